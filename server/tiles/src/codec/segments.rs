//! The chunks that a tile's columns point into, ascending.

use super::Decoded;
use crate::limits;
use bytemuck::{Pod, Zeroable};
use earthshine_world::{ChunkCoord, ChunkId};

const _: () = assert!(size_of::<SegmentRecord>() == 16, "a segment is 16 bytes on disk");

/// A chunk's identity.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct SegmentRecord {
    coord: [i32; 3],
    level: u32,
}

pub(crate) fn encode(segments: &[ChunkId]) -> Vec<u8> {
    let record = |id: &ChunkId| SegmentRecord { coord: id.coord.to_array(), level: u32::from(id.level) };
    bytemuck::cast_slice(&segments.iter().map(record).collect::<Vec<_>>()).to_vec()
}

pub(crate) fn decode(raw: &[u8]) -> Decoded<Vec<ChunkId>> {
    let mut segments = Vec::with_capacity(raw.len() / size_of::<SegmentRecord>());
    for bytes in raw.chunks_exact(size_of::<SegmentRecord>()) {
        let record: SegmentRecord = bytemuck::pod_read_unaligned(bytes);
        if record.level > u32::from(limits::LEVEL_MAX) {
            return Err(format!("a segment of level {}", record.level));
        }
        segments.push(ChunkId::new(record.level as u8, ChunkCoord::from_array(record.coord)));
    }
    if !segments.is_sorted_by(|a, b| a < b) {
        return Err("the segments do not ascend".to_owned());
    }
    Ok(segments)
}
