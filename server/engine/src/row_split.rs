//! How the row of one resident splits over the slots taken now, kept up to date as patches come and go.
//!
//! One pass over the row when its patch takes a slot; from then on each patch that comes or goes moves one column from one
//! side to the other. Shares are `f16` or `f32` and their sums `f64`, so what is added and taken away again leaves no trace
//! that an `f32` could show. The same row computed afresh is [`crate::slots::split_row`]: invariants hold one against the other.

use crate::far::FarShare;
use earthshine_world::{ChunkId, ChunkRows, Column, PatchId};

/// Of a column without a known parent.
pub(crate) const NOBODY: u32 = u32::MAX;

/// Which way a column goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Move {
    /// Its patch took a slot.
    In,
    /// Its patch lost it.
    Out,
}

/// A row in two parts, and the far one by parent.
#[derive(Debug, Default)]
pub(crate) struct RowSplit {
    pub(crate) resident: f64,
    pub(crate) far: f64,
    /// Every parent that the row leads to, in the order in which it names them first: the order does not depend on who is
    /// resident, so that sums over it do not either.
    pub(crate) parents: Vec<FarShare>,
    /// By column: its place in `parents`, or [`NOBODY`]. Empty where nothing feeds.
    pub(crate) parent_of: Vec<u32>,
}

impl RowSplit {
    /// Memory of its lists, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.parents.capacity() * size_of::<FarShare>() + self.parent_of.capacity() * size_of::<u32>()
    }

    /// The patch of column `column` (its place in the row) with form factor `share` goes `way`.
    fn shift(&mut self, column: usize, share: f64, way: Move) {
        let inwards = if way == Move::In { share } else { -share };
        self.resident += inwards;
        self.far -= inwards;
        if let Some(parent) = self.parent_of.get(column).filter(|&&parent| parent != NOBODY) {
            self.parents[*parent as usize].share -= inwards;
        }
    }
}

/// Moves one patch in or out in the rows of its neighbours, which come chunk by chunk.
#[derive(Debug)]
pub(crate) struct Mover {
    patch: PatchId,
    way: Move,
    /// Of the chunk asked about last: where `patch`'s chunk is among its segments.
    segment: Option<(ChunkId, Option<u16>)>,
}

impl Mover {
    pub(crate) fn new(patch: PatchId, way: Move) -> Self {
        Self { patch, way, segment: None }
    }

    /// In the row of patch `local` of `chunk`, whose rows are `rows`. A row that does not name the patch stays as it is.
    pub(crate) fn shift(&mut self, split: &mut RowSplit, chunk: ChunkId, rows: &ChunkRows, local: usize) {
        let segment = match self.segment {
            Some((of, segment)) if of == chunk => segment,
            _ => {
                let at = rows.segments.binary_search(&self.patch.chunk).ok();
                let segment = at.and_then(|at| u16::try_from(at).ok());
                self.segment = Some((chunk, segment));
                segment
            }
        };
        let Some(segment) = segment else { return };
        let range = rows.row_starts[local] as usize..rows.row_starts[local + 1] as usize;
        let column = Column { segment, local: self.patch.local };
        if let Ok(place) = rows.columns[range.clone()].binary_search(&column) {
            split.shift(place, f64::from(rows.shares[range.start + place]), self.way);
        }
    }
}
