//! `bench gpu`: what kernels cost on a graphics adapter, beside a copy in its memory and light by the CPU backend.
//!
//! Needs no files. Times are of the device where it has timestamps, the copy's too; of the clock with the wait for the device
//! otherwise, and of blocks and frames everywhere. The quickest of some rounds counts. Without options it measures what is
//! asked of hardware: blocks at 4,096 patches, the product and frames at 8,192, a step of 10,422, 4,096 alias tables.

use super::Report;
use super::gpu_frame::{DirectFigures, FrameArguments, FrameWork};
use super::gpu_gather::{GatherArguments, GatherFigures, GatherWork};
use super::gpu_matrix::{BlockFigures, MatrixArguments, MatrixBench, copy_rate};
use super::gpu_news::{self, NewsArguments, NewsFigures};
use super::gpu_rays::{self, RayArguments};
use super::gpu_step::{self, StepArguments};
use anyhow::Context as _;
use clap::Args;
use earthshine_gpu::alias::AliasBuilder;
use earthshine_gpu::work::unknown;
use earthshine_gpu::{AdapterChoice, GpuDevice, PassTime, memory};
use earthshine_radiosity::{Backend as _, CpuBackend};
use earthshine_world::random::{Purpose, hash, unit_f32};
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::Instant;

/// Arguments of `bench gpu`.
#[derive(Args)]
pub(crate) struct GpuBenchArguments {
    /// Part of the adapter's name; empty for the best there is. A software adapter has to be named.
    #[arg(long, default_value = "")]
    adapter: String,
    /// Measures kernels that do without subgroups.
    #[arg(long)]
    without_subgroups: bool,
    #[command(flatten)]
    matrix: MatrixArguments,
    /// Rows whose alias tables are built.
    #[arg(long, default_value_t = 4096, value_parser = clap::value_parser!(u32).range(1..))]
    rows: u32,
    /// Items of each of those rows.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..))]
    items: u32,
    #[command(flatten)]
    step: StepArguments,
    #[command(flatten)]
    rays: RayArguments,
    #[command(flatten)]
    frame: FrameArguments,
    #[command(flatten)]
    gather: GatherArguments,
    #[command(flatten)]
    news: NewsArguments,
    /// Rounds of which the quickest counts.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    rounds: u32,
    /// Of everything random.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Serialize)]
struct Figures {
    adapter: String,
    /// Patches of the matrix whose blocks are timed, and that the CPU follows.
    block_m: u32,
    /// Patches of the matrix whose product and frames are timed.
    product_m: u32,
    rows: u32,
    items: u32,
    /// Opening the device and compiling every kernel.
    open_ms: f64,
    /// Largest difference of a patch's irradiance from the CPU backend's, as a share of the brightest.
    irradiance_error_rel: f64,
    #[serde(flatten)]
    blocks: BlockFigures,
    /// The product of a frame, three planes: all its passes over them, and that which adds up what they found.
    product_ms: f64,
    /// Bytes of the planes read in a second of it.
    product_gb_s: f64,
    /// How far the larger matrix is from inverse after all of this, by a probe.
    product_drift_rel: f64,
    /// A copy in the device's memory: bytes read and written in a second, by the same clock as the product.
    copy_gb_s: f64,
    product_share_of_copy: f64,
    /// Direct light of all lit patches and a gather of receivers handed over, a block out, a block in, tables rebuilt, new
    /// sources, the product; until all of that light is on the host.
    frame_ms: f64,
    #[serde(flatten)]
    direct: DirectFigures,
    #[serde(flatten)]
    gather: GatherFigures,
    alias_gitems_s: f64,
    has_timestamps: bool,
    /// Lanes of a subgroup, where kernels use them.
    subgroup_lanes: Option<u32>,
    passes: Vec<Pass>,
    vram_bytes: u64,
    /// A frame of temporal radiosity by cumulative tables.
    step_ms: f64,
    /// The same by alias tables.
    alias_step_ms: f64,
    /// All cumulative tables from form factors on.
    cdf_build_ms: f64,
    /// Rays of a bake through a generated town, on the device.
    mrays_s: f64,
    /// The same rays on all cores of the CPU.
    cpu_mrays_s: f64,
    /// Of those, the share that the device ends on another triangle: within rounding, or along an edge.
    rays_elsewhere: f64,
    /// Of the town.
    ray_triangles: usize,
    #[serde(flatten)]
    news: NewsFigures,
}

/// A kernel's largest runs, the quickest of them: what it moves and computes at least, as
/// [`earthshine_gpu::work`] reckons.
#[derive(Serialize)]
struct Pass {
    name: &'static str,
    ms: f64,
    bytes: Option<f64>,
    flops: Option<f64>,
    /// Bytes a second, as a share of a copy's. Above 1: caches answered.
    copy_share: Option<f64>,
    /// Why bytes and operations are not known.
    unknown: Option<&'static str>,
}

impl Pass {
    fn new(run: &PassTime, copy_gb_s: f64) -> Self {
        let (bytes, flops) = run.work.map(|work| (work.bytes, work.flops)).unzip();
        let copy_share = bytes.map(|bytes| bytes / 1e6 / run.ms.max(1e-9) / copy_gb_s);
        Self { name: run.name, ms: run.ms, bytes, flops, copy_share, unknown: unknown(run.name) }
    }
}

/// Runs the suite.
pub(crate) fn run(arguments: &GpuBenchArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let device = opened(arguments)?;
    let open_ms = started.elapsed().as_secs_f64() * 1e3;
    let (rounds, seed) = (arguments.rounds, arguments.seed);
    let [block_m, product_m] = arguments.matrix.sizes(&device);
    let mut cpu = CpuBackend::new(block_m)?;
    let mut matrix = MatrixBench::new(&device, block_m, seed, Some(&mut cpu))?;
    let irradiance_error_rel = matrix.error_against(&mut cpu)?;
    drop(cpu);
    let blocks = matrix.blocks(rounds)?;
    let block_passes = matrix.take_passes();
    if product_m != block_m {
        // The one is given up before the other is taken.
        drop(matrix);
        matrix = MatrixBench::new(&device, product_m, seed, None)?;
    }
    let town = arguments.rays.town(seed)?;
    let mut frame = FrameWork::new(&device, &arguments.frame, &town, arguments.items, seed)?;
    let mut gather = GatherWork::new(&device, &arguments.gather, seed)?;
    let direct_figures = frame.measure(rounds, &arguments.news)?;
    let gather_figures = gather.measure(rounds, &arguments.news)?;
    let (frame_ms, frame_passes) = matrix.frames(rounds, &mut frame, &mut gather)?;
    let slots = matrix.slots();
    let news = gpu_news::measure(&device, matrix.backend(), &slots, &arguments.news)?;
    let product_ms = matrix.product_ms(rounds)?;
    let product_gb_s = 3.0 * memory::plane_bytes(product_m) as f64 / 1e6 / product_ms.max(1e-9);
    let (copy_gb_s, copy_passes) = copy_rate(&device, product_m, rounds)?;
    let product_drift_rel = f64::from(matrix.backend().drift(seed));
    let product_passes = matrix.take_passes();
    let (alias_gitems_s, alias_passes) = alias_rate(&device, arguments)?;
    let step = gpu_step::measure(&device, &arguments.step, rounds, seed)?;
    let rays = gpu_rays::measure(&device, &arguments.rays, &town, rounds, seed)?;
    let of_matrix = [block_passes, product_passes, copy_passes].concat();
    let all = [of_matrix, step.passes, rays.passes, frame_passes, alias_passes].concat();
    let passes = largest_quickest(&all).into_values().map(|run| Pass::new(&run, copy_gb_s)).collect();
    let figures = Figures {
        adapter: device.name().to_owned(),
        block_m,
        product_m,
        rows: arguments.rows,
        items: arguments.items,
        open_ms,
        irradiance_error_rel,
        blocks,
        product_ms,
        product_gb_s,
        product_drift_rel,
        copy_gb_s,
        product_share_of_copy: product_gb_s / copy_gb_s,
        frame_ms,
        direct: direct_figures,
        gather: gather_figures,
        alias_gitems_s,
        has_timestamps: matrix.has_timestamps(),
        subgroup_lanes: device.subgroup_lanes(),
        passes,
        vram_bytes: memory::device_bytes(product_m),
        step_ms: step.step_ms,
        alias_step_ms: step.alias_step_ms,
        cdf_build_ms: step.cdf_build_ms,
        mrays_s: rays.mrays_s,
        cpu_mrays_s: rays.cpu_mrays_s,
        rays_elsewhere: rays.elsewhere,
        ray_triangles: rays.triangles,
        news,
    };
    let seconds = started.elapsed().as_secs_f64();
    let mut report = Report::new("gpu", "closed room", "matrix", seed, seconds, figures);
    report.backend = "gpu";
    report.print(json)
}

fn opened(arguments: &GpuBenchArguments) -> anyhow::Result<GpuDevice> {
    let choice = AdapterChoice {
        name: arguments.adapter.clone(),
        allow_software: false,
        without_subgroups: arguments.without_subgroups,
    };
    GpuDevice::open(&choice).context("no device to measure; `earthshine gpu` lists adapters")
}

/// Of each kernel the run that moved most, and of those the quickest.
fn largest_quickest(passes: &[PassTime]) -> BTreeMap<&'static str, PassTime> {
    let mut best = BTreeMap::<&'static str, PassTime>::new();
    let size = |pass: &PassTime| pass.work.map_or(0.0, |work| work.bytes);
    for pass in passes {
        let held = best.entry(pass.name).or_insert(*pass);
        if size(pass) > size(held) || (size(pass) == size(held) && pass.ms < held.ms) {
            *held = *pass;
        }
    }
    best
}

/// Items a second in 10^9, and the passes where the device can tell.
fn alias_rate(device: &GpuDevice, arguments: &GpuBenchArguments) -> anyhow::Result<(f64, Vec<PassTime>)> {
    let (rows, items) = (arguments.rows as usize, arguments.items as usize);
    let mut builder = AliasBuilder::new(device, &vec![items; rows])?;
    let weight = |at: u64| unit_f32(hash(arguments.seed, Purpose::Simulation, at, 0));
    builder.set_weights(&(0..(rows * items) as u64).map(weight).collect::<Vec<f32>>())?;
    let is_timed = builder.time_passes()?;
    let (mut best, mut best_pass, mut passes) = (f64::INFINITY, f64::INFINITY, Vec::new());
    for _ in 0..arguments.rounds.max(1) {
        builder.finish()?;
        let start = Instant::now();
        builder.build()?;
        builder.finish()?;
        best = best.min(start.elapsed().as_secs_f64() * 1e3);
        let times = builder.take_times()?;
        best_pass = times.iter().fold(best_pass, |best, pass| best.min(pass.ms));
        passes.extend(times);
    }
    let ms = if is_timed { best_pass } else { best };
    Ok(((rows * items) as f64 / 1e6 / ms.max(1e-9), passes))
}
