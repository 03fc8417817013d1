//! The bytes of a row group to rows; the layout is in [`super::row_group`]. The hot path of streaming.

use super::row_group::{GroupHead, TAIL_BYTES};
use super::{Decoded, RowCodec, half_share, planes, take};
use crate::limits;
use earthshine_world::{ChunkId, ChunkRows, Column};

/// Rows as they come in, group by group.
pub(crate) struct RowSink {
    rows: ChunkRows,
    /// For each of the tile's segments, the patches that its chunk has.
    patch_counts: Vec<u32>,
    nonzero_limit: usize,
}

impl RowSink {
    /// Room for `row_count` rows with `nonzero_limit` entries, both held against their limits already.
    pub(crate) fn new(
        segments: Vec<ChunkId>,
        patch_counts: Vec<u32>,
        row_count: usize,
        nonzero_limit: usize,
    ) -> Self {
        let mut row_starts = Vec::with_capacity(row_count + 1);
        row_starts.push(0);
        let rows = ChunkRows {
            segments,
            row_starts,
            // Columns are appended by eights and cut back.
            columns: Vec::with_capacity(nonzero_limit + 8),
            shares: Vec::with_capacity(nonzero_limit),
            sky_shares: Vec::with_capacity(row_count),
            absorbed_shares: Vec::with_capacity(row_count),
        };
        Self { rows, patch_counts, nonzero_limit }
    }

    /// Appends the `row_count` rows in `raw`.
    pub(crate) fn push_group(&mut self, mut raw: &[u8], codec: RowCodec, row_count: u32) -> Decoded<()> {
        let head: GroupHead = bytemuck::pod_read_unaligned(take(&mut raw, size_of::<GroupHead>(), "head")?);
        if head.row_count != row_count {
            return Err(format!("it has {} rows instead of {row_count}", head.row_count));
        }
        let nonzero_count = head.nonzero_count as usize;
        if nonzero_count > self.nonzero_limit - self.rows.columns.len() {
            return Err("it has more non-zeros than the header says".to_owned());
        }
        let segments =
            self.group_segments(take(&mut raw, head.segment_count as usize * 2, "segment list")?)?;
        let lengths = take(&mut raw, row_count as usize * 4, "row lengths")?;
        self.push_lengths(lengths, nonzero_count)?;
        self.push_tails(take(&mut raw, row_count as usize * TAIL_BYTES, "sky shares")?)?;
        let gaps = take(&mut raw, head.gap_bytes as usize, "columns")?;
        if raw.len() != nonzero_count * codec.share_bytes() {
            return Err(format!("{} bytes of shares for {nonzero_count} non-zeros", raw.len()));
        }
        decode_gaps(gaps, lengths, &segments, &mut self.rows.columns)?;
        match codec {
            RowCodec::Half => self.push_half_shares(raw, head.share_exponent),
            RowCodec::Full => self.push_full_shares(raw),
        }
    }

    /// All rows, once every group is in.
    pub(crate) fn finish(self) -> Decoded<ChunkRows> {
        if self.rows.columns.len() != self.nonzero_limit {
            let found = self.rows.columns.len();
            return Err(format!("{found} non-zeros instead of the header's {}", self.nonzero_limit));
        }
        Ok(self.rows)
    }

    /// The rows so far: what partial reads want.
    pub(crate) fn into_rows(self) -> ChunkRows {
        self.rows
    }

    fn group_segments(&self, list: &[u8]) -> Decoded<Vec<GroupSegment>> {
        let mut previous = None;
        let (list, _) = list.as_chunks::<2>();
        list.iter()
            .map(|&bytes| {
                let segment = u16::from_le_bytes(bytes);
                if previous.replace(segment) >= Some(segment) {
                    return Err("its segment list does not ascend".to_owned());
                }
                let patch_count = self.patch_counts.get(usize::from(segment));
                let patch_count = *patch_count.ok_or_else(|| format!("it names segment {segment}"))?;
                Ok(GroupSegment { segment, patch_count })
            })
            .collect()
    }

    fn push_lengths(&mut self, lengths: &[u8], nonzero_count: usize) -> Decoded<()> {
        let mut end = self.rows.columns.len();
        let expected = end + nonzero_count;
        for length in row_lengths(lengths) {
            if length > limits::ROW_NONZEROS_MAX {
                return Err(format!("a row of {length} non-zeros"));
            }
            end += length as usize;
            self.rows.row_starts.push(end as u32);
        }
        if end != expected {
            return Err("its row lengths do not add up to its non-zeros".to_owned());
        }
        Ok(())
    }

