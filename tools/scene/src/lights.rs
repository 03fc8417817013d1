//! Lights JSON: lamps, sun and sky beside a scene, in glTF units.
//!
//! ```json
//! {"sky": {"color": [3000, 4000, 6000]}, "use_gltf_lights": false, "emission_scale": 1,
//!  "lights": [{"type": "directional", "direction": [0.5, -0.75, -0.43], "color": [1, 0.96, 0.9], "intensity": 100000,
//!              "angularDiameter": 0.0093},
//!             {"type": "point", "position": [0, 3, 0], "intensity": 200, "range": 20},
//!             {"type": "spot", "position": [0, 3, 0], "direction": [0, -1, 0], "intensity": 200,
//!              "innerConeAngle": 0.2, "outerConeAngle": 0.5}]}
//! ```
//!
//! `color` is linear RGB and defaults to white; `intensity` (lx or cd) to 1; `range` to none; the cone angles to
//! 0 and pi/4, as in glTF; `angularDiameter` (rad) to 0. Directions need not be unit vectors. `emission_scale`
//! multiplies every emissive surface. Unknown keys, negative colors and intensities and directions of length zero are errors; a
//! light without intensity is left out with a warning, and a black sky or an emission scale of zero is remarked on.
//!
//! The sky is one of three, all in cd/m2:
//!
//! | form | sky |
//! |---|---|
//! | `{"color": [r, g, b]}` | the same everywhere |
//! | `{"gradient": {"zenith": [..], "horizon": [..], "ground": [..]}}` | [`Sky::gradient`] |
//! | `{"environment": "sky.hdr", "scale": 1, "rotation_deg": 0}` | [`EnvironmentMap`], .hdr or .exr beside this file |
//!
//! `config/lights.example.json` has all of it. Start at [`load_lights`].

use crate::lights_json::{Entry, JsonFile, JsonLight, JsonSky};
use crate::{EnvironmentMap, Material, Scene, SceneError, environment_file, resource, sky_projection};
use earthshine_world::light::{RADIANCE_WARNING, STRENGTH_WARNING};
use earthshine_world::{Light, LightRig, Rgb, Sky};
use std::path::Path;
use std::sync::Arc;

/// What a lights file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct LightsFile {
    /// In the file's order, without the dark ones.
    pub lights: Vec<Light>,
    /// Black where the file has none; of an environment map, what the service can hold of it.
    pub sky: Sky,
    /// The map itself, for tools that trace rays.
    pub environment: Option<Arc<EnvironmentMap>>,
    /// Multiplies every emissive surface.
    pub emission_scale: f32,
    /// The file, and entry and line there that say so: for messages.
    name: String,
    emission_scale_place: String,
    /// Whether the scene's own `KHR_lights_punctual` shine as well.
    pub use_gltf_lights: bool,
    /// Sentences for people: what was left out or may be wrong.
    pub warnings: Vec<String>,
    /// Sentences for people: what was measured, such as the error of a projected sky.
    pub notes: Vec<String>,
}

/// Most lights in a file.
const LIGHTS_MAX: usize = 100_000;

/// Most bytes of a file: some hundreds a light.
const FILE_BYTES_MAX: u64 = 64 << 20;

/// From this error on planes facing all ways a map is worth a warning: an even sky over black ground stays below.
const ERROR_WARNING: f64 = 0.2;

/// Reads a lights file.
///
/// # Errors
/// [`SceneError::NotFound`], [`SceneError::Io`], and [`SceneError::BadLights`] naming the entry and its line.
pub fn load_lights(path: &Path) -> Result<LightsFile, SceneError> {
    let file = path.display().to_string();
    let text =
        resource::read_file_up_to(path, FILE_BYTES_MAX).map_err(|error| SceneError::io(&file, error))?;
    parse(&text, &file, path.parent())
}

/// Reads lights JSON; `name` stands for the file in messages. There is no environment map beside it.
///
/// # Errors
/// [`SceneError::BadLights`], naming the entry and its line.
pub fn parse_lights(text: &[u8], name: &str) -> Result<LightsFile, SceneError> {
    parse(text, name, None)
}

