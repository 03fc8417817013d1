//! How exposed a point is: open, hidden in a crevice, or buried.
//!
//! *Buried* points lie inside of something closed (floor under a box, inside of a wall): most of their rays
//! end on back faces, and no path from them finds light. They get no patch, or their darkness would leak
//! through interpolation. Back faces alone do not tell: both sides of a triangle reflect, and many rooms are
//! modelled with their walls facing out.
//!
//! *Hidden* points see almost nothing but surfaces much nearer than a voxel (ceiling behind a lamp, wall behind
//! a picture). Others hardly see them, so they must not share in the mean light of their voxel; they count
//! only where a patch has nothing else. *Open* points share in it by their openness: a patch's exitance is
//! what others see of it.

use crate::eye::Eye;
use crate::sample::SurfaceSample;
use earthshine_trace::hemisphere::{cosine_direction, spread_pair};
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{Light, Vec3};
use std::cell::{Cell, OnceCell};

/// What becomes of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Exposure {
    /// Stands for its area; the number is its openness, the share of its rays that go far, above zero.
    Open(f32),
    /// Stands for its area where nothing else does.
    Hidden,
    /// Stands for nothing.
    Buried,
}

/// More back faces than this share of its rays make a point suspect.
const BACK_SHARE: f32 = 0.5;
/// More surfaces near by than this share of its rays make a point hidden. A corner of two walls stays below.
pub const NEAR_SHARE: f32 = 0.62;
/// What is near: this share of a voxel's edge.
pub const NEAR_VOXELS: f32 = 0.25;
/// Rays after which a clear case is decided.
const FIRST_RAYS: u32 = 8;
/// Paths, and segments of each, that look for light from a suspect point.
const LIGHT_PATHS: u64 = 4;
const LIGHT_PATH_SEGMENTS: u64 = 6;

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
        let key = sample.key();
        let (shift_u, shift_v) = unit_pair(hash(self.seed, Purpose::BuriedTest, key, 0));
        let origin = sample.position + sample.normal * self.off_surface_m;
        let (mut back, mut near) = (0, 0);
        let is_lit = OnceCell::new();
        let is_lit = || *is_lit.get_or_init(|| self.finds_light(origin, sample.normal, key));
        for index in 0..self.rays {
            let (u, v) = spread_pair(index, shift_u, shift_v);
            let direction = cosine_direction(sample.normal, u, v);
            self.count_ray();
            if let Some(hit) = self.tracer.closest(origin, direction, f32::INFINITY) {
                back += u32::from(self.tracer.tracer().is_back(&hit));
                near += u32::from(hit.distance < NEAR_VOXELS * self.voxel_edge_m);
            }
            if index + 1 == FIRST_RAYS && back == 0 && near < FIRST_RAYS / 2 {
                return Exposure::Open(1.0 - near as f32 / FIRST_RAYS as f32);
            }
            if index + 1 == FIRST_RAYS && back == FIRST_RAYS && !is_lit() {
                return Exposure::Buried;
            }
        }
        let limit = |share: f32| self.rays as f32 * share;
        if back as f32 > limit(BACK_SHARE) && !is_lit() {
            Exposure::Buried
        } else if near as f32 > limit(NEAR_SHARE) {
            Exposure::Hidden
        } else {
            Exposure::Open(1.0 - near as f32 / self.rays as f32)
        }
    }

    fn count_ray(&self) {
        self.cast.set(self.cast.get() + 1);
    }

    /// Whether any of some random paths meets the sky, an emitter, or a place that a lamp shines on.
    fn finds_light(&self, origin: Vec3, normal: Vec3, key: u64) -> bool {
        (0..LIGHT_PATHS).any(|path| {
            let (mut place, mut side) = (origin, normal);
            for segment in 0..LIGHT_PATH_SEGMENTS {
                let index = 1 + path * LIGHT_PATH_SEGMENTS + segment;
                let bits = hash(self.seed, Purpose::BuriedTest, key, index);
                // The low bits choose the lamp, the high ones the direction.
                if self.sees_lamp(place, bits & 0xFFFF) {
                    return true;
                }
                let (u, v) = unit_pair(bits);
                let direction = cosine_direction(side, u, v);
                self.count_ray();
                let Some(hit) = self.tracer.closest(place, direction, f32::INFINITY) else {
                    return true;
                };
                if self.tracer.tracer().surface(&hit).emitted_radiance != Vec3::ZERO {
                    return true;
                }
                side = self.tracer.tracer().normal(&hit);
                place = place + direction * hit.distance + side * self.off_surface_m;
            }
            false
        })
    }

    /// Whether one lamp of the scene, drawn by `draw`, shines on `place`: a scene may have hundreds. The sun is not
    /// asked: whoever sees it sees the sky.
    fn sees_lamp(&self, place: Vec3, draw: u64) -> bool {
        let lamps = &self.tracer.scene().lights;
        let Some(lamp) = (draw as usize).checked_rem(lamps.len()).map(|index| lamps[index]) else {
            return false;
        };
        let (position, range_m, cone) = match lamp {
            Light::Directional { .. } => return false,
            Light::Point { position, range_m, .. } => (position, range_m, None),
            Light::Spot { position, direction, outer_cone_rad, range_m, .. } => {
                (position, range_m, Some((direction, outer_cone_rad.cos())))
            }
        };
        let distance = position.distance(place);
        let towards = (position - place) / distance.max(f32::MIN_POSITIVE);
        range_m.is_none_or(|range| distance < range)
            && cone.is_none_or(|(axis, cosine)| -towards.dot(axis) > cosine)
            && {
                self.count_ray();
                !self.tracer.is_blocked(place, towards, distance)
            }
    }
}
