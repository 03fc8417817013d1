//! Patches enter: the bordered inverse, a block at a time.
//!
//! With the new patches' columns `f_c` and rows `f_r` of `F` over the residents, `f_s` among themselves, `c`
//! their reflectance:
//!
//! ```text
//! U = f_c + H R f_c        S = f_s + f_r R U        G = (Id - c S)^-1
//! V = f_r + f_r R H                                 L = (Id - S c)^-1 = Id + S G c
//!
//! H += U G c V      H[:, new] = U G      H[new, :] = L V      H[new, new] = S G
//! ```
//!
//! For one patch this is DESIGN's `k = 1 / (1 - c s)`. The third equation rides on the first: rows of `new`
//! are zero before, so with `L` for their rows of `U G c` the same pass fills them.

use super::block::{ABSENT, Workspace, find_lit, panel_index, row_products};
use super::capacitance::{SmallMatrices, product};
use super::{Arrival, BAND_ROWS, LocalMatrix, TILE};
use crate::backend::MIN_PIVOT;
use crate::kernel::{GatherColumns, ROW_GROUP, Scalar, ScatterRows};
use rayon::prelude::*;

/// Up to this size a block's columns are single products: cheaper than a tile mostly empty.
const GATHER_SINGLY_MAX: usize = 3;

