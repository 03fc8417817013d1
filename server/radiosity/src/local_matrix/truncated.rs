//! The sources' update, for comparison only: bounces cut off, and nothing undone when a patch leaves.
//!
//! An add stops at the paths that meet the new patch once (`k = 1`, light that returns to it and
//! leaves again is missing); a removal clears the row and the column and leaves in the matrix all the light
//! that had gone over the patch. Cheap, and ever brighter: never a default.

use super::{Arrival, LocalMatrix};
use crate::backend::Slot;
use crate::exchange::BLOCK;

impl LocalMatrix {
    /// Adds a patch as the sources do.
    ///
    /// # Panics
    /// If the slot is taken or beyond the capacity.
    pub fn add_truncated(&mut self, arrival: &Arrival<'_>) {
        let arrivals = [*arrival];
        let returned = self.open(&arrivals);
        for channel in 0..3 {
            self.set_finals(channel, &[1.0], 1);
            self.workspace.finals[arrival.slot.0 as usize * BLOCK] = returned.plane(channel)[0] as f32;
            let factor = f64::from(arrival.reflectance[channel]) / f64::from(arrival.area);
            self.rank_update(channel, 1, &[factor], true);
        }
        self.register(&arrivals, 1);
    }

    /// Removes a patch as the sources do.
    ///
    /// # Panics
    /// If the slot is free or beyond the capacity.
    pub fn remove_truncated(&mut self, slot: Slot) {
        let slot = slot.0 as usize;
        self.workspace.set_members(std::iter::once(slot));
        (0..3).for_each(|channel| self.settle_members(channel, false));
        self.forget(slot);
    }
}
