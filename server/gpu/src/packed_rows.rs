//! Rows as a device holds them: 32 bits a column where that is exact, 64 where it is not.
//!
//! Worlds keep a share in 16 bits, a half float times a power of two, and columns of a chunk lead to far fewer patches than
//! there are columns. So a column is the number of its target in a list of the chunk's, and a half float, found again in the
//! `f32` that readers made of it; the power of two goes with the row. Every share is the same to the bit. Rows that do not
//! fit, of `--lossless` worlds or with more than 65,536 targets, are held wide: target and `f32`. The kernel's side is
//! `shaders/wgsl/kernels/gather_receivers.wgsl`.

use earthshine_shaders::host::ReceiverSpan;
use earthshine_shaders::limits::{NO_TARGETS, ROW_COLUMNS_MAX};
use earthshine_world::{ChunkRows, Column};
use half::f16;

/// Targets that a narrow column can name.
const TARGETS_MAX: usize = 1 << 16;
/// Exponents of rows: as far as what a kernel computes of them is a normal `f32`.
const EXPONENTS: std::ops::RangeInclusive<i32> = 0..=100;
/// Of the largest half float.
const HALF_EXPONENT_MAX: i32 = f16::MAX_EXP - 1;

/// The rows of a chunk, in words.
#[derive(Debug, PartialEq)]
pub(crate) struct PackedRows {
    /// Targets of narrow columns, then columns.
    pub(crate) words: Vec<u32>,
    /// None where columns are wide.
    narrow: Option<Narrow>,
}

#[derive(Debug, PartialEq)]
struct Narrow {
    target_count: u32,
    /// By row: its half floats are shares times two to that.
    exponents: Vec<u32>,
}

impl PackedRows {
    pub(crate) fn new(rows: &ChunkRows) -> Self {
        narrow(rows).unwrap_or_else(|| {
            let words = rows.columns.iter().zip(&rows.shares);
            let words = words.flat_map(|(column, share)| [target(column), share.to_bits()]).collect();
            Self { words, narrow: None }
        })
    }

    /// Where the targets of rows begin whose words begin at `first`.
    pub(crate) fn first_target(&self, first: u32) -> u32 {
        if self.narrow.is_some() { first } else { NO_TARGETS }
    }

    /// Rows whose words begin at `first`.
    pub(crate) fn spans(&self, rows: &ChunkRows, first: u32) -> Vec<ReceiverSpan> {
        let (first, words_a_column) = match &self.narrow {
            Some(Narrow { target_count, .. }) => (first + target_count, 1),
            None => (first, 2),
        };
        let of = |(row, (bounds, sky)): (usize, (&[u32], &[f32; 6]))| {
            let exponent = self.narrow.as_ref().map_or(0, |narrow| narrow.exponents[row]);
            ReceiverSpan {
                first_sky: [sky[0], sky[1], sky[2]],
                first: first + bounds[0] * words_a_column,
                last_sky: [sky[3], sky[4], sky[5]],
                count: (bounds[1] - bounds[0]) | (exponent << 24),
            }
        };
        rows.row_starts.windows(2).zip(&rows.sky_shares).enumerate().map(of).collect()
    }
}

/// Segment of its chunk, and the patch in it times 2^16.
fn target(column: &Column) -> u32 {
    u32::from(column.segment) | u32::from(column.local) << 16
}

/// Rows in 32 bits a column; none where they do not fit.
fn narrow(rows: &ChunkRows) -> Option<PackedRows> {
    let mut targets = Vec::new();
    // By segment and patch; none so far.
    let mut numbers: Vec<Vec<u32>> = vec![Vec::new(); rows.segments.len()];
    let (mut columns, mut exponents) = (Vec::with_capacity(rows.columns.len()), Vec::new());
    for row in 0..rows.row_count() {
        let largest = rows.row(row).map(|(_, share)| share).fold(0.0, f32::max);
        let exponent = if largest > 0.0 { HALF_EXPONENT_MAX - exponent_of(largest) } else { 0 };
        if !EXPONENTS.contains(&exponent) || rows.row(row).len() > ROW_COLUMNS_MAX as usize {
            return None;
        }
        exponents.push(exponent as u32);
        for (column, share) in rows.row(row) {
            let half = half(share, exponent)?;
            let of_segment = &mut numbers[usize::from(column.segment)];
            let local = usize::from(column.local);
            if of_segment.len() <= local {
                of_segment.resize(local + 1, NO_TARGETS);
            }
            let number = &mut of_segment[local];
            if *number == NO_TARGETS {
                *number = targets.len() as u32;
                targets.push(target(&column));
            }
            columns.push(*number | (half << 16));
        }
        if targets.len() > TARGETS_MAX {
            return None;
        }
    }
    let target_count = targets.len() as u32;
    targets.append(&mut columns);
    Some(PackedRows { words: targets, narrow: Some(Narrow { target_count, exponents }) })
}

