//! Tiles as the bake writes them: encode, describe, put under their name.

use crate::BakeError;
use earthshine_tiles::{ChunkEntry, EncodeOptions, encode, tile_file_name, tile_hash, write_atomic};
use earthshine_world::Chunk;
use std::path::{Path, PathBuf};

/// Where tiles go, and how they are encoded.
#[derive(Debug)]
pub(crate) struct TileFiles<'a> {
    /// The world's folder.
    pub(crate) world: &'a Path,
    /// Codec and world hash.
    pub(crate) encoding: EncodeOptions,
}

impl TileFiles<'_> {
    /// Where the tile of `entry` is.
    pub(crate) fn path(&self, entry: &ChunkEntry) -> PathBuf {
        self.world.join(&entry.file)
    }

    /// Writes the tile of `chunk` and describes it for the manifest.
    pub(crate) fn put(&self, chunk: &Chunk, input_hash: u64) -> Result<ChunkEntry, BakeError> {
        let bytes = encode(chunk, &self.encoding)?;
        let hash = tile_hash(&bytes);
        let entry = ChunkEntry {
            level: chunk.id.level,
            coord: chunk.id.coord.to_array(),
            file: tile_file_name(chunk.id, hash),
            tile_bytes: bytes.len() as u64,
            tile_hash: hash,
            input_hash,
            patch_count: chunk.patches.len() as u32,
            nonzero_count: chunk.rows.columns.len() as u64,
            receiver_count: chunk.receivers.places.len() as u32,
            receiver_nonzero_count: chunk.receivers.rows.columns.len() as u64,
        };
        write_atomic(&self.path(&entry), &bytes)?;
        Ok(entry)
    }
}
