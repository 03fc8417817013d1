//! Tests with tiles that lie: every checksum is right, the contents are not.

use crate::checksum;
use crate::codec::zstd_frame::{Packer, Unpacker};
use crate::error::TileError;
use crate::format::{Frame, SectionEntry, TileHeader, VERSION_OLDEST};
use crate::reader::Layout;
use crate::{EncodeOptions, RowCodec, decode_bytes, encode, limits, structure};
use earthshine_world::{
    Chunk, ChunkCoord, ChunkId, ChunkRows, Column, Direction, OccluderMesh, Patch, ReceiverPlace, Receivers,
    SamplePoint, Vec3,
};
use std::path::Path;

const PATCHES: u32 = 33;

/// A sound chunk with two row groups.
fn chunk() -> Chunk {
    let id = ChunkId::new(0, ChunkCoord::ONE);
    let other = ChunkId::new(0, ChunkCoord::splat(2));
    let patch = |index| Patch {
        voxel: ChunkCoord::new(16, 16, 16),
        direction: Direction::PosY,
        area: 1.0,
        centroid: Vec3::splat(16.5),
        reflectance: Vec3::splat(0.5),
        emission: Vec3::ZERO,
        point_first: index,
        point_count: 1,
    };
    let point = |index| SamplePoint { position: Vec3::splat(16.0 + index as f32 / 64.0), normal: Vec3::Y };
    let columns =
        (0..12).map(|local| Column { segment: 0, local }).chain([Column { segment: 1, local: 700 }]);
    let count = PATCHES as usize;
    let rows = ChunkRows {
        segments: vec![id, other],
        row_starts: (0..=PATCHES).map(|row| row * 13).collect(),
        columns: (0..PATCHES).flat_map(|_| columns.clone()).collect(),
        shares: vec![0.06; count * 13],
        sky_shares: vec![[0.1, 0.0, 0.05, 0.0, 0.0, 0.0]; count],
        absorbed_shares: vec![0.07; count],
    };
    let occluders = OccluderMesh {
        vertices: vec![Vec3::X, Vec3::Y, Vec3::Z],
        triangles: vec![[0, 1, 2]],
        surfaces: vec![[9; 4]],
    };
    let (patches, points) = ((0..PATCHES).map(patch).collect(), (0..PATCHES).map(point).collect());
    let receivers = receivers(&rows);
    Chunk { id, patches, points, rows, receivers, occluders }
}

/// Five receivers above the patches, with the first five of `rows`.
fn receivers(rows: &ChunkRows) -> Receivers {
    const COUNT: usize = 5;
    let place = |index: usize| ReceiverPlace::in_air(ChunkCoord::new(16, 17, 16), Direction::ALL[index]);
    let entries = rows.row_starts[COUNT] as usize;
    let rows = ChunkRows {
        segments: rows.segments.clone(),
        row_starts: rows.row_starts[..=COUNT].to_vec(),
        columns: rows.columns[..entries].to_vec(),
        shares: rows.shares[..entries].to_vec(),
        sky_shares: rows.sky_shares[..COUNT].to_vec(),
        absorbed_shares: rows.absorbed_shares[..COUNT].to_vec(),
    };
    Receivers { places: (0..COUNT).map(place).collect(), rows }
}

fn tile(codec: RowCodec) -> Vec<u8> {
    encode(&chunk(), &EncodeOptions { codec, ..EncodeOptions::new(1) }).unwrap()
}

fn decode(tile: &[u8]) -> Result<Chunk, TileError> {
    decode_bytes(tile, Path::new("hostile.tile"))
}

/// The frames of `tile`, decompressed, with its header.
fn take_apart(tile: &[u8]) -> (TileHeader, Vec<(SectionEntry, Vec<u8>)>) {
    let layout = Layout::parse(tile, Path::new("hostile.tile")).unwrap();
    let frames = layout.sections.iter().map(|entry| {
        let stored = &tile[entry.offset as usize..][..entry.stored_bytes as usize];
        (*entry, Unpacker::new().unpack(stored, entry.raw_bytes).unwrap().to_vec())
    });
    let frames = frames.collect();
    (layout.header, frames)
}

