//! `bench builders`: one scene baked by every builder and estimator, each held against the same reference.
//!
//! The table in `tools/bake/BUILDERS.md` is what it prints with `--markdown`.

use super::Report;
use super::accuracy::measured::baked;
use crate::output::out;
use crate::quality::QualityArguments;
use crate::reference_light;
use crate::scene_source::{self, SceneSource};
use crate::volume_light;
use clap::Args;
use earthshine_bake::BakeError;
use earthshine_render::ReferenceOptions;
use earthshine_render::compare_points::{LightErrors, compare_points};
use earthshine_render::csv::{self, ReferencePoint};
use earthshine_tiles::{BakeMethod, BakeParameters, PatchBuilder, RowEstimator, SampleSource};
use earthshine_world::{AxisWeights, Rgb};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `bench builders`.
#[derive(Args)]
pub(crate) struct BuildersArguments {
    /// A generated world or a .glb file.
    #[arg(long)]
    scene: String,
    /// Lights JSON.
    #[arg(long)]
    lights: Option<PathBuf>,
    /// CSV of reference light; without it our own path tracer makes one.
    #[arg(long)]
    reference: Option<PathBuf>,
    /// Random points, where there is no --reference.
    #[arg(long, default_value_t = 600, value_parser = super::accuracy::point_count)]
    point_count: usize,
    /// Noise at which our own reference stops, as a share of the light.
    #[arg(long, default_value_t = 0.01, value_parser = crate::numbers::noise)]
    noise: f32,
    /// Print a Markdown table.
    #[arg(long)]
    markdown: bool,
    #[command(flatten)]
    quality: QualityArguments,
}

#[derive(Serialize)]
struct Figures {
    voxel_edge_m: f32,
    points: usize,
    builders: Vec<BuilderFigures>,
}

#[derive(Serialize)]
struct BuilderFigures {
    builder: &'static str,
    /// Without them the builder refused the scene, and `refused` says why.
    #[serde(flatten)]
    made: Option<Made>,
    refused: Option<String>,
}

#[derive(Serialize)]
struct Made {
    patches: u64,
    #[serde(flatten)]
    errors: LightErrors,
    absorbed_share_mean: f64,
    bake_seconds: Option<f64>,
    world_bytes: u64,
}

/// Every combination that is compared, by what it changes.
fn variants(base: BakeParameters) -> Vec<(&'static str, BakeParameters)> {
    let with = |method: BakeMethod| BakeParameters { method, ..base };
    let clustered = BakeMethod { builder: PatchBuilder::Clustered, ..base.method };
    let sources_rule = BakeMethod { cluster_distance: 0.0, ..clustered };
    let hammersley = SampleSource::Hammersley;
    vec![
        ("area, axis (default)", base),
        ("area, axis, weights \\|n\\|", BakeParameters { weights: AxisWeights::Absolute, ..base }),
        ("Hammersley, axis", with(BakeMethod { samples: hammersley, ..base.method })),
        ("area, clustered", with(clustered)),
        ("area, clustered, distance 0", with(sources_rule)),
        ("area, clustered, distance 0, k = 2", with(BakeMethod { clusters_per_voxel: 2, ..sources_rule })),
        ("Hammersley, clustered, distance 0", with(BakeMethod { samples: hammersley, ..sources_rule })),
        ("area, axis, sums over points", with(BakeMethod { estimator: RowEstimator::Points, ..base.method })),
    ]
}

/// Runs the suite.
pub(crate) fn run(arguments: &BuildersArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let quality = &arguments.quality;
    let source = scene_source::load(&arguments.scene, arguments.lights.as_deref(), quality.metals_black())?;
    let base = quality.checked_of_patches(&source)?;
    let reference = reference_points(arguments, &source, json)?;
    let builders = variants(base)
        .into_iter()
        .map(|(builder, parameters)| figures_of(builder, parameters, &source, &reference, json))
        .collect::<anyhow::Result<Vec<_>>>()?;
    let figures = Figures { voxel_edge_m: base.grid.voxel_edge_m, points: reference.len(), builders };
    if arguments.markdown && !json {
        print_table(&source.name, &figures);
        return Ok(());
    }
    let seconds = started.elapsed().as_secs_f64();
    Report::new("builders", &source.name, "gather", quality.seed, seconds, figures).print(json)
}

fn figures_of(
    builder: &'static str,
    parameters: BakeParameters,
    source: &SceneSource,
    reference: &[ReferencePoint],
    quiet: bool,
) -> anyhow::Result<BuilderFigures> {
    match baked(source, parameters, quiet) {
        Ok(measured) => {
            let light: Vec<Option<Rgb>> = reference
                .iter()
                .map(|point| volume_light::at(&measured.volumes, point.position, point.normal))
                .collect();
            let made = Made {
                patches: measured.patches,
                errors: compare_points(reference, &light)?,
                absorbed_share_mean: measured.absorbed_share_mean,
                bake_seconds: measured.bake_seconds,
                world_bytes: measured.world_bytes,
            };
            Ok(BuilderFigures { builder, made: Some(made), refused: None })
        }
        Err(error) => match error.downcast_ref::<BakeError>() {
            Some(refusal @ BakeError::TooManyPairs { .. }) => {
                Ok(BuilderFigures { builder, made: None, refused: Some(refusal.to_string()) })
            }
            _ => Err(error),
        },
    }
}

fn reference_points(
    arguments: &BuildersArguments,
    source: &SceneSource,
    quiet: bool,
) -> anyhow::Result<Vec<ReferencePoint>> {
    if let Some(path) = &arguments.reference {
        let points = csv::read(path)?;
        if points.is_empty() {
            return Err(csv::CsvError::NoPoints { path: path.clone() }.into());
        }
        return Ok(points);
    }
    let tracer = source.tracer();
    let seed = arguments.quality.seed;
    let places = volume_light::random_places(&tracer, arguments.point_count, seed);
    let options = ReferenceOptions { seed, target_error_rel: arguments.noise, ..ReferenceOptions::default() };
    Ok(reference_light::traced(&tracer, &source.lights, &places, &options, quiet))
}

fn print_table(scene: &str, figures: &Figures) {
    out!("`{scene}`, voxels of {} m, {} points:\n", figures.voxel_edge_m, figures.points);
    out!("| builder | patches | median | RMSE | bias | uncovered | absorbed | bake | bytes |");
    out!("|---|---|---|---|---|---|---|---|---|");
    for row in &figures.builders {
        let Some(made) = &row.made else {
            out!("| {} | refused: too many pairs | | | | | | | |", row.builder);
            continue;
        };
        let percent = |share: f64| share * 100.0;
        out!(
            "| {} | {} | {:.2} % | {:.2} % | {:+.2} % | {} | {:.2} % | {:.1} s | {:.2} MB |",
            row.builder,
            made.patches,
            percent(made.errors.median_rel),
            percent(made.errors.rel_rmse),
            percent(made.errors.bias),
            made.errors.uncovered,
            percent(made.absorbed_share_mean),
            made.bake_seconds.unwrap_or(0.0),
            made.world_bytes as f64 / 1e6
        );
    }
}
