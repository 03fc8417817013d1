//! How long each pass took on the device, where it can tell.

use crate::device::GpuDevice;
use crate::readback::{Arrival, Staging, read_now};
use crate::work::Work;
use earthshine_radiosity::BackendError;
use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePassDescriptor, ComputePassTimestampWrites, QuerySet,
    QuerySetDescriptor, QueryType,
};

/// One pass, as the device timed it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassTime {
    /// Of the kernel.
    pub name: &'static str,
    /// ms.
    pub ms: f64,
    /// What it did, where that is known.
    pub work: Option<Work>,
}

/// What a kernel has taken in all timed passes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PassTotal {
    /// Passes.
    pub count: u64,
    /// Their time, s.
    pub seconds: f64,
    /// What they moved; of kernels whose [`Work`] is unknown nothing.
    pub bytes: f64,
    /// What they computed; of kernels whose [`Work`] is unknown nothing.
    pub flops: f64,
}

/// A frame in so many is timed while a device works: timestamps are not free.
const FRAMES_A_SAMPLE: u32 = 64;

/// Times the passes of a frame now and then, for whoever watches the device.
#[derive(Debug, Default)]
pub(crate) struct Sampling {
    frames: u32,
    is_on: bool,
    /// Times on their way to the host.
    coming: Option<Coming>,
}

impl Sampling {
    /// A frame begins; `timing` is set if it is to be timed and nobody times anyway.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn begin(
        &mut self,
        device: &GpuDevice,
        timing: &mut Option<Timing>,
    ) -> Result<(), BackendError> {
        self.frames = self.frames.wrapping_add(1);
        if let Some(coming) = self.coming.take_if(|coming| coming.staging.arrival() != Arrival::Coming) {
            device.note_passes(&coming.take(device)?);
        }
        if timing.is_none() && self.frames % FRAMES_A_SAMPLE == 1 {
            *timing = Timing::new(device)?;
            self.is_on = timing.is_some();
        }
        Ok(())
    }

    /// The frame is on the device: its times are sent for, and added to the device's in a later one. Nobody waits for them.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn end(
        &mut self,
        device: &GpuDevice,
        timing: &mut Option<Timing>,
    ) -> Result<(), BackendError> {
        if std::mem::take(&mut self.is_on)
            && let Some(timing) = timing.take()
        {
            self.coming = timing.send(device)?;
        }
        Ok(())
    }
}

/// Most passes that are timed between two readings.
const PASSES_MAX: u32 = 1024;

/// Timestamps of passes, two each.
#[derive(Debug)]
pub(crate) struct Timing {
    queries: QuerySet,
    resolved: Buffer,
    passes: Vec<(&'static str, Option<Work>)>,
    period_ns: f64,
}

impl Timing {
    /// None where the device cannot tell.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn new(device: &GpuDevice) -> Result<Option<Self>, BackendError> {
        if !device.has_timestamps() {
            return Ok(None);
        }
        let queries = device.wgpu().create_query_set(&QuerySetDescriptor {
            label: Some("pass times"),
            ty: QueryType::Timestamp,
            count: 2 * PASSES_MAX,
        });
        let usage = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
        let resolved = device.buffer("pass times", 16 * u64::from(PASSES_MAX), usage)?;
        let period_ns = f64::from(device.queue().get_timestamp_period());
        Ok(Some(Self { queries, resolved, passes: Vec::new(), period_ns }))
    }

    /// Where the next pass writes its times; nowhere once there is no more room.
    pub(crate) fn next(
        &mut self,
        name: &'static str,
        work: Option<Work>,
    ) -> Option<ComputePassTimestampWrites<'_>> {
        let at = 2 * self.passes.len() as u32;
        if at >= 2 * PASSES_MAX {
            return None;
        }
        self.passes.push((name, work));
        Some(ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(at),
            end_of_pass_write_index: Some(at + 1),
        })
    }

    /// Records by `record` what is no pass, and times it as one called `name`: between two passes that do nothing, one that
    /// ends before it and one that begins after it.
    pub(crate) fn around(
        &mut self,
        encoder: &mut CommandEncoder,
        name: &'static str,
        work: Work,
        record: impl FnOnce(&mut CommandEncoder),
    ) {
        let Some(ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: first,
            end_of_pass_write_index: last,
        }) = self.next(name, Some(work))
        else {
            return record(encoder);
        };
        let mark = |encoder: &mut CommandEncoder, begin, end| {
            let timestamp_writes = Some(ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: begin,
                end_of_pass_write_index: end,
            });
            drop(encoder.begin_compute_pass(&ComputePassDescriptor { label: Some(name), timestamp_writes }));
        };
        mark(encoder, None, first);
        record(encoder);
        mark(encoder, last, None);
    }

    /// The passes since the last call. Waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn take(&mut self, device: &GpuDevice) -> Result<Vec<PassTime>, BackendError> {
        let bytes = self.bytes();
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let read = read_now(device, "pass times", &self.resolved, bytes, |encoder| self.resolve(encoder))?;
        Ok(self.passes_of(&read))
    }

    /// Sends for the times of all passes; nothing if there are none.
    fn send(self, device: &GpuDevice) -> Result<Option<Coming>, BackendError> {
        let bytes = self.bytes();
        if bytes == 0 {
            return Ok(None);
        }
        let mut staging = Staging::new(device, bytes)?;
        let mut encoder = device.wgpu().create_command_encoder(&Default::default());
        self.resolve(&mut encoder);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, staging.buffer(), 0, bytes);
        device.queue().submit([encoder.finish()]);
        staging.map(device, "pass times", bytes);
        Ok(Some(Coming { timing: self, staging }))
    }

    fn bytes(&self) -> u64 {
        16 * self.passes.len() as u64
    }

    fn resolve(&self, encoder: &mut CommandEncoder) {
        let count = 2 * self.passes.len() as u32;
        encoder.resolve_query_set(&self.queries, 0..count, &self.resolved, 0);
    }

    /// All passes, of which the device has said `times`.
    fn passes_of(&mut self, times: &[u8]) -> Vec<PassTime> {
        let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(times);
        let times = self.passes.drain(..).zip(ticks.chunks_exact(2));
        times
            .map(|((name, work), ticks)| PassTime {
                name,
                work,
                ms: ticks[1].saturating_sub(ticks[0]) as f64 * self.period_ns / 1e6,
            })
            .collect()
    }
}

/// Times on their way to the host.
#[derive(Debug)]
struct Coming {
    timing: Timing,
    staging: Staging,
}

impl Coming {
    /// They have arrived.
    fn take(mut self, device: &GpuDevice) -> Result<Vec<PassTime>, BackendError> {
        let (bytes, mut read) = (self.timing.bytes(), Vec::new());
        self.staging.take(device, bytes, |view| read.extend_from_slice(view))?;
        Ok(self.timing.passes_of(&read))
    }
}
