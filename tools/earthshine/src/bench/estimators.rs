//! `bench estimators`: how far rows are from rows of very many rays: by spread, by sums over points, by target.
//!
//! The error of a row is the root of the summed squares of what its shares are off by, sky lobes and absorbed share
//! among them. Rows are raw: as estimated, before both sides of a pair are averaged.

use super::Report;
use crate::output::out;
use crate::progress_bars::BakeBars;
use crate::quality::QualityArguments;
use crate::scene_source;
use clap::Args;
use earthshine_bake::SceneTracer;
use earthshine_bake::builder::{Builder, Surfaces};
use earthshine_bake::estimator::Estimator;
use earthshine_bake::rows::{RawRow, RowCaster};
use earthshine_render::compare_points::percentile;
use earthshine_tiles::{BakeMethod, BakeParameters, RaySpread, RowEstimator};
use rayon::prelude::*;
use serde::Serialize;
use std::time::Instant;

/// Arguments of `bench estimators`.
#[derive(Args)]
pub(crate) struct EstimatorsArguments {
    /// A generated world or a .glb file.
    #[arg(long)]
    scene: String,
    /// Rows that are measured, evenly over all.
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u32).range(1..))]
    rows: u32,
    /// Rays of the rows that all are held against.
    #[arg(long, default_value_t = 65_536, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    reference_rays: u32,
    /// Targets that are tried as --row-error.
    #[arg(long, value_delimiter = ',', default_values_t = [0.04, 0.02], value_parser = crate::numbers::share)]
    targets: Vec<f32>,
    /// Print Markdown tables.
    #[arg(long)]
    markdown: bool,
    #[command(flatten)]
    quality: QualityArguments,
}

/// Rays at which spreads are compared.
const RAYS: [u32; 3] = [256, 1024, 4096];
/// The reference must not share its random numbers with what is measured.
const REFERENCE_SEED: u64 = 0x5EED_0FF5;

#[derive(Serialize)]
struct Figures {
    patches: usize,
    rows: usize,
    reference_rays: u32,
    estimators: Vec<Measured>,
    targets: Vec<Target>,
}

#[derive(Serialize)]
struct Measured {
    estimator: &'static str,
    rays: u32,
    #[serde(flatten)]
    errors: RowErrors,
}

/// Errors over rows.
#[derive(Debug, Clone, Copy, Serialize)]
struct RowErrors {
    rays_mean: f64,
    error_mean: f64,
    error_rms: f64,
    error_p95: f64,
    error_max: f64,
    row_us: f64,
}

/// A target beside rows of a fixed number of rays.
#[derive(Serialize)]
struct Target {
    row_error: f32,
    #[serde(flatten)]
    errors: RowErrors,
    /// The same rays on average, the same for every row.
    fixed_at_equal_rays: RowErrors,
    /// Rays a row that a fixed number takes for the same root-mean-square error, by the slope of its errors.
    fixed_rays_at_equal_rms: f64,
    /// The same for the same 95th percentile.
    fixed_rays_at_equal_p95: f64,
}

struct Bench<'a> {
    tracer: SceneTracer<'a>,
    surfaces: Surfaces,
    parameters: BakeParameters,
    chosen: Vec<u32>,
    reference: Vec<RawRow>,
}

/// Runs the suite.
pub(crate) fn run(arguments: &EstimatorsArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let quality = &arguments.quality;
    let source = scene_source::load(&arguments.scene, None, quality.metals_black())?;
    let bench = Bench::new(&source.scene, quality.checked_of_patches(&source)?, arguments, json);
    let mut estimators = Vec::new();
    for (name, spread) in SPREADS {
        for rays in RAYS {
            let errors = bench.fixed(spread, rays);
            estimators.push(Measured { estimator: name, rays, errors });
        }
    }
    let points = BakeMethod { estimator: RowEstimator::Points, ..bench.parameters.method };
    // Larger scenes refuse; what is left out says so by its absence.
    if let Ok(errors) = bench.errors(BakeParameters { method: points, ..bench.parameters }) {
        estimators.push(Measured { estimator: "sums over points", rays: 0, errors });
    }
    let targets = arguments.targets.iter().map(|&target| bench.target(target)).collect::<Result<_, _>>()?;
    let figures = Figures {
        patches: bench.surfaces.set.len(),
        rows: bench.chosen.len(),
        reference_rays: arguments.reference_rays,
        estimators,
        targets,
    };
    if arguments.markdown && !json {
        print_tables(&source.name, &figures);
        return Ok(());
    }
    let seconds = started.elapsed().as_secs_f64();
    Report::new("estimators", &source.name, "none", quality.seed, seconds, figures).print(json)
}

