//! `KHR_lights_punctual`: the lights of a glTF file in world space.

use crate::SceneError;
use crate::document::Document;
use earthshine_world::light::STRENGTH_WARNING;
use earthshine_world::{Light, LightRig, Rgb, Vec3};
use glam::{DAffine3, DVec3};
use gltf::json::extensions::scene::khr_lights_punctual::{Light as Json, Spot, Type};
use gltf::json::validation::Checked;
use std::collections::BTreeMap;

/// Most lights that a warning names.
const NAMED_MAX: usize = 8;

/// The lights at `placed` nodes, and warnings where some are dark, or brighter than anything likely.
///
/// # Errors
/// [`SceneError::BadLights`] for a light that cannot be, [`SceneError::Malformed`] for one that is not there.
pub(crate) fn lights(
    document: &Document<'_>,
    placed: &[(usize, DAffine3)],
) -> Result<(Vec<Light>, Vec<String>), SceneError> {
    let known = document.root.extensions.as_ref().and_then(|all| all.khr_lights_punctual.as_ref());
    let known = known.map_or(&[][..], |known| &known.lights);
    let mut lights = Vec::with_capacity(placed.len());
    let (mut dark, mut bright) = (BTreeMap::new(), BTreeMap::new());
    for (index, world) in placed {
        let json = known.get(*index);
        let json = json.ok_or_else(|| document.malformed(format!("light {index}"), "it is not there"))?;
        let named = || format!("light {index} `{}`", json.name.as_deref().unwrap_or("without a name"));
        let bad = |cause: &str| SceneError::BadLights {
            file: document.file.to_owned(),
            entry: named(),
            cause: cause.to_owned(),
        };
        // Two of them would make a light.
        if Rgb::from_array(json.color).min_element() < 0.0 || json.intensity < 0.0 {
            return Err(bad("its color or intensity is negative; give zero or more (zero leaves it out)"));
        }
        let strength = Rgb::from_array(json.color) * json.intensity;
        if strength == Rgb::ZERO {
            dark.insert(*index, named());
            continue;
        }
        if strength.max_element() > STRENGTH_WARNING {
            bright.insert(*index, named());
        }
        if matches!(json.type_, Checked::Invalid) {
            return Err(bad("its type is none of directional, point and spot"));
        }
        let light = in_world(json, strength, world)
            .ok_or_else(|| bad("its node is scaled to nothing and has no direction"))?;
        let mut rig = LightRig::emission_only();
        rig.lights.push(light);
        rig.validate().map_err(|error| bad(error.cause))?;
        lights.push(light);
    }
    let mut warnings = Vec::new();
    warnings.extend(names(dark.values()).map(|names| format!("without intensity and left out: {names}")));
    warnings.extend(names(bright.values()).map(|names| {
        format!("of more than {STRENGTH_WARNING:.0e} cd or lx; is a smaller intensity meant? {names}")
    }));
    Ok((lights, warnings))
}

/// The first of `all`, and how many more; nothing where there are none.
pub(crate) fn names<'a>(mut all: impl ExactSizeIterator<Item = &'a String>) -> Option<String> {
    let mut names: Vec<&str> = all.by_ref().take(NAMED_MAX).map(String::as_str).collect();
    let more = format!("{} more", all.len());
    if all.len() > 0 {
        names.push(&more);
    }
    (!names.is_empty()).then(|| names.join(", "))
}

fn in_world(json: &Json, strength: Rgb, world: &DAffine3) -> Option<Light> {
    let position = world.translation.as_vec3();
    let direction = || {
        let along: DVec3 = world.transform_vector3(DVec3::NEG_Z);
        along.try_normalize().map(|unit| -> Vec3 { unit.as_vec3() })
    };
    match json.type_ {
        Checked::Valid(Type::Directional) => Some(Light::Directional {
            direction: direction()?,
            illuminance: strength,
            angular_diameter_rad: 0.0,
        }),
        Checked::Valid(Type::Point) => {
            Some(Light::Point { position, intensity: strength, range_m: json.range })
        }
        Checked::Valid(Type::Spot) => {
            let (inner_cone_rad, outer_cone_rad) = cone(json.spot.as_ref());
            Some(Light::Spot {
                position,
                direction: direction()?,
                intensity: strength,
                inner_cone_rad,
                outer_cone_rad,
                range_m: json.range,
            })
        }
        Checked::Invalid => None,
    }
}

/// Half angles; glTF's defaults where the light has none.
fn cone(spot: Option<&Spot>) -> (f32, f32) {
    spot.map_or((0.0, std::f32::consts::FRAC_PI_4), |spot| (spot.inner_cone_angle, spot.outer_cone_angle))
}
