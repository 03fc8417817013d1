//! What an interrupted bake leaves behind: the traced rows of finished chunks.
//!
//! One file a chunk under `WORLD/.bake/HASH/`, written whole or not at all. They are scratch: another hash
//! is another bake, a damaged file is traced again, and the folder goes when the world is whole.
//!
//! │ xxh3 of the rest, u64 │ row count, u32 │ entry counts, u32 each │ sky 6 x f32, absorbed f32 and rays u32 each │ entries (u32, f32) │

use crate::BakeError;
use crate::rows::RawRow;
use earthshine_tiles::write_atomic;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Folder inside a world that holds checkpoints while it is being baked.
pub const FOLDER: &str = ".bake";

/// The checkpoints of one bake.
#[derive(Debug)]
pub struct Checkpoints {
    folder: PathBuf,
}

impl Checkpoints {
    /// Opens, or makes, the checkpoints of the bake `world_hash` in `world`.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub fn open(world: &Path, world_hash: u64) -> Result<Self, BakeError> {
        let folder = world.join(FOLDER).join(format!("{world_hash:016x}"));
        std::fs::create_dir_all(&folder).map_err(BakeError::io(&folder))?;
        Ok(Self { folder })
    }

    /// The rows of `chunk` if an earlier run finished them and the file is sound.
    #[must_use]
    pub fn load(&self, chunk: [i32; 3], row_count: usize, patch_count: usize) -> Option<Vec<RawRow>> {
        decode(&std::fs::read(self.path(chunk)).ok()?, row_count, patch_count)
    }

    /// Keeps the rows of `chunk`.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, chunk: [i32; 3], rows: &[RawRow]) -> Result<(), BakeError> {
        Ok(write_atomic(&self.path(chunk), &encode(rows))?)
    }

    /// Removes the scratch of every bake of `world`.
    ///
    /// # Errors
    /// The folder is there and cannot be removed.
    pub fn clear(world: &Path) -> Result<(), BakeError> {
        let folder = world.join(FOLDER);
        match std::fs::remove_dir_all(&folder) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(BakeError::io(folder)(error)),
            _ => Ok(()),
        }
    }

    /// Those of receivers' rows, beside those of patches.
    #[must_use]
    pub fn of_receivers(&self) -> Self {
        Self { folder: self.folder.join("receivers") }
    }

    fn path(&self, [x, y, z]: [i32; 3]) -> PathBuf {
        self.folder.join(format!("{x}_{y}_{z}.rows"))
    }
}

fn encode(rows: &[RawRow]) -> Vec<u8> {
    let mut bytes = vec![0; 8];
    bytes.extend((rows.len() as u32).to_le_bytes());
    rows.iter().for_each(|row| bytes.extend((row.entries.len() as u32).to_le_bytes()));
    for row in rows {
        row.sky.iter().chain([&row.absorbed]).for_each(|share| bytes.extend(share.to_le_bytes()));
        bytes.extend(row.rays.to_le_bytes());
    }
    for (patch, share) in rows.iter().flat_map(|row| &row.entries) {
        bytes.extend(patch.to_le_bytes());
        bytes.extend(share.to_le_bytes());
    }
    let hash = xxh3_64(&bytes[8..]);
    bytes[..8].copy_from_slice(&hash.to_le_bytes());
    bytes
}

fn decode(bytes: &[u8], row_count: usize, patch_count: usize) -> Option<Vec<RawRow>> {
    let (hash, body) = bytes.split_first_chunk::<8>()?;
    if u64::from_le_bytes(*hash) != xxh3_64(body) {
        return None;
    }
    let mut words = body.chunks_exact(4).map(|word| [word[0], word[1], word[2], word[3]]);
    let mut next = || words.next();
    if u32::from_le_bytes(next()?) as usize != row_count {
        return None;
    }
    let counts: Vec<u32> = (0..row_count).map(|_| next().map(u32::from_le_bytes)).collect::<Option<_>>()?;
    let mut rows = vec![RawRow::default(); row_count];
    for row in &mut rows {
        for share in &mut row.sky {
            *share = f32::from_le_bytes(next()?);
        }
        row.absorbed = f32::from_le_bytes(next()?);
        row.rays = u32::from_le_bytes(next()?);
    }
    for (row, count) in rows.iter_mut().zip(counts) {
        for _ in 0..count {
            let patch = u32::from_le_bytes(next()?);
            if patch as usize >= patch_count {
                return None;
            }
            row.entries.push((patch, f32::from_le_bytes(next()?)));
        }
    }
    next().is_none().then_some(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_and_damage_is_noticed() {
        let rows = vec![
            RawRow {
                entries: vec![(1, 0.25), (7, 0.5)],
                sky: [0.1, 0.0, 0.0, 0.0, 0.05, 0.0],
                absorbed: 0.1,
                rays: 64,
            },
            RawRow::default(),
        ];
        let bytes = encode(&rows);
        assert_eq!(decode(&bytes, 2, 8), Some(rows));
        assert_eq!(decode(&bytes, 2, 7), None);
        assert_eq!(decode(&bytes, 3, 8), None);
        for at in 0..bytes.len() {
            let mut flipped = bytes.clone();
            flipped[at] ^= 0x10;
            assert_eq!(decode(&flipped, 2, 8), None, "byte {at}");
            assert_eq!(decode(&bytes[..at], 2, 8), None, "cut at {at}");
        }
    }
}
