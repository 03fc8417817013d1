//! What a method that draws keeps of rows, whichever rows and tables they are: [`Draws`].

use super::links::LinkRows;
use super::temporal::{Drawn, Scene};
use crate::backend::{Backend, BackendError};
use crate::tables::draw::Spread;

/// What tables are made from.
pub(crate) struct TableSources<'a> {
    pub(crate) links: &'a LinkRows,
    /// The sky's share of each slot's row.
    pub(crate) sky_shares: &'a [f32],
    /// Slots, most urgent first.
    pub(crate) order: &'a [u32],
    /// Where rows of the matrix come from.
    pub(crate) matrix: Option<&'a mut dyn Backend>,
}

/// Tables of resident rows, rebuilt a few at a time, and draws from them.
pub(crate) trait Draws: Send + Sync {
    /// A patch has come into `slot`; its links are there.
    fn come(&mut self, links: &LinkRows, slot: usize);

    /// The patch in `slot` goes; its links are still there.
    fn go(&mut self, links: &LinkRows, slot: usize);

    /// What the row of `slot` sends outside is split otherwise.
    fn outdate(&mut self, slot: usize);

    /// Rebuilds tables of rows that have changed, about `items_max` items.
    fn rebuild(&mut self, from: TableSources<'_>, items_max: u32) -> Result<(), BackendError>;

    /// What `samples` draws of the row of `slot` say; nothing before it has a table.
    fn drawn(
        &self,
        links: &LinkRows,
        scene: Scene<'_>,
        slot: usize,
        key: u32,
        samples: u32,
        spread: Spread,
    ) -> Option<Drawn>;
}
