//! How far rounding has carried `H` from the matrix it stands for, and the way back.

use super::LocalMatrix;
use crate::dense::{DenseError, DenseMatrix, LuFactors};
use crate::exchange::entry_at;
use earthshine_world::random::{Purpose, hash, unit_f32};
use rayon::prelude::*;

/// Columns solved for at a time: bounds the memory of a fresh solve to `8 M^2 + 8 M SOLVE_COLUMNS` bytes.
const SOLVE_COLUMNS: usize = 1024;

impl LocalMatrix {
    /// `|H x - F (x + R H x)| / |H x|` over all channels, for an exitance `x` random in 0..1 by `seed`.
    /// O(M^2). Infinite if `H` holds what is not a number; zero if there is no light to compare.
    pub fn drift(&mut self, seed: u64) -> f32 {
        let (mut gap, mut norm) = (0.0f64, 0.0f64);
        let mut irradiance = vec![0.0f32; self.capacity];
        let mut exitance = vec![0.0f32; self.capacity];
        for channel in 0..3 {
            for (slot, exitance) in exitance.iter_mut().enumerate().take(self.capacity) {
                let random = hash(seed, Purpose::Simulation, slot as u64, channel as u64);
                *exitance = if self.taken[slot] { unit_f32(random) } else { 0.0 };
            }
            self.multiply(channel, &exitance, &mut irradiance);
            let leaving = |slot: usize| {
                f64::from(exitance[slot])
                    + f64::from(self.reflectance[slot][channel]) * f64::from(irradiance[slot])
            };
            let residual = |slot: usize| {
                let arriving: f64 = self.rows.row(slot).map(|(j, share)| f64::from(share) * leaving(j)).sum();
                arriving - f64::from(irradiance[slot])
            };
            let residuals: Vec<f64> = (0..self.extent).into_par_iter().map(residual).collect();
            gap += residuals.iter().map(|residual| residual * residual).sum::<f64>();
            norm += irradiance.iter().map(|&value| f64::from(value) * f64::from(value)).sum::<f64>();
        }
        match (gap / norm).sqrt() {
            _ if gap == 0.0 => 0.0,
            drift if drift.is_finite() => drift as f32,
            _ => f32::INFINITY,
        }
    }

    /// Solves `H` afresh from the resident form factors, in `f64`. O(M^3).
    ///
    /// # Errors
    /// [`DenseError`]: no memory, or a system that rounding made singular; that channel and those after it
    /// stay as they were.
    pub fn resolve(&mut self) -> Result<(), DenseError> {
        let slots: Vec<usize> = (0..self.extent).filter(|&slot| self.taken[slot]).collect();
        let mut place = vec![0; self.capacity];
        for (at, &slot) in slots.iter().enumerate() {
            place[slot] = at;
        }
        let n = slots.len();
        for channel in 0..3 {
            let mut system = DenseMatrix::zeros(n, n)?;
            for (at, &slot) in slots.iter().enumerate() {
                let row = system.row_mut(at);
                row[at] = 1.0;
                for (column, share) in self.rows.row(slot) {
                    row[place[column]] -= f64::from(share) * f64::from(self.reflectance[column][channel]);
                }
            }
            let factors = LuFactors::new(system)?;
            for first in (0..n).step_by(SOLVE_COLUMNS) {
                let width = SOLVE_COLUMNS.min(n - first);
                let mut right = DenseMatrix::zeros(n, width)?;
                for (at, &slot) in slots.iter().enumerate() {
                    for (column, share) in self.rows.row(slot) {
                        if let Some(entry) = place[column].checked_sub(first).filter(|&at| at < width) {
                            right.row_mut(at)[entry] += f64::from(share);
                        }
                    }
                }
                factors.solve(&mut right);
                for (at, &slot) in slots.iter().enumerate() {
                    for (&value, &column) in right.row(at).iter().zip(&slots[first..]) {
                        let exchange = value * f64::from(self.areas[slot]);
                        if slot >= column {
                            self.set_pair(channel, slot, column, exchange as f32);
                        }
                    }
                }
            }
        }
        // A round of repairs that was under way has nothing left to do.
        self.repair_from = 0;
        Ok(())
    }

    /// Sets an entry and its mirror image.
    fn set_pair(&mut self, channel: usize, a: usize, b: usize, exchange: f32) {
        self.planes[channel][entry_at(a, b)] = exchange;
        self.planes[channel][entry_at(b, a)] = exchange;
    }

    /// Multiplies one entry of `H`, and what it answers to by reciprocity: a fault for tests of the probe.
    #[cfg(test)]
    pub(crate) fn corrupt(&mut self, channel: usize, row: usize, column: usize, factor: f32) {
        let exchange = self.planes[channel][entry_at(row, column)] * factor;
        self.set_pair(channel, row, column, exchange);
    }
}
