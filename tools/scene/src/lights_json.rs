//! The shape of lights JSON, and where in the file each entry stands.
//!
//! Not here: what an entry means ([`crate::lights`]). Entries are read one by one from their own text, so that a fault
//! names its light and its line.

use earthshine_world::{Light, Rgb, Vec3};
use serde_json::value::RawValue;

/// The whole file, its entries unread.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct JsonFile<'text> {
    #[serde(borrow, default)]
    pub(crate) lights: Vec<Entry<'text>>,
    #[serde(borrow)]
    pub(crate) sky: Option<Entry<'text>>,
    #[serde(default = "yes")]
    pub(crate) use_gltf_lights: bool,
    #[serde(borrow)]
    pub(crate) emission_scale: Option<Entry<'text>>,
}

impl<'text> JsonFile<'text> {
    /// Reads all but the entries.
    ///
    /// # Errors
    /// What is wrong with it, and in which line.
    pub(crate) fn read(text: &'text [u8]) -> Result<Self, String> {
        serde_json::from_slice(text)
            .map_err(|error| format!("{error}; config/lights.example.json shows every form"))
    }
}

/// One light, the sky or a number, as written.
#[derive(serde::Deserialize)]
#[serde(transparent)]
pub(crate) struct Entry<'text>(#[serde(borrow)] &'text RawValue);

impl Entry<'_> {
    /// The line of `text`, from which the file was read, that the entry begins in; the first is 1.
    pub(crate) fn line(&self, text: &[u8]) -> usize {
        let start = self.0.get().as_ptr() as usize - text.as_ptr() as usize;
        1 + text[..start.min(text.len())].iter().filter(|&&byte| byte == b'\n').count()
    }

    /// The entry as a `T`.
    ///
    /// # Errors
    /// What does not fit.
    pub(crate) fn read<T: serde::de::DeserializeOwned>(&self) -> Result<T, String> {
        serde_json::from_str(self.0.get()).map_err(|error| {
            // Positions within the entry would be taken for positions in the file.
            let cause = error.to_string();
            cause.split(" at line ").next().unwrap_or(&cause).to_owned()
        })
    }
}

/// One of three skies; which is checked by its reader.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct JsonSky {
    pub(crate) color: Option<[f32; 3]>,
    pub(crate) gradient: Option<JsonGradient>,
    pub(crate) environment: Option<String>,
    pub(crate) scale: Option<f32>,
    pub(crate) rotation_deg: Option<f32>,
}

/// Radiances, cd/m2.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct JsonGradient {
    pub(crate) zenith: [f32; 3],
    pub(crate) horizon: [f32; 3],
    pub(crate) ground: [f32; 3],
}

/// A light as glTF spells it.
#[derive(serde::Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
pub(crate) enum JsonLight {
    #[serde(rename_all = "camelCase")]
    Directional {
        direction: [f32; 3],
        #[serde(default = "white")]
        color: [f32; 3],
        #[serde(default = "one")]
        intensity: f32,
        #[serde(default)]
        angular_diameter: f32,
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
    /// With a unit direction, `color` times `intensity`; the rest is still to be validated.
    ///
    /// # Errors
    /// A direction without length, a negative colour or intensity: two of them would make a light.
    pub(crate) fn into_light(self) -> Result<Light, &'static str> {
        let unit = |direction: [f32; 3]| {
            Vec3::from_array(direction)
                .try_normalize()
                .ok_or("its direction has no length; give where the light goes")
        };
        let strength = |color: [f32; 3], intensity: f32| {
            if Rgb::from_array(color).min_element() < 0.0 {
                Err("the color is negative")
            } else if intensity < 0.0 {
                Err("the intensity is negative")
            } else {
                Ok(Rgb::from_array(color) * intensity)
            }
        };
        Ok(match self {
            Self::Directional { direction, color, intensity, angular_diameter } => Light::Directional {
                direction: unit(direction)?,
                illuminance: strength(color, intensity)?,
                angular_diameter_rad: angular_diameter,
            },
            Self::Point { position, color, intensity, range } => Light::Point {
                position: Vec3::from_array(position),
                intensity: strength(color, intensity)?,
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
                intensity: strength(color, intensity)?,
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
