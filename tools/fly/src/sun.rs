//! A sun that moves while the camera flies.

use earthshine_client::{LightSource, Lights};
use glam::Vec3;

/// From one place in the sky to another, at an even pace.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunPath {
    /// From +X towards +Z, at the start and at the end, degrees.
    pub azimuth_deg: [f32; 2],
    /// Above the horizon, at the start and at the end, degrees.
    pub elevation_deg: [f32; 2],
    /// On a surface that faces the sun, linear RGB, lx; none below the horizon.
    pub illuminance: Vec3,
    /// How often the lights are sent, 1/s.
    pub rate_hz: f32,
}

impl SunPath {
    /// Diameter of the sun seen from the ground, rad.
    pub const ANGULAR_DIAMETER_RAD: f32 = 0.0093;

    /// Where the sun's light goes at `share` (0..=1) of the flight; unit.
    #[must_use]
    pub fn direction(&self, share: f32) -> Vec3 {
        let at = |[from, to]: [f32; 2]| (from + (to - from) * share).to_radians();
        let (sin_elevation, cos_elevation) = at(self.elevation_deg).sin_cos();
        let (sin_azimuth, cos_azimuth) = at(self.azimuth_deg).sin_cos();
        -Vec3::new(cos_elevation * cos_azimuth, sin_elevation, cos_elevation * sin_azimuth)
    }

    /// `base` with its directional lights replaced by this sun.
    #[must_use]
    pub fn lights(&self, base: &Lights, share: f32) -> Lights {
        let direction = self.direction(share);
        let lamps = base.sources.iter().filter(|source| !matches!(source, LightSource::Directional { .. }));
        let sun = LightSource::Directional {
            direction,
            illuminance: if direction.y < 0.0 { self.illuminance } else { Vec3::ZERO },
            angular_diameter_rad: Self::ANGULAR_DIAMETER_RAD,
        };
        Lights { sources: lamps.copied().chain(std::iter::once(sun)).collect(), ..base.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_rises_in_the_east_and_sets() {
        let sun = SunPath {
            azimuth_deg: [0.0, 0.0],
            elevation_deg: [90.0, -30.0],
            illuminance: Vec3::splat(1e5),
            rate_hz: 1.0,
        };
        assert!(sun.direction(0.0).distance(Vec3::NEG_Y) < 1e-6);
        assert!(sun.direction(0.75).distance(Vec3::NEG_X) < 1e-6);
        let lamp = LightSource::Point { position: Vec3::ZERO, intensity: Vec3::ONE, range_m: None };
        let old = LightSource::Directional {
            direction: Vec3::X,
            illuminance: Vec3::ONE,
            angular_diameter_rad: 0.0,
        };
        let base = Lights { sources: vec![old, lamp], ..Lights::default() };
        let day = sun.lights(&base, 0.25).sources;
        assert_eq!((day.len(), day[0]), (2, lamp));
        assert!(matches!(day[1], LightSource::Directional { illuminance, .. } if illuminance.x == 1e5));
        let night = sun.lights(&base, 1.0).sources;
        assert!(
            matches!(night[1], LightSource::Directional { illuminance, .. } if illuminance == Vec3::ZERO)
        );
    }
}
