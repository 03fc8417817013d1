//! `earthshine render`: pictures of a scene by one of several methods, beside the path tracer's.

mod animation;
pub(crate) mod default_view;
mod progressive;
pub(crate) mod screen_space;
mod traced;

use crate::error_view::View;
use crate::exit_code::WrongUse;
use crate::progress_bars::counted;
use crate::same_scene;
use crate::scene_source::{self, SceneSource};
use crate::view::ViewArguments;
use crate::writable;
use clap::{Args, ValueEnum};
use earthshine_render::picture::{Layers, LightSource, PictureOptions, check_samples, render_with_progress};
use earthshine_render::{SceneTracer, metrics};
use earthshine_tiles::Manifest;
use std::path::PathBuf;

/// Arguments of `earthshine render`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine render cornell.glb --out pictures --camera 0,1,3.5 --target 0,1,0
  earthshine render sponza.glb --lights sponza.lights.json --world sponza.world --out pictures --exr
  earthshine render sponza.glb --lights sponza.lights.json --method screen-space --far-samples 8 --radius 1
  earthshine render sponza.glb --lights sponza.lights.json --method screen-space --world sponza.world
  earthshine render sponza.glb --world sponza.world --animation sun --solvers hybrid,alias --out moving
  earthshine render cornell --method progressive --until 99 --visibility id-buffer --out frames
With --world: served-light pictures, the path-traced reference, their difference, and a sheet of all of them.
With --animation: moving light by solvers side by side, as animation.gif and strip.png.
With --method screen-space: indirect light with and without refinement (of a world's light one bounce later, sharp below
voxel size), each against the reference, and a sheet.
With --method progressive: frame_0001.png and so on as light spreads, progress.csv and progress.svg (power shot), and the
last picture against the reference.")]
pub(crate) struct RenderArguments {
    /// A .glb or .gltf file, or the name of a generated scene.
    scene: String,
    /// Lights JSON.
    #[arg(long)]
    lights: Option<PathBuf>,
    /// World baked from the scene: draws its light beside the reference.
    #[arg(long)]
    world: Option<PathBuf>,
    /// How light is found.
    #[arg(long, value_enum, default_value_t = Method::PathTraced)]
    method: Method,
    /// Folder for the pictures.
    #[arg(long, default_value = "pictures")]
    out: PathBuf,
    #[command(flatten)]
    view: ViewArguments,
    #[command(flatten)]
    screen_space: screen_space::ScreenSpaceArguments,
    #[command(flatten)]
    progressive: progressive::ProgressiveArguments,
    #[command(flatten)]
    animation: animation::AnimationArguments,
    /// Paths a pixel of the reference.
    #[arg(long, default_value_t = 64)]
    samples: u32,
    /// Every random number hangs on it.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Exposure: radiance times this is shown, clipped at one. Default: the geometric mean becomes middle grey.
    #[arg(long, value_parser = crate::numbers::positive)]
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

/// How pictures are made.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Method {
    /// Random paths; with --world the served light beside them.
    PathTraced,
    /// Few rays a pixel, filtered, refined by near occlusion; with --world its light answers for where they end.
    ScreenSpace,
    /// Radiosity by shooting, for small scenes.
    Progressive,
}

/// Places within a pixel where light is looked up.
pub(crate) const LOOKUP_SAMPLES: u32 = 32;

/// Runs the subcommand.
pub(crate) fn run(arguments: &RenderArguments) -> anyhow::Result<()> {
    arguments.check()?;
    writable::ensure_folder(&arguments.out)?;
    let manifest = arguments.world.as_deref().map(Manifest::load).transpose()?;
    // The reference's metals are those that the world was baked with.
    let metals_black = manifest.as_ref().is_some_and(|manifest| manifest.parameters.metals_black);
    let source = scene_source::load(&arguments.scene, arguments.lights.as_deref(), metals_black)?;
    scene_source::warn_if_dark(&source);
    match (&arguments.world, &manifest) {
        (Some(world), Some(manifest)) if arguments.shown == View::Light => {
            same_scene::warn_if_other(&source, world, manifest);
        }
        (Some(world), Some(manifest)) => same_scene::ensure_related(&source, world, manifest)?,
        _ => (),
    }
    let tracer = source.tracer();
    let camera = default_view::pinhole(&arguments.view, &tracer, &source.lights)?;
    let options = PictureOptions { camera, samples: arguments.samples, seed: arguments.seed };
    check_samples(arguments.samples)?;
    let is_compared = arguments.world.is_some() || arguments.method != Method::PathTraced;
    if is_compared && arguments.shown == View::Light && arguments.animation.wanted().is_none() {
        metrics::check_window(camera.width(), camera.height())?;
    }
    let task = Task { arguments, source: &source, tracer: &tracer, options };
    if let (Some(animation), Some(world)) = (arguments.animation.wanted(), &arguments.world) {
        return animation::animate(&task, animation, world);
    }
    match (arguments.method, &arguments.world) {
        (Method::PathTraced, None) => traced::reference(&task),
        (Method::PathTraced, Some(world)) => traced::served(&task, world),
        (Method::ScreenSpace, None) => screen_space::gathered(&task),
        (Method::ScreenSpace, Some(world)) => screen_space::served(&task, world),
        (Method::Progressive, _) => progressive::refine(&task),
    }
}

