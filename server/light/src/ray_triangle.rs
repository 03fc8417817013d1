//! Where a ray crosses a triangle: the one intersection that shadows and the reference tracer share.
//!
//! Two-sided, and closed over shared edges: a ray through an edge may count both neighbours but never
//! slips between them. `obvhs` has its own test, which drops a ray whose barycentric coordinate rounds
//! to -0.0 and so leaks light through the diagonals of closed boxes.

use glam::{Vec3, Vec3A};
use obvhs::ray::Ray;
use obvhs::rt_triangle::RtTriangle;

/// How far outside an edge still counts, in barycentric units: a few roundings of `f32`.
pub const EDGE_TOLERANCE: f32 = 1e-6;

/// A ray for the trees of `obvhs`, for crossings with `distance_min < distance < distance_max`.
///
/// Minus zero becomes zero: `obvhs` takes the sign of the inverse from the bits but the order of the box
/// planes from a comparison, so a direction such as `-Vec3::NEG_Y` misses everything.
#[inline]
#[must_use]
pub fn ray(from: Vec3, direction: Vec3, distance_min: f32, distance_max: f32) -> Ray {
    Ray::new(from.into(), (direction + Vec3::ZERO).into(), distance_min, distance_max)
}

/// A triangle laid out for intersection.
#[derive(Clone, Copy)]
pub struct RayTriangle(RtTriangle);

impl std::fmt::Debug for RayTriangle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RayTriangle").field("corner", &self.0.v0).finish_non_exhaustive()
    }
}

/// A ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Along the ray, in lengths of its direction.
    pub distance: f32,
    /// Weight of corner 1.
    pub u: f32,
    /// Weight of corner 2.
    pub v: f32,
    /// Whether the ray comes from the side where the corners run counter-clockwise.
    pub front: bool,
}

impl RayTriangle {
    /// From three corners, counter-clockwise seen from the front.
    #[must_use]
    pub fn new([a, b, c]: [Vec3; 3]) -> Self {
        Self(RtTriangle::new(a.into(), b.into(), c.into()))
    }

    /// Corner 0, corner 0 minus corner 1, corner 2 minus corner 0: all that a crossing hangs on.
    #[must_use]
    pub fn corner_and_edges(&self) -> [Vec3; 3] {
        [self.0.v0.into(), self.0.e1.into(), self.0.e2.into()]
    }

    /// The crossing with `tmin < distance < tmax` of `ray`, if there is one.
    #[inline]
    #[must_use]
    pub fn crossing(&self, ray: &Ray) -> Option<Crossing> {
        let triangle = &self.0;
        let to_corner: Vec3A = triangle.v0 - ray.origin;
        let across = ray.direction.cross(to_corner);
        // `ng` points to the back: e1 is stored as corner 0 minus corner 1.
        let facing = triangle.ng.dot(ray.direction);
        let inverse = 1.0 / facing;
        let u = across.dot(triangle.e2) * inverse;
        let v = across.dot(triangle.e1) * inverse;
        // NaN, from a ray within the plane, fails every comparison.
        let inside = u >= -EDGE_TOLERANCE && v >= -EDGE_TOLERANCE && u + v <= 1.0 + EDGE_TOLERANCE;
        let distance = triangle.ng.dot(to_corner) * inverse;
        if !(inside && distance > ray.tmin && distance < ray.tmax) {
            return None;
        }
        Some(Crossing { distance, u, v, front: facing > 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit_triangle() -> RayTriangle {
        RayTriangle::new([Vec3::ZERO, Vec3::X, Vec3::Y])
    }

    fn down(x: f32, y: f32) -> Ray {
        Ray::new_inf(glam::vec3a(x, y, 2.0), Vec3A::NEG_Z)
    }

    #[test]
    fn weights_belong_to_their_corners_and_the_front_is_counter_clockwise() {
        let hit = unit_triangle().crossing(&down(0.6, 0.3)).expect("inside");
        assert!((hit.u - 0.6).abs() < 1e-6 && (hit.v - 0.3).abs() < 1e-6, "{hit:?}");
        assert!((hit.distance - 2.0).abs() < 1e-6 && hit.front);
        let from_behind = Ray::new_inf(glam::vec3a(0.1, 0.1, -1.0), Vec3A::Z);
        assert!(!unit_triangle().crossing(&from_behind).expect("inside").front);
    }

    #[test]
    fn outside_beyond_and_in_the_plane_are_misses() {
        assert_eq!(unit_triangle().crossing(&down(0.6, 0.5)), None);
        let short = Ray::new(glam::vec3a(0.2, 0.2, 2.0), Vec3A::NEG_Z, 0.0, 1.9);
        assert_eq!(unit_triangle().crossing(&short), None);
        let grazing = Ray::new_inf(glam::vec3a(-1.0, 0.2, 0.0), Vec3A::X);
        assert_eq!(unit_triangle().crossing(&grazing), None);
    }

    #[test]
    fn nothing_slips_through_a_shared_diagonal() {
        let other = RayTriangle::new([Vec3::X, Vec3::ONE.with_z(0.0), Vec3::Y]);
        for i in 0..1000 {
            let x = i as f32 / 999.0;
            let ray = down(x, 1.0 - x);
            assert!(unit_triangle().crossing(&ray).is_some() || other.crossing(&ray).is_some(), "{x}");
        }
    }
}
