//! The plane that what lies in a cube lies in, in three bytes.
//!
//! A detail voxel's surfaces are told apart by their planes: at bake time which samples belong together, at run time
//! which light a point reads. `client-lib/volume` reads the same codes.

use glam::Vec3;

/// A plane by its normal and its distance from the middle of a cube.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SurfacePlane {
    /// The normal on an octahedron: 1..=255 a coordinate, 128 for zero. No coordinate is 0.
    pub normal: [u8; 2],
    /// How far along the normal it lies, 0..=254 from one corner of the cube to the opposite one.
    pub distance: u8,
}

impl SurfacePlane {
    /// Steps of [`Self::distance`].
    pub const STEPS: u8 = 254;
    /// Half of the largest coordinate of a normal.
    const MIDDLE: f32 = 127.0;
    /// Diagonal of a cube in its edges.
    const DIAGONAL: f32 = 1.732_050_8;

    /// With unit `normal`, `distance` cube edges along it from the cube's middle.
    #[must_use]
    pub fn new(normal: Vec3, distance: f32) -> Self {
        let sum = normal.abs().element_sum().max(f32::MIN_POSITIVE);
        let (x, y) = (normal.x / sum, normal.y / sum);
        let fold = |along: f32, across: f32| (1.0 - across.abs()).copysign(along);
        let [x, y] = if normal.z < 0.0 { [fold(x, y), fold(y, x)] } else { [x, y] };
        let code = |along: f32| (along.clamp(-1.0, 1.0) * Self::MIDDLE).round() as i32 + 128;
        let share = (distance / Self::DIAGONAL + 0.5).clamp(0.0, 1.0);
        Self {
            normal: [code(x), code(y)].map(|code| code as u8),
            distance: (share * f32::from(Self::STEPS)).round() as u8,
        }
    }

    /// As it is told to clients: two coordinates of the normal, and one more than the distance. No byte is 0.
    #[must_use]
    pub fn code(self) -> [u8; 3] {
        let [x, y] = self.normal;
        [x, y, self.distance.saturating_add(1)]
    }

    /// Its unit normal, within 0.02 of the one it was made of.
    #[must_use]
    pub fn unit_normal(self) -> Vec3 {
        let [x, y] = self.normal.map(|code| (f32::from(code) - 128.0) / Self::MIDDLE);
        let z = 1.0 - x.abs() - y.abs();
        let fold = (-z).max(0.0);
        Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize_or(Vec3::Z)
    }

    /// How far along its normal from the cube's middle it lies, in cube edges.
    #[must_use]
    pub fn middle_distance(self) -> f32 {
        (f32::from(self.distance) / f32::from(Self::STEPS) - 0.5) * Self::DIAGONAL
    }

    /// Where it crosses the cube's middle line along `axis` (0..3), in cube edges from the low side, 0..=1.
    #[must_use]
    pub fn offset_along(self, axis: usize) -> f32 {
        let along = self.unit_normal()[axis];
        let crossing = self.middle_distance() / along;
        if crossing.is_finite() { (0.5 + crossing).clamp(0.0, 1.0) } else { 0.5 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Direction;
    use crate::random::{Purpose, hash, unit_f32};

    #[test]
    fn planes_come_back_as_they_were() {
        let axes = Direction::ALL.map(Direction::vector);
        let number = |i: u64, k: u64| unit_f32(hash(1, Purpose::Simulation, i, k)) - 0.5;
        let any =
            (0..2000).map(|i| Vec3::new(number(i, 0), number(i, 1), number(i, 2)).normalize_or(Vec3::X));
        for normal in axes.into_iter().chain(any) {
            for distance in [-0.85, -0.3, 0.0, 0.5, 0.86] {
                let plane = SurfacePlane::new(normal, distance);
                assert!((plane.unit_normal() - normal).length() < 0.02, "{normal}: {}", plane.unit_normal());
                assert!((plane.middle_distance() - distance).abs() < 0.004);
                assert!(plane.normal.iter().all(|&code| code > 0) && plane.distance <= SurfacePlane::STEPS);
            }
        }
        for axis in axes {
            assert_eq!(SurfacePlane::new(axis, 0.0).unit_normal(), axis);
        }
    }

    #[test]
    fn planes_cross_the_middle_line_where_they_should() {
        let up = SurfacePlane::new(Vec3::Y, 0.25);
        assert!((up.offset_along(1) - 0.75).abs() < 0.005);
        let down = SurfacePlane::new(Vec3::NEG_Y, 0.25);
        assert!((down.offset_along(1) - 0.25).abs() < 0.005);
        let slanted = SurfacePlane::new(Vec3::new(0.8, 0.6, 0.0), 0.12);
        assert!((slanted.offset_along(0) - 0.65).abs() < 0.02);
        assert!((slanted.offset_along(1) - 0.7).abs() < 0.02);
        assert!((0.0..=1.0).contains(&up.offset_along(0)));
    }
}
