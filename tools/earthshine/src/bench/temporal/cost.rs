//! What a frame costs on one core: every solver, and a dense product of as many patches in the same run.

use super::response::Response;
use super::subset::{SETTLE_STEPS, Subset};
use earthshine_radiosity::Backend;
use earthshine_radiosity::solver::{Method, SolverSettings};
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Frames that are timed after a change of light.
const FRAMES: usize = 8;
/// Frames timed with nothing changing.
const IDLE_FRAMES: u32 = 50;
/// Most bytes of one dense plane that is multiplied: a channel of 16,000 patches.
const DENSE_BYTES_MAX: usize = 1 << 30;
/// Planes of a multibounce matrix: one a channel.
const CHANNELS: f64 = 3.0;

/// Costs at one number of patches.
#[derive(Debug, Serialize)]
pub(super) struct Cost {
    pub(super) n: usize,
    pub(super) links_per_row: f64,
    /// A product with three full planes of f32.
    pub(super) dense_ns_per_patch_frame: Option<f64>,
    pub(super) dense_gb_s: Option<f64>,
    /// Read and written.
    pub(super) copy_gb_s: f64,
    pub(super) solvers: Vec<SolverCost>,
}

/// One solver's.
#[derive(Debug, Serialize)]
pub(super) struct SolverCost {
    pub(super) solver: &'static str,
    /// Mean over the first frames after a change of light.
    pub(super) ns_per_patch_frame: f64,
    pub(super) worst_ns_per_patch_frame: f64,
    /// With nothing changing, once it has come to rest, if it does.
    pub(super) idle_ns_per_patch_frame: f64,
    pub(super) speedup_over_dense: Option<f64>,
    /// With as many draws as bring its steady error (of the errors' part of this run) to 1 %; exact solvers as they are.
    pub(super) speedup_over_dense_at_1_percent: Option<f64>,
}

pub(super) fn measure(
    subset: &mut Subset,
    methods: &[Method],
    settings: &SolverSettings,
    responses: &[Response],
) -> anyhow::Result<Cost> {
    let n = subset.patch_count();
    let dense = dense_ns(n);
    let mut solvers = Vec::new();
    for &method in methods {
        let (mean, worst, idle) = frames(subset, SolverSettings { method, ..*settings })?;
        let error = responses.iter().find(|response| response.solver == method.name());
        let more = error.map_or(1.0, |response| (response.steady_rel_rmse / 0.01).powi(2)).max(1e-9);
        let at_1_percent = if method.is_endless() { mean * more } else { mean };
        solvers.push(SolverCost {
            solver: method.name(),
            ns_per_patch_frame: mean,
            worst_ns_per_patch_frame: worst,
            idle_ns_per_patch_frame: idle,
            speedup_over_dense: dense.map(|dense| dense / mean),
            speedup_over_dense_at_1_percent: dense.map(|dense| dense / at_1_percent),
        });
    }
    Ok(Cost {
        n,
        links_per_row: subset.link_count() as f64 / n as f64,
        dense_ns_per_patch_frame: dense,
        dense_gb_s: dense.map(|ns| CHANNELS * 4.0 * n as f64 / ns),
        copy_gb_s: copy_gb_s(),
        solvers,
    })
}

/// Mean and worst of the first frames after a change, and of idle ones, ns a patch.
fn frames(subset: &mut Subset, settings: SolverSettings) -> anyhow::Result<(f64, f64, f64)> {
    let count = subset.patch_count() as f64;
    subset.settle(false)?;
    subset.switch(&settings)?;
    subset.shine(true)?;
    let (mut sum, mut worst) = (0.0, 0.0f64);
    for _ in 0..FRAMES {
        let started = Instant::now();
        subset.backend.step()?;
        let ns = started.elapsed().as_secs_f64() * 1e9 / count;
        sum += ns;
        worst = worst.max(ns);
    }
    let is_endless = settings.method.is_endless();
    let mut steps = 0;
    while !is_endless && !subset.backend.is_settled() {
        anyhow::ensure!(steps < SETTLE_STEPS, "{} did not settle in {SETTLE_STEPS} frames", settings.method);
        subset.backend.step()?;
        steps += 1;
    }
    let idle_frames = if is_endless { FRAMES as u32 } else { IDLE_FRAMES };
    let started = Instant::now();
    for _ in 0..idle_frames {
        subset.backend.step()?;
    }
    let idle = started.elapsed().as_secs_f64() * 1e9 / count / f64::from(idle_frames);
    Ok((sum / FRAMES as f64, worst, idle))
}

/// Three products of a plane of `n` x `n` numbers, ns a row; nothing where the plane is too large. Best of some.
fn dense_ns(n: usize) -> Option<f64> {
    let len = n.checked_mul(n).filter(|&len| len * size_of::<f32>() <= DENSE_BYTES_MAX)?;
    let plane: Vec<f32> = (0..len).map(|at| (at % 251) as f32).collect();
    let light: Vec<f32> = (0..n).map(|at| (at % 7) as f32).collect();
    let mut best = f64::INFINITY;
    for _ in 0..5 {
        let started = Instant::now();
        for row in plane.chunks_exact(n) {
            black_box(dot(row, &light));
        }
        best = best.min(started.elapsed().as_secs_f64());
    }
    Some(CHANNELS * best * 1e9 / n as f64)
}

fn dot(row: &[f32], light: &[f32]) -> f32 {
    let mut sums = [0.0f32; 32];
    let (rows, lights) = (row.as_chunks::<32>(), light.as_chunks::<32>());
    for (row, light) in rows.0.iter().zip(lights.0) {
        for ((sum, share), light) in sums.iter_mut().zip(row).zip(light) {
            *sum += share * light;
        }
    }
    let rest: f32 = rows.1.iter().zip(lights.1).map(|(share, light)| share * light).sum();
    sums.iter().sum::<f32>() + rest
}

/// Of a plain copy that no cache holds.
fn copy_gb_s() -> f64 {
    const BYTES: usize = 256 << 20;
    let from = vec![1u8; BYTES];
    let mut to = vec![0u8; BYTES];
    let mut best = f64::INFINITY;
    for _ in 0..4 {
        let started = Instant::now();
        to.copy_from_slice(black_box(&from));
        black_box(&to);
        best = best.min(started.elapsed().as_secs_f64());
    }
    2.0 * BYTES as f64 / best / 1e9
}
