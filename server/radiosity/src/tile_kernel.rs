//! The inner loops over tiles of the exchange matrix: change it, gather columns of it, multiply by it.
//!
//! Only the lower triangle is stored (`exchange.rs` has the layout), so a tile stands for two places: itself, and
//! its mirror image above the diagonal. Every element of a result is summed in an order that depends on the operands
//! alone, so however rayon cuts the work, the bits are the same.
//!
//! | kernel | computes | used for |
//! |---|---|---|
//! | [`StripeUpdate`] | `G[stripe, ..] += left right` | patches that enter or leave |
//! | [`StripeGather`] | `G[stripe, list] X`, both sides of the diagonal | light on its way to patches that enter |
//! | [`BandProduct`] | `y += G x` of a few stripes and their mirror images | the light of a frame |
//! | [`BlockProduct`] | `X' W`, a block's columns with each other | light that returns to patches that enter |
//! | [`SparseRow`] | `F X` of one row | the residual of a repair |

use crate::exchange::{BLOCK, TILE_EDGE, TILE_LEN, tile_at};
use crate::kernel::{Kernel, Scalar, accumulate};
use crate::simd::Lanes;
use std::ops::Range;

/// Numbers between what is updated and what is fetched from memory meanwhile: two groups of rows. Measured: more
/// pushes the operands out of the nearest cache.
const UPDATE_AHEAD: usize = 512;

/// The same for products, which read only.
const PRODUCT_AHEAD: usize = 1024;

/// Tiles whose products with a row stay in `f32` lanes before they go to the `f64` sum.
const LANE_TILES: usize = 8;

/// Vectors of a row of a tile that [`BandProduct`] holds at a time.
const PRODUCT_VECTORS: usize = 4;

/// Groups of rows in a tile, at most: no instruction set works on fewer than four rows.
const GROUPS_MAX: usize = TILE_EDGE / 4;

/// Numbers in one cache line.
const LINE: usize = 16;

/// Adds `left * right` to the tiles of one stripe, hands each to `finish` while it is in the nearest cache.
pub(crate) struct StripeUpdate<'a, F> {
    /// Tiles of the stripe, the diagonal one last.
    pub(crate) tiles: &'a mut [f32],
    /// [`TILE_EDGE`] rows of [`BLOCK`] numbers.
    pub(crate) left: &'a [f32],
    /// For each tile, `depth` rows of [`TILE_EDGE`] numbers.
    pub(crate) right: &'a [f32],
    /// Columns of `left` that count.
    pub(crate) depth: usize,
    /// Gets the tile's place in the stripe, and the tile.
    pub(crate) finish: F,
}

impl<F: FnMut(usize, &mut [f32])> StripeUpdate<'_, F> {
    #[inline(always)]
    fn tiles<S: Lanes<f32>, const R: usize, const N: usize>(mut self, simd: S) {
        let depth = self.depth;
        let mut packed = [[[0.0f32; R]; BLOCK]; GROUPS_MAX];
        for (left, packed) in self.left.chunks_exact(R * BLOCK).zip(&mut packed) {
            for (k, packed) in packed.iter_mut().enumerate() {
                *packed = std::array::from_fn(|r| left[r * BLOCK + k]);
            }
        }
        let rights = self.right.chunks_exact(depth * TILE_EDGE);
        for (place, (tile, right)) in self.tiles.chunks_exact_mut(TILE_LEN).zip(rights).enumerate() {
            for (rows, packed) in tile.chunks_exact_mut(R * TILE_EDGE).zip(&packed) {
                for part in (0..TILE_EDGE).step_by(N * S::WIDTH) {
                    // Loops, not `array::from_fn`: its closures are not always inlined, and then their vectors go
                    // through memory.
                    let mut sum = [[simd.splat(0.0); N]; R];
                    for (r, sum) in sum.iter_mut().enumerate() {
                        for (n, sum) in sum.iter_mut().enumerate() {
                            let at = r * TILE_EDGE + part + n * S::WIDTH;
                            simd.prefetch(rows, at + UPDATE_AHEAD);
                            *sum = simd.load(&rows[at..]);
                        }
                    }
                    let steps = packed.iter().copied();
                    let steps = steps.zip(right.chunks_exact(TILE_EDGE).map(|row| &row[part..]));
                    accumulate(simd, steps, &mut sum);
                    for (r, sum) in sum.iter().enumerate() {
                        for (n, &sum) in sum.iter().enumerate() {
                            simd.store(sum, &mut rows[r * TILE_EDGE + part + n * S::WIDTH..]);
                        }
                    }
                }
            }
            (self.finish)(place, tile);
        }
    }
}

