//! `earthshine render`: pictures by path tracing, and by a world's light beside it.

use crate::error_view::{ErrorView, View};
use crate::exit_code::WrongUse;
use crate::output::out;
use crate::scene_source;
use crate::view::{Comparison, ViewArguments, write_layers};
use crate::volume_light;
use crate::whole_world::WholeWorld;
use clap::Args;
use earthshine_render::picture::{LightSource, PictureOptions, render};
use earthshine_render::{SceneTracer, image_file};
use std::path::PathBuf;

/// Arguments of `earthshine render`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine render cornell.glb --out pictures --camera 0,1,3.5 --target 0,1,0
  earthshine render sponza.glb --lights sponza.lights.json --world sponza.world --out pictures --exr
With --world: served-light pictures, the path-traced reference, their difference, and a sheet of all of them.")]
pub(crate) struct RenderArguments {
    /// A .glb or .gltf file, or the name of a generated scene.
    scene: String,
    /// Lights JSON.
    #[arg(long)]
    lights: Option<PathBuf>,
    /// World baked from the scene: draws its light beside the reference.
    #[arg(long)]
    world: Option<PathBuf>,
    /// Folder for the pictures.
    #[arg(long, default_value = "pictures")]
    out: PathBuf,
    #[command(flatten)]
    view: ViewArguments,
    /// Paths a pixel of the reference.
    #[arg(long, default_value_t = 64)]
    samples: u32,
    /// Every random number hangs on it.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Exposure: radiance times this is shown, clipped at one. Default: the geometric mean becomes middle grey.
    #[arg(long)]
    exposure: Option<f32>,
    /// Also write linear OpenEXR files.
    #[arg(long)]
    exr: bool,
    /// What to draw of a world: its light; how far it is off, pixel by pixel; or why.
    #[arg(long = "view", default_value = "light")]
    shown: View,
    /// Print figures as JSON.
    #[arg(long)]
    json: bool,
}

/// Places within a pixel where served light is looked up.
const SERVICE_SAMPLES: u32 = 16;

/// Runs the subcommand.
pub(crate) fn run(arguments: &RenderArguments) -> anyhow::Result<()> {
    let source = scene_source::load(&arguments.scene, arguments.lights.as_deref(), false)?;
    scene_source::warn_if_dark(&source);
    let tracer = SceneTracer::new(&source.scene).under(source.environment.clone());
    let camera = arguments.view.pinhole(&source.scene.bounds())?;
    let options = PictureOptions { camera, samples: arguments.samples, seed: arguments.seed };
    if arguments.shown != View::Light && arguments.world.is_none() {
        return Err(
            WrongUse("--view error and --view cause need a world to look at: name it with --world").into()
        );
    }
    let Some(folder) = &arguments.world else {
        let layers = render(&tracer, &source.lights, &options, LightSource::Reference)?;
        let exposure = arguments.exposure.unwrap_or_else(|| image_file::key_exposure(&layers.full));
        write_layers(&arguments.out, "reference_", &layers, exposure, arguments.exr)?;
        out!("{}: reference_{{direct,indirect,full}}, exposure {exposure:e}", arguments.out.display());
        return Ok(());
    };
    let world = WholeWorld::load(folder)?;
    let light = world.solve(&source.lights);
    let volume = world.volume(&light)?;
    if arguments.shown != View::Light {
        let view = ErrorView {
            tracer: &tracer,
            source: &source,
            world: &world,
            light: &light,
            volume: &volume,
            camera,
            samples: arguments.samples,
            seed: arguments.seed,
            quiet: arguments.json,
        };
        return view.write(arguments.shown, &arguments.out, arguments.json);
    }
    let lookup = |position, normal| volume_light::at(&volume, position, normal);
    let service = PictureOptions { samples: arguments.samples.min(SERVICE_SAMPLES), ..options };
    let mut comparison = Comparison::take(&tracer, &source.lights, &service, arguments.samples, &lookup)?;
    comparison.exposure = arguments.exposure.unwrap_or(comparison.exposure);
    let exposure = comparison.exposure;
    write_layers(&arguments.out, "service_", &comparison.service, exposure, arguments.exr)?;
    write_layers(&arguments.out, "reference_", &comparison.reference, exposure, arguments.exr)?;
    comparison.write_sheet(&arguments.out.join("sheet.png"))?;
    if comparison.service.uncovered_share > 0.5 {
        eprintln!(
            "warning: most of the view has no light in {}: is it baked from this scene?",
            folder.display()
        );
    }
    let errors = comparison.indirect_errors()?;
    if arguments.json {
        let uncovered_share = comparison.service.uncovered_share;
        let figures = serde_json::json!({
            "exposure": exposure, "uncovered_share": uncovered_share, "indirect": errors,
            "ssim_window_pixels": earthshine_render::metrics::SSIM_WINDOW,
            "ssim_sigma_pixels": earthshine_render::metrics::SSIM_SIGMA,
        });
        out!("{figures}");
    } else {
        out!("{}: service_*, reference_*, sheet.png; exposure {exposure:e}", arguments.out.display());
        out!("indirect light, sRGB at that exposure: {}", crate::compare::described(&errors));
        out!(
            "{:.2} % of the surfaces in view have no light in the world",
            comparison.service.uncovered_share * 100.0
        );
    }
    Ok(())
}
