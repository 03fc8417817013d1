//! `earthshine bench SUITE --json`: every figure, as one JSON object on standard output.
//!
//! A bench exits 0 when it measured, whatever the figure; it says what it compares with.

use crate::output::out;
mod accuracy;
mod alias;
mod bake;
mod builders;
mod estimators;
mod far;
mod flight;
mod gpu;
mod gpu_frame;
mod gpu_gather;
mod gpu_matrix;
mod gpu_news;
mod gpu_rays;
mod gpu_step;
mod keep;
mod lit_world;
mod matrix;
mod moving_sphere;
mod pictures;
mod reference;
mod refinement;
mod scratch;
mod temporal;
mod tiles;

use crate::machine::Machine;
use clap::{Args, Subcommand};
use serde::Serialize;

/// Arguments of `earthshine bench`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine bench accuracy --scene furnace --json
  earthshine bench accuracy --scene cornell --voxel 0.2 --json
  earthshine bench accuracy --scene sponza.glb --lights sponza.lights.json --reference sponza.mitsuba.csv
  earthshine bench accuracy --scene cornell --builder clustered --clusters 3 --samples hammersley --json
  earthshine bench builders --scene cornell --markdown
  earthshine bench estimators --scene town --targets 0.04,0.02 --markdown
  earthshine bench sphere --scene sponza.glb --lights sponza.lights.json --way '-8,1.5,0; 6,3,0.5'
  earthshine bench pictures cornell 'office.glb;voxel=0.25' --markdown
  earthshine bench refinement --scene office.glb --markdown
  earthshine bench matrix --swaps 10000 --json
  earthshine bench gpu --json
  earthshine bench gpu --adapter llvmpipe --m 256 --json
  earthshine bench alias --rows 4096 --items 1000 --plot alias-error
  earthshine bench temporal --scene cornell --solver hybrid,alias --plot step
  earthshine bench temporal --world sponza --n 1736,5485,8786,10422 --json
  earthshine bench bake --scene town --gpu --json
  earthshine bench far --scene sponza.glb --lights sponza.lights.json --voxel 1
  earthshine bench keep --world town.world --plot keep
  earthshine bench flight --world town.world --speed 50 --json")]
pub(crate) struct BenchArguments {
    #[command(subcommand)]
    suite: Suite,
    /// Print one JSON object instead of lines.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Subcommand)]
enum Suite {
    /// Light at points against a reference.
    Accuracy(accuracy::AccuracyArguments),
    /// Our path tracer against another renderer's light at points.
    Reference(reference::ReferenceArguments),
    /// Pictures of indirect light against the path tracer's: SSIM, PSNR, FLIP, bias.
    Pictures(pictures::PicturesArguments),
    /// The screen-space method by rays a pixel, in its own right and over served light.
    Refinement(refinement::RefinementArguments),
    /// Light on a sphere that moves through the air, against a path tracer.
    Sphere(moving_sphere::SphereArguments),
    /// Add and remove against a fresh solve; the time they take.
    Matrix(matrix::MatrixArguments),
    /// Tables that rows are drawn from: build speed, exactness, error by number of draws.
    Alias(alias::AliasArguments),
    /// Solvers that follow moving light: frames to follow a step, noise, cost of a frame.
    Temporal(temporal::TemporalArguments),
    /// Size and speed of a world's tiles.
    Tiles(tiles::TilesArguments),
    /// One scene by every way to make samples, patches and rows: error, patches, seconds, bytes.
    Builders(builders::BuildersArguments),
    /// Errors of rows by spread, by sums over points, and with a target.
    Estimators(estimators::EstimatorsArguments),
    /// Rays, bytes and seconds of a bake.
    Bake(bake::BakeBenchArguments),
    /// Far light by coarse levels against the whole world.
    Far(far::FarArguments),
    /// Rows that keep the top share of their mass: error against bytes.
    Keep(keep::KeepArguments),
    /// A flight through a served world against what the server promises.
    Flight(flight::FlightArguments),
    /// Kernels on a graphics adapter against a copy in its memory.
    Gpu(gpu::GpuBenchArguments),
}

/// What every suite prints beside its own figures.
#[derive(Serialize)]
struct Report<F: Serialize> {
    suite: &'static str,
    scene: String,
    backend: &'static str,
    solver: String,
    seed: u64,
    version: &'static str,
    machine: Machine,
    seconds: f64,
    #[serde(flatten)]
    figures: F,
}

impl<F: Serialize> Report<F> {
    fn new(suite: &'static str, scene: &str, solver: &str, seed: u64, seconds: f64, figures: F) -> Self {
        let (backend, version) = ("cpu", env!("CARGO_PKG_VERSION"));
        Self {
            suite,
            scene: scene.to_owned(),
            backend,
            solver: solver.to_owned(),
            seed,
            version,
            machine: Machine::here(),
            seconds,
            figures,
        }
    }

    /// The same, computed on `backend`.
    fn on(self, backend: &'static str) -> Self {
        Self { backend, ..self }
    }

    fn print(&self, json: bool) -> anyhow::Result<()> {
        // Through a map, so that a key stands once: figures may have seconds of their own.
        let serde_json::Value::Object(keys) = serde_json::to_value(self)? else { return Ok(()) };
        if json {
            out!("{}", serde_json::to_string(&keys)?);
            return Ok(());
        }
        for (key, value) in keys {
            out!("{key:>24}  {value}");
        }
        Ok(())
    }
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &BenchArguments) -> anyhow::Result<()> {
    match &arguments.suite {
        Suite::Accuracy(suite) => accuracy::run(suite, arguments.json),
        Suite::Reference(suite) => reference::run(suite, arguments.json),
        Suite::Pictures(suite) => pictures::run(suite, arguments.json),
        Suite::Refinement(suite) => refinement::run(suite, arguments.json),
        Suite::Sphere(suite) => moving_sphere::run(suite, arguments.json),
        Suite::Matrix(suite) => matrix::run(suite, arguments.json),
        Suite::Alias(suite) => alias::run(suite, arguments.json),
        Suite::Temporal(suite) => temporal::run(suite, arguments.json),
        Suite::Tiles(suite) => tiles::run(suite, arguments.json),
        Suite::Builders(suite) => builders::run(suite, arguments.json),
        Suite::Estimators(suite) => estimators::run(suite, arguments.json),
        Suite::Bake(suite) => bake::run(suite, arguments.json),
        Suite::Far(suite) => far::run(suite, arguments.json),
        Suite::Keep(suite) => keep::run(suite, arguments.json),
        Suite::Flight(suite) => flight::run(suite, arguments.json),
        Suite::Gpu(suite) => gpu::run(suite, arguments.json),
    }
}
