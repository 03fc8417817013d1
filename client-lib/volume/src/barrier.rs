//! Where walls end what a value of detail stands for, and how much that makes a point trust its light.
//!
//! A floor goes on behind the wall that stands on it, in the same plane ([`crate::tilt`] cannot tell the two sides apart) and
//! under another light. So a value may say where walls are near it: a point beyond them is on another side, and reads what lies
//! there.

use glam::Vec3;
use std::f32::consts::TAU;

/// Which way a wall is and how far from the middle of the voxel, a half plane square to the axis of the value's direction.
///
/// First the angle, 1..=252 once around that axis, from the axis after it (of x, y, z, x) towards the one after that; then the
/// distance, 0..=250 from [`BARRIER_REACH_VOXELS`] behind the middle to as much before it. Zeros for no wall.
pub type Barrier = [u8; 2];

/// Those of a value: two meet in a corner.
pub type Barriers = [Barrier; 2];

/// Of a value that no wall ends.
pub const NONE: Barriers = [[0; 2]; 2];

/// How far from the middle of its voxel a barrier may be, in voxel edges.
pub const BARRIER_REACH_VOXELS: f32 = 1.5;

/// Codes of an angle.
pub const BARRIER_ANGLES: u8 = 252;

/// Steps of a distance.
pub const BARRIER_STEPS: u8 = 250;

/// So far beyond a barrier, in voxel edges, a value counts a sixteenth. Twice what codes are off by: half a step of a
/// distance (0.006), and half a step of an angle as far along the wall as barriers reach (0.019).
pub const BEYOND_REACH_VOXELS: f32 = 0.05;

/// What is farther beyond counts no less, so that products of weights stay numbers: 1e-8.
pub const BEYOND_MAX_VOXELS: f32 = 0.5;

/// Whether `barrier` is none, or a code that there is.
#[must_use]
pub fn is_code(barrier: Barrier) -> bool {
    matches!(barrier, [0, 0] | [1..=BARRIER_ANGLES, 0..=BARRIER_STEPS])
}

/// How much a value on a direction along `axis` (0..3) with `barriers` counts for a point `from_middle` voxels from the middle of
/// the value's voxel: 1 on its side, `(1 + (beyond / BEYOND_REACH_VOXELS)^2)^-4` beyond a barrier, the product of both.
///
/// # Panics
/// If `axis` is not 0..3.
#[must_use]
pub fn trust(barriers: Barriers, axis: usize, from_middle: Vec3) -> f32 {
    let trust = |barrier: Barrier| {
        let off = beyond(barrier, axis, from_middle) / BEYOND_REACH_VOXELS;
        (1.0 + off * off).powi(-4)
    };
    barriers.into_iter().filter(|&barrier| barrier != [0; 2]).map(trust).product()
}

/// How far the point lies beyond `barrier`, in voxel edges, from 0 to [`BEYOND_MAX_VOXELS`].
fn beyond([angle, distance]: Barrier, axis: usize, from_middle: Vec3) -> f32 {
    let turn = TAU * (f32::from(angle) - 1.0) / f32::from(BARRIER_ANGLES);
    let (sine, cosine) = turn.sin_cos();
    let towards = cosine * from_middle[(axis + 1) % 3] + sine * from_middle[(axis + 2) % 3];
    let share = f32::from(distance) / f32::from(BARRIER_STEPS);
    (towards - (share - 0.5) * 2.0 * BARRIER_REACH_VOXELS).clamp(0.0, BEYOND_MAX_VOXELS)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of what faces up: the wall is towards x, 0.3 voxels from the middle.
    const WALL: Barrier = [1 + BARRIER_ANGLES / 4, 150];

    #[test]
    fn what_lies_beyond_a_wall_is_not_trusted() {
        let trusted = |x: f32| trust([WALL, [0; 2]], 1, Vec3::new(x, 7.0, -0.8));
        assert_eq!([-3.0, 0.0, 0.299].map(trusted), [1.0; 3]);
        assert!((trusted(0.3 + BEYOND_REACH_VOXELS) - 0.0625).abs() < 1e-4);
        assert!((trusted(2.0) - 1e-8).abs() < 1e-9 && trusted(2.0) == trusted(0.9));
        assert_eq!(trust(NONE, 1, Vec3::splat(9.0)), 1.0);
    }

    #[test]
    fn a_corner_is_beyond_both_of_its_walls() {
        // Towards -z: an eighth of a turn less than all around would be between z and x.
        let other = [1 + BARRIER_ANGLES / 2, 125];
        let trusted = |x: f32, z: f32| trust([WALL, other], 1, Vec3::new(x, 0.0, z));
        assert_eq!(trusted(0.2, 0.1), 1.0);
        assert!((trusted(0.35, 0.1) - 0.0625).abs() < 1e-4 && (trusted(0.2, -0.05) - 0.0625).abs() < 1e-4);
        assert!((trusted(0.35, -0.05) - 0.0625f32.powi(2)).abs() < 1e-5);
        assert!(trusted(3.0, -3.0) > 0.0);
    }

    #[test]
    fn no_code_makes_a_number_that_is_none() {
        for (angle, distance) in
            (0..=255u8).flat_map(|angle| (0..=255u8).map(move |distance| (angle, distance)))
        {
            let expected = (angle, distance) == (0, 0) || (1..=252).contains(&angle) && distance <= 250;
            assert_eq!(is_code([angle, distance]), expected);
            for axis in 0..3 {
                let trust = trust([[angle, distance]; 2], axis, Vec3::new(2.0, -1.5, 0.3));
                assert!(trust > 0.0 && trust <= 1.0, "{angle} {distance}: {trust}");
            }
        }
    }
}
