//! The sources' update, for comparison only: bounces cut off, and nothing undone when a patch leaves.
//!
//! An add stops at the paths that meet the new patch once (`k = 1`, light that returns to it and
//! leaves again is missing); a removal clears the row and the column and leaves in `H` all the light
//! that had gone over the patch. Cheap, and ever brighter: never a default.

use super::{Arrival, LocalMatrix};
use crate::backend::Slot;

impl LocalMatrix {
    /// Adds a patch as the sources do.
    ///
    /// # Panics
    /// If the slot is taken or beyond the capacity.
    pub fn add_truncated(&mut self, arrival: &Arrival<'_>) {
        let new = arrival.slot.0 as usize;
        assert!(!self.taken[new], "{new} is taken");
        self.extent = self.extent.max(new + 1);
        for channel in 0..3 {
            let weighted = |entries: &[(Slot, f32)]| -> Vec<(usize, f32, f32)> {
                let present = entries.iter().filter(|(slot, _)| self.is_taken(*slot));
                let entry = |slot: usize, share| (slot, share, share * self.reflectance[slot][channel]);
                present.map(|&(slot, share)| entry(slot.0 as usize, share)).collect()
            };
            let (row, column) = (weighted(arrival.row), weighted(arrival.column));
            let plane = &self.planes[channel];
            let mut u = vec![0.0f32; self.extent];
            for (u, matrix) in u.iter_mut().zip(plane.chunks_exact(self.stride)) {
                *u = column.iter().map(|&(slot, _, weight)| matrix[slot] * weight).sum();
            }
            let mut v = vec![0.0f32; self.extent];
            for &(slot, _, weight) in &row {
                for (v, entry) in v.iter_mut().zip(&plane[slot * self.stride..]) {
                    *v += weight * entry;
                }
            }
            column.iter().for_each(|&(slot, share, _)| u[slot] += share);
            row.iter().for_each(|&(slot, share, _)| v[slot] += share);
            let returned: f32 = row.iter().map(|&(slot, _, weight)| weight * u[slot]).sum();
            let reflectance = arrival.reflectance[channel];
            for (matrix, &u) in self.planes[channel].chunks_exact_mut(self.stride).zip(&u) {
                for (entry, &v) in matrix.iter_mut().zip(&v) {
                    *entry += reflectance * u * v;
                }
                matrix[new] = u;
            }
            self.planes[channel][new * self.stride..][..self.extent].copy_from_slice(&v);
            self.planes[channel][new * self.stride + new] = returned;
        }
        self.register(&[*arrival], 1);
    }

    /// Removes a patch as the sources do.
    ///
    /// # Panics
    /// If the slot is free or beyond the capacity.
    pub fn remove_truncated(&mut self, slot: Slot) {
        (0..3).for_each(|channel| self.clear(channel, &[slot.0 as usize]));
        self.forget(slot.0 as usize);
    }
}
