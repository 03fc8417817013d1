//! Tables that draw from a row of form factors: which patch, or which part of the outside, a sample looks at.
//!
//! A row is a distribution: an item for each resident column, one for what is far, one for the sky. A table is built
//! from the items' weights and draws item `i` with probability `weight_i / total`. Weights become integers first
//! ([`masses`]), so that every builder of a kind makes the same table to the bit, whatever the order of its sums, and a
//! shader's table can be held against these.
//!
//! | table | built by | a draw costs |
//! |---|---|---|
//! | [`AliasTable`] | [`sweep`], the oracle; [`split_pack`] and [`merge`], which a GPU can run | one bin |
//! | [`CdfTable`] | prefix sums | a guide entry and a short search |
//!
//! Not here: what light an item brings, and how rows change (the solvers' business).

mod alias_merge;
mod alias_split;
mod alias_sweep;
mod alias_table;
mod cdf_table;
pub mod draw;
pub mod edge_rows;
pub mod masses;
pub mod order;

pub use alias_merge::merge;
pub use alias_split::split_pack;
pub use alias_sweep::{SweepScratch, sweep};
pub use alias_table::{AliasBin, AliasTable, SECTION_ITEMS_MAX};
pub use cdf_table::CdfTable;
pub use masses::UNITS;

/// Why a row has no table. Bytes and rows are checked at the edge; this is the last one.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TableError {
    /// A weight that is infinite or not a number.
    #[error("weight {weight} of item {item} is not finite: the row it comes from is broken; verify the tile")]
    NotFinite {
        /// Which item.
        item: usize,
        /// Its weight.
        weight: f32,
    },
    /// More items than a table can number.
    #[error("{0} items in a row; a table holds at most {max}", max = AliasTable::ITEMS_MAX)]
    TooMany(usize),
}

/// What building needs besides the table, kept from row to row.
#[derive(Debug, Clone, Default)]
pub struct BuildRoom {
    masses: Vec<u32>,
    sweep: SweepScratch,
}

/// A table of one row, of either kind.
pub trait RowTable: Default + Send + Sync {
    /// Makes the table of `weights`, in the items' order. Negative weights, which rounding leaves, count as zero; returns
    /// how many there were. A row without weight draws nothing: its [`total`](Self::total) is zero. O(items).
    ///
    /// # Errors
    /// [`TableError`]: the table is as it was.
    fn rebuild(&mut self, weights: &[f32], room: &mut BuildRoom) -> Result<u32, TableError>;

    /// Sum of the weights: what a mean over draws has to be multiplied by.
    fn total(&self) -> f32;

    /// The item that 32 random bits draw; 0 where there is no weight. O(1) on average.
    fn draw(&self, random: u32) -> usize;

    /// Bytes that the table takes.
    fn bytes(&self) -> usize;
}

/// The checks that both kinds share: how many weights are negative.
fn negative_weights(weights: &[f32]) -> Result<u32, TableError> {
    if weights.len() > AliasTable::ITEMS_MAX {
        return Err(TableError::TooMany(weights.len()));
    }
    let (mut sound, mut negative) = (true, 0u32);
    for &weight in weights {
        sound &= weight.is_finite();
        negative += u32::from(weight < 0.0);
    }
    if sound {
        return Ok(negative);
    }
    let item = weights.iter().position(|weight| !weight.is_finite()).unwrap_or(0);
    Err(TableError::NotFinite { item, weight: weights[item] })
}
