//! The one place that asks `earthshine-light` for direct light.
//!
//! It owns the shadow casters of all chunks in memory and says when they have changed; which slots are lit again,
//! and when, is [`crate::relight`]'s business.

use earthshine_light::{OccluderSet, Occluders, direct_irradiance};
use earthshine_world::random::{Purpose, hash};
use earthshine_world::{ChunkId, Light, OccluderMesh, Patch, Rgb, SamplePoint};
use std::sync::Arc;

/// How far shadow rays start off their surface at least, in voxel edges.
const RAY_EPSILON_VOXELS: f32 = 1e-3;

/// Shadow casters of every chunk of one level whose tile is in memory.
#[derive(Debug)]
pub(crate) struct ShadowCasters {
    set: OccluderSet,
    generation: u64,
    seed: u64,
    ray_epsilon_m: f32,
}

impl ShadowCasters {
    pub(crate) fn new(seed: u64, level: u8, voxel_edge_m: f32) -> Self {
        let voxels = OccluderMesh::displacement_voxels(level).max(RAY_EPSILON_VOXELS);
        Self { set: OccluderSet::new(), generation: 0, seed, ray_epsilon_m: voxels * voxel_edge_m }
    }

    /// Counts changes: light computed at an earlier generation is out of date.
    pub(crate) fn generation(&self) -> u64 {
        self.generation
    }

    /// Chunks that cast shadows.
    pub(crate) fn len(&self) -> usize {
        self.set.len()
    }

    /// A tile came. One without triangles changes no shadow and is left out.
    pub(crate) fn insert(&mut self, chunk: ChunkId, occluders: Arc<Occluders>) {
        if occluders.triangle_count() > 0 {
            self.set.insert(chunk, occluders);
            self.generation += 1;
        }
    }

    /// A tile went.
    pub(crate) fn remove(&mut self, chunk: ChunkId) {
        let before = self.set.len();
        self.set.remove(chunk);
        self.generation += u64::from(self.set.len() != before);
    }

    /// Irradiance on `patch` from delta lights, lx: the same bits for the same lights, casters and seed.
    pub(crate) fn irradiance(&self, lights: &[Light], patch: &Patch, points: &[SamplePoint]) -> Rgb {
        if lights.is_empty() {
            return Rgb::ZERO;
        }
        let rounding = 8.0 * f32::EPSILON * patch.centroid.abs().max_element();
        let epsilon_m = self.ray_epsilon_m.max(rounding);
        direct_irradiance(&self.set, lights, points, epsilon_m, self.patch_seed(patch))
    }

    /// The patch's own, wherever it is resident.
    fn patch_seed(&self, patch: &Patch) -> u64 {
        let [x, y, z] = patch.voxel.to_array().map(|c| u64::from(c.cast_unsigned()));
        hash(self.seed, Purpose::SunDisc, x << 32 | y, z << 32 | patch.direction.index() as u64)
    }
}
