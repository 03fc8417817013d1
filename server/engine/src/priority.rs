//! What is nearest and what comes first: the point that distances are measured from, the M patches around it, and
//! the order of work towards them.
//!
//! Distance from the focus alone decides *what* is resident: light comes from behind a camera too, and a camera that turns
//! must find it there. What lies in view only comes *earlier*.

use crate::config::EngineConfig;
use crate::local_set::LocalSet;
use earthshine_world::{Camera, Chunk, PatchId, Vec3};
use std::sync::Arc;

/// What one camera looks at, as far as plans depend on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outlook {
    /// Where the camera is, m.
    pub(crate) position: Vec3,
    /// Where distances are measured from: where the camera will be, m.
    pub(crate) focus: Vec3,
    /// The way that tiles are asked for along, from the focus on.
    way: Vec3,
    /// Unit, or zero for a camera that looks nowhere.
    forward: Vec3,
    /// By how much what lies straight behind counts as farther in the order of work.
    view_bias: f32,
}

impl Outlook {
    /// Of a valid camera, led by at most `lead_max_m`.
    pub(crate) fn of(camera: &Camera, config: &EngineConfig, lead_max_m: f32) -> Self {
        let focus = ahead(camera, config.look_ahead_s, lead_max_m.min(config.load_radius_m * 0.5));
        let way_max_m = config.load_radius_m * f32::from(EngineConfig::TILE_WAY_RADII);
        let end = ahead(camera, config.tile_look_ahead_s, way_max_m);
        // A shorter look ahead for tiles than for patches leaves no way.
        let is_ahead = (end - focus).dot(camera.velocity) > 0.0;
        Self {
            position: camera.position,
            focus,
            way: if is_ahead { end - focus } else { Vec3::ZERO },
            forward: camera.forward.normalize_or_zero(),
            view_bias: config.view_bias,
        }
    }

    /// Places along the way at most `step_m` apart, and how far each lies from the focus, m: the focus first.
    pub(crate) fn stops(&self, step_m: f32) -> impl Iterator<Item = (Vec3, f32)> {
        let (focus, way, length_m) = (self.focus, self.way, self.way.length());
        let steps = (length_m / step_m).ceil().clamp(0.0, f32::from(EngineConfig::TILE_WAY_RADII)) as u8;
        (0..=steps).map(move |step| {
            let share = f32::from(step) / f32::from(steps.max(1));
            (focus + way * share, length_m * share)
        })
    }

    /// `distance` to something at `place` as the order of work counts it: what is in view comes first.
    pub(crate) fn urgency(&self, distance: f32, place: Vec3) -> f32 {
        let towards = (place - self.position).normalize_or(self.forward);
        distance * (1.0 + self.view_bias * 0.5 * (1.0 - towards.dot(self.forward)))
    }
}

/// Where the camera will be after `look_ahead_s`, at most `most_m` from where it is.
fn ahead(camera: &Camera, look_ahead_s: f32, most_m: f32) -> Vec3 {
    // In f64: a velocity near `f32::MAX` must not overflow on its way to the limit.
    let way = camera.velocity.as_dvec3() * f64::from(look_ahead_s);
    let clamped = way.clamp_length_max(f64::from(most_m));
    camera.position + clamped.as_vec3()
}

/// What a local set should take in and let go.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct SwapPlan {
    /// Wanted and not resident, most urgent last: taken from the end.
    pub(crate) adds: Vec<PatchId>,
    /// Resident, and their chunk is not wanted: these go in any case.
    pub(crate) forced: Vec<PatchId>,
    /// Resident, and one of `adds` is nearer, or more are resident than should be: these go when it comes. Nearest first: taken from the end.
    pub(crate) displaced: Vec<PatchId>,
}

