//! One light at one point with a normal, nothing in between: the closed forms of `KHR_lights_punctual`.
//!
//! No shadows here (see [`crate::direct`]) and no bounces. The sun may have a size; everything else
//! is a point.

use earthshine_world::{Light, Rgb, Vec3};
use std::f32::consts::TAU;

/// Light that reaches a point if nothing is in between.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrival {
    /// From the point to the light, unit.
    pub towards: Vec3,
    /// How far a shadow ray must go, m; infinite for the sun.
    pub distance_m: f32,
    /// On the surface, lx: the cosine is in it.
    pub irradiance: Rgb,
}

/// Smallest difference of the cone's cosines, as `KHR_lights_punctual` bounds it.
pub const CONE_COSINES_MIN: f32 = 1e-3;

/// What `light` brings to `position` on a surface facing `normal` (unit); `None` when it cannot reach.
///
/// `disc`, two numbers in `[0, 1)`, chooses a place on the sun's disc: the mean over all of them is the
/// illuminance of the whole sun. Other lights ignore it.
#[must_use]
pub fn arrival(light: &Light, position: Vec3, normal: Vec3, disc: (f32, f32)) -> Option<Arrival> {
    match *light {
        Light::Directional { direction, illuminance, angular_diameter_rad } => {
            let half_angle = 0.5 * angular_diameter_rad;
            let towards = direction_in_cap(-direction, half_angle, disc);
            // Directions are uniform over the cap; the mean of their cosine to the axis is
            // (1 + cos) / 2, and this factor makes a surface that faces the sun receive `illuminance`.
            let strength = illuminance * (2.0 / (1.0 + half_angle.cos()));
            lit(towards, f32::INFINITY, strength, normal)
        }
        Light::Point { position: lamp, intensity, range_m } => {
            let (towards, distance) = towards_lamp(position, lamp)?;
            lit(towards, distance, intensity * distance_falloff(distance, range_m), normal)
        }
        Light::Spot { position: lamp, direction, intensity, inner_cone_rad, outer_cone_rad, range_m } => {
            let (towards, distance) = towards_lamp(position, lamp)?;
            let cone = cone_falloff((-towards).dot(direction), inner_cone_rad, outer_cone_rad);
            lit(towards, distance, intensity * (cone * distance_falloff(distance, range_m)), normal)
        }
    }
}

/// By how much a cone is taken to be wider than it is, rad: angles of `f32` are off by less.
const CONE_MARGIN_RAD: f32 = 2e-3;

/// Whether `light` can bring anything to a point within `radius_m` of `centre`, by its range and its cone: never a wrong no.
/// Street lamps have no range, mostly, but a cone.
#[must_use]
pub fn may_reach(light: &Light, centre: Vec3, radius_m: f32) -> bool {
    let (Light::Point { position, range_m, .. } | Light::Spot { position, range_m, .. }) = *light else {
        return true;
    };
    let way = centre - position;
    let distance = way.length();
    if range_m.is_some_and(|range_m| distance > range_m + radius_m) {
        return false;
    }
    let Light::Spot { direction, outer_cone_rad, .. } = *light else { return true };
    // `arrival` takes a direction for as long as it is, which may be a little more than 1.
    let half_angle = (outer_cone_rad.cos() / direction.length().max(1.0)).acos();
    distance <= radius_m
        || way.angle_between(direction) <= half_angle + (radius_m / distance).asin() + CONE_MARGIN_RAD
}

fn lit(towards: Vec3, distance_m: f32, on_facing: Rgb, normal: Vec3) -> Option<Arrival> {
    let irradiance = on_facing * normal.dot(towards).max(0.0);
    (irradiance.max_element() > 0.0).then_some(Arrival { towards, distance_m, irradiance })
}

fn towards_lamp(position: Vec3, lamp: Vec3) -> Option<(Vec3, f32)> {
    let offset = lamp - position;
    let distance = offset.length();
    Some((offset.try_normalize()?, distance))
}

/// `1 / d^2` under the window that reaches zero at the range, 1/m2.
fn distance_falloff(distance: f32, range_m: Option<f32>) -> f32 {
    let window = range_m.map_or(1.0, |range| (1.0 - (distance / range).powi(4)).clamp(0.0, 1.0));
    window / (distance * distance)
}

/// One on the axis, zero outside the outer cone, the square of a straight line in the cosine between.
fn cone_falloff(cosine: f32, inner_rad: f32, outer_rad: f32) -> f32 {
    let (inner, outer) = (inner_rad.cos(), outer_rad.cos());
    let linear = ((cosine - outer) / (inner - outer).max(CONE_COSINES_MIN)).clamp(0.0, 1.0);
    linear * linear
}

