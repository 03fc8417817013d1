//! `bench bake`: rays, bytes and seconds of a bake into a scratch folder.

use super::{Report, scratch};
use crate::bake::MeasuredBake;
use crate::generate::ShapeArguments;
use crate::quality::QualityArguments;
use crate::scene_source;
use anyhow::Context as _;
use clap::Args;
use earthshine_bake::Levels;
use std::time::Instant;

/// Arguments of `bench bake`.
#[derive(Args)]
pub(crate) struct BakeBenchArguments {
    /// A generated world or a .glb file.
    #[arg(long)]
    scene: String,
    #[command(flatten)]
    quality: QualityArguments,
    #[command(flatten)]
    shape: ShapeFlags,
}

/// The shape of a generated world, without a seed of its own: the bake's serves both.
#[derive(Args)]
struct ShapeFlags {
    /// Town: triangles wanted, instances counted.
    #[arg(long, value_parser = crate::generate::count)]
    triangles: Option<u64>,
    /// Town: edge of the square it covers, m.
    #[arg(long)]
    size: Option<f32>,
}

/// Runs the suite.
pub(crate) fn run(arguments: &BakeBenchArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let shape = ShapeArguments::of(arguments.shape.triangles, arguments.shape.size).options();
    let source =
        scene_source::load_generated(&arguments.scene, None, arguments.quality.metals_black(), &shape)?;
    let folder = tempfile::tempdir().context("a scratch folder for the world")?;
    let chosen = arguments.quality.chosen(&source);
    let summary = scratch::bake(&source, chosen.parameters, Levels::Auto, folder.path(), json)?;
    let figures = MeasuredBake::now(summary, chosen);
    let seconds = started.elapsed().as_secs_f64();
    Report::new("bake", &source.name, "none", arguments.quality.seed, seconds, figures).print(json)
}
