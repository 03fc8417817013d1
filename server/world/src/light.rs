//! Sun, lamps and sky, in glTF units.

use crate::{Direction, Rgb};
use glam::Vec3;

/// A delta light. `color * intensity` is premultiplied; clients draw its first arrival themselves.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
pub enum Light {
    /// The sun.
    Directional {
        /// Where its light goes, unit.
        direction: Vec3,
        /// On a surface that faces it, lx.
        illuminance: Rgb,
        /// Diameter seen from the ground, rad; 0 is a point at infinity.
        #[serde(default)]
        angular_diameter_rad: f32,
    },
    /// A bare lamp.
    Point {
        /// m.
        position: Vec3,
        /// cd.
        intensity: Rgb,
        /// Beyond it there is no light, m; `None` for no limit.
        #[serde(default)]
        range_m: Option<f32>,
    },
    /// A lamp with a cone.
    Spot {
        /// m.
        position: Vec3,
        /// Axis of the cone, unit.
        direction: Vec3,
        /// On the axis, cd.
        intensity: Rgb,
        /// Full intensity inside this half angle, rad.
        inner_cone_rad: f32,
        /// None outside this half angle, rad.
        outer_cone_rad: f32,
        /// Beyond it there is no light, m; `None` for no limit.
        #[serde(default)]
        range_m: Option<f32>,
    },
}

/// Radiance of the sky by direction lobe, cd/m2: along unit `d` it is `sum_a d_a^2 * lobe_a` over the lobes faced.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Sky {
    /// One a [`Direction`].
    pub lobes: [Rgb; 6],
}

impl Sky {
    /// The same radiance everywhere.
    #[must_use]
    pub fn constant(radiance: Rgb) -> Self {
        Self { lobes: [radiance; 6] }
    }

    /// From `horizon` all around to `zenith` above and `ground` below, blended by the squared sine of the elevation:
    /// with `s = d_y`, it is `s^2 * zenith + (1 - s^2) * horizon` above and the same with `ground` below. That blend
    /// is what the lobes can hold exactly, so nothing is projected.
    #[must_use]
    pub fn gradient(zenith: Rgb, horizon: Rgb, ground: Rgb) -> Self {
        let mut lobes = [horizon; 6];
        lobes[Direction::PosY.index()] = zenith;
        lobes[Direction::NegY.index()] = ground;
        Self { lobes }
    }

    /// Irradiance of a plane that faces `direction` with nothing in its way, lx.
    ///
    /// `integral of d_a^2 (d . b)` over the half space of `b` is `pi / 2` for the lobe faced, zero for the one behind
    /// and `pi / 8` for each of the four at its sides; they sum to `pi`.
    #[must_use]
    pub fn open_irradiance(&self, direction: Direction) -> Rgb {
        let weight = |lobe: Direction| match lobe {
            _ if lobe == direction => 0.5,
            _ if lobe.axis() == direction.axis() => 0.0,
            _ => 0.125,
        };
        let sum: Rgb = Direction::ALL.iter().map(|&lobe| self.lobes[lobe.index()] * weight(lobe)).sum();
        sum * std::f32::consts::PI
    }

    /// Radiance along unit `direction`, cd/m2.
    #[must_use]
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        (0..3)
            .map(|axis| {
                let component = direction[axis];
                self.lobes[Direction::of_component(axis, component).index()] * (component * component)
            })
            .sum()
    }

    /// Irradiance that a row's sky shares receive from this sky, lx: `pi * sum_lobe share * L`.
    #[must_use]
    pub fn irradiance(&self, sky_shares: &[f32; 6]) -> Rgb {
        self.lobes.iter().zip(sky_shares).map(|(&lobe, &share)| lobe * share).sum::<Rgb>()
            * std::f32::consts::PI
    }
}

/// Everything that lights a world, besides its own emissive surfaces.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightRig {
    /// Delta lights.
    #[serde(default)]
    pub lights: Vec<Light>,
    /// What escapes see.
    #[serde(default)]
    pub sky: Sky,
    /// Multiplies every emissive surface.
    #[serde(default = "one")]
    pub emission_scale: f32,
}

fn one() -> f32 {
    1.0
}

/// A light that cannot be: refused at the edge, by name.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("light {index}: {cause}")]
pub struct LightError {
    /// Position in [`LightRig::lights`]; the number of lights stands for the sky and the emission scale.
    pub index: usize,
    /// What is wrong with it.
    pub cause: &'static str,
}