fn parse(text: &[u8], name: &str, folder: Option<&Path>) -> Result<LightsFile, SceneError> {
    let bad = |entry: &str, cause: String| SceneError::BadLights {
        file: name.to_owned(),
        entry: entry.to_owned(),
        cause,
    };
    let json = JsonFile::read(text).map_err(|cause| bad("the file", cause))?;
    if json.lights.len() > LIGHTS_MAX {
        return Err(bad(
            "lights",
            format!("{} of them, and at most {LIGHTS_MAX} are read", json.lights.len()),
        ));
    }
    let mut file = LightsFile {
        lights: Vec::with_capacity(json.lights.len()),
        sky: Sky::default(),
        environment: None,
        emission_scale: 1.0,
        name: name.to_owned(),
        emission_scale_place: String::new(),
        use_gltf_lights: json.use_gltf_lights,
        warnings: Vec::new(),
        notes: Vec::new(),
    };
    if let Some(entry) = &json.emission_scale {
        let place = format!("emission_scale, line {}", entry.line(text));
        file.emission_scale = read_emission_scale(entry).map_err(|cause| bad(&place, cause))?;
        file.emission_scale_place = place;
    }
    if let Some(entry) = &json.sky {
        let place = format!("sky, line {}", entry.line(text));
        let named = format!("{name}: {place}");
        file.add_sky(entry, &named, folder).map_err(|cause| bad(&place, cause))?;
        file.remark_on_sky(&named);
    }
    for (index, entry) in json.lights.iter().enumerate() {
        let place = format!("light {index}, line {}", entry.line(text));
        let light = read_light(entry).map_err(|cause| bad(&place, cause))?;
        let strength = light.strength();
        if strength == Rgb::ZERO {
            file.warnings.push(format!("{name}: {place} has no intensity and was left out"));
        } else {
            let found = strength.max_element();
            if found > STRENGTH_WARNING {
                file.warnings.push(format!(
                    "{name}: {place} has an intensity of {found:.1e} cd or lx, more than {STRENGTH_WARNING:.0e}: is a \
                     smaller one meant?"
                ));
            }
            file.lights.push(light);
        }
    }
    Ok(file)
}

fn read_emission_scale(entry: &Entry<'_>) -> Result<f32, String> {
    let emission_scale = entry.read()?;
    let rig = LightRig { emission_scale, ..LightRig::emission_only() };
    rig.validate().map_err(|error| format!("{}; give zero or more", error.cause))?;
    Ok(emission_scale)
}

fn read_light(entry: &Entry<'_>) -> Result<Light, String> {
    let light: JsonLight = entry.read()?;
    let light = light.into_light().map_err(|cause| format!("{cause}; {}", cure(cause)))?;
    let one = LightRig { lights: vec![light], ..LightRig::emission_only() };
    one.validate().map_err(|error| format!("{}; {}", error.cause, cure(error.cause)))?;
    Ok(light)
}

/// What to do about a number that cannot be.
fn cure(cause: &str) -> &'static str {
    if cause.contains("intensity") || cause.contains("color") {
        "color and intensity must be zero or more (zero leaves the light out)"
    } else {
        "see config/lights.example.json"
    }
}

impl LightsFile {
    /// A sentence for people where the emission scale puts out what emits in `scene`, or makes it brighter than any lamp.
    ///
    /// # Errors
    /// [`SceneError::BadLights`] where it makes a material brighter than any number.
    pub fn emission_warning(&self, scene: &Scene) -> Result<Option<String>, SceneError> {
        let radiance = |material: &Material| material.emitted_radiance.max_element();
        let brightest = scene.materials.iter().max_by(|a, b| radiance(a).total_cmp(&radiance(b)));
        let Some(brightest) = brightest.filter(|_| scene.emits()) else { return Ok(None) };
        let (scale, place, name) = (self.emission_scale, &self.emission_scale_place, &brightest.name);
        let scaled = radiance(brightest) * scale;
        if !scaled.is_finite() {
            return Err(SceneError::BadLights {
                file: self.name.clone(),
                entry: place.clone(),
                cause: format!(
                    "{scale:e} makes material `{name}` brighter than any number; give a smaller one"
                ),
            });
        }
        let remark = if scale == 0.0 {
            "zero puts out all surfaces that emit; leave it out for their own light".to_owned()
        } else if scale > 1.0 && scaled > RADIANCE_WARNING {
            format!(
                "{scale:e} makes material `{name}` emit {scaled:.1e} cd/m2, more than {RADIANCE_WARNING:.0e}: is a \
                 smaller one meant?"
            )
        } else {
            return Ok(None);
        };
        Ok(Some(format!("{}: {place}: {remark}", self.name)))
    }

