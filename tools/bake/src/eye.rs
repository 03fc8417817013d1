//! How the rays of a stage look at the scene.
//!
//! An [`Eye`] is a tracer that may keep record of its rays, or cast them without looking: asked by a `Probe`, the same
//! code that casts a row's rays tells whether an edit can have changed what they find. Rays are made from seeds, so they
//! need not be kept to be cast again.

use crate::cells::Seen;
use crate::changes::Changes;
use earthshine_scene::Scene;
use earthshine_trace::{Hit, Query, SceneTracer};
use earthshine_world::{Vec3, VoxelCoord};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// A tracer with a purpose.
#[derive(Debug, Clone, Copy)]
pub struct Eye<'a> {
    tracer: &'a SceneTracer<'a>,
    purpose: Purpose<'a>,
}

#[derive(Debug, Clone, Copy)]
enum Purpose<'a> {
    Look,
    Note(&'a Seen<'a>),
    Trail(&'a Trail),
    Ask(&'a Probe<'a>),
}

/// What rays are told that are cast without looking.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Answer {
    /// They leave the world.
    Sky,
    /// They end where they begin, on a front face.
    Near,
}

impl Answer {
    fn hit(self) -> Option<Hit> {
        (self == Self::Near).then_some(Hit { triangle: 0, u: 0.0, v: 0.0, distance: 0.0, front: true })
    }
}

/// The way of one ray: origin, unit direction, and how far it got, m.
pub(crate) type Segment = (Vec3, Vec3, f32);

/// The rays of one point, in order. For one thread at a time.
#[derive(Debug, Default)]
pub(crate) struct Trail {
    segments: Mutex<Vec<Segment>>,
    /// What rays are told; `None` to look.
    answer: Option<Answer>,
}

impl Trail {
    /// Of rays that are told `answer` without looking.
    pub(crate) fn answering(answer: Answer) -> Self {
        Self { answer: Some(answer), ..Self::default() }
    }

    /// What there is, and begins anew.
    pub(crate) fn take(&self) -> Vec<Segment> {
        std::mem::take(&mut self.segments.lock().expect("no holder panics"))
    }

    fn add(&self, segment: Segment) {
        self.segments.lock().expect("no holder panics").push(segment);
    }
}

/// Asks whether rays can find other things than before some changes.
#[derive(Debug)]
pub(crate) struct Probe<'a> {
    changes: &'a Changes,
    answer: Answer,
    is_concerned: AtomicBool,
}

impl<'a> Probe<'a> {
    /// About rays that are told `answer`.
    pub(crate) fn new(changes: &'a Changes, answer: Answer) -> Self {
        Self { changes, answer, is_concerned: AtomicBool::new(false) }
    }

    /// Whether any ray so far can.
    pub(crate) fn is_concerned(&self) -> bool {
        self.is_concerned.load(Ordering::Relaxed)
    }

    /// A ray that something else stops before it comes to the changes has always been stopped there.
    fn hold(&self, tracer: &SceneTracer<'_>, origin: Vec3, direction: Vec3, distance_max: f32) {
        if !self.is_concerned()
            && let Some(distance) = self.changes.entry(origin, direction, distance_max)
            && !tracer.is_blocked(origin, direction, distance)
        {
            self.is_concerned.store(true, Ordering::Relaxed);
        }
    }
}

impl<'a> From<&'a SceneTracer<'a>> for Eye<'a> {
    fn from(tracer: &'a SceneTracer<'a>) -> Self {
        Self { tracer, purpose: Purpose::Look }
    }
}

impl<'a> Eye<'a> {
    /// Notes in `seen` what rays cross.
    #[must_use]
    pub fn noting(tracer: &'a SceneTracer<'a>, seen: &'a Seen<'a>) -> Self {
        Self { tracer, purpose: Purpose::Note(seen) }
    }

    /// Leaves its rays in `trail`.
    pub(crate) fn trailing(tracer: &'a SceneTracer<'a>, trail: &'a Trail) -> Self {
        Self { tracer, purpose: Purpose::Trail(trail) }
    }

    /// Does not look, and has `probe` asked about each ray.
    pub(crate) fn asking(tracer: &'a SceneTracer<'a>, probe: &'a Probe<'a>) -> Self {
        Self { tracer, purpose: Purpose::Ask(probe) }
    }

    /// What is looked at.
    #[must_use]
    pub fn scene(&self) -> &'a Scene {
        self.tracer.scene()
    }

    /// The tracer behind it.
    #[must_use]
    pub fn tracer(&self) -> &'a SceneTracer<'a> {
        self.tracer
    }

    /// As [`SceneTracer::closest`] from a distance of zero on.
    #[must_use]
    pub fn closest(&self, origin: Vec3, direction: Vec3, distance_max: f32) -> Option<Hit> {
        let look = || self.tracer.closest(origin, direction, 0.0, distance_max);
        let reach = |hit: &Option<Hit>| hit.map_or(distance_max, |hit| hit.distance);
        match self.purpose {
            Purpose::Look => look(),
            Purpose::Note(seen) => {
                let hit = look();
                seen.mark_way(origin, direction, reach(&hit));
                hit
            }
            Purpose::Trail(trail) => {
                let hit = trail.answer.map_or_else(look, Answer::hit);
                trail.add((origin, direction, reach(&hit)));
                hit
            }
            Purpose::Ask(probe) => {
                probe.hold(self.tracer, origin, direction, distance_max);
                probe.answer.hit()
            }
        }
    }

    /// As [`Self::closest`], where a device says that `query` meets `triangle` first; where that is not so here, `returned`
    /// hears of it and the ray is cast. For eyes that look or note.
    pub(crate) fn closest_named(
        &self,
        query: &Query,
        triangle: Option<u32>,
        returned: impl FnOnce(),
    ) -> Option<Hit> {
        let Query { origin, direction, distance_max } = *query;
        let hit = triangle.and_then(|triangle| {
            self.tracer.crossing(query, triangle).or_else(|| {
                returned();
                self.tracer.closest(origin, direction, 0.0, distance_max)
            })
        });
        if let Purpose::Note(seen) = self.purpose {
            seen.mark_way(origin, direction, hit.map_or(distance_max, |hit| hit.distance));
        }
        hit
    }

    /// As [`SceneTracer::is_blocked`].
    #[must_use]
    pub fn is_blocked(&self, origin: Vec3, direction: Vec3, distance: f32) -> bool {
        match self.purpose {
            Purpose::Look => {}
            Purpose::Note(seen) => seen.mark_way(origin, direction, distance),
            Purpose::Trail(trail) => trail.add((origin, direction, distance)),
            Purpose::Ask(probe) => {
                probe.hold(self.tracer, origin, direction, distance);
                return false;
            }
        }
        self.tracer.is_blocked(origin, direction, distance)
    }

    /// Notes the voxel that a hit is counted for.
    pub(crate) fn note_voxel(&self, voxel: VoxelCoord) {
        if let Purpose::Note(seen) = self.purpose {
            seen.mark_voxel(voxel);
        }
    }
}
