//! What updates and products cost on a full matrix, beside what the machine can do.

use super::{ClosedBox, MatrixBenchError, Streamed};
use crate::backend::{Backend, BackendError, Slot, Update};
use crate::cpu::CpuBackend;
use crate::kernel::Scalar;
use crate::local_matrix::LocalMatrix;
use crate::simd::InstructionSet;
use crate::tile_kernel::PeakRate;
use earthshine_world::Rgb;
use rayon::prelude::*;

/// Repetitions; the quickest counts: others' work can only add time.
const ROUNDS: usize = 12;
/// Most bytes copied to measure the memory.
const COPY_BYTES_MAX: usize = 256 << 20;
/// Numbers copied at a time by a thread.
const COPY_CHUNK: usize = 1 << 16;
/// Steps of the peak measurement: about 10 ms.
const PEAK_STEPS: u32 = 3_000_000;
/// Share of the slots that are of interest in the last measurement.
const INTEREST_SHARE: usize = 8;

/// What one pool of threads needs for things; ms a patch, GB/s, GFLOP/s.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Timing {
    /// Threads of the pool.
    pub threads: usize,
    /// One patch out and one in, singly, ms.
    pub swap_ms: f64,
    /// Per patch of a block that enters, all of which see all others, ms.
    pub add_ms: f64,
    /// Per patch of a block that leaves, ms.
    pub remove_ms: f64,
    /// Per patch of a block that enters and sees only a few, ms.
    pub sparse_add_ms: f64,
    /// Slots that any patch of that block sees.
    pub seen_columns: u32,
    /// Three channels of light, ms.
    pub step_ms: f64,
    /// The same for an eighth of the slots, neighbours, ms.
    pub interest_step_ms: f64,
    /// Refining the columns of a block, per patch, ms.
    pub repair_patch_ms: f64,
    /// Bytes of the half of the matrix that is stored, read a second by the full product, GB/s.
    pub product_gb_s: f64,
    /// Bytes read and written a second by a plain copy, GB/s.
    pub copy_gb_s: f64,
    /// Multiplications and additions of a block's removal a second, 10^9.
    pub remove_gflop_s: f64,
    /// The same of nothing but multiply-adds in registers.
    pub peak_gflop_s: f64,
}

/// A full matrix and the room around it.
pub(super) struct Bench<'a> {
    backend: CpuBackend,
    streamed: Streamed,
    block: usize,
    clock: &'a (dyn Fn() -> f64 + Sync),
}

impl<'a> Bench<'a> {
    pub(super) fn new(
        m: u32,
        block: usize,
        seed: u64,
        clock: &'a (dyn Fn() -> f64 + Sync),
    ) -> Result<Self, MatrixBenchError> {
        let mut backend = CpuBackend::new(m)?;
        let mut streamed = Streamed::new(ClosedBox::new(m as usize + 2 * block, seed), m as usize, seed);
        loop {
            let updates = streamed.enter(LocalMatrix::BLOCK_MAX);
            if updates.is_empty() {
                break;
            }
            backend.apply(&updates)?;
        }
        Ok(Self { backend, streamed, block, clock })
    }

    /// Measures on the threads of the current pool.
    pub(super) fn measure(&mut self) -> Result<Timing, MatrixBenchError> {
        let mut timing = Timing { threads: rayon::current_num_threads(), ..Timing::default() };
        let [mut swap, mut add, mut remove, mut sparse, mut step, mut interest, mut repair] =
            [f64::INFINITY; 7];
        let per_patch = 1.0 / self.block as f64;
        for round in 0..ROUNDS {
            let (out, into) = (self.streamed.leave(1), self.streamed.enter(1));
            swap = swap.min(self.apply(&out)? + self.apply(&into)?);
            let (out, into) = (self.streamed.leave(self.block), self.streamed.enter(self.block));
            remove = remove.min(self.apply(&out)? * per_patch);
            add = add.min(self.apply(&into)? * per_patch);
            let (thinned, seen) = self.thinned(&into);
            timing.seen_columns = seen;
            self.apply(&removals(&into))?;
            sparse = sparse.min(self.apply(&thinned)? * per_patch);
            self.apply(&removals(&into))?;
            self.apply(&into)?;
            step = step.min(self.light(round, None)?);
            interest = interest.min(self.light(round, Some(INTEREST_SHARE))?);
            let start = (self.clock)();
            let columns = self.backend.repair(LocalMatrix::BLOCK_MAX as u32)?.columns;
            repair = repair.min(((self.clock)() - start) * 1e3 / f64::from(columns.max(1)));
        }
        let slots = self.backend.capacity();
        let bytes = LocalMatrix::bytes(slots) as f64;
        // Each of the numbers stored takes one multiplication and one addition a patch.
        let flops = bytes / 4.0 * 2.0;
        timing.swap_ms = swap;
        timing.add_ms = add;
        timing.remove_ms = remove;
        timing.sparse_add_ms = sparse;
        timing.step_ms = step;
        timing.interest_step_ms = interest;
        timing.repair_patch_ms = repair;
        timing.product_gb_s = bytes / 1e6 / step.max(1e-6);
        timing.copy_gb_s = self.copy_rate(bytes as usize);
        timing.remove_gflop_s = flops / 1e6 / remove.max(1e-6);
        timing.peak_gflop_s = self.peak_rate();
        Ok(timing)
    }

