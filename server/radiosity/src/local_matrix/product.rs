//! The light of a frame: `H x`, over what carries light, for what is of interest (the sources' `P_vis` x `P_lit`).
//!
//! A stored tile serves twice, so the product reads half of what a whole matrix would have it read: `6 M^2` bytes
//! for three channels. Stripes are cut into [`BANDS`] bands, each with sums of its own, added up in order: the same
//! bits at any number of threads.

use super::LocalMatrix;
use super::workspace::Workspace;
use crate::exchange::{TILE_EDGE, bands, stripe_at};
use crate::kernel::Scalar;
use crate::tile_kernel::BandProduct;
use rayon::prelude::*;

/// Bands that are summed apart.
pub(super) const BANDS: usize = 16;

/// Bit `slot % TILE_EDGE` of stripe `slot / TILE_EDGE`.
fn mark(bits: &mut [u64], slot: usize) {
    bits[slot / TILE_EDGE] |= 1 << (slot % TILE_EDGE);
}

impl LocalMatrix {
    /// `out = H x` of one channel. What is dark is not read; sums are `f32` over at most 512 columns or 64
    /// mirrored rows, `f64` beyond.
    ///
    /// # Panics
    /// If the channel is beyond 2, or `x` or `out` are shorter than the capacity.
    pub fn multiply(&mut self, channel: usize, x: &[f32], out: &mut [f32]) {
        self.multiply_rows(channel, x, None, out);
    }

    /// As [`Self::multiply`], for rows that are `wanted` alone (`None`: all); the others of `out` are left as they are.
    /// A row is read if it is wanted or carries light, so what is gained grows as both become few.
    ///
    /// # Panics
    /// As [`Self::multiply`], or if `wanted` is shorter than the capacity.
    pub fn multiply_rows(&mut self, channel: usize, x: &[f32], wanted: Option<&[bool]>, out: &mut [f32]) {
        let extent = self.extent;
        self.workspace.vector[..self.capacity].copy_from_slice(&x[..self.capacity]);
        self.product(channel, wanted);
        let is_wanted = |slot: usize| wanted.is_none_or(|wanted| wanted[slot]);
        for (slot, out) in out[..self.capacity].iter_mut().enumerate().filter(|&(slot, _)| is_wanted(slot)) {
            let flux = if slot < extent { self.workspace.partial[slot] } else { 0.0 };
            *out = if self.taken[slot] { (flux / f64::from(self.areas[slot])) as f32 } else { 0.0 };
        }
    }

    /// `G x` of one channel for `x` in `vector`, into the first numbers of `partial`.
    pub(super) fn product(&mut self, channel: usize, wanted: Option<&[bool]>) {
        let (stripes, set, rows) = (self.stripes(), self.instructions, self.areas.len());
        let Workspace { vector, lit, wanted: rows_wanted, partial, .. } = &mut self.workspace;
        lit.fill(0);
        rows_wanted.fill(0);
        for slot in 0..self.extent {
            if vector[slot] != 0.0 {
                mark(lit, slot);
            }
            if self.taken[slot] && wanted.is_none_or(|wanted| wanted[slot]) {
                mark(rows_wanted, slot);
            }
        }
        let plane = &self.planes[channel][..stripe_at(stripes)];
        let (x, lit, wanted) = (&vector[..], &lit[..], &rows_wanted[..]);
        let mut ranges = [const { 0..0 }; BANDS];
        ranges.iter_mut().zip(bands(stripes, BANDS)).for_each(|(range, band)| *range = band);
        partial.par_chunks_exact_mut(rows).zip(ranges.par_iter()).for_each(|(out, range)| {
            out[..stripes * TILE_EDGE].fill(0.0);
            let stripes = range.clone();
            f32::dispatch(set, BandProduct { plane, stripes, x, lit, wanted, out });
        });
        let (first, others) = partial.split_at_mut(rows);
        for (other, range) in others.chunks_exact(rows).zip(&ranges[1..]) {
            for (sum, part) in first.iter_mut().zip(&other[..range.end * TILE_EDGE]) {
                *sum += part;
            }
        }
    }
}
