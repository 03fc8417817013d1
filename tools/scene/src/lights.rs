//! Lights JSON: lamps, sun and sky beside a scene, in glTF units.
//!
//! ```json
//! {"sky": {"color": [3000, 4000, 6000]}, "use_gltf_lights": false,
//!  "lights": [{"type": "directional", "direction": [0.5, -0.75, -0.43], "color": [1, 0.96, 0.9], "intensity": 100000},
//!             {"type": "point", "position": [0, 3, 0], "intensity": 200, "range": 20},
//!             {"type": "spot", "position": [0, 3, 0], "direction": [0, -1, 0], "intensity": 200,
//!              "innerConeAngle": 0.2, "outerConeAngle": 0.5}]}
//! ```
//!
//! `color` is linear RGB and defaults to white; `intensity` (lx or cd) to 1; `range` to none; the cone angles to
//! 0 and pi/4, as in glTF. Directions need not be unit vectors. Unknown keys, negative intensities and directions of
//! length zero are errors; a light without intensity is left out with a warning. Start at [`load_lights`].

use crate::{Scene, SceneError, resource};
use earthshine_world::{Light, LightRig, Rgb, Sky, Vec3};
use std::path::Path;

/// What a lights file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct LightsFile {
    /// In the file's order, without the dark ones.
    pub lights: Vec<Light>,
    /// Black where the file has none.
    pub sky: Sky,
    /// Whether the scene's own `KHR_lights_punctual` shine as well.
    pub use_gltf_lights: bool,
    /// Sentences for people.
    pub warnings: Vec<String>,
}

/// Most lights in a file.
const LIGHTS_MAX: usize = 100_000;

/// Reads a lights file.
///
/// # Errors
/// [`SceneError::NotFound`], [`SceneError::Io`], and [`SceneError::BadLights`] naming the entry.
pub fn load_lights(path: &Path) -> Result<LightsFile, SceneError> {
    let file = path.display().to_string();
    let text = resource::read_file(path).map_err(|error| SceneError::io(&file, error))?;
    parse_lights(&text, &file)
}

/// Reads lights JSON; `name` stands for the file in messages.
///
/// # Errors
/// [`SceneError::BadLights`], naming the entry.
pub fn parse_lights(text: &[u8], name: &str) -> Result<LightsFile, SceneError> {
    let bad = |entry: &str, cause: String| SceneError::BadLights {
        file: name.to_owned(),
        entry: entry.to_owned(),
        cause,
    };
    let json: JsonFile = serde_json::from_slice(text).map_err(|error| bad("the file", error.to_string()))?;
    if json.lights.len() > LIGHTS_MAX {
        return Err(bad(
            "lights",
            format!("{} of them, and at most {LIGHTS_MAX} are read", json.lights.len()),
        ));
    }
    let sky = json.sky.map_or(Sky::default(), |sky| Sky::constant(Rgb::from_array(sky.color)));
    let mut rig = LightRig { sky, ..LightRig::emission_only() };
    rig.validate().map_err(|error| bad("sky", error.cause.to_owned()))?;
    let mut warnings = Vec::new();
    for (index, entry) in json.lights.into_iter().enumerate() {
        let entry_name = format!("light {index}");
        let light: JsonLight =
            serde_json::from_value(entry).map_err(|error| bad(&entry_name, error.to_string()))?;
        let light = light.into_light().map_err(|cause| bad(&entry_name, cause.to_owned()))?;
        let one = LightRig { lights: vec![light], ..LightRig::emission_only() };
        one.validate().map_err(|error| bad(&entry_name, error.cause.to_owned()))?;
        if strength(&light) == Rgb::ZERO {
            warnings.push(format!("{name}: {entry_name} has no intensity and was left out"));
        } else {
            rig.lights.push(light);
        }
    }
    Ok(LightsFile { lights: rig.lights, sky, use_gltf_lights: json.use_gltf_lights, warnings })
}

/// Everything that lights `scene`: its own lights unless `file` leaves them out, then the file's, and its sky.
#[must_use]
pub fn light_rig(scene: &Scene, file: Option<&LightsFile>) -> LightRig {
    let own = scene.lights.iter().filter(|_| file.is_none_or(|file| file.use_gltf_lights));
    let added = file.map_or(&[][..], |file| &file.lights);
    LightRig {
        lights: own.chain(added).copied().collect(),
        sky: file.map_or(Sky::default(), |file| file.sky),
        ..LightRig::emission_only()
    }
}

fn strength(light: &Light) -> Rgb {
    match *light {
        Light::Directional { illuminance, .. } => illuminance,
        Light::Point { intensity, .. } | Light::Spot { intensity, .. } => intensity,
    }
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct JsonFile {
    #[serde(default)]
    lights: Vec<serde_json::Value>,
    sky: Option<JsonSky>,
    #[serde(default = "yes")]
    use_gltf_lights: bool,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct JsonSky {
    color: [f32; 3],
}

#[derive(serde::Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
enum JsonLight {
    Directional {
        direction: [f32; 3],
        #[serde(default = "white")]
        color: [f32; 3],
        #[serde(default = "one")]
        intensity: f32,
    },
    Point {
        position: [f32; 3],
        #[serde(default = "white")]
        color: [f32; 3],
        #[serde(default = "one")]
        intensity: f32,
        range: Option<f32>,
    },
    #[serde(rename_all = "camelCase")]
    Spot {
        position: [f32; 3],
        direction: [f32; 3],
        #[serde(default = "white")]
        color: [f32; 3],
        #[serde(default = "one")]
        intensity: f32,
        range: Option<f32>,
        #[serde(default)]
        inner_cone_angle: f32,
        #[serde(default = "quarter_pi")]
        outer_cone_angle: f32,
    },
}

impl JsonLight {
    fn into_light(self) -> Result<Light, &'static str> {
        let unit = |direction: [f32; 3]| {
            Vec3::from_array(direction).try_normalize().ok_or("its direction has no length")
        };
        let strength = |color: [f32; 3], intensity: f32| Rgb::from_array(color) * intensity;
        Ok(match self {
            Self::Directional { direction, color, intensity } => Light::Directional {
                direction: unit(direction)?,
                illuminance: strength(color, intensity),
                angular_diameter_rad: 0.0,
            },
            Self::Point { position, color, intensity, range } => Light::Point {
                position: Vec3::from_array(position),
                intensity: strength(color, intensity),
                range_m: range,
            },
            Self::Spot {
                position,
                direction,
                color,
                intensity,
                range,
                inner_cone_angle,
                outer_cone_angle,
            } => Light::Spot {
                position: Vec3::from_array(position),
                direction: unit(direction)?,
                intensity: strength(color, intensity),
                inner_cone_rad: inner_cone_angle,
                outer_cone_rad: outer_cone_angle,
                range_m: range,
            },
        })
    }
}

fn yes() -> bool {
    true
}

fn white() -> [f32; 3] {
    [1.0; 3]
}

fn one() -> f32 {
    1.0
}

fn quarter_pi() -> f32 {
    std::f32::consts::FRAC_PI_4
}
