//! `earthshine bake`: a glTF scene becomes a world folder.

use crate::defaults::Chosen;
use crate::machine;
use crate::output::out;
use crate::progress_bars::BakeBars;
use crate::quality::QualityArguments;
use crate::ray_device::Adapter;
use crate::scene_source;
use clap::Args;
use earthshine_bake::{BakeOptions, BakeSummary, Levels, MemoryLimit, RayDevice, Shard};
use earthshine_tiles::{Manifest, RowCodec};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Arguments of `earthshine bake`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine bake sponza.glb sponza.world --voxel 1
  earthshine bake cornell cornell.world --json     (a generated scene by name)
  earthshine bake cornell clusters.world --builder clustered --clusters 3
  earthshine bake cornell points.world --voxel 0.28 --samples hammersley --estimator points
  earthshine bake town town.world --row-error 0.02
  earthshine bake town town.world --levels 3       (level 0 and two coarser ones)
  earthshine bake town.glb town.world --memory 20GiB
  earthshine bake town.glb town.world --shard 2/8  (the third of eight processes)
  earthshine bake town.glb town.world --gpu        (rays traced on a graphics adapter)
  earthshine bake town.glb town.world --explain    (after an edit of town.glb: what was stale, and why)
An interrupted bake goes on where it stopped: run the same command again. After an edit the same command traces
only what can have changed; the world is the same, byte for byte, as if it were baked afresh.")]
pub(crate) struct BakeArguments {
    /// A .glb or .gltf file, or the name of a generated scene (cornell, furnace, two-rooms, study, corridor, town).
    scene: String,
    /// Folder to make.
    world: PathBuf,
    #[command(flatten)]
    quality: QualityArguments,
    /// Levels of the pyramid, level 0 included: each next has voxels twice as large. `auto` ends with the first of 512
    /// patches or fewer. Changing it alone traces nothing.
    #[arg(long, default_value = "auto")]
    levels: Levels,
    /// Lights JSON that goes into the world beside the scene's own.
    #[arg(long)]
    lights: Option<PathBuf>,
    /// Replace a world of another scene or other parameters.
    #[arg(long)]
    overwrite: bool,
    /// Store shares as f32: lossless, about twice the size.
    #[arg(long)]
    lossless: bool,
    /// Which of several processes this is, 0/4 to 3/4: each begins with its own share of the chunks, and goes on with
    /// what the others have not done. All write into the same folder; run it once without --shard in the end to clear up.
    #[arg(long, value_name = "I/N", default_value = "0/1", hide_default_value = true)]
    shard: Shard,
    /// Memory that the bake may take, as in 8GiB: more is refused before it is taken. Default: no limit.
    #[arg(long)]
    memory: Option<MemoryLimit>,
    /// Remove the work folder (WORLD/.bake) in the end. It takes several times the room of the world, and is what makes
    /// the bake of an edited scene quick.
    #[arg(long)]
    discard_work: bool,
    /// Trace rays on the best graphics adapter, which has to be there, and add up there where they end; should it fail, this
    /// is said and the CPU does the rest. Shares are the same but for rounding and rays that pass an edge within it,
    /// by which a patch in thousands may come or go. All processes of a --shard bake have to use the same adapter, or none.
    #[arg(long)]
    gpu: bool,
    /// Part of the name of the adapter that has to trace; `earthshine gpu` lists them. A software adapter is taken only if
    /// it is named.
    #[arg(long, value_name = "NAME", requires = "gpu", default_value = "", hide_default_value = true)]
    gpu_adapter: String,
    /// Say of every chunk that was traced why, and which tiles changed.
    #[arg(long)]
    explain: bool,
    /// Print the summary as JSON.
    #[arg(long)]
    json: bool,
    /// No progress bars.
    #[arg(long, short)]
    quiet: bool,
}

/// What a bake came to, and what it took of this process.
#[derive(Debug, serde::Serialize)]
pub(crate) struct MeasuredBake {
    #[serde(flatten)]
    summary: BakeSummary,
    /// By which parameters that hang on the size of the world.
    chosen: Chosen,
    /// Most memory held at once, bytes.
    peak_rss_bytes: Option<u64>,
}

