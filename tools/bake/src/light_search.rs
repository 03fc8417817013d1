//! Paths from a suspect point that look for light: the sky, an emitter, or a place that a lamp shines on.
//!
//! Each segment begins where another ended. So a search says what it casts next and is told what that met: the same rule
//! for one search after the other here, and for many in step on a device.

use crate::exposure::ExposureTest;
use earthshine_trace::hemisphere::cosine_direction;
use earthshine_trace::{Hit, Query, RayFan};
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{Light, Vec3};

/// Paths from a point, and segments of each.
const PATHS: u64 = 4;
const SEGMENTS: u64 = 6;

/// A search on its way.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LightSearch {
    key: u64,
    /// Where paths begin, and what faces there.
    origin: Vec3,
    normal: Vec3,
    /// Of the segment, among those of all paths.
    number: u64,
    /// Where it begins, and what faces there.
    place: Vec3,
    side: Vec3,
    /// Whether the lamp that is asked for there does not shine on it.
    is_past_lamp: bool,
}

/// A ray that a search casts.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Sight {
    /// As far as a lamp.
    Lamp(Query),
    /// As far as it goes.
    Way(Query),
}

impl Sight {
    /// The ray.
    pub(crate) fn query(&self) -> &Query {
        match self {
            Self::Lamp(query) | Self::Way(query) => query,
        }
    }
}

impl LightSearch {
    /// From where the rays of `fan` begin; `key` is the point's.
    pub(crate) fn new(fan: &RayFan, key: u64) -> Self {
        let RayFan { origin, normal, .. } = *fan;
        Self { key, origin, normal, number: 0, place: origin, side: normal, is_past_lamp: false }
    }

    /// What is cast next.
    pub(crate) fn sight(&self, test: &ExposureTest<'_>) -> Sight {
        let bits = hash(test.seed, Purpose::BuriedTest, self.key, 1 + self.number);
        // The low bits choose the lamp, the high ones the direction.
        let lamp = if self.is_past_lamp { None } else { self.towards_lamp(test, bits & 0xFFFF) };
        lamp.map_or_else(
            || {
                let (u, v) = unit_pair(bits);
                let direction = cosine_direction(self.side, u, v);
                Sight::Way(Query { origin: self.place, direction, distance_max: f32::INFINITY })
            },
            Sight::Lamp,
        )
    }

    /// Hears whether something stands before the lamp; whether light is found, once that is known.
    pub(crate) fn pass_lamp(&mut self, is_blocked: bool) -> Option<bool> {
        self.is_past_lamp = true;
        (!is_blocked).then_some(true)
    }

    /// Hears what is met on `way`; whether light is found, once that is known.
    pub(crate) fn follow(&mut self, test: &ExposureTest<'_>, way: &Query, hit: Option<Hit>) -> Option<bool> {
        let tracer = test.tracer.tracer();
        let Some(hit) = hit.filter(|hit| tracer.surface(hit).emitted_radiance == Vec3::ZERO) else {
            return Some(true);
        };
        self.side = tracer.normal(&hit);
        self.place = self.place + way.direction * hit.distance + self.side * test.off_surface_m;
        self.number += 1;
        self.is_past_lamp = false;
        if self.number.is_multiple_of(SEGMENTS) {
            (self.place, self.side) = (self.origin, self.normal);
        }
        (self.number == PATHS * SEGMENTS).then_some(false)
    }

    /// The ray to one lamp of the scene, drawn by `draw`, if it may shine here: a scene may have hundreds. The sun is not
    /// asked: whoever sees it sees the sky.
    fn towards_lamp(&self, test: &ExposureTest<'_>, draw: u64) -> Option<Query> {
        let lamps = &test.tracer.scene().lights;
        let lamp = lamps[(draw as usize).checked_rem(lamps.len())?];
        let (position, range_m, cone) = match lamp {
            Light::Directional { .. } => return None,
            Light::Point { position, range_m, .. } => (position, range_m, None),
            Light::Spot { position, direction, outer_cone_rad, range_m, .. } => {
                (position, range_m, Some((direction, outer_cone_rad.cos())))
            }
        };
        let distance = position.distance(self.place);
        let towards = (position - self.place) / distance.max(f32::MIN_POSITIVE);
        let may_shine = range_m.is_none_or(|range| distance < range)
            && cone.is_none_or(|(axis, cosine)| -towards.dot(axis) > cosine);
        may_shine.then_some(Query { origin: self.place, direction: towards, distance_max: distance })
    }
}
