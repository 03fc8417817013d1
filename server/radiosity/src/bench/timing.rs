//! What updates and products cost on a full matrix.

use super::{ClosedBox, MatrixBenchError, Streamed};
use crate::backend::{Backend, Update};
use crate::cpu::CpuBackend;
use rayon::prelude::*;

/// Repetitions; the median counts.
const ROUNDS: usize = 5;
/// Most bytes copied to measure the memory.
const COPY_BYTES_MAX: usize = 256 << 20;

/// What came out; ms a patch, GB/s.
#[derive(Debug)]
pub(super) struct Timing {
    pub(super) swap_ms: f64,
    pub(super) add_ms: f64,
    pub(super) remove_ms: f64,
    pub(super) product_gb_s: f64,
    pub(super) copy_gb_s: f64,
}

pub(super) fn measure(
    m: u32,
    block: usize,
    seed: u64,
    clock: &dyn Fn() -> f64,
) -> Result<Timing, MatrixBenchError> {
    let mut backend = CpuBackend::new(m)?;
    let mut streamed = Streamed::new(ClosedBox::new(m as usize + 2 * block, seed), m as usize, seed);
    loop {
        let updates = streamed.enter(block);
        if updates.is_empty() {
            break;
        }
        backend.apply(&updates)?;
    }
    let mut timed = |updates: &[Update]| -> Result<f64, MatrixBenchError> {
        let start = clock();
        backend.apply(updates)?;
        Ok((clock() - start) * 1e3)
    };
    let (mut swap, mut add, mut remove) = ([0.0; ROUNDS], [0.0; ROUNDS], [0.0; ROUNDS]);
    for round in 0..ROUNDS {
        swap[round] = timed(&streamed.leave(1))? + timed(&streamed.enter(1))?;
        remove[round] = timed(&streamed.leave(block))? / block as f64;
        add[round] = timed(&streamed.enter(block))? / block as f64;
    }
    let matrix_bytes = 12.0 * f64::from(m) * f64::from(m);
    let (mut product, mut copy) = ([0.0; ROUNDS], [0.0; ROUNDS]);
    let matrix = backend.matrix_mut();
    let (light, mut out) = (vec![1.0f32; matrix.vector_len()], vec![0.0f32; m as usize]);
    for product in &mut product {
        let start = clock();
        (0..3).for_each(|channel| matrix.multiply(channel, &light, &mut out));
        *product = clock() - start;
    }
    let from = vec![1.0f32; (matrix_bytes as usize).min(COPY_BYTES_MAX) / 4];
    let mut to = vec![0.0f32; from.len()];
    for copy in &mut copy {
        let start = clock();
        to.par_chunks_mut(1 << 16)
            .zip(from.par_chunks(1 << 16))
            .for_each(|(to, from)| to.copy_from_slice(from));
        *copy = clock() - start;
    }
    Ok(Timing {
        swap_ms: median(swap),
        add_ms: median(add),
        remove_ms: median(remove),
        product_gb_s: matrix_bytes / 1e9 / median(product).max(1e-9),
        copy_gb_s: 8.0 * from.len() as f64 / 1e9 / median(copy).max(1e-9),
    })
}

fn median(mut values: [f64; ROUNDS]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[ROUNDS / 2]
}
