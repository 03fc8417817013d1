//! How exact the matrix stays over many swaps, and how far off the sources' update and planes of 16-bit floats go.

use super::{ClosedBox, ErrorPoint, MatrixBenchError, Streamed};
use crate::backend::{Backend, Update};
use crate::cpu::CpuBackend;
use crate::local_matrix::{Arrival, LocalMatrix};

/// Swap counts at which the error is looked at, besides the last.
const CURVE: [u32; 5] = [10, 100, 1_000, 4_000, 40_000];
/// Swaps between drift probes, and the drift that calls for a repair: the service's defaults.
const PROBE_SWAPS: u32 = 1_000;
const DRIFT_MAX: f32 = 1e-4;

/// What came out.
#[derive(Debug)]
pub(super) struct Accuracy {
    pub(super) exact_rel: f64,
    pub(super) frobenius_rel: f64,
    pub(super) truncated_rel: f64,
    pub(super) halved_rel: f64,
    pub(super) curve: Vec<ErrorPoint>,
    pub(super) drift_rel: f64,
    pub(super) repairs: u32,
}

pub(super) fn measure(m: u32, swaps: u32, block: usize, seed: u64) -> Result<Accuracy, MatrixBenchError> {
    let mut backend = CpuBackend::new(m)?;
    let mut others = Others { truncated: LocalMatrix::new(m)?, halved: LocalMatrix::new(m)? };
    let slots = m as usize;
    let mut streamed = Streamed::new(ClosedBox::new(2 * slots, seed), slots, seed);
    apply(&mut backend, &mut others, &streamed.enter(slots))?;
    let (mut done, mut curve, mut repairs) = (0, Vec::new(), 0);
    let mut stops = CURVE.iter().copied().filter(|&stop| stop < swaps).chain([swaps]).peekable();
    while let Some(&stop) = stops.peek() {
        let count = block.min((stop - done) as usize);
        apply(&mut backend, &mut others, &streamed.leave(count))?;
        apply(&mut backend, &mut others, &streamed.enter(count))?;
        let before = done;
        done += count as u32;
        if before / PROBE_SWAPS != done / PROBE_SWAPS && backend.drift(seed + u64::from(done)) > DRIFT_MAX {
            while !backend.repair(LocalMatrix::BLOCK_MAX as u32)?.is_complete {}
            repairs += 1;
        }
        if done == stop {
            stops.next();
            let exact_rel = streamed.error_of(backend.matrix())?.irradiance_rel;
            let truncated_rel = streamed.error_of(&others.truncated)?.irradiance_rel;
            let halved_rel = streamed.error_of(&others.halved)?.irradiance_rel;
            curve.push(ErrorPoint { swaps: done, exact_rel, truncated_rel, halved_rel });
        }
    }
    let last = streamed.error_of(backend.matrix())?;
    Ok(Accuracy {
        exact_rel: last.irradiance_rel,
        frobenius_rel: last.frobenius_rel,
        truncated_rel: curve.last().map_or(0.0, |point| point.truncated_rel),
        halved_rel: curve.last().map_or(0.0, |point| point.halved_rel),
        curve,
        drift_rel: f64::from(backend.drift(seed)),
        repairs,
    })
}

/// What the exact matrix is compared with.
struct Others {
    /// Updated as in the sources.
    truncated: LocalMatrix,
    /// Updated exactly, and rounded to 16-bit floats after each block.
    halved: LocalMatrix,
}

impl Others {
    /// `updates` are of one kind.
    fn halve(&mut self, updates: &[Update]) {
        for block in updates.chunks(LocalMatrix::BLOCK_MAX) {
            let (mut arrivals, mut leaving) = (Vec::new(), Vec::new());
            for update in block {
                match update {
                    Update::Add { slot, reflectance, area, row, column: _ } => {
                        arrivals.push(Arrival { slot: *slot, reflectance: *reflectance, area: *area, row });
                    }
                    Update::Remove { slot } => leaving.push(*slot),
                }
            }
            self.halved.add_block(&arrivals);
            self.halved.remove_block(&leaving);
            self.halved.round_to_half();
        }
    }
}

fn apply(backend: &mut CpuBackend, others: &mut Others, updates: &[Update]) -> Result<(), MatrixBenchError> {
    backend.apply(updates)?;
    others.halve(updates);
    let truncated = &mut others.truncated;
    for update in updates {
        match update {
            Update::Add { slot, reflectance, area, row, column: _ } => {
                let (slot, reflectance, area) = (*slot, *reflectance, *area);
                truncated.add_truncated(&Arrival { slot, reflectance, area, row });
            }
            Update::Remove { slot } => truncated.remove_truncated(*slot),
        }
    }
    Ok(())
}
