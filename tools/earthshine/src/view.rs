//! Where pictures are taken from, and what a set of pictures consists of.

use anyhow::Context as _;
use clap::Args;
use earthshine_render::camera::Pinhole;
use earthshine_render::picture::{IrradianceLookup, Layers, LightSource, Picture, PictureOptions, render};
use earthshine_render::{SceneTracer, difference, image_file, metrics, sheet};
use earthshine_world::{Bounds, LightRig, Vec3};
use std::path::Path;

/// Camera and size of a picture.
#[derive(Args, Clone)]
pub(crate) struct ViewArguments {
    /// Where the camera is: x,y,z in metres. Default: inside or in front of the scene, where it sees light.
    #[arg(long, value_parser = vector, allow_hyphen_values = true)]
    camera: Option<Vec3>,
    /// What it looks at: x,y,z in metres. Default: the middle of the scene.
    #[arg(long, value_parser = vector, allow_hyphen_values = true)]
    target: Option<Vec3>,
    /// Field of view from bottom to top, degrees.
    #[arg(long, default_value_t = 60.0)]
    fov: f32,
    /// Pixels across.
    #[arg(long, default_value_t = 480)]
    width: u32,
    /// Pixels down.
    #[arg(long, default_value_t = 270)]
    height: u32,
}

/// `x,y,z` as on the command line.
pub(crate) fn vector(text: &str) -> Result<Vec3, String> {
    let parts: Vec<f32> = text
        .split(',')
        .map(|part| part.trim().parse::<f32>().map_err(|error| format!("{part:?}: {error}")))
        .collect::<Result<_, _>>()?;
    let array = <[f32; 3]>::try_from(parts).map_err(|parts| format!("{} numbers, not x,y,z", parts.len()))?;
    let vector = Vec3::from(array);
    if vector.is_finite() { Ok(vector) } else { Err("not finite".to_owned()) }
}

impl ViewArguments {
    /// Pictures of that size by cameras that are told where to stand.
    pub(crate) fn sized(width: u32, height: u32) -> Self {
        Self { camera: None, target: None, fov: 60.0, width, height }
    }

    /// The same size, from `camera` towards `target`; what is not given is found as if it had not been said.
    pub(crate) fn seen(self, camera: Option<Vec3>, target: Option<Vec3>) -> Self {
        Self { camera, target, ..self }
    }

    /// Where the camera was told to stand.
    pub(crate) fn position(&self) -> Option<Vec3> {
        self.camera
    }

    /// Degrees from bottom to top.
    pub(crate) fn fov_deg(&self) -> f32 {
        self.fov
    }

    /// The same view in another size.
    pub(crate) fn resized(&self, width: u32, height: u32) -> Self {
        Self { width, height, ..self.clone() }
    }

    /// The camera at `position` in a scene of these bounds.
    pub(crate) fn pinhole_from(&self, position: Vec3, bounds: &Bounds) -> anyhow::Result<Pinhole> {
        let target = self.target.unwrap_or_else(|| bounds.centre());
        Ok(Pinhole::new(position, target, self.fov, self.width, self.height)?)
    }

    /// The camera at `position`, looking along `forward`.
    pub(crate) fn pinhole_at(&self, position: Vec3, forward: Vec3) -> anyhow::Result<Pinhole> {
        Ok(Pinhole::new(position, position + forward, self.fov, self.width, self.height)?)
    }
}

/// One view, by service light and by the path tracer, at one exposure.
pub(crate) struct Comparison {
    pub(crate) service: Layers,
    pub(crate) reference: Layers,
    pub(crate) exposure: f32,
}

impl Comparison {
    /// Takes both pictures.
    pub(crate) fn take(
        tracer: &SceneTracer<'_>,
        rig: &LightRig,
        options: &PictureOptions,
        reference_samples: u32,
        lookup: &IrradianceLookup<'_>,
    ) -> anyhow::Result<Self> {
        let service = render(tracer, rig, options, LightSource::Lookup(lookup))?;
        let traced = PictureOptions { samples: reference_samples, ..*options };
        let reference = render(tracer, rig, &traced, LightSource::Reference)?;
        let exposure = image_file::key_exposure(&reference.full);
        Ok(Self { service, reference, exposure })
    }

    /// Errors of the indirect light alone, at the common exposure.
    pub(crate) fn indirect_errors(&self) -> anyhow::Result<metrics::PictureErrors> {
        let shown = |layers: &Layers| image_file::exposed(&layers.indirect, self.exposure);
        Ok(metrics::compare_pictures(&shown(&self.service), &shown(&self.reference))?)
    }

    /// Direct, indirect, full, reference, difference, side by side.
    pub(crate) fn write_sheet(&self, path: &Path) -> anyhow::Result<()> {
        let shown = |picture: &Picture| image_file::exposed(picture, self.exposure);
        // Full colour where the difference is as bright as middle grey.
        let scale = 0.18 / self.exposure;
        let difference = difference::difference(&self.service.full, &self.reference.full, scale)?;
        let pictures = [
            ("DIRECT", shown(&self.service.direct)),
            ("INDIRECT SERVED", shown(&self.service.indirect)),
            ("FULL", shown(&self.service.full)),
            ("INDIRECT REFERENCE", shown(&self.reference.indirect)),
            ("FULL REFERENCE", shown(&self.reference.full)),
            ("DIFFERENCE", difference),
        ];
        let labelled: Vec<_> = pictures.iter().map(|(label, picture)| (*label, picture)).collect();
        let sheet = sheet::sheet(&labelled, 3)?;
        image_file::write_png(path, &sheet)?;
        Ok(())
    }
}

/// Writes the layers as PNG at one exposure, and as OpenEXR where asked.
pub(crate) fn write_layers(
    folder: &Path,
    prefix: &str,
    layers: &Layers,
    exposure: f32,
    exr: bool,
) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let named = [("direct", &layers.direct), ("indirect", &layers.indirect), ("full", &layers.full)];
    for (name, picture) in named {
        let stem = folder.join(format!("{prefix}{name}"));
        image_file::write_png(&stem.with_extension("png"), &image_file::exposed(picture, exposure))?;
        if exr {
            image_file::write_exr(&stem.with_extension("exr"), picture)?;
        }
    }
    Ok(())
}
