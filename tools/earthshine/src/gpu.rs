//! `earthshine gpu`: the graphics adapters there are, what each can do, and how many patches fit.

use crate::output::out;
use clap::Args;
use earthshine_gpu::adapter::{AdapterReport, list};
use earthshine_gpu::receivers::COLUMN_BYTES_MAX;
use earthshine_gpu::{AdapterChoice, CachedPipelines, Given, GpuDevice, memory};
use serde::Serialize;
use std::time::Instant;

/// Arguments of `earthshine gpu`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine gpu
  earthshine gpu --json
  earthshine serve world --backend gpu --gpu-adapter nvidia")]
pub(crate) struct GpuArguments {
    /// Print one JSON object instead of lines.
    #[arg(long)]
    json: bool,
}

/// Matrix sizes whose memory is listed.
const SLOTS: [u32; 5] = [1024, 2048, 4096, 8192, 16_384];

#[derive(Serialize)]
struct Listing {
    adapters: Vec<Adapter>,
    /// What light of so many patches takes on any device.
    memory: Vec<Memory>,
    /// Most that rows of receivers and of far light take on a device, whoever gathers.
    receiver_bytes_max: u64,
    /// Of the trees that direct light is traced through: room for twice what is resident.
    tree_triangle_bytes: u64,
    tree_node_bytes: u64,
}

#[derive(Serialize)]
struct Adapter {
    name: String,
    driver: String,
    api: String,
    kind: &'static str,
    binding_bytes_max: u64,
    buffer_bytes_max: u64,
    workgroup_bytes_max: u32,
    subgroup_size_min: u32,
    subgroup_size_max: u32,
    has_subgroups: bool,
    has_f16: bool,
    has_timestamps: bool,
    slots_unsplit_max: u32,
    slots_max: u32,
    /// Opening it and compiling every kernel; none where that fails.
    open_ms: Option<f64>,
    /// Opening it twice more: whether to set `gpu_pipeline_cache`.
    reopened: Option<Reopened>,
    unusable: Option<String>,
}

impl From<AdapterReport> for Adapter {
    fn from(report: AdapterReport) -> Self {
        let opened = report.unusable.is_none().then(|| opened(&report.name)).flatten();
        Self {
            name: report.name,
            driver: report.driver,
            api: report.api,
            kind: report.kind,
            binding_bytes_max: report.binding_bytes_max,
            buffer_bytes_max: report.buffer_bytes_max,
            workgroup_bytes_max: report.workgroup_bytes_max,
            subgroup_size_min: report.subgroup_sizes.0,
            subgroup_size_max: report.subgroup_sizes.1,
            has_subgroups: report.has_subgroups,
            has_f16: report.has_f16,
            has_timestamps: report.has_timestamps,
            slots_unsplit_max: report.slots_unsplit_max,
            slots_max: report.slots_max,
            open_ms: opened.as_ref().map(|opened| opened.0),
            reopened: opened.and_then(|opened| opened.1),
            unusable: report.unusable,
        }
    }
}

/// The same adapter again, by when the driver has whatever it keeps itself.
#[derive(Serialize)]
struct Reopened {
    without_pipelines_ms: f64,
    with_pipelines_ms: f64,
    /// Size of the compiled kernels that it was given.
    pipeline_bytes: usize,
    /// Whether it took them.
    are_pipelines_taken: bool,
}

/// How long it takes to open the adapter of that name, ms; then without and with its compiled kernels, if it hands them out.
fn opened(name: &str) -> Option<(f64, Option<Reopened>)> {
    let choice = AdapterChoice { name: name.to_owned(), allow_software: true, ..AdapterChoice::default() };
    let timed = |stored: Option<&[u8]>| {
        let start = Instant::now();
        let pipelines = match stored {
            Some(stored) => Some(GpuDevice::open_cached(&choice, stored).ok()?.1),
            None => GpuDevice::open(&choice).ok().map(|_| None)?,
        };
        Some((start.elapsed().as_secs_f64() * 1e3, pipelines))
    };
    let (open_ms, first) = timed(Some(&[]))?;
    let reopened = || {
        let stored = first?.changed?;
        let (without_pipelines_ms, _) = timed(None)?;
        let (with_pipelines_ms, found) = timed(Some(&stored))?;
        let are_pipelines_taken = matches!(found, Some(CachedPipelines { given: Given::Taken, .. }));
        let pipeline_bytes = stored.len();
        Some(Reopened { without_pipelines_ms, with_pipelines_ms, pipeline_bytes, are_pipelines_taken })
    };
    Some((open_ms, reopened()))
}

