//! Worlds baked for one measurement, in a folder of the caller's.

use crate::progress_bars::BakeBars;
use crate::scene_source::SceneSource;
use earthshine_bake::{BakeError, BakeOptions, BakeSummary, Levels, RayDevice};
use earthshine_tiles::BakeParameters;
use std::path::Path;

/// Bakes `source` into `world`, under progress bars.
pub(super) fn bake(
    source: &SceneSource,
    parameters: BakeParameters,
    levels: Levels,
    world: &Path,
    quiet: bool,
) -> Result<BakeSummary, BakeError> {
    bake_on(None, source, parameters, levels, world, quiet)
}

/// As [`bake`], with rays traced on `device` if there is one.
pub(super) fn bake_on(
    device: Option<&dyn RayDevice>,
    source: &SceneSource,
    parameters: BakeParameters,
    levels: Levels,
    world: &Path,
    quiet: bool,
) -> Result<BakeSummary, BakeError> {
    let options = BakeOptions { levels, ..BakeOptions::new(&source.name, parameters, source.lights.clone()) };
    let bars = BakeBars::new(quiet);
    let summary = earthshine_bake::bake_on(device, &source.scene, world, &options, &bars)?;
    bars.finish();
    Ok(summary)
}
