//! Clear-sky daylight by the sun's elevation: how bright, and roughly what colour. A simple model, for moving lights.
//!
//! - Air mass: Kasten and Young 1989, `1 / (sin h + 0.50572 (h + 6.07995)^-1.6364)`, h in degrees.
//! - Sun: `127.5 klx * exp(-t m)` a channel (IES 1984, recommended practice for daylight availability, whose `t` for a
//!   clear sky is 0.21). The optical depths `t` are Rayleigh's `0.008735 l^-4.08` and an aerosol's `0.0506 l^-1.3` at
//!   680, 550 and 440 nm, the aerosol chosen to give 0.21 in green. Outside the air sunlight counts as white.
//!   A setting sun fades with the share of its disc above the horizon.
//! - Sky: `0.8 + 15.5 sqrt(sin h)` klx on an open horizontal plane (IES 1984, clear); below the horizon it falls
//!   exponentially through the 3.4 lx of the end of civil twilight at -6 degrees and is dark from -18 degrees on.
//! - The gradient's hues: Rayleigh's blue at the zenith; at the horizon what ten air masses scatter of sunlight that
//!   came through a seventh of the sun's own path, twice as bright. They are choices and move no illuminance.
//! - Ground: what a grey plane returns of both.
//!
//! Not here: where the sun is ([`crate::sun`]), clouds, the moon, the sky's bright patch around the sun.

use glam::Vec3;

/// Diameter of the sun seen from the ground, rad.
pub const SUN_ANGULAR_DIAMETER_RAD: f32 = 0.0093;

/// Illuminance facing the sun outside the air, lx.
const SOLAR_ILLUMINANCE_LX: f32 = 127_500.0;
/// Rayleigh's optical depth at 680, 550 and 440 nm.
const RAYLEIGH: Vec3 = Vec3::new(0.0421, 0.1001, 0.2489);
/// The aerosol's.
const AEROSOL: Vec3 = Vec3::new(0.0835, 0.1100, 0.1471);
/// Air masses that the horizon's light is scattered by.
const HORIZON_AIR_MASSES: f32 = 10.0;
/// Share of the sun's own path that its light travels before it is scattered at the horizon.
const HORIZON_PATH_SHARE: f32 = 1.0 / 7.0;
/// Luminance of the horizon over that of the zenith.
const HORIZON_OVER_ZENITH: f32 = 2.0;
/// Sky on a horizontal plane with the sun on the horizon, lx.
const SUNSET_SKY_LX: f32 = 800.0;
/// Added with the root of the sine of the elevation, lx.
const DAY_SKY_LX: f32 = 15_500.0;
/// Sky on a horizontal plane at [`CIVIL_TWILIGHT_DEG`], lx.
const CIVIL_TWILIGHT_LX: f32 = 3.4;
const CIVIL_TWILIGHT_DEG: f32 = -6.0;
/// Astronomical twilight ends.
const NIGHT_DEG: f32 = -18.0;
/// Linear RGB of Rec. 709 to luminance.
const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// What sun and sky bring at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Daylight {
    /// On a surface that faces the sun, linear RGB, lx.
    pub sun_illuminance: Vec3,
    /// Radiance overhead, cd/m2.
    pub zenith: Vec3,
    /// Radiance all around, cd/m2.
    pub horizon: Vec3,
    /// Radiance of the ground below the world, cd/m2.
    pub ground: Vec3,
}

impl Daylight {
    /// With the sun `elevation_deg` above the horizon, over a ground that reflects `ground_reflectance`.
    #[must_use]
    pub fn clear(elevation_deg: f32, ground_reflectance: f32) -> Self {
        let mass = air_mass(elevation_deg);
        let depth = RAYLEIGH + AEROSOL;
        let through = |depth: Vec3| Vec3::new((-depth.x).exp(), (-depth.y).exp(), (-depth.z).exp());
        let sun_illuminance = through(depth * mass) * (SOLAR_ILLUMINANCE_LX * disc_share(elevation_deg));
        let horizon_hue =
            (Vec3::ONE - through(depth * HORIZON_AIR_MASSES)) * through(depth * (mass * HORIZON_PATH_SHARE));
        // A gradient brings pi / 2 times (zenith + horizon) to a plane that faces up.
        let sum = sky_illuminance_lx(elevation_deg) / std::f32::consts::FRAC_PI_2;
        let zenith = hue(RAYLEIGH) * (sum / (1.0 + HORIZON_OVER_ZENITH));
        let horizon = hue(horizon_hue) * (sum * HORIZON_OVER_ZENITH / (1.0 + HORIZON_OVER_ZENITH));
        let from_sky = (zenith + horizon) * std::f32::consts::FRAC_PI_2;
        let from_sun = sun_illuminance * elevation_deg.to_radians().sin().max(0.0);
        let ground = (from_sky + from_sun) * (ground_reflectance / std::f32::consts::PI);
        Self { sun_illuminance, zenith, horizon, ground }
    }
}

/// `colour` at luminance one.
fn hue(colour: Vec3) -> Vec3 {
    colour / colour.dot(LUMINANCE).max(f32::MIN_POSITIVE)
}

