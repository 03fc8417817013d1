//! What a bake was asked for: written into the manifest, part of every hash.

use crate::checksum;
use crate::method::BakeMethod;
use earthshine_world::{AxisWeights, Grid};
use serde::{Deserialize, Serialize};

/// The knobs of a bake that change its result. Thread counts and the like are not here.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BakeParameters {
    /// Of every random number. The same seed gives the same bytes.
    pub seed: u64,
    /// Rays of a patch's row. Noise falls with its root; time grows with it.
    pub rays_per_patch: u32,
    /// Sample points that a patch keeps for direct light.
    pub points_per_patch: u32,
    /// Sample points a voxel face's area of surface, from which patches are made.
    pub samples_per_voxel_face: u32,
    /// Rays by which a side is found to be inside of something.
    pub buried_rays: u32,
    /// How points spread over directions.
    pub weights: AxisWeights,
    /// Whether the backs of single-sided materials reflect too.
    pub two_sided: bool,
    /// Whether metals are black instead of diffuse.
    pub metals_black: bool,
    /// Empty voxels within this many voxels of a patch get receivers; 0 for none anywhere.
    pub receiver_reach_voxels: u32,
    /// Rays over the whole sphere that a voxel's receivers share.
    pub receiver_rays: u32,
    /// Most columns of a receiver's row; the rest of its share goes to a fair choice of them.
    pub receiver_columns: u32,
    /// Detail voxels along a voxel's edge, each with receivers on its surfaces: 1 (none), 2, 4 or 8.
    #[serde(default = "no_detail")]
    pub detail: u32,
    /// Rays of such a receiver.
    #[serde(default)]
    pub detail_rays: u32,
    /// Most columns of its row.
    #[serde(default)]
    pub detail_columns: u32,
    /// Voxels and chunks of level 0.
    pub grid: Grid,
    /// By which methods. Worlds from before there was a choice were made by the default ones.
    #[serde(default)]
    pub method: BakeMethod,
}

/// Worlds from before there was detail have none.
fn no_detail() -> u32 {
    1
}

impl Default for BakeParameters {
    fn default() -> Self {
        Self {
            seed: 1,
            rays_per_patch: 1024,
            points_per_patch: 16,
            samples_per_voxel_face: 16,
            buried_rays: 32,
            weights: AxisWeights::Squared,
            two_sided: true,
            metals_black: false,
            receiver_reach_voxels: 4,
            receiver_rays: 512,
            receiver_columns: 24,
            detail: 1,
            detail_rays: 512,
            detail_columns: 192,
            grid: Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 16 },
            method: BakeMethod::default(),
        }
    }
}

impl BakeParameters {
    /// The same with detail voxels for voxels: chunks are as large as they were, surfaces have about as many points.
    #[must_use]
    pub fn of_detail_voxels(&self) -> Self {
        let Grid { voxel_edge_m, chunk_edge_voxels } = self.grid;
        let grid = Grid {
            voxel_edge_m: voxel_edge_m / self.detail as f32,
            chunk_edge_voxels: chunk_edge_voxels * self.detail,
        };
        let samples_per_voxel_face = self.samples_per_voxel_face.div_ceil(self.detail * self.detail);
        Self { grid, samples_per_voxel_face, ..*self }
    }

    /// A hash of all of them, for a world's hash and the input hashes of chunks.
    #[must_use]
    pub fn content_hash(&self) -> u64 {
        // Taken apart without `..`: a new parameter that is not hashed does not compile.
        let Self {
            seed,
            rays_per_patch,
            points_per_patch,
            samples_per_voxel_face,
            buried_rays,
            weights,
            two_sided,
            metals_black,
            receiver_reach_voxels,
            receiver_rays,
            receiver_columns,
            detail,
            detail_rays,
            detail_columns,
            grid: Grid { voxel_edge_m, chunk_edge_voxels },
            method,
        } = *self;
        let counts = [
            rays_per_patch,
            points_per_patch,
            samples_per_voxel_face,
            buried_rays,
            receiver_reach_voxels,
            receiver_rays,
            receiver_columns,
            detail,
            detail_rays,
            detail_columns,
            chunk_edge_voxels,
        ];
        checksum::hash_parts(&[
            &seed.to_le_bytes(),
            bytemuck::cast_slice(&counts),
            &[weights as u8, u8::from(two_sided), u8::from(metals_black)],
            &voxel_edge_m.to_bits().to_le_bytes(),
            bytemuck::cast_slice(&method.words()),
        ])
    }

    /// What is impossible about them, if anything.
    pub(crate) fn fault(&self) -> Option<&'static str> {
        let grid = &self.grid;
        if !(grid.voxel_edge_m.is_finite() && grid.voxel_edge_m > 0.0) {
            Some("parameters.grid.voxel_edge_m is not a positive number")
        } else if !(1..=Grid::CHUNK_EDGE_VOXELS_MAX).contains(&grid.chunk_edge_voxels) {
            Some("parameters.grid.chunk_edge_voxels is not between 1 and 22")
        } else if self.seed > i64::MAX as u64 {
            Some("parameters.seed is above 2^63 - 1, the largest integer in TOML")
        } else if ![1, 2, 4, 8].contains(&self.detail) {
            Some("parameters.detail is not 1, 2, 4 or 8")
        } else if self.method.fault().is_some() {
            Some("parameters.method is none that a bake can have")
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parameter_changes_the_hash() {
        let base = BakeParameters::default();
        let finer = Grid { voxel_edge_m: 0.5, ..base.grid };
        let smaller = Grid { chunk_edge_voxels: 8, ..base.grid };
        let mut hashes: Vec<u64> = [
            base,
            BakeParameters { seed: 2, ..base },
            BakeParameters { rays_per_patch: 2, ..base },
            BakeParameters { points_per_patch: 2, ..base },
            BakeParameters { samples_per_voxel_face: 2, ..base },
            BakeParameters { buried_rays: 2, ..base },
            BakeParameters { weights: AxisWeights::Absolute, ..base },
            BakeParameters { two_sided: false, ..base },
            BakeParameters { metals_black: true, ..base },
            BakeParameters { receiver_reach_voxels: 2, ..base },
            BakeParameters { receiver_rays: 2, ..base },
            BakeParameters { receiver_columns: 2, ..base },
            BakeParameters { detail: 4, ..base },
            BakeParameters { detail_rays: 2, ..base },
            BakeParameters { detail_columns: 2, ..base },
            BakeParameters { grid: finer, ..base },
            BakeParameters { grid: smaller, ..base },
            BakeParameters { method: BakeMethod { rays_min: 8, ..base.method }, ..base },
        ]
        .iter()
        .map(BakeParameters::content_hash)
        .collect();
        hashes.sort_unstable();
        hashes.dedup();
        assert_eq!(hashes.len(), 18);
    }
}
