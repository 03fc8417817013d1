//! Which methods a bake works by, as flags; part of [`crate::quality`].

use clap::{Args, ValueEnum};
use earthshine_tiles::{BakeMethod, PatchBuilder, RaySpread, RowEstimator, SampleSource};

/// Which methods a bake works by.
#[derive(Args, Clone)]
pub(crate) struct MethodArguments {
    /// Where sample points come from: by area on triangles, or Hammersley points on voxel faces traced inwards.
    #[arg(long, default_value = "area")]
    samples: Samples,
    /// How samples become patches: by axis, or clusters with free normals (offline only: `serve` refuses them).
    #[arg(long, default_value = "axis")]
    builder: Builder,
    /// Most clusters a voxel, 1 to 16, for `--builder clustered`.
    #[arg(long, default_value_t = 6)]
    clusters: u32,
    /// Clusters nearer than this merge even below --clusters; 0 keeps as many as may be, as the sources do.
    #[arg(long, default_value_t = BakeMethod::default().cluster_distance)]
    cluster_distance: f32,
    /// How rows are found: cosine-weighted rays, or sums over pairs of points (quadratic: small scenes).
    #[arg(long, default_value = "rays")]
    estimator: Estimator,
    /// How a row's rays spread over the hemisphere.
    #[arg(long, default_value = "r2")]
    spread: Spread,
    /// Cast rays until a row's estimated error is below this share (0.02, say), instead of --rays for all; 0 turns it
    /// off.
    #[arg(long, default_value_t = 0.0)]
    row_error: f32,
    /// How many times the rays of other patches a patch that emits casts, as long as all emitters together cast no more
    /// than all patches do.
    #[arg(long, default_value_t = BakeMethod::default().emitter_factor)]
    emitter_factor: u32,
    /// Fewest rays of a row with --row-error.
    #[arg(long, default_value_t = BakeMethod::default().rays_min)]
    min_rays: u32,
    /// Most rays of a row with --row-error.
    #[arg(long, default_value_t = BakeMethod::default().rays_max)]
    max_rays: u32,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Samples {
    Area,
    Hammersley,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Builder {
    Axis,
    Clustered,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Estimator {
    Rays,
    Points,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Spread {
    R2,
    Sobol,
    Stratified,
    White,
}

impl MethodArguments {
    /// As the bake wants it.
    pub(crate) fn method(&self) -> BakeMethod {
        BakeMethod {
            samples: match self.samples {
                Samples::Area => SampleSource::Area,
                Samples::Hammersley => SampleSource::Hammersley,
            },
            builder: match self.builder {
                Builder::Axis => PatchBuilder::Axis,
                Builder::Clustered => PatchBuilder::Clustered,
            },
            clusters_per_voxel: self.clusters,
            cluster_distance: self.cluster_distance,
            estimator: match self.estimator {
                Estimator::Rays => RowEstimator::Rays,
                Estimator::Points => RowEstimator::Points,
            },
            spread: match self.spread {
                Spread::R2 => RaySpread::R2,
                Spread::Sobol => RaySpread::Sobol,
                Spread::Stratified => RaySpread::Stratified,
                Spread::White => RaySpread::White,
            },
            row_error: self.row_error,
            emitter_factor: self.emitter_factor,
            rays_min: self.min_rays,
            rays_max: self.max_rays,
        }
    }
}
