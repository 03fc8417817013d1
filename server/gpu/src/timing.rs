//! How long each pass took on the device, where it can tell.

use crate::device::GpuDevice;
use crate::readback::read_now;
use earthshine_radiosity::BackendError;
use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePassTimestampWrites, QuerySet, QuerySetDescriptor, QueryType,
};

/// One pass, as the device timed it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassTime {
    /// Of the kernel.
    pub name: &'static str,
    /// ms.
    pub ms: f64,
}

/// Most passes that are timed between two readings.
const PASSES_MAX: u32 = 1024;

/// Timestamps of passes, two each.
#[derive(Debug)]
pub(crate) struct Timing {
    queries: QuerySet,
    resolved: Buffer,
    names: Vec<&'static str>,
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
        Ok(Some(Self { queries, resolved, names: Vec::new(), period_ns }))
    }

    /// Where the next pass writes its times; nowhere once there is no more room.
    pub(crate) fn next(&mut self, name: &'static str) -> Option<ComputePassTimestampWrites<'_>> {
        let at = 2 * self.names.len() as u32;
        if at >= 2 * PASSES_MAX {
            return None;
        }
        self.names.push(name);
        Some(ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(at),
            end_of_pass_write_index: Some(at + 1),
        })
    }

    /// The passes since the last call. Waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn take(&mut self, device: &GpuDevice) -> Result<Vec<PassTime>, BackendError> {
        if self.names.is_empty() {
            return Ok(Vec::new());
        }
        let count = 2 * self.names.len() as u32;
        let resolve = |encoder: &mut CommandEncoder| {
            encoder.resolve_query_set(&self.queries, 0..count, &self.resolved, 0);
        };
        let bytes = read_now(device, &self.resolved, 8 * u64::from(count), resolve)?;
        let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&bytes);
        let times = self.names.drain(..).zip(ticks.chunks_exact(2));
        Ok(times
            .map(|(name, ticks)| PassTime {
                name,
                ms: ticks[1].saturating_sub(ticks[0]) as f64 * self.period_ns / 1e6,
            })
            .collect())
    }
}
