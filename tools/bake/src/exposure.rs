//! How exposed a point is: open, hidden in a crevice, or buried.
//!
//! *Buried* points lie inside of something closed (floor under a box, inside of a wall): most of their rays
//! end on back faces, and no path from them finds light. They get no patch, or their darkness would leak
//! through interpolation. Back faces alone do not tell: both sides of a triangle reflect, and many rooms are
//! modelled with their walls facing out.
//!
//! *Hidden* points see almost nothing but surfaces much nearer than a voxel (ceiling behind a lamp, wall behind
//! a picture). Others hardly see them, so they must not share in the mean light of their voxel; they count
//! only where a patch has nothing else. *Open* points share in it by their openness, the share of their rays that go
//! beyond what is near: a patch's exitance is what others see of it.

use crate::eye::Eye;
use crate::light_search::{LightSearch, Sight};
use crate::sample::SurfaceSample;
use earthshine_trace::{Query, RayFan};
use earthshine_world::random::{Purpose, hash, unit_pair};
use std::cell::{Cell, OnceCell};

/// What becomes of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Exposure {
    /// Stands for its area; the number is its openness, the share of its rays that go far, above zero.
    Open(f32),
    /// Stands for its area where nothing else does; the number is its openness.
    Hidden(f32),
    /// Stands for nothing.
    Buried,
}

impl Exposure {
    /// It as a number, for files: openness, that of what is hidden with its sign turned, or one below all of them.
    pub(crate) fn word(self) -> f32 {
        match self {
            Self::Open(openness) => openness,
            // Of none as well: zeros have a sign.
            Self::Hidden(openness) => -openness,
            Self::Buried => -2.0,
        }
    }

    /// What [`Self::word`] made.
    pub(crate) fn from_word(word: f32) -> Self {
        match word {
            -2.0 => Self::Buried,
            hidden if hidden.is_sign_negative() => Self::Hidden(-hidden),
            openness => Self::Open(openness),
        }
    }
}

/// More back faces than this share of its rays make a point suspect.
const BACK_SHARE: f32 = 0.5;
/// More surfaces near by than this share of its rays make a point hidden. A corner of two walls stays below.
pub const NEAR_SHARE: f32 = 0.62;
/// What is near: this share of a voxel's edge.
pub const NEAR_VOXELS: f32 = 0.25;
/// Rays after which a clear case is decided.
pub(crate) const FIRST_RAYS: u32 = 8;

/// What rays of a point tell about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Verdict {
    /// Its exposure.
    Clear(Exposure),
    /// It is buried, unless a path from it finds light.
    Suspect,
    /// Not enough yet.
    Unclear,
}

impl Verdict {
    /// Of the first [`FIRST_RAYS`], of which `back` met back faces and `near` something near.
    pub(crate) fn of_first(back: u32, near: u32) -> Self {
        if back == 0 && near < FIRST_RAYS / 2 {
            Self::Clear(Exposure::Open(1.0 - near as f32 / FIRST_RAYS as f32))
        } else if back == FIRST_RAYS {
            Self::Suspect
        } else {
            Self::Unclear
        }
    }

    /// Of all `rays`.
    pub(crate) fn of_all(back: u32, near: u32, rays: u32) -> Self {
        if back as f32 > rays as f32 * BACK_SHARE { Self::Suspect } else { Self::Clear(unburied(near, rays)) }
    }
}

/// The exposure of a point that is not buried.
pub(crate) fn unburied(near: u32, rays: u32) -> Exposure {
    let openness = 1.0 - near as f32 / rays as f32;
    if near as f32 > rays as f32 * NEAR_SHARE { Exposure::Hidden(openness) } else { Exposure::Open(openness) }
}

/// Tells the exposure of points; one a thread.
#[derive(Debug)]
pub struct ExposureTest<'a> {
    /// The scene.
    pub tracer: Eye<'a>,
    /// Most rays a point; most points need few.
    pub rays: u32,
    /// m.
    pub voxel_edge_m: f32,
    /// How far rays begin off their surface, m.
    pub off_surface_m: f32,
    /// Of the bake.
    pub seed: u64,
    /// Rays cast so far.
    pub cast: Cell<u64>,
}

impl ExposureTest<'_> {
    /// How exposed `sample` is.
    #[must_use]
    pub fn of(&self, sample: &SurfaceSample) -> Exposure {
        self.told(sample).0
    }

    /// The same, and whether it looked buried.
    pub(crate) fn told(&self, sample: &SurfaceSample) -> (Exposure, bool) {
        let fan = self.fan(sample);
        let (mut back, mut near) = (0, 0);
        let is_lit = OnceCell::new();
        let is_lit = || *is_lit.get_or_init(|| self.finds_light(&fan, sample.key()));
        for index in 0..self.rays {
            let Query { origin, direction, distance_max } = fan.query(index);
            self.count_ray();
            if let Some(hit) = self.tracer.closest(origin, direction, distance_max) {
                back += u32::from(self.tracer.tracer().is_back(&hit));
                near += u32::from(hit.distance < self.near_m());
            }
            if index + 1 == FIRST_RAYS {
                match Verdict::of_first(back, near) {
                    Verdict::Clear(exposure) => return (exposure, false),
                    Verdict::Suspect if !is_lit() => return (Exposure::Buried, true),
                    Verdict::Suspect | Verdict::Unclear => {}
                }
            }
        }
        match Verdict::of_all(back, near, self.rays) {
            Verdict::Clear(exposure) => (exposure, false),
            _ if is_lit() => (unburied(near, self.rays), true),
            _ => (Exposure::Buried, true),
        }
    }

    /// All rays that may be cast from `sample` whatever they find. The one rule for rays cast here and on a device.
    pub(crate) fn fan(&self, sample: &SurfaceSample) -> RayFan {
        RayFan {
            origin: sample.position + sample.normal * self.off_surface_m,
            normal: sample.normal,
            shift: unit_pair(hash(self.seed, Purpose::BuriedTest, sample.key(), 0)),
            first_pair: 0,
            ray_count: self.rays,
        }
    }

    /// What is nearer is near, m.
    pub(crate) fn near_m(&self) -> f32 {
        NEAR_VOXELS * self.voxel_edge_m
    }

    fn count_ray(&self) {
        self.cast.set(self.cast.get() + 1);
    }

    /// Whether any of some random paths meets the sky, an emitter, or a place that a lamp shines on.
    fn finds_light(&self, fan: &RayFan, key: u64) -> bool {
        let mut search = LightSearch::new(fan, key);
        loop {
            self.count_ray();
            let found = match search.sight(self) {
                Sight::Lamp(Query { origin, direction, distance_max }) => {
                    search.pass_lamp(self.tracer.is_blocked(origin, direction, distance_max))
                }
                Sight::Way(way) => search.follow(
                    self,
                    &way,
                    self.tracer.closest(way.origin, way.direction, way.distance_max),
                ),
            };
            if let Some(found) = found {
                return found;
            }
        }
    }
}
