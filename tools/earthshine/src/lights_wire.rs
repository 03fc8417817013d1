//! Light rigs of scenes and light sources of the client library: the same quantities under two packages' names.

use earthshine_client::{LightSource, Lights};
use earthshine_world::{Light, LightRig, Sky};

/// What a client says to get the light of `rig`.
pub(crate) fn to_client(rig: &LightRig) -> Lights {
    Lights {
        sources: rig.lights.iter().map(source).collect(),
        sky: rig.sky.lobes,
        emission_scale: rig.emission_scale,
    }
}

/// The rig that a client asked for, to draw the same direct light.
pub(crate) fn from_client(lights: &Lights) -> LightRig {
    LightRig {
        lights: lights.sources.iter().map(light).collect(),
        sky: Sky { lobes: lights.sky },
        emission_scale: lights.emission_scale,
    }
}

fn source(light: &Light) -> LightSource {
    match *light {
        Light::Directional { direction, illuminance, angular_diameter_rad } => {
            LightSource::Directional { direction, illuminance, angular_diameter_rad }
        }
        Light::Point { position, intensity, range_m } => LightSource::Point { position, intensity, range_m },
        Light::Spot { position, direction, intensity, inner_cone_rad, outer_cone_rad, range_m } => {
            LightSource::Spot { position, direction, intensity, inner_cone_rad, outer_cone_rad, range_m }
        }
    }
}

fn light(source: &LightSource) -> Light {
    match *source {
        LightSource::Directional { direction, illuminance, angular_diameter_rad } => {
            Light::Directional { direction, illuminance, angular_diameter_rad }
        }
        LightSource::Point { position, intensity, range_m } => Light::Point { position, intensity, range_m },
        LightSource::Spot { position, direction, intensity, inner_cone_rad, outer_cone_rad, range_m } => {
            Light::Spot { position, direction, intensity, inner_cone_rad, outer_cone_rad, range_m }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::Vec3;

    #[test]
    fn a_rig_comes_back_as_it_went() {
        let rig = LightRig {
            lights: vec![
                Light::Directional {
                    direction: Vec3::NEG_Y,
                    illuminance: Vec3::ONE,
                    angular_diameter_rad: 0.1,
                },
                Light::Point { position: Vec3::X, intensity: Vec3::Z, range_m: Some(3.0) },
                Light::Spot {
                    position: Vec3::Y,
                    direction: Vec3::NEG_Z,
                    intensity: Vec3::ONE,
                    inner_cone_rad: 0.2,
                    outer_cone_rad: 0.4,
                    range_m: None,
                },
            ],
            sky: Sky::constant(Vec3::new(1.0, 2.0, 3.0)),
            emission_scale: 0.5,
        };
        assert_eq!(from_client(&to_client(&rig)), rig);
    }
}
