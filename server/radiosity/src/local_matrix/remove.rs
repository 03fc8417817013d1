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
use super::capacitance::{SmallMatrices, leaving};
use crate::backend::Slot;
use crate::exchange::{entry_at, stripe_at};

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
        let mut places = [0; Self::BLOCK_MAX];
        for (to, slot) in places.iter_mut().zip(slots) {
            *to = slot.0 as usize;
        }
        let slots = &places[..slots.len()];
        self.workspace.set_members(slots.iter().copied());
        let correction = self.correction(slots);
        for channel in 0..3 {
            self.copy_out(channel, slots);
            self.rank_update(channel, slots.len(), correction.plane(channel), false);
        }
        slots.iter().for_each(|&slot| self.forget(slot));
    }

    /// All patches leave: O(M^2) writes for all together.
    pub fn clear(&mut self) {
        let used = stripe_at(self.stripes());
        self.planes.iter_mut().for_each(|plane| plane[..used].fill(0.0));
        for slot in (0..self.extent).rev() {
            if self.taken[slot] {
                self.forget(slot);
            }
        }
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
    fn correction(&self, slots: &[usize]) -> SmallMatrices {
        let block = slots.len();
        let mut exchange = SmallMatrices::zero(block);
        for channel in 0..3 {
            for (at, entry) in exchange.plane_mut(channel).iter_mut().enumerate() {
                let (receiver, sender) = (slots[at / block], slots[at % block]);
                *entry = f64::from(self.planes[channel][entry_at(receiver, sender)]);
            }
        }
        leaving(exchange, |place| (self.reflectance[slots[place]], self.areas[slots[place]]))
    }
}
