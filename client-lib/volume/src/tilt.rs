//! In which plane a surface lies, tilted as it may be, and how much that makes a point trust its light.
//!
//! Where several surfaces share a voxel and a direction (a moulding and the wall behind it), a place along the axis
//! ([`crate::plane`]) does not tell them apart: a normal and a distance do. The server tells both of detail.

use glam::Vec3;

/// Two octahedral coordinates of a normal, 1..=255 with 128 for zero, and the distance from the middle of the voxel along it,
/// 1..=255 from one corner of the voxel to the opposite one.
pub type Tilt = [u8; 3];

/// Code of a plane that is not told.
pub const UNKNOWN: Tilt = [0; 3];

/// At this distance from its plane, in voxels, a value counts a quarter.
pub const TILT_REACH_VOXELS: f32 = 0.1;

/// A value whose normal differs by this, as the sine of half the angle, counts a quarter.
pub const TURN_REACH: f32 = 0.05;

/// Half of the largest coordinate of a normal.
const NORMAL_MIDDLE: f32 = 127.0;
/// Steps of a distance.
const DISTANCE_STEPS: f32 = 254.0;
/// Diagonal of a voxel in its edges.
const DIAGONAL: f32 = 1.732_050_8;

/// How many voxel edges a point `from_middle` of them from the middle of a value's voxel lies above the plane `tilt`. `None`
/// where the plane is unknown.
#[must_use]
pub fn distance(tilt: Tilt, from_middle: Vec3) -> Option<f32> {
    if tilt.contains(&0) {
        return None;
    }
    let distance = ((f32::from(tilt[2]) - 1.0) / DISTANCE_STEPS - 0.5) * DIAGONAL;
    Some(from_middle.dot(unit_normal(tilt)) - distance)
}

/// How much a value counts whose surface lies in the plane `tilt`, for a point on a surface with unit `normal`, `distance`
/// voxel edges from that plane: `1 / (1 + (distance / TILT_REACH_VOXELS)^2 + (s / TURN_REACH)^2)^2`, `s` the sine of half the
/// angle between the normals.
#[must_use]
pub fn trust(tilt: Tilt, distance: f32, normal: Vec3) -> f32 {
    let off = distance / TILT_REACH_VOXELS;
    let turned = 0.5 * (normal - unit_normal(tilt)).length() / TURN_REACH;
    (1.0 + off * off + turned * turned).powi(-2)
}

fn unit_normal([x, y, _]: Tilt) -> Vec3 {
    let [x, y] = [x, y].map(|code| (f32::from(code) - 128.0) / NORMAL_MIDDLE);
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize_or(Vec3::Z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plane;

    /// The plane x = 0.25, seen from above it.
    const WALL: Tilt = [255, 128, 165];

    #[test]
    fn what_lies_in_the_plane_is_trusted_and_a_quarter_where_it_should_be() {
        let in_plane = Vec3::new(0.25, 0.4, -0.3);
        let trusted = |from: Vec3, normal: Vec3| trust(WALL, distance(WALL, from).unwrap(), normal);
        assert!(trusted(in_plane, Vec3::X) > 0.99);
        assert!((trusted(in_plane + Vec3::X * TILT_REACH_VOXELS, Vec3::X) - 0.25).abs() < 0.03);
        let angle = 2.0 * TURN_REACH.asin();
        let turned = Vec3::new(angle.cos(), 0.0, angle.sin());
        assert!((trusted(in_plane, turned) - 0.25).abs() < 0.01);
        assert!(trusted(in_plane, Vec3::NEG_X) < 0.01);
    }

    /// Goal: what is square to its direction is told apart as by its place along the axis, only more sharply.
    #[test]
    fn square_planes_are_trusted_by_the_square_of_their_nearness() {
        for step in -20..=20 {
            let height = step as f32 / 20.0;
            let off = distance(WALL, Vec3::new(height - 0.5, 0.2, 0.1)).unwrap();
            let trusted = trust(WALL, off, Vec3::X);
            let near = plane::nearness(plane::distance(plane::encode(0.75), height));
            assert!((trusted.sqrt() - near).abs() < 0.05, "{height}: {trusted} and {near}");
        }
    }

    #[test]
    fn no_code_makes_a_number_that_is_none() {
        for code in 0..=255u8 {
            for other in [0, 1, 2, 64, 127, 128, 129, 255] {
                for tilt in [[code, other, 9], [other, code, 200], [other, 77, code]] {
                    let known =
                        distance(tilt, Vec3::new(0.3, -2.0, 0.1)).map(|off| trust(tilt, off, Vec3::Y));
                    assert_eq!(known.is_none(), tilt.contains(&0));
                    assert!(known.is_none_or(|trust| trust > 0.0 && trust <= 1.0), "{tilt:?}: {known:?}");
                }
            }
        }
    }
}
