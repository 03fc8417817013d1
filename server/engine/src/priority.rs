//! What is nearest: the point that distances are measured from, and the M patches around it.

use crate::local_set::LocalSet;
use earthshine_world::{Camera, Chunk, PatchId, Vec3};

/// Where the camera will be after `look_ahead_s`, at most `most_m` from where it is.
pub(crate) fn focus(camera: &Camera, look_ahead_s: f32, most_m: f32) -> Vec3 {
    // In f64: a velocity near `f32::MAX` must not overflow on its way to the limit.
    let way = camera.velocity.as_dvec3() * f64::from(look_ahead_s);
    let clamped = way.clamp_length_max(f64::from(most_m));
    camera.position + clamped.as_vec3()
}

/// What a local set should take in and let go.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct SwapPlan {
    /// Wanted and not resident, farthest first: taken from the end.
    pub(crate) adds: Vec<PatchId>,
    /// Resident, and their chunk is not wanted: these go in any case.
    pub(crate) forced: Vec<PatchId>,
    /// Resident, and one of `adds` is nearer: these go when it comes. Nearest first: taken from the end.
    pub(crate) displaced: Vec<PatchId>,
}

impl SwapPlan {
    /// Whether the local set is what it should be.
    pub(crate) fn is_empty(&self) -> bool {
        self.adds.is_empty() && self.forced.is_empty() && self.displaced.is_empty()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Candidate {
    /// Squared distance as bits: they order like the number, which is never negative.
    distance: u32,
    patch: PatchId,
    is_resident: bool,
}

/// The nearest patches of `chunks` (ascending by id) against what `local` holds.
///
/// Residents count as nearer by `hysteresis`. What `local` was refused is left out.
pub(crate) fn plan_swaps(focus: Vec3, chunks: &[&Chunk], local: &LocalSet, hysteresis: f32) -> SwapPlan {
    let resident_scale = (1.0 + hysteresis).powi(-2);
    let mut candidates = Vec::new();
    for chunk in chunks {
        let slots = local.slots_of(chunk.id);
        for (index, patch) in chunk.patches.iter().enumerate() {
            let id = PatchId { chunk: chunk.id, local: u16::try_from(index).expect("locals are u16") };
            let is_resident = slots.is_some_and(|slots| slots.is_taken(index));
            if !is_resident && local.was_refused(id) {
                continue;
            }
            let scale = if is_resident { resident_scale } else { 1.0 };
            let distance = (patch.centroid.distance_squared(focus) * scale).to_bits();
            candidates.push(Candidate { distance, patch: id, is_resident });
        }
    }
    let capacity = local.capacity() as usize;
    let beyond = if candidates.len() > capacity {
        candidates.select_nth_unstable(capacity);
        candidates.split_off(capacity)
    } else {
        Vec::new()
    };
    let pick = |from: Vec<Candidate>, is_resident| {
        let mut picked: Vec<_> =
            from.into_iter().filter(|candidate| candidate.is_resident == is_resident).collect();
        picked.sort_unstable();
        picked.into_iter().map(|candidate| candidate.patch)
    };
    let forced = local
        .chunks()
        .filter(|id| chunks.binary_search_by_key(id, |chunk| chunk.id).is_err())
        .flat_map(|id| local.patches_of(id))
        .collect();
    SwapPlan {
        adds: pick(candidates, false).rev().collect(),
        forced,
        displaced: pick(beyond, true).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_focus_runs_ahead_of_a_moving_camera_but_not_away_from_it() {
        for (velocity, expected) in [(0.0, 1.0), (4.0, 3.0), (-4.0, -1.0), (1000.0, 11.0), (f32::MAX, 11.0)] {
            let camera = Camera { position: Vec3::X, forward: Vec3::X, velocity: Vec3::X * velocity };
            assert!((focus(&camera, 0.5, 10.0) - Vec3::X * expected).length() < 1e-5, "{velocity} m/s");
        }
    }
}
