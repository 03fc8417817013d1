//! `bench refinement`: the screen-space method by rays a pixel, in its own right and over served light, against the path
//! tracer's picture.
//!
//! What is compared is indirect light alone, as `bench pictures` does it: 8-bit sRGB at one exposure, and by what two
//! references of different seeds have in common, so that their noise counts for nothing. Noise of the method itself counts.

use super::Report;
use super::accuracy::measured::baked;
use super::pictures::{OWN_SEED, picture};
use crate::exit_code::WrongUse;
use crate::output::out;
use crate::quality::QualityArguments;
use crate::render::LOOKUP_SAMPLES;
use crate::render::screen_space::{RADIUS_SHARE, SERVED_RADIUS_VOXELS};
use crate::scene_source::{self, SceneSource};
use crate::view::ViewArguments;
use crate::volume_light;
use clap::Args;
use earthshine_render::SceneTracer;
use earthshine_render::camera::Pinhole;
use earthshine_render::image_file;
use earthshine_render::metrics::linear_errors;
use earthshine_render::noiseless::{CORRECTION_MAX, compare_noiseless};
use earthshine_render::picture::{IrradianceLookup, Layers, LightSource, PictureOptions};
use earthshine_render::screen_space::screen_light::ScreenLight;
use earthshine_render::screen_space::{self, ScreenSpaceOptions};
use earthshine_world::Rgb;
use image::RgbImage;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `bench refinement`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine bench refinement --scene cornell --width 160 --height 90 --markdown
  earthshine bench refinement --scene sponza.glb --lights sponza.lights.json --camera -8,2,0 --target 0,3,0 --detail 4
  earthshine bench refinement --scene office.glb --pixel-rays 8,64 --json")]
pub(crate) struct RefinementArguments {
    /// A generated world or a .glb file.
    #[arg(long)]
    scene: String,
    /// Lights JSON.
    #[arg(long)]
    lights: Option<PathBuf>,
    /// Far rays a pixel, each number measured.
    #[arg(long, value_delimiter = ',', default_values_t = [4, 8, 16])]
    pixel_rays: Vec<u32>,
    /// Short rays a pixel beside them, for occlusion and near light; not of served light, whose rays find both.
    #[arg(long, default_value_t = 16)]
    near_samples: u32,
    /// Paths a pixel of the reference.
    #[arg(long, default_value_t = 512)]
    reference_samples: u32,
    /// Print a Markdown table.
    #[arg(long)]
    markdown: bool,
    #[command(flatten)]
    view: ViewArguments,
    #[command(flatten)]
    quality: QualityArguments,
}

#[derive(Serialize)]
struct Figures {
    width: u32,
    height: u32,
    near_samples: u32,
    /// Where near ends of far light from paths, and of served light, m.
    radius_m: f32,
    served_radius_m: f32,
    voxel_edge_m: f32,
    detail: u32,
    patches: u64,
    reference_samples: u32,
    /// Served light as it is looked up.
    served: Quality,
    by_rays: Vec<ByRays>,
}

/// Pictures of so many rays a pixel.
#[derive(Serialize)]
struct ByRays {
    pixel_rays: u32,
    /// Far rays alone, without any filter.
    gathered: Quality,
    /// The same, filtered along surfaces.
    filtered: Quality,
    /// Filtered far light beside near light and occlusion.
    refined: Quality,
    /// Served light one bounce later.
    served_refined: Quality,
}

/// How near a picture comes to the reference without the reference's noise.
#[derive(Clone, Copy, Serialize)]
struct Quality {
    ssim: f64,
    psnr_db: Option<f64>,
    bias: f64,
}

/// Runs the suite.
pub(crate) fn run(arguments: &RefinementArguments, json: bool) -> anyhow::Result<()> {
    if arguments.pixel_rays.is_empty() {
        return Err(WrongUse("--pixel-rays names no number of rays").into());
    }
    let started = Instant::now();
    let metals_black = arguments.quality.metals_black();
    let source = scene_source::load(&arguments.scene, arguments.lights.as_deref(), metals_black)?;
    let tracer = source.tracer();
    let camera = crate::render::default_view::pinhole(&arguments.view, &tracer, &source.lights)?;
    earthshine_render::metrics::check_window(camera.width(), camera.height())?;
    let parameters = arguments.quality.checked(&source)?;
    for &far_samples in &arguments.pixel_rays {
        let (near_samples, seed) = (arguments.near_samples, arguments.quality.seed);
        ScreenSpaceOptions { camera, far_samples, near_samples, radius_m: 1.0, seed }.validate()?;
    }
    let bench = Bench::new(arguments, &source, &tracer, camera, json)?;
    let world = baked(&source, parameters, json)?;
    let lookup = |position, normal| volume_light::at(&world.volumes, position, normal);
    let grid = world.world.grid;
    let radius_m = RADIUS_SHARE * source.scene.bounds().size().length();
    let served_radius_m = SERVED_RADIUS_VOXELS * grid.voxel_edge_m;
    let served = bench.quality(LightSource::Lookup(&lookup))?;
    let by_rays = arguments.pixel_rays.iter().map(|&pixel_rays| {
        let options = |radius_m: f32| ScreenSpaceOptions {
            camera,
            far_samples: pixel_rays,
            near_samples: arguments.near_samples,
            radius_m,
            seed: arguments.quality.seed,
        };
        let [gathered, filtered, refined] = bench.gathered(&options(radius_m))?;
        let served_refined = bench.refined(&options(served_radius_m), &lookup)?;
        anyhow::Ok(ByRays { pixel_rays, gathered, filtered, refined, served_refined })
    });
    let figures = Figures {
        width: camera.width(),
        height: camera.height(),
        near_samples: arguments.near_samples,
        radius_m,
        served_radius_m,
        voxel_edge_m: grid.voxel_edge_m,
        detail: world.world.manifest.parameters.detail,
        patches: world.patches,
        reference_samples: arguments.reference_samples,
        served,
        by_rays: by_rays.collect::<anyhow::Result<_>>()?,
    };
    if arguments.markdown && !json {
        print_table(&source.name, &figures);
        return Ok(());
    }
    let seconds = started.elapsed().as_secs_f64();
    Report::new("refinement", &source.name, "gather", arguments.quality.seed, seconds, figures).print(json)
}

