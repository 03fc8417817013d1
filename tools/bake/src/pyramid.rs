//! Coarse levels, bottom-up: each is merged from the tiles of the one below, like the overviews of an image.
//!
//! A coarse patch is what all its children are together (`merge`): areas add, exchanges add, everything else is
//! weighted by area, so no level has more or less energy than another ([`check`]). Nothing is traced: a pyramid
//! can be added to a world whose level 0 is finished, and needs no more memory than a few chunks and the
//! list of patches (`numbering`). It stops at a level that is small enough to be held whole by everyone.

pub mod check;
mod merge;
mod numbering;
mod occluders;

use crate::BakeError;
use crate::progress::{Progress, Stage};
use crate::shard::{Shard, for_all, visits};
use crate::tile_files::TileFiles;
use earthshine_tiles::{BakeParameters, ChunkEntry, MappedTile, limits};
use earthshine_world::{Chunk, ChunkId, Patch};
use merge::Merge;
use numbering::Numbering;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A level of at most this many patches is the top: its matrix takes 3 MiB, so every session holds all of it.
pub const TOP_PATCHES_MAX: u64 = 512;

/// Raised when the same finer tiles would give other coarse tiles than before.
const RECIPE: u32 = 2;

/// Of each patch of the chunks `finer` of a level, which have `chunk_edge_voxels` along an edge: its parent's number in the chunk
/// above.
///
/// # Panics
/// If a chunk has more patches than numbers, which none of an edge that a bake takes has.
#[must_use]
pub fn parent_numbers(
    finer: &BTreeMap<ChunkId, Vec<Patch>>,
    chunk_edge_voxels: u32,
) -> BTreeMap<ChunkId, Vec<u16>> {
    Numbering::new(finer, chunk_edge_voxels).into_parents()
}

/// How many levels a world gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Levels {
    /// Up to the first with at most [`TOP_PATCHES_MAX`] patches.
    #[default]
    Auto,
    /// So many, level 0 included; 1 to 16.
    Exactly(u8),
}

impl Levels {
    /// Most levels there can be.
    pub const MAX: u8 = limits::LEVEL_MAX + 1;

    /// Whether a world whose levels hold `patch_counts`, finest first, needs one more.
    pub(crate) fn wants_more(self, patch_counts: &[u64]) -> bool {
        let levels = patch_counts.len();
        let wanted = match self {
            Self::Auto => patch_counts.last().is_some_and(|&count| count > TOP_PATCHES_MAX),
            Self::Exactly(wanted) => levels < usize::from(wanted),
        };
        wanted && levels < usize::from(Self::MAX)
    }

    /// Whether a world whose levels hold `patch_counts` has just these levels.
    pub(crate) fn are(self, patch_counts: &[u64]) -> bool {
        let shorter = &patch_counts[..patch_counts.len().saturating_sub(1)];
        !self.wants_more(patch_counts) && (shorter.is_empty() || self.wants_more(shorter))
    }
}

impl std::str::FromStr for Levels {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse::<u8>() {
            _ if text == "auto" => Ok(Self::Auto),
            Ok(count) if (1..=Self::MAX).contains(&count) => Ok(Self::Exactly(count)),
            _ => Err(format!("{text:?} is neither auto nor a number of levels from 1 to {}", Self::MAX)),
        }
    }
}

/// Patches of each level of `chunks`, finest first.
pub(crate) fn patch_counts(chunks: &[ChunkEntry]) -> Vec<u64> {
    let mut counts = Vec::new();
    for chunk in chunks {
        counts.resize(counts.len().max(usize::from(chunk.level) + 1), 0);
        counts[usize::from(chunk.level)] += u64::from(chunk.patch_count);
    }
    counts
}

