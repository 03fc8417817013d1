//! `bench matrix`: adds and removals against a fresh solve, and the time they take.

use super::Report;
use clap::Args;
use earthshine_radiosity::bench::{MatrixBenchParams, measure_matrix};
use serde::Serialize;
use std::time::Instant;

/// Arguments of `bench matrix`.
#[derive(Args)]
pub(crate) struct MatrixArguments {
    /// Slots of the matrix that is timed; accuracy uses a smaller one, printed beside its error.
    #[arg(long, default_value_t = 2048)]
    m: u32,
    /// Swaps (one patch out, another in) after which the error is taken.
    #[arg(long, default_value_t = 10_000)]
    swaps: u32,
    /// Patches that leave, and enter, together.
    #[arg(long, default_value_t = 32)]
    block: u32,
    /// Of everything random.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Serialize)]
struct Figures {
    m: u32,
    swaps: u32,
    block: u32,
    accuracy_m: u32,
    /// Exact update, relative RMSE of irradiance against a fresh f64 solve.
    exact_error_rel: f64,
    exact_frobenius_rel: f64,
    /// The sources' update, the same measure.
    truncated_error_rel: f64,
    drift_rel: f64,
    repairs: u32,
    swap_ms: f64,
    block_patch_ms: f64,
    block_add_ms: f64,
    block_remove_ms: f64,
    product_gb_s: f64,
    copy_gb_s: f64,
    curve: Vec<CurvePoint>,
}

#[derive(Serialize)]
struct CurvePoint {
    swaps: u32,
    exact_rel: f64,
    truncated_rel: f64,
}

/// Runs the suite.
pub(crate) fn run(arguments: &MatrixArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let &MatrixArguments { m, swaps, block, seed } = arguments;
    let clock = || started.elapsed().as_secs_f64();
    let measured = measure_matrix(MatrixBenchParams { m, swaps, block, seed, clock: &clock })?;
    let point = |point: &earthshine_radiosity::bench::ErrorPoint| CurvePoint {
        swaps: point.swaps,
        exact_rel: point.exact_rel,
        truncated_rel: point.truncated_rel,
    };
    let figures = Figures {
        m,
        swaps,
        block,
        accuracy_m: measured.accuracy_m,
        exact_error_rel: measured.exact_error_rel,
        exact_frobenius_rel: measured.exact_frobenius_rel,
        truncated_error_rel: measured.truncated_error_rel,
        drift_rel: measured.drift_rel,
        repairs: measured.repairs,
        swap_ms: measured.swap_ms,
        block_patch_ms: measured.block_patch_ms,
        block_add_ms: measured.block_add_ms,
        block_remove_ms: measured.block_remove_ms,
        product_gb_s: measured.product_gb_s,
        copy_gb_s: measured.copy_gb_s,
        curve: measured.curve.iter().map(point).collect(),
    };
    Report::new("matrix", "closed box", "matrix", seed, clock(), figures).print(json)
}
