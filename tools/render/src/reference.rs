//! Many paths: the light at a point as the service means it, with its standard error.
//!
//! All light that arrives from surfaces (reflected and emitted) and from the sky, without the first
//! arrival of lamps and sun. This is the oracle that baked worlds are measured against; it shares the
//! scene and the closed forms of lamps with them and nothing else.

use crate::path::{EmitterSampling, PathLight, PathTracer};
use crate::sampling::PathStream;
use crate::tracer::SceneTracer;
use earthshine_world::random::{Purpose, hash};
use earthshine_world::{LightRig, Rgb, Vec3};
use glam::DVec3;
use rayon::prelude::*;

/// Strata of the first direction along each of its two numbers.
const STRATA: u64 = 8;
/// Paths of one batch, one a stratum. Batches are independent of each other; paths within one are not.
pub const BATCH: u64 = STRATA * STRATA;
/// A standard error from fewer batches says little: with fewer no point is declared finished.
const BATCHES_MIN: u64 = 8;

/// How long to sample, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceOptions {
    /// Of the random numbers.
    pub seed: u64,
    /// Most paths a point; rounded up to whole batches of [`BATCH`], at least two.
    pub samples_max: u64,
    /// Stop when the standard error falls to this share of the mean (channels averaged); 0 never stops early.
    pub target_error_rel: f32,
    /// How emissive triangles are found.
    pub emitter_sampling: EmitterSampling,
}

impl Default for ReferenceOptions {
    fn default() -> Self {
        Self {
            seed: 1,
            samples_max: 1 << 16,
            target_error_rel: 0.01,
            emitter_sampling: EmitterSampling::Balanced,
        }
    }
}

/// Light at one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointEstimate {
    /// Mean over all paths, lx.
    pub irradiance: Rgb,
    /// Standard error of that mean, lx.
    pub standard_error: Rgb,
    /// Paths taken.
    pub samples: u64,
    /// Rays traced for them.
    pub rays: u64,
}

/// Mean and standard error of the irradiance at `position` facing `normal` (unit) from `samples` paths.
#[must_use]
pub fn irradiance_at(
    tracer: &SceneTracer<'_>,
    rig: &LightRig,
    position: Vec3,
    normal: Vec3,
    samples: u64,
    seed: u64,
) -> (Rgb, Rgb) {
    let options =
        ReferenceOptions { seed, samples_max: samples, target_error_rel: 0.0, ..ReferenceOptions::default() };
    let found = estimate(tracer, rig, position, normal, &options);
    (found.irradiance, found.standard_error)
}

/// Estimates the irradiance at every (position, unit normal) on all cores.
///
/// `finished` is called once a point, from any thread: for progress. The result depends on the seed and
/// the order of the points, not on the number of threads.
#[must_use]
pub fn irradiance_at_points(
    tracer: &SceneTracer<'_>,
    rig: &LightRig,
    points: &[(Vec3, Vec3)],
    options: &ReferenceOptions,
    finished: &(dyn Fn() + Sync),
) -> Vec<PointEstimate> {
    points
        .par_iter()
        .enumerate()
        .with_max_len(1)
        .map(|(index, &(position, normal))| {
            let seed = hash(options.seed, Purpose::ReferencePath, index as u64, 0);
            let found = estimate(tracer, rig, position, normal, &ReferenceOptions { seed, ..*options });
            finished();
            found
        })
        .collect()
}

/// Samples one point until it is good enough or `samples_max` is reached.
#[must_use]
pub fn estimate(
    tracer: &SceneTracer<'_>,
    rig: &LightRig,
    position: Vec3,
    normal: Vec3,
    options: &ReferenceOptions,
) -> PointEstimate {
    let paths = PathTracer { tracer, rig, emitter_sampling: options.emitter_sampling };
    let batches_max = options.samples_max.div_ceil(BATCH).max(2);
    let mut sums = BatchSums::default();
    let mut rays = 0;
    for batch in 0..batches_max {
        let (mean, cost) = batch_mean(&paths, position, normal, options.seed, batch);
        sums.add(mean);
        rays += cost;
        if batch + 1 >= BATCHES_MIN && sums.is_within(options.target_error_rel) {
            break;
        }
    }
    PointEstimate {
        irradiance: sums.mean().as_vec3(),
        standard_error: sums.standard_error().as_vec3(),
        samples: sums.count * BATCH,
        rays,
    }
}

fn batch_mean(paths: &PathTracer<'_>, position: Vec3, normal: Vec3, seed: u64, batch: u64) -> (DVec3, u64) {
    let mut sum = DVec3::ZERO;
    let mut rays = 0;
    for path in 0..BATCH {
        let mut stream = PathStream::new(seed, batch * BATCH + path);
        let jitter = stream.pair();
        let stratum = |index: u64, jitter: f32| (index as f32 + jitter) / STRATA as f32;
        let first = (stratum(path % STRATA, jitter.0), stratum(path / STRATA, jitter.1));
        let PathLight { irradiance, rays: cost } = paths.sample(position, normal, first, &mut stream);
        sum += irradiance.as_dvec3();
        rays += cost;
    }
    (sum / BATCH as f64, rays)
}

/// Running mean and spread of batch means (Welford's update: no cancellation).
#[derive(Debug, Default)]
struct BatchSums {
    count: u64,
    mean: DVec3,
    squares: DVec3,
}

impl BatchSums {
    fn add(&mut self, value: DVec3) {
        self.count += 1;
        let before = value - self.mean;
        self.mean += before / self.count as f64;
        self.squares += before * (value - self.mean);
    }

    fn mean(&self) -> DVec3 {
        self.mean
    }

    fn standard_error(&self) -> DVec3 {
        let count = self.count as f64;
        let variance = self.squares.max(DVec3::ZERO) / (count * (count - 1.0)).max(1.0);
        DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt())
    }

    fn is_within(&self, share: f32) -> bool {
        share > 0.0 && self.standard_error().element_sum() <= self.mean.element_sum() * f64::from(share)
    }
}