impl<F: FnMut(usize, &mut [f32])> Kernel<f32> for StripeUpdate<'_, F> {
    #[inline(always)]
    fn run<S: Lanes<f32>, const R: usize, const N: usize>(self, simd: S) {
        if S::WIDTH == 16 {
            // Whole rows of a tile: one stream through memory.
            self.tiles::<S, 4, 4>(simd);
        } else {
            self.tiles::<S, R, N>(simd);
        }
    }
}

/// Columns of `G` that a product with a block takes, stripe by stripe.
#[derive(Clone, Copy)]
pub(crate) struct NamedColumns<'a> {
    /// Their slots, ascending.
    pub(crate) slots: &'a [u32],
    /// Where each stripe's begin, and the end.
    pub(crate) starts: &'a [u32],
    /// [`BLOCK`] numbers a column.
    pub(crate) operand: &'a [f32],
}

impl NamedColumns<'_> {
    fn of(&self, stripe: usize) -> Range<usize> {
        self.starts[stripe] as usize..self.starts[stripe + 1] as usize
    }
}

/// `out = G[stripe, named] X`.
pub(crate) struct StripeGather<'a> {
    /// The lower triangle.
    pub(crate) plane: &'a [f32],
    /// Rows that are wanted.
    pub(crate) stripe: usize,
    /// `X`.
    pub(crate) named: NamedColumns<'a>,
    /// [`TILE_EDGE`] rows of [`BLOCK`]; overwritten.
    pub(crate) out: &'a mut [f32],
}

impl Kernel<f32> for StripeGather<'_> {
    #[inline(always)]
    fn run<S: Lanes<f32>, const R: usize, const N: usize>(self, simd: S) {
        self.out.fill(0.0);
        // The tile whose columns, or, above the diagonal, rows are those of `other`.
        let tile_of = |other: usize| {
            let (row, column) = (self.stripe.max(other), self.stripe.min(other));
            &self.plane[tile_at(row, column)..][..TILE_LEN]
        };
        let stripes = self.named.starts.len() - 1;
        let mut others = (0..stripes).filter(|&other| !self.named.of(other).is_empty()).peekable();
        while let Some(other) = others.next() {
            let tile = tile_of(other);
            let next = others.peek().map_or(tile, |&next| tile_of(next));
            let named = self.named.of(other);
            let operand = &self.named.operand[named.start * BLOCK..named.end * BLOCK];
            let slots = &self.named.slots[named];
            // Each group of rows fetches as many of the next tile, spread over its steps.
            let pace = u32::from(slots.len() > TILE_EDGE / 2);
            let is_mirrored = other > self.stripe;
            let rows = tile.as_chunks::<TILE_EDGE>().0;
            let mut out = &mut *self.out;
            for group in (0..TILE_EDGE).step_by(R) {
                let (these, rest) = std::mem::take(&mut out).split_at_mut(R * BLOCK);
                out = rest;
                for part in (0..BLOCK).step_by(N * S::WIDTH) {
                    let mut sum = [[simd.splat(0.0); N]; R];
                    let steps = slots.iter().zip(operand.chunks_exact(BLOCK)).enumerate();
                    let steps = steps.map(|(k, (&slot, operand))| {
                        simd.prefetch(next, group * TILE_EDGE + (k >> pace) * LINE);
                        (slot as usize % TILE_EDGE, &operand[part..])
                    });
                    if is_mirrored {
                        let steps = steps.map(|(column, operand)| {
                            let row = &rows[column][group..group + R];
                            (std::array::from_fn(|r| row[r]), operand)
                        });
                        accumulate(simd, steps, &mut sum);
                    } else {
                        let rows: &[[f32; TILE_EDGE]; R] =
                            rows[group..].first_chunk().expect("whole groups of rows");
                        let steps = steps
                            .map(|(column, operand)| (std::array::from_fn(|r| rows[r][column]), operand));
                        accumulate(simd, steps, &mut sum);
                    }
                    for (out, sum) in these.chunks_exact_mut(BLOCK).zip(&sum) {
                        for (n, &sum) in sum.iter().enumerate() {
                            let out = &mut out[part + n * S::WIDTH..];
                            simd.store(simd.add(simd.load(out), sum), out);
                        }
                    }
                }
            }
        }
    }
}

