//! The same measurement with several seeds: what is noise of the bake and what is not.

use super::{AccuracyArguments, Figures, against, compared, measured};
use crate::bench::Report;
use crate::output::out;
use crate::scene_source::SceneSource;
use earthshine_render::compare_points::LightErrors;
use earthshine_render::csv::ReferencePoint;
use serde::Serialize;
use std::time::Instant;

/// Most seeds of one run.
pub(super) const SEEDS_MAX: u32 = 64;

#[derive(Serialize)]
struct SeedFigures {
    /// Of the first seed, its errors replaced by the means over all.
    #[serde(flatten)]
    mean: Figures,
    seeds: u32,
    /// Standard deviations over the seeds.
    spread: Spread,
    /// Each seed's own.
    by_seed: Vec<LightErrors>,
}

#[derive(Serialize)]
struct Spread {
    median_rel: f64,
    p90_rel: f64,
    p99_rel: f64,
    rel_rmse: f64,
    bias: f64,
    beyond_factor_two: f64,
}

/// A figure of the errors, by name.
type Named = (&'static str, fn(&LightErrors) -> f64);

const NAMED: [Named; 6] = [
    ("median error", |errors| errors.median_rel),
    ("90th percentile", |errors| errors.p90_rel),
    ("99th percentile", |errors| errors.p99_rel),
    ("RMSE", |errors| errors.rel_rmse),
    ("bias", |errors| errors.bias),
    ("beyond a factor of two", |errors| errors.beyond_factor_two),
];

/// Measures with `count` seeds from the one asked for, and prints mean and spread of each figure.
pub(super) fn run(
    count: u32,
    arguments: &AccuracyArguments,
    source: &SceneSource,
    reference: &[ReferencePoint],
    json: bool,
    started: Instant,
) -> anyhow::Result<()> {
    let first = arguments.quality.seed;
    let mut all = Vec::with_capacity(count as usize);
    for seed in first..first.saturating_add(u64::from(count)) {
        let quality = arguments.quality.clone().with_seed(seed);
        let measured = measured::baked_for(&arguments.solving, source, quality.parameters(source), json)?;
        all.push(compared(&measured, reference, 0.0)?.1);
    }
    let by_seed: Vec<LightErrors> = all.iter().map(|figures| figures.errors).collect();
    let [median_rel, p90_rel, p99_rel, rel_rmse, bias, beyond_factor_two] =
        NAMED.map(|(_, figure)| mean_and_deviation(&by_seed, figure));
    let mut mean = all.swap_remove(0);
    mean.errors = LightErrors {
        median_rel: median_rel.0,
        p90_rel: p90_rel.0,
        p99_rel: p99_rel.0,
        rel_rmse: rel_rmse.0,
        bias: bias.0,
        beyond_factor_two: beyond_factor_two.0,
        ..mean.errors
    };
    let spread = Spread {
        median_rel: median_rel.1,
        p90_rel: p90_rel.1,
        p99_rel: p99_rel.1,
        rel_rmse: rel_rmse.1,
        bias: bias.1,
        beyond_factor_two: beyond_factor_two.1,
    };
    if json {
        let seconds = started.elapsed().as_secs_f64();
        let figures = SeedFigures { mean, seeds: count, spread, by_seed };
        let report = Report::new("accuracy", &source.name, arguments.solving.name(), first, seconds, figures);
        return report.on(arguments.solving.backend.name()).print(json);
    }
    out!(
        "{}: seeds {first} to {}, against {}",
        source.name,
        first + u64::from(count) - 1,
        against(arguments)
    );
    out!("{} patches with the first, {:.3} MB\n", mean.patches, mean.world_bytes as f64 / 1e6);
    out!("{:>24}  {:>9}  {:>9}  {:>9}  {:>9}", "", "mean", "spread", "least", "most");
    for (name, figure) in NAMED {
        let (mean, deviation) = mean_and_deviation(&by_seed, figure);
        let values = || by_seed.iter().map(figure);
        let (least, most) =
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        let [mean, deviation, least, most] = [mean, deviation, least, most].map(|value| value * 100.0);
        out!("{name:>24}  {mean:>7.2} %  {deviation:>7.2} %  {least:>7.2} %  {most:>7.2} %");
    }
    Ok(())
}

fn mean_and_deviation(errors: &[LightErrors], figure: fn(&LightErrors) -> f64) -> (f64, f64) {
    let count = errors.len() as f64;
    let mean = errors.iter().map(figure).sum::<f64>() / count;
    let squares: f64 = errors.iter().map(|errors| (figure(errors) - mean).powi(2)).sum();
    (mean, (squares / (count - 1.0).max(1.0)).sqrt())
}
