//! Where in its voxel a surface lies, and how much that makes a point trust it.
//!
//! A voxel holds one value a direction, wherever in it the surface lies that the value is of. Points near the planes of
//! two floors in one column of voxels would read a mean of both; with the planes known, each reads its own. And a point
//! that lies in no plane near by is in the air, whatever surfaces share its voxels.

use glam::Vec3;

/// Code of a value without a plane: receivers', and those of servers that do not tell.
pub const UNKNOWN: u8 = 0;

/// At this distance from its plane, in voxels, a value counts half.
pub const PLANE_REACH_VOXELS: f32 = 0.1;

/// A point as near to a plane, in voxels, lies on its surface. Farther out it is in the air more and more, from
/// [`AIR_FROM_VOXELS`] on wholly.
pub const SURFACE_TO_VOXELS: f32 = 0.1;

/// From this distance on, in voxels, a surface leaves a point to the air.
pub const AIR_FROM_VOXELS: f32 = 0.3;

/// What such a surface counts nevertheless, so that it answers where there is no air.
pub const FAR_SURFACE: f32 = 0.01;

/// Steps between the two sides of a voxel; codes are one more than the step.
pub const PLANE_STEPS: f32 = 254.0;

/// The code of a plane that lies `offset` voxel edges (0..1) above the low side of its voxel, along the axis of its
/// direction. What is not a number is unknown.
#[must_use]
pub fn encode(offset: f32) -> u8 {
    if offset.is_nan() { UNKNOWN } else { 1 + (offset.clamp(0.0, 1.0) * PLANE_STEPS).round() as u8 }
}

/// How many voxel edges a point `height` of them above the low side of the voxel lies above plane `code`; 0 where the plane
/// is unknown.
#[must_use]
pub fn distance(code: u8, height: f32) -> f32 {
    if code == UNKNOWN { 0.0 } else { height - (f32::from(code) - 1.0) / PLANE_STEPS }
}

/// How much a value counts for a point `distance` voxel edges from its plane: `1 / (1 + (distance /
/// PLANE_REACH_VOXELS)^2)`.
#[must_use]
pub fn nearness(distance: f32) -> f32 {
    let distance = distance / PLANE_REACH_VOXELS;
    1.0 / (1.0 + distance * distance)
}

/// How much of a point `distance` voxel edges from a plane lies on its surface, not in the air: 1 to [`FAR_SURFACE`].
#[must_use]
pub fn on_surface(distance: f32) -> f32 {
    ((AIR_FROM_VOXELS - distance.abs()) / (AIR_FROM_VOXELS - SURFACE_TO_VOXELS)).clamp(FAR_SURFACE, 1.0)
}

/// How far a surface with unit `normal` may lie from the middle of its patch along `axis`, in voxel edges: a slanted
/// one goes through its voxel from one side to the other.
#[must_use]
pub fn slant(normal: Vec3, axis: usize) -> f32 {
    let along = normal[axis].abs();
    0.5 * (normal.abs().element_sum() - along) / along.max(f32::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_say_where_a_plane_is_to_half_a_step() {
        for offset in [0.0, 0.001, 0.25, 0.5, 0.999, 1.0] {
            let code = encode(offset);
            assert_ne!(code, UNKNOWN);
            assert!(distance(code, offset).abs() < 0.51 / PLANE_STEPS);
            assert!((nearness(distance(code, offset + PLANE_REACH_VOXELS)) - 0.5).abs() < 0.03);
        }
        assert_eq!([encode(-3.0), encode(7.0), encode(f32::NAN)], [1, 255, UNKNOWN]);
        assert_eq!(nearness(distance(UNKNOWN, 12.0)), 1.0);
    }

    #[test]
    fn what_lies_off_a_plane_is_in_the_air() {
        assert_eq!([0.0, -0.09, 0.3, -0.7].map(on_surface), [1.0, 1.0, FAR_SURFACE, FAR_SURFACE]);
        assert!((on_surface(-0.2) - 0.5).abs() < 1e-5);
    }

    #[test]
    fn slanted_surfaces_reach_from_side_to_side() {
        assert_eq!(slant(Vec3::NEG_Y, 1), 0.0);
        assert!((slant(Vec3::new(0.6, 0.0, -0.8), 0) - 0.5 * 0.8 / 0.6).abs() < 1e-6);
        assert!(slant(Vec3::X, 2) > 1e30, "a direction that it does not face");
    }
}
