//! Sun, lamps and sky, as in `KHR_lights_punctual`.

use crate::{
    ClientError,
    camera::{vector_from_wire, vector_to_wire},
};
use earthshine_protocol::{
    LIGHTS_MAX,
    v1::{self, light::Kind},
};
use glam::Vec3;

/// A delta light: its first arrival is drawn by the client, all that it does afterwards comes from the server.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightSource {
    /// The sun.
    Directional {
        /// Where its light goes, unit.
        direction: Vec3,
        /// On a surface that faces it, linear RGB, lx.
        illuminance: Vec3,
        /// Diameter seen from the ground, rad; 0 is a point at infinity.
        angular_diameter_rad: f32,
    },
    /// A bare lamp.
    Point {
        /// m.
        position: Vec3,
        /// Linear RGB, cd.
        intensity: Vec3,
        /// Beyond it there is no light, m; `None` for no limit.
        range_m: Option<f32>,
    },
    /// A lamp with a cone.
    Spot {
        /// m.
        position: Vec3,
        /// Axis of the cone, unit.
        direction: Vec3,
        /// On the axis, linear RGB, cd.
        intensity: Vec3,
        /// Full intensity inside this half angle, rad.
        inner_cone_rad: f32,
        /// None outside this half angle, rad.
        outer_cone_rad: f32,
        /// Beyond it there is no light, m; `None` for no limit.
        range_m: Option<f32>,
    },
}

/// All lights of a world besides its emissive surfaces: what is not listed is off.
#[derive(Debug, Clone, PartialEq)]
pub struct Lights {
    /// Sun and lamps.
    pub sources: Vec<LightSource>,
    /// Radiance of the sky by lobe, +X -X +Y -Y +Z -Z, cd/m2: along unit `d` it is `sum_a d_a^2 * lobe_a` over the
    /// lobes faced.
    pub sky: [Vec3; 6],
    /// Multiplies every emissive surface.
    pub emission_scale: f32,
}

impl Default for Lights {
    /// Emissive surfaces only: no lamps, a black sky.
    fn default() -> Self {
        Self { sources: Vec::new(), sky: [Vec3::ZERO; 6], emission_scale: 1.0 }
    }
}

impl Lights {
    /// A sky from `horizon` all around to `zenith` above and `ground` below, for [`Self::sky`]; cd/m2.
    ///
    /// At elevation `e` it is `sin^2(e) * zenith + cos^2(e) * horizon`, below the horizon the same with `ground`: the
    /// blend that lobes hold exactly. A plane that faces up receives `pi / 2 * (zenith + horizon)` lx of it.
    #[must_use]
    pub fn gradient_sky(zenith: Vec3, horizon: Vec3, ground: Vec3) -> [Vec3; 6] {
        [horizon, horizon, zenith, ground, horizon, horizon]
    }

    /// For the wire. Whether the numbers make sense is the server's to judge.
    pub(crate) fn to_wire(&self) -> Result<v1::Lights, ClientError> {
        if self.sources.len() > LIGHTS_MAX {
            let cause = format!("{} lights; at most {LIGHTS_MAX} are allowed", self.sources.len());
            return Err(ClientError::Invalid { cause });
        }
        let lights = self.sources.iter().map(|source| v1::Light { kind: Some(source.to_wire()) }).collect();
        let sky = v1::Sky { lobes: self.sky.map(rgb_to_wire).to_vec() };
        Ok(v1::Lights { lights, sky: Some(sky), emission_scale: Some(self.emission_scale) })
    }

    pub(crate) fn from_wire(wire: &v1::Lights) -> Result<Self, ClientError> {
        let sources = wire.lights.iter().map(LightSource::from_wire).collect::<Result<_, _>>()?;
        let lobes = wire.sky.as_ref().map_or(&[][..], |sky| &sky.lobes);
        let sky = match lobes {
            [] => [Vec3::ZERO; 6],
            &[a, b, c, d, e, f] => [a, b, c, d, e, f].map(|lobe| rgb_from_wire(Some(lobe))),
            _ => return Err(ClientError::protocol(format!("a sky of {} lobes", lobes.len()))),
        };
        Ok(Self { sources, sky, emission_scale: wire.emission_scale.unwrap_or(1.0) })
    }
}

