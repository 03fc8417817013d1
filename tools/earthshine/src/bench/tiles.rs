//! `bench tiles`: size and speed of a world's tiles.

use super::Report;
use clap::Args;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `bench tiles`.
#[derive(Args)]
pub(crate) struct TilesArguments {
    /// World folder.
    #[arg(long)]
    world: PathBuf,
    /// How long to decode and encode, s.
    #[arg(long, default_value_t = 3.0)]
    duration: f64,
}

/// Runs the suite.
pub(crate) fn run(arguments: &TilesArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let figures = earthshine_tiles::measure(&arguments.world, arguments.duration)?;
    let manifest = earthshine_tiles::Manifest::load(&arguments.world)?;
    let seconds = started.elapsed().as_secs_f64();
    Report::new("tiles", &manifest.scene, "none", manifest.parameters.seed, seconds, figures).print(json)
}