/// A tile of these parts with everything that is derived made right.
fn put_together(mut header: TileHeader, frames: &[(SectionEntry, Vec<u8>)]) -> Vec<u8> {
    header.section_count = frames.len() as u32;
    let mut packer = Packer::new(1);
    let (mut table, mut bytes) = (Vec::new(), Vec::new());
    for (entry, raw) in frames {
        let stored = packer.pack(&[raw]).unwrap();
        let offset = header.frames_offset() + bytes.len() as u64;
        let (stored_bytes, hash) = (stored.len() as u32, checksum::hash(&stored));
        table.push(SectionEntry { offset, stored_bytes, hash, ..*entry });
        bytes.extend(stored);
    }
    header.file_bytes = header.frames_offset() + bytes.len() as u64;
    header.table_hash = checksum::hash(bytemuck::cast_slice(&table));
    sealed(header, &table, &bytes)
}

fn sealed(mut header: TileHeader, table: &[SectionEntry], frames: &[u8]) -> Vec<u8> {
    header.header_hash = header.own_hash();
    [bytemuck::bytes_of(&header), bytemuck::cast_slice(table), frames].concat()
}

/// Goal: worlds that were baked before there were barriers, or layers, are read. Method: the same tile as their versions wrote
/// it, where receivers had four or six bytes less each, in byte planes of their own.
#[test]
fn tiles_of_the_versions_before_are_read() {
    for (version, bytes) in [(VERSION_OLDEST, 16), (VERSION_OLDEST + 1, 18)] {
        let (header, mut frames) = take_apart(&tile(RowCodec::Half));
        let receivers = frames.iter_mut().find(|(entry, _)| entry.kind == Frame::Receivers.numbers().0);
        let (entry, raw) = receivers.expect("a frame of receivers");
        raw.truncate(header.receiver_count as usize * bytes);
        entry.raw_bytes = raw.len() as u32;
        let old = put_together(TileHeader { version, ..header }, &frames);
        assert_eq!(decode(&old).unwrap().receivers, decode(&tile(RowCodec::Half)).unwrap().receivers);
        let claimed = put_together(header, &frames);
        assert!(
            decode(&claimed).unwrap_err().to_string().contains("receivers"),
            "the new version has longer ones than {version}"
        );
    }
}

/// Goal: no contents can make the reader panic, or give out what others would index out of bounds with.
/// Method: flip bytes of every decompressed frame, compress and seal again, decode.
#[test]
fn altered_contents_are_refused_or_sound() {
    for codec in [RowCodec::Half, RowCodec::Full] {
        let (header, frames) = take_apart(&tile(codec));
        let (mut refused, mut sound) = (0, 0);
        for index in 0..frames.len() {
            for at in (0..frames[index].1.len()).step_by(if index == 0 { 5 } else { 1 }) {
                for mask in [0xFF, 0x80, 0x01] {
                    let mut frames = frames.clone();
                    frames[index].1[at] ^= mask;
                    match decode(&put_together(header, &frames)) {
                        Ok(chunk) => {
                            structure::check(&chunk).or_else(shares_may_be_large).unwrap();
                            sound += 1;
                        }
                        Err(TileError::Structure { .. }) => refused += 1,
                        Err(other) => panic!("frame {index}, byte {at}: {other}"),
                    }
                }
            }
        }
        assert!(refused > 500 && sound > 500, "{refused} refused, {sound} sound");
    }
}

/// A scale that is too small makes shares of up to 8: finite, positive, and the row's sum tells.
fn shares_may_be_large(cause: String) -> Result<(), String> {
    if cause.contains("has the share") && !cause.contains('-') && !cause.contains("NaN") {
        Ok(())
    } else {
        Err(cause)
    }
}

