//! `bench pictures`: scenes baked, solved and drawn by their indirect light, held against the path tracer's pictures.
//!
//! What is compared is indirect light alone, in 8-bit sRGB at one exposure a scene: the one at which the geometric mean of
//! the reference becomes middle grey. SSIM forgives wrong energy, so the bias of the linear light stands beside it; and it
//! takes noise of the reference for structure, so beside that against one reference is what two of them have in common:
//! of served light as it is, and refined in screen space.

use super::Report;
use super::accuracy::measured::baked;
use crate::output::out;
use crate::progress_bars::counted;
use crate::quality::QualityArguments;
use crate::render::screen_space::{SERVED_RADIUS_VOXELS, SERVED_SAMPLES};
use crate::scene_source::{self, SceneSource};
use crate::view::{ViewArguments, vector};
use crate::volume_light;
use crate::writable;
use anyhow::Context as _;
use clap::Args;
use earthshine_render::SceneTracer;
use earthshine_render::metrics::{
    LinearErrors, PictureErrors, check_window, compare_pictures, linear_errors,
};
use earthshine_render::noiseless::{CORRECTION_MAX, NoiselessErrors, compare_noiseless, lost_ssim};
use earthshine_render::picture::{Layers, LightSource, PictureOptions, check_samples, render_with_progress};
use earthshine_render::screen_space::{self, ScreenSpaceOptions};
use earthshine_render::{difference, image_file};
use earthshine_scene::SceneError;
use earthshine_world::Vec3;
use serde::Serialize;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;

/// Arguments of `bench pictures`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine bench pictures cornell --markdown
  earthshine bench pictures cornell 'sponza.glb;lights=sponza.lights.json;voxel=1.03;camera=-8,2,0;target=0,3,0' --markdown
  earthshine bench pictures 'office.glb;voxel=0.25' --reference-samples 1024 --out pictures --json")]
pub(crate) struct PicturesArguments {
    /// Scenes: NAME or FILE, then what else holds for it: `;lights=FILE`, `;voxel=M`, `;camera=X,Y,Z`, `;target=X,Y,Z`.
    #[arg(required = true)]
    scenes: Vec<Subject>,
    /// Pixels across.
    #[arg(long, default_value_t = 480)]
    width: u32,
    /// Pixels down.
    #[arg(long, default_value_t = 270)]
    height: u32,
    /// Paths a pixel of the reference.
    #[arg(long, default_value_t = 512)]
    reference_samples: u32,
    /// Rays a pixel that refine served light in screen space.
    #[arg(long, default_value_t = SERVED_SAMPLES)]
    refine_samples: u32,
    /// Folder for the pictures, what they are off by, and where SSIM is lost; without it none are kept.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print a Markdown table.
    #[arg(long)]
    markdown: bool,
    #[command(flatten)]
    quality: QualityArguments,
}

/// One scene, and from where it is seen.
#[derive(Debug, Clone, PartialEq, Default)]
struct Subject {
    scene: String,
    lights: Option<PathBuf>,
    voxel_edge_m: Option<f32>,
    camera: Option<Vec3>,
    target: Option<Vec3>,
}

impl FromStr for Subject {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(';');
        let scene = parts.next().unwrap_or_default().to_owned();
        let mut subject = Self { scene, ..Self::default() };
        for part in parts {
            let (key, value) = part.split_once('=').ok_or_else(|| format!("{part:?} is not KEY=VALUE"))?;
            match key {
                "lights" => subject.lights = Some(value.into()),
                "voxel" => {
                    let edge = value.parse::<f32>().map_err(|error| format!("voxel {value:?}: {error}"))?;
                    subject.voxel_edge_m = Some(edge);
                }
                "camera" => subject.camera = Some(vector(value)?),
                "target" => subject.target = Some(vector(value)?),
                _ => return Err(format!("{key:?} is none of lights, voxel, camera, target")),
            }
        }
        Ok(subject)
    }
}

impl PicturesArguments {
    /// What would be found out after the bake of a scene, or of the ones before it.
    fn check(&self) -> anyhow::Result<()> {
        check_window(self.width, self.height)?;
        check_samples(self.reference_samples)?;
        self.out.iter().try_for_each(|folder| writable::ensure_folder(folder))?;
        for subject in &self.scenes {
            let is_file = Path::new(&subject.scene).extension().is_some();
            let scene = is_file.then(|| PathBuf::from(&subject.scene));
            for file in scene.iter().chain(&subject.lights) {
                let name = file.display().to_string();
                std::fs::File::open(file).map_err(|source| match source.kind() {
                    ErrorKind::NotFound => SceneError::NotFound { file: name },
                    _ => SceneError::Io { file: name, source },
                })?;
            }
        }
        Ok(())
    }
}

