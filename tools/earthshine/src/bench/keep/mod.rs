//! `bench keep`: what a world would cost, and its light be worth, if rows kept the top share of their mass.
//!
//! The rest of each row goes to the coarse parents of the patches that it leads to, one level up, so that no energy is
//! lost. Bytes are those of real tiles of level 0, encoded anew; errors are those of the light of all patches, solved at once,
//! against the rows as they are.

mod thinned;

use super::Report;
use super::lit_world::WorldArguments;
use crate::output::out;
use crate::whole_world::WholeWorld;
use anyhow::Context as _;
use clap::Args;
use earthshine_render::chart::{self, Axis, Chart, Scale, Series};
use earthshine_tiles::{EncodeOptions, encode};
use earthshine_world::Rgb;
use rayon::prelude::*;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;
use thinned::{Parents, Thinned};

/// Arguments of `bench keep`.
#[derive(Args)]
pub(crate) struct KeepArguments {
    #[command(flatten)]
    world: WorldArguments,
    /// Shares of a row's mass that keep columns of their own.
    #[arg(long, value_delimiter = ',', default_value = "1,0.99,0.95,0.9,0.8,0.7,0.5,0.25,0", value_parser = share)]
    shares: Vec<f32>,
    /// Draw error against bytes to PATH.svg and PATH.png.
    #[arg(long, value_name = "PATH")]
    plot: Option<PathBuf>,
}

fn share(text: &str) -> Result<f32, String> {
    match text.trim().parse::<f32>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        Ok(_) => Err(format!("`{text}` is not between 0 and 1")),
        Err(error) => Err(format!("`{text}`: {error}")),
    }
}

#[derive(Serialize)]
struct Figures {
    patches: usize,
    /// Ground that the world covers, km2.
    km2: f64,
    steps: Vec<Step>,
    files: Option<[PathBuf; 2]>,
}

#[derive(Serialize)]
struct Step {
    keep: f32,
    /// Columns of a row, and how many of them are coarse.
    columns_mean: f64,
    coarse_columns_mean: f64,
    /// All tiles of level 0.
    level_0_bytes: u64,
    level_0_bytes_per_km2: f64,
    /// Of the light that patches receive from patches and sky, against keeping all.
    rel_rmse: f64,
    median_rel: f64,
    p99_rel: f64,
    bias: f64,
}

/// Runs the suite.
pub(crate) fn run(arguments: &KeepArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let lit = arguments.world.load(json)?;
    let world = &lit.world;
    let parents = Parents::of(world);
    let bounds = world.manifest.bounds;
    let extent = bounds.max - bounds.min;
    let km2 = f64::from(extent.x) * f64::from(extent.z) / 1e6;
    let mut steps = Vec::with_capacity(arguments.shares.len());
    for &keep in &arguments.shares {
        let thinned = Thinned::new(world, &parents, keep);
        let rows =
            thinned.expanded(&parents).context("rows with coarse columns spread over their children")?;
        let light = world.solve_rows(&rows, lit.light.direct_exitance.clone(), &lit.rig);
        let errors = Errors::between(&light.irradiance, &lit.light.irradiance);
        let level_0_bytes = encoded_bytes(world, &thinned, &parents)?;
        let row_count = lit.areas.len().max(1) as f64;
        steps.push(Step {
            keep,
            columns_mean: thinned.column_count() as f64 / row_count,
            coarse_columns_mean: thinned.coarse_column_count() as f64 / row_count,
            level_0_bytes,
            level_0_bytes_per_km2: level_0_bytes as f64 / km2,
            rel_rmse: errors.rel_rmse,
            median_rel: errors.median_rel,
            p99_rel: errors.p99_rel,
            bias: errors.bias,
        });
    }
    let files = match &arguments.plot {
        Some(stem) => Some(chart::write_both(stem, &[curve(&steps, &lit.name)])?),
        None => None,
    };
    let figures = Figures { patches: lit.areas.len(), km2, steps, files };
    let seconds = started.elapsed().as_secs_f64();
    if !json {
        print_table(&figures);
        return Ok(());
    }
    Report::new("keep", &lit.name, "gather", world.manifest.parameters.seed, seconds, figures).print(json)
}

