//! Tiles as the bake writes them: encode, describe, put under their name; and what was done is noted.

use crate::BakeError;
use crate::words::{Reader, Writer};
use crate::work_folder::{Kind, Stamp, WorkFolder};
use earthshine_tiles::{ChunkEntry, EncodeOptions, encode, tile_file_name, tile_hash, write_atomic};
use earthshine_world::{Chunk, ChunkId};
use glam::IVec3;
use std::path::{Path, PathBuf};

/// Where tiles go, and how they are encoded.
#[derive(Debug)]
pub(crate) struct TileFiles<'a> {
    /// The world's folder.
    pub(crate) world: &'a Path,
    /// Codec and world hash.
    pub(crate) encoding: EncodeOptions,
    /// Where finished tiles are noted.
    pub(crate) work: &'a WorkFolder,
    /// Hash of the scene and the parameters.
    pub(crate) content_hash: u64,
}

impl TileFiles<'_> {
    /// Where the tile of `entry` is.
    pub(crate) fn path(&self, entry: &ChunkEntry) -> PathBuf {
        self.world.join(&entry.file)
    }

    /// The tile of chunk `id` if an earlier run of this bake, or another process, has finished it.
    pub(crate) fn finished(&self, id: ChunkId) -> Option<ChunkEntry> {
        let (stamp, payload) = self.work.read(Kind::Tiles, id.level, id.coord.to_array())?;
        let entry = decode(&payload, id)?;
        (stamp == self.stamp() && is_there(self.world, &entry)).then_some(entry)
    }

    /// Writes the tile of `chunk`, unless it is there, and describes it for the manifest.
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
        // The name holds the hash: what is there under it is this tile, perhaps mapped by a server.
        if !is_there(self.world, &entry) {
            write_atomic(&self.path(&entry), &bytes)?;
        }
        self.work.write(Kind::Tiles, entry.level, entry.coord, &self.stamp(), &encode_entry(&entry))?;
        Ok(entry)
    }

    fn stamp(&self) -> Stamp {
        Stamp { key: self.content_hash, own: self.encoding.codec as u64, ..Stamp::default() }
    }
}

/// Whether the tile of `entry` is in the folder `world`, to go by its name and length.
pub(crate) fn is_there(world: &Path, entry: &ChunkEntry) -> bool {
    std::fs::metadata(world.join(&entry.file)).is_ok_and(|file| file.len() == entry.tile_bytes)
}

fn encode_entry(entry: &ChunkEntry) -> Vec<u8> {
    let mut out = Writer::default();
    let words = [entry.tile_bytes, entry.tile_hash, entry.input_hash];
    let counts = [entry.nonzero_count, entry.receiver_nonzero_count];
    words.into_iter().chain(counts).for_each(|word| out.u64(word));
    out.u32s([entry.patch_count, entry.receiver_count]);
    out.0
}

fn decode(payload: &[u8], id: ChunkId) -> Option<ChunkEntry> {
    let mut reader = Reader(payload);
    let (tile_bytes, tile_hash, input_hash) = (reader.u64()?, reader.u64()?, reader.u64()?);
    let (nonzero_count, receiver_nonzero_count) = (reader.u64()?, reader.u64()?);
    let (patch_count, receiver_count) = (reader.u32()?, reader.u32()?);
    reader.is_empty().then(|| ChunkEntry {
        level: id.level,
        coord: IVec3::to_array(&id.coord),
        file: tile_file_name(id, tile_hash),
        tile_bytes,
        tile_hash,
        input_hash,
        patch_count,
        nonzero_count,
        receiver_count,
        receiver_nonzero_count,
    })
}
