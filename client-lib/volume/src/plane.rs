//! Where in its voxel a surface lies, and how much that makes a point trust it.
//!
//! A voxel holds one value a direction, wherever in it the surface lies that the value is of. Points near the planes of
//! two floors in one column of voxels would read a mean of both; with the planes known, each reads its own.

/// Code of a value without a plane: receivers', and those of servers that do not tell.
pub const UNKNOWN: u8 = 0;

/// At this distance from its plane, in voxels, a value counts half.
pub const PLANE_REACH_VOXELS: f32 = 0.1;

/// Steps between the two sides of a voxel; codes are one more than the step.
pub const PLANE_STEPS: f32 = 254.0;

/// The code of a plane that lies `offset` voxel edges (0..1) above the low side of its voxel, along the axis of its
/// direction. What is not a number is unknown.
#[must_use]
pub fn encode(offset: f32) -> u8 {
    if offset.is_nan() { UNKNOWN } else { 1 + (offset.clamp(0.0, 1.0) * PLANE_STEPS).round() as u8 }
}

/// How much a value with plane `code` counts for a point `height` voxel edges above the low side of the voxel:
/// `1 / (1 + (d / PLANE_REACH_VOXELS)^2)`, `d` voxel edges from the plane; 1 where the plane is unknown.
#[must_use]
pub fn nearness(code: u8, height: f32) -> f32 {
    if code == UNKNOWN {
        return 1.0;
    }
    let distance = (height - (f32::from(code) - 1.0) / PLANE_STEPS) / PLANE_REACH_VOXELS;
    1.0 / (1.0 + distance * distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_say_where_a_plane_is_to_half_a_step() {
        for offset in [0.0, 0.001, 0.25, 0.5, 0.999, 1.0] {
            let code = encode(offset);
            assert_ne!(code, UNKNOWN);
            assert!(nearness(code, offset) > 1.0 - (0.51 / PLANE_STEPS / PLANE_REACH_VOXELS).powi(2));
            assert!((nearness(code, offset + PLANE_REACH_VOXELS) - 0.5).abs() < 0.03);
        }
        assert_eq!([encode(-3.0), encode(7.0), encode(f32::NAN)], [1, 255, UNKNOWN]);
        assert_eq!(nearness(UNKNOWN, 12.0), 1.0);
    }
}
