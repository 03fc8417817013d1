//! A ray as devices are asked for it, and why they may not answer.

use crate::run_up;
use earthshine_world::Vec3;
use obvhs::ray::Ray;

/// A ray to be traced.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Query {
    /// m.
    pub origin: Vec3,
    /// Unit.
    pub direction: Vec3,
    /// m; crossings from zero to it count.
    pub distance_max: f32,
}

impl Query {
    pub(crate) fn ray(&self) -> Ray {
        run_up(self.origin, self.direction, 0.0, self.distance_max)
    }

    /// The ray as trees are asked: origin, direction without minus zeros, and the distances between which crossings count.
    #[must_use]
    pub fn as_asked(&self) -> (Vec3, Vec3, f32, f32) {
        let ray = self.ray();
        (ray.origin.into(), ray.direction.into(), ray.tmin, ray.tmax.min(f32::MAX))
    }
}

/// Why many rays could not be traced at once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CasterError(pub String);

impl std::fmt::Display for CasterError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for CasterError {}