impl SwapPlan {
    /// Whether the local set is what it should be.
    pub(crate) fn is_empty(&self) -> bool {
        self.adds.is_empty() && self.forced.is_empty() && self.displaced.is_empty()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Candidate {
    /// Squared distance as bits: they order like the number, which is never negative.
    distance: u32,
    patch: PatchId,
    is_resident: bool,
}

/// Who is to stay.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Staying {
    /// Residents count as nearer by this share.
    pub(crate) hysteresis: f32,
    /// As many patches as this, at most.
    pub(crate) slots: u32,
}

/// The nearest patches of `chunks` (ascending by id) against what `local` holds, worked out in `candidates`.
///
/// What `local` was refused is left out, and what is beyond the nearest that are to stay.
pub(crate) fn plan_swaps(
    outlook: &Outlook,
    chunks: &[&Arc<Chunk>],
    local: &LocalSet,
    stay: Staying,
    candidates: &mut Vec<Candidate>,
) -> SwapPlan {
    let resident_scale = (1.0 + stay.hysteresis).powi(-2);
    candidates.clear();
    for chunk in chunks {
        let slots = local.slots_of(chunk.id);
        for (index, patch) in chunk.patches.iter().enumerate() {
            let id = PatchId { chunk: chunk.id, local: u16::try_from(index).expect("locals are u16") };
            let is_resident = slots.is_some_and(|slots| slots.is_taken(index));
            if !is_resident && local.was_refused(id) {
                continue;
            }
            let scale = if is_resident { resident_scale } else { 1.0 };
            let distance = (patch.centroid.distance_squared(outlook.focus) * scale).to_bits();
            candidates.push(Candidate { distance, patch: id, is_resident });
        }
    }
    let capacity = local.capacity().min(stay.slots) as usize;
    if candidates.len() > capacity {
        candidates.select_nth_unstable(capacity);
    }
    let (chosen, beyond) = candidates.split_at(capacity.min(candidates.len()));
    let mut displaced: Vec<_> = beyond.iter().filter(|candidate| candidate.is_resident).collect();
    displaced.sort_unstable();
    let forced = local
        .chunks()
        .filter(|id| chunks.binary_search_by_key(id, |chunk| chunk.id).is_err())
        .flat_map(|id| local.patches_of(id))
        .collect();
    SwapPlan {
        adds: most_urgent_last(outlook, chunks, chosen),
        forced,
        displaced: displaced.into_iter().map(|candidate| candidate.patch).collect(),
    }
}

/// Those of `chosen` that are not resident, in the order of work.
fn most_urgent_last(outlook: &Outlook, chunks: &[&Arc<Chunk>], chosen: &[Candidate]) -> Vec<PatchId> {
    let centroid = |id: PatchId| {
        let at = chunks.binary_search_by_key(&id.chunk, |chunk| chunk.id).expect("chosen from these chunks");
        chunks[at].patches[usize::from(id.local)].centroid
    };
    let mut adds: Vec<(u32, PatchId)> = chosen
        .iter()
        .filter(|candidate| !candidate.is_resident)
        .map(|&Candidate { distance, patch, .. }| {
            let distance = f32::from_bits(distance).sqrt();
            (outlook.urgency(distance, centroid(patch)).to_bits(), patch)
        })
        .collect();
    adds.sort_unstable_by(|a, b| b.cmp(a));
    adds.into_iter().map(|(_, patch)| patch).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_focus_runs_ahead_of_a_moving_camera_but_not_away_from_it() {
        for (velocity, expected) in [(0.0, 1.0), (4.0, 3.0), (-4.0, -1.0), (1000.0, 11.0), (f32::MAX, 11.0)] {
            let camera = Camera { position: Vec3::X, forward: Vec3::X, velocity: Vec3::X * velocity };
            assert!((ahead(&camera, 0.5, 10.0) - Vec3::X * expected).length() < 1e-5, "{velocity} m/s");
        }
    }

    #[test]
    fn tiles_are_wanted_along_the_way_and_a_still_camera_has_none() {
        let config = EngineConfig { load_radius_m: 10.0, ..EngineConfig::default() };
        let stops = |velocity: f32| {
            let camera = Camera { position: Vec3::X, forward: Vec3::X, velocity: Vec3::X * velocity };
            Outlook::of(&camera, &config, f32::INFINITY).stops(10.0).collect::<Vec<_>>()
        };
        assert_eq!(stops(0.0), [(Vec3::X, 0.0)]);
        for velocity in [1.0, 20.0, 2778.0, f32::MAX] {
            let stops = stops(velocity);
            let end = 1.0 + velocity.min(10.0 * f32::from(EngineConfig::TILE_WAY_RADII));
            assert!((stops.last().unwrap().0.x - end).abs() < 1e-3, "{velocity} m/s: {stops:?}");
            assert!(stops.windows(2).all(|pair| pair[0].0.distance(pair[1].0) <= 10.001), "{stops:?}");
        }
    }

    #[test]
    fn what_lies_in_view_comes_first_and_nothing_comes_nearer_than_it_is() {
        let camera = Camera { position: Vec3::ZERO, forward: Vec3::X * 3.0, velocity: Vec3::ZERO };
        let config = EngineConfig { view_bias: 1.0, ..EngineConfig::default() };
        let outlook = Outlook::of(&camera, &config, f32::INFINITY);
        let urgency = |place: Vec3| outlook.urgency(place.length(), place);
        assert_eq!(urgency(Vec3::X * 2.0), 2.0);
        assert_eq!(urgency(Vec3::X * -2.0), 4.0);
        assert_eq!(urgency(Vec3::Y * 2.0), 3.0);
        let nowhere = Outlook::of(&Camera { forward: Vec3::ZERO, ..camera }, &config, f32::INFINITY);
        assert!(nowhere.urgency(2.0, Vec3::Y * 2.0).is_finite());
        assert_eq!(outlook.urgency(0.0, Vec3::ZERO), 0.0);
    }
}
