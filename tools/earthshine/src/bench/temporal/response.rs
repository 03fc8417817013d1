//! One solver's answer to a step of light, and its error when light has been still for long.

use super::subset::{Subset, rel_rmse};
use earthshine_radiosity::Backend;
use earthshine_radiosity::solver::SolverSettings;
use serde::Serialize;

/// Histories that a blend is given to reach its steady noise.
const STEADY_HISTORIES: f32 = 2.0;
/// Points of a curve beyond the first frames grow by this factor.
const CURVE_GROWTH: f64 = 1.04;
/// Frames in which moving lights go there and back.
const MOVING_PERIOD: u32 = 48;
/// Frames at the end whose errors are the noise that is left.
const NOISE_FRAMES: u32 = 20;

/// How one solver does.
#[derive(Debug, Serialize)]
pub(super) struct Response {
    pub(super) solver: &'static str,
    /// Relative RMSE when light has been still for two histories, from settled light.
    pub(super) steady_rel_rmse: f64,
    /// Frames until a tenth, and a hundredth, of the change is left; nothing if that was not seen.
    pub(super) frames_to_90: Option<u32>,
    pub(super) frames_to_99: Option<u32>,
    /// Relative RMSE of the last frames that were followed, lag included.
    pub(super) noise_after_rel: f64,
    /// Relative RMSE while lights move between before and after the change and back, every frame, mean over two rounds.
    pub(super) moving_rel_rmse: f64,
    /// Whether another frame would change no bit.
    is_settled: bool,
    /// Frames after which no bit changed any more.
    frames_to_rest: Option<u32>,
    /// Frame and share of the change that is left.
    pub(super) curve: Vec<(u32, f64)>,
}

/// Follows `settings.method` for `frames` frames.
pub(super) fn measure(
    subset: &mut Subset,
    settings: SolverSettings,
    frames: u32,
) -> anyhow::Result<Response> {
    let steady_rel_rmse = steady(subset, settings, frames)?;
    subset.settle(false)?;
    subset.switch(&settings)?;
    subset.shine(true)?;
    let change = subset.light_before.clone();
    let (mut to_90, mut to_99, mut to_rest, mut noise) = (None, None, None, 0.0);
    let (mut curve, mut next_point) = (Vec::new(), 1.0f64);
    let noise_frames = NOISE_FRAMES.min(frames.max(1));
    for frame in 1..=frames.max(1) {
        subset.backend.step()?;
        let light = subset.light()?;
        let left = rel_rmse(&light, &subset.light_after, |at| change[at] - subset.light_after[at]);
        to_90 = to_90.or((left <= 0.1).then_some(frame));
        to_99 = to_99.or((left <= 0.01).then_some(frame));
        if f64::from(frame) >= next_point {
            curve.push((frame, left));
            next_point = (f64::from(frame) * CURVE_GROWTH).max(f64::from(frame) + 1.0);
        }
        if frame + noise_frames > frames {
            noise += rel_rmse(&light, &subset.light_after, |at| subset.light_after[at]);
        }
        if subset.backend.is_settled() {
            to_rest = Some(frame);
            noise =
                f64::from(noise_frames) * rel_rmse(&light, &subset.light_after, |at| subset.light_after[at]);
            curve.push((frame, left));
            break;
        }
    }
    let (is_settled, moving_rel_rmse) = (subset.backend.is_settled(), moving(subset, settings)?);
    Ok(Response {
        solver: settings.method.name(),
        steady_rel_rmse,
        frames_to_90: to_90,
        frames_to_99: to_99,
        noise_after_rel: noise / f64::from(noise_frames),
        moving_rel_rmse,
        is_settled,
        frames_to_rest: to_rest,
        curve,
    })
}

/// Error of light whose sources change every frame.
fn moving(subset: &mut Subset, settings: SolverSettings) -> anyhow::Result<f64> {
    subset.settle(false)?;
    subset.switch(&settings)?;
    let (before, after) = (subset.light_before.clone(), subset.light_after.clone());
    let mut sum = 0.0;
    for frame in 1..=2 * MOVING_PERIOD {
        let turn = std::f32::consts::TAU * frame as f32 / MOVING_PERIOD as f32;
        let share = 0.5 - 0.5 * turn.cos();
        subset.shine_between(share)?;
        subset.backend.step()?;
        let light = subset.light()?;
        let truth: Vec<_> =
            before.iter().zip(&after).map(|(&before, &after)| before.lerp(after, share)).collect();
        sum += rel_rmse(&light, &truth, |at| truth[at]);
    }
    Ok(sum / f64::from(2 * MOVING_PERIOD))
}

fn steady(subset: &mut Subset, settings: SolverSettings, frames: u32) -> anyhow::Result<f64> {
    subset.settle(true)?;
    subset.switch(&settings)?;
    let is_blend = settings.method.is_endless();
    let history = (STEADY_HISTORIES / (1.0 - settings.history_weight)) as u32;
    let frames = if is_blend { history.clamp(1, frames.max(1)) } else { frames };
    for _ in 0..frames {
        subset.backend.step()?;
        if subset.backend.is_settled() {
            break;
        }
    }
    let light = subset.light()?;
    Ok(rel_rmse(&light, &subset.light_after, |at| subset.light_after[at]))
}