/// Added to the seed for pictures that are measured.
pub(super) const OWN_SEED: u64 = 0x5EED;

#[derive(Serialize)]
struct Figures {
    width: u32,
    height: u32,
    reference_samples: u32,
    pictures: Vec<PictureFigures>,
}

#[derive(Serialize)]
struct PictureFigures {
    scene: String,
    voxel_edge_m: f32,
    detail: u32,
    patches: u64,
    exposure: f32,
    uncovered_share: f64,
    #[serde(flatten)]
    errors: PictureErrors,
    /// Without the references' noise.
    noiseless: NoiselessErrors,
    /// The same of served light that is refined in screen space.
    refined: NoiselessErrors,
    /// Of the light itself, pixel by pixel; the reference's noise is in `median_rel`.
    linear: LinearErrors,
    /// Two references of different seeds: what noise alone costs.
    noise: PictureErrors,
}

/// Runs the suite.
pub(crate) fn run(arguments: &PicturesArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    arguments.check()?;
    let pictures = arguments
        .scenes
        .iter()
        .map(|subject| figures_of(arguments, subject, json).with_context(|| subject.scene.clone()))
        .collect::<anyhow::Result<Vec<_>>>()?;
    let PicturesArguments { width, height, reference_samples, .. } = *arguments;
    let figures = Figures { width, height, reference_samples, pictures };
    if arguments.markdown && !json {
        print_table(&figures);
        return Ok(());
    }
    let names: Vec<&str> = arguments.scenes.iter().map(|subject| subject.scene.as_str()).collect();
    let seconds = started.elapsed().as_secs_f64();
    Report::new("pictures", &names.join(" "), "gather", arguments.quality.seed, seconds, figures).print(json)
}

fn figures_of(
    arguments: &PicturesArguments,
    subject: &Subject,
    quiet: bool,
) -> anyhow::Result<PictureFigures> {
    let source =
        scene_source::load(&subject.scene, subject.lights.as_deref(), arguments.quality.metals_black())?;
    let quality = arguments.quality.clone();
    let quality = match subject.voxel_edge_m {
        Some(edge) => quality.with_voxel(edge),
        None => quality,
    };
    let parameters = quality.checked(&source)?;
    let tracer = source.tracer();
    let view = ViewArguments::sized(arguments.width, arguments.height).seen(subject.camera, subject.target);
    let camera = crate::render::default_view::pinhole(&view, &tracer, &source.lights)?;
    let seed = arguments.quality.seed;
    let refining = ScreenSpaceOptions {
        camera,
        far_samples: arguments.refine_samples,
        near_samples: 1,
        radius_m: SERVED_RADIUS_VOXELS * parameters.grid.voxel_edge_m,
        seed,
    };
    refining.validate()?;
    let measured = baked(&source, parameters, quiet)?;
    let shoot = |samples: u32, seed: u64, light: LightSource<'_>| -> anyhow::Result<Layers> {
        picture(&tracer, &source, &PictureOptions { camera, samples, seed }, light, quiet)
    };
    let lookup = |position, normal| volume_light::at(&measured.volumes, position, normal);
    let light = screen_space::served(&tracer, &source.lights, &refining, &lookup, &|_| {})?;
    let refined_lookup = light.refined_lookup(&lookup);
    // Other places in pixels than either reference's, or what they share would count as right.
    let own_seed = seed.wrapping_add(OWN_SEED);
    let refined = shoot(crate::render::LOOKUP_SAMPLES, own_seed, LightSource::Lookup(&refined_lookup))?;
    let served = shoot(crate::render::LOOKUP_SAMPLES, own_seed, LightSource::Lookup(&lookup))?;
    let reference = shoot(arguments.reference_samples, seed, LightSource::Reference)?;
    let again = shoot(arguments.reference_samples, !seed, LightSource::Reference)?;
    let exposure = image_file::key_exposure(&reference.indirect);
    let shown = |layers: &Layers| image_file::exposed(&layers.indirect, exposure);
    let references = [&shown(&reference), &shown(&again)];
    if let Some(folder) = &arguments.out {
        let stem = source.name.trim_end_matches(".glb");
        crate::view::write_layers(folder, &format!("{stem}_reference_"), &reference, exposure, false)?;
        for (name, layers) in [("service", &served), ("refined", &refined)] {
            crate::view::write_layers(folder, &format!("{stem}_{name}_"), layers, exposure, false)?;
            // Full colour where the difference is as bright as middle grey.
            let off = difference::difference(&layers.indirect, &reference.indirect, 0.18 / exposure)?;
            let lost = lost_ssim(&shown(layers), references)?;
            for (what, picture) in [("off", off), ("lost_ssim", lost)] {
                image_file::write_png(&folder.join(format!("{stem}_{name}_{what}.png")), &picture)?;
            }
        }
    }
    let noiseless = compare_noiseless(&shown(&served), references)?;
    let refined = compare_noiseless(&shown(&refined), references)?;
    let correction = noiseless.ssim_correction.max(refined.ssim_correction);
    if correction > CORRECTION_MAX {
        eprintln!(
            "{}: the references' noise takes {:.3} off SSIM without noise, which is more than can be known: \
             it is true to some hundredths; ask for more --reference-samples",
            source.name, correction
        );
    }
    Ok(PictureFigures {
        scene: source.name.clone(),
        voxel_edge_m: parameters.grid.voxel_edge_m,
        detail: parameters.detail,
        patches: measured.patches,
        exposure,
        uncovered_share: served.uncovered_share,
        errors: compare_pictures(&shown(&served), &shown(&reference))?,
        noiseless,
        refined,
        linear: linear_errors(&served.indirect, &reference.indirect)?,
        noise: compare_pictures(&shown(&again), &shown(&reference))?,
    })
}

