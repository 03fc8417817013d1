//! What a bake did, in numbers: `earthshine bake --json` prints it.

use crate::progress::Stage;
use crate::reciprocity::Balance;
use earthshine_tiles::Manifest;
use std::collections::BTreeMap;

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
    /// Receivers: rows in empty air.
    pub receivers: u64,
    /// Form factors of receivers.
    pub receiver_nonzeros: u64,
    /// Rays of receivers that were traced in this run.
    pub receiver_rays: u64,
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
    /// Rays of rows a second and core, in millions, while rows were traced.
    pub mrays_s_core: f64,
    /// Rays of rows and of exposure over all seconds of the bake and all cores, in millions.
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
    /// How the rows were balanced.
    pub balance: Balance,
    /// Wall time by stage.
    pub seconds_by_stage: BTreeMap<&'static str, f64>,
    /// Wall time in all.
    pub seconds: f64,
}

impl BakeSummary {
    /// Books `seconds` to `stage`.
    pub(crate) fn spent(&mut self, stage: Stage, seconds: f64) {
        *self.seconds_by_stage.entry(stage.name()).or_default() += seconds;
    }
}
