//! `bench gpu`: what kernels cost on a graphics adapter, beside a copy in its memory and light by the CPU backend.
//!
//! Needs no files: a closed room of `--m` patches, each seeing five sixths of the others, the worst case for updates. Times
//! are of the device where it has timestamps (`passes`), of the clock with the wait for the device otherwise; the
//! quickest of some rounds counts.

use super::Report;
use super::gpu_frame::{DirectFigures, FrameArguments, FrameWork};
use super::gpu_gather::{GatherArguments, GatherFigures, GatherWork};
use super::gpu_news::{self, NewsArguments, NewsFigures};
use super::gpu_rays::{self, RayArguments};
use super::gpu_step::{self, StepArguments};
use anyhow::Context as _;
use clap::Args;
use earthshine_gpu::alias::AliasBuilder;
use earthshine_gpu::copy_bench::CopyBench;
use earthshine_gpu::work::unknown;
use earthshine_gpu::{AdapterChoice, GpuBackend, GpuDevice, PassTime, memory};
use earthshine_radiosity::bench::Streamed;
use earthshine_radiosity::closed_box::ClosedBox;
use earthshine_radiosity::{Backend, CpuBackend, Slot, Update};
use earthshine_world::Rgb;
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
    /// Patches of the matrix, at least a block.
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(BLOCK as i64..))]
    m: u32,
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

/// Patches that leave and enter together.
const BLOCK: usize = 32;

