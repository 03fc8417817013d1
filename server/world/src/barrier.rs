//! Where a wall ends what a layer of detail stands for, in two bytes.
//!
//! A floor goes on behind the wall that stands on it, in the same plane and often in the same detail voxel, and another
//! light falls on it there. A barrier says where a layer's own side ends: a half plane, square to the two axes across its
//! direction's. `client-lib/volume` reads the same codes.

use crate::Direction;
use glam::Vec3;
use std::f32::consts::TAU;

/// The side of a wall that a layer lies on: what is further towards [`Self::towards`] than [`Self::middle_distance`] is beyond it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Barrier {
    /// Which way the wall is: 1..=252 once around the axis of the layer's direction, from the axis after it towards the one
    /// after that.
    angle: u8,
    /// 0..=250 from [`Self::REACH`] behind the middle of the cube to as much before it.
    distance: u8,
}

impl Barrier {
    /// Most barriers of a layer: those of a corner.
    pub const PER_LAYER_MAX: usize = 2;
    /// How far from the middle of its cube one may be, in cube edges: across the cubes beside it.
    pub const REACH: f32 = 1.5;
    /// Codes of an angle: a multiple of four, so that walls along an axis are met.
    const ANGLES: u8 = 252;
    /// Steps of a distance.
    const STEPS: u8 = 250;

    /// Of a layer that faces `direction`: `distance` cube edges from the cube's middle towards `towards`, of which only what is
    /// across the direction's axis counts. `None` where that is nothing, or the distance more than [`Self::REACH`].
    #[must_use]
    pub fn new(direction: Direction, towards: Vec3, distance: f32) -> Option<Self> {
        let [across, up] = axes(direction);
        let (x, y) = (towards[across], towards[up]);
        let is_across = x.hypot(y) > f32::MIN_POSITIVE;
        if !is_across || distance.is_nan() || distance.abs() > Self::REACH {
            return None;
        }
        let turn = (y.atan2(x) / TAU).rem_euclid(1.0) * f32::from(Self::ANGLES);
        let share = 0.5 + 0.5 * distance / Self::REACH;
        Some(Self {
            angle: 1 + (turn.round() as u8) % Self::ANGLES,
            distance: (share * f32::from(Self::STEPS)).round() as u8,
        })
    }

    /// The unit vector towards the wall.
    #[must_use]
    pub fn towards(self, direction: Direction) -> Vec3 {
        let [across, up] = axes(direction);
        let (sine, cosine) = (TAU * f32::from(self.angle - 1) / f32::from(Self::ANGLES)).sin_cos();
        let mut towards = Vec3::ZERO;
        (towards[across], towards[up]) = (cosine, sine);
        towards
    }

    /// How far from the cube's middle it is, in cube edges; negative where the middle is beyond it.
    #[must_use]
    pub fn middle_distance(self) -> f32 {
        (f32::from(self.distance) / f32::from(Self::STEPS) - 0.5) * 2.0 * Self::REACH
    }

    /// As it is kept and told: angle and distance. The first is never 0, which stands for no barrier.
    #[must_use]
    pub fn code(self) -> [u8; 2] {
        [self.angle, self.distance]
    }

    /// Those of a layer, as they are kept and told: zeros for none.
    #[must_use]
    pub fn codes(barriers: [Option<Self>; Self::PER_LAYER_MAX]) -> [[u8; 2]; Self::PER_LAYER_MAX] {
        barriers.map(|barrier| barrier.map_or([0; 2], Self::code))
    }

    /// What [`Self::code`] made, or zeros for none.
    ///
    /// # Errors
    /// The code, if it is of no barrier.
    pub fn from_code(code: [u8; 2]) -> Result<Option<Self>, [u8; 2]> {
        match code {
            [0, 0] => Ok(None),
            [angle @ 1..=Self::ANGLES, distance @ 0..=Self::STEPS] => Ok(Some(Self { angle, distance })),
            _ => Err(code),
        }
    }
}

/// The two axes across that of `direction`.
fn axes(direction: Direction) -> [usize; 2] {
    [1, 2].map(|step| (direction.axis() + step) % 3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, hash, unit_f32};

    #[test]
    fn barriers_come_back_as_they_were() {
        let number = |i: u64, k: u64| unit_f32(hash(1, Purpose::Simulation, i, k)) - 0.5;
        let any = (0..2000).map(|i| Vec3::new(number(i, 0), number(i, 1), number(i, 2)));
        let axes = Direction::ALL.map(Direction::vector);
        for direction in Direction::ALL {
            for towards in axes.into_iter().chain(any.clone()) {
                let flat = towards - direction.vector() * towards.dot(direction.vector());
                for distance in [-1.5, -0.3, 0.0, 0.5, 1.5] {
                    let made = Barrier::new(direction, towards, distance);
                    if flat.length() < 1e-6 {
                        assert_eq!(made, None);
                        continue;
                    }
                    let made = made.expect("it is across the direction's axis");
                    assert!((made.towards(direction) - flat.normalize_or_zero()).length() < 0.013, "{flat}");
                    assert!((made.middle_distance() - distance).abs() < 0.0061);
                    assert_eq!(Barrier::from_code(made.code()), Ok(Some(made)));
                }
            }
        }
        for towards in axes {
            if let Some(made) = Barrier::new(Direction::PosY, towards, 0.0) {
                assert!((made.towards(Direction::PosY) - towards).length() < 1e-6, "{towards}");
            }
        }
    }

    #[test]
    fn what_is_no_barrier_is_refused() {
        assert_eq!(Barrier::new(Direction::PosX, Vec3::Y, 1.6), None);
        assert_eq!(Barrier::new(Direction::PosX, Vec3::Y, f32::NAN), None);
        assert_eq!(Barrier::new(Direction::PosX, Vec3::splat(f32::NAN), 0.5), None);
        assert_eq!(Barrier::from_code([0, 0]), Ok(None));
        for code in [[0, 1], [253, 0], [1, 251]] {
            assert_eq!(Barrier::from_code(code), Err(code));
        }
    }
}