/// Lamps and suns above this, cd and lx, and scales of emission are probably meant otherwise: the sun has 1e5 lx, a
/// lighthouse some 1e6 cd.
pub const STRENGTH_WARNING: f32 = 1e9;

/// Skies and surfaces brighter than this, cd/m2, are probably meant otherwise: a filament has some 1e7.
pub const RADIANCE_WARNING: f32 = 1e8;

impl LightRig {
    /// Only emissive surfaces: no lamps, a black sky.
    #[must_use]
    pub fn emission_only() -> Self {
        Self { emission_scale: 1.0, ..Self::default() }
    }

    /// Checks that every number is finite, every intensity non-negative and every direction a direction.
    ///
    /// # Errors
    /// The first light that is not.
    pub fn validate(&self) -> Result<(), LightError> {
        let not_negative = |rgb: Rgb| rgb.is_finite() && rgb.min_element() >= 0.0;
        for (index, light) in self.lights.iter().enumerate() {
            if let Some(cause) = light.fault(not_negative) {
                return Err(LightError { index, cause });
            }
        }
        let index = self.lights.len();
        if !self.sky.lobes.iter().all(|&lobe| not_negative(lobe)) {
            return Err(LightError { index, cause: "the sky's radiance is negative or not finite" });
        }
        if !(self.emission_scale.is_finite() && self.emission_scale >= 0.0) {
            return Err(LightError { index, cause: "the emission scale is negative or not finite" });
        }
        Ok(())
    }

    /// The first light, or else the sky or the emission scale, that is brighter than anything likely, and how bright.
    #[must_use]
    pub fn remark(&self) -> Option<String> {
        let strength = |light: &Light| light.strength().max_element();
        if let Some(index) = self.lights.iter().position(|light| strength(light) > STRENGTH_WARNING) {
            let found = strength(&self.lights[index]);
            return Some(format!(
                "light {index} has an intensity of {found:.1e} cd or lx, more than {STRENGTH_WARNING:.0e}"
            ));
        }
        let sky = self.sky.lobes.iter().map(|lobe| lobe.max_element()).fold(0.0, f32::max);
        if sky > RADIANCE_WARNING {
            return Some(format!("the sky has {sky:.1e} cd/m2, more than {RADIANCE_WARNING:.0e}"));
        }
        let scale = self.emission_scale;
        (scale > STRENGTH_WARNING)
            .then(|| format!("the emission scale is {scale:.1e}, more than {STRENGTH_WARNING:.0e}"))
    }
}

impl Light {
    /// What it sends out: cd, or lx of a sun.
    #[must_use]
    pub fn strength(&self) -> Rgb {
        match *self {
            Self::Directional { illuminance, .. } => illuminance,
            Self::Point { intensity, .. } | Self::Spot { intensity, .. } => intensity,
        }
    }

