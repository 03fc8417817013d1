//! `earthshine compare`: two pictures, or a world's light and a reference at points.

use crate::output::out;
use crate::scene_source;
use crate::volume_light;
use crate::whole_world::WholeWorld;
use clap::{Args, Subcommand};
use earthshine_render::compare_points::compare_points;
use earthshine_render::metrics::{PictureErrors, compare_pictures, flip_picture};
use earthshine_render::{csv, image_file};
use earthshine_world::{LightRig, Rgb};
use std::path::PathBuf;

/// Arguments of `earthshine compare`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine compare pictures service_full.png reference_full.png --flip flip.png
  earthshine compare points sponza.world sponza.mitsuba.csv --out points.csv")]
pub(crate) struct CompareArguments {
    #[command(subcommand)]
    what: What,
    /// Print JSON.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Subcommand)]
enum What {
    /// MSE, RMSE, PSNR, SSIM and FLIP of two pictures of one size. EXR and HDR are shown at --exposure first.
    Pictures {
        /// What was made.
        measured: PathBuf,
        /// What is right.
        reference: PathBuf,
        /// Exposure for linear pictures.
        #[arg(long, default_value_t = 1.0, value_parser = crate::numbers::positive)]
        exposure: f32,
        /// Writes the FLIP error map as PNG.
        #[arg(long)]
        flip: Option<PathBuf>,
    },
    /// A world's light at the points of a reference CSV.
    Points {
        /// World folder.
        world: PathBuf,
        /// x,y,z,nx,ny,nz,r,g,b,sr,sg,sb.
        reference: PathBuf,
        /// Lights JSON that replaces the lights of the world.
        #[arg(long)]
        lights: Option<PathBuf>,
        /// Writes both lights of each point as CSV.
        #[arg(long)]
        out: Option<PathBuf>,
    },
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &CompareArguments) -> anyhow::Result<()> {
    match &arguments.what {
        What::Pictures { measured, reference, exposure, flip } => {
            let read = |path: &PathBuf| -> anyhow::Result<_> {
                let is_linear = path.extension().is_some_and(|kind| kind == "exr" || kind == "hdr");
                Ok(if is_linear {
                    image_file::exposed(&image_file::read_linear(path)?, *exposure)
                } else {
                    image_file::read_srgb(path)?
                })
            };
            let (measured, reference) = (read(measured)?, read(reference)?);
            let errors = compare_pictures(&measured, &reference)?;
            if let Some(path) = flip {
                image_file::write_png(path, &flip_picture(&measured, &reference)?)?;
            }
            if arguments.json {
                out!("{}", serde_json::to_string(&errors)?);
            } else {
                out!("{}", described(&errors));
            }
        }
        What::Points { world, reference, lights, out } => {
            points(world, reference, lights.as_deref(), out.as_deref(), arguments.json)?;
        }
    }
    Ok(())
}

/// One line for people.
pub(crate) fn described(errors: &PictureErrors) -> String {
    let psnr = errors.psnr_db.map_or("the same".to_owned(), |psnr| format!("{psnr:.2} dB"));
    format!("RMSE {:.4}, PSNR {psnr}, SSIM {:.4}, FLIP {:.4}", errors.rmse, errors.ssim, errors.flip)
}

fn points(
    world: &std::path::Path,
    reference: &std::path::Path,
    lights: Option<&std::path::Path>,
    out: Option<&std::path::Path>,
    json: bool,
) -> anyhow::Result<()> {
    let reference = csv::read(reference)?;
    if let Some(path) = out {
        crate::writable::ensure_file(path)?;
    }
    let world = WholeWorld::load(world)?;
    let own = &world.manifest.lights;
    let rig = match lights {
        Some(path) => {
            let file = scene_source::load_lights(path)?;
            LightRig { lights: file.lights, sky: file.sky, emission_scale: file.emission_scale }
        }
        None => own.clone(),
    };
    let volumes = world.volumes(&world.solve(&rig))?;
    let measured: Vec<Option<Rgb>> =
        reference.iter().map(|point| volume_light::at(&volumes, point.position, point.normal)).collect();
    if let Some(path) = out {
        volume_light::write_csv(path, &reference, &measured)?;
    }
    let errors = compare_points(&reference, &measured)?;
    if json {
        out!("{}", serde_json::to_string(&errors)?);
        return Ok(());
    }
    out!("{} points compared, {} without light", errors.points, errors.uncovered);
    out!(
        "median {:.2} %, p90 {:.2} %, p99 {:.2} %",
        errors.median_rel * 100.0,
        errors.p90_rel * 100.0,
        errors.p99_rel * 100.0
    );
    out!("RMSE {:.2} % of the mean, bias {:+.2} %", errors.rel_rmse * 100.0, errors.bias * 100.0);
    out!(
        "{:.2} % beyond a factor of two; the reference's own noise {:.2} %",
        errors.beyond_factor_two * 100.0,
        errors.reference_noise_rel * 100.0
    );
    Ok(())
}