    /// ms.
    fn apply(&mut self, updates: &[Update]) -> Result<f64, BackendError> {
        let start = (self.clock)();
        self.backend.apply(updates)?;
        Ok(((self.clock)() - start) * 1e3)
    }

    /// The same patches, each seeing only residents of the first eighth of the room's patches: rows as sparse, and as
    /// alike, as those of neighbours in a world. And how many slots they name.
    fn thinned(&self, updates: &[Update]) -> (Vec<Update>, u32) {
        let most = self.streamed.room().len() / 8;
        let mut seen = vec![false; self.backend.capacity() as usize];
        let mut keep = |entries: &[(Slot, f32)]| -> Vec<(Slot, f32)> {
            let is_near = |slot: Slot| self.streamed.patch(slot).is_some_and(|patch| patch < most);
            let kept: Vec<_> = entries.iter().copied().filter(|&(slot, _)| is_near(slot)).collect();
            kept.iter().for_each(|(slot, _)| seen[slot.0 as usize] = true);
            kept
        };
        let mut thin = |update: &Update| match update {
            Update::Add { slot, reflectance, area, row, column } => {
                let (slot, reflectance, area) = (*slot, *reflectance, *area);
                Update::Add { slot, reflectance, area, row: keep(row), column: keep(column) }
            }
            Update::Remove { slot } => Update::Remove { slot: *slot },
        };
        let thinned = updates.iter().map(&mut thin).collect();
        (thinned, seen.iter().filter(|&&seen| seen).count() as u32)
    }

    /// ms of a step after all sources have changed; of interest is all, or the first of so many shares.
    fn light(&mut self, round: usize, share: Option<usize>) -> Result<f64, BackendError> {
        let slots: Vec<Slot> = (0..self.backend.capacity()).map(Slot).collect();
        let exitance = vec![Rgb::splat(1.0 + round as f32 + share.unwrap_or(0) as f32); slots.len()];
        self.backend.set_sources(&slots, &exitance, &exitance)?;
        self.backend.set_interest(share.map(|share| &slots[..slots.len().div_ceil(share)]))?;
        let start = (self.clock)();
        self.backend.step()?;
        let taken = ((self.clock)() - start) * 1e3;
        self.backend.set_interest(None)?;
        Ok(taken)
    }

    fn copy_rate(&self, bytes: usize) -> f64 {
        let from = vec![1.0f32; bytes.min(COPY_BYTES_MAX) / 4];
        let mut to = vec![0.0f32; from.len()];
        let mut best = f64::INFINITY;
        for _ in 0..ROUNDS {
            let start = (self.clock)();
            to.par_chunks_mut(COPY_CHUNK)
                .zip(std::hint::black_box(&from).par_chunks(COPY_CHUNK))
                .for_each(|(to, from)| to.copy_from_slice(from));
            best = best.min((self.clock)() - start);
        }
        8.0 * from.len() as f64 / 1e9 / best.max(1e-9)
    }

    /// All threads at once.
    fn peak_rate(&self) -> f64 {
        let (set, mut best) = (InstructionSet::widest(), f64::INFINITY);
        let mut done = 0;
        for _ in 0..ROUNDS {
            let start = (self.clock)();
            let flops = rayon::broadcast(|_| {
                let (mut out, mut flops) = (0.0, 0);
                f32::dispatch(set, PeakRate { steps: PEAK_STEPS, out: &mut out, flops: &mut flops });
                std::hint::black_box(out);
                flops
            });
            best = best.min((self.clock)() - start);
            done = flops.iter().sum();
        }
        done as f64 / 1e9 / best.max(1e-9)
    }
}

/// Takes the same patches out again.
fn removals(updates: &[Update]) -> Vec<Update> {
    let slot = |update: &Update| match update {
        Update::Add { slot, .. } | Update::Remove { slot } => *slot,
    };
    updates.iter().map(|update| Update::Remove { slot: slot(update) }).collect()
}