fn encoded_bytes(world: &WholeWorld, thinned: &Thinned, parents: &Parents) -> anyhow::Result<u64> {
    let options = EncodeOptions::new(world.manifest.world_hash);
    let mut first = 0;
    let chunks: Vec<_> = world
        .chunks()
        .iter()
        .map(|chunk| {
            let own = first..first + chunk.patches.len();
            first = own.end;
            (chunk, own)
        })
        .collect();
    let bytes = chunks.into_par_iter().map(|(chunk, own)| {
        let thin = thinned.chunk(chunk, own, parents);
        Ok(encode(&thin, &options)?.len() as u64)
    });
    bytes.sum()
}

/// Relative errors over all patches that receive light.
struct Errors {
    rel_rmse: f64,
    median_rel: f64,
    p99_rel: f64,
    bias: f64,
}

impl Errors {
    fn between(light: &[Rgb], truth: &[Rgb]) -> Self {
        let (mut gap, mut norm, mut sum, mut truth_sum) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
        let mut relative = Vec::with_capacity(light.len());
        for (light, truth) in light.iter().zip(truth) {
            let difference = f64::from((*light - *truth).length_squared());
            gap += difference;
            norm += f64::from(truth.length_squared());
            sum += f64::from(light.element_sum());
            truth_sum += f64::from(truth.element_sum());
            if truth.length_squared() > 0.0 {
                relative.push((difference / f64::from(truth.length_squared())).sqrt());
            }
        }
        relative.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let last = relative.len().saturating_sub(1);
            relative.get((last as f64 * share) as usize).copied().unwrap_or(0.0)
        };
        Self {
            rel_rmse: (gap / norm.max(f64::MIN_POSITIVE)).sqrt(),
            median_rel: at(0.5),
            p99_rel: at(0.99),
            bias: sum / truth_sum.max(f64::MIN_POSITIVE) - 1.0,
        }
    }
}

fn print_table(figures: &Figures) {
    out!(
        "{} patches on {:.3} km2; errors are of all patches' light, against rows that keep all",
        figures.patches,
        figures.km2
    );
    out!(
        "{:>6} {:>9} {:>9} {:>12} {:>12} {:>9} {:>9} {:>9} {:>9}",
        "keep",
        "columns",
        "coarse",
        "bytes",
        "bytes/km2",
        "RMSE",
        "median",
        "p99",
        "bias"
    );
    let percent = |share: f64| format!("{:.3} %", share * 100.0);
    for step in &figures.steps {
        out!(
            "{:>6} {:>9.1} {:>9.1} {:>12} {:>12.0} {:>9} {:>9} {:>9} {:>9}",
            step.keep,
            step.columns_mean,
            step.coarse_columns_mean,
            step.level_0_bytes,
            step.level_0_bytes_per_km2,
            percent(step.rel_rmse),
            percent(step.median_rel),
            percent(step.p99_rel),
            percent(step.bias)
        );
    }
    if let Some([svg, png]) = &figures.files {
        out!("\n{}, {}", svg.display(), png.display());
    }
}

fn curve(steps: &[Step], scene: &str) -> Chart {
    type Ordinate = (&'static str, fn(&Step) -> f64);
    let errors: [Ordinate; 3] =
        [("median", |step| step.median_rel), ("RMSE", |step| step.rel_rmse), ("p99", |step| step.p99_rel)];
    Chart {
        title: format!("{scene}: rows that keep the top share of their mass"),
        x: Axis { label: "bytes of level 0 a km2".to_owned(), scale: Scale::Logarithmic },
        y: Axis { label: "error of light, %".to_owned(), scale: Scale::Logarithmic },
        series: errors
            .iter()
            .map(|(name, error)| Series {
                name: (*name).to_owned(),
                points: steps.iter().map(|step| (step.level_0_bytes_per_km2, error(step) * 100.0)).collect(),
            })
            .collect(),
    }
}
