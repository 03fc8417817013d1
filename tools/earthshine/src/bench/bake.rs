//! `bench bake`: rays, bytes and seconds of a bake into a scratch folder; with `--gpu` of one on a device, after one on the CPU
//! to hold it against.

use super::{Report, scratch};
use crate::bake::MeasuredBake;
use crate::generate::ShapeArguments;
use crate::quality::QualityArguments;
use crate::ray_device::Adapter;
use crate::scene_source;
use anyhow::Context as _;
use clap::Args;
use earthshine_bake::{BakeSummary, Levels, RayDevice};
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::Instant;

/// Arguments of `bench bake`.
#[derive(Args)]
pub(crate) struct BakeBenchArguments {
    /// A generated world or a .glb file.
    #[arg(long)]
    scene: String,
    #[command(flatten)]
    quality: QualityArguments,
    #[command(flatten)]
    shape: ShapeFlags,
    /// Bakes once more with rays traced on a graphics adapter: the figures are of that bake, beside the CPU's.
    #[arg(long)]
    gpu: bool,
    /// Part of the adapter's name; a software adapter has to be named.
    #[arg(long, value_name = "NAME", requires = "gpu", default_value = "", hide_default_value = true)]
    gpu_adapter: String,
}

/// What a bake comes to, and beside which.
#[derive(Serialize)]
struct Figures {
    #[serde(flatten)]
    bake: MeasuredBake,
    /// Rays of all stages, in millions, over all seconds of the bake.
    mrays_s: f64,
    #[serde(flatten)]
    beside: Option<Beside>,
}

/// The same bake on the CPU alone, and how the device's is another.
#[derive(Serialize)]
struct Beside {
    adapter: String,
    cpu_mrays_s: f64,
    cpu_seconds: f64,
    cpu_seconds_by_stage: BTreeMap<&'static str, f64>,
    /// By how many more or fewer form factors the device finds, as a share.
    nonzeros_off_rel: f64,
}

/// The shape of a generated world, without a seed of its own: the bake's serves both.
#[derive(Args)]
struct ShapeFlags {
    /// Town: triangles wanted, instances counted.
    #[arg(long, value_parser = crate::generate::count)]
    triangles: Option<u64>,
    /// Town: edge of the square it covers, m.
    #[arg(long)]
    size: Option<f32>,
}

/// Runs the suite.
pub(crate) fn run(arguments: &BakeBenchArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let shape = ShapeArguments::of(arguments.shape.triangles, arguments.shape.size).options();
    let source =
        scene_source::load_generated(&arguments.scene, None, arguments.quality.metals_black(), &shape)?;
    let adapter = arguments.gpu.then(|| Adapter::open(&arguments.gpu_adapter)).transpose()?;
    let chosen = arguments.quality.chosen(&source);
    let baked = |device: Option<&dyn RayDevice>| -> anyhow::Result<BakeSummary> {
        let folder = tempfile::tempdir().context("a scratch folder for the world")?;
        Ok(scratch::bake_on(device, &source, chosen.parameters, Levels::Auto, folder.path(), json)?)
    };
    let mut summary = baked(None)?;
    let mut beside = None;
    if let Some(adapter) = &adapter {
        let cpu = std::mem::replace(&mut summary, baked(Some(adapter))?);
        beside = Some(Beside {
            adapter: adapter.name().to_owned(),
            cpu_mrays_s: mrays_s(&cpu),
            cpu_seconds: cpu.seconds,
            nonzeros_off_rel: summary.nonzeros.abs_diff(cpu.nonzeros) as f64 / cpu.nonzeros.max(1) as f64,
            cpu_seconds_by_stage: cpu.seconds_by_stage,
        });
    }
    let figures = Figures { mrays_s: mrays_s(&summary), bake: MeasuredBake::now(summary, chosen), beside };
    let seconds = started.elapsed().as_secs_f64();
    Report::new("bake", &source.name, "none", arguments.quality.seed, seconds, figures)
        .on(if adapter.is_some() { "gpu" } else { "cpu" })
        .print(json)
}

fn mrays_s(of: &BakeSummary) -> f64 {
    of.mrays_s_core_whole * rayon::current_num_threads() as f64
}
