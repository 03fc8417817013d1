//! Rays until a row's error is met: batches, and the variance between them.
//!
//! Each batch goes over the whole patch, so that batches are estimates of the same row. The error of their mean is
//! the root of the summed variances of all shares, `sqrt(sum_j var(F_ij))`, sky lobes and absorbed share among them.
//! Few batches may agree by chance; so their variance is mixed with the one that independent rays would have, which a
//! row of shares `p` tells by itself: `(1 - sum p^2) / rays`. Batches that continue one even sequence repel each other,
//! so that both overstate the error; `bench estimators` prints what it is. Where it stops hangs on the patch's own rays alone: the same at any thread
//! count.

use crate::rows::{RawRow, RowCaster};

/// Rays between two looks at the error.
pub const BATCH_RAYS: u32 = 64;

/// As many batches the variance of independent rays counts for.
const INDEPENDENT_WEIGHT: f64 = 4.0;

/// Of the rays that the error so far lets expect, those that are surely needed.
const SURE_SHARE: f64 = 0.8;

/// When a row is good enough.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorTarget {
    /// Of the whole row, as a share.
    pub error: f32,
    /// Rays before the first look; at least two batches are cast.
    pub rays_min: u32,
    /// Rays after which it is given up.
    pub rays_max: u32,
}

/// Batches of one row added up.
#[derive(Debug, Clone, Default)]
pub struct BatchedRow {
    /// Sums over batches, not means.
    total: RawRow,
    batches: u32,
    /// Sum of the batches' squared lengths.
    squares: f64,
}

impl BatchedRow {
    /// Adds a batch as long as those before.
    pub fn add(&mut self, batch: &RawRow) {
        self.squares += length_squared(batch);
        self.batches += 1;
        self.total.rays += batch.rays;
        self.total.absorbed += batch.absorbed;
        self.total.sky.iter_mut().zip(batch.sky).for_each(|(sum, share)| *sum += share);
        self.total.entries.extend(&batch.entries);
        self.total.merge();
    }

    /// Estimated root-mean-square length of what the mean row is off by; infinite before the second batch.
    #[must_use]
    pub fn error(&self) -> f64 {
        if self.batches < 2 {
            return f64::INFINITY;
        }
        let count = f64::from(self.batches);
        let total = length_squared(&self.total);
        let between = (self.squares - total / count).max(0.0) / (count * (count - 1.0));
        let independent = (1.0 - total / (count * count)).max(0.0) / f64::from(self.total.rays.max(1));
        let known = count - 1.0;
        ((INDEPENDENT_WEIGHT * independent + known * between) / (INDEPENDENT_WEIGHT + known)).sqrt()
    }

    /// The mean of the batches.
    #[must_use]
    pub fn mean(mut self) -> RawRow {
        self.total.scale(1.0 / self.batches.max(1) as f32);
        self.total
    }
}

fn length_squared(row: &RawRow) -> f64 {
    let shares = row.entries.iter().map(|(_, share)| share).chain(&row.sky).chain([&row.absorbed]);
    shares.map(|&share| f64::from(share).powi(2)).sum()
}

/// A row that gets batches until its error is met.
#[derive(Debug, Clone)]
pub struct Refinement {
    target: ErrorTarget,
    row: BatchedRow,
    cast: u32,
}

impl Refinement {
    /// A row without rays.
    #[must_use]
    pub fn new(target: ErrorTarget) -> Self {
        Self { target, row: BatchedRow::default(), cast: 0 }
    }

    /// The next batches, as far as can be told that they will be needed; one at least.
    pub fn due(&self) -> impl Iterator<Item = std::ops::Range<u32>> + use<> {
        let least = f64::from(self.target.rays_min.max(2 * BATCH_RAYS));
        let ratio = self.row.error() / f64::from(self.target.error);
        let expected =
            if self.row.batches < 2 { least } else { f64::from(self.cast) * ratio * ratio * SURE_SHARE };
        let end = expected.max(least).min(f64::from(self.most())) as u32;
        let batches = (end.saturating_sub(self.cast) / BATCH_RAYS).max(1);
        let first = self.cast;
        (0..batches).map(move |batch| first + batch * BATCH_RAYS..first + (batch + 1) * BATCH_RAYS)
    }