#[test]
fn frames_of_other_lengths_are_refused() {
    let (header, frames) = take_apart(&tile(RowCodec::Half));
    for index in 0..frames.len() {
        for change in [-1, 1] {
            let mut frames = frames.clone();
            let length = frames[index].1.len();
            frames[index].1.resize(length.strict_add_signed(change), 0);
            frames[index].0.raw_bytes = frames[index].1.len() as u32;
            let result = decode(&put_together(header, &frames));
            assert!(matches!(result, Err(TileError::Structure { .. })), "frame {index}: {result:?}");
        }
        let mut frames = frames.clone();
        frames[index].0.raw_bytes += 1;
        let result = decode(&put_together(header, &frames));
        assert!(matches!(result, Err(TileError::Structure { .. })), "frame {index}: {result:?}");
    }
}

/// Goal: nothing is allocated on a liar's word. Method: counts for many a GiB in a file of a KiB.
#[test]
fn huge_counts_in_small_files_are_refused() {
    let (header, frames) = take_apart(&tile(RowCodec::Half));
    type Change = fn(&mut TileHeader);
    let over_limit: [Change; 10] = [
        |h| h.patch_count = limits::PATCHES_MAX + 1,
        |h| h.point_count = u32::MAX,
        |h| h.nonzero_count = u64::MAX,
        |h| h.segment_count = u32::MAX,
        |h| h.vertex_count = u32::MAX,
        |h| h.triangle_count = u32::MAX,
        |h| h.level = 16,
        |h| h.receiver_count = limits::RECEIVERS_MAX + 1,
        |h| h.receiver_nonzero_count = u64::MAX,
        |h| h.receiver_segment_count = u32::MAX,
    ];
    for change in over_limit {
        let mut header = header;
        change(&mut header);
        let result = decode(&put_together(header, &frames));
        assert!(matches!(result, Err(TileError::Limit { .. })), "{result:?}");
    }
    let contradictory: [Change; 11] = [
        |h| h.patch_count = limits::PATCHES_MAX,
        |h| h.point_count = limits::POINTS_MAX,
        |h| h.nonzero_count = limits::NONZEROS_MAX,
        |h| h.nonzero_count -= 1,
        |h| h.segment_count = limits::SEGMENTS_MAX,
        |h| h.vertex_count = limits::VERTICES_MAX,
        |h| h.row_codec = 77,
        |h| h.receiver_count = limits::RECEIVERS_MAX,
        |h| h.receiver_count -= 1,
        |h| h.receiver_nonzero_count = limits::NONZEROS_MAX,
        |h| h.receiver_nonzero_count -= 1,
    ];
    for change in contradictory {
        let mut header = header;
        change(&mut header);
        let result = decode(&put_together(header, &frames));
        assert!(matches!(result, Err(TileError::Structure { .. })), "{result:?}");
    }
}

#[test]
fn tables_that_lie_about_places_are_refused() {
    let good = tile(RowCodec::Half);
    let layout = Layout::parse(&good, Path::new("hostile.tile")).unwrap();
    let frames = &good[layout.header.frames_offset() as usize..];
    type Change = fn(&mut [SectionEntry]);
    let cases: [Change; 7] = [
        |t| t[1].offset = u64::MAX,
        |t| t[1].offset += 1,
        |t| t[5].stored_bytes = u32::MAX,
        |t| t[5].stored_bytes -= 1,
        |t| t[3].raw_bytes = u32::MAX,
        |t| t[3].group = 1,
        |t| t.swap(0, 1),
    ];
    for (index, change) in cases.into_iter().enumerate() {
        let (mut header, mut table) = (layout.header, layout.sections.clone());
        change(&mut table);
        header.table_hash = checksum::hash(bytemuck::cast_slice(&table));
        let result = decode(&sealed(header, &table, frames));
        assert!(matches!(result, Err(TileError::Structure { .. })), "case {index}: {result:?}");
    }
}