impl LocalMatrix {
    /// Adds up to [`Self::BLOCK_MAX`] patches at once, as if one after the other. Returns who entered, bit
    /// `b` for `arrivals[b]`; the others' pivot lay below [`MIN_PIVOT`] and their slots stay free.
    ///
    /// # Panics
    /// If there are more patches, or a slot is taken, named twice, or beyond the capacity.
    pub fn add_block(&mut self, arrivals: &[Arrival<'_>]) -> u32 {
        let block = arrivals.len();
        assert!(block <= Self::BLOCK_MAX, "{block} patches in a block");
        if block == 0 {
            return 0;
        }
        for (place, arrival) in arrivals.iter().enumerate() {
            let slot = arrival.slot.0 as usize;
            assert!(!self.taken[slot] && self.workspace.place[slot] == ABSENT, "{slot} is taken");
            self.workspace.place[slot] = place as u8;
            self.extent = self.extent.max(slot + 1);
        }
        self.workspace.depth = block.next_multiple_of(ROW_GROUP);
        self.open_columns(arrivals);
        let returned = self.open_rows(arrivals);
        let (kept, inverse) = self.close_loop(arrivals, &returned);
        for channel in 0..3 {
            self.enter(channel, arrivals, kept, &returned, &inverse);
        }
        self.register(arrivals, kept);
        kept
    }

    /// `columns = f_c + H R f_c`.
    fn open_columns(&mut self, arrivals: &[Arrival<'_>]) {
        let taken = &self.taken;
        self.workspace.list_named(self.extent, |name| {
            for (slot, _) in arrivals.iter().flat_map(|arrival| arrival.column) {
                if taken[slot.0 as usize] {
                    name(slot.0 as usize);
                }
            }
        });
        for channel in 0..3 {
            if arrivals.len() <= GATHER_SINGLY_MAX {
                self.gather_singly(channel, arrivals);
            } else {
                self.gather_together(channel, arrivals);
            }
            let columns = &mut self.workspace.columns[channel];
            for (place, arrival) in arrivals.iter().enumerate() {
                for &(slot, share) in arrival.column {
                    if self.taken[slot.0 as usize] {
                        columns[slot.0 as usize * TILE + place] += share;
                    }
                }
            }
        }
    }

    fn gather_singly(&mut self, channel: usize, arrivals: &[Arrival<'_>]) {
        let rows = self.active_rows();
        let (stride, extent) = (self.stride, self.extent);
        let Workspace { products, lit_runs, columns, vector, .. } = &mut self.workspace;
        let columns = &mut columns[channel][..rows * TILE];
        columns.fill(0.0);
        for (place, arrival) in arrivals.iter().enumerate() {
            vector.fill(0.0);
            for &(slot, share) in arrival.column {
                let slot = slot.0 as usize;
                if self.taken[slot] {
                    vector[slot] += self.reflectance[slot][channel] * share;
                }
            }
            find_lit(vector, extent, lit_runs);
            let matrix = &self.planes[channel][..rows * stride];
            row_products(self.instructions, matrix, stride, vector, lit_runs, &mut products[..rows]);
            for (row, &sum) in columns.chunks_exact_mut(TILE).zip(&products[..rows]) {
                row[place] = sum as f32;
            }
        }
    }

    fn gather_together(&mut self, channel: usize, arrivals: &[Arrival<'_>]) {
        let rows = self.active_rows();
        let (stride, set) = (self.stride, self.instructions);
        let Workspace { columns, operand, named, index, .. } = &mut self.workspace;
        let operand = &mut operand[..named.len() * TILE];
        operand.fill(0.0);
        for (place, arrival) in arrivals.iter().enumerate() {
            for &(slot, share) in arrival.column {
                let slot = slot.0 as usize;
                if self.taken[slot] {
                    operand[index[slot] as usize * TILE + place] += self.reflectance[slot][channel] * share;
                }
            }
        }
        self.planes[channel][..rows * stride]
            .par_chunks(BAND_ROWS * stride)
            .zip(columns[channel][..rows * TILE].par_chunks_mut(BAND_ROWS * TILE))
            .for_each(|(matrix, out)| {
                f32::dispatch(set, GatherColumns { matrix, stride, columns: named, panel: operand, out });
            });
    }

    /// `panels = f_r + f_r R H`; returns `S`, the light that comes back to the new patches.
    fn open_rows(&mut self, arrivals: &[Arrival<'_>]) -> SmallMatrices {
        let taken = &self.taken;
        self.workspace.list_named(self.extent, |name| {
            for (slot, _) in arrivals.iter().flat_map(|arrival| arrival.row) {
                if taken[slot.0 as usize] {
                    name(slot.0 as usize);
                }
            }
        });
        let mut returned = SmallMatrices::zero(arrivals.len());
        for channel in 0..3 {
            let depth = self.workspace.depth;
            let Workspace { operand, named, index, .. } = &mut self.workspace;
            operand[..depth * named.len()].fill(0.0);
            for (place, arrival) in arrivals.iter().enumerate() {
                for &(slot, share) in arrival.row {
                    let slot = slot.0 as usize;
                    if self.taken[slot] {
                        operand[index[slot] as usize * depth + place] +=
                            self.reflectance[slot][channel] * share;
                    }
                }
            }
            self.scatter_rows(channel);
            let panels = &mut self.workspace.panels[channel];
            for (place, arrival) in arrivals.iter().enumerate() {
                for &(slot, share) in arrival.row {
                    if self.taken[slot.0 as usize] {
                        panels[panel_index(depth, place, slot.0 as usize)] += share;
                    }
                }
            }
            self.return_light(channel, arrivals, returned.plane_mut(channel));
        }
        returned
    }

    /// `S = f_s + f_r R U` of one channel; `operand` holds `f_r R`.
    fn return_light(&self, channel: usize, arrivals: &[Arrival<'_>], returned: &mut [f64]) {
        let block = arrivals.len();
        let Workspace { columns, operand, named, depth, place, .. } = &self.workspace;
        let mut sums = [0.0f32; TILE * TILE];
        if !named.is_empty() {
            let kernel = ScatterRows {
                matrix: &columns[channel],
                stride: TILE,
                first_column: 0,
                rows: named,
                coefficients: &operand[..depth * named.len()],
                depth: *depth,
                out: &mut sums[..depth * TILE],
            };
            f32::dispatch(self.instructions, kernel);
        }
        for (returned, sums) in returned.chunks_exact_mut(block).zip(sums.chunks_exact(TILE)) {
            for (returned, &sum) in returned.iter_mut().zip(sums) {
                *returned = f64::from(sum);
            }
        }
        for (new, arrival) in arrivals.iter().enumerate() {
            for (from, share) in within_block(place, arrival.row, new + 1) {
                returned[new * block + from] += f64::from(share);
            }
            for (to, share) in within_block(place, arrival.column, new) {
                returned[to * block + new] += f64::from(share);
            }
        }
    }

    /// `G`, and who may enter.
    fn close_loop(&self, arrivals: &[Arrival<'_>], returned: &SmallMatrices) -> (u32, SmallMatrices) {
        let block = arrivals.len();
        let mut inverse = SmallMatrices::zero(block);
        for channel in 0..3 {
            let system = inverse.plane_mut(channel).iter_mut().zip(returned.plane(channel));
            for (at, (entry, &returned)) in system.enumerate() {
                let reflectance = f64::from(arrivals[at / block].reflectance[channel]);
                *entry = f64::from(u8::from(at / block == at % block)) - reflectance * returned;
            }
        }
        (inverse.invert(f64::from(MIN_PIVOT)), inverse)
    }

    /// Writes one channel of `H`.
    fn enter(
        &mut self,
        channel: usize,
        arrivals: &[Arrival<'_>],
        kept: u32,
        returned: &SmallMatrices,
        inverse: &SmallMatrices,
    ) {
        let block = arrivals.len();
        let mut among = SmallMatrices::zero(block);
        product(returned.plane(channel), inverse.plane(channel), block, among.plane_mut(channel));
        among.keep(channel, kept);
        self.multiply_columns(channel, inverse.plane(channel), block);
        let (mut slots, mut reflectance) = ([0; Self::BLOCK_MAX], [0.0; Self::BLOCK_MAX]);
        for (place, arrival) in arrivals.iter().enumerate() {
            slots[place] = arrival.slot.0 as usize;
            reflectance[place] = arrival.reflectance[channel];
        }
        let (slots, reflectance) = (&slots[..block], &reflectance[..block]);
        // `left` goes to the update with the reflectance in it, to the columns of `new` without.
        let rows = self.active_rows() * TILE;
        let Workspace { left, columns, .. } = &mut self.workspace;
        let (left, columns) = (&mut left[..rows], &mut columns[channel][..rows]);
        columns.copy_from_slice(left);
        for row in left.chunks_exact_mut(TILE) {
            row.iter_mut().zip(reflectance).for_each(|(entry, reflectance)| *entry *= reflectance);
        }
        for (new, &slot) in slots.iter().enumerate().filter(|(new, _)| kept >> new & 1 == 1) {
            for (from, reflectance) in reflectance.iter().enumerate() {
                let share = among.plane(channel)[new * block + from];
                let identity = f64::from(u8::from(new == from));
                columns[slot * TILE + from] = share as f32;
                left[slot * TILE + from] = (identity + share * f64::from(*reflectance)) as f32;
            }
        }
        self.rank_update(channel, block, |_, row, columns| {
            slots.iter().zip(columns).for_each(|(&slot, &share)| row[slot] = share);
        });
    }

    /// Notes who came, and what they see.
    pub(super) fn register(&mut self, arrivals: &[Arrival<'_>], kept: u32) {
        for (place, arrival) in arrivals.iter().enumerate() {
            let new = arrival.slot.0 as usize;
            self.workspace.place[new] = ABSENT;
            if kept >> place & 1 == 1 {
                self.set_taken(new, true);
                self.reflectance[new] = arrival.reflectance;
                for &(slot, share) in arrival.row {
                    if self.taken[slot.0 as usize] {
                        self.rows.insert(new, slot.0 as usize, share);
                    }
                }
                for &(slot, share) in arrival.column {
                    if self.taken[slot.0 as usize] {
                        self.rows.insert(slot.0 as usize, new, share);
                    }
                }
            }
        }
        while self.extent > 0 && !self.taken[self.extent - 1] {
            self.extent -= 1;
        }
    }
}

/// Entries that name one of the first `before` patches of the block: its place, the share.
fn within_block<'a>(
    place: &'a [u8],
    entries: &'a [(crate::backend::Slot, f32)],
    before: usize,
) -> impl Iterator<Item = (usize, f32)> + 'a {
    entries
        .iter()
        .map(|&(slot, share)| (usize::from(place[slot.0 as usize]), share))
        .filter(move |&(place, _)| place < before)
}
