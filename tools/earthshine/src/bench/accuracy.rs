//! `bench accuracy`: bake, solve, look up light at points, compare with a path tracer or with other renderers.

use super::Report;
use crate::progress_bars::{BakeBars, counted};
use crate::quality::QualityArguments;
use crate::scene_source::{self, SceneSource};
use crate::volume_light;
use crate::whole_world::WholeWorld;
use anyhow::Context as _;
use clap::Args;
use earthshine_bake::{BakeOptions, BakeSummary};
use earthshine_gen::GenOptions;
use earthshine_render::compare_points::{LightErrors, compare_points};
use earthshine_render::csv::{self, ReferencePoint};
use earthshine_render::{ReferenceOptions, SceneTracer, irradiance_at_points};
use earthshine_tiles::RowCodec;
use earthshine_world::Rgb;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `bench accuracy`.
#[derive(Args)]
pub(crate) struct AccuracyArguments {
    /// furnace, another generated world, or a .glb file.
    #[arg(long)]
    scene: String,
    /// Lights JSON.
    #[arg(long)]
    lights: Option<PathBuf>,
    /// CSV of points where light is compared; the light in it is ignored. Default: those of --reference, or random ones.
    #[arg(long)]
    points: Option<PathBuf>,
    /// CSV of reference light; without it our own path tracer makes one.
    #[arg(long)]
    reference: Option<PathBuf>,
    /// Random points, where no file names any.
    #[arg(long, default_value_t = 600)]
    point_count: usize,
    /// Noise at which our own reference stops, as a share of the light.
    #[arg(long, default_value_t = 0.01)]
    noise: f32,
    /// Writes the light at each point beside its reference as CSV.
    #[arg(long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    quality: QualityArguments,
}

/// Reflectances of the two furnaces.
const FURNACES: [f32; 2] = [0.5, 0.8];

#[derive(Serialize)]
struct Figures {
    patches: u64,
    #[serde(flatten)]
    errors: LightErrors,
    bake_seconds: f64,
    solve_seconds: f64,
    reference_seconds: f64,
    world_bytes: u64,
    absorbed_share_mean: f64,
}

#[derive(Serialize)]
struct FurnaceFigures {
    patches: u64,
    max_exitance_error_rel: f32,
    max_exitance_error_rel_by_reflectance: [f32; 2],
    bake_seconds: f64,
    world_bytes: u64,
}

/// Runs the suite.
pub(crate) fn run(arguments: &AccuracyArguments, json: bool) -> anyhow::Result<()> {
    if arguments.scene == "furnace" { furnace(arguments, json) } else { against_reference(arguments, json) }
}

/// Bakes into a scratch folder and loads the world.
fn baked(
    source: &SceneSource,
    quality: &QualityArguments,
    quiet: bool,
) -> anyhow::Result<(WholeWorld, BakeSummary)> {
    let folder = tempfile::tempdir().context("a scratch folder for the world")?;
    let options = BakeOptions {
        parameters: quality.parameters(source),
        codec: RowCodec::Half,
        scene_name: source.name.clone(),
        lights: source.lights.clone(),
        overwrite: false,
    };
    let bars = BakeBars::new(quiet);
    let summary = earthshine_bake::bake(&source.scene, folder.path(), &options, &bars)?;
    bars.finish();
    Ok((WholeWorld::load(folder.path())?, summary))
}

fn furnace(arguments: &AccuracyArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let mut figures = FurnaceFigures {
        patches: 0,
        max_exitance_error_rel: 0.0,
        max_exitance_error_rel_by_reflectance: [0.0; 2],
        bake_seconds: 0.0,
        world_bytes: 0,
    };
    for (index, reflectance) in FURNACES.into_iter().enumerate() {
        let shape = GenOptions { furnace_reflectance: reflectance, ..GenOptions::default() };
        let source = scene_source::load_generated("furnace", None, false, &shape)?;
        let (world, summary) = baked(&source, &arguments.quality, json)?;
        let worst = world.furnace_error();
        figures.max_exitance_error_rel_by_reflectance[index] = worst;
        figures.max_exitance_error_rel = figures.max_exitance_error_rel.max(worst);
        figures.patches += summary.patches;
        figures.bake_seconds += summary.seconds;
        figures.world_bytes += summary.world_bytes;
    }
    let seconds = started.elapsed().as_secs_f64();
    Report::new("accuracy", "furnace", "gather", arguments.quality.seed, seconds, figures).print(json)
}

fn against_reference(arguments: &AccuracyArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let metals_black = arguments.quality.metals_black();
    let source = scene_source::load_generated(
        &arguments.scene,
        arguments.lights.as_deref(),
        metals_black,
        &GenOptions::default(),
    )?;
    let (world, summary) = baked(&source, &arguments.quality, json)?;
    let solving = Instant::now();
    let light = world.solve(&source.lights);
    let volume = world.volume(&light)?;
    let solve_seconds = solving.elapsed().as_secs_f64();
    let referencing = Instant::now();
    let reference = reference_points(arguments, &source, json)?;
    let reference_seconds = referencing.elapsed().as_secs_f64();
    let measured: Vec<Option<Rgb>> =
        reference.iter().map(|point| volume_light::at(&volume, point.position, point.normal)).collect();
    if let Some(path) = &arguments.out {
        volume_light::write_csv(path, &reference, &measured)?;
    }
    let figures = Figures {
        patches: summary.patches,
        errors: compare_points(&reference, &measured)?,
        bake_seconds: summary.seconds,
        solve_seconds,
        reference_seconds,
        world_bytes: summary.world_bytes,
        absorbed_share_mean: summary.absorbed_share_mean,
    };
    let seconds = started.elapsed().as_secs_f64();
    Report::new("accuracy", &source.name, "gather", arguments.quality.seed, seconds, figures).print(json)
}

fn reference_points(
    arguments: &AccuracyArguments,
    source: &SceneSource,
    quiet: bool,
) -> anyhow::Result<Vec<ReferencePoint>> {
    if let Some(path) = &arguments.reference {
        return Ok(csv::read(path)?);
    }
    let tracer = SceneTracer::new(&source.scene);
    let places: Vec<_> = match &arguments.points {
        Some(path) => csv::read(path)?.into_iter().map(|point| (point.position, point.normal)).collect(),
        None => volume_light::random_places(&tracer, arguments.point_count, arguments.quality.seed),
    };
    let bar = counted("reference", "points", places.len() as u64, quiet);
    let options = ReferenceOptions {
        seed: arguments.quality.seed,
        target_error_rel: arguments.noise,
        ..ReferenceOptions::default()
    };
    let estimates = irradiance_at_points(&tracer, &source.lights, &places, &options, &|| bar.inc(1));
    bar.finish_and_clear();
    Ok(places
        .into_iter()
        .zip(estimates)
        .map(|((position, normal), estimate)| ReferencePoint {
            position,
            normal,
            irradiance: estimate.irradiance,
            standard_error: estimate.standard_error,
        })
        .collect())
}
