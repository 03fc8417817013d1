//! Tables of resident rows, rebuilt a few at a time: [`RowSampler`].
//!
//! A row's items are its links and, last, one for all that comes from outside the resident set, as likely as
//! [`LinkRows::outside_share`] says. A row that has changed keeps its old table until its turn: an item whose patch has
//! left looks outside meanwhile, so the row's probabilities still sum to one and no light is invented.

use super::links::LinkRows;
use crate::tables::{BuildRoom, RowTable, TableError};

/// What a draw looks at: a slot, or what comes from outside.
pub const OUTSIDE: u32 = u32::MAX;

/// The table of one row.
#[derive(Debug, Clone, Default)]
pub struct RowDraw<T> {
    /// Over the items of `outcomes`.
    pub table: T,
    /// A slot an item, or [`OUTSIDE`].
    pub outcomes: Vec<u32>,
}

/// One table a slot.
#[derive(Debug)]
pub struct RowSampler<T> {
    rows: Vec<RowDraw<T>>,
    /// Slots whose rows changed after their tables were built.
    is_old: Vec<bool>,
    old_count: usize,
    /// Where the next rebuild goes on.
    cursor: usize,
    room: BuildRoom,
    weights: Vec<f32>,
    /// Negative weights that counted as zero.
    clamped: u64,
}

/// What a call of `RowSampler::rebuild` did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rebuilt {
    /// Tables.
    pub rows: u32,
    /// Items of them.
    pub items: u64,
    /// Rows that still wait.
    pub waiting: u32,
}

impl<T: RowTable + Clone> RowSampler<T> {
    pub(crate) fn new(links: &LinkRows) -> Self {
        let capacity = links.capacity();
        let is_old: Vec<bool> = (0..capacity).map(|slot| links.is_taken(slot)).collect();
        Self {
            rows: vec![RowDraw { table: T::default(), outcomes: Vec::new() }; capacity],
            old_count: links.taken_count(),
            is_old,
            cursor: 0,
            room: BuildRoom::default(),
            weights: Vec::new(),
            clamped: 0,
        }
    }

    /// The table of `slot`.
    #[must_use]
    pub fn row(&self, slot: usize) -> &RowDraw<T> {
        &self.rows[slot]
    }

    /// Negative weights that counted as zero, so far.
    #[must_use]
    pub fn clamped(&self) -> u64 {
        self.clamped
    }

    /// Bytes of all tables.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.rows.iter().map(|row| row.table.bytes() + row.outcomes.len() * size_of::<u32>()).sum()
    }

    /// The row of `slot` is no longer what its table says.
    pub(crate) fn outdate(&mut self, slot: usize) {
        self.old_count += usize::from(!std::mem::replace(&mut self.is_old[slot], true));
    }

    /// The patch in `slot` leaves; `neighbours` have it in their rows.
    pub(crate) fn forget(&mut self, slot: usize, neighbours: impl Iterator<Item = usize>) {
        for neighbour in neighbours.filter(|&neighbour| neighbour != slot) {
            for outcome in self.rows[neighbour].outcomes.iter_mut().filter(|outcome| **outcome == slot as u32)
            {
                *outcome = OUTSIDE;
            }
            self.outdate(neighbour);
        }
        self.rows[slot] = RowDraw::default();
        self.old_count -= usize::from(std::mem::take(&mut self.is_old[slot]));
    }

    /// Rebuilds tables of changed rows, in turn, until `items_max` items are exceeded.
    ///
    /// # Errors
    /// [`TableError`]: a row that cannot be; rows are checked when patches enter.
    pub(crate) fn rebuild(&mut self, links: &LinkRows, items_max: u32) -> Result<Rebuilt, TableError> {
        let mut rebuilt = Rebuilt::default();
        let mut looked_at = 0;
        while self.old_count > 0 && rebuilt.items < u64::from(items_max) && looked_at < self.rows.len() {
            let slot = self.cursor;
            self.cursor = (self.cursor + 1) % self.rows.len();
            looked_at += 1;
            if !self.is_old[slot] {
                continue;
            }
            let outside = links.outside_share(slot, &mut self.weights);
            self.weights.push(outside);
            let RowDraw { table, outcomes } = &mut self.rows[slot];
            self.clamped += u64::from(table.rebuild(&self.weights, &mut self.room)?);
            outcomes.clear();
            outcomes.extend(links.row(slot).iter().map(|link| link.slot));
            outcomes.push(OUTSIDE);
            self.is_old[slot] = false;
            self.old_count -= 1;
            rebuilt.rows += 1;
            rebuilt.items += self.weights.len() as u64;
        }
        rebuilt.waiting = self.old_count as u32;
        Ok(rebuilt)
    }
}