impl MeasuredBake {
    /// `summary`, of a bake that has just ended.
    pub(crate) fn now(summary: BakeSummary, chosen: Chosen) -> Self {
        Self { summary, chosen, peak_rss_bytes: machine::peak_rss_bytes() }
    }
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &BakeArguments) -> anyhow::Result<()> {
    let quiet = arguments.quiet || arguments.json;
    let source =
        scene_source::load(&arguments.scene, arguments.lights.as_deref(), arguments.quality.metals_black())?;
    scene_source::warn_if_dark(&source);
    let memory = arguments.memory.unwrap_or_default();
    let chosen = quality(arguments, &source.name).chosen_within(&source, memory);
    if let (Some(told), false) = (chosen.told(), quiet) {
        eprintln!("{told}");
    }
    let options = BakeOptions {
        parameters: chosen.parameters,
        codec: if arguments.lossless { RowCodec::Full } else { RowCodec::Half },
        scene_name: source.name,
        lights: source.lights,
        overwrite: arguments.overwrite,
        levels: arguments.levels,
        shard: arguments.shard,
        memory,
        discard_work: arguments.discard_work,
    };
    let adapter = arguments.gpu.then(|| Adapter::open(&arguments.gpu_adapter)).transpose()?;
    let device = adapter.as_ref().map(|adapter| adapter as &dyn RayDevice);
    let bars = BakeBars::new(quiet);
    let summary = earthshine_bake::bake_on(device, &source.scene, &arguments.world, &options, &bars)?;
    bars.finish();
    if arguments.json {
        out!("{}", serde_json::to_string(&MeasuredBake::now(summary, chosen))?);
    } else {
        print_summary(&summary, &chosen, &arguments.world);
        if arguments.explain {
            print_stale(&summary);
        }
    }
    Ok(())
}

/// The quality asked for; where nothing was said, that of the world of the same scene that is there already, so that an
/// edit does not change it.
fn quality(arguments: &BakeArguments, scene: &str) -> QualityArguments {
    match Manifest::load(&arguments.world) {
        Ok(manifest) if manifest.scene == scene && !arguments.overwrite => {
            arguments.quality.as_before(&manifest.parameters)
        }
        // Whatever is wrong with it, the bake says.
        _ => arguments.quality.clone(),
    }
}

/// What was traced again and what changed, chunk by chunk.
fn print_stale(summary: &BakeSummary) {
    let stale = &summary.stale;
    let (traced, changed, kept) = (stale.traced_chunks, stale.changed_tiles, stale.kept_tiles);
    out!("{traced} of {} chunks traced, {changed} tiles changed, {kept} stayed", summary.chunks);
    for stage in &stale.stages {
        out!("chunk {:?}: {}: {}", stage.chunk, stage.stage, stage.why);
    }
    let traced: BTreeSet<[i32; 3]> = stale.stages.iter().map(|stage| stage.chunk).collect();
    for chunk in stale.changed_chunks.iter().filter(|chunk| !traced.contains(*chunk)) {
        out!("chunk {chunk:?}: tile: what it exchanges light with was traced again, or its colours changed");
    }
}

fn print_summary(summary: &BakeSummary, chosen: &Chosen, world: &std::path::Path) {
    if summary.up_to_date {
        out!("{} is up to date: nothing to do", world.display());
        return;
    }
    out!(
        "{}: {} triangles, {} patches in {} chunks, {} form factors",
        world.display(),
        summary.triangles,
        summary.patches,
        summary.chunks,
        summary.nonzeros
    );
    out!(
        "{:.1} MB ({:.2} bytes a form factor), {:.2} M rays/s a core ({:.2} over the whole bake), {:.1} s",
        summary.world_bytes as f64 / 1e6,
        summary.tile_bytes_per_nonzero,
        summary.mrays_s_core,
        summary.mrays_s_core_whole,
        summary.seconds
    );
    if summary.device_rays > 0 {
        let rays = summary.device_rays as f64;
        out!(
            "{rays} rays traced on the device ({:.1} % of all), {:.2} % of them to no use; {:.1} bytes sent and {:.1} read a ray",
            100.0 * summary.device_ray_share,
            100.0 * summary.device_returned_rays as f64 / rays,
            summary.device_sent_bytes as f64 / rays,
            summary.device_read_bytes as f64 / rays
        );
    }
    if summary.receivers > 0 {
        let (receivers, nonzeros) = (summary.receivers, summary.receiver_nonzeros);
        out!("{receivers} receivers of light in the air, {nonzeros} form factors");
    }
    for level in summary.levels.iter().skip(1) {
        out!(
            "level {}: voxels of {} m, {} patches in {} chunks, {:.1} MB",
            level.level,
            level.voxel_edge_m,
            level.patches,
            level.chunks,
            level.bytes as f64 / 1e6
        );
    }
    if let Some(told) = chosen.told() {
        out!("{told}");
    }
    if summary.buried_samples > 0 {
        out!("{} of {} points are buried and left out", summary.buried_samples, summary.samples);
    }
}
