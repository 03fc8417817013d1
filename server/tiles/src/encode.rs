//! One chunk to the bytes of its tile. The same chunk and options give the same bytes anywhere.

use crate::checksum;
use crate::codec::zstd_frame::Packer;
use crate::codec::{Decoded, RowCodec, occluders, patches, points, receivers, row_encode, segments};
use crate::error::TileError;
use crate::format::{Frame, GroupCounts, MAGIC, SectionEntry, TileHeader, VERSION};
use crate::{limits, structure};
use earthshine_world::{Chunk, ChunkRows};
use std::path::Path;

/// How to encode, and for which world.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EncodeOptions {
    /// Hash of bake parameters: a tile of another world is refused by the store.
    pub world_hash: u64,
    /// How rows are stored.
    pub codec: RowCodec,
    /// zstd level, clamped to what zstd has; 3 is the default.
    pub zstd_level: i32,
}

impl EncodeOptions {
    /// zstd level 3 was measured: higher levels gain little on shares, which are mostly noise.
    pub const ZSTD_LEVEL_DEFAULT: i32 = 3;

    /// The defaults, for the world with hash `world_hash`.
    #[must_use]
    pub fn new(world_hash: u64) -> Self {
        Self { world_hash, codec: RowCodec::default(), zstd_level: Self::ZSTD_LEVEL_DEFAULT }
    }
}

/// The tile of `chunk`.
///
/// # Errors
/// [`TileError::Unencodable`] if the chunk's parts do not fit together or hold impossible numbers,
/// [`TileError::Limit`] if it is too large for a tile.
pub fn encode(chunk: &Chunk, options: &EncodeOptions) -> Result<Vec<u8>, TileError> {
    let unencodable = |cause| TileError::Unencodable { chunk: chunk.id, cause };
    structure::check(chunk).map_err(unencodable)?;
    let mut header = header_of(chunk, options);
    header.check_limits(Path::new(&format!("chunk {}", chunk.id)))?;
    let frames = encode_frames(chunk, options).map_err(unencodable)?;

    header.section_count = frames.len() as u32;
    let mut offset = header.frames_offset();
    let mut table = Vec::with_capacity(frames.len() * size_of::<SectionEntry>());
    for (frame, raw_bytes, bytes) in &frames {
        let (kind, group) = frame.numbers();
        let hash = checksum::hash(bytes);
        let (stored_bytes, raw_bytes) = (bytes.len() as u32, *raw_bytes as u32);
        let entry = SectionEntry { kind, group, offset, stored_bytes, raw_bytes, hash };
        table.extend_from_slice(bytemuck::bytes_of(&entry));
        offset += bytes.len() as u64;
    }
    header.file_bytes = offset;
    header.check_limits(Path::new(&format!("chunk {}", chunk.id)))?;
    header.table_hash = checksum::hash(&table);
    header.header_hash = header.own_hash();

    let mut tile = Vec::with_capacity(offset as usize);
    tile.extend_from_slice(bytemuck::bytes_of(&header));
    tile.extend_from_slice(&table);
    for (_, _, bytes) in &frames {
        tile.extend_from_slice(bytes);
    }
    Ok(tile)
}

fn header_of(chunk: &Chunk, options: &EncodeOptions) -> TileHeader {
    let count = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
    TileHeader {
        magic: MAGIC,
        version: VERSION,
        row_codec: options.codec as u32,
        world_hash: options.world_hash,
        file_bytes: 0,
        coord: chunk.id.coord.to_array(),
        level: u32::from(chunk.id.level),
        patch_count: count(chunk.patches.len()),
        point_count: count(chunk.points.len()),
        nonzero_count: chunk.rows.columns.len() as u64,
        segment_count: count(chunk.rows.segments.len()),
        section_count: 0,
        vertex_count: count(chunk.occluders.vertices.len()),
        triangle_count: count(chunk.occluders.triangles.len()),
        receiver_count: count(chunk.receivers.places.len()),
        receiver_segment_count: count(chunk.receivers.rows.segments.len()),
        receiver_nonzero_count: chunk.receivers.rows.columns.len() as u64,
        table_hash: 0,
        header_hash: 0,
    }
}

/// Each frame with its length before zstd and its bytes after, in file order.
fn encode_frames(chunk: &Chunk, options: &EncodeOptions) -> Decoded<Vec<(Frame, usize, Vec<u8>)>> {
    let mut packer = Packer::new(options.zstd_level);
    let groups = GroupCounts::of(chunk.patches.len() as u32, chunk.receivers.places.len() as u32);
    let packed_rows = |rows: &ChunkRows, group: u32, packer: &mut Packer| {
        let first = (group * limits::ROWS_PER_GROUP) as usize;
        let range = first..rows.row_count().min(first + limits::ROWS_PER_GROUP as usize);
        row_encode::encode(rows, range, options.codec, packer)
    };
    Frame::in_order(groups)
        .map(|frame| {
            let raw = match frame {
                Frame::Rows(group) => {
                    let packed = packed_rows(&chunk.rows, group, &mut packer)?;
                    return Ok((frame, packed.raw_bytes, packed.frame));
                }
                Frame::ReceiverRows(group) => {
                    let packed = packed_rows(&chunk.receivers.rows, group, &mut packer)?;
                    return Ok((frame, packed.raw_bytes, packed.frame));
                }
                Frame::Receivers => receivers::encode(&chunk.receivers.places),
                Frame::ReceiverSegments => segments::encode(&chunk.receivers.rows.segments),
                Frame::Points => points::encode(&chunk.points)?,
                Frame::Segments => segments::encode(&chunk.rows.segments),
                Frame::Occluders => occluders::encode(&chunk.occluders),
                Frame::Header | Frame::Table | Frame::Patches => patches::encode(&chunk.patches),
            };
            Ok((frame, raw.len(), packer.pack(&[&raw])?))
        })
        .collect()
}
