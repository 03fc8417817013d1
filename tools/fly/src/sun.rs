//! Time of day as a path: a sun that moves while the camera flies, and a sky that follows it.
//!
//! Where the sun is comes from a [`SunCourse`], how bright and what colour from a [`SunLight`]
//! ([`crate::daylight`]). Files are read by [`crate::SunFile::load`] (`config/day.example.toml`).

use crate::daylight::{Daylight, SUN_ANGULAR_DIAMETER_RAD, disc_share};
use earthshine_client::{LightSource, Lights};
use glam::Vec3;

/// A number of a sun path that makes no sense.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{table}.{key} {cause}")]
pub struct SunFault {
    /// `course` or `light`.
    pub table: &'static str,
    /// Which of its keys.
    pub key: &'static str,
    /// What it is, and what it may be.
    pub cause: String,
}

/// A sun over a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunPath {
    /// Where it goes.
    pub course: SunCourse,
    /// What it brings.
    pub light: SunLight,
    /// How often the lights are sent, 1/s.
    pub rate_hz: f32,
}

/// Where the sun goes during the flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SunCourse {
    /// From one place in the sky to another, at an even pace.
    Straight {
        /// From +X towards +Z, at the start and at the end, degrees.
        azimuth_deg: [f32; 2],
        /// Above the horizon, at the start and at the end, degrees.
        elevation_deg: [f32; 2],
    },
    /// As seen from a place on Earth.
    Solar {
        /// North is positive, degrees.
        latitude_deg: f32,
        /// 1 is the first of January; 172 about midsummer in the north.
        day_of_year: u16,
        /// Solar time at the start of the flight, h; the sun is highest at 12.
        from_hour: f32,
        /// Solar time at its end, h; beyond 24 is the next day.
        to_hour: f32,
        /// Where north lies, from +X towards +Z, degrees; -90 is -Z.
        north_azimuth_deg: f32,
    },
}

impl SunCourse {
    fn validate(&self) -> Result<(), SunFault> {
        let range = |key, value, low, high| in_range("course", key, value, low, high);
        match *self {
            Self::Straight { azimuth_deg, elevation_deg } => {
                for (azimuth, elevation) in azimuth_deg.into_iter().zip(elevation_deg) {
                    range("azimuth_deg", azimuth, -3600.0, 3600.0)?;
                    range("elevation_deg", elevation, -90.0, 90.0)?;
                }
                Ok(())
            }
            Self::Solar { latitude_deg, day_of_year, from_hour, to_hour, north_azimuth_deg } => {
                range("latitude_deg", latitude_deg, -90.0, 90.0)?;
                range("day_of_year", f32::from(day_of_year), 1.0, 366.0)?;
                range("from_hour", from_hour, 0.0, SunPath::HOURS_MAX)?;
                range("to_hour", to_hour, from_hour, SunPath::HOURS_MAX)?;
                range("north_azimuth_deg", north_azimuth_deg, -360.0, 360.0)
            }
        }
    }
}

/// What the sun brings by its elevation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SunLight {
    /// The same wherever it stands, none below the horizon; the sky is left alone.
    Constant {
        /// On a surface that faces the sun, linear RGB, lx.
        illuminance: Vec3,
    },
    /// A clear sky: brightness, colour and a sky gradient follow the elevation.
    ClearSky {
        /// Of the ground below the world, 0 to 1.
        ground_reflectance: f32,
    },
}

impl SunLight {
    /// Brighter suns are probably meant otherwise, lx; as in lights files, which `earthshine fly` holds it to.
    pub const ILLUMINANCE_WARNING_LX: f32 = 1e9;

    fn validate(&self) -> Result<(), SunFault> {
        match *self {
            Self::Constant { illuminance } if illuminance.is_finite() && illuminance.min_element() >= 0.0 => {
                Ok(())
            }
            Self::Constant { .. } => Err(SunFault {
                table: "light",
                key: "illuminance",
                cause: "is negative or not finite; give zero or more lx".to_owned(),
            }),
            Self::ClearSky { ground_reflectance } => {
                in_range("light", "ground_reflectance", ground_reflectance, 0.0, 1.0)
            }
        }
    }
}

fn in_range(table: &'static str, key: &'static str, value: f32, low: f32, high: f32) -> Result<(), SunFault> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(SunFault { table, key, cause: format!("is {value}; it must be {low} to {high}") })
}

impl SunPath {
    /// Longest course of a flight, h: two days.
    pub const HOURS_MAX: f32 = 48.0;

    /// Checks all numbers but the rate, which is the flight's to judge.
    ///
    /// # Errors
    /// Which makes no sense, and what would.
    pub fn validate(&self) -> Result<(), SunFault> {
        self.course.validate()?;
        self.light.validate()
    }

