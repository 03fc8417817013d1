//! Tables of resident rows, rebuilt a few at a time: [`RowSampler`].
//!
//! A row's items are its links and, last, two for what comes from outside the resident set: what is far and the sky, as
//! likely as [`LinkRows::outside_share`] and the sky's share say. A row that has changed keeps its old table until its
//! turn: an item whose patch has left looks far meanwhile, so the row's probabilities still sum to one and no light is
//! invented. The most urgent rows have their turn first, and a part of every step goes round all of them.

use super::draws::{Draws, TableSources};
use super::links::LinkRows;
use super::temporal::{Drawn, Scene, drawn};
use super::turns::{Rebuilt, Turns};
use crate::backend::BackendError;
use crate::tables::draw::Spread;
use crate::tables::{BuildRoom, RowTable, TableError};

/// What a draw looks at besides slots: what is far, that is neither resident nor the sky.
pub const FAR: u32 = u32::MAX;
/// What a draw looks at besides slots: the sky.
pub const SKY: u32 = u32::MAX - 1;
/// The table of one row.
#[derive(Debug, Clone, Default)]
pub struct RowDraw<T> {
    /// Over the items of `outcomes`.
    pub table: T,
    /// A slot an item, or [`FAR`], or [`SKY`].
    pub outcomes: Vec<u32>,
}

/// One table a slot.
#[derive(Debug)]
pub struct RowSampler<T> {
    rows: Vec<RowDraw<T>>,
    turns: Turns,
    room: BuildRoom,
    weights: Vec<f32>,
    /// Negative weights that counted as zero.
    clamped: u64,
}

impl<T: RowTable + Clone> RowSampler<T> {
    pub(crate) fn new(links: &LinkRows) -> Self {
        Self {
            rows: vec![RowDraw { table: T::default(), outcomes: Vec::new() }; links.capacity()],
            turns: Turns::new(links),
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

    /// The patch in `slot` leaves; `neighbours` have it in their rows.
    pub(crate) fn forget(&mut self, slot: usize, neighbours: impl Iterator<Item = usize>) {
        for neighbour in neighbours.filter(|&neighbour| neighbour != slot) {
            for outcome in self.rows[neighbour].outcomes.iter_mut().filter(|outcome| **outcome == slot as u32)
            {
                *outcome = FAR;
            }
            self.turns.outdate(neighbour);
        }
        self.rows[slot] = RowDraw::default();
        self.turns.settle(slot);
    }

    /// Rebuilds tables of changed rows, the first of `order` first, until `items_max` items are exceeded.
    ///
    /// # Errors
    /// [`TableError`]: a row that cannot be; rows are checked when patches enter.
    pub(crate) fn rebuild(
        &mut self,
        links: &LinkRows,
        sky_shares: &[f32],
        order: &[u32],
        items_max: u32,
    ) -> Result<Rebuilt, TableError> {
        let Self { rows, turns, room, weights, clamped } = self;
        turns.rebuild(order, items_max, |slot| {
            let outside = links.outside_share(slot, weights);
            let sky = sky_part(outside, sky_shares[slot]);
            weights.extend([outside - sky, sky]);
            let RowDraw { table, outcomes } = &mut rows[slot];
            *clamped += u64::from(table.rebuild(weights, room)?);
            outcomes.clear();
            outcomes.extend(links.row(slot).iter().map(|link| link.slot));
            outcomes.extend([FAR, SKY]);
            Ok(weights.len())
        })
    }
}

impl<T: RowTable + Clone> Draws for RowSampler<T> {
    fn come(&mut self, links: &LinkRows, slot: usize) {
        let neighbours = links.row(slot).iter().map(|link| link.slot as usize);
        neighbours.chain([slot]).for_each(|row| self.turns.outdate(row));
    }

    fn go(&mut self, links: &LinkRows, slot: usize) {
        self.forget(slot, links.row(slot).iter().map(|link| link.slot as usize));
    }

    fn outdate(&mut self, slot: usize) {
        self.turns.outdate(slot);
    }

    fn rebuild(&mut self, from: TableSources<'_>, items_max: u32) -> Result<(), BackendError> {
        let rebuilt = self.rebuild(from.links, from.sky_shares, from.order, items_max);
        rebuilt.map(|_| ()).map_err(BackendError::Table)
    }

    fn drawn(
        &self,
        _: &LinkRows,
        scene: Scene<'_>,
        slot: usize,
        key: u32,
        samples: u32,
        spread: Spread,
    ) -> Option<Drawn> {
        let row = &self.rows[slot];
        (!row.outcomes.is_empty()).then(|| drawn(row, scene, slot, key, samples, spread))
    }
}

/// What of a row's share of the outside is the sky's; the rest is far. Rounding of the row goes to the far part.
#[must_use]
pub fn sky_part(outside_share: f32, sky_share: f32) -> f32 {
    sky_share.clamp(0.0, outside_share.max(0.0))
}