const SPREADS: [(&str, RaySpread); 4] = [
    ("white noise", RaySpread::White),
    ("stratified", RaySpread::Stratified),
    ("R2", RaySpread::R2),
    ("Sobol, scrambled", RaySpread::Sobol),
];

impl<'a> Bench<'a> {
    fn new(
        scene: &'a earthshine_scene::Scene,
        parameters: BakeParameters,
        arguments: &EstimatorsArguments,
        quiet: bool,
    ) -> Self {
        let tracer = SceneTracer::new(scene);
        let bars = BakeBars::new(quiet);
        let surfaces = Builder { tracer: &tracer, parameters: &parameters }.surfaces(&bars);
        bars.finish();
        let patches = surfaces.set.len() as u64;
        let rows = u64::from(arguments.rows).clamp(1, patches.max(1));
        let chosen = (0..rows.min(patches)).map(|row| (row * patches / rows) as u32).collect();
        let mut bench = Self { tracer, surfaces, parameters, chosen, reference: Vec::new() };
        let method = BakeMethod { spread: RaySpread::Sobol, ..parameters.method };
        let many = BakeParameters { seed: parameters.seed ^ REFERENCE_SEED, method, ..parameters };
        let caster = bench.caster(&many);
        let rays = arguments.reference_rays.clamp(1, BakeMethod::RAYS_MAX);
        bench.reference = bench.chosen.par_iter().map(|&patch| caster.row(patch, rays)).collect();
        bench
    }

    fn caster<'b>(&'b self, parameters: &'b BakeParameters) -> RowCaster<'b> {
        RowCaster::of_world(&self.tracer, &self.surfaces, parameters)
    }

    fn fixed(&self, spread: RaySpread, rays: u32) -> RowErrors {
        let method = BakeMethod { spread, ..self.parameters.method };
        let parameters = BakeParameters { rays_per_patch: rays, method, ..self.parameters };
        let caster = self.caster(&parameters);
        self.errors_of(|patch| caster.row(patch, rays))
    }

    fn errors(&self, parameters: BakeParameters) -> anyhow::Result<RowErrors> {
        let estimator = Estimator::new(self.caster(&parameters))?;
        Ok(self.errors_of(|patch| estimator.row(patch)))
    }

    fn errors_of(&self, row: impl Fn(u32) -> RawRow + Sync) -> RowErrors {
        let started = Instant::now();
        let rows: Vec<RawRow> = self.chosen.par_iter().map(|&patch| row(patch)).collect();
        let seconds = started.elapsed().as_secs_f64() * rayon::current_num_threads() as f64;
        let mut errors: Vec<f64> =
            rows.iter().zip(&self.reference).map(|(row, truth)| distance(row, truth)).collect();
        errors.sort_by(f64::total_cmp);
        let count = errors.len() as f64;
        RowErrors {
            rays_mean: rows.iter().map(|row| f64::from(row.rays)).sum::<f64>() / count,
            error_mean: errors.iter().sum::<f64>() / count,
            error_rms: (errors.iter().map(|error| error * error).sum::<f64>() / count).sqrt(),
            error_p95: percentile(&errors, 0.95),
            error_max: percentile(&errors, 1.0),
            row_us: seconds / count * 1e6,
        }
    }