    /// What is probably not meant, as a key of `light` and a sentence about it.
    #[must_use]
    pub fn remark(&self) -> Option<(&'static str, String)> {
        let SunLight::Constant { illuminance } = self.light else { return None };
        let brightest = illuminance.max_element();
        let text = if brightest <= 0.0 {
            "is zero: this sun gives no light at any time; give it lx, or fly without it".to_owned()
        } else if brightest > SunLight::ILLUMINANCE_WARNING_LX {
            let most = SunLight::ILLUMINANCE_WARNING_LX;
            format!("is {brightest:.1e} lx, more than {most:.0e} (the sun has 1e5): is a smaller one meant?")
        } else {
            return None;
        };
        Some(("illuminance", text))
    }

    /// Where the sun's light goes at `share` (0..=1) of the flight; unit.
    #[must_use]
    pub fn direction(&self, share: f32) -> Vec3 {
        let between = |[from, to]: [f32; 2]| from + (to - from) * share;
        match self.course {
            SunCourse::Straight { azimuth_deg, elevation_deg } => {
                let (sin_elevation, cos_elevation) = between(elevation_deg).to_radians().sin_cos();
                let (sin_azimuth, cos_azimuth) = between(azimuth_deg).to_radians().sin_cos();
                -Vec3::new(cos_elevation * cos_azimuth, sin_elevation, cos_elevation * sin_azimuth)
            }
            SunCourse::Solar { latitude_deg, day_of_year, from_hour, to_hour, north_azimuth_deg } => {
                let [east, north, up] =
                    solar_position(latitude_deg, day_of_year, between([from_hour, to_hour]));
                let (sin, cos) = north_azimuth_deg.to_radians().sin_cos();
                // East is a quarter turn clockwise from north, seen from above.
                -Vec3::new(north * cos - east * sin, up, north * sin + east * cos).normalize_or(Vec3::Y)
            }
        }
    }

    /// `base` with its directional lights replaced by this sun, and under a clear sky its sky as well.
    #[must_use]
    pub fn lights(&self, base: &Lights, share: f32) -> Lights {
        let direction = self.direction(share);
        let elevation_deg = (-direction.y).clamp(-1.0, 1.0).asin().to_degrees();
        let lamps = base.sources.iter().filter(|source| !matches!(source, LightSource::Directional { .. }));
        let (illuminance, sky) = match self.light {
            SunLight::Constant { illuminance } => (illuminance * disc_share(elevation_deg), base.sky),
            SunLight::ClearSky { ground_reflectance } => {
                let day = Daylight::clear(elevation_deg, ground_reflectance);
                (day.sun_illuminance, Lights::gradient_sky(day.zenith, day.horizon, day.ground))
            }
        };
        let sun = LightSource::Directional {
            direction,
            illuminance,
            angular_diameter_rad: SUN_ANGULAR_DIAMETER_RAD,
        };
        Lights { sources: lamps.copied().chain(std::iter::once(sun)).collect(), sky, ..base.clone() }
    }
}