    fn push_tails(&mut self, raw: &[u8]) -> Decoded<()> {
        for [sky @ .., absorbed] in planes::join_as::<[f32; super::row_group::TAIL_VALUES]>(raw) {
            if !sky.iter().chain([&absorbed]).all(|&share| is_share(share)) {
                return Err("a sky or absorbed share is not a share".to_owned());
            }
            self.rows.sky_shares.push(sky);
            self.rows.absorbed_shares.push(absorbed);
        }
        Ok(())
    }

    fn push_half_shares(&mut self, raw: &[u8], exponent: i32) -> Decoded<()> {
        if !half_share::EXPONENTS.contains(&exponent) {
            return Err(format!("shares scaled by 2^{exponent}"));
        }
        let (high, low) = raw.split_at(raw.len() / 2);
        if high.iter().copied().max().unwrap_or(0) > half_share::HIGH_BYTE_MAX {
            return Err("a share is negative or not a number".to_owned());
        }
        half_share::decode(high, low, exponent, &mut self.rows.shares);
        Ok(())
    }

    fn push_full_shares(&mut self, raw: &[u8]) -> Decoded<()> {
        let count = raw.len() / 4;
        let (high, rest) = raw.split_at(count);
        let (second, rest) = rest.split_at(count);
        let (third, low) = rest.split_at(count);
        let first = self.rows.shares.len();
        let bytes = high.iter().zip(second).zip(third.iter().zip(low));
        self.rows.shares.extend(bytes.map(|((&a, &b), (&c, &d))| f32::from_be_bytes([a, b, c, d])));
        if self.rows.shares[first..].iter().all(|&share| is_share(share)) {
            Ok(())
        } else {
            Err("a share is negative or not a number".to_owned())
        }
    }
}

/// A segment of one group.
struct GroupSegment {
    /// Its place in the tile's table.
    segment: u16,
    /// Locals in it are below this.
    patch_count: u32,
}

impl GroupSegment {
    /// The rows ascend, so that the last column of a run stands for all of it.
    fn check_last(&self, local: u16) -> Decoded<()> {
        if u32::from(local) < self.patch_count {
            return Ok(());
        }
        let Self { segment, patch_count } = self;
        Err(format!("a column names patch {local} of segment {segment}, which has {patch_count}"))
    }
}

/// Not negative, not beyond any bound, a number.
fn is_share(share: f32) -> bool {
    (0.0..=limits::SHARE_MAX).contains(&share) && share.is_sign_positive()
}

fn row_lengths(bytes: &[u8]) -> impl Iterator<Item = u32> + '_ {
    bytes.as_chunks::<4>().0.iter().map(|&bytes| u32::from_le_bytes(bytes))
}

/// Top bits of eight bytes: none set means eight gaps of one byte.
const CONTINUATION_BITS: u64 = 0x8080_8080_8080_8080;

/// Decodes the columns of all rows of a group: as many as eight at a time up to the next gap that takes
/// more than a byte, which few do.
fn decode_gaps(
    mut gaps: &[u8],
    lengths: &[u8],
    segments: &[GroupSegment],
    columns: &mut Vec<Column>,
) -> Decoded<()> {
    for length in row_lengths(lengths) {
        let mut row = RowKeys { key: u64::MAX, place: u64::MAX, segments };
        let mut remaining = length as usize;
        while remaining > 0 {
            if let Some(word) = gaps.first_chunk::<8>() {
                let word = u64::from_le_bytes(*word);
                let short = (word & CONTINUATION_BITS).trailing_zeros() as usize / 8;
                let count = short.min(remaining);
                if count > 0 {
                    row.push_short(word, count, columns)?;
                    gaps = &gaps[count..];
                    remaining -= count;
                }
                if short == 8 || remaining == 0 {
                    continue;
                }
            }
            let gap = take_varint(&mut gaps)?;
            columns.push(row.next_column(gap)?);
            remaining -= 1;
        }
        row.check_run()?;
    }
    if gaps.is_empty() { Ok(()) } else { Err("bytes follow its last column".to_owned()) }
}

/// Where a row stands while its gaps are added up.
struct RowKeys<'a> {
    /// The last key; `u64::MAX` stands for -1. No row is long enough to make it wrap again.
    key: u64,
    /// Place of the last key's segment in the group's list; `u64::MAX` before the first.
    place: u64,
    segments: &'a [GroupSegment],
}

