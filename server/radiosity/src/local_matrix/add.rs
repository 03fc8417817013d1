//! Patches enter: the bordered inverse, a block at a time.
//!
//! With `X = A_new f_r` the new patches' exchange with the residents (m2), `X_s` that among themselves, `c` their
//! reflectance and `R` the residents':
//!
//! ```text
//! W = X' + G R A^-1 X'          columns of G before the loop is closed
//! T = X_s + X R A^-1 W          light that returns to the new patches: A_new S, symmetric
//! N = (Id - c A_new^-1 T)^-1    K = N c A_new^-1, symmetric
//!
//! G += W K W'      G[:, new] = W N      G[new, new] = T N
//! ```
//!
//! For one patch this is DESIGN's `k = 1 / (1 - c s)`: `N = k`, `K = c k / A`. Its row `v` is its column `u` by
//! reciprocity, so one product serves both.

use super::capacitance::{Entering, SmallMatrices, symmetrise};
use super::workspace::{ABSENT, STRIPE_COLUMNS, Workspace, times_small};
use super::{Arrival, LocalMatrix};
use crate::backend::MIN_PIVOT;
use crate::exchange::{BLOCK, TILE_EDGE};
use crate::kernel::Scalar;
use crate::tile_kernel::BlockProduct;

/// Up to this size a block's columns are single products: cheaper than columns mostly empty.
const GATHER_SINGLY_MAX: usize = 4;

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
        let returned = self.open(arrivals);
        let patch = |place: usize| (arrivals[place].reflectance, arrivals[place].area);
        let entering = Entering::solve(&returned, f64::from(MIN_PIVOT), patch);
        for channel in 0..3 {
            self.enter(channel, arrivals, &entering);
        }
        self.register(arrivals, entering.kept);
        entering.kept
    }

    /// Computes the block's `columns`; returns `T`.
    pub(super) fn open(&mut self, arrivals: &[Arrival<'_>]) -> SmallMatrices {
        for (place, arrival) in arrivals.iter().enumerate() {
            let slot = arrival.slot.0 as usize;
            assert!(!self.taken[slot] && self.workspace.place[slot] == ABSENT, "{slot} is taken");
            self.workspace.place[slot] = place as u8;
            self.extent = self.extent.max(slot + 1);
        }
        let (taken, stripes) = (&self.taken, self.stripes());
        self.workspace.set_members(arrivals.iter().map(|arrival| arrival.slot.0 as usize));
        self.workspace.list_named(stripes, |name| {
            let slots = arrivals.iter().flat_map(|arrival| arrival.row).map(|(slot, _)| slot.0 as usize);
            slots.filter(|&slot| taken[slot]).for_each(name);
        });
        let mut returned = SmallMatrices::zero(arrivals.len());
        for channel in 0..3 {
            self.fill_operand(channel, arrivals);
            if arrivals.len() <= GATHER_SINGLY_MAX {
                self.gather_singly(channel, arrivals);
            } else {
                self.gather_named(channel, true);
            }
            let columns = &mut self.workspace.columns[channel];
            for (place, arrival) in arrivals.iter().enumerate() {
                for (slot, exchange) in arrival.exchange().filter(|&(slot, _)| self.taken[slot]) {
                    columns[slot * BLOCK + place] += exchange;
                }
            }
            self.return_light(channel, arrivals, returned.plane_mut(channel));
        }
        returned
    }

    /// `operand = R A^-1 X'`, a row for each named slot.
    fn fill_operand(&mut self, channel: usize, arrivals: &[Arrival<'_>]) {
        let Workspace { operand, index, named, .. } = &mut self.workspace;
        operand[..named.len() * BLOCK].fill(0.0);
        for (place, arrival) in arrivals.iter().enumerate() {
            for (slot, exchange) in arrival.exchange().filter(|&(slot, _)| self.taken[slot]) {
                operand[index[slot] as usize * BLOCK + place] +=
                    self.reflectance[slot][channel] / self.areas[slot] * exchange;
            }
        }
    }

    /// `columns = G[:, named] operand`, a product for each patch.
    fn gather_singly(&mut self, channel: usize, arrivals: &[Arrival<'_>]) {
        let stripes = self.stripes();
        self.workspace.columns[channel][..stripes * STRIPE_COLUMNS].fill(0.0);
        for place in 0..arrivals.len() {
            let Workspace { vector, named, operand, .. } = &mut self.workspace;
            vector[..stripes * TILE_EDGE].fill(0.0);
            for (&slot, operand) in named.iter().zip(operand.chunks_exact(BLOCK)) {
                vector[slot as usize] = operand[place];
            }
            self.product(channel, None);
            let Workspace { columns, partial, .. } = &mut self.workspace;
            for (row, &sum) in
                columns[channel].chunks_exact_mut(BLOCK).zip(partial[..stripes * TILE_EDGE].iter())
            {
                row[place] = sum as f32;
            }
        }
    }

    /// `T = X_s + operand' W` of one channel, made exactly symmetric.
    fn return_light(&self, channel: usize, arrivals: &[Arrival<'_>], returned: &mut [f64]) {
        let block = arrivals.len();
        let Workspace { columns, operand, named, place, .. } = &self.workspace;
        let mut sums = [0.0; BLOCK * BLOCK];
        let (slots, columns, out) = (&named[..], &columns[channel][..], &mut sums[..]);
        f32::dispatch(self.instructions, BlockProduct { operand, slots, columns, out });
        for (returned, sums) in returned.chunks_exact_mut(block).zip(sums.chunks_exact(BLOCK)) {
            returned.copy_from_slice(&sums[..block]);
        }
        symmetrise(returned, block);
        for (new, arrival) in arrivals.iter().enumerate() {
            for (slot, exchange) in arrival.exchange() {
                let from = usize::from(place[slot]);
                if from <= new {
                    returned[new * block + from] += f64::from(exchange);
                    if from != new {
                        returned[from * block + new] += f64::from(exchange);
                    }
                }
            }
        }
    }

    /// Writes one channel of `G`.
    fn enter(&mut self, channel: usize, arrivals: &[Arrival<'_>], entering: &Entering) {
        let block = arrivals.len();
        self.set_finals(channel, entering.inverse.plane(channel), block);
        for (new, arrival) in arrivals.iter().enumerate() {
            let finals = &mut self.workspace.finals[arrival.slot.0 as usize * BLOCK..][..block];
            for (to, &from) in finals.iter_mut().zip(&entering.among.plane(channel)[new * block..]) {
                *to = from as f32;
            }
        }
        self.rank_update(channel, block, entering.factor.plane(channel), true);
    }

    /// `finals = columns small` of one channel.
    pub(super) fn set_finals(&mut self, channel: usize, small: &[f64], block: usize) {
        let len = self.stripes() * STRIPE_COLUMNS;
        let Workspace { columns, finals, .. } = &mut self.workspace;
        times_small(self.instructions, &columns[channel][..len], small, block, &mut finals[..len]);
    }

    /// Notes who came, and what they see.
    pub(super) fn register(&mut self, arrivals: &[Arrival<'_>], kept: u32) {
        for (place, arrival) in arrivals.iter().enumerate() {
            let new = arrival.slot.0 as usize;
            self.workspace.place[new] = ABSENT;
            if kept >> place & 1 == 1 {
                self.set_taken(new, true);
                self.reflectance[new] = arrival.reflectance;
                self.areas[new] = arrival.area;
                for &(slot, share) in arrival.row {
                    let slot = slot.0 as usize;
                    if self.taken[slot] {
                        self.rows.insert(new, slot, share);
                        if slot != new {
                            self.rows.insert(slot, new, arrival.area * share / self.areas[slot]);
                        }
                    }
                }
            }
        }
        self.shrink();
    }
}
