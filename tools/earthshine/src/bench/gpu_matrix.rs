//! `bench gpu`: the local matrix on a device: blocks that enter and leave, the product of a frame, and whole frames around
//! them.
//!
//! A closed room, each patch of which sees five sixths of the others: the worst case for updates. One matrix for blocks,
//! small enough that the CPU follows it as an oracle, and one for the product and frames.

use super::gpu_frame::FrameWork;
use super::gpu_gather::GatherWork;
use clap::Args;
use earthshine_gpu::copy_bench::CopyBench;
use earthshine_gpu::{GpuBackend, GpuDevice, PassTime, memory};
use earthshine_radiosity::bench::Streamed;
use earthshine_radiosity::closed_box::ClosedBox;
use earthshine_radiosity::{Backend, CpuBackend, Slot, Update};
use earthshine_world::Rgb;
use serde::Serialize;
use std::time::Instant;

/// How many patches.
#[derive(Args)]
pub(super) struct MatrixArguments {
    /// Patches of both matrices, at least a block; see the other two.
    #[arg(long, value_parser = clap::value_parser!(u32).range(BLOCK as i64..))]
    m: Option<u32>,
    /// Patches of the matrix whose blocks are timed [default: 4096, on a software adapter 1024].
    #[arg(long, value_parser = clap::value_parser!(u32).range(BLOCK as i64..))]
    block_m: Option<u32>,
    /// Patches of the matrix whose product and frames are timed [default: 8192, on a software adapter 1024].
    #[arg(long, value_parser = clap::value_parser!(u32).range(BLOCK as i64..))]
    product_m: Option<u32>,
}

impl MatrixArguments {
    /// Patches of the matrix whose blocks are timed, and of the other.
    pub(super) fn sizes(&self, device: &GpuDevice) -> [u32; 2] {
        let default = if device.is_software() { SOFTWARE_SIZES } else { SIZES };
        let [block, product] = default.map(|size| self.m.unwrap_or(size));
        [self.block_m.unwrap_or(block), self.product_m.unwrap_or(product)]
    }
}

const SIZES: [u32; 2] = [4096, 8192];
const SOFTWARE_SIZES: [u32; 2] = [1024, 1024];
/// Patches that leave and enter together.
const BLOCK: usize = 32;
/// Patches that enter at once to fill a matrix.
const FILL: usize = 256;
/// Without timestamps a clock times so many products or copies together, and the wait for them.
const REPEATS: u32 = 16;
/// Least bytes of a copy: more than caches hold.
const COPY_BYTES_MIN: u64 = 64 << 20;

/// Time of a block, us a patch.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct BlockFigures {
    /// One that enters or one that leaves, whichever takes longer.
    block_patch_us: f64,
    /// From the call until the device has done it: what the host does with the rows, submission and wait included.
    add_patch_us: f64,
    remove_patch_us: f64,
    /// Of that, all passes on the device; none where it cannot tell.
    add_patch_device_us: Option<f64>,
    remove_patch_device_us: Option<f64>,
}

/// A full matrix and what happens to it.
pub(super) struct MatrixBench {
    streamed: Streamed,
    backend: GpuBackend,
    has_timestamps: bool,
    passes: Vec<PassTime>,
    round: u32,
}

impl MatrixBench {
    /// Of `m` patches; the other backend, if any, is told the same.
    pub(super) fn new(
        device: &GpuDevice,
        m: u32,
        seed: u64,
        mut beside: Option<&mut CpuBackend>,
    ) -> anyhow::Result<Self> {
        let room = ClosedBox::new(m as usize + BLOCK, seed);
        let mut streamed = Streamed::new(room, m as usize, seed);
        let mut backend = GpuBackend::new(device, m)?;
        loop {
            let updates = streamed.enter(FILL);
            if updates.is_empty() {
                break;
            }
            backend.apply(&updates)?;
            if let Some(cpu) = &mut beside {
                cpu.apply(&updates)?;
            }
        }
        let has_timestamps = backend.time_passes()?;
        Ok(Self { streamed, backend, has_timestamps, passes: Vec::new(), round: 0 })
    }