    /// Adds the next batch; whether that is enough.
    pub fn add(&mut self, batch: &RawRow) -> bool {
        self.row.add(batch);
        self.cast += BATCH_RAYS;
        let met = self.row.batches >= 2
            && self.cast >= self.target.rays_min
            && self.row.error() <= f64::from(self.target.error);
        met || self.cast.saturating_add(BATCH_RAYS) > self.most()
    }

    fn most(&self) -> u32 {
        self.target.rays_max.max(2 * BATCH_RAYS)
    }

    /// The mean of the batches so far.
    #[must_use]
    pub fn mean(&self) -> RawRow {
        self.row.clone().mean()
    }
}

/// Adds batches from `next` until `target` is met or its most rays are spent.
pub fn refine(target: ErrorTarget, mut next: impl FnMut(std::ops::Range<u32>) -> RawRow) -> BatchedRow {
    let mut refinement = Refinement::new(target);
    while !refinement.add(&next(refinement.cast..refinement.cast + BATCH_RAYS)) {}
    refinement.row
}

/// The row of patch `index`, with as many rays as `target` asks for.
#[must_use]
pub fn refined_row(caster: &RowCaster<'_>, index: u32, target: ErrorTarget) -> RawRow {
    let spread = caster.spread(index, target.rays_max);
    refine(target, |run| caster.run(index, &spread, run)).mean()
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::random::{Purpose, hash, unit_f32};

    /// A batch of independent rays to `columns` patches alike.
    fn batch(columns: u32, key: u64, run: &std::ops::Range<u32>) -> RawRow {
        let draw =
            |ray: u32| (unit_f32(hash(9, Purpose::RowRay, key, u64::from(ray))) * columns as f32) as u32;
        let share = 1.0 / run.len() as f32;
        let mut row = RawRow { rays: run.len() as u32, ..RawRow::default() };
        row.entries = run.clone().map(|ray| (draw(ray), share)).collect();
        row.merge();
        row
    }

    fn true_error(row: &RawRow, columns: u32) -> f64 {
        let truth = 1.0 / f64::from(columns);
        let found: f64 = row.entries.iter().map(|(_, share)| (f64::from(*share) - truth).powi(2)).sum();
        (found + (columns as usize - row.entries.len()) as f64 * truth * truth).sqrt()
    }

    #[test]
    fn a_synthetic_row_meets_its_target_with_the_rays_that_it_takes() {
        // The variance of a row of n equal columns after R rays is (1 - 1/n) / R.
        let target = ErrorTarget { error: 0.02, rays_min: 128, rays_max: 1 << 14 };
        for columns in [2u32, 10, 50] {
            let (mut rays, mut squares) = (0.0, 0.0);
            for key in 0..40 {
                let row = refine(target, |run| batch(columns, key, &run));
                assert!(row.error() <= 0.02);
                let mean = row.mean();
                rays += f64::from(mean.rays) / 40.0;
                squares += true_error(&mean, columns).powi(2) / 40.0;
            }
            let expected = (1.0 - 1.0 / f64::from(columns)) / (0.02f64 * 0.02);
            assert!((0.6..1.3).contains(&(rays / expected)), "{columns}: {rays} rays, not {expected}");
            assert!(squares.sqrt() < 0.02 * 1.3, "{columns}: {}", squares.sqrt());
        }
    }

    #[test]
    fn bounds_hold_and_certain_rows_stop_at_the_least() {
        let target = ErrorTarget { error: 1e-6, rays_min: 64, rays_max: 1000 };
        assert_eq!(refine(target, |run| batch(50, 1, &run)).mean().rays, 960);
        let target = ErrorTarget { rays_min: 256, ..target };
        let certain = refine(target, |run| batch(1, 1, &run)).mean();
        assert_eq!((certain.rays, certain.entries), (256, vec![(0, 1.0)]));
    }
}