/// Towards the sun: east, north, up; unit. The declination is Cooper's (1969), good to half a degree.
fn solar_position(latitude_deg: f32, day_of_year: u16, hour: f32) -> [f32; 3] {
    let year = (360.0 / 365.0 * (284.0 + f32::from(day_of_year))).to_radians();
    let (sin_declination, cos_declination) = (23.45 * year.sin()).to_radians().sin_cos();
    let (sin_latitude, cos_latitude) = latitude_deg.to_radians().sin_cos();
    let (sin_hour, cos_hour) = (15.0 * (hour - 12.0)).to_radians().sin_cos();
    [
        -cos_declination * sin_hour,
        cos_latitude * sin_declination - sin_latitude * cos_declination * cos_hour,
        sin_latitude * sin_declination + cos_latitude * cos_declination * cos_hour,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn straight(elevation_deg: [f32; 2]) -> SunPath {
        SunPath {
            course: SunCourse::Straight { azimuth_deg: [0.0, 0.0], elevation_deg },
            light: SunLight::Constant { illuminance: Vec3::splat(1e5) },
            rate_hz: 1.0,
        }
    }

    fn solar(latitude_deg: f32, day_of_year: u16) -> SunPath {
        let course = SunCourse::Solar {
            latitude_deg,
            day_of_year,
            from_hour: 0.0,
            to_hour: 24.0,
            north_azimuth_deg: -90.0,
        };
        SunPath { course, light: SunLight::ClearSky { ground_reflectance: 0.2 }, rate_hz: 1.0 }
    }

    fn elevation_deg(path: &SunPath, hour: f32) -> f32 {
        (-path.direction(hour / 24.0).y).asin().to_degrees()
    }

    #[test]
    fn the_sun_rises_in_the_east_and_sets() {
        let sun = straight([90.0, -30.0]);
        assert!(sun.direction(0.0).distance(Vec3::NEG_Y) < 1e-6);
        assert!(sun.direction(0.75).distance(Vec3::NEG_X) < 1e-6);
        let lamp = LightSource::Point { position: Vec3::ZERO, intensity: Vec3::ONE, range_m: None };
        let old = LightSource::Directional {
            direction: Vec3::X,
            illuminance: Vec3::ONE,
            angular_diameter_rad: 0.0,
        };
        let base = Lights { sources: vec![old, lamp], sky: [Vec3::ONE; 6], ..Lights::default() };
        let day = sun.lights(&base, 0.25);
        assert_eq!((day.sources.len(), day.sources[0], day.sky), (2, lamp, base.sky));
        let illuminance = |lights: &Lights| match lights.sources[1] {
            LightSource::Directional { illuminance, .. } => illuminance,
            _ => panic!("{lights:?}"),
        };
        assert!((illuminance(&day) - Vec3::splat(1e5)).length() < 0.1);
        assert_eq!(illuminance(&sun.lights(&base, 1.0)), Vec3::ZERO);
    }

    #[test]
    fn noon_stands_as_high_as_the_calendar_says() {
        // 90 degrees less the latitude, plus the declination.
        for (latitude, day, noon) in
            [(0.0, 81, 90.0), (50.0, 81, 40.0), (50.0, 172, 63.45), (50.0, 355, 16.55)]
        {
            let found = elevation_deg(&solar(latitude, day), 12.0);
            assert!((found - noon).abs() < 0.1, "{latitude}, {day}: {found} for {noon}");
        }
        // Midsummer at 70 degrees north: it does not set.
        assert!(elevation_deg(&solar(70.0, 172), 0.0) > 3.0);
    }

    #[test]
    fn at_the_equinox_it_rises_due_east_and_culminates_in_the_south() {
        let path = solar(50.0, 81);
        let towards = |hour: f32| -path.direction(hour / 24.0);
        assert!(towards(6.0).distance(Vec3::X) < 1e-2, "{}", towards(6.0));
        assert!(towards(18.0).distance(Vec3::NEG_X) < 1e-2);
        let noon = towards(12.0);
        assert!(noon.z > 0.5 && noon.x.abs() < 1e-3, "-Z is north: {noon}");
        let SunCourse::Solar { latitude_deg, day_of_year, from_hour, to_hour, .. } = path.course else {
            panic!("{path:?}")
        };
        let north_azimuth_deg = 0.0;
        let course = SunCourse::Solar { latitude_deg, day_of_year, from_hour, to_hour, north_azimuth_deg };
        let turned = SunPath { course, ..path };
        assert!((-turned.direction(0.25)).distance(Vec3::Z) < 1e-2, "north is +X, so east is +Z");
    }

    #[test]
    fn a_clear_day_brings_its_own_sky_and_nights_are_dark() {
        let path = solar(50.0, 172);
        let base = Lights { emission_scale: 0.5, ..Lights::default() };
        let (noon, night) = (path.lights(&base, 0.5), solar(50.0, 355).lights(&base, 0.0));
        assert_eq!(noon.emission_scale, 0.5);
        let day = Daylight::clear(elevation_deg(&path, 12.0), 0.2);
        assert_eq!(noon.sky, Lights::gradient_sky(day.zenith, day.horizon, day.ground));
        assert_eq!(night.sky, [Vec3::ZERO; 6]);
        assert!(noon.sources.iter().chain(&night.sources).all(|source| matches!(
            source, LightSource::Directional { illuminance, .. } if illuminance.is_finite()
        )));
    }

    #[test]
    fn impossible_courses_are_named() {
        assert_eq!(straight([0.0, 90.0]).validate(), Ok(()));
        assert_eq!(solar(-33.0, 366).validate(), Ok(()));
        let fault = |path: SunPath, word: &str| {
            let cause = path.validate().unwrap_err().to_string();
            assert!(cause.contains(word), "{cause}");
        };
        fault(straight([0.0, 91.0]), "course.elevation_deg is 91");
        fault(straight([f32::NAN, 0.0]), "course.elevation_deg");
        fault(solar(91.0, 1), "course.latitude_deg is 91; it must be -90 to 90");
        fault(solar(0.0, 0), "course.day_of_year");
        let constant = SunLight::Constant { illuminance: Vec3::new(1.0, -1.0, 0.0) };
        fault(SunPath { light: constant, ..solar(0.0, 1) }, "light.illuminance");
        let white = SunLight::ClearSky { ground_reflectance: 1.5 };
        fault(SunPath { light: white, ..solar(0.0, 1) }, "light.ground_reflectance");
        let backwards = SunCourse::Solar {
            latitude_deg: 0.0,
            day_of_year: 1,
            from_hour: 20.0,
            to_hour: 4.0,
            north_azimuth_deg: 0.0,
        };
        fault(SunPath { course: backwards, ..solar(0.0, 1) }, "course.to_hour is 4; it must be 20 to 48");
    }
}
