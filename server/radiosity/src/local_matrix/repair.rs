//! The way back from drift in small steps: Newton-Schulz, a few columns at a time.
//!
//! With `r = X e + X R A^-1 g - g` the residual of columns `g` of `G` (`X = A F`, sparse: what the patches exchange
//! directly), the refined columns are
//!
//! ```text
//! g + (Id + G R A^-1) r          G stands in for the inverse it approximates
//! ```
//!
//! One round over all columns squares the relative error, down to rounding. A block of [`BLOCK`] columns costs the product
//! of adding so many patches that see everything, and [`BLOCK`] multiplications for each form factor. Meanwhile the matrix can be used and changed: each column that is
//! refined only makes it better.

use super::LocalMatrix;
use super::workspace::{STRIPE_COLUMNS, Workspace};
use crate::backend::Repaired;
use crate::exchange::{BLOCK, TILE_EDGE};
use crate::kernel::Scalar;
use crate::tile_kernel::SparseRow;
use rayon::prelude::*;

impl LocalMatrix {
    /// Refines the columns of the next `columns_max` patches, at least one block of them; goes on where the last call
    /// left off. O(M^2) a column.
    pub fn repair(&mut self, columns_max: u32) -> Repaired {
        let mut columns = 0;
        loop {
            let mut slots = [0; BLOCK];
            let mut count = 0;
            while self.repair_from < self.extent && count < BLOCK {
                if self.taken[self.repair_from] {
                    slots[count] = self.repair_from;
                    count += 1;
                }
                self.repair_from += 1;
            }
            self.refine(&slots[..count]);
            columns += count as u32;
            if self.repair_from >= self.extent {
                self.repair_from = 0;
                return Repaired { columns, is_complete: true };
            }
            if columns.saturating_add(BLOCK as u32) > columns_max {
                return Repaired { columns, is_complete: false };
            }
        }
    }

    fn refine(&mut self, slots: &[usize]) {
        if slots.is_empty() {
            return;
        }
        let stripes = self.stripes();
        let taken = &self.taken;
        self.workspace.set_members(slots.iter().copied());
        self.workspace.list_named(stripes, |name| {
            (0..taken.len().min(stripes * TILE_EDGE)).filter(|&slot| taken[slot]).for_each(name);
        });
        for channel in 0..3 {
            self.copy_out(channel, slots);
            self.residual(channel, slots);
            let Workspace { operand, named, finals, .. } = &mut self.workspace;
            for (operand, &slot) in operand.chunks_exact_mut(BLOCK).zip(named.iter()) {
                let slot = slot as usize;
                let scale = self.reflectance[slot][channel] / self.areas[slot];
                for (to, &from) in operand.iter_mut().zip(&finals[slot * BLOCK..][..BLOCK]) {
                    *to = scale * from;
                }
            }
            self.gather_named(channel, false);
            let Workspace { columns, finals, other, .. } = &mut self.workspace;
            let len = stripes * STRIPE_COLUMNS;
            let parts = columns[channel][..len].iter().zip(&other[..len]);
            for (to, (&column, &echo)) in finals[..len].iter_mut().zip(parts) {
                *to = column + (*to + echo);
            }
            self.settle_members(channel, true);
        }
    }

    /// `finals = X e + X R A^-1 columns - columns` of one channel, `e` the unit vectors of `slots`.
    fn residual(&mut self, channel: usize, slots: &[usize]) {
        let (stripes, set) = (self.stripes(), self.instructions);
        let (areas, rows) = (&self.areas, &self.rows);
        let Workspace { columns, finals, place, vector, .. } = &mut self.workspace;
        // What leaves a patch for each unit of flux that arrives, per m2.
        let slots_of = areas.iter().zip(&self.reflectance).zip(vector.iter_mut());
        for ((&area, reflectance), scale) in slots_of {
            *scale = if area > 0.0 { reflectance[channel] / area } else { 0.0 };
        }
        let scales = &vector[..];
        slots.iter().enumerate().for_each(|(at, &slot)| place[slot] = at as u8);
        let (columns, block) = (&columns[channel][..], &*place);
        finals[..stripes * STRIPE_COLUMNS].par_chunks_mut(BLOCK).enumerate().for_each(|(receiver, out)| {
            if areas[receiver] == 0.0 {
                out.fill(0.0);
                return;
            }
            let entries = rows.row(receiver).map(|(sender, share)| (sender, share * scales[sender]));
            f32::dispatch(set, SparseRow { entries, rows: columns, out });
            for (sender, share) in rows.row(receiver) {
                if let Some(out) = out.get_mut(usize::from(block[sender])) {
                    *out += share;
                }
            }
            for (out, &column) in out.iter_mut().zip(&columns[receiver * BLOCK..][..BLOCK]) {
                *out = areas[receiver] * *out - column;
            }
        });
        slots.iter().for_each(|&slot| self.workspace.place[slot] = super::workspace::ABSENT);
    }
}
