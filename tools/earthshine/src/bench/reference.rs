//! `bench reference`: our path tracer against another renderer's light at points, in standard errors.

use super::Report;
use crate::numbers;
use crate::progress_bars::counted;
use crate::quality::Metals;
use crate::scene_source;
use crate::writable;
use anyhow::Context as _;
use clap::Args;
use earthshine_render::agreement::{Agreement, ApartPoint, agreement, apart};
use earthshine_render::compare_points::{LightErrors, compare_points};
use earthshine_render::csv::{self, ReferencePoint};
use earthshine_render::{ReferenceOptions, irradiance_at_points};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `bench reference`.
#[derive(Args)]
#[command(
    after_help = "A point agrees when both lights, channels averaged, differ by at most k sqrt(s1^2 + s2^2) with
their standard errors s1 and s2; of unbiased light 95.4 % of the points do within k = 2, 99.7 % within k = 3.
A target of --noise stops a point where its noise happens to look small, so that more points than that disagree: compare
with --noise 0 and so many --paths.

Examples:
  earthshine bench reference --scene cornell.glb --reference cornell.mitsuba.csv --noise 0 --paths 16384
  earthshine bench reference --scene sponza.glb --lights sponza.lights.json --reference sponza.cycles.csv --json"
)]
pub(crate) struct ReferenceArguments {
    /// A generated world or a .glb file.
    #[arg(long)]
    scene: String,
    /// Lights JSON.
    #[arg(long)]
    lights: Option<PathBuf>,
    /// CSV of another renderer's light.
    #[arg(long)]
    reference: PathBuf,
    /// Points of it that are traced, from the first on.
    #[arg(long, value_parser = super::accuracy::point_count)]
    point_count: Option<usize>,
    /// Noise at which a point is done, as a share of its light; 0 takes all paths.
    #[arg(long, default_value_t = 0.01, value_parser = numbers::noise)]
    noise: f32,
    /// Most paths a point.
    #[arg(long, default_value_t = 1 << 16, value_parser = clap::value_parser!(u64).range(1..=1 << 40))]
    paths: u64,
    /// Of the random numbers.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Whether metals reflect their base colour diffusely or nothing.
    #[arg(long, default_value = "diffuse")]
    metals: Metals,
    /// Writes our light in the same form.
    #[arg(long)]
    out: Option<PathBuf>,
}

#[derive(Serialize)]
struct Figures {
    #[serde(flatten)]
    agreement: Agreement,
    /// Points beyond two combined standard errors.
    apart: Vec<ApartPoint>,
    /// Ours as if it were measured.
    #[serde(flatten)]
    errors: LightErrors,
    paths: u64,
    rays: u64,
    mrays_s: f64,
}

/// Runs the suite.
pub(crate) fn run(arguments: &ReferenceArguments, json: bool) -> anyhow::Result<()> {
    let mut theirs = csv::read(&arguments.reference)?;
    theirs.truncate(arguments.point_count.unwrap_or(usize::MAX));
    writable::ensure_files(&arguments.out)?;
    if theirs.is_empty() {
        return Err(csv::CsvError::NoPoints { path: arguments.reference.clone() }.into());
    }
    let metals_black = arguments.metals == Metals::Black;
    let source = scene_source::load(&arguments.scene, arguments.lights.as_deref(), metals_black)?;
    let tracer = source.tracer();
    let places: Vec<_> = theirs.iter().map(|point| (point.position, point.normal)).collect();
    let options = ReferenceOptions {
        seed: arguments.seed,
        samples_max: arguments.paths,
        target_error_rel: arguments.noise,
        ..ReferenceOptions::default()
    };
    let bar = counted("reference", "points", places.len() as u64, json);
    let started = Instant::now();
    let found = irradiance_at_points(&tracer, &source.lights, &places, &options, &|| bar.inc(1));
    let seconds = started.elapsed().as_secs_f64();
    bar.finish_and_clear();
    let ours: Vec<ReferencePoint> =
        places.iter().zip(&found).map(|(&place, estimate)| ReferencePoint::of(place, estimate)).collect();
    if let Some(path) = &arguments.out {
        csv::write(path, &ours)?;
    }
    let measured: Vec<_> = ours.iter().map(|point| Some(point.irradiance)).collect();
    let errors = compare_points(&theirs, &measured)?;
    let agreement = agreement(&ours, &theirs).context("the reference is black at every point")?;
    let rays: u64 = found.iter().map(|point| point.rays).sum();
    let paths = found.iter().map(|point| point.samples).sum();
    let mrays_s = rays as f64 / seconds.max(1e-9) / 1e6;
    let figures = Figures { agreement, apart: apart(&ours, &theirs), errors, paths, rays, mrays_s };
    Report::new("reference", &source.name, "path-tracer", arguments.seed, seconds, figures).print(json)
}