#[derive(Serialize)]
struct Figures {
    adapter: String,
    m: u32,
    rows: u32,
    items: u32,
    /// Opening the device and compiling every kernel.
    open_ms: f64,
    /// Largest difference of a patch's irradiance from the CPU backend's, as a share of the brightest.
    irradiance_error_rel: f64,
    /// Per patch of a block that leaves and a block that enters, waits included.
    block_patch_us: f64,
    /// The product of a frame: bytes of the planes read in a second.
    product_gb_s: f64,
    /// A copy in the device's memory: bytes read and written in a second.
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
    let choice = AdapterChoice {
        name: arguments.adapter.clone(),
        allow_software: false,
        without_subgroups: arguments.without_subgroups,
    };
    let device = GpuDevice::open(&choice).context("no device to measure; `earthshine gpu` lists adapters")?;
    let open_ms = started.elapsed().as_secs_f64() * 1e3;
    let mut bench = Bench::new(&device, arguments)?;
    let irradiance_error_rel = bench.error_against_cpu()?;
    let town = arguments.rays.town(arguments.seed)?;
    let mut frame = FrameWork::new(&device, &arguments.frame, &town, arguments.items, arguments.seed)?;
    let mut gather = GatherWork::new(&device, &arguments.gather, arguments.seed)?;
    let direct_figures = frame.measure(arguments.rounds, &arguments.news)?;
    let gather_figures = gather.measure(arguments.rounds, &arguments.news)?;
    let (frame_ms, frame_passes) = bench.frames(arguments.rounds, &mut frame, &mut gather)?;
    let block_patch_us = bench.quickest(arguments.rounds, Bench::swap)? * 1e3 / (2 * BLOCK) as f64;
    let slots = bench.streamed.taken();
    let news = gpu_news::measure(&device, &mut bench.backend, &slots, &arguments.news)?;
    let product_wall_ms = bench.quickest(arguments.rounds, Bench::product)?;
    let product = largest_quickest(&bench.passes).remove("multiply_tiles");
    let product_ms = product.map_or(product_wall_ms, |pass| 3.0 * pass.ms);
    let plane_bytes = memory::plane_bytes(arguments.m) as f64;
    let product_gb_s = 3.0 * plane_bytes / 1e6 / product_ms.max(1e-6);
    let copy_gb_s = copy_rate(&device, arguments)?;
    let (alias_gitems_s, alias_passes) = alias_rate(&device, arguments)?;
    let step = gpu_step::measure(&device, &arguments.step, arguments.rounds, arguments.seed)?;
    let rays = gpu_rays::measure(&device, &arguments.rays, &town, arguments.rounds, arguments.seed)?;
    let all = [bench.passes, step.passes, rays.passes, frame_passes, alias_passes].concat();
    let passes = largest_quickest(&all).into_values().map(|run| Pass::new(&run, copy_gb_s)).collect();
    let figures = Figures {
        adapter: device.name().to_owned(),
        m: arguments.m,
        rows: arguments.rows,
        items: arguments.items,
        open_ms,
        irradiance_error_rel,
        block_patch_us,
        product_gb_s,
        copy_gb_s,
        product_share_of_copy: product_gb_s / copy_gb_s,
        frame_ms,
        direct: direct_figures,
        gather: gather_figures,
        alias_gitems_s,
        has_timestamps: bench.has_timestamps,
        subgroup_lanes: device.subgroup_lanes(),
        passes,
        vram_bytes: memory::device_bytes(arguments.m),
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
    let mut report = Report::new("gpu", "closed room", "matrix", arguments.seed, seconds, figures);
    report.backend = "gpu";
    report.print(json)
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

/// A full matrix and what happens to it.
struct Bench {
    streamed: Streamed,
    backend: GpuBackend,
    cpu: CpuBackend,
    has_timestamps: bool,
    passes: Vec<PassTime>,
    round: u32,
}

impl Bench {
    fn new(device: &GpuDevice, arguments: &GpuBenchArguments) -> anyhow::Result<Self> {
        let m = arguments.m as usize;
        let room = ClosedBox::new(m + BLOCK, arguments.seed);
        let mut streamed = Streamed::new(room, m, arguments.seed);
        let (mut backend, mut cpu) = (GpuBackend::new(device, arguments.m)?, CpuBackend::new(arguments.m)?);
        let updates = streamed.enter(m);
        backend.apply(&updates)?;
        cpu.apply(&updates)?;
        let has_timestamps = backend.time_passes()?;
        Ok(Self { streamed, backend, cpu, has_timestamps, passes: Vec::new(), round: 0 })
    }

    /// Light by both backends after a block was swapped on both.
    fn error_against_cpu(&mut self) -> anyhow::Result<f64> {
        for updates in [self.streamed.leave(BLOCK), self.streamed.enter(BLOCK)] {
            self.backend.apply(&updates)?;
            self.cpu.apply(&updates)?;
        }
        let slots = self.streamed.taken();
        let light: Vec<Rgb> = slots.iter().map(|&slot| self.streamed.source(slot)).collect();
        let both: [&mut dyn Backend; 2] = [&mut self.backend, &mut self.cpu];
        let mut irradiance = [vec![Rgb::ZERO; slots.len()], vec![Rgb::ZERO; slots.len()]];
        for (backend, out) in both.into_iter().zip(&mut irradiance) {
            backend.set_sources(&slots, &light, &light)?;
            backend.step()?;
            backend.read_irradiance(&slots, out)?;
        }
        let brightest = irradiance[1].iter().map(|light| light.max_element()).fold(0.0, f32::max);
        let gaps = irradiance[0].iter().zip(&irradiance[1]).map(|(a, b)| (*a - *b).abs().max_element());
        Ok(f64::from(gaps.fold(0.0, f32::max) / brightest))
    }

    /// The quickest of `rounds` rounds, ms.
    fn quickest(
        &mut self,
        rounds: u32,
        mut run: impl FnMut(&mut Self) -> anyhow::Result<f64>,
    ) -> anyhow::Result<f64> {
        let mut best = f64::INFINITY;
        for _ in 0..rounds.max(1) {
            self.round += 1;
            best = best.min(run(self)?);
            self.passes.extend(self.backend.take_times()?);
        }
        Ok(best)
    }

    /// Seeded updates that take a block out and another in.
    fn swapped(&mut self) -> [Vec<Update>; 2] {
        [self.streamed.leave(BLOCK), self.streamed.enter(BLOCK)]
    }

    /// ms.
    fn swap(&mut self) -> anyhow::Result<f64> {
        let updates = self.swapped();
        self.backend.finish()?;
        let start = Instant::now();
        for updates in &updates {
            self.backend.apply(updates)?;
        }
        self.backend.finish()?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// New light for every slot.
    fn relight(&mut self, slots: &[Slot]) -> anyhow::Result<()> {
        let light = vec![Rgb::splat(1.0 + self.round as f32); slots.len()];
        Ok(self.backend.set_sources(slots, &light, &light)?)
    }

    /// ms.
    fn product(&mut self) -> anyhow::Result<f64> {
        let slots = self.streamed.taken();
        self.relight(&slots)?;
        self.backend.finish()?;
        let start = Instant::now();
        self.backend.step()?;
        self.backend.finish()?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// The quickest of `rounds` frames, ms, and the passes of direct light and gathers in all of them.
    fn frames(
        &mut self,
        rounds: u32,
        work: &mut FrameWork,
        gather: &mut GatherWork,
    ) -> anyhow::Result<(f64, Vec<PassTime>)> {
        // Times of what was measured before are not theirs.
        work.take_times()?;
        gather.take_times()?;
        let best = self.quickest(rounds, |bench| bench.frame(work, gather))?;
        Ok((best, [work.take_times()?, gather.take_times()?].concat()))
    }

    /// As in the engine: what is handed over first is on its way while the matrix is updated. ms.
    fn frame(&mut self, work: &mut FrameWork, gather: &mut GatherWork) -> anyhow::Result<f64> {
        let updates = self.swapped();
        let slots = self.streamed.taken();
        let mut irradiance = vec![Rgb::ZERO; slots.len()];
        let start = Instant::now();
        let direct = work.begin()?;
        gather.begin()?;
        for updates in &updates {
            self.backend.apply(updates)?;
        }
        self.relight(&slots)?;
        self.backend.step()?;
        self.backend.read_irradiance(&slots, &mut irradiance)?;
        direct.wait()?;
        gather.wait()?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }
}

/// GB/s of a copy of as much as a plane, at least 16 MiB so that caches do not answer.
fn copy_rate(device: &GpuDevice, arguments: &GpuBenchArguments) -> anyhow::Result<f64> {
    let most = device.binding_bytes_max();
    let bytes = memory::plane_bytes(arguments.m).max(16 << 20).min(most).next_multiple_of(16);
    let copy = CopyBench::new(device, bytes)?;
    let mut best = f64::INFINITY;
    for _ in 0..arguments.rounds.max(1) {
        let start = Instant::now();
        copy.run(1)?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    // There and back, read and written.
    Ok(4.0 * bytes as f64 / 1e9 / best.max(1e-9))
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
