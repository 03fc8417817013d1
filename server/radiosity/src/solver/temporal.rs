//! Temporal radiosity: a few draws a row and frame, blended with the past.
//!
//! ```text
//! B_j   = E_j + rho_j I_j                       what leaves each patch: the past times reflectance, not the past itself
//! I_now = total / k * sum of k draws of B_j     what is far brings g_far / F_far, the sky g_sky / F_sky
//! I     = w I + (1 - w) I_now
//! ```
//!
//! Shcherbakov, Frolov and Galaktionov (2023) with the reflectance that their section 4.2 leaves out; the dissertation has
//! it. Rows are uncoloured and light is RGB, so one draw serves all channels.

use super::links::LinkRows;
use super::sampler::{FAR, RowDraw, SKY};
use super::{Light, SolverSettings, add_scaled};
use crate::tables::RowTable;
use crate::tables::draw::{Spread, random, row_key};
use rayon::prelude::*;

/// Rows a task takes at least.
const ROWS_MIN: usize = 64;
/// Least and most draws of an adaptive row, as a part and a multiple of `k`.
pub const ADAPTIVE_RANGE: f32 = 4.0;
/// Weight of the past in the short mean that tells whether light has moved.
pub const SHORT_WEIGHT: f32 = 0.75;
/// The short mean's variance, of one frame's: `(1 - w) / (1 + w)`.
pub const SHORT_VARIANCE: f32 = (1.0 - SHORT_WEIGHT) / (1.0 + SHORT_WEIGHT);
/// Standard errors between short and long mean that count as a move of light.
pub const MOVED: f32 = 4.0;
/// Frames of past that a row keeps whose light has moved.
pub const AGE_AFTER_MOVE: f32 = 3.0;

/// What draws of one frame look at, by slot.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// What leaves each patch.
    pub sent: &'a [Light],
    /// What each row's draw of [`FAR`] brings: the light that is far over its share.
    pub far: &'a [Light],
    /// What each row's draw of [`SKY`] brings.
    pub sky: &'a [Light],
    /// What arrives from outside, whole: for rows that draw none of it.
    pub outside: &'a [Light],
}

/// What `samples` draws of one row say.
#[derive(Debug, Clone, Copy, Default)]
pub struct Drawn {
    /// Irradiance.
    pub irradiance: Light,
    /// Variance of the sum of its channels, as if the draws were independent.
    pub variance: f32,
}

/// The light of one row from `samples` draws. The twin of the shaders' `advance_row`.
#[inline]
pub fn drawn<T: RowTable>(
    row: &RowDraw<T>,
    scene: Scene<'_>,
    slot: usize,
    key: u32,
    samples: u32,
    spread: Spread,
) -> Drawn {
    let (mut sum, mut squares) = ([0.0f32; 4], 0.0f32);
    for sample in 0..samples {
        let outcome = row.outcomes[row.table.draw(random(key, sample, samples, spread))];
        let light = match outcome {
            FAR => &scene.far[slot],
            SKY => &scene.sky[slot],
            _ => &scene.sent[outcome as usize],
        };
        add_scaled(&mut sum, 1.0, light);
        squares += square_of_sum(light);
    }
    Drawn::of(&sum, squares, samples, row.table.total())
}

/// Square of the sum of channels.
#[inline(always)]
pub(crate) fn square_of_sum(light: &Light) -> f32 {
    let all = light[0] + light[1] + light[2];
    all * all
}

impl Drawn {
    /// From the sum of `samples` draws and the sum of their [`square_of_sum`]s, by a table of weight `total`.
    #[inline]
    pub(crate) fn of(sum: &Light, squares: f32, samples: u32, total: f32) -> Self {
        let count = samples as f32;
        let mean = (sum[0] + sum[1] + sum[2]) / count;
        let spread = (squares / count - mean * mean).max(0.0);
        let scale = total / count;
        Self { irradiance: sum.map(|sum| sum * scale), variance: spread / count * total * total }
    }
}

/// What an adaptive row knows of its noise.
#[derive(Debug, Clone, Copy, Default)]
pub struct RowNoise {
    /// Mean variance of a frame's draws.
    variance: f32,
    /// Mean of the last frames, sum of channels.
    short: f32,
    /// Frames since its light moved.
    age: f32,
    /// Draws of the next frame.
    samples: u32,
}

/// Advances `irradiance` by a frame. `draw` is what draws of a row say, given its slot, key and number of draws; nothing
/// for a row without a table yet, which keeps its light.
pub fn step(
    links: &LinkRows,
    settings: &SolverSettings,
    frame: u32,
    noise: &mut [RowNoise],
    irradiance: &mut [Light],
    draw: impl Fn(usize, u32, u32) -> Option<Drawn> + Sync,
) {
    let rows = irradiance.par_iter_mut().zip(noise.par_iter_mut()).with_min_len(ROWS_MIN).enumerate();
    rows.for_each(|(slot, (irradiance, noise))| {
        if !links.is_taken(slot) {
            return;
        }
        let key = row_key(settings.seed, frame, slot as u32);
        let samples =
            if settings.adaptive && noise.samples > 0 { noise.samples } else { settings.samples_per_row };
        let Some(now) = draw(slot, key, samples) else { return };
        let weight = if settings.adaptive {
            noise.weigh(&now, irradiance, settings.history_weight)
        } else {
            settings.history_weight
        };
        for (old, now) in irradiance.iter_mut().zip(now.irradiance) {
            *old = weight * *old + (1.0 - weight) * now;
        }
    });
    if settings.adaptive {
        share_out(settings.samples_per_row, noise);
    }
}

impl RowNoise {
    /// Weight of the past for this frame.
    fn weigh(&mut self, now: &Drawn, old: &Light, most: f32) -> f32 {
        let all = |light: &Light| light[0] + light[1] + light[2];
        let fresh = self.age == 0.0;
        self.variance = if fresh { now.variance } else { 0.9 * self.variance + 0.1 * now.variance };
        self.short = if fresh {
            all(&now.irradiance)
        } else {
            SHORT_WEIGHT * self.short + (1.0 - SHORT_WEIGHT) * all(&now.irradiance)
        };
        self.age += 1.0;
        let gap = self.short - all(old);
        if gap * gap > MOVED * MOVED * SHORT_VARIANCE * self.variance {
            self.age = self.age.min(AGE_AFTER_MOVE);
        }
        most.min(1.0 - 1.0 / self.age)
    }
}

/// Draws of the next frame by standard error, so that all rows together draw about `samples` each.
fn share_out(samples: u32, noise: &mut [RowNoise]) {
    let sum: f64 = noise.iter().map(|noise| f64::from(noise.variance.sqrt())).sum();
    let rows = noise.iter().filter(|noise| noise.age > 0.0).count();
    let mean = (sum / rows.max(1) as f64) as f32;
    let (least, most) = (samples as f32 / ADAPTIVE_RANGE, samples as f32 * ADAPTIVE_RANGE);
    for noise in noise.iter_mut().filter(|noise| noise.age > 0.0) {
        let relative = if mean > 0.0 { noise.variance.sqrt() / mean } else { 1.0 };
        noise.samples = ((samples as f32 * relative).clamp(least, most) as u32).max(1);
    }
}
