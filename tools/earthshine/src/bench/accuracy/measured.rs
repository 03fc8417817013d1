//! A world with its light, baked for the occasion or read from a folder.

use super::solving::SolvingArguments;
use crate::bench::scratch;
use crate::scene_source::SceneSource;
use crate::whole_world::{WholeLight, WholeWorld};
use anyhow::Context as _;
use earthshine_bake::Levels;
use earthshine_tiles::BakeParameters;
use earthshine_volume::Volume;
use std::path::Path;
use std::time::Instant;

/// A solved world.
pub(in crate::bench) struct Measured {
    pub(in crate::bench) world: WholeWorld,
    pub(in crate::bench) light: WholeLight,
    pub(in crate::bench) volumes: Vec<Volume>,
    pub(in crate::bench) patches: u64,
    pub(in crate::bench) world_bytes: u64,
    /// Absent for a world that was there.
    pub(in crate::bench) bake_seconds: Option<f64>,
    pub(in crate::bench) solve_seconds: f64,
    pub(in crate::bench) absorbed_share_mean: f64,
}

impl Measured {
    fn solve(
        world: WholeWorld,
        source: &SceneSource,
        solver: &SolvingArguments,
        bake_seconds: Option<f64>,
    ) -> anyhow::Result<Self> {
        let solving = Instant::now();
        let light = solver.solve(&world, &source.lights)?;
        let volumes = world.volumes(&light)?;
        let solve_seconds = solving.elapsed().as_secs_f64();
        let chunks = &world.manifest.chunks;
        let patches = world.patches().count() as u64;
        let world_bytes = chunks.iter().map(|chunk| chunk.tile_bytes).sum();
        let absorbed: f64 = world
            .chunks()
            .iter()
            .flat_map(|chunk| &chunk.rows.absorbed_shares)
            .map(|&share| f64::from(share))
            .sum();
        let absorbed_share_mean = absorbed / patches.max(1) as f64;
        Ok(Self {
            world,
            light,
            volumes,
            patches,
            world_bytes,
            bake_seconds,
            solve_seconds,
            absorbed_share_mean,
        })
    }
}

/// Bakes into a scratch folder, loads and gathers bounce by bounce.
pub(in crate::bench) fn baked(
    source: &SceneSource,
    parameters: BakeParameters,
    quiet: bool,
) -> anyhow::Result<Measured> {
    baked_for(&SolvingArguments::default(), source, parameters, quiet)
}

/// Bakes into a scratch folder, loads, and solves by `solver`.
pub(super) fn baked_for(
    solver: &SolvingArguments,
    source: &SceneSource,
    parameters: BakeParameters,
    quiet: bool,
) -> anyhow::Result<Measured> {
    let folder = tempfile::tempdir().context("a scratch folder for the world")?;
    let summary = scratch::bake(source, parameters, Levels::Exactly(1), folder.path(), quiet)?;
    Measured::solve(WholeWorld::load(folder.path())?, source, solver, Some(summary.seconds))
}

/// Loads a world that was baked from `source` (which is for the caller to see to), and solves it under the source's lights.
pub(super) fn loaded(
    solver: &SolvingArguments,
    source: &SceneSource,
    folder: &Path,
) -> anyhow::Result<Measured> {
    Measured::solve(WholeWorld::load(folder)?, source, solver, None)
}
