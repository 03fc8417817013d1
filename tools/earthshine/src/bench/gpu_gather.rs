//! `bench gpu`: light of receivers, and far light, gathered on the device: one kernel for both.
//!
//! Rows of equal length over the slots of a matrix; a quarter of the columns lead to coarse parents.

use super::gpu_news::NewsArguments;
use clap::Args;
use earthshine_gpu::receivers::GpuReceivers;
use earthshine_gpu::{GpuDevice, PassTime};
use earthshine_radiosity::receivers::{
    ColumnSpan, ReceiverGather, ReceiverLight as _, ReceiverRow, ReceiverSums, RowsOf, gather_receivers,
};
use earthshine_world::random::{Purpose, hash, unit_f32};
use earthshine_world::{
    Asked, Chunk, ChunkCoord, ChunkId, ChunkRows, Column, OccluderMesh, Receivers, Rgb, Sky, Vec4,
};
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What is gathered in a frame.
#[derive(Args)]
pub(super) struct GatherArguments {
    /// Receivers, or patches with far light, whose rows are gathered in a frame.
    #[arg(long, default_value_t = 8192, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    receivers: u32,
    /// Columns of each of those rows.
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=4096))]
    receiver_columns: u32,
}

/// Slots and coarse parents that rows lead to.
const PATCHES: u32 = 16_384;
/// Patches that come together.
const BLOCK: u32 = 32;

/// Rows on a device, and what is asked of them.
pub(super) struct GatherWork {
    device: GpuDevice,
    gpu: GpuReceivers,
    chunk: Arc<Chunk>,
    columns: Vec<u32>,
    sources: Vec<Vec4>,
    rows: Vec<ReceiverRow>,
    has_timestamps: bool,
}

/// A gather alone.
#[derive(Serialize)]
pub(super) struct GatherFigures {
    /// On the device, upload of what leaves patches, wait and readback included, ms.
    gather_ms: f64,
    /// The same on one core of the CPU, in `f64`, ms.
    cpu_gather_ms: f64,
    /// The largest difference from that, as a share of the brightest.
    gather_error_rel: f64,
    /// How many frames later than its own a gather's sums come, where nobody waits for them.
    gather_late_frames: f64,
    /// Bytes of all sums of a gather.
    gather_whole_bytes: usize,
    /// Bytes that come back of a gather of other light of all patches.
    gather_changed_bytes: u64,
    /// Bytes that come back where a block of 32 patches took slots since.
    gather_swapped_bytes: u64,
    /// Bytes that come back where nothing has changed.
    gather_settled_bytes: u64,
}

impl GatherWork {
    pub(super) fn new(device: &GpuDevice, arguments: &GatherArguments, seed: u64) -> anyhow::Result<Self> {
        let mut gpu = GpuReceivers::new(device)?;
        let has_timestamps = gpu.time_passes()?;
        // Channels differ, so that light whose channels change places is other light.
        let source = |at: u32| {
            let channel = |of| 1.0 + unit_f32(hash(seed, Purpose::Simulation, u64::from(at), of));
            Vec4::new(channel(4), channel(5), channel(6), 1.0)
        };
        Ok(Self {
            device: device.clone(),
            gpu,
            chunk: Arc::new(chunk(arguments, seed)),
            columns: (0..PATCHES).collect(),
            sources: (0..PATCHES).map(source).collect(),
            rows: (0..arguments.receivers).map(|row| ReceiverRow { chunk: 0, row }).collect(),
            has_timestamps,
        })
    }

