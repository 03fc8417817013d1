//! `earthshine bake`: a glTF scene becomes a world folder.

use crate::progress_bars::BakeBars;
use crate::scene_source;
use clap::{Args, ValueEnum};
use earthshine_bake::{BakeOptions, BakeSummary};
use earthshine_tiles::{BakeParameters, RowCodec};
use earthshine_world::{AxisWeights, Grid};
use std::path::PathBuf;

/// Arguments of `earthshine bake`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine bake sponza.glb sponza.world --voxel 1
  earthshine bake cornell sponza.world --json      (a generated scene by name)
An interrupted bake goes on where it stopped: run the same command again.")]
pub(crate) struct BakeArguments {
    /// A .glb or .gltf file, or the name of a generated scene (cornell, furnace, two-rooms, corridor, town).
    scene: String,
    /// Folder to make.
    world: PathBuf,
    #[command(flatten)]
    quality: QualityArguments,
    /// Lights JSON that goes into the world beside the scene's own.
    #[arg(long)]
    lights: Option<PathBuf>,
    /// Replace a world of another scene or other parameters.
    #[arg(long)]
    overwrite: bool,
    /// Store shares as f32: lossless, about twice the size.
    #[arg(long)]
    lossless: bool,
    /// Print the summary as JSON.
    #[arg(long)]
    json: bool,
    /// No progress bars.
    #[arg(long, short)]
    quiet: bool,
}

/// What the bytes of a bake depend on; shared with `bench`.
#[derive(Args, Clone)]
pub(crate) struct QualityArguments {
    /// Edge of a voxel, m. Smaller: more detail, about four times the patches a halving.
    #[arg(long, default_value_t = 1.0)]
    pub(crate) voxel: f32,
    /// Voxels along a chunk's edge, 1 to 22.
    #[arg(long, default_value_t = 16)]
    chunk_voxels: u32,
    /// Rays a patch. The error of a row falls with its square root; time grows in step.
    #[arg(long, default_value_t = 1024)]
    rays: u32,
    /// Sample points a patch keeps for direct light.
    #[arg(long, default_value_t = 16)]
    points_per_patch: u32,
    /// Points that cover a voxel face of surface.
    #[arg(long, default_value_t = 16)]
    samples_per_face: u32,
    /// How normals spread over directions; `absolute` is the sources' way and makes energy.
    #[arg(long, default_value = "squared")]
    weights: Weights,
    /// Whether back faces of single-sided materials reflect.
    #[arg(long, default_value = "two")]
    sides: Sides,
    /// Rays that find buried points; 0 keeps them all.
    #[arg(long, default_value_t = 32)]
    buried_rays: u32,
    /// Every random number hangs on it.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Whether metals reflect their base colour diffusely or nothing.
    #[arg(long, default_value = "diffuse")]
    metals: Metals,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Weights {
    Squared,
    Absolute,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Sides {
    One,
    Two,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Metals {
    Diffuse,
    Black,
}

impl QualityArguments {
    pub(crate) fn parameters(&self) -> BakeParameters {
        BakeParameters {
            seed: self.seed,
            grid: Grid { voxel_edge_m: self.voxel, chunk_edge_voxels: self.chunk_voxels },
            rays_per_patch: self.rays,
            points_per_patch: self.points_per_patch,
            samples_per_voxel_face: self.samples_per_face,
            buried_rays: self.buried_rays,
            weights: match self.weights {
                Weights::Squared => AxisWeights::Squared,
                Weights::Absolute => AxisWeights::Absolute,
            },
            two_sided: self.sides == Sides::Two,
            metals_black: self.metals_black(),
        }
    }

    pub(crate) fn metals_black(&self) -> bool {
        self.metals == Metals::Black
    }
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &BakeArguments) -> anyhow::Result<()> {
    let parameters = arguments.quality.parameters();
    let quiet = arguments.quiet || arguments.json;
    let source = scene_source::load(&arguments.scene, arguments.lights.as_deref(), parameters.metals_black)?;
    for warning in &source.scene.report.warnings {
        eprintln!("warning: {warning}");
    }
    let options = BakeOptions {
        parameters,
        codec: if arguments.lossless { RowCodec::Full } else { RowCodec::Half },
        scene_name: source.name,
        lights: source.lights,
        overwrite: arguments.overwrite,
    };
    let bars = BakeBars::new(quiet);
    let summary = earthshine_bake::bake(&source.scene, &arguments.world, &options, &bars)?;
    bars.finish();
    if arguments.json {
        println!("{}", serde_json::to_string(&summary)?);
    } else {
        print_summary(&summary, &arguments.world);
    }
    Ok(())
}

fn print_summary(summary: &BakeSummary, world: &std::path::Path) {
    if summary.up_to_date {
        println!("{} is up to date: nothing to do", world.display());
        return;
    }
    println!(
        "{}: {} triangles, {} patches in {} chunks, {} form factors",
        world.display(),
        summary.triangles,
        summary.patches,
        summary.chunks,
        summary.nonzeros
    );
    println!(
        "{:.1} MB ({:.2} bytes a form factor), {:.2} M rays/s a core, {:.1} s",
        summary.world_bytes as f64 / 1e6,
        summary.bytes_per_nonzero,
        summary.mrays_s_core,
        summary.seconds
    );
    if summary.buried_samples > 0 {
        println!("{} of {} points are buried and left out", summary.buried_samples, summary.samples);
    }
}