impl RenderArguments {
    /// Options of one method given to another would be ignored silently.
    fn check(&self) -> Result<(), WrongUse> {
        let screen_space = self.method == Method::ScreenSpace;
        let faults = [
            (
                self.shown != View::Light && self.world.is_none(),
                "--view error and --view cause need a world to look at: name it with --world",
            ),
            (
                self.shown != View::Light && self.method != Method::PathTraced,
                "--view error and --view cause hold a world's light against --method path-traced alone",
            ),
            (
                !screen_space && self.screen_space.is_given(),
                "--far-samples, --near-samples and --radius need --method screen-space",
            ),
            (
                screen_space && self.world.is_some() && self.screen_space.has_near_samples(),
                "--near-samples has no use with --world: near and far light are found by the same rays, --far-samples",
            ),
            (
                self.method != Method::Progressive && self.progressive.is_given(),
                "--visibility, --id-texels, --patch-area, --elements, --splits, --gradient, --until, --shots and \
                 --ambient need --method progressive",
            ),
            (
                self.method == Method::Progressive && self.world.is_some(),
                "--method progressive computes all light from the scene: leave --world out",
            ),
            (
                self.animation.wanted().is_some()
                    && (self.world.is_none() || self.method != Method::PathTraced),
                "--animation needs --world, whose light moves, and no other --method",
            ),
            (
                self.animation.wanted().is_none() && self.animation.is_given(),
                "--solvers, --frames, --picture-every and --sun-path need --animation",
            ),
            (
                self.animation.wanted().is_some() && (self.exr || self.shown != View::Light),
                "--animation draws light alone: leave --exr and --view out",
            ),
            (self.animation.has_useless_sun_path(), "--sun-path needs --animation sun"),
            (self.progressive.has_useless_texels(), "--id-texels needs --visibility id-buffer"),
        ];
        faults.into_iter().find(|fault| fault.0).map_or(Ok(()), |fault| Err(WrongUse(fault.1)))
    }
}

/// What all methods share.
struct Task<'a> {
    arguments: &'a RenderArguments,
    source: &'a SceneSource,
    tracer: &'a SceneTracer<'a>,
    options: PictureOptions,
}

impl Task<'_> {
    /// Pixels of a picture.
    fn pixels(&self) -> u64 {
        u64::from(self.options.camera.width()) * u64::from(self.options.camera.height())
    }

    /// The path-traced picture, under a progress bar.
    fn reference(&self) -> anyhow::Result<Layers> {
        self.layers("reference", self.arguments.samples, LightSource::Reference)
    }

    /// A picture by `source`, under a progress bar of that name.
    fn layers(&self, name: &'static str, samples: u32, source: LightSource<'_>) -> anyhow::Result<Layers> {
        let bar = counted(name, "pixels", self.pixels(), self.arguments.json);
        let options = PictureOptions { samples, ..self.options };
        let layers = render_with_progress(self.tracer, &self.source.lights, &options, source, &|pixels| {
            bar.inc(pixels);
        })?;
        bar.finish();
        Ok(layers)
    }

    /// A picture by a lookup, at fewer places within a pixel than the reference's paths.
    fn lookup_layers(&self, name: &'static str, source: LightSource<'_>) -> anyhow::Result<Layers> {
        self.layers(name, self.arguments.samples.min(LOOKUP_SAMPLES), source)
    }
}

/// One line for people.
fn described_linear(errors: &metrics::LinearErrors) -> String {
    format!("median {:.2} %, bias {:+.2} %", errors.median_rel * 100.0, errors.bias * 100.0)
}