impl LightSource {
    fn to_wire(self) -> Kind {
        match self {
            Self::Directional { direction, illuminance, angular_diameter_rad } => {
                Kind::Directional(v1::DirectionalLight {
                    direction: Some(vector_to_wire(direction)),
                    illuminance: Some(rgb_to_wire(illuminance)),
                    angular_diameter_rad,
                })
            }
            Self::Point { position, intensity, range_m } => Kind::Point(v1::PointLight {
                position: Some(vector_to_wire(position)),
                intensity: Some(rgb_to_wire(intensity)),
                range_m,
            }),
            Self::Spot { position, direction, intensity, inner_cone_rad, outer_cone_rad, range_m } => {
                Kind::Spot(v1::SpotLight {
                    position: Some(vector_to_wire(position)),
                    direction: Some(vector_to_wire(direction)),
                    intensity: Some(rgb_to_wire(intensity)),
                    inner_cone_rad,
                    outer_cone_rad,
                    range_m,
                })
            }
        }
    }

    fn from_wire(wire: &v1::Light) -> Result<Self, ClientError> {
        let vector = |vector, what| vector_from_wire(vector, what);
        match wire.kind {
            None => Err(ClientError::protocol("a light of no kind that this client knows")),
            Some(Kind::Directional(light)) => Ok(Self::Directional {
                direction: vector(light.direction, "a light's direction")?,
                illuminance: rgb_from_wire(light.illuminance),
                angular_diameter_rad: light.angular_diameter_rad,
            }),
            Some(Kind::Point(light)) => Ok(Self::Point {
                position: vector(light.position, "a light's position")?,
                intensity: rgb_from_wire(light.intensity),
                range_m: light.range_m,
            }),
            Some(Kind::Spot(light)) => Ok(Self::Spot {
                position: vector(light.position, "a light's position")?,
                direction: vector(light.direction, "a light's direction")?,
                intensity: rgb_from_wire(light.intensity),
                inner_cone_rad: light.inner_cone_rad,
                outer_cone_rad: light.outer_cone_rad,
                range_m: light.range_m,
            }),
        }
    }
}

fn rgb_to_wire(rgb: Vec3) -> v1::Rgb {
    v1::Rgb { red: rgb.x, green: rgb.y, blue: rgb.z }
}

fn rgb_from_wire(rgb: Option<v1::Rgb>) -> Vec3 {
    rgb.map_or(Vec3::ZERO, |rgb| Vec3::new(rgb.red, rgb.green, rgb.blue))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_survive_the_wire() {
        let (position, direction, intensity) = (Vec3::new(1.0, 2.0, 3.0), Vec3::NEG_Y, Vec3::splat(80.0));
        let sources = vec![
            LightSource::Directional { direction, illuminance: Vec3::splat(5e4), angular_diameter_rad: 0.01 },
            LightSource::Point { position, intensity, range_m: None },
            LightSource::Spot {
                position,
                direction,
                intensity,
                inner_cone_rad: 0.1,
                outer_cone_rad: 0.4,
                range_m: Some(9.0),
            },
        ];
        let sky = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0].map(Vec3::splat);
        let lights = Lights { sources, sky, emission_scale: 0.5 };
        assert_eq!(Lights::from_wire(&lights.to_wire().unwrap()), Ok(lights));
        assert_eq!(Lights::from_wire(&v1::Lights::default()), Ok(Lights::default()));
    }

    #[test]
    fn too_many_lights_are_refused_before_they_are_sent() {
        let lamp = LightSource::Point { position: Vec3::ZERO, intensity: Vec3::ONE, range_m: None };
        let lights = Lights { sources: vec![lamp; LIGHTS_MAX + 1], ..Lights::default() };
        assert!(matches!(lights.to_wire(), Err(ClientError::Invalid { .. })));
    }
}
