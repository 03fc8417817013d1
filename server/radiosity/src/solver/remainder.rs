//! What shooting has not told yet, estimated by draws: the sampled half of the hybrid.
//!
//! ```text
//! light published = I + e        e_i = total / k * sum of k draws of (r_j + rho_j e_j)
//! ```
//!
//! `I` stays exact; `e` is an unbiased guess of the rest, with bounces, a frame behind. Its noise is that of what is left
//! to shoot, so it vanishes as that does: when nothing is left, light is constant to the bit, without a history to wait for.

use super::links::LinkRows;
use super::sampler::RowSampler;
use super::temporal::{Scene, drawn};
use super::{Light, SolverSettings};
use crate::tables::RowTable;
use crate::tables::draw::{Spread, row_key};
use rayon::prelude::*;

/// Rows a task takes at least.
const ROWS_MIN: usize = 64;
/// Draws a row, as a part of `samples_per_row`.
pub const SAMPLES_PART: u32 = 4;
/// Weight of the last frame's estimate.
pub const HISTORY_WEIGHT: f32 = 0.5;
/// Below this share of all light the rest is not worth a draw.
pub const UNSHOT_MIN: f32 = 1e-3;

/// Advances the estimate `rest` by a frame, from unshot exitance `unshot`.
pub fn step<T: RowTable + Clone>(
    links: &LinkRows,
    sampler: &RowSampler<T>,
    unshot: &[Light],
    settings: &SolverSettings,
    frame: u32,
    rest: &mut [Light],
) {
    let leaving = (0..links.capacity()).into_par_iter().with_min_len(ROWS_MIN).map(|slot| -> Light {
        let reflectance = super::light(links.reflectance(slot));
        std::array::from_fn(|c| unshot[slot][c] + reflectance[c] * rest[slot][c])
    });
    let leaving: Vec<Light> = leaving.collect();
    // Nothing of the rest comes from outside: a change there is in `I` at once.
    let none = vec![[0.0; 4]; links.capacity()];
    let scene = Scene { sent: &leaving, far: &none, sky: &none, outside: &none };
    let samples = (settings.samples_per_row / SAMPLES_PART).max(1);
    rest.par_iter_mut().with_min_len(ROWS_MIN).enumerate().for_each(|(slot, rest)| {
        let row = sampler.row(slot);
        if !links.is_taken(slot) || row.outcomes.is_empty() {
            *rest = [0.0; 4];
            return;
        }
        let key = row_key(settings.seed, frame, slot as u32);
        let now = drawn(row, scene, slot, key, samples, Spread::Systematic);
        for (old, now) in rest.iter_mut().zip(now.irradiance) {
            *old = HISTORY_WEIGHT * *old + (1.0 - HISTORY_WEIGHT) * now;
        }
    });
}
