//! What a bake did, in numbers: `earthshine bake --json` prints it.

use crate::progress::Stage;
use crate::reciprocity::Balance;
use crate::stale::StaleReport;
use earthshine_tiles::Manifest;
use std::collections::BTreeMap;
use std::time::Instant;

/// One level of a world.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct LevelSummary {
    /// 0 is the finest.
    pub level: u8,
    /// Edge of a voxel, m.
    pub voxel_edge_m: f32,
    /// Chunks with a tile.
    pub chunks: u64,
    /// Patches.
    pub patches: u64,
    /// Form factors stored.
    pub nonzeros: u64,
    /// All tiles of the level.
    pub bytes: u64,
}

impl LevelSummary {
    /// The levels of a world, finest first.
    #[must_use]
    pub fn of(manifest: &Manifest) -> Vec<Self> {
        let mut levels: BTreeMap<u8, Self> = BTreeMap::new();
        for chunk in &manifest.chunks {
            let level = levels.entry(chunk.level).or_default();
            level.level = chunk.level;
            level.voxel_edge_m = manifest.parameters.grid.at_level(chunk.level).voxel_edge_m;
            level.chunks += 1;
            level.patches += u64::from(chunk.patch_count);
            level.nonzeros += chunk.nonzero_count;
            level.bytes += chunk.tile_bytes;
        }
        levels.into_values().collect()
    }
}

/// What a bake did. Keys carry their unit last.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct BakeSummary {
    /// In the scene, instances counted.
    pub triangles: u64,
    /// Points on surfaces, both sides.
    pub samples: u64,
    /// Points dropped because they see mostly back faces.
    pub buried_samples: u64,
    /// Patches of level 0.
    pub patches: u64,
    /// Form factors of level 0.
    pub nonzeros: u64,
    /// Receivers, in empty air and on surfaces.
    pub receivers: u64,
    /// Of those, on surfaces: rows of detail voxels.
    pub detail_receivers: u64,
    /// Form factors of receivers.
    pub receiver_nonzeros: u64,
    /// Rays of receivers that were traced in this run.
    pub receiver_rays: u64,
    /// Rays of detail that were traced in this run, those of emitters towards them included.
    pub detail_rays: u64,
    /// Chunks of level 0 with a tile.
    pub chunks: u64,
    /// All levels, finest first.
    pub levels: Vec<LevelSummary>,
    /// Rays of rows that were traced in this run; resumed chunks need none.
    pub rays: u64,
    /// Chunks whose rows an interrupted run had left.
    pub resumed_chunks: u64,
    /// Whether the world was there already, whole.
    pub up_to_date: bool,
    /// Rays that told how exposed points are, in this run.
    pub exposure_rays: u64,
    /// Rays of exposure, rows, receivers and detail that a device traced.
    pub device_rays: u64,
    /// Those of them that were of no use, and cast on the CPU: they met a triangle that may have holes, or places that
    /// patches left out, or are of a point with such a ray.
    pub device_returned_rays: u64,
    /// Of all rays that are counted, those that a device traced to some use: the second look at hidden points is not among them.
    pub device_ray_share: f64,
    /// What was sent to the device with its questions, bytes; trees and tables aside.
    pub device_sent_bytes: u64,
    /// What was read back from the device, bytes.
    pub device_read_bytes: u64,
    /// What the device that rays were traced on failed of, if it did: the CPU traced the rest.
    pub device_failure: Option<String>,
    /// Rays of rows a second and core, in millions, while rows were traced.
    pub mrays_s_core: f64,
    /// Rays of all stages over all seconds of the bake and all cores, in millions.
    pub mrays_s_core_whole: f64,
    /// Patches a second, over the whole bake.
    pub patches_s: f64,
    /// All tiles of the world.
    pub world_bytes: u64,
    /// Whole tiles of level 0 (rows, points, occluders) over form factors; `bench tiles` has the rows alone.
    pub tile_bytes_per_nonzero: f64,
    /// World size over the ground it covers.
    pub bytes_per_km2: f64,
    /// Mean share that hits sides without patches or was lost in balancing.
    pub absorbed_share_mean: f64,
    /// Most points of one chunk.
    pub chunk_samples_max: u64,
    /// What rays go through, beside the scene.
    pub tree_bytes: u64,
    /// Memory that scene, patches and chunks at work were reckoned to take.
    pub memory_estimate_bytes: u64,
    /// What an edit made stale, and why.
    pub stale: StaleReport,
    /// How the rows were balanced.
    pub balance: Balance,
    /// Wall time by stage.
    pub seconds_by_stage: BTreeMap<&'static str, f64>,
    /// Wall time in all.
    pub seconds: f64,
    /// Over the ground it covers.
    pub seconds_per_km2: f64,
    /// Over the triangles of the scene.
    pub seconds_per_mtriangle: f64,
    /// World size over the triangles of the scene.
    pub bytes_per_mtriangle: f64,
}

impl BakeSummary {
    /// Counts what `manifest` says of the world, at the end of a bake that began at `started`.
    pub(crate) fn count(&mut self, manifest: &Manifest, started: Instant) {
        self.levels = LevelSummary::of(manifest);
        if let Some(finest) = self.levels.first().copied() {
            (self.patches, self.nonzeros) = (finest.patches, finest.nonzeros);
            self.chunks = finest.chunks;
            self.tile_bytes_per_nonzero = finest.bytes as f64 / finest.nonzeros.max(1) as f64;
        }
        self.world_bytes = self.levels.iter().map(|level| level.bytes).sum();
        self.receivers = manifest.chunks.iter().map(|c| u64::from(c.receiver_count)).sum();
        self.receiver_nonzeros = manifest.chunks.iter().map(|c| c.receiver_nonzero_count).sum();
        let size = manifest.bounds.size().as_dvec3();
        self.bytes_per_km2 = self.world_bytes as f64 / (size.x * size.z).max(1e-9) * 1e6;
        self.seconds = started.elapsed().as_secs_f64();
        let (km2, mtriangles) = ((size.x * size.z).max(1e-9) / 1e6, self.triangles.max(1) as f64 / 1e6);
        self.seconds_per_km2 = self.seconds / km2;
        (self.seconds_per_mtriangle, self.bytes_per_mtriangle) =
            (self.seconds / mtriangles, self.world_bytes as f64 / mtriangles);
        let core_seconds = self.seconds.max(1e-9) * rayon::current_num_threads() as f64;
        self.mrays_s_core_whole = self.all_rays() as f64 / core_seconds / 1e6;
        self.patches_s = self.patches as f64 / self.seconds.max(1e-9);
    }

    /// Rays of all stages.
    pub(crate) fn all_rays(&self) -> u64 {
        self.rays + self.exposure_rays + self.receiver_rays + self.detail_rays
    }

    /// Books `seconds` to `stage`.
    pub(crate) fn spent(&mut self, stage: Stage, seconds: f64) {
        *self.seconds_by_stage.entry(stage.name()).or_default() += seconds;
    }
}
