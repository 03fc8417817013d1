//! `bench matrix`: adds and removals against a fresh solve, and the time they take.

use super::Report;
use crate::output::out;
use clap::Args;
use earthshine_radiosity::LocalMatrix;
use earthshine_radiosity::bench::{MatrixBenchParams, MatrixFigures, Timing, measure_matrix};
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
    /// Exact updates, planes rounded to 16-bit floats after each block: the same measure.
    halved_error_rel: f64,
    drift_rel: f64,
    repairs: u32,
    /// One patch out and one in, singly, all threads.
    swap_ms: f64,
    /// Per patch of a block that leaves and a block that enters; every patch sees every other.
    block_patch_ms: f64,
    block_add_ms: f64,
    block_remove_ms: f64,
    /// The same where the patches that enter see `seen_columns` slots together.
    block_patch_sparse_ms: f64,
    seen_columns: u32,
    step_ms: f64,
    /// With an eighth of the slots of interest.
    step_interest_ms: f64,
    repair_patch_ms: f64,
    /// Bytes really read: half of the matrix is stored.
    product_gb_s: f64,
    copy_gb_s: f64,
    threads: usize,
    swap_ms_one_core: f64,
    block_patch_ms_one_core: f64,
    block_add_ms_one_core: f64,
    block_remove_ms_one_core: f64,
    block_patch_sparse_ms_one_core: f64,
    step_ms_one_core: f64,
    repair_patch_ms_one_core: f64,
    product_gb_s_one_core: f64,
    copy_gb_s_one_core: f64,
    remove_gflop_s_one_core: f64,
    peak_gflop_s_one_core: f64,
    matrix_bytes: u64,
    curve: Vec<CurvePoint>,
}

#[derive(Serialize)]
struct CurvePoint {
    swaps: u32,
    exact_rel: f64,
    truncated_rel: f64,
    halved_rel: f64,
}

/// Runs the suite.
pub(crate) fn run(arguments: &MatrixArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let &MatrixArguments { m, swaps, block, seed } = arguments;
    let clock = || started.elapsed().as_secs_f64();
    let measured = measure_matrix(MatrixBenchParams { m, swaps, block, seed, clock: &clock })?;
    let (all, one) = (&measured.timing, &measured.one_core);
    if !json {
        return print_text(arguments, &measured);
    }
    let point = |point: &earthshine_radiosity::bench::ErrorPoint| CurvePoint {
        swaps: point.swaps,
        exact_rel: point.exact_rel,
        truncated_rel: point.truncated_rel,
        halved_rel: point.halved_rel,
    };
    let figures = Figures {
        m,
        swaps,
        block,
        accuracy_m: measured.accuracy_m,
        exact_error_rel: measured.exact_error_rel,
        exact_frobenius_rel: measured.exact_frobenius_rel,
        truncated_error_rel: measured.truncated_error_rel,
        halved_error_rel: measured.halved_error_rel,
        drift_rel: measured.drift_rel,
        repairs: measured.repairs,
        swap_ms: all.swap_ms,
        block_patch_ms: (all.add_ms + all.remove_ms) / 2.0,
        block_add_ms: all.add_ms,
        block_remove_ms: all.remove_ms,
        block_patch_sparse_ms: (all.sparse_add_ms + all.remove_ms) / 2.0,
        seen_columns: all.seen_columns,
        step_ms: all.step_ms,
        step_interest_ms: all.interest_step_ms,
        repair_patch_ms: all.repair_patch_ms,
        product_gb_s: all.product_gb_s,
        copy_gb_s: all.copy_gb_s,
        threads: all.threads,
        swap_ms_one_core: one.swap_ms,
        block_patch_ms_one_core: (one.add_ms + one.remove_ms) / 2.0,
        block_add_ms_one_core: one.add_ms,
        block_remove_ms_one_core: one.remove_ms,
        block_patch_sparse_ms_one_core: (one.sparse_add_ms + one.remove_ms) / 2.0,
        step_ms_one_core: one.step_ms,
        repair_patch_ms_one_core: one.repair_patch_ms,
        product_gb_s_one_core: one.product_gb_s,
        copy_gb_s_one_core: one.copy_gb_s,
        remove_gflop_s_one_core: one.remove_gflop_s,
        peak_gflop_s_one_core: one.peak_gflop_s,
        matrix_bytes: LocalMatrix::bytes(m),
        curve: measured.curve.iter().map(point).collect(),
    };
    Report::new("matrix", "closed box", "matrix", seed, clock(), figures).print(json)
}

/// Takes one figure out of what was timed.
type Figure = fn(&Timing) -> f64;

/// The figures as a table for people; the best of several rounds each.
fn print_text(arguments: &MatrixArguments, measured: &MatrixFigures) -> anyhow::Result<()> {
    let &MatrixArguments { m, swaps, block, seed } = arguments;
    out!("matrix of {m} slots, {:.1} MiB, blocks of {block}, seed {seed}", mebibytes(LocalMatrix::bytes(m)));
    out!("");
    out!("exactness, {} slots, {swaps} swaps, relative to a fresh f64 solve", measured.accuracy_m);
    out!("  {:>10}  {:>12}  {:>16}  {:>13}", "swaps", "exact update", "sources' update", "16-bit floats");
    for point in &measured.curve {
        let [exact, truncated, halved] = [point.exact_rel, point.truncated_rel, point.halved_rel];
        out!("  {:>10}  {exact:>12.2e}  {truncated:>16.2e}  {halved:>13.2e}", point.swaps);
    }
    out!("  drift after all: {:.2e} in {} repairs", measured.drift_rel, measured.repairs);
    out!("");
    let (all, one) = (&measured.timing, &measured.one_core);
    let threads = format!("{} threads", all.threads);
    out!("{:<44}  {threads:>10}  {:>10}", "time, best of several rounds", "1 thread");
    let rows: [(&str, &str, Figure); 11] = [
        ("patch added, in a block, sees all", "ms", |t| t.add_ms),
        ("patch added, in a block, sees few", "ms", |t| t.sparse_add_ms),
        ("patch removed, in a block", "ms", |t| t.remove_ms),
        ("patch added or removed, mean, sees all", "ms", |t| (t.add_ms + t.remove_ms) / 2.0),
        ("one patch out, one in, singly", "ms", |t| t.swap_ms),
        ("patch repaired", "ms", |t| t.repair_patch_ms),
        ("light of a frame", "ms", |t| t.step_ms),
        ("light of a frame, an eighth of interest", "ms", |t| t.interest_step_ms),
        ("product, bytes really read", "GB/s", |t| t.product_gb_s),
        ("plain copy, read and written", "GB/s", |t| t.copy_gb_s),
        ("removal, of the peak of multiply-adds", "%", |t| 100.0 * t.remove_gflop_s / t.peak_gflop_s),
    ];
    for (what, unit, value) in rows {
        out!("  {:<42}  {:>10.3}  {:>10.3}  {unit}", what, value(all), value(one));
    }
    out!("\"sees few\": the block's patches see {} slots together", all.seen_columns);
    Ok(())
}

fn mebibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}