/// One view and its references.
struct Bench<'a> {
    source: &'a SceneSource,
    tracer: &'a SceneTracer<'a>,
    camera: Pinhole,
    seed: u64,
    exposure: f32,
    /// Linear, of the first seed.
    reference: Layers,
    /// As shown, of two seeds.
    shown: [RgbImage; 2],
    quiet: bool,
}

impl<'a> Bench<'a> {
    fn new(
        arguments: &RefinementArguments,
        source: &'a SceneSource,
        tracer: &'a SceneTracer<'a>,
        camera: Pinhole,
        quiet: bool,
    ) -> anyhow::Result<Self> {
        let seed = arguments.quality.seed;
        let shoot = |seed: u64| {
            let options = PictureOptions { camera, samples: arguments.reference_samples, seed };
            picture(tracer, source, &options, LightSource::Reference, quiet)
        };
        let (reference, again) = (shoot(seed)?, shoot(!seed)?);
        let exposure = image_file::key_exposure(&reference.indirect);
        let shown = [&reference, &again].map(|layers| image_file::exposed(&layers.indirect, exposure));
        Ok(Self { source, tracer, camera, seed, exposure, reference, shown, quiet })
    }

    /// Draws by `light` and compares.
    fn quality(&self, light: LightSource<'_>) -> anyhow::Result<Quality> {
        let seed = self.seed.wrapping_add(OWN_SEED);
        let options = PictureOptions { camera: self.camera, samples: LOOKUP_SAMPLES, seed };
        let drawn = picture(self.tracer, self.source, &options, light, self.quiet)?;
        let shown = image_file::exposed(&drawn.indirect, self.exposure);
        let errors = compare_noiseless(&shown, [&self.shown[0], &self.shown[1]])?;
        if errors.ssim_correction > CORRECTION_MAX {
            eprintln!(
                "{}: the references' noise takes {:.3} off SSIM without noise, which is more than can be known: ask for \
                 more --reference-samples",
                self.source.name, errors.ssim_correction
            );
        }
        let bias = linear_errors(&drawn.indirect, &self.reference.indirect)?.bias;
        Ok(Quality { ssim: errors.ssim, psnr_db: errors.psnr_db, bias })
    }

    /// The method in its own right: far rays alone, filtered, and refined.
    fn gathered(&self, options: &ScreenSpaceOptions) -> anyhow::Result<[Quality; 3]> {
        let light = screen_space::gathered(self.tracer, &self.source.lights, options, &|_| {})?;
        let quality = |irradiance: &[Rgb]| {
            let screen = ScreenLight { buffer: &light.buffer, irradiance };
            self.quality(LightSource::Lookup(&|position, normal| screen.at(position, normal)))
        };
        Ok([quality(&light.raw)?, quality(&light.plain)?, quality(&light.refined)?])
    }

    /// Light of `lookup` one bounce later.
    fn refined(
        &self,
        options: &ScreenSpaceOptions,
        lookup: &IrradianceLookup<'_>,
    ) -> anyhow::Result<Quality> {
        let light = screen_space::served(self.tracer, &self.source.lights, options, lookup, &|_| {})?;
        self.quality(LightSource::Lookup(&light.refined_lookup(lookup)))
    }
}

fn print_table(scene: &str, figures: &Figures) {
    out!("| scene | rays a pixel | far rays alone | filtered | with near light | served | served, refined |");
    out!("|---|---|---|---|---|---|---|");
    let of = |quality: Quality| {
        let psnr = quality.psnr_db.map_or("same".to_owned(), |db| format!("{db:.1} dB"));
        format!("{:.3}, {psnr}", quality.ssim)
    };
    for (index, row) in figures.by_rays.iter().enumerate() {
        let served = if index == 0 { of(figures.served) } else { String::new() };
        out!(
            "| {} | {} | {} | {} | {} | {served} | {} |",
            if index == 0 { scene } else { "" },
            row.pixel_rays,
            of(row.gathered),
            of(row.filtered),
            of(row.refined),
            of(row.served_refined)
        );
    }
}