/// One picture under a progress bar.
pub(super) fn picture(
    tracer: &SceneTracer<'_>,
    source: &SceneSource,
    options: &PictureOptions,
    light: LightSource<'_>,
    quiet: bool,
) -> anyhow::Result<Layers> {
    let pixels = u64::from(options.camera.width()) * u64::from(options.camera.height());
    let bar = counted("picture", "pixels", pixels, quiet);
    let layers = render_with_progress(tracer, &source.lights, options, light, &|done| bar.inc(done))?;
    bar.finish_and_clear();
    Ok(layers)
}

fn print_table(figures: &Figures) {
    out!(
        "| scene | voxel | detail | patches | SSIM | PSNR | FLIP | bias | SSIM, PSNR without noise | the same, refined | SSIM, FLIP of two references |"
    );
    out!("|---|---|---|---|---|---|---|---|---|---|---|");
    let decibels = |psnr_db: Option<f64>| psnr_db.map_or("same".to_owned(), |db| format!("{db:.1} dB"));
    for picture in &figures.pictures {
        let PictureFigures { scene, voxel_edge_m, detail, patches, errors, noiseless, refined, .. } = picture;
        let PictureFigures { linear, noise, .. } = picture;
        out!(
            "| {scene} | {voxel_edge_m:.3} m | {detail} | {patches} | {:.3} | {} | {:.3} | {:+.1} % | {:.3}, {} | {:.3}, {} | {:.3}, {:.3} |",
            errors.ssim,
            decibels(errors.psnr_db),
            errors.flip,
            linear.bias * 100.0,
            noiseless.ssim,
            decibels(noiseless.psnr_db),
            refined.ssim,
            decibels(refined.psnr_db),
            noise.ssim,
            noise.flip
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subjects_are_read_and_wrong_ones_named() {
        let subject: Subject = "a.glb;lights=l.json;voxel=0.5;camera=-1,2,3;target=0,0,0".parse().unwrap();
        assert_eq!((subject.scene.as_str(), subject.voxel_edge_m), ("a.glb", Some(0.5)));
        assert_eq!((subject.camera, subject.target), (Some(Vec3::new(-1.0, 2.0, 3.0)), Some(Vec3::ZERO)));
        assert_eq!("cornell".parse(), Ok(Subject { scene: "cornell".to_owned(), ..Subject::default() }));
        for (wrong, named) in [("a;light=b", "light"), ("a;voxel", "voxel"), ("a;camera=1,2", "2 numbers")] {
            let error = wrong.parse::<Subject>().unwrap_err();
            assert!(error.contains(named), "{error}");
        }
    }
}
