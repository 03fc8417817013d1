//! `bench alias`: how fast tables of rows are built, how exact they are, and how well they draw.
//!
//! Speed is one core's, on rows of weights made up for the purpose and on rows of a world. Errors are of one row's
//! irradiance from `k` draws, relative to the exact sum, in a world whose light is solved.

mod error;
mod rebuild;
mod speed;

use super::Report;
use super::lit_world::{LitWorld, WorldArguments};
use crate::output::out;
use clap::Args;
use earthshine_render::chart::{self, Axis, Chart, Scale, Series};
use error::RmseByK;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `bench alias`.
#[derive(Args)]
pub(crate) struct AliasArguments {
    /// Rows that are made up for the figures of speed.
    #[arg(long, default_value_t = 4096)]
    rows: usize,
    /// Items of each.
    #[arg(long, default_value_t = 1000)]
    items: usize,
    #[command(flatten)]
    world: WorldArguments,
    /// Also write error over draws as charts: STEM.svg and STEM.png.
    #[arg(long, value_name = "STEM")]
    plot: Option<PathBuf>,
}

#[derive(Serialize)]
struct Figures {
    rows: usize,
    items: usize,
    patches: usize,
    nonzeros: usize,
    /// The sequential build of made-up rows on one core, weights to bins.
    build_mitems_s_core: f64,
    /// The same by builder, on made-up rows and on the world's.
    build: Vec<speed::Build>,
    bytes_per_item: speed::Bytes,
    /// Largest difference between a share and its table, in bins of that row, over rows of the world and edge rows.
    max_mass_error_bins: f64,
    rmse_by_k: RmseByK,
    rebuild_waste: rebuild::RebuildWaste,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    files: Vec<PathBuf>,
}

/// Runs the suite.
pub(crate) fn run(arguments: &AliasArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let lit = arguments.world.load(json)?;
    let seed = arguments.world.quality.seed;
    let build = speed::measure(&lit, arguments.rows, arguments.items, seed)?;
    let rmse_by_k = error::measure(&lit, seed as u32)?;
    let files = match &arguments.plot {
        Some(stem) => chart::write_both(stem, &[error_chart(&lit, &rmse_by_k)])?.to_vec(),
        None => Vec::new(),
    };
    let figures = Figures {
        rows: arguments.rows,
        items: arguments.items,
        patches: lit.areas.len(),
        nonzeros: lit.rows.nonzero_count(),
        build_mitems_s_core: build[0].made_up_mitems_s,
        build,
        bytes_per_item: speed::bytes(&lit)?,
        max_mass_error_bins: error::max_mass_error_bins(&lit)?,
        rmse_by_k,
        rebuild_waste: rebuild::measure(&lit, seed as u32)?,
        files,
    };
    if !json {
        print_text(&figures);
        return Ok(());
    }
    let seconds = started.elapsed().as_secs_f64();
    Report::new("alias", &lit.name, "alias", seed, seconds, figures).print(json)
}

fn print_text(figures: &Figures) {
    out!(
        "{} patches, {} form factors; {} rows of {} items made up",
        figures.patches,
        figures.nonzeros,
        figures.rows,
        figures.items
    );
    out!("\nbuilt on one core, million items a second   made up    the world's");
    for build in &figures.build {
        out!("  {:<38} {:>10.1} {:>14.1}", build.builder, build.made_up_mitems_s, build.world_mitems_s);
    }
    out!("largest error of a table: {:.2e} bins", figures.max_mass_error_bins);
    let Figures { bytes_per_item, rmse_by_k, rebuild_waste: waste, .. } = figures;
    out!("bytes an item: alias {:.2}, cdf {:.2}", bytes_per_item.alias, bytes_per_item.cdf);
    out!("\nerror of a row's light from k draws, relative RMSE");
    out!(
        "{:>6} {:>12} {:>18} {:>18} {:>18}",
        "k",
        "alias",
        "alias systematic",
        "cdf systematic",
        "cdf, tile order"
    );
    for (at, k) in rmse_by_k.k.iter().enumerate() {
        let cell = |errors: &[f64]| format!("{:.3} %", errors[at] * 100.0);
        out!(
            "{k:>6} {:>12} {:>18} {:>18} {:>18}",
            cell(&rmse_by_k.alias),
            cell(&rmse_by_k.alias_systematic),
            cell(&rmse_by_k.cdf_systematic),
            cell(&rmse_by_k.cdf_tile_order_systematic)
        );
    }
    out!(
        "\nhalf of the patches resident: {:.1} % of full rows' draws are of others",
        waste.wasted_share * 100.0
    );
    out!(
        "  32 draws of a rebuilt row   {:>8.1} ns  error {:.3} %",
        waste.rebuilt_ns,
        waste.rebuilt_rel_rmse * 100.0
    );
    out!(
        "  as long on the full row     {:>8.1} ns  error {:.3} % ({} draws)",
        waste.full_ns,
        waste.full_rel_rmse * 100.0,
        waste.full_draws
    );
    out!("  one rebuild                 {:>8.1} ns", waste.rebuild_ns);
}

fn error_chart(lit: &LitWorld, errors: &RmseByK) -> Chart {
    let series = |name: &str, values: &[f64]| Series {
        name: name.to_owned(),
        points: errors.k.iter().zip(values).map(|(&k, &error)| (f64::from(k), error * 100.0)).collect(),
    };
    Chart {
        title: format!("{}: light of a row from k draws", lit.name),
        x: Axis { label: "draws a row".to_owned(), scale: Scale::Logarithmic },
        y: Axis { label: "relative RMSE, %".to_owned(), scale: Scale::Logarithmic },
        series: vec![
            series("alias", &errors.alias),
            series("alias, systematic", &errors.alias_systematic),
            series("CDF in Morton order, systematic", &errors.cdf_systematic),
            series("CDF in tile order, systematic", &errors.cdf_tile_order_systematic),
        ],
    }
}
