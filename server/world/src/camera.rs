//! Who looks, from where, how fast.

use glam::Vec3;

/// A camera as the engine sees it: where light is wanted, and where it will be wanted soon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// m.
    pub position: Vec3,
    /// Unit.
    pub forward: Vec3,
    /// m/s.
    pub velocity: Vec3,
}

impl Camera {
    /// Coordinates beyond this lose voxel precision in `f32`, m.
    pub const POSITION_MAX_M: f32 = 1e6;

    /// Whether all numbers are finite and the position is within [`Self::POSITION_MAX_M`].
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.position.is_finite()
            && self.forward.is_finite()
            && self.velocity.is_finite()
            && self.position.abs().max_element() <= Self::POSITION_MAX_M
    }
}
