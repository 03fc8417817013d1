//! `bench temporal`: how fast and how exactly every solver follows a change of light, and what a frame costs.
//!
//! The change: all lamps and the sun go on, and emissive surfaces from a tenth; the sky stays. Errors are relative RMSE of
//! irradiance against the solve of the same patches, gathered until a bounce changes less than 1e-6: tests hold that
//! against the multibounce matrix. Times are those of one core, unless more are asked for.

mod cost;
mod response;
mod subset;

use super::Report;
use super::lit_world::WorldArguments;
use crate::output::out;
use crate::solver_world;
use clap::Args;
use earthshine_radiosity::solver::{DrawnRows, Method, SolverSettings};
use earthshine_render::chart::{self, Axis, Chart, Scale, Series};
use response::Response;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;
use subset::{Changes, Subset};

/// Arguments of `bench temporal`.
#[derive(Args)]
pub(crate) struct TemporalArguments {
    #[command(flatten)]
    world: WorldArguments,
    /// Solvers to measure, the first for the figures at the top: gather, alias, cdf, progressive, hybrid.
    #[arg(long, value_delimiter = ',', value_parser = solver_world::method, default_value = "hybrid,alias,cdf,progressive,gather")]
    solver: Vec<Method>,
    /// Patches nearest to the middle of the world for figures of cost; several by commas. Default: all.
    #[arg(long, value_delimiter = ',')]
    n: Vec<usize>,
    /// Patches nearest to the middle of the world for errors. Default: all.
    #[arg(long)]
    response_n: Option<usize>,
    /// Draws a row and frame.
    #[arg(long, default_value_t = 32)]
    k: u32,
    /// Weight of the past.
    #[arg(long, default_value_t = 0.998)]
    history_weight: f32,
    /// Alias and cdf draw from rows of the multibounce matrix, in colour: all bounces at once; takes 6 N^2 bytes.
    #[arg(long)]
    multibounce: bool,
    /// Threads for figures of cost; 0 for one a core.
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Draws and weight by measured variance.
    #[arg(long)]
    adaptive: bool,
    /// Form factors that a frame shoots over, a patch.
    #[arg(long, default_value_t = SolverSettings::default().shot_links_per_patch)]
    shot_links: u32,
    /// Frames that are followed after the change.
    #[arg(long, default_value_t = 2500)]
    frames: u32,
    /// Also write error over frames as charts: STEM.svg and STEM.png.
    #[arg(long, value_name = "STEM")]
    plot: Option<PathBuf>,
}

#[derive(Serialize)]
struct Figures {
    patches: usize,
    nonzeros: usize,
    k: u32,
    history_weight: f32,
    drawn_rows: DrawnRows,
    threads: usize,
    oracle: &'static str,
    /// Of the first solver named, at the first number of patches.
    steady_rel_rmse: f64,
    frames_to_90: Option<u32>,
    frames_to_99: Option<u32>,
    noise_after_rel: f64,
    ns_per_patch_frame: f64,
    dense_ns_per_patch_frame: Option<f64>,
    speedup_over_dense: Option<f64>,
    solvers: Vec<Response>,
    cost: Vec<cost::Cost>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    files: Vec<PathBuf>,
}

/// Runs the suite.
pub(crate) fn run(arguments: &TemporalArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let methods = &arguments.solver;
    let settings = arguments.settings();
    settings.validate()?;
    let lit = arguments.world.load(json)?;
    let changes = Changes::of(&lit);
    let order = lit.nearest_first();
    let subset = |count: usize| Subset::new(&lit, &changes, &order[..count.clamp(1, order.len())]);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build()?;
    let mut whole = subset(arguments.response_n.unwrap_or(order.len()))?;
    let (patches, nonzeros) = (whole.patch_count(), whole.link_count());
    let mut solvers = Vec::new();
    for &method in methods {
        eprintln!("{method}: {patches} patches");
        solvers.push(response::measure(&mut whole, SolverSettings { method, ..settings }, arguments.frames)?);
    }
    drop(whole);
    let counts = if arguments.n.is_empty() { vec![patches] } else { arguments.n.clone() };
    let mut cost = Vec::new();
    for count in counts {
        let mut subset = subset(count)?;
        eprintln!("cost: {} patches", subset.patch_count());
        cost.push(pool.install(|| cost::measure(&mut subset, methods, &settings, &solvers))?);
    }
    let files = match &arguments.plot {
        Some(stem) => chart::write_both(stem, &[error_chart(&lit.name, &solvers)])?.to_vec(),
        None => Vec::new(),
    };
    let (first, first_cost) = (&solvers[0], &cost[0]);
    let figures = Figures {
        patches,
        nonzeros,
        k: arguments.k,
        history_weight: arguments.history_weight,
        drawn_rows: settings.rows,
        threads: arguments.threads,
        oracle: "gather to 1e-6",
        steady_rel_rmse: first.steady_rel_rmse,
        frames_to_90: first.frames_to_90,
        frames_to_99: first.frames_to_99,
        noise_after_rel: first.noise_after_rel,
        ns_per_patch_frame: first_cost.solvers[0].ns_per_patch_frame,
        dense_ns_per_patch_frame: first_cost.dense_ns_per_patch_frame,
        speedup_over_dense: first_cost.solvers[0].speedup_over_dense,
        solvers,
        cost,
        files,
    };
    if !json {
        print_text(&figures);
        return Ok(());
    }
    let seconds = started.elapsed().as_secs_f64();
    let seed = arguments.world.quality.seed;
    Report::new("temporal", &lit.name, methods[0].name(), seed, seconds, figures).print(json)
}

