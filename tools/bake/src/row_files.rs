//! Rows as their own rays see them, in files that other chunks can read their part of.
//!
//! │ rows │ sections │ sky 6 x f32, absorbed f32, rays u32 each row │ section: chunk 3 x i32, entries u32 │ entries │
//!
//! Entries are (row u16, target u16, share f32), grouped into one section a target chunk, ascending; in a section
//! ascending by row, then target. Targets are [`PatchSet::stable_id`]s: a file stays good when patches elsewhere
//! come or go.

use crate::BakeError;
use crate::patches::PatchSet;
use crate::rows::RawRow;
use crate::words::{Reader, Writer};
use crate::work_folder::{Kind, WorkFolder};
use earthshine_world::Grid;
use std::collections::BTreeMap;
use std::ops::Range;

const HEAD_BYTES: u64 = 32;
const SECTION_BYTES: u64 = 16;
const ENTRY_BYTES: u64 = 8;

/// Where the parts of a chunk's rows are.
#[derive(Debug, Clone, Default)]
pub(crate) struct RowIndex {
    /// Cells in the file's stamp.
    pub(crate) seen: usize,
    /// Of each row.
    pub(crate) rays: Vec<u32>,
    /// Target chunk and its entries' place, ascending by chunk.
    sections: Vec<([i32; 3], Range<u64>)>,
}

/// The payload of a file with `rows`.
pub(crate) fn encode(rows: &[RawRow], set: &PatchSet, grid: &Grid) -> Vec<u8> {
    let chunk_of = |patch: u32| grid.chunk_of(set.patches[patch as usize].patch.voxel).to_array();
    let mut sections: BTreeMap<[i32; 3], Vec<(u16, u16, f32)>> = BTreeMap::new();
    for (row, source) in rows.iter().enumerate() {
        let mut rest = source.entries.as_slice();
        while let Some(&(patch, _)) = rest.first() {
            // Entries are ascending by patch, and patches by chunk.
            let chunk = chunk_of(patch);
            let end = set.chunks[&chunk].end;
            let (own, others) = rest.split_at(rest.partition_point(|entry| entry.0 < end));
            let entry = |&(patch, share): &(u32, f32)| (row as u16, set.stable_id(patch, grid), share);
            sections.entry(chunk).or_default().extend(own.iter().map(entry));
            rest = others;
        }
    }
    let mut out = Writer::default();
    out.u32(rows.len() as u32);
    out.u32(sections.len() as u32);
    for row in rows {
        out.f32s(row.sky);
        out.f32s([row.absorbed]);
        out.u32(row.rays);
    }
    for (chunk, entries) in &sections {
        out.i32s(*chunk);
        out.u32(entries.len() as u32);
    }
    for (row, target, share) in sections.into_values().flatten() {
        out.u32(u32::from(row) | u32::from(target) << 16);
        out.f32s([share]);
    }
    out.0
}

/// Rows that were in a file.
#[derive(Debug)]
pub(crate) struct FoundRows {
    pub(crate) rows: Vec<RawRow>,
    pub(crate) index: RowIndex,
    /// Of each row, whether a patch that it leads to is gone.
    pub(crate) has_lost: Vec<bool>,
}

/// What [`encode`] made, in numbers of `set`; `None` if it is not about `row_count` rows, or leads to patches that are
/// gone.
pub(crate) fn decode(
    payload: &[u8],
    row_count: usize,
    set: &PatchSet,
    grid: &Grid,
) -> Option<(Vec<RawRow>, RowIndex)> {
    let FoundRows { rows, index, has_lost } = decode_found(payload, row_count, set, grid)?;
    (!has_lost.contains(&true)).then_some((rows, index))
}

/// As [`decode`], without entries whose patches are gone.
pub(crate) fn decode_found(
    payload: &[u8],
    row_count: usize,
    set: &PatchSet,
    grid: &Grid,
) -> Option<FoundRows> {
    let mut reader = Reader(payload);
    if reader.u32()? as usize != row_count {
        return None;
    }
    let section_count = reader.u32()? as usize;
    let mut rows = Vec::with_capacity(row_count);
    for _ in 0..row_count {
        let (sky, [absorbed]) = (reader.f32s()?, reader.f32s()?);
        rows.push(RawRow { entries: Vec::new(), sky, absorbed, rays: reader.u32()? });
    }
    let mut at = 8 + row_count as u64 * HEAD_BYTES + section_count as u64 * SECTION_BYTES;
    let mut index = RowIndex { rays: rows.iter().map(|row| row.rays).collect(), ..RowIndex::default() };
    for _ in 0..section_count {
        let chunk = reader.i32s()?;
        let end = at + u64::from(reader.u32()?) * ENTRY_BYTES;
        index.sections.push((chunk, at..end));
        at = end;
    }
    let mut has_lost = vec![false; row_count];
    for (chunk, range) in &index.sections {
        for _ in 0..(range.end - range.start) / ENTRY_BYTES {
            let (row, target, share) = decode_entry(&mut reader)?;
            match set.by_stable_id(*chunk, target, grid) {
                Some(patch) => rows.get_mut(usize::from(row))?.entries.push((patch, share)),
                None => *has_lost.get_mut(usize::from(row))? = true,
            }
        }
    }
    reader.is_empty().then_some(FoundRows { rows, index, has_lost })
}

fn decode_entry(reader: &mut Reader<'_>) -> Option<(u16, u16, f32)> {
    let word = reader.u32()?;
    Some((word as u16, (word >> 16) as u16, reader.f32()?))
}

impl RowIndex {
    /// The chunks that the rows lead to.
    pub(crate) fn targets(&self) -> impl Iterator<Item = [i32; 3]> + '_ {
        self.sections.iter().map(|section| section.0)
    }

    /// Reads what the rows of chunk `from` send to `to`: (row in its chunk, patch of the whole world, share).
    pub(crate) fn read_section(
        &self,
        work: &WorkFolder,
        (from, to): ([i32; 3], [i32; 3]),
        set: &PatchSet,
        grid: &Grid,
    ) -> Result<Vec<(u16, u32, f32)>, BakeError> {
        let Ok(found) = self.sections.binary_search_by_key(&to, |section| section.0) else {
            return Ok(Vec::new());
        };
        let part = work.read_part(Kind::Rows, from, self.seen, self.sections[found].1.clone())?;
        let mut reader = Reader(&part);
        let mut entries = Vec::with_capacity(part.len() / ENTRY_BYTES as usize);
        while !reader.is_empty() {
            let entry = decode_entry(&mut reader)
                .and_then(|(row, id, share)| Some((row, set.by_stable_id(to, id, grid)?, share)));
            entries.push(entry.ok_or(BakeError::WorkChanged { chunk: from })?);
        }
        Ok(entries)
    }
}