/// `out += G x` of the stripes of a band and their mirror images; what is dark or of no interest is not read.
///
/// A row of a tile is read if it carries light that its columns want, or wants light that its columns carry:
/// exact by rows, by stripes in the other direction.
pub(crate) struct BandProduct<'a> {
    /// The lower triangle.
    pub(crate) plane: &'a [f32],
    /// Stripes of the band.
    pub(crate) stripes: Range<usize>,
    /// `x`, whole stripes.
    pub(crate) x: &'a [f32],
    /// For each stripe, which of its slots carry light.
    pub(crate) lit: &'a [u64],
    /// For each stripe, which of its rows are wanted.
    pub(crate) wanted: &'a [u64],
    /// Added to, whole stripes; rows that are not wanted are left with something.
    pub(crate) out: &'a mut [f64],
}

impl Kernel<f32> for BandProduct<'_> {
    #[inline(always)]
    fn run<S: Lanes<f32>, const R: usize, const N: usize>(self, simd: S) {
        let mut lanes = [0.0f32; TILE_EDGE];
        for stripe in self.stripes {
            let x_rows = &self.x[stripe * TILE_EDGE..][..TILE_EDGE];
            let mut row_sums = [simd.splat(0.0); TILE_EDGE];
            for column in 0..=stripe {
                let (is_lit, is_wanted) = (self.lit[column] != 0, self.wanted[column] != 0);
                let forth = if is_lit { self.wanted[stripe] } else { 0 };
                let back = if is_wanted && column < stripe { self.lit[stripe] } else { 0 };
                let tile = &self.plane[tile_at(stripe, column)..][..TILE_LEN];
                let x_columns = &self.x[column * TILE_EDGE..][..TILE_EDGE];
                for part in (0..TILE_EDGE).step_by(PRODUCT_VECTORS * S::WIDTH) {
                    let mut x = [simd.splat(0.0); PRODUCT_VECTORS];
                    for (n, x) in x.iter_mut().enumerate() {
                        *x = simd.load(&x_columns[part + n * S::WIDTH..]);
                    }
                    let mut sums = [simd.splat(0.0); PRODUCT_VECTORS];
                    let mut rows = forth | back;
                    while rows != 0 {
                        let row = rows.trailing_zeros() as usize;
                        rows &= rows - 1;
                        let entries = &tile[row * TILE_EDGE..][..TILE_EDGE];
                        let sent = simd.splat(x_rows[row]);
                        let entries = &entries[part..][..PRODUCT_VECTORS * S::WIDTH];
                        let mut row_sum = row_sums[row];
                        // By index: arrays zipped with each other end up in memory.
                        for n in 0..PRODUCT_VECTORS {
                            simd.prefetch(entries, n * S::WIDTH + PRODUCT_AHEAD);
                            let entries = simd.load(&entries[n * S::WIDTH..]);
                            row_sum = simd.multiply_add(entries, x[n], row_sum);
                            sums[n] = simd.multiply_add(entries, sent, sums[n]);
                        }
                        row_sums[row] = row_sum;
                    }
                    if back != 0 {
                        for (n, &sum) in sums.iter().enumerate() {
                            simd.store(sum, &mut lanes[n * S::WIDTH..]);
                        }
                        let out = &mut self.out[column * TILE_EDGE + part..];
                        for (out, &lane) in out.iter_mut().zip(&lanes[..PRODUCT_VECTORS * S::WIDTH]) {
                            *out += f64::from(lane);
                        }
                    }
                }
                if column == stripe || column % LANE_TILES == LANE_TILES - 1 {
                    let out = &mut self.out[stripe * TILE_EDGE..][..TILE_EDGE];
                    for (out, sum) in out.iter_mut().zip(&mut row_sums) {
                        simd.store(*sum, &mut lanes);
                        *out += lanes[..S::WIDTH].iter().map(|&lane| f64::from(lane)).sum::<f64>();
                        *sum = simd.splat(0.0);
                    }
                }
            }
        }
    }
}

/// `out += X' W` over some rows of both, `BLOCK` x `BLOCK`.
pub(crate) struct BlockProduct<'a> {
    /// `X`, [`BLOCK`] numbers for each of `slots`.
    pub(crate) operand: &'a [f32],
    /// Rows of `W` to take.
    pub(crate) slots: &'a [u32],
    /// `W`, [`BLOCK`] numbers a row.
    pub(crate) columns: &'a [f32],
    /// Added to, row-major.
    pub(crate) out: &'a mut [f64],
}