impl RowKeys<'_> {
    #[inline]
    fn next_column(&mut self, gap: u64) -> Decoded<Column> {
        let key = self.key.wrapping_add(gap).wrapping_add(1);
        if key >> 16 != self.place {
            self.check_run()?;
            self.place = key >> 16;
        }
        self.key = key;
        let found = usize::try_from(self.place).ok().and_then(|place| self.segments.get(place));
        let segment = found.ok_or_else(|| format!("a column of its segment {}", self.place))?;
        Ok(Column { segment: segment.segment, local: key as u16 })
    }

    /// Appends the columns of the lowest `count` (1 to 8) of eight gaps of one byte each.
    #[inline]
    fn push_short(&mut self, word: u64, count: usize, columns: &mut Vec<Column>) -> Decoded<()> {
        let unused = 8 - count;
        let word = word & (u64::MAX >> (8 * unused));
        let steps = Steps::of(word);
        let key = self.key.wrapping_add(steps.total() - unused as u64);
        // Keys ascend: if the last is of the segment of the one before the first, all are.
        if key >> 16 == self.place
            && let Some(found) = self.segments.get(self.place as usize)
        {
            let locals = steps.locals_after(self.key as u16);
            self.key = key;
            // Always eight, then back: cheaper than a loop whose length nobody can predict.
            let end = columns.len() + count;
            columns.extend_from_slice(&locals.map(|local| Column { segment: found.segment, local }));
            columns.truncate(end);
            return Ok(());
        }
        for gap in &word.to_le_bytes()[..count] {
            let column = self.next_column(u64::from(*gap))?;
            columns.push(column);
        }
        Ok(())
    }

    /// Checks the run of columns of one segment that ends with the last key.
    fn check_run(&self) -> Decoded<()> {
        match usize::try_from(self.place).ok().and_then(|place| self.segments.get(place)) {
            None => Ok(()),
            Some(segment) => segment.check_last(self.key as u16),
        }
    }
}

/// How far eight keys are beyond the one before them: sums of gaps, and one for each.
///
/// Two words of four 16-bit lanes; a multiplication adds up the lanes below each.
struct Steps {
    even: u64,
    odd: u64,
}

impl Steps {
    const LANES: u64 = 0x0001_0001_0001_0001;

    #[inline]
    fn of(word: u64) -> Self {
        let even = (word & (Self::LANES * 0xFF)).wrapping_mul(Self::LANES);
        let odd = (word >> 8 & (Self::LANES * 0xFF)).wrapping_mul(Self::LANES);
        // Gaps are below 128: no lane overflows.
        Self {
            even: even.wrapping_add(odd << 16).wrapping_add(0x0007_0005_0003_0001),
            odd: even.wrapping_add(odd).wrapping_add(0x0008_0006_0004_0002),
        }
    }

    /// Of the last key.
    #[inline]
    fn total(&self) -> u64 {
        self.odd >> 48
    }

    /// The locals, if they are all of the segment of `local`, the one before.
    #[inline]
    fn locals_after(&self, local: u16) -> [u16; 8] {
        let base = u64::from(local).wrapping_mul(Self::LANES);
        let (even, odd) = (self.even.wrapping_add(base), self.odd.wrapping_add(base));
        std::array::from_fn(|index| ((if index % 2 == 0 { even } else { odd }) >> (index / 2 * 16)) as u16)
    }
}

#[inline]
fn take_varint(bytes: &mut &[u8]) -> Decoded<u64> {
    let mut value = 0u64;
    for shift in [0, 7, 14, 21, 28] {
        let (&byte, rest) = bytes.split_first().ok_or_else(|| "it ends inside a column".to_owned())?;
        *bytes = rest;
        value |= u64::from(byte & 0x7F) << shift;
        if byte < 0x80 {
            return Ok(value);
        }
    }
    Err("a column gap of more than five bytes".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_sums_of_gaps() {
        for gaps in [[0; 8], [127; 8], [1, 0, 5, 127, 0, 0, 99, 3]] {
            let mut key = 1000;
            let expected = gaps.map(|gap| {
                key += 1 + u16::from(gap);
                key
            });
            let steps = Steps::of(u64::from_le_bytes(gaps));
            assert_eq!(steps.locals_after(1000), expected);
            assert_eq!(steps.total(), u64::from(key - 1000));
        }
    }
}
