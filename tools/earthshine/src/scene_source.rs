//! Where a scene comes from: a glTF file, or the name of a generated world.

use anyhow::Context as _;
use earthshine_gen::{GenOptions, WorldKind};
use earthshine_render::SceneTracer;
use earthshine_scene::{EnvironmentMap, ImportOptions, ImportReport, LightsFile, Scene};
use earthshine_world::LightRig;
use std::path::Path;
use std::sync::Arc;

/// A scene with its name and lights.
pub(crate) struct SceneSource {
    pub(crate) scene: Scene,
    pub(crate) name: String,
    /// Which generated world; `None` for a file.
    pub(crate) kind: Option<WorldKind>,
    pub(crate) lights: LightRig,
    /// What paths see in place of the rig's sky; `None` where that has no map.
    pub(crate) environment: Option<Arc<EnvironmentMap>>,
}

impl SceneSource {
    /// A path tracer of the scene under its sky: the real map, where there is one.
    pub(crate) fn tracer(&self) -> SceneTracer<'_> {
        SceneTracer::new(&self.scene).under(self.environment.clone())
    }
}

/// Loads `scene`, and `lights` where a file is given; what is remarkable about them goes to standard error.
pub(crate) fn load(scene: &str, lights: Option<&Path>, metals_black: bool) -> anyhow::Result<SceneSource> {
    load_generated(scene, lights, metals_black, &GenOptions::default())
}

/// As [`load`]; a generated world takes its shape from `shape`.
pub(crate) fn load_generated(
    scene: &str,
    lights: Option<&Path>,
    metals_black: bool,
    shape: &GenOptions,
) -> anyhow::Result<SceneSource> {
    let options = ImportOptions { metals_black, ..ImportOptions::default() };
    let is_file = Path::new(scene).extension().is_some();
    let (loaded, name, kind) = match scene.parse::<WorldKind>() {
        Ok(kind) if !is_file => {
            let glb = earthshine_gen::generate(kind, shape, &|_, _| {})?;
            (earthshine_scene::load_bytes(&glb.bytes, scene, &options)?, scene.to_owned(), Some(kind))
        }
        _ => {
            let path = Path::new(scene);
            let name = path.file_name().map_or(scene.into(), |name| name.to_string_lossy().into_owned());
            (earthshine_scene::load(path, &options)?, name, None)
        }
    };
    tell(&name, &loaded.report);
    let file = lights.map(load_lights).transpose()?;
    if let Some(file) = &file
        && let Some(warning) = file.emission_warning(&loaded)?
    {
        eprintln!("warning: {warning}");
    }
    let lights = earthshine_scene::light_rig(&loaded, file.as_ref());
    lights.validate().context("the scene's lights")?;
    let environment = file.and_then(|file| file.environment);
    Ok(SceneSource { scene: loaded, name, kind, lights, environment })
}

/// What the import of `file` left out or changed, on standard error.
fn tell(file: &str, report: &ImportReport) {
    let counted = [
        (report.zero_area_triangles, "triangles without area were skipped"),
        (report.clamped_materials, "materials reflect more than 98 % somewhere: clamped"),
        (report.blended_materials, "materials blend: masked at 0.5"),
    ];
    for (count, what) in counted.into_iter().filter(|(count, _)| *count > 0) {
        eprintln!("warning: {file}: {count} {what}");
    }
    for warning in &report.warnings {
        eprintln!("warning: {file}: {warning}");
    }
}

/// Reads a lights file, and says on standard error what is remarkable about it.
pub(crate) fn load_lights(file: &Path) -> anyhow::Result<LightsFile> {
    let lights = earthshine_scene::load_lights(file)?;
    for note in &lights.notes {
        eprintln!("{note}");
    }
    for warning in &lights.warnings {
        eprintln!("warning: {warning}");
    }
    Ok(lights)
}

/// Says so when nothing shines: no lamp, no sky, no emitter.
pub(crate) fn warn_if_dark(source: &SceneSource) {
    let has_sky = source.lights.sky.lobes.iter().any(|lobe| lobe.max_element() > 0.0);
    if !source.scene.emits() && !has_sky && source.lights.lights.is_empty() {
        eprintln!("warning: nothing shines in {}: give it lights with --lights", source.name);
    }
}