    fn fault(&self, not_negative: impl Fn(Rgb) -> bool) -> Option<&'static str> {
        let unit = |v: Vec3| v.is_finite() && (v.length_squared() - 1.0).abs() < 1e-3;
        let (direction, strength, position, range) = match *self {
            Self::Directional { direction, illuminance, angular_diameter_rad } => {
                if !(0.0..3.2).contains(&angular_diameter_rad) {
                    return Some("the angular diameter is not between 0 and pi");
                }
                (Some(direction), illuminance, Vec3::ZERO, None)
            }
            Self::Point { position, intensity, range_m } => (None, intensity, position, range_m),
            Self::Spot { position, direction, intensity, inner_cone_rad, outer_cone_rad, range_m } => {
                let ordered = inner_cone_rad >= 0.0 && inner_cone_rad <= outer_cone_rad;
                if !(ordered && outer_cone_rad <= std::f32::consts::FRAC_PI_2 + 1e-6) {
                    return Some("the cone angles are not 0 <= inner <= outer <= pi/2");
                }
                (Some(direction), intensity, position, range_m)
            }
        };
        if direction.is_some_and(|d| !unit(d)) {
            Some("the direction is not a unit vector")
        } else if !not_negative(strength) {
            Some("the intensity is negative or not finite")
        } else if !position.is_finite() {
            Some("the position is not finite")
        } else if range.is_some_and(|r| r.is_nan() || r <= 0.0) {
            Some("the range is not positive")
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_sky_is_the_same_in_every_direction() {
        let sky = Sky::constant(Rgb::new(1.0, 2.0, 3.0));
        let direction = Vec3::new(0.3, -0.5, 0.8).normalize_or_zero();
        assert!((sky.radiance(direction) - Rgb::new(1.0, 2.0, 3.0)).length() < 1e-5);
    }

    #[test]
    fn a_gradient_is_its_three_colours_and_their_blend() {
        let (zenith, horizon, ground) = (Rgb::new(1.0, 2.0, 6.0), Rgb::splat(3.0), Rgb::new(0.5, 0.4, 0.3));
        let sky = Sky::gradient(zenith, horizon, ground);
        assert_eq!([sky.radiance(Vec3::Y), sky.radiance(Vec3::NEG_Y)], [zenith, ground]);
        let level = sky.radiance(Vec3::new(0.6, 0.0, -0.8));
        assert!((level - horizon).length() < 1e-6, "{level}");
        // 30 degrees up: a quarter of the way by the squared sine.
        let between = sky.radiance(Vec3::new(0.75f32.sqrt(), 0.5, 0.0));
        assert!((between - zenith.lerp(horizon, 0.75)).length() < 1e-5, "{between}");
    }

    /// Midpoints in the cosine to `axis` and the angle around it: every direction of a half space.
    fn by_quadrature(sky: &Sky, axis: Vec3) -> Rgb {
        const STEPS: usize = 200;
        let (side, up) = axis.any_orthonormal_pair();
        let mut sum = Rgb::ZERO;
        for i in 0..STEPS {
            let cosine = (i as f32 + 0.5) / STEPS as f32;
            for j in 0..STEPS {
                let (sin, cos) = (std::f32::consts::TAU * (j as f32 + 0.5) / STEPS as f32).sin_cos();
                let direction = axis * cosine + (side * cos + up * sin) * (1.0 - cosine * cosine).sqrt();
                sum += sky.radiance(direction) * cosine;
            }
        }
        sum * (std::f32::consts::TAU / (STEPS * STEPS) as f32)
    }

    #[test]
    fn an_open_plane_receives_what_the_integral_says() {
        let even = Sky::constant(Rgb::splat(2.0)).open_irradiance(Direction::NegX);
        assert!((even.x - std::f32::consts::TAU).abs() < 1e-5, "pi L: {even}");
        let sky = Sky { lobes: [1.0, 2.0, 4.0, 8.0, 16.0, 32.0].map(|lobe| Rgb::new(lobe, 1.0, 0.0)) };
        for direction in Direction::ALL {
            let (closed, summed) = (sky.open_irradiance(direction), by_quadrature(&sky, direction.vector()));
            assert!((closed - summed).length() < 1e-3 * closed.length(), "{direction:?}: {closed} {summed}");
        }
    }

    #[test]
    fn impossible_lights_are_named() {
        let mut rig = LightRig::emission_only();
        rig.lights.push(Light::Point { position: Vec3::ZERO, intensity: Rgb::splat(-1.0), range_m: None });
        let error = rig.validate().expect_err("a negative lamp");
        assert_eq!((error.index, error.cause), (0, "the intensity is negative or not finite"));
    }

    #[test]
    fn what_is_brighter_than_likely_is_remarked_on() {
        let sun = |lux: f32| Light::Directional {
            direction: Vec3::NEG_Y,
            illuminance: Rgb::new(1.0, lux, 1.0),
            angular_diameter_rad: 0.0,
        };
        let rig = |lights: Vec<Light>| LightRig { lights, ..LightRig::emission_only() };
        assert_eq!(rig(vec![sun(1e5), sun(1e9)]).remark(), None);
        let remark = rig(vec![sun(1e5), sun(2e9)]).remark().unwrap();
        assert!(remark.contains("light 1 has an intensity of 2.0e9 cd or lx, more than 1e9"), "{remark}");
        let sky = LightRig { sky: Sky::constant(Rgb::splat(1e10)), ..rig(Vec::new()) };
        assert!(sky.remark().unwrap().contains("the sky has 1.0e10 cd/m2, more than 1e8"));
        let scale = LightRig { emission_scale: 1e12, ..rig(Vec::new()) };
        assert!(scale.remark().unwrap().contains("the emission scale is 1.0e12"));
        assert_eq!(rig(vec![sun(0.0)]).remark(), None, "switched off is no mistake while a world is served");
    }
}
