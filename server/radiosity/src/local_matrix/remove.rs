//! Patches leave: their reflectance is set to zero, then their rows and columns are cleared.
//!
//! With `c` the leaving patches' reflectance, `A` their areas and `p` their slots:
//!
//! ```text
//! G -= G[:, p] K G[:, p]'      K = c (Id + A^-1 G[p, p] c)^-1 A^-1, symmetric
//! ```
//!
//! For one patch this is Sherman-Morrison, `rho / (1 + rho h)`. The pivots are at least one in exact
//! numbers, so nobody is ever refused. No product: the columns are there.

use super::LocalMatrix;
use super::capacitance::{SmallMatrices, symmetrise};
use crate::backend::Slot;
use crate::exchange::entry_at;

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
        self.workspace.set_members(leaving.iter().copied());
        let correction = self.correction(leaving);
        for channel in 0..3 {
            self.copy_out(channel, leaving);
            self.rank_update(channel, leaving.len(), correction.plane(channel), false);
        }
        leaving.iter().for_each(|&slot| self.forget(slot));
    }

    /// Frees a slot whose row and column are clear.
    pub(super) fn forget(&mut self, slot: usize) {
        assert!(self.taken[slot], "{slot} is free");
        self.rows.remove(slot);
        self.reflectance[slot] = earthshine_world::Rgb::ZERO;
        self.areas[slot] = 0.0;
        self.set_taken(slot, false);
    }

    /// `-K`.
    fn correction(&self, leaving: &[usize]) -> SmallMatrices {
        let block = leaving.len();
        let mut matrices = SmallMatrices::zero(block);
        let reflectance = |place: usize, channel| f64::from(self.reflectance[leaving[place]][channel]);
        let area = |place: usize| f64::from(self.areas[leaving[place]]);
        for channel in 0..3 {
            for (at, entry) in matrices.plane_mut(channel).iter_mut().enumerate() {
                let (receiver, sender) = (at / block, at % block);
                let exchange = self.planes[channel][entry_at(leaving[receiver], leaving[sender])];
                let identity = f64::from(u8::from(receiver == sender));
                *entry = identity + f64::from(exchange) / area(receiver) * reflectance(sender, channel);
            }
        }
        matrices.invert(0.0);
        for channel in 0..3 {
            for (at, entry) in matrices.plane_mut(channel).iter_mut().enumerate() {
                *entry *= -reflectance(at / block, channel) / area(at % block);
            }
            symmetrise(matrices.plane_mut(channel), block);
        }
        matrices
    }
}
