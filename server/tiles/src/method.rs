//! By which of its methods a bake works: where samples come from, how they become patches, how rows are found.
//!
//! Names and numbers alone; the methods themselves are the bake's. All of them are part of every hash.

use serde::{Deserialize, Serialize};

/// Where sample points come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SampleSource {
    /// Uniform by area on every piece that a voxel cuts from a triangle: areas are exact.
    #[default]
    Area,
    /// The sources' way: Hammersley points on the faces of voxels, traced inwards. Areas are estimates.
    Hammersley,
}

/// How samples become patches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PatchBuilder {
    /// One patch a voxel and direction.
    #[default]
    Axis,
    /// The sources' first variant: patches with free normals, merged greedily. For the offline solve alone: several
    /// of them may share a voxel and a direction.
    Clustered,
}

/// How rows are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RowEstimator {
    /// Cosine-weighted rays from each patch: linear in patches, sums of one.
    #[default]
    Rays,
    /// The sources' sum over pairs of points, with a visibility ray each: quadratic, for small scenes.
    Points,
}

/// How the rays of a row spread over the hemisphere.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RaySpread {
    /// The R2 sequence, shifted at random.
    #[default]
    R2,
    /// The first two dimensions of Sobol's sequence, scrambled after Owen.
    Sobol,
    /// One ray a cell of a grid, at random within it.
    Stratified,
    /// Independent random numbers, to compare with.
    White,
}

/// By which methods a bake works.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BakeMethod {
    /// Where sample points come from.
    pub samples: SampleSource,
    /// How they become patches.
    pub builder: PatchBuilder,
    /// Most clusters a voxel; axis-aligned patches know no such number.
    pub clusters_per_voxel: u32,
    /// Clusters nearer than this in the sources' metric merge even below that number; 0 is the sources' rule.
    pub cluster_distance: f32,
    /// How rows are found.
    pub estimator: RowEstimator,
    /// How rays spread.
    pub spread: RaySpread,
    /// Estimated error at which a row gets no more rays: the root of the summed variances of its shares. 0 gives every
    /// row the same rays.
    pub row_error: f32,
    /// How many times the rays of other patches a patch that emits casts, at most: all emitters together get no more
    /// rays than all patches do.
    pub emitter_factor: u32,
    /// Fewest rays of a row whose error is a target.
    pub rays_min: u32,
    /// Most rays of such a row.
    pub rays_max: u32,
}

impl Default for BakeMethod {
    fn default() -> Self {
        Self {
            samples: SampleSource::Area,
            builder: PatchBuilder::Axis,
            clusters_per_voxel: 6,
            cluster_distance: 1.8,
            estimator: RowEstimator::Rays,
            spread: RaySpread::R2,
            row_error: 0.0,
            emitter_factor: 256,
            rays_min: 256,
            rays_max: 8192,
        }
    }
}

impl BakeMethod {
    /// Most clusters a voxel may have.
    pub const CLUSTERS_MAX: u32 = 16;
    /// Most times the rays of others that an emitter may cast.
    pub const EMITTER_FACTOR_MAX: u32 = 256;
    /// Most rays a row may have.
    pub const RAYS_MAX: u32 = 1 << 20;

    /// Everything, as words for a hash.
    pub(crate) fn words(&self) -> [u32; 10] {
        // Taken apart without `..`: a new parameter that is not hashed does not compile.
        let Self {
            samples,
            builder,
            clusters_per_voxel,
            cluster_distance,
            estimator,
            spread,
            row_error,
            emitter_factor,
            rays_min,
            rays_max,
        } = *self;
        [
            samples as u32,
            builder as u32,
            clusters_per_voxel,
            cluster_distance.to_bits(),
            estimator as u32,
            spread as u32,
            row_error.to_bits(),
            emitter_factor,
            rays_min,
            rays_max,
        ]
    }

    /// What is impossible about it, if anything: the parameter, what it is and what it may be.
    #[must_use]
    pub fn fault(&self) -> Option<(&'static str, String, &'static str)> {
        let of = |name, value: &dyn std::fmt::Display, cause| Some((name, value.to_string(), cause));
        if !(1..=Self::CLUSTERS_MAX).contains(&self.clusters_per_voxel) {
            of("clusters a voxel", &self.clusters_per_voxel, "must be 1 to 16")
        } else if !(self.cluster_distance.is_finite() && self.cluster_distance >= 0.0) {
            of("cluster distance", &self.cluster_distance, "must be 0 or a positive number")
        } else if !(self.row_error.is_finite() && (0.0..1.0).contains(&self.row_error)) {
            of("row error", &self.row_error, "must be 0 (all rows get the same rays) or a share below 1")
        } else if !(1..=Self::EMITTER_FACTOR_MAX).contains(&self.emitter_factor) {
            of("emitter factor", &self.emitter_factor, "must be 1 to 256")
        } else if !(1..=Self::RAYS_MAX).contains(&self.rays_min)
            || !(self.rays_min..=Self::RAYS_MAX).contains(&self.rays_max)
        {
            let both = format!("{} and {}", self.rays_min, self.rays_max);
            of("least and most rays", &both, "must be 1 to 1,048,576, the least first")
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_choice_changes_the_words() {
        let base = BakeMethod::default();
        let mut words: Vec<_> = [
            base,
            BakeMethod { samples: SampleSource::Hammersley, ..base },
            BakeMethod { builder: PatchBuilder::Clustered, ..base },
            BakeMethod { clusters_per_voxel: 3, ..base },
            BakeMethod { cluster_distance: 0.0, ..base },
            BakeMethod { estimator: RowEstimator::Points, ..base },
            BakeMethod { spread: RaySpread::White, ..base },
            BakeMethod { row_error: 0.01, ..base },
            BakeMethod { emitter_factor: 3, ..base },
            BakeMethod { rays_min: 8, ..base },
            BakeMethod { rays_max: 800, ..base },
        ]
        .iter()
        .map(BakeMethod::words)
        .collect();
        words.sort_unstable();
        words.dedup();
        assert_eq!(words.len(), 11);
    }

    #[test]
    fn impossible_choices_are_named() {
        let base = BakeMethod::default();
        assert_eq!(base.fault(), None);
        let name = |method: BakeMethod| method.fault().map(|(name, ..)| name);
        assert_eq!(name(BakeMethod { clusters_per_voxel: 17, ..base }), Some("clusters a voxel"));
        assert_eq!(name(BakeMethod { row_error: f32::NAN, ..base }), Some("row error"));
        assert_eq!(name(BakeMethod { rays_min: 9000, ..base }), Some("least and most rays"));
    }
}