impl TemporalArguments {
    fn settings(&self) -> SolverSettings {
        SolverSettings {
            seed: self.world.quality.seed as u32,
            samples_per_row: self.k,
            history_weight: self.history_weight,
            adaptive: self.adaptive,
            rows: if self.multibounce { DrawnRows::Multibounce } else { DrawnRows::FormFactors },
            // What a rebuild costs is `bench alias`' figure.
            rebuild_items_per_step: u32::MAX,
            shot_links_per_patch: self.shot_links,
            ..SolverSettings::default()
        }
    }
}

fn error_chart(scene: &str, solvers: &[Response]) -> Chart {
    let series = |response: &Response| Series {
        name: response.solver.to_owned(),
        points: response.curve.iter().map(|&(frame, error)| (f64::from(frame), error * 100.0)).collect(),
    };
    Chart {
        title: format!("{scene}: a step of light"),
        x: Axis { label: "frames after the change".to_owned(), scale: Scale::Logarithmic },
        y: Axis { label: "error, % of the change".to_owned(), scale: Scale::Logarithmic },
        series: solvers.iter().map(series).collect(),
    }
}

fn print_text(figures: &Figures) {
    let frames = |frames: Option<u32>| frames.map_or_else(|| "more".to_owned(), |frames| frames.to_string());
    out!(
        "{} patches, {} form factors, k {}, w {}",
        figures.patches,
        figures.nonzeros,
        figures.k,
        figures.history_weight
    );
    out!(
        "\n{:<12} {:>10} {:>10} {:>10} {:>12} {:>12}",
        "solver",
        "to 90 %",
        "to 99 %",
        "noise",
        "steady",
        "moving"
    );
    for solver in &figures.solvers {
        out!(
            "{:<12} {:>10} {:>10} {:>8.3} % {:>10.4} % {:>10.3} %",
            solver.solver,
            frames(solver.frames_to_90),
            frames(solver.frames_to_99),
            solver.noise_after_rel * 100.0,
            solver.steady_rel_rmse * 100.0,
            solver.moving_rel_rmse * 100.0
        );
    }
    out!("\nns a patch and frame, one core; plain copy {:.1} GB/s", figures.cost[0].copy_gb_s);
    for cost in &figures.cost {
        let dense = cost.dense_ns_per_patch_frame.map_or("no memory".to_owned(), |ns| format!("{ns:.0} ns"));
        let bandwidth = cost.dense_gb_s.map_or(String::new(), |rate| format!(" at {rate:.1} GB/s"));
        out!("{} patches, {:.0} links a row; dense product {dense}{bandwidth}", cost.n, cost.links_per_row);
        for solver in &cost.solvers {
            let times = |times: Option<f64>| times.map_or("-".to_owned(), |times| format!("{times:.1} x"));
            out!(
                "  {:<12} {:>9.1} ns, worst {:>9.1}, idle {:>7.2}   over dense {:>8}, at 1 % error {:>8}",
                solver.solver,
                solver.ns_per_patch_frame,
                solver.worst_ns_per_patch_frame,
                solver.idle_ns_per_patch_frame,
                times(solver.speedup_over_dense),
                times(solver.speedup_over_dense_at_1_percent)
            );
        }
    }
}
