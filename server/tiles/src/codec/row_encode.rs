//! Rows to the bytes of a row group; the layout is in [`super::row_group`].

use super::row_group::{GroupHead, TAIL_VALUES};
use super::zstd_frame::Packer;
use super::{Decoded, RowCodec, half_share, planes};
use earthshine_world::ChunkRows;
use std::ops::Range;

/// A row group, compressed.
pub(crate) struct PackedGroup {
    pub(crate) frame: Vec<u8>,
    pub(crate) raw_bytes: usize,
}

/// Encodes the rows `range` of `rows`, which have passed [`crate::structure`]. Negative zeros become zeros.
pub(crate) fn encode(
    rows: &ChunkRows,
    range: Range<usize>,
    codec: RowCodec,
    packer: &mut Packer,
) -> Decoded<PackedGroup> {
    let entries = rows.row_starts[range.start] as usize..rows.row_starts[range.end] as usize;
    let shares = &rows.shares[entries.clone()];
    let segments = segments_of(rows, entries.clone());
    let gaps = encode_gaps(rows, range.clone(), &segments);
    let share_exponent = match codec {
        RowCodec::Half => half_share::exponent_for(shares.iter().copied().fold(0.0, f32::max)),
        RowCodec::Full => 0,
    };
    let head = GroupHead {
        row_count: range.len() as u32,
        segment_count: segments.len() as u32,
        nonzero_count: entries.len() as u32,
        gap_bytes: gaps.len() as u32,
        share_exponent,
    };
    let lengths: Vec<u32> =
        rows.row_starts[range.start..=range.end].windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut first = bytemuck::bytes_of(&head).to_vec();
    first.extend_from_slice(bytemuck::cast_slice(&segments));
    first.extend_from_slice(bytemuck::cast_slice(&lengths));
    first.extend(encode_tails(rows, range.clone(), codec));

    let share_planes = match codec {
        RowCodec::Half => {
            let (mut high, mut low) = (Vec::with_capacity(shares.len()), Vec::with_capacity(shares.len()));
            for row in range {
                let row = rows.row_starts[row] as usize..rows.row_starts[row + 1] as usize;
                half_share::encode_row(&rows.shares[row], share_exponent, &mut high, &mut low);
            }
            vec![high, low]
        }
        RowCodec::Full => (0..4)
            .map(|byte| shares.iter().map(|share| (share + 0.0).to_be_bytes()[byte]).collect())
            .collect(),
    };
    let mut parts = vec![&first[..], &gaps[..]];
    parts.extend(share_planes.iter().map(Vec::as_slice));
    let raw_bytes = parts.iter().map(|part| part.len()).sum();
    Ok(PackedGroup { frame: packer.pack(&parts)?, raw_bytes })
}

/// The segments that these entries use, ascending.
fn segments_of(rows: &ChunkRows, entries: Range<usize>) -> Vec<u16> {
    let mut segments: Vec<u16> =
        rows.columns[entries].chunk_by(|a, b| a.segment == b.segment).map(|run| run[0].segment).collect();
    segments.sort_unstable();
    segments.dedup();
    segments
}

fn encode_gaps(rows: &ChunkRows, range: Range<usize>, segments: &[u16]) -> Vec<u8> {
    let mut place = vec![0u64; rows.segments.len()];
    for (index, &segment) in segments.iter().enumerate() {
        place[usize::from(segment)] = index as u64;
    }
    let mut gaps = Vec::new();
    for row in range {
        let mut next = 0u64;
        for column in &rows.columns[rows.row_starts[row] as usize..rows.row_starts[row + 1] as usize] {
            let key = place[usize::from(column.segment)] << 16 | u64::from(column.local);
            push_varint(key - next, &mut gaps);
            next = key + 1;
        }
    }
    gaps
}

fn push_varint(mut value: u64, bytes: &mut Vec<u8>) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

fn encode_tails(rows: &ChunkRows, range: Range<usize>, codec: RowCodec) -> Vec<u8> {
    let mut tails: Vec<f32> = Vec::with_capacity(range.len() * TAIL_VALUES);
    for row in range {
        tails.extend(rows.sky_shares[row]);
        tails.push(rows.absorbed_shares[row]);
    }
    for value in &mut tails {
        *value = match codec {
            RowCodec::Half => half_share::rounded(*value + 0.0),
            RowCodec::Full => *value + 0.0,
        };
    }
    planes::split(bytemuck::cast_slice(&tails), TAIL_VALUES * 4)
}
