//! What `earthshine bench matrix` measures: how exact the local matrix stays, and what it costs.
//!
//! Two rooms, because the questions want different sizes. *Accuracy*: a [`ClosedBox`] of twice as many
//! patches as slots (at most [`ACCURACY_SLOTS_MAX`]), seeded swaps, a fresh `f64` solve to compare with, the
//! sources' truncated update beside it. *Time*: a box for `m` slots, blocks and single swaps on a full matrix.
//! The box is the dense worst case: every patch sees five sixths of the others. `sparse_add_ms` is for rows that see an
//! eighth of that.
//!
//! There is no clock in this package: the caller passes one.

mod accuracy;
mod light;
mod streamed;
#[cfg(test)]
mod tests;
mod timing;

pub use light::{read, rel_rmse};
pub use streamed::Streamed;
pub use timing::Timing;

use crate::backend::BackendError;
use crate::closed_box::ClosedBox;
use crate::dense::DenseError;
use crate::local_matrix::{CapacityError, LocalMatrix};

/// Most slots of the accuracy part: a fresh solve there takes milliseconds.
pub const ACCURACY_SLOTS_MAX: u32 = 200;

/// What to measure.
#[derive(Clone, Copy)]
pub struct MatrixBenchParams<'a> {
    /// Slots of the matrix that is timed; accuracy uses at most [`ACCURACY_SLOTS_MAX`].
    pub m: u32,
    /// Swaps (one patch out, another in) of the accuracy part.
    pub swaps: u32,
    /// Patches that leave, and enter, together; 1 to [`LocalMatrix::BLOCK_MAX`], clamped.
    pub block: u32,
    /// Of everything random.
    pub seed: u64,
    /// Seconds since some moment; never goes back.
    pub clock: &'a (dyn Fn() -> f64 + Sync),
}

impl std::fmt::Debug for MatrixBenchParams<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "m {} swaps {} block {} seed {}", self.m, self.swaps, self.block, self.seed)
    }
}

/// Error after so many swaps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorPoint {
    /// Swaps so far.
    pub swaps: u32,
    /// Relative RMSE of irradiance from a random source, against a fresh `f64` solve.
    pub exact_rel: f64,
    /// The same, of the sources' update.
    pub truncated_rel: f64,
    /// The same, of exact updates of planes that are rounded to 16-bit floats after each block.
    pub halved_rel: f64,
}

/// What was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct MatrixFigures {
    /// Slots of the accuracy part.
    pub accuracy_m: u32,
    /// Relative RMSE of irradiance from a random source after all swaps, against a fresh `f64` solve.
    pub exact_error_rel: f64,
    /// Relative Frobenius distance of `H` from that solve, all channels.
    pub exact_frobenius_rel: f64,
    /// As `exact_error_rel`, of the sources' update.
    pub truncated_error_rel: f64,
    /// As `exact_error_rel`, of planes that are rounded to 16-bit floats after each block.
    pub halved_error_rel: f64,
    /// On the way.
    pub curve: Vec<ErrorPoint>,
    /// The drift probe after all swaps.
    pub drift_rel: f64,
    /// Repairs that the probe called for.
    pub repairs: u32,
    /// On all threads of the current pool.
    pub timing: Timing,
    /// On one thread.
    pub one_core: Timing,
}

/// Why nothing was measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MatrixBenchError {
    /// No matrix of that size.
    #[error(transparent)]
    Capacity(#[from] CapacityError),
    /// The backend refused: a fault of the bench.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// No fresh solve to compare with.
    #[error(transparent)]
    Dense(#[from] DenseError),
    /// No thread for the figures of one core.
    #[error("no pool of one thread: {0}")]
    Threads(String),
}

/// Measures both parts.
///
/// # Errors
/// [`MatrixBenchError`].
pub fn measure_matrix(params: MatrixBenchParams<'_>) -> Result<MatrixFigures, MatrixBenchError> {
    let block = (params.block.clamp(1, LocalMatrix::BLOCK_MAX as u32) as usize).min(params.m.max(1) as usize);
    let accuracy = accuracy::measure(params.m.min(ACCURACY_SLOTS_MAX), params.swaps, block, params.seed)?;
    let mut bench = timing::Bench::new(params.m, block, params.seed, params.clock)?;
    let timing = bench.measure()?;
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let one = one.map_err(|error| MatrixBenchError::Threads(error.to_string()))?;
    let one_core = one.install(|| bench.measure())?;
    Ok(MatrixFigures {
        accuracy_m: params.m.min(ACCURACY_SLOTS_MAX),
        exact_error_rel: accuracy.exact_rel,
        exact_frobenius_rel: accuracy.frobenius_rel,
        truncated_error_rel: accuracy.truncated_rel,
        halved_error_rel: accuracy.halved_rel,
        curve: accuracy.curve,
        drift_rel: accuracy.drift_rel,
        repairs: accuracy.repairs,
        timing,
        one_core,
    })
}
