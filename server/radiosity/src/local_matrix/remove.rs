//! Patches leave: their reflectance is set to zero, then their rows and columns are cleared.
//!
//! With `c` the leaving patches' reflectance and `p` their slots:
//!
//! ```text
//! H -= H[:, p] c (Id + H[p, p] c)^-1 H[p, :]
//! ```
//!
//! For one patch this is Sherman-Morrison, `rho / (1 + rho h)`. The pivots are at least one in exact
//! numbers, so nobody is ever refused.

use super::block::panel_index;
use super::capacitance::SmallMatrices;
use super::{LocalMatrix, TILE};
use crate::backend::Slot;
use crate::kernel::ROW_GROUP;

impl LocalMatrix {
    /// Removes up to [`Self::BLOCK_MAX`] patches at once.
    ///
    /// # Panics
    /// If there are more, or a slot is free, named twice, or beyond the capacity.
    pub fn remove_block(&mut self, slots: &[Slot]) {
        assert!(slots.len() <= Self::BLOCK_MAX, "{} patches in a block", slots.len());
        if slots.is_empty() {
            return;
        }
        let mut leaving = [0; Self::BLOCK_MAX];
        for (to, slot) in leaving.iter_mut().zip(slots) {
            *to = slot.0 as usize;
        }
        let leaving = &leaving[..slots.len()];
        self.workspace.depth = leaving.len().next_multiple_of(ROW_GROUP);
        let correction = self.correction(leaving);
        for channel in 0..3 {
            self.copy_out(channel, leaving);
            self.multiply_columns(channel, correction.plane(channel), leaving.len());
            self.rank_update(channel, leaving.len(), |slot, row, _| clear_row(slot, row, leaving));
        }
        leaving.iter().for_each(|&slot| self.forget(slot));
    }

    /// Frees a slot whose row and column are clear.
    pub(super) fn forget(&mut self, slot: usize) {
        assert!(self.taken[slot], "{slot} is free");
        self.rows.remove(slot);
        self.reflectance[slot] = earthshine_world::Rgb::ZERO;
        self.set_taken(slot, false);
    }

    /// `-c (Id + H[p, p] c)^-1`.
    fn correction(&self, leaving: &[usize]) -> SmallMatrices {
        let block = leaving.len();
        let mut matrices = SmallMatrices::zero(block);
        let reflectance = |place: usize, channel| f64::from(self.reflectance[leaving[place]][channel]);
        for channel in 0..3 {
            for (at, entry) in matrices.plane_mut(channel).iter_mut().enumerate() {
                let (receiver, sender) = (at / block, at % block);
                let share = self.planes[channel][leaving[receiver] * self.stride + leaving[sender]];
                let identity = f64::from(u8::from(receiver == sender));
                *entry = identity + f64::from(share) * reflectance(sender, channel);
            }
        }
        matrices.invert(0.0);
        for channel in 0..3 {
            for (at, entry) in matrices.plane_mut(channel).iter_mut().enumerate() {
                *entry *= -reflectance(at / block, channel);
            }
        }
        matrices
    }

    /// The leaving columns into `columns`, their rows into `panels`.
    fn copy_out(&mut self, channel: usize, leaving: &[usize]) {
        let (rows, stride, tiles) = (self.active_rows(), self.stride, self.extent.div_ceil(TILE));
        let plane = &self.planes[channel][..rows * stride];
        let columns = &mut self.workspace.columns[channel];
        for (row, columns) in plane.chunks_exact(stride).zip(columns.chunks_exact_mut(TILE)) {
            for (to, &slot) in columns.iter_mut().zip(leaving) {
                *to = row[slot];
            }
        }
        for (place, &slot) in leaving.iter().enumerate() {
            for (tile, from) in plane[slot * stride..].chunks_exact(TILE).take(tiles).enumerate() {
                let at = panel_index(self.workspace.depth, place, tile * TILE);
                self.workspace.panels[channel][at..at + TILE].copy_from_slice(from);
            }
        }
    }

    /// Zeroes rows and columns.
    pub(super) fn clear(&mut self, channel: usize, leaving: &[usize]) {
        let (rows, stride) = (self.active_rows(), self.stride);
        for (slot, row) in self.planes[channel][..rows * stride].chunks_exact_mut(stride).enumerate() {
            clear_row(slot, row, leaving);
        }
    }
}

fn clear_row(slot: usize, row: &mut [f32], leaving: &[usize]) {
    if leaving.contains(&slot) {
        row.fill(0.0);
    } else {
        leaving.iter().for_each(|&leaving| row[leaving] = 0.0);
    }
}