fn exponent_of(share: f32) -> i32 {
    (share.to_bits() >> 23) as i32 - 127
}

/// The half float that is `share` times two to the `exponent`; none where none is, and none of what is negative.
fn half(share: f32, exponent: i32) -> Option<u32> {
    // Exact, or infinite.
    let scaled = share * 2f32.powi(exponent);
    let half = f16::from_f32(scaled);
    let is_same = half.is_finite() && half.is_sign_positive() && half.to_f32() == scaled;
    is_same.then(|| half.to_bits().into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::{ChunkCoord, ChunkId};

    /// As the kernel does.
    fn share_of(half: u32, exponent: i32) -> f32 {
        let (exponent_bits, mantissa) = (half >> 10, half & 0x3FF);
        let whole = if exponent_bits == 0 { mantissa } else { 1024 + mantissa };
        whole as f32 * 2f32.powi(exponent_bits.max(1) as i32 - 25 - exponent)
    }

    /// Goal: every half float there is comes back to the bit, and nothing else is taken for one. Method: all of them, with
    /// exponents at both ends; their neighbours among `f32`.
    #[test]
    fn half_floats_are_found_again_to_the_bit() {
        for exponent in [0, 1, 15, 24, 60, 100] {
            for bits in 0..0x7C00u32 {
                let share = share_of(bits, exponent);
                assert_eq!(half(share, exponent), Some(bits), "{share} times 2^{exponent}");
                if bits > 0 {
                    let other = f32::from_bits(share.to_bits() ^ 1);
                    assert_eq!(half(other, exponent), None, "{other} times 2^{exponent}");
                }
            }
        }
        for share in [-1.0, f32::NAN, f32::INFINITY, 65_536.0, 1e-40, f32::MIN_POSITIVE] {
            assert_eq!(half(share, 0), None, "{share}");
        }
    }

    fn rows(shares: &[&[f32]]) -> ChunkRows {
        let mut rows = ChunkRows {
            segments: (0..3).map(|x| ChunkId::new(0, ChunkCoord::new(x, 0, 0))).collect(),
            row_starts: vec![0],
            ..ChunkRows::default()
        };
        for of_row in shares {
            for (item, &share) in (0u16..).zip(*of_row) {
                rows.columns.push(Column { segment: item % 3, local: item / 3 });
                rows.shares.push(share);
            }
            rows.row_starts.push(rows.columns.len() as u32);
            rows.sky_shares.push([0.0; 6]);
            rows.absorbed_shares.push(0.0);
        }
        rows
    }

    #[test]
    fn rows_that_fit_take_a_word_a_column_and_a_word_a_target() {
        let rows = rows(&[&[0.5, 0.25, 0.0, 0.001_953_125], &[], &[2f32.powi(-20), 0.0]]);
        let packed = PackedRows::new(&rows);
        assert_eq!(packed.words.len(), 4 + 6);
        assert_eq!(packed.first_target(7), 7);
        let spans = packed.spans(&rows, 7);
        assert_eq!(spans.iter().map(|span| span.first).collect::<Vec<_>>(), [11, 15, 15]);
        for (row, span) in spans.iter().enumerate() {
            assert_eq!(span.count & ROW_COLUMNS_MAX, rows.row(row).len() as u32);
            for (item, (column, share)) in rows.row(row).enumerate() {
                let word = packed.words[(span.first - 7) as usize + item];
                assert_eq!(packed.words[(word & 0xFFFF) as usize], target(&column));
                assert_eq!(share_of(word >> 16, (span.count >> 24) as i32), share);
            }
        }
    }

    #[test]
    fn rows_that_do_not_fit_stay_as_they_are() {
        let fine = 0.1f32;
        let rows = rows(&[&[0.5, fine]]);
        let packed = PackedRows::new(&rows);
        assert_eq!(packed.words, [0, 0.5f32.to_bits(), 1, fine.to_bits()]);
        assert_eq!((packed.first_target(7), packed.spans(&rows, 7)[0].first), (NO_TARGETS, 7));
        // A share far below the largest of its row.
        assert!(narrow(&self::rows(&[&[0.5, 2f32.powi(-41)]])).is_none());
        assert!(narrow(&self::rows(&[&[0.5, 2f32.powi(-39)]])).is_some());
    }
}