    fn target(&self, row_error: f32) -> anyhow::Result<Target> {
        let method = BakeMethod { row_error, ..self.parameters.method };
        let errors = self.errors(BakeParameters { method, ..self.parameters })?;
        let rays = errors.rays_mean.round().max(1.0) as u32;
        let spread = self.parameters.method.spread;
        let fixed = self.fixed(spread, rays);
        // Errors fall with a power of the rays, between the same rays and twice as many.
        let twice = self.fixed(spread, 2 * rays);
        let needed = |fixed: f64, twice: f64, wanted: f64| {
            let slope = (fixed / twice).log2().max(0.1);
            f64::from(rays) * (fixed / wanted).powf(1.0 / slope)
        };
        Ok(Target {
            row_error,
            errors,
            fixed_at_equal_rays: fixed,
            fixed_rays_at_equal_rms: needed(fixed.error_rms, twice.error_rms, errors.error_rms),
            fixed_rays_at_equal_p95: needed(fixed.error_p95, twice.error_p95, errors.error_p95),
        })
    }
}

/// Length of the difference of two rows.
fn distance(row: &RawRow, truth: &RawRow) -> f64 {
    let (mut a, mut b) = (row.entries.iter().peekable(), truth.entries.iter().peekable());
    let mut sum = f64::from(row.absorbed - truth.absorbed).powi(2);
    sum += row.sky.iter().zip(&truth.sky).map(|(x, y)| f64::from(x - y).powi(2)).sum::<f64>();
    loop {
        let patch = match (a.peek(), b.peek()) {
            (None, None) => return sum.sqrt(),
            (Some(x), None) | (None, Some(x)) => x.0,
            (Some(x), Some(y)) => x.0.min(y.0),
        };
        let here = a.next_if(|x| x.0 == patch).map_or(0.0, |x| x.1);
        let there = b.next_if(|y| y.0 == patch).map_or(0.0, |y| y.1);
        sum += f64::from(here - there).powi(2);
    }
}

fn print_tables(scene: &str, figures: &Figures) {
    out!(
        "`{scene}`, {} of {} rows against rows of {} rays:\n",
        figures.rows,
        figures.patches,
        figures.reference_rays
    );
    out!("| rows by | rays | mean error | RMS | p95 | largest | a row |");
    out!("|---|---|---|---|---|---|---|");
    for Measured { estimator, rays, errors } in &figures.estimators {
        let rays = if *rays == 0 { "-".to_owned() } else { rays.to_string() };
        out!("| {estimator} | {rays} | {} |", described(errors));
    }
    for target in &figures.targets {
        let rays = target.errors.rays_mean.round();
        out!("| error {} as target | {rays} on average | {} |", target.row_error, described(&target.errors));
        out!("| the same rays for all | {rays} | {} |", described(&target.fixed_at_equal_rays));
        out!(
            "| fixed, for the same RMS; p95 | {:.0}; {:.0} | | | | | |",
            target.fixed_rays_at_equal_rms,
            target.fixed_rays_at_equal_p95
        );
    }
}

fn described(errors: &RowErrors) -> String {
    let RowErrors { error_mean, error_rms, error_p95, error_max, row_us, .. } = errors;
    format!("{error_mean:.4} | {error_rms:.4} | {error_p95:.4} | {error_max:.4} | {row_us:.0} us")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_of_rows_counts_every_share_once() {
        let row = |entries: &[(u32, f32)], sky: f32| RawRow {
            entries: entries.to_vec(),
            sky: [sky, 0.0, 0.0, 0.0, 0.0, 0.0],
            ..RawRow::default()
        };
        let (a, b) = (row(&[(1, 0.3), (4, 0.4)], 0.3), row(&[(1, 0.3), (2, 0.4)], 0.3));
        assert_eq!(distance(&a, &a), 0.0);
        assert!((distance(&a, &b) - 0.32f64.sqrt()).abs() < 1e-6);
        assert!((distance(&a, &row(&[(1, 0.3), (4, 0.4)], 0.0)) - 0.3).abs() < 1e-6);
    }
}
