//! Which patches of one level make which patch of the next, and what number that has in its chunk.
//!
//! Coarse patches are ordered as fine ones are: by chunk, then direction, then Morton code. What emits is a patch of its own
//! on every level, and comes second: far light of a flame is not that of the wall behind it. In chunks that have too few
//! numbers for that, the two share one, as they do on level 0.

use crate::apart::CHUNK_EDGE_MAX;
use crate::patches::morton;
use earthshine_world::{ChunkId, Direction, Grid, Patch, VoxelCoord};
use std::collections::BTreeMap;
use xxhash_rust::xxh3::Xxh3Default;

/// One patch of a finer level: a chunk and a patch of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Child {
    pub(super) chunk: ChunkId,
    pub(super) local: u16,
}

/// A coarse patch before it is merged.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) voxel: VoxelCoord,
    pub(super) direction: Direction,
    /// Ascending by chunk, then patch; at most eight, more where patches are clusters.
    pub(super) children: Vec<Child>,
}

/// A level's patches and their children.
#[derive(Debug)]
pub(super) struct Numbering {
    places: BTreeMap<ChunkId, Vec<Place>>,
    /// Of each patch of each finer chunk: its parent's number in the parent chunk.
    parents: BTreeMap<ChunkId, Vec<u16>>,
    hash: u64,
}

impl Numbering {
    /// Numbers the level above `finer`, whose chunks have `chunk_edge_voxels` along an edge.
    ///
    /// # Panics
    /// If a chunk has more patches than numbers, which none of an edge that a bake takes has.
    pub(super) fn new(finer: &BTreeMap<ChunkId, Vec<Patch>>, chunk_edge_voxels: u32) -> Self {
        let is_parted = chunk_edge_voxels <= CHUNK_EDGE_MAX;
        let mut keyed: BTreeMap<ChunkId, BTreeMap<(Direction, u32, bool), Place>> = BTreeMap::new();
        for (&chunk, patches) in finer {
            let corner = chunk.parent().coord * chunk_edge_voxels.cast_signed();
            let parent = keyed.entry(chunk.parent()).or_default();
            for (local, patch) in patches.iter().enumerate() {
                let voxel = Grid::parent_voxel(patch.voxel);
                let (direction, code) = (patch.direction, morton((voxel - corner).to_array()));
                let is_emitter = is_parted && patch.emits();
                let place = parent.entry((direction, code, is_emitter)).or_insert_with(|| Place {
                    voxel,
                    direction,
                    children: Vec::new(),
                });
                place.children.push(Child { chunk, local: numbered(local) });
            }
        }
        let mut parents: BTreeMap<ChunkId, Vec<u16>> =
            finer.iter().map(|(&chunk, patches)| (chunk, vec![0; patches.len()])).collect();
        let mut places: BTreeMap<ChunkId, Vec<Place>> = BTreeMap::new();
        let mut hash = Xxh3Default::new();
        for (id, keyed) in keyed {
            let mut list = Vec::with_capacity(keyed.len());
            for ((direction, _, is_emitter), place) in keyed {
                let number = numbered(list.len());
                hash.update(bytemuck::cast_slice(&place.voxel.to_array()));
                hash.update(&[direction as u8, u8::from(is_emitter)]);
                hash.update(&(place.children.len() as u64).to_le_bytes());
                for child in &place.children {
                    hash.update(&[child.chunk.level]);
                    hash.update(bytemuck::cast_slice(&child.chunk.coord.to_array()));
                    hash.update(bytemuck::cast_slice(&[child.local, number]));
                    if let Some(numbers) = parents.get_mut(&child.chunk) {
                        numbers[usize::from(child.local)] = number;
                    }
                }
                list.push(place);
            }
            places.insert(id, list);
        }
        Self { places, parents, hash: hash.digest() }
    }

    /// The patches of coarse chunk `id`.
    pub(super) fn places(&self, id: ChunkId) -> &[Place] {
        self.places.get(&id).map_or(&[], Vec::as_slice)
    }

    /// The number of each fine patch's parent in the parent of `chunk`.
    pub(super) fn parents(&self, chunk: ChunkId) -> &[u16] {
        self.parents.get(&chunk).map_or(&[], Vec::as_slice)
    }

    /// The same of all finer chunks.
    pub(super) fn into_parents(self) -> BTreeMap<ChunkId, Vec<u16>> {
        self.parents
    }

    /// Changes with any place of any patch, and with whose child any is.
    pub(super) fn hash(&self) -> u64 {
        self.hash
    }
}

/// The number of the patch at place `at` of its chunk.
fn numbered(at: usize) -> u16 {
    u16::try_from(at).expect("a chunk has at most 65,536 patches")
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::{Rgb, Vec3};

    fn patch(voxel: VoxelCoord, direction: Direction, emission: Rgb) -> Patch {
        Patch {
            voxel,
            direction,
            area: 1.0,
            centroid: Vec3::ZERO,
            reflectance: Rgb::ZERO,
            emission,
            point_first: 0,
            point_count: 1,
        }
    }

    /// Goal: the fullest coarse chunk has a number for each patch. Method: both kinds of patches in every place of one, with
    /// the largest chunks that have numbers for both, and with the largest there are.
    #[test]
    fn a_full_chunk_has_numbers_for_all() {
        for (chunk_edge_voxels, kinds) in [(CHUNK_EDGE_MAX, 2), (Grid::CHUNK_EDGE_VOXELS_MAX, 1)] {
            let grid = Grid { voxel_edge_m: 1.0, chunk_edge_voxels };
            let edge = chunk_edge_voxels.cast_signed();
            let mut finer: BTreeMap<ChunkId, Vec<Patch>> = BTreeMap::new();
            for place in 0..edge.pow(3) {
                let at = VoxelCoord::new(place / (edge * edge), place / edge % edge, place % edge);
                let own = finer.entry(ChunkId::new(0, grid.chunk_of(at * 2))).or_default();
                for direction in Direction::ALL {
                    own.extend([Rgb::ZERO, Rgb::ONE].map(|emission| patch(at * 2, direction, emission)));
                }
            }
            let numbering = Numbering::new(&finer, chunk_edge_voxels);
            let count = numbering.places(ChunkId::new(1, VoxelCoord::ZERO)).len();
            assert_eq!(count, (kinds * 6 * edge.pow(3)) as usize);
            let last = finer.keys().flat_map(|&chunk| numbering.parents(chunk)).max();
            assert_eq!(last.map(|&last| usize::from(last) + 1), Some(count));
        }
    }

    #[test]
    fn the_hash_knows_what_emits_and_who_is_whose_child() {
        let hash = |patches: &[Patch]| {
            let chunk = ChunkId::new(0, VoxelCoord::ZERO);
            Numbering::new(&BTreeMap::from([(chunk, patches.to_vec())]), 4).hash()
        };
        let [near, far] = [0, 2].map(|x| patch(VoxelCoord::new(x, 0, 0), Direction::PosX, Rgb::ZERO));
        let glowing = Patch { emission: Rgb::ONE, ..near };
        let hashes =
            [hash(&[near, far]), hash(&[far, near]), hash(&[glowing, far]), hash(&[near, near, far])];
        for (place, one) in hashes.iter().enumerate() {
            assert!(!hashes[..place].contains(one), "{place}: {hashes:?}");
        }
        assert_eq!(hash(&[near, far]), hashes[0]);
    }
}
