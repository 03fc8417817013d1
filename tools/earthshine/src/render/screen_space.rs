//! `--method screen-space`: indirect light with and without refinement, each against the reference.

use super::{Task, described_linear};
use crate::output::out;
use crate::progress_bars::counted;
use crate::view::write_layers;
use crate::volume_light;
use crate::whole_world::WholeWorld;
use clap::Args;
use earthshine_render::camera::Pinhole;
use earthshine_render::metrics::{LinearErrors, PictureErrors, compare_pictures, linear_errors};
use earthshine_render::picture::{Layers, LightSource, Picture};
use earthshine_render::screen_space::screen_light::ScreenLight;
use earthshine_render::screen_space::{self, ScreenIrradiance, ScreenSpaceOptions};
use earthshine_render::{difference, image_file, sheet};
use earthshine_world::Rgb;
use std::path::Path;

/// Where near ends, as a share of the scene's diagonal, unless told: about a voxel of a bake with some thousand patches.
pub(crate) const RADIUS_SHARE: f32 = 0.03;

/// The same of served light, as a share of a voxel.
pub(crate) const SERVED_RADIUS_VOXELS: f32 = 0.5;
/// Rays a pixel without and with a world, unless told.
const FAR_SAMPLES: u32 = 8;
pub(crate) const SERVED_SAMPLES: u32 = 64;

/// Options of the method.
#[derive(Args)]
#[command(next_help_heading = "With --method screen-space")]
pub(super) struct ScreenSpaceArguments {
    /// Far rays a pixel, each answered by a path; 8 if not given. With --world rays a pixel, each answered by its light; 64 if not
    /// given.
    #[arg(long)]
    far_samples: Option<u32>,
    /// Short rays a pixel for occlusion and near light; 16 if not given. Not with --world.
    #[arg(long)]
    near_samples: Option<u32>,
    /// Where near ends, m. Default: half a voxel with --world, else 3 % of the scene's diagonal.
    #[arg(long)]
    radius: Option<f32>,
}

impl ScreenSpaceArguments {
    /// Whether any was given.
    pub(super) fn is_given(&self) -> bool {
        self.far_samples.is_some() || self.near_samples.is_some() || self.radius.is_some()
    }

    /// Whether short rays were asked for.
    pub(super) fn has_near_samples(&self) -> bool {
        self.near_samples.is_some()
    }
}

/// A way to the picture, and how far off its indirect light is.
struct Variant {
    name: &'static str,
    layers: Layers,
    errors: PictureErrors,
    linear: LinearErrors,
}

/// Far light from few rays a pixel.
pub(super) fn gathered(task: &Task<'_>) -> anyhow::Result<()> {
    let options = options(task, FAR_SAMPLES, RADIUS_SHARE * task.source.scene.bounds().size().length());
    let bar = counted("gather", "pixels", screen_space::work_pixels(&options.camera), task.arguments.json);
    let advance = |pixels| bar.inc(pixels);
    let light = screen_space::gathered(task.tracer, &task.source.lights, &options, &advance)?;
    bar.finish();
    let names = [("gathered", &light.raw), ("unrefined", &light.plain), ("refined", &light.refined)];
    let mut drawn = Vec::new();
    for (name, irradiance) in names {
        let screen = ScreenLight { buffer: &light.buffer, irradiance };
        let lookup = |position, normal| screen.at(position, normal);
        drawn.push((name, task.lookup_layers(name, LightSource::Lookup(&lookup))?));
    }
    report(task, &options, &light, drawn)
}

/// Light of the world in `folder` where rays end.
pub(super) fn served(task: &Task<'_>, folder: &Path) -> anyhow::Result<()> {
    let world = WholeWorld::load(folder)?;
    let voxel_edge_m = world.manifest.parameters.grid.voxel_edge_m;
    let options = options(task, SERVED_SAMPLES, SERVED_RADIUS_VOXELS * voxel_edge_m);
    options.validate()?;
    let rig = &task.source.lights;
    let volumes = world.volumes(&world.solve(rig))?;
    let lookup = |position, normal| volume_light::at(&volumes, position, normal);
    let work = screen_space::served::work_texels(&options.camera);
    let bar = counted("refine", "texels", work, task.arguments.json);
    let advance = |pixels| bar.inc(pixels);
    let light = screen_space::served(task.tracer, rig, &options, &lookup, &advance)?;
    bar.finish();
    let refined = light.refined_lookup(&lookup);
    let drawn = vec![
        ("unrefined", task.lookup_layers("unrefined", LightSource::Lookup(&lookup))?),
        ("refined", task.lookup_layers("refined", LightSource::Lookup(&refined))?),
    ];
    report(task, &options, &light, drawn)
}

