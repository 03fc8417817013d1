//! Draws from rows of the multibounce matrix: all bounces at once, in colour, without feedback.
//!
//! ```text
//! I = H (E + rho g) + g        weight of j: mean over channels of H_ij; what a draw of j brings: H_ij / weight * (E_j + rho_j g_j)
//! ```
//!
//! Rows of form factors have no colour, rows of `H` have three. One table serves all channels: a draw carries the tint of its
//! item, so colours stay together and a third of the draws does. The sources' second way to sample; it needs the matrix. What comes
//! from outside is not drawn: `g` is known.

use super::draws::{Draws, TableSources};
use super::links::LinkRows;
use super::temporal::{Drawn, Scene, square_of_sum};
use super::turns::Turns;
use super::{Light, add_scaled};
use crate::backend::{BackendError, Slot};
use crate::tables::draw::{Spread, random};
use crate::tables::{BuildRoom, RowTable, TableError};
use earthshine_world::Rgb;

/// What a draw of such a row looks at.
#[derive(Debug, Clone, Copy)]
struct Item {
    slot: u32,
    /// Whose slot it was when the table was built: who has come since is not meant.
    tenancy: u32,
    /// The entry's channels over their mean.
    tint: Light,
}

/// A row of the multibounce matrix to draw from.
#[derive(Debug, Clone, Default)]
pub struct ColouredRow<T> {
    table: T,
    items: Vec<Item>,
}

impl<T: RowTable> ColouredRow<T> {
    /// Makes the row anew from its entries. O(entries).
    ///
    /// # Errors
    /// [`TableError`]: the matrix has gone wrong.
    pub fn rebuild(
        &mut self,
        links: &LinkRows,
        entries: &[(Slot, Rgb)],
        room: &mut BuildRoom,
    ) -> Result<(), TableError> {
        let mut weights = Vec::with_capacity(entries.len());
        self.items.clear();
        for &(slot, shares) in entries {
            let mean = shares.element_sum() / 3.0;
            // Rounding may leave a little less than nothing.
            if mean > 0.0 {
                let tenancy = links.tenancy(slot.0 as usize);
                self.items.push(Item { slot: slot.0, tenancy, tint: super::light(shares / mean) });
                weights.push(mean);
            }
        }
        self.table.rebuild(&weights, room).map(|_| ())
    }

    /// What `samples` draws with key `key` say: `sent` is `E + rho g` by slot, `outside` is `g` of this row.
    #[must_use]
    pub fn drawn(
        &self,
        links: &LinkRows,
        sent: &[Light],
        outside: &Light,
        key: u32,
        samples: u32,
        spread: Spread,
    ) -> Drawn {
        let (mut sum, mut squares) = ([0.0f32; 4], 0.0f32);
        for sample in (0..samples).filter(|_| !self.items.is_empty()) {
            let item = &self.items[self.table.draw(random(key, sample, samples, spread))];
            if links.tenancy(item.slot as usize) == item.tenancy {
                let light = &sent[item.slot as usize];
                let light: Light = std::array::from_fn(|channel| item.tint[channel] * light[channel]);
                add_scaled(&mut sum, 1.0, &light);
                squares += square_of_sum(&light);
            }
        }
        let mut drawn = Drawn::of(&sum, squares, samples, self.table.total());
        add_scaled(&mut drawn.irradiance, 1.0, outside);
        drawn
    }
}

/// One such row a slot. A patch that comes or goes changes all of `H`, so all rows wait for their turn; until then they
/// miss the light of who has come, and that of who has gone is none.
#[derive(Debug)]
pub struct ColouredSampler<T> {
    rows: Vec<ColouredRow<T>>,
    turns: Turns,
    room: BuildRoom,
    entries: Vec<(Slot, Rgb)>,
}

impl<T: RowTable + Clone> ColouredSampler<T> {
    pub(crate) fn new(links: &LinkRows) -> Self {
        Self {
            rows: vec![ColouredRow { table: T::default(), items: Vec::new() }; links.capacity()],
            turns: Turns::new(links),
            room: BuildRoom::default(),
            entries: Vec::new(),
        }
    }

    fn outdate_all(&mut self, links: &LinkRows) {
        (0..links.capacity()).filter(|&slot| links.is_taken(slot)).for_each(|slot| self.turns.outdate(slot));
    }
}

impl<T: RowTable + Clone> Draws for ColouredSampler<T> {
    fn come(&mut self, links: &LinkRows, _: usize) {
        self.outdate_all(links);
    }

    fn go(&mut self, links: &LinkRows, slot: usize) {
        self.rows[slot].items.clear();
        self.outdate_all(links);
        self.turns.settle(slot);
    }

    /// What comes from outside is not drawn.
    fn outdate(&mut self, _: usize) {}

    fn rebuild(&mut self, from: TableSources<'_>, items_max: u32) -> Result<(), BackendError> {
        let Some(matrix) = from.matrix else { return Err(BackendError::NoRows) };
        let Self { rows, turns, room, entries } = self;
        let rebuilt = turns.rebuild(from.order, items_max, |slot| {
            matrix.read_row(Slot(slot as u32), entries)?;
            rows[slot].rebuild(from.links, entries, room).map_err(BackendError::Table)?;
            Ok(entries.len())
        });
        rebuilt.map(|_| ())
    }

    fn drawn(
        &self,
        links: &LinkRows,
        scene: Scene<'_>,
        slot: usize,
        key: u32,
        samples: u32,
        spread: Spread,
    ) -> Option<Drawn> {
        let row = &self.rows[slot];
        let has_table = !row.items.is_empty();
        has_table.then(|| row.drawn(links, scene.sent, &scene.outside[slot], key, samples, spread))
    }
}
