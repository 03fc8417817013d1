//! A pinhole camera: from a place in the picture to a direction in the world.

use earthshine_world::Vec3;

/// Most pixels along an edge.
pub const EDGE_PIXELS_MAX: u32 = 16_384;

/// Where a picture is taken from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    position: Vec3,
    forward: Vec3,
    /// To the right edge at unit distance.
    right: Vec3,
    /// To the upper edge at unit distance.
    up: Vec3,
    width: u32,
    height: u32,
}

/// A camera that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// Not finite, or looking nowhere.
    #[error("the camera needs two different finite points to stand at and to look at")]
    NoDirection,
    /// A pinhole sees less than half of everything.
    #[error("the field of view is {0} degrees; it must be above 0 and below 180")]
    FieldOfView(f32),
    /// No pixels, or too many.
    #[error("{width} x {height} pixels; each edge must be 1 to {EDGE_PIXELS_MAX}")]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
}

impl Pinhole {
    /// Stands at `position`, looks at `target` with +Y up, sees `fov_deg` degrees from bottom to top.
    ///
    /// # Errors
    /// The two points give no direction, the field of view is not below 180 degrees, or there are no pixels.
    pub fn new(
        position: Vec3,
        target: Vec3,
        fov_deg: f32,
        width: u32,
        height: u32,
    ) -> Result<Self, CameraError> {
        let sizes = 1..=EDGE_PIXELS_MAX;
        if !(sizes.contains(&width) && sizes.contains(&height)) {
            return Err(CameraError::Size { width, height });
        }
        if !(fov_deg > 0.0 && fov_deg < 180.0) {
            return Err(CameraError::FieldOfView(fov_deg));
        }
        if !position.is_finite() {
            return Err(CameraError::NoDirection);
        }
        let forward = (target - position).try_normalize().ok_or(CameraError::NoDirection)?;
        // Straight up or down any right will do.
        let right = forward.cross(Vec3::Y).try_normalize().unwrap_or(Vec3::X);
        let half_height = (0.5 * fov_deg.to_radians()).tan();
        let half_width = half_height * width as f32 / height as f32;
        Ok(Self {
            position,
            forward,
            right: right * half_width,
            up: right.cross(forward) * half_height,
            width,
            height,
        })
    }

    /// The same view in `times` as many pixels along each edge, at most [`EDGE_PIXELS_MAX`] of them.
    #[must_use]
    pub fn finer(&self, times: u32) -> Self {
        let most = EDGE_PIXELS_MAX / self.width.max(self.height);
        let times = times.clamp(1, most.max(1));
        Self { width: self.width * times, height: self.height * times, ..*self }
    }

    /// m.
    #[must_use]
    pub fn position(&self) -> Vec3 {
        self.position
    }

    /// Pixels across.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Unit direction through `(x, y)` in pixels from the upper left corner.
    #[must_use]
    pub fn direction(&self, x: f32, y: f32) -> Vec3 {
        let across = 2.0 * x / self.width as f32 - 1.0;
        let upward = 1.0 - 2.0 * y / self.height as f32;
        (self.forward + self.right * across + self.up * upward).normalize_or(self.forward)
    }

    /// Where `position` is in the picture, in pixels from the upper left corner: the inverse of
    /// [`Self::direction`]. `None` for what is not in front; places beyond the edges are returned as such.
    #[must_use]
    pub fn project(&self, position: Vec3) -> Option<(f32, f32)> {
        let offset = position - self.position;
        let depth = offset.dot(self.forward);
        if depth <= 0.0 {
            return None;
        }
        let across = offset.dot(self.right) / (depth * self.right.length_squared());
        let upward = offset.dot(self.up) / (depth * self.up.length_squared());
        Some(((across + 1.0) * 0.5 * self.width as f32, (1.0 - upward) * 0.5 * self.height as f32))
    }

    /// Height of a pixel in the middle of the picture, radians.
    #[must_use]
    pub fn pixel_angle(&self) -> f32 {
        2.0 * self.up.length() / self.height as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_half_the_field_of_view_away() {
        let camera = Pinhole::new(Vec3::ZERO, Vec3::NEG_Z * 5.0, 90.0, 200, 100).unwrap();
        assert!((camera.direction(100.0, 50.0) - Vec3::NEG_Z).length() < 1e-6);
        let top = camera.direction(100.0, 0.0);
        assert!((top - Vec3::new(0.0, 1.0, -1.0).normalize_or_zero()).length() < 1e-6, "{top}");
        let right = camera.direction(200.0, 50.0);
        assert!((right - Vec3::new(2.0, 0.0, -1.0).normalize_or_zero()).length() < 1e-6, "{right}");
    }

    #[test]
    fn projecting_undoes_a_direction() {
        let camera = Pinhole::new(Vec3::new(1.0, 2.0, 3.0), Vec3::new(-2.0, 1.0, 0.5), 50.0, 64, 48).unwrap();
        for (x, y) in [(0.0, 0.0), (10.5, 40.25), (64.0, 48.0)] {
            let (px, py) =
                camera.project(camera.position() + camera.direction(x, y) * 7.0).expect("in front");
            assert!((px - x).abs() < 1e-3 && (py - y).abs() < 1e-3, "{px} {py} for {x} {y}");
        }
        assert_eq!(camera.project(camera.position() - camera.direction(32.0, 24.0)), None);
    }

    #[test]
    fn a_camera_may_look_straight_down() {
        let camera = Pinhole::new(Vec3::Y, Vec3::ZERO, 60.0, 10, 10).unwrap();
        assert!((camera.direction(5.0, 5.0) - Vec3::NEG_Y).length() < 1e-6);
        assert!((camera.direction(0.0, 5.0) - camera.direction(10.0, 5.0)).length() > 0.5);
    }

    #[test]
    fn impossible_cameras_are_refused() {
        let new = |target: Vec3, fov: f32, width: u32| Pinhole::new(Vec3::ZERO, target, fov, width, 10);
        assert_eq!(new(Vec3::ZERO, 60.0, 10), Err(CameraError::NoDirection));
        assert_eq!(new(Vec3::NAN, 60.0, 10), Err(CameraError::NoDirection));
        assert_eq!(new(Vec3::X, 180.0, 10), Err(CameraError::FieldOfView(180.0)));
        assert!(matches!(new(Vec3::X, f32::NAN, 10), Err(CameraError::FieldOfView(_))));
        assert_eq!(new(Vec3::X, 60.0, 0), Err(CameraError::Size { width: 0, height: 10 }));
    }
}