#[derive(Serialize)]
struct Memory {
    slots: u32,
    plane_bytes: u64,
    /// A matrix.
    device_bytes: u64,
    /// Light over rows instead, [`LINKS`] links each.
    row_bytes: u64,
}

/// Links of a row, about as many as baked worlds have.
const LINKS: u64 = 300;

/// Runs the subcommand. No adapter is no error: the list is empty.
pub(crate) fn run(arguments: &GpuArguments) -> anyhow::Result<()> {
    let memory = SLOTS.map(|slots| Memory {
        slots,
        plane_bytes: memory::plane_bytes(slots),
        device_bytes: memory::device_bytes(slots),
        row_bytes: memory::row_bytes(slots, LINKS * u64::from(slots)),
    });
    let listing = Listing {
        adapters: list().into_iter().map(Adapter::from).collect(),
        memory: memory.into(),
        receiver_bytes_max: COLUMN_BYTES_MAX,
        tree_triangle_bytes: memory::TREE_TRIANGLE_BYTES,
        tree_node_bytes: memory::TREE_NODE_BYTES,
    };
    if arguments.json {
        out!("{}", serde_json::to_string(&listing)?);
        return Ok(());
    }
    if listing.adapters.is_empty() {
        out!("no graphics adapter: `serve` computes on the CPU");
    }
    for adapter in &listing.adapters {
        print_adapter(adapter);
    }
    print_memory(&listing);
    Ok(())
}

fn print_memory(listing: &Listing) {
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    out!("{:>8}  {:>14}  {:>14}  {:>14}", "patches", "MiB a plane", "MiB a matrix", "MiB over rows");
    for of in &listing.memory {
        let (plane, matrix, rows) = (mib(of.plane_bytes), mib(of.device_bytes), mib(of.row_bytes));
        out!("{:>8}  {plane:>14.1}  {matrix:>14.1}  {rows:>14.1}", of.slots);
    }
    out!(
        "rows are of {LINKS} links; what links take may be four times as much, as lists double when they grow"
    );
    out!("receivers and far light: at most {:.0} MiB in all", mib(listing.receiver_bytes_max));
    let (triangle, node) = (listing.tree_triangle_bytes, listing.tree_node_bytes);
    out!(
        "direct light: {triangle} bytes a triangle and {node} a node of the trees resident, room for twice that"
    );
}

fn print_adapter(adapter: &Adapter) {
    let yes = |has: bool| if has { "yes" } else { "no" };
    out!("{}", adapter.name);
    out!("{:>24}  {} ({}, {})", "driver", adapter.driver, adapter.api, adapter.kind);
    out!("{:>24}  {} MiB", "largest binding", adapter.binding_bytes_max >> 20);
    out!("{:>24}  {} KiB", "workgroup memory", adapter.workgroup_bytes_max >> 10);
    let (least, most) = (adapter.subgroup_size_min, adapter.subgroup_size_max);
    out!("{:>24}  {} ({least} to {most} threads)", "subgroups", yes(adapter.has_subgroups));
    out!("{:>24}  {}", "16-bit floats", yes(adapter.has_f16));
    out!("{:>24}  {}", "timestamps", yes(adapter.has_timestamps));
    let split = adapter.slots_unsplit_max;
    out!("{:>24}  {} (planes split above {split})", "resident patches, most", adapter.slots_max);
    if let Some(ms) = adapter.open_ms {
        out!("{:>24}  {ms:.0} ms", "opened, kernels ready");
        out!("{:>24}  {}", "opened again", reopened_text(adapter.reopened.as_ref()));
    }
    if let Some(cause) = &adapter.unusable {
        out!("{:>24}  {cause}", "cannot be used");
    }
}

fn reopened_text(reopened: Option<&Reopened>) -> String {
    let Some(of) = reopened else {
        return "the driver hands out no compiled kernels: gpu_pipeline_cache has no effect".to_owned();
    };
    let taken = if of.are_pipelines_taken { "given" } else { "refused" };
    format!(
        "{:.0} ms; {:.0} ms with its compiled kernels ({:.1} KiB, {taken})",
        of.without_pipelines_ms,
        of.with_pipelines_ms,
        of.pipeline_bytes as f64 / 1024.0,
    )
}