/// A direction within `half_angle` of unit `axis`, uniform in solid angle over `disc`.
fn direction_in_cap(axis: Vec3, half_angle: f32, disc: (f32, f32)) -> Vec3 {
    if half_angle <= 0.0 {
        return axis;
    }
    // 1 - cos of a small angle loses its digits; 2 sin^2 of the half does not.
    let height = 2.0 * (0.5 * half_angle).sin().powi(2) * disc.0;
    let radius = (height * (2.0 - height)).max(0.0).sqrt();
    let (sin, cos) = (TAU * disc.1).sin_cos();
    let (side, up) = axis.any_orthonormal_pair();
    (axis * (1.0 - height) + (side * cos + up * sin) * radius).normalize_or(axis)
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::random::{Purpose, hash, unit_f32};

    const CENTRE: (f32, f32) = (0.5, 0.5);

    fn received(light: &Light, position: Vec3, normal: Vec3) -> f32 {
        arrival(light, position, normal, CENTRE).map_or(0.0, |arrival| arrival.irradiance.x)
    }

    fn lamp(range_m: Option<f32>) -> Light {
        Light::Point { position: Vec3::ZERO, intensity: Rgb::splat(100.0), range_m }
    }

    #[test]
    fn a_lamp_falls_off_with_the_square_and_the_cosine() {
        let facing = received(&lamp(None), Vec3::new(0.0, -2.0, 0.0), Vec3::Y);
        assert!((facing - 25.0).abs() < 1e-4, "{facing}");
        let far = received(&lamp(None), Vec3::new(0.0, -4.0, 0.0), Vec3::Y);
        assert!((far - 6.25).abs() < 1e-4, "{far}");
        let tilted = Vec3::new((60f32).to_radians().sin(), (60f32).to_radians().cos(), 0.0);
        assert!((received(&lamp(None), Vec3::new(0.0, -2.0, 0.0), tilted) - 12.5).abs() < 1e-4);
        assert_eq!(arrival(&lamp(None), Vec3::new(0.0, -2.0, 0.0), Vec3::NEG_Y, CENTRE), None);
        assert_eq!(arrival(&lamp(None), Vec3::ZERO, Vec3::Y, CENTRE), None);
    }

    #[test]
    fn the_range_is_a_smooth_window() {
        let at = |distance: f32| received(&lamp(Some(4.0)), Vec3::new(0.0, -distance, 0.0), Vec3::Y);
        assert!((at(2.0) - 25.0 * (1.0 - 1.0 / 16.0)).abs() < 1e-4);
        assert_eq!(at(4.0), 0.0);
        assert_eq!(at(5.0), 0.0);
        assert!(at(3.99) < 0.1 && at(3.99) > 0.0);
    }

    #[test]
    fn a_cone_is_full_inside_squared_between_and_dark_outside() {
        let (inner, outer) = (0.3f32, 0.6f32);
        let spot = Light::Spot {
            position: Vec3::ZERO,
            direction: Vec3::NEG_Y,
            intensity: Rgb::splat(100.0),
            inner_cone_rad: inner,
            outer_cone_rad: outer,
            range_m: None,
        };
        let at = |angle: f32| {
            let along = Vec3::new(angle.sin(), -angle.cos(), 0.0);
            received(&spot, along, -along)
        };
        assert!((at(0.0) - 100.0).abs() < 1e-3);
        assert!((at(0.29) - 100.0).abs() < 1e-3);
        let middle = 0.45f32;
        let expected = 100.0 * ((middle.cos() - outer.cos()) / (inner.cos() - outer.cos())).powi(2);
        assert!((at(middle) - expected).abs() < 1e-3, "{} for {expected}", at(middle));
        assert_eq!(at(0.61), 0.0);
    }

    #[test]
    fn a_hard_cone_does_not_divide_by_zero() {
        assert_eq!(cone_falloff(0.9f32, 0.3, 0.3), 0.0);
        assert_eq!(cone_falloff(0.3f32.cos() + 0.002, 0.3, 0.3), 1.0);
    }

    #[test]
    fn the_sun_brings_its_illuminance_times_the_cosine() {
        let sun = Light::Directional {
            direction: Vec3::new(0.0, -0.6, -0.8),
            illuminance: Rgb::new(1e5, 9e4, 8e4),
            angular_diameter_rad: 0.0,
        };
        let found = arrival(&sun, Vec3::splat(3.0), Vec3::Y, CENTRE).expect("by day");
        assert!((found.irradiance - Rgb::new(6e4, 5.4e4, 4.8e4)).length() < 0.1);
        assert_eq!(found.distance_m, f32::INFINITY);
        assert!((found.towards - Vec3::new(0.0, 0.6, 0.8)).length() < 1e-6);
        assert_eq!(arrival(&sun, Vec3::ZERO, Vec3::NEG_Y, CENTRE), None);
    }

    /// Mean over the disc of a sun of 10 lx at `zenith_angle`, on the ground, lx.
    fn from_disc(diameter: f32, zenith_angle: f32) -> f64 {
        const STEPS: usize = 128;
        let (sin, cos) = zenith_angle.sin_cos();
        let sun = Light::Directional {
            direction: -Vec3::new(0.6 * sin, cos, 0.8 * sin),
            illuminance: Rgb::splat(10.0),
            angular_diameter_rad: diameter,
        };
        let step = |i: usize| (i as f32 + 0.5) / STEPS as f32;
        let places = (0..STEPS * STEPS).map(|i| (step(i / STEPS), step(i % STEPS)));
        let found = places.filter_map(|disc| arrival(&sun, Vec3::ZERO, Vec3::Y, disc));
        found.map(|arrival| f64::from(arrival.irradiance.x)).sum::<f64>() / (STEPS * STEPS) as f64
    }

    #[test]
    fn the_mean_over_a_disc_of_any_size_is_the_illuminance() {
        for diameter in [0.0093f32, 0.5, 3.0] {
            let mean = from_disc(diameter, 0.0);
            assert!((mean - 10.0).abs() < 1e-3, "diameter {diameter}: {mean}");
        }
    }

    /// What a plane receives of an evenly bright disc of angular radius `radius` that would bring 1 to a plane facing
    /// it, its centre at `zenith_angle`: the configuration factor of a sphere seen from a tilted plate (J. R. Howell,
    /// catalogue of radiation heat transfer configuration factors, B-43), over `sin^2(radius)`.
    fn disc_on_plane(radius: f64, zenith_angle: f64) -> f64 {
        use std::f64::consts::{FRAC_PI_2, PI};
        if zenith_angle <= FRAC_PI_2 - radius {
            return zenith_angle.cos();
        }
        if zenith_angle >= FRAC_PI_2 + radius {
            return 0.0;
        }
        let (height, root) = (1.0 / radius.sin(), 1.0 / radius.tan());
        let (sin, cos) = zenith_angle.sin_cos();
        let part = cos * (-root * cos / sin).acos() - root * (1.0 - (height * cos).powi(2)).sqrt();
        let factor = 0.5 - (root / (height * sin)).asin() / PI + part / (PI * height * height);
        factor * height * height
    }

    #[test]
    fn a_disc_partly_below_the_horizon_brings_the_part_above() {
        for diameter in [0.0093f32, 0.1, 0.5, 1.0] {
            let radius = 0.5 * diameter;
            for step in -6..=6 {
                let zenith_angle = std::f32::consts::FRAC_PI_2 + step as f32 / 4.0 * radius;
                let found = from_disc(diameter, zenith_angle) / 10.0;
                let expected = disc_on_plane(f64::from(radius), f64::from(zenith_angle));
                // In units of what a plane facing the disc would receive from its cosines there.
                let scale = f64::from(radius.sin());
                let difference = (found - expected).abs() / scale;
                assert!(difference < 3e-3, "diameter {diameter}, step {step}: {found} for {expected}");
            }
        }
        // On the horizon itself the formula is one that is easily checked: a - sin a cos a over pi sin^2 a.
        let radius = 0.25f64;
        let half = (radius - radius.sin() * radius.cos()) / (std::f64::consts::PI * radius.sin().powi(2));
        assert!((disc_on_plane(radius, std::f64::consts::FRAC_PI_2) - half).abs() < 1e-12);
    }

    /// Goal: no light is passed over. Method: random lamps, narrow and wide, their axes as long as they may be, and points in balls
    /// about the edges of their cones and ranges.
    #[test]
    fn what_a_lamp_reaches_is_never_denied() {
        let number = |seed: u64, at: u64| unit_f32(hash(seed, Purpose::WorldShape, at, 0));
        let vector =
            |seed: u64, at: u64| Vec3::from_array([0, 1, 2].map(|k| number(seed, at + k) * 2.0 - 1.0));
        let (mut lit, mut denied) = (0u32, 0u32);
        for seed in 0..100_000u64 {
            let outer_cone_rad = 0.02 + 1.5 * number(seed, 0).powi(3);
            let axis = vector(seed, 1).normalize_or(Vec3::Y);
            let range_m = seed.is_multiple_of(3).then_some(30.0);
            let lamp = vector(seed, 4) * 50.0;
            let spot = Light::Spot {
                position: lamp,
                direction: axis * (1.0 + 4e-4 * (number(seed, 7) * 2.0 - 1.0)),
                intensity: Rgb::ONE,
                inner_cone_rad: 0.9 * outer_cone_rad,
                outer_cone_rad,
                range_m,
            };
            let (side, up) = axis.any_orthonormal_pair();
            let (sin, cos) = (TAU * number(seed, 8)).sin_cos();
            let angle = outer_cone_rad * (0.97 + 0.06 * number(seed, 9));
            let edge = axis * angle.cos() + (side * cos + up * sin) * angle.sin();
            let distance = 1.0 + 60.0 * number(seed, 10);
            let point = lamp + edge * distance;
            let radius_m = 0.3 * number(seed, 11).powi(4);
            let centre = point + vector(seed, 12).normalize_or(Vec3::X) * radius_m * 0.999;
            let brings = arrival(&spot, point, -edge, (0.0, 0.0)).is_some();
            let may = may_reach(&spot, centre, radius_m);
            assert!(may || !brings, "case {seed}: {spot:?} {point}");
            lit += u32::from(brings);
            denied += u32::from(!may);
        }
        assert!(lit > 20_000 && denied > 20_000, "{lit} lit, {denied} denied");
    }
}