    /// Largest difference of a patch's irradiance from that of `cpu`, which was told the same, after a block was swapped on
    /// both; as a share of the brightest.
    pub(super) fn error_against(&mut self, cpu: &mut CpuBackend) -> anyhow::Result<f64> {
        for updates in self.swapped() {
            self.backend.apply(&updates)?;
            cpu.apply(&updates)?;
        }
        let slots = self.slots();
        let light: Vec<Rgb> = slots.iter().map(|&slot| self.streamed.source(slot)).collect();
        let both: [&mut dyn Backend; 2] = [&mut self.backend, cpu];
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

    pub(super) fn backend(&mut self) -> &mut GpuBackend {
        &mut self.backend
    }

    /// Taken slots.
    pub(super) fn slots(&self) -> Vec<Slot> {
        self.streamed.taken()
    }

    pub(super) fn has_timestamps(&self) -> bool {
        self.has_timestamps
    }

    /// All passes since the last call.
    pub(super) fn take_passes(&mut self) -> Vec<PassTime> {
        std::mem::take(&mut self.passes)
    }

    /// The passes since they were last collected; they are kept for [`Self::take_passes`] as well.
    fn collected(&mut self) -> anyhow::Result<Vec<PassTime>> {
        let passes = self.backend.take_times()?;
        self.passes.extend(&passes);
        Ok(passes)
    }

    /// Seeded updates that take a block out and another in.
    fn swapped(&mut self) -> [Vec<Update>; 2] {
        [self.streamed.leave(BLOCK), self.streamed.enter(BLOCK)]
    }

    /// The quickest block that leaves and the quickest that enters.
    pub(super) fn blocks(&mut self, rounds: u32) -> anyhow::Result<BlockFigures> {
        let (mut wall_us, mut device_us) = ([f64::INFINITY; 2], [f64::INFINITY; 2]);
        for _ in 0..rounds {
            for (of, updates) in self.swapped().iter().enumerate() {
                self.backend.finish()?;
                self.collected()?;
                let start = Instant::now();
                self.backend.apply(updates)?;
                self.backend.finish()?;
                wall_us[of] = wall_us[of].min(start.elapsed().as_secs_f64() * 1e6 / BLOCK as f64);
                let passes_ms: f64 = self.collected()?.iter().map(|pass| pass.ms).sum();
                device_us[of] = device_us[of].min(passes_ms * 1e3 / BLOCK as f64);
            }
        }
        let [remove_patch_us, add_patch_us] = wall_us;
        let [remove_patch_device_us, add_patch_device_us] =
            device_us.map(|us| self.has_timestamps.then_some(us));
        Ok(BlockFigures {
            block_patch_us: add_patch_us.max(remove_patch_us),
            add_patch_us,
            remove_patch_us,
            add_patch_device_us,
            remove_patch_device_us,
        })
    }

    /// New light for every slot.
    fn relight(&mut self, slots: &[Slot]) -> anyhow::Result<()> {
        self.round += 1;
        let light = vec![Rgb::splat(1.0 + self.round as f32); slots.len()];
        Ok(self.backend.set_sources(slots, &light, &light)?)
    }

    /// The quickest product of a frame, ms: its passes over the planes, of all their parts, and that which adds up what they
    /// found. By the device's clock, else by the host's, for whole steps.
    pub(super) fn product_ms(&mut self, rounds: u32) -> anyhow::Result<f64> {
        let slots = self.slots();
        let mut best = f64::INFINITY;
        for _ in 0..rounds {
            let repeats = if self.has_timestamps { 1 } else { REPEATS };
            self.backend.finish()?;
            self.collected()?;
            let start = Instant::now();
            for _ in 0..repeats {
                self.relight(&slots)?;
                self.backend.step()?;
            }
            self.backend.finish()?;
            let wall_ms = start.elapsed().as_secs_f64() * 1e3 / f64::from(repeats);
            let of_product = |pass: &&PassTime| matches!(pass.name, "multiply_tiles" | "sum_tiles");
            let passes = self.collected()?;
            let ms: f64 = passes.iter().filter(of_product).map(|pass| pass.ms).sum();
            best = best.min(if self.has_timestamps { ms } else { wall_ms });
        }
        Ok(best)
    }

    /// The quickest frame, ms, and the passes of direct light and gathers in all of them.
    pub(super) fn frames(
        &mut self,
        rounds: u32,
        work: &mut FrameWork,
        gather: &mut GatherWork,
    ) -> anyhow::Result<(f64, Vec<PassTime>)> {
        // Times of what was measured before are not theirs.
        work.take_times()?;
        gather.take_times()?;
        let mut best = f64::INFINITY;
        for _ in 0..rounds {
            best = best.min(self.frame(work, gather)?);
            self.collected()?;
        }
        Ok((best, [work.take_times()?, gather.take_times()?].concat()))
    }

    /// As in the engine: what is handed over first is on its way while the matrix is updated. ms.
    fn frame(&mut self, work: &mut FrameWork, gather: &mut GatherWork) -> anyhow::Result<f64> {
        let updates = self.swapped();
        let slots = self.slots();
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

/// GB/s of a copy of as much as a plane of `m` slots, and more where caches would answer; by the device's clock, as the
/// product, else by the host's. And all copies.
pub(super) fn copy_rate(device: &GpuDevice, m: u32, rounds: u32) -> anyhow::Result<(f64, Vec<PassTime>)> {
    let most = device.binding_bytes_max();
    let bytes = memory::plane_bytes(m).max(COPY_BYTES_MIN).min(most).next_multiple_of(16);
    let mut copy = CopyBench::new(device, bytes)?;
    let is_timed = copy.time_passes()?;
    let repeats = if is_timed { 1 } else { REPEATS };
    let (mut best_ms, mut passes) = (f64::INFINITY, Vec::new());
    for _ in 0..rounds {
        let start = Instant::now();
        copy.run(repeats)?;
        let wall_ms = start.elapsed().as_secs_f64() * 1e3;
        let times = copy.take_times()?;
        best_ms = best_ms.min(if is_timed { times.iter().map(|pass| pass.ms).sum() } else { wall_ms });
        passes.extend(times);
    }
    Ok((copy.moved_bytes(repeats) / 1e6 / best_ms.max(1e-9), passes))
}