fn options(task: &Task<'_>, default_samples: u32, default_radius_m: f32) -> ScreenSpaceOptions {
    let given = &task.arguments.screen_space;
    ScreenSpaceOptions {
        camera: task.options.camera,
        far_samples: given.far_samples.unwrap_or(default_samples),
        near_samples: given.near_samples.unwrap_or(16),
        radius_m: given.radius.unwrap_or(default_radius_m),
        seed: task.arguments.seed,
    }
}

/// Writes pictures and sheet, prints the errors.
fn report(
    task: &Task<'_>,
    options: &ScreenSpaceOptions,
    light: &ScreenIrradiance,
    drawn: Vec<(&'static str, Layers)>,
) -> anyhow::Result<()> {
    let arguments = task.arguments;
    let reference = task.reference()?;
    let exposure = arguments.exposure.unwrap_or_else(|| image_file::key_exposure(&reference.full));
    let shown = |picture: &Picture| image_file::exposed(picture, exposure);
    let mut variants = Vec::new();
    for (name, layers) in drawn {
        let errors = compare_pictures(&shown(&layers.indirect), &shown(&reference.indirect))?;
        let linear = linear_errors(&layers.indirect, &reference.indirect)?;
        write_layers(&arguments.out, &format!("{name}_"), &layers, exposure, arguments.exr)?;
        variants.push(Variant { name, layers, errors, linear });
    }
    write_layers(&arguments.out, "reference_", &reference, exposure, arguments.exr)?;
    write_sheet(&arguments.out, &variants, &reference, &occlusion_picture(light, &options.camera), exposure)?;
    if arguments.json {
        let by_name: serde_json::Map<_, _> = variants
            .iter()
            .map(|variant| {
                let figures = serde_json::json!({
                    "picture": variant.errors, "linear": variant.linear,
                    "uncovered_share": variant.layers.uncovered_share,
                });
                (variant.name.to_owned(), figures)
            })
            .collect();
        let near_samples = arguments.world.is_none().then_some(options.near_samples);
        let figures = serde_json::json!({
            "method": "screen-space", "radius_m": options.radius_m,
            "far_samples": options.far_samples, "near_samples": near_samples, "exposure": exposure, "indirect": by_name,
        });
        out!("{figures}");
        return Ok(());
    }
    out!("{}: reference_*, refined_*, sheet.png; exposure {exposure:e}", arguments.out.display());
    out!("indirect light against the reference, sRGB at that exposure; near is {} m", options.radius_m);
    for variant in &variants {
        let (picture, linear) =
            (crate::compare::described(&variant.errors), described_linear(&variant.linear));
        out!("{:>9}: {picture}; light {linear}", variant.name);
    }
    Ok(())
}

/// White where nothing is near; of several texels to a pixel the mean.
fn occlusion_picture(light: &ScreenIrradiance, camera: &Pinhole) -> Picture {
    let across = light.buffer.camera().width();
    let finer = across / camera.width();
    let open = |pixel: u32| {
        let (left, top) = (pixel % camera.width() * finer, pixel / camera.width() * finer);
        let texel = |at: u32| light.occlusion[((top + at / finer) * across + left + at % finer) as usize];
        1.0 - (0..finer * finer).map(texel).sum::<f32>() / (finer * finer) as f32
    };
    let pixels = (0..camera.width() * camera.height()).map(|pixel| Rgb::splat(open(pixel))).collect();
    Picture::new(camera.width(), camera.height(), pixels)
}

fn write_sheet(
    folder: &Path,
    variants: &[Variant],
    reference: &Layers,
    occlusion: &Picture,
    exposure: f32,
) -> anyhow::Result<()> {
    let shown = |picture: &Picture| image_file::exposed(picture, exposure);
    // Full colour where the difference is as bright as middle grey.
    let scale = 0.18 / exposure;
    let mut pictures = Vec::new();
    for variant in variants {
        let name = variant.name.to_uppercase();
        let off = difference::difference(&variant.layers.indirect, &reference.indirect, scale)?;
        pictures.push((format!("INDIRECT {name}"), shown(&variant.layers.indirect)));
        pictures.push((format!("DIFFERENCE {name}"), off));
        pictures.push((format!("FULL {name}"), shown(&variant.layers.full)));
    }
    pictures.push(("INDIRECT REFERENCE".to_owned(), shown(&reference.indirect)));
    pictures.push(("NEAR OCCLUSION".to_owned(), image_file::exposed(occlusion, 1.0)));
    pictures.push(("FULL REFERENCE".to_owned(), shown(&reference.full)));
    let labelled: Vec<_> = pictures.iter().map(|(label, picture)| (label.as_str(), picture)).collect();
    image_file::write_png(&folder.join("sheet.png"), &sheet::sheet(&labelled, 3)?)?;
    Ok(())
}