/// How many times the air overhead a ray from the sun crosses; below the horizon as on it.
fn air_mass(elevation_deg: f32) -> f32 {
    let elevation_deg = elevation_deg.max(0.0);
    1.0 / (elevation_deg.to_radians().sin() + 0.505_72 * (elevation_deg + 6.079_95).powf(-1.636_4))
}

/// Share of the sun's disc above a level horizon.
pub(crate) fn disc_share(elevation_deg: f32) -> f32 {
    let height = (elevation_deg.to_radians() / (0.5 * SUN_ANGULAR_DIAMETER_RAD)).clamp(-1.0, 1.0);
    let share = 0.5 + (height.asin() + height * (1.0 - height * height).sqrt()) / std::f32::consts::PI;
    share.clamp(0.0, 1.0)
}

fn sky_illuminance_lx(elevation_deg: f32) -> f32 {
    if elevation_deg >= 0.0 {
        SUNSET_SKY_LX + DAY_SKY_LX * elevation_deg.to_radians().sin().sqrt()
    } else if elevation_deg > NIGHT_DEG {
        SUNSET_SKY_LX * (CIVIL_TWILIGHT_LX / SUNSET_SKY_LX).powf(elevation_deg / CIVIL_TWILIGHT_DEG)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn luminance(colour: Vec3) -> f32 {
        colour.dot(LUMINANCE)
    }

    #[test]
    fn the_air_overhead_is_one_and_at_the_horizon_thirty_eight() {
        assert!((air_mass(90.0) - 1.0).abs() < 1e-3);
        assert!((air_mass(30.0) - 1.994).abs() < 5e-3, "{}", air_mass(30.0));
        assert!((air_mass(0.0) - 37.92).abs() < 0.1, "{}", air_mass(0.0));
        assert_eq!(air_mass(-5.0), air_mass(0.0));
    }

    #[test]
    fn the_sun_is_as_bright_as_the_formula_and_redder_when_low() {
        let noon = Daylight::clear(90.0, 0.2).sun_illuminance;
        let green = 127_500.0 * (-0.2101f32).exp();
        assert!((noon.y / green - 1.0).abs() < 2e-3, "{noon}");
        let mut last = f32::INFINITY;
        for elevation in [90.0, 60.0, 30.0, 15.0, 5.0, 1.0, 0.3] {
            let sun = Daylight::clear(elevation, 0.2).sun_illuminance;
            assert!(sun.x > sun.y && sun.y > sun.z && sun.z > 0.0, "{elevation}: {sun}");
            let warmth = sun.z / sun.x;
            assert!(warmth < last, "{elevation}");
            last = warmth;
        }
    }

    #[test]
    fn a_setting_sun_fades_over_its_disc() {
        let radius_deg = (0.5 * SUN_ANGULAR_DIAMETER_RAD).to_degrees();
        let shares = [2.0, 1.0, 0.0, -1.0, -2.0].map(|radii| disc_share(radii * radius_deg));
        for (found, expected) in shares.into_iter().zip([1.0, 1.0, 0.5, 0.0, 0.0]) {
            assert!((found - expected).abs() < 1e-3, "{shares:?}");
        }
        assert_eq!(Daylight::clear(-1.0, 0.2).sun_illuminance, Vec3::ZERO);
    }

    #[test]
    fn the_gradient_brings_the_sky_s_illuminance() {
        for (elevation, expected) in
            [(90.0, 16_300.0), (30.0, 800.0 + 15_500.0 * 0.5f32.sqrt()), (0.0, 800.0)]
        {
            let day = Daylight::clear(elevation, 0.2);
            let open = luminance(day.zenith + day.horizon) * std::f32::consts::FRAC_PI_2;
            assert!((open / expected - 1.0).abs() < 1e-4, "{elevation}: {open}");
            assert!((luminance(day.horizon) / luminance(day.zenith) - 2.0).abs() < 1e-4);
        }
        let dusk = Daylight::clear(-6.0, 0.0);
        let open = luminance(dusk.zenith + dusk.horizon) * std::f32::consts::FRAC_PI_2;
        assert!((open / 3.4 - 1.0).abs() < 1e-3, "{open}");
        let night = Daylight::clear(-18.0, 0.2);
        assert_eq!(
            night,
            Daylight {
                sun_illuminance: Vec3::ZERO,
                zenith: Vec3::ZERO,
                horizon: Vec3::ZERO,
                ground: Vec3::ZERO
            }
        );
    }

    #[test]
    fn the_zenith_is_blue_the_horizon_pale_by_day_and_red_at_sunset() {
        let (noon, sunset) = (Daylight::clear(60.0, 0.2), Daylight::clear(0.0, 0.2));
        assert!(noon.zenith.z > 3.0 * noon.zenith.x);
        assert!(noon.horizon.z < 2.0 * noon.horizon.x, "{}", noon.horizon);
        assert!(sunset.horizon.x > 2.0 * sunset.horizon.z, "{}", sunset.horizon);
        let grey = 0.2 / std::f32::consts::PI;
        let falls = noon.sun_illuminance * 0.75f32.sqrt()
            + (noon.zenith + noon.horizon) * std::f32::consts::FRAC_PI_2;
        assert!((noon.ground - falls * grey).length() < 1e-3 * noon.ground.length());
    }
}