/// Appends the coarser levels to `chunks`, which holds level 0 alone, ascending.
///
/// # Errors
/// A tile cannot be read or written.
pub(crate) fn build(
    chunks: &mut Vec<ChunkEntry>,
    files: &TileFiles<'_>,
    parameters: &BakeParameters,
    levels: Levels,
    shard: Shard,
    progress: &dyn Progress,
) -> Result<(), BakeError> {
    let mut finer = chunks.clone();
    while levels.wants_more(&patch_counts(chunks)) {
        finer = next_level(&finer, files, parameters, shard, progress)?;
        chunks.extend_from_slice(&finer);
    }
    Ok(())
}

/// The level above the one whose chunks are `finer`.
fn next_level(
    finer: &[ChunkEntry],
    files: &TileFiles<'_>,
    parameters: &BakeParameters,
    shard: Shard,
    progress: &dyn Progress,
) -> Result<Vec<ChunkEntry>, BakeError> {
    let mut families: BTreeMap<ChunkId, Vec<&ChunkEntry>> = BTreeMap::new();
    for child in finer {
        families.entry(child.id().parent()).or_default().push(child);
    }
    progress.begin(Stage::Pyramid, families.len() as u64);
    let patches = finer
        .par_iter()
        .map(|entry| Ok((entry.id(), MappedTile::open(&files.path(entry))?.decode_patches()?)))
        .collect::<Result<BTreeMap<_, _>, BakeError>>()?;
    let numbering = Numbering::new(&patches, parameters.grid.chunk_edge_voxels);
    drop(patches);
    let families: Vec<(ChunkId, Vec<&ChunkEntry>)> = families.into_iter().collect();
    let coords: Vec<[i32; 3]> = families.iter().map(|(id, _)| id.coord.to_array()).collect();
    let mut entries = for_all(&visits(shard, &coords), |number| {
        let (id, family) = &families[number];
        let entry = match files.finished(*id) {
            Some(entry) => entry,
            None => {
                let children = family
                    .iter()
                    .map(|entry| Ok(MappedTile::open(&files.path(entry))?.decode()?))
                    .collect::<Result<Vec<Chunk>, BakeError>>()?;
                let merged =
                    Merge { id: *id, children: &children, numbering: &numbering, parameters }.chunk();
                files.put(&merged, input_hash(family, &numbering, parameters))?
            }
        };
        progress.advance(1);
        Ok(entry)
    })?;
    entries.sort_by_key(ChunkEntry::id);
    Ok(entries)
}

/// Hash of what the tile merged from `family` depends on.
fn input_hash(family: &[&ChunkEntry], numbering: &Numbering, parameters: &BakeParameters) -> u64 {
    let mut hash = xxhash_rust::xxh3::Xxh3Default::new();
    hash.update(&RECIPE.to_le_bytes());
    hash.update(&parameters.content_hash().to_le_bytes());
    // Columns are numbers of patches elsewhere.
    hash.update(&numbering.hash().to_le_bytes());
    family.iter().for_each(|child| hash.update(&child.tile_hash.to_le_bytes()));
    hash.digest()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pyramid_ends_with_the_first_small_level_or_as_asked() {
        assert!(Levels::Auto.wants_more(&[600]) && !Levels::Auto.wants_more(&[600, 512]));
        assert!(!Levels::Auto.wants_more(&[9999; 16]), "there is no level 16");
        assert!(Levels::Auto.are(&[600, 100]) && Levels::Auto.are(&[3]));
        assert!(!Levels::Auto.are(&[600]) && !Levels::Auto.are(&[600, 100, 30]));
        assert!(Levels::Exactly(2).are(&[6, 1]) && !Levels::Exactly(2).are(&[6]));
        assert!(!Levels::Exactly(1).are(&[6, 1]));
    }

    #[test]
    fn levels_are_read_from_words() {
        assert_eq!("auto".parse(), Ok(Levels::Auto));
        assert_eq!("16".parse(), Ok(Levels::Exactly(16)));
        for wrong in ["0", "17", "", "many"] {
            assert!(wrong.parse::<Levels>().unwrap_err().contains("auto"), "{wrong}");
        }
    }
}