    /// Remarks on the sky at `place` where it is black or brighter than anything likely.
    fn remark_on_sky(&mut self, place: &str) {
        let brightest = self.sky.lobes.iter().map(|lobe| lobe.max_element()).fold(0.0, f32::max);
        if brightest <= 0.0 {
            self.warnings
                .push(format!("{place} is black and gives no light; leave it out, or give it cd/m2"));
        } else if brightest > RADIANCE_WARNING {
            self.warnings.push(format!(
                "{place} has {brightest:.1e} cd/m2, more than {RADIANCE_WARNING:.0e}: is a smaller one meant?"
            ));
        }
    }

    /// Reads the sky of `entry`; `place` names it in warnings, files are looked up in `folder`.
    fn add_sky(&mut self, entry: &Entry<'_>, place: &str, folder: Option<&Path>) -> Result<(), String> {
        let json: JsonSky = entry.read()?;
        match (&json.color, &json.gradient, &json.environment) {
            (Some(color), None, None) => self.sky = Sky::constant(Rgb::from_array(*color)),
            (None, Some(gradient), None) => {
                let [zenith, horizon, ground] =
                    [gradient.zenith, gradient.horizon, gradient.ground].map(Rgb::from_array);
                self.sky = Sky::gradient(zenith, horizon, ground);
            }
            (None, None, Some(file)) => {
                let (scale, rotation_deg) = (json.scale.unwrap_or(1.0), json.rotation_deg.unwrap_or(0.0));
                if !(scale.is_finite() && scale >= 0.0 && rotation_deg.is_finite()) {
                    return Err("scale must be zero or more, and scale and rotation_deg finite".to_owned());
                }
                let folder = folder.ok_or("there is no folder to look for the environment map in")?;
                self.add_environment(&folder.join(file), scale, rotation_deg, &format!("{place}: {file}"))
                    .map_err(|cause| format!("{file}: {cause}"))?;
                return Ok(());
            }
            _ => return Err("it must be one of color, gradient and environment".to_owned()),
        }
        if json.scale.is_some() || json.rotation_deg.is_some() {
            return Err("scale and rotation_deg belong to an environment".to_owned());
        }
        let rig = LightRig { sky: self.sky, ..LightRig::emission_only() };
        rig.validate().map_err(|error| format!("{}; give zero or more cd/m2", error.cause))
    }

    fn add_environment(
        &mut self,
        path: &Path,
        scale: f32,
        rotation_deg: f32,
        place: &str,
    ) -> Result<(), String> {
        let read = environment_file::read(path, scale, rotation_deg)?;
        self.warnings.extend(read.warning.map(|warning| format!("{place}: {warning}")));
        let found = sky_projection::project(&read.map);
        let percent = |share: f64| share * 100.0;
        self.notes.push(format!(
            "{place}: {} x {} pixels on six lobes: irradiance off by {:.1} % (RMS over planes facing all ways), at \
             most {:.1} % on the six axis planes; {:.1} % clamped",
            read.map.width(),
            read.map.height(),
            percent(found.error_rel),
            percent(found.axes_error_rel),
            percent(found.clamped_share),
        ));
        if found.error_rel > ERROR_WARNING {
            self.warnings.push(format!(
                "{place}: the six lobes of the service hold it badly; is there a sun in it? Paint it over and give it \
                 as a directional light"
            ));
        }
        self.sky = found.sky;
        self.environment = Some(Arc::new(read.map));
        Ok(())
    }
}

/// Everything that lights `scene`: its own lights unless `file` leaves them out, then the file's, and its sky.
#[must_use]
pub fn light_rig(scene: &Scene, file: Option<&LightsFile>) -> LightRig {
    let own = scene.lights.iter().filter(|_| file.is_none_or(|file| file.use_gltf_lights));
    let added = file.map_or(&[][..], |file| &file.lights);
    LightRig {
        lights: own.chain(added).copied().collect(),
        sky: file.map_or(Sky::default(), |file| file.sky),
        emission_scale: file.map_or(1.0, |file| file.emission_scale),
    }
}