/// Rows whose products stay in `f32` before they go to the `f64` sum.
const SEGMENT: usize = 64;

impl Kernel<f32> for BlockProduct<'_> {
    #[inline(always)]
    fn run<S: Lanes<f32>, const R: usize, const N: usize>(self, simd: S) {
        let mut lanes = [0.0f32; TILE_EDGE];
        for (slots, operand) in self.slots.chunks(SEGMENT).zip(self.operand.chunks(SEGMENT * BLOCK)) {
            for (group, out) in self.out.chunks_exact_mut(R * BLOCK).enumerate() {
                for part in (0..BLOCK).step_by(N * S::WIDTH) {
                    let mut sum = [[simd.splat(0.0); N]; R];
                    let steps = slots.iter().zip(operand.chunks_exact(BLOCK)).map(|(&slot, operand)| {
                        let operand = &operand[group * R..][..R];
                        (std::array::from_fn(|r| operand[r]), &self.columns[slot as usize * BLOCK + part..])
                    });
                    accumulate(simd, steps, &mut sum);
                    for (out, &sum) in out.chunks_exact_mut(BLOCK).zip(&sum) {
                        for (n, sum) in sum.into_iter().enumerate() {
                            simd.store(sum, &mut lanes);
                            let out = &mut out[part + n * S::WIDTH..];
                            out.iter_mut()
                                .zip(&lanes[..S::WIDTH])
                                .for_each(|(to, &lane)| *to += f64::from(lane));
                        }
                    }
                }
            }
        }
    }
}

/// `out = sum_k coefficient_k rows[slot_k]`, rows of [`BLOCK`] numbers.
pub(crate) struct SparseRow<'a, I> {
    /// Slot and coefficient.
    pub(crate) entries: I,
    /// [`BLOCK`] numbers a slot.
    pub(crate) rows: &'a [f32],
    /// [`BLOCK`] numbers; overwritten.
    pub(crate) out: &'a mut [f32],
}

impl<I: Iterator<Item = (usize, f32)> + Clone> Kernel<f32> for SparseRow<'_, I> {
    #[inline(always)]
    fn run<S: Lanes<f32>, const R: usize, const N: usize>(self, simd: S) {
        for part in (0..BLOCK).step_by(N * S::WIDTH) {
            let mut sum = [[simd.splat(0.0); N]; 1];
            let rows = self.rows;
            let steps = self.entries.clone();
            let steps = steps.map(|(slot, coefficient)| ([coefficient], &rows[slot * BLOCK + part..]));
            accumulate(simd, steps, &mut sum);
            for (n, &sum) in sum[0].iter().enumerate() {
                simd.store(sum, &mut self.out[part + n * S::WIDTH..]);
            }
        }
    }
}

/// Multiplies and adds as fast as the processor can: what the other kernels are measured against.
pub(crate) struct PeakRate<'a> {
    /// Rounds, each one multiply-add on every one of [`PEAK_SUMS`] vectors.
    pub(crate) steps: u32,
    /// Something that depends on all of it.
    pub(crate) out: &'a mut f32,
    /// Set to what was done: floating-point operations.
    pub(crate) flops: &'a mut u64,
}

/// Sums that [`PeakRate`] keeps going: enough to hide a multiply-add's latency on any known core.
const PEAK_SUMS: usize = 12;

impl Kernel<f32> for PeakRate<'_> {
    #[inline(always)]
    fn run<S: Lanes<f32>, const R: usize, const N: usize>(self, simd: S) {
        let factor = simd.splat(std::hint::black_box(0.5));
        let term = simd.splat(std::hint::black_box(0.25));
        let mut sums = [simd.splat(0.0); PEAK_SUMS];
        for _ in 0..self.steps {
            for sum in &mut sums {
                *sum = simd.multiply_add(*sum, factor, term);
            }
        }
        let mut lanes = [0.0; TILE_EDGE];
        for &sum in &sums {
            simd.store(sum, &mut lanes);
            *self.out += lanes[..S::WIDTH].iter().sum::<f32>();
        }
        *self.flops = u64::from(self.steps) * 2 * (PEAK_SUMS * S::WIDTH) as u64;
    }
}

const _: () = assert!(BLOCK == <f32 as Scalar>::TILE && TILE_EDGE == 2 * BLOCK);

#[cfg(test)]
mod tests;
