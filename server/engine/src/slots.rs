//! From columns of rows to slots: one table a chunk, indexed by the patch's place in it.

use crate::far::FarSegment;
use crate::row_split::RowSplit;
use earthshine_world::lineage::Lineage;
use earthshine_world::{Chunk, ChunkId, ChunkRows, PatchId, RowParts};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Stands for "holds no slot".
pub(crate) const FREE: u32 = u32::MAX;

/// The slots that one chunk's patches hold in one local set.
#[derive(Debug)]
pub(crate) struct SlotTable {
    pub(crate) chunk: Arc<Chunk>,
    /// Of what the chunk's rows lead to.
    pub(crate) lineage: Arc<Lineage>,
    /// Parents of each segment's patches; empty where no coarser view feeds this one.
    pub(crate) far_segments: Vec<Option<FarSegment>>,
    slots: Vec<u32>,
    taken: u32,
}

impl SlotTable {
    pub(crate) fn new(
        chunk: Arc<Chunk>,
        lineage: Arc<Lineage>,
        far_segments: Vec<Option<FarSegment>>,
    ) -> Self {
        let slots = vec![FREE; chunk.patches.len()];
        Self { chunk, lineage, far_segments, slots, taken: 0 }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.taken == 0
    }

    pub(crate) fn taken(&self) -> u32 {
        self.taken
    }

    /// By patch; [`FREE`] for none.
    pub(crate) fn slots(&self) -> &[u32] {
        &self.slots
    }

    pub(crate) fn is_taken(&self, local: usize) -> bool {
        self.slots.get(local).is_some_and(|&slot| slot != FREE)
    }

    pub(crate) fn slot(&self, local: usize) -> Option<u32> {
        self.slots.get(local).copied().filter(|&slot| slot != FREE)
    }

    /// Patches that hold slots, ascending.
    pub(crate) fn patches(&self) -> impl Iterator<Item = PatchId> {
        (0u16..=u16::MAX)
            .zip(&self.slots)
            .filter(|&(_, &slot)| slot != FREE)
            .map(|(local, _)| PatchId { chunk: self.chunk.id, local })
    }

    pub(crate) fn take(&mut self, local: usize, slot: u32) {
        assert_eq!(self.slots[local], FREE, "a patch holds one slot");
        self.slots[local] = slot;
        self.taken += 1;
    }

    pub(crate) fn free(&mut self, local: usize) {
        assert_ne!(self.slots[local], FREE, "only a held slot is freed");
        self.slots[local] = FREE;
        self.taken -= 1;
    }
}

/// The slots of every segment that the columns of `rows` point into: looked up once for many rows.
pub(crate) fn segment_slots<'a>(
    tables: &'a BTreeMap<ChunkId, SlotTable>,
    rows: &ChunkRows,
) -> Vec<&'a [u32]> {
    rows.segments.iter().map(|id| tables.get(id).map_or(&[][..], |table| &table.slots)).collect()
}

/// Calls `visit` with the slot (or [`FREE`]) and the share of every entry of row `row` of `rows`.
pub(crate) fn visit_row(segments: &[&[u32]], rows: &ChunkRows, row: usize, mut visit: impl FnMut(u32, f32)) {
    for (column, share) in rows.row(row) {
        let slots = segments[usize::from(column.segment)];
        visit(slots.get(usize::from(column.local)).copied().unwrap_or(FREE), share);
    }
}

/// How row `row` of `rows` splits over the slots taken now, computed afresh. What is not resident is far, and never the sky's.
pub(crate) fn split_row(segments: &[&[u32]], rows: &ChunkRows, row: usize) -> RowSplit {
    // Shares come from f16 or f32: their sums in f64 do not depend on the order.
    let mut split = RowSplit::default();
    visit_row(segments, rows, row, |slot, share| {
        *(if slot == FREE { &mut split.far } else { &mut split.resident }) += f64::from(share);
    });
    split
}

/// The parts of row `row` of `rows`, of which `resident` and `far` are known.
pub(crate) fn parts_of_row(rows: &ChunkRows, row: usize, resident: f64, far: f64) -> RowParts {
    let sky: f64 = rows.sky_shares[row].iter().map(|&share| f64::from(share)).sum();
    RowParts {
        resident: resident as f32,
        far: far as f32,
        sky: sky as f32,
        absorbed: rows.absorbed_shares[row],
    }
}