    fn asked<R>(&self, ask: impl FnOnce(&ReceiverGather<'_>) -> R) -> R {
        ask(&question(&[&self.chunk], &self.columns, &self.sources, &self.rows))
    }

    /// Hands a gather over, of other light than the last.
    pub(super) fn begin(&mut self) -> anyhow::Result<()> {
        self.sources.iter_mut().for_each(|source| *source = Vec4::new(source.y, source.z, source.x, 1.0));
        self.begin_again()
    }

    /// Hands a gather over, of the light that there is.
    fn begin_again(&mut self) -> anyhow::Result<()> {
        let Self { gpu, chunk, columns, sources, rows, .. } = self;
        Ok(gpu.gather(&question(&[chunk], columns, sources, rows))?)
    }

    /// The sums of the last gather, waited for.
    pub(super) fn wait(&mut self) -> anyhow::Result<Vec<ReceiverSums>> {
        Ok(self.gpu.wait()?)
    }

    /// Bytes that come back of a gather that `begin` hands over.
    fn bytes_of(&mut self, begin: impl FnOnce(&mut Self) -> anyhow::Result<()>) -> anyhow::Result<u64> {
        let bytes = |device: &GpuDevice| device.read_back_bytes().get("receivers").copied().unwrap_or(0);
        let before = bytes(&self.device);
        begin(self)?;
        self.wait()?;
        Ok(bytes(&self.device) - before)
    }

    /// How many frames later than its own a gather's sums come, on average, at `period` a frame, one under way at a time.
    fn late_frames(&mut self, frames: u32, period: Duration) -> anyhow::Result<f64> {
        let (mut asked, mut late, mut gathers) = (None, 0, 0u32);
        for frame in 0..frames {
            let start = Instant::now();
            if let Some(of) = asked.take_if(|_| self.gpu.take() != Asked::UnderWay) {
                late += frame - of;
            }
            if asked.is_none() {
                self.begin()?;
                (asked, gathers) = (Some(frame), gathers + 1);
            }
            std::thread::sleep(period.saturating_sub(start.elapsed()));
        }
        late += asked.map_or(0, |of| frames - of);
        self.wait()?;
        Ok(f64::from(late) / f64::from(gathers.max(1)))
    }

    /// The passes since the last call.
    pub(super) fn take_times(&mut self) -> anyhow::Result<Vec<PassTime>> {
        Ok(if self.has_timestamps { self.gpu.take_times()? } else { Vec::new() })
    }

    /// The same gather by both.
    pub(super) fn measure(&mut self, rounds: u32, rate: &NewsArguments) -> anyhow::Result<GatherFigures> {
        let (mut gather_ms, mut found) = (f64::INFINITY, Vec::new());
        for _ in 0..rounds {
            let start = Instant::now();
            self.begin()?;
            found = self.wait()?;
            gather_ms = gather_ms.min(start.elapsed().as_secs_f64() * 1e3);
        }
        let start = Instant::now();
        let expected = self.asked(gather_receivers);
        let cpu_gather_ms = start.elapsed().as_secs_f64() * 1e3;
        let all = |of: &ReceiverSums| of.irradiance + of.far_irradiance;
        let brightest = expected.iter().map(|of| all(of).max_element()).fold(0.0, f32::max);
        let gaps = found.iter().zip(&expected).map(|(a, b)| (all(a) - all(b)).abs().max_element());
        let gather_error_rel = f64::from(gaps.fold(0.0, f32::max) / brightest);
        let gather_late_frames = self.late_frames(rate.news_frames, rate.period())?;
        let gather_changed_bytes = self.bytes_of(Self::begin)?;
        // As much is copied at once as the gather before had to tell.
        self.bytes_of(Self::begin_again)?;
        let gather_settled_bytes = self.bytes_of(Self::begin_again)?;
        let gather_swapped_bytes = self.bytes_of(|own| {
            let spread = (PATCHES / BLOCK) as usize;
            own.columns.iter_mut().step_by(spread).for_each(|column| *column = (*column + 1) % PATCHES);
            own.begin_again()
        })?;
        let gather_whole_bytes = size_of::<ReceiverSums>() * found.len();
        Ok(GatherFigures {
            gather_ms,
            cpu_gather_ms,
            gather_error_rel,
            gather_late_frames,
            gather_whole_bytes,
            gather_changed_bytes,
            gather_swapped_bytes,
            gather_settled_bytes,
        })
    }
}

fn question<'a>(
    chunks: &'a [&'a Arc<Chunk>],
    columns: &'a [u32],
    sources: &'a [Vec4],
    rows: &'a [ReceiverRow],
) -> ReceiverGather<'a> {
    const SKY: &Sky = &Sky { lobes: [Rgb::ONE; 6] };
    const SPAN: &[ColumnSpan] = &[ColumnSpan { first: 0, count: PATCHES }];
    ReceiverGather {
        rows_of: RowsOf::Receivers,
        chunks,
        first_spans: &[0],
        spans: SPAN,
        columns,
        sources,
        slot_count: PATCHES / 4 * 3,
        sky: SKY,
        rows,
    }
}

/// Rows over random patches, ascending; half of each is the sky's.
fn chunk(arguments: &GatherArguments, seed: u64) -> Chunk {
    let (count, length) = (arguments.receivers as usize, arguments.receiver_columns);
    let id = ChunkId::new(0, ChunkCoord::ZERO);
    let mut rows = ChunkRows { segments: vec![id], row_starts: vec![0], ..ChunkRows::default() };
    for row in 0..count {
        let first = hash(seed, Purpose::Simulation, row as u64, 3);
        let step = PATCHES / length;
        let local = |item: u32| (item * step + (first >> (item % 48)) as u32 % step) as u16;
        rows.columns.extend((0..length).map(|item| Column { segment: 0, local: local(item) }));
        // A half float as tiles keep it, or less: rows of others take more room on a device.
        let share = f32::from_bits((0.5 / length as f32).to_bits() & !0x1fff);
        rows.shares.extend((0..length).map(|_| share));
        rows.row_starts.push(rows.columns.len() as u32);
        rows.sky_shares.push([0.5 / 6.0; 6]);
        rows.absorbed_shares.push(0.0);
    }
    Chunk {
        id,
        patches: Vec::new(),
        points: Vec::new(),
        rows: ChunkRows::default(),
        receivers: Receivers { places: Vec::new(), rows },
        occluders: OccluderMesh::default(),
    }
}
