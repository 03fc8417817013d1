//! From the device to the host: at once where a caller waits for it, or started now and fetched when asked for. Every byte
//! that comes back comes through [`Staging::map`], where it is counted by what it is of.

use crate::device::GpuDevice;
use earthshine_radiosity::BackendError;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};
use wgpu::{Buffer, BufferUsages, CommandEncoder, MapMode, SubmissionIndex};

/// After this long nobody is about to tell how a map went whose submission is done: the device is of no more use.
const HEARD_WITHIN: Duration = Duration::from_secs(10);

/// Whether a copy can be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Arrival {
    Coming,
    Here,
    /// The device is of no more use.
    Failed,
}

/// A buffer that the host can read, and whether it may yet.
#[derive(Debug)]
pub(crate) struct Staging {
    buffer: Buffer,
    arrival: Arc<AtomicU8>,
}

impl Staging {
    pub(crate) fn new(device: &GpuDevice, bytes: u64) -> Result<Self, BackendError> {
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let buffer = device.buffer("readback", bytes, usage)?;
        Ok(Self { buffer, arrival: Arc::default() })
    }

    pub(crate) fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Asks for the map of the first `bytes` bytes, of `what`; it is there once the submission that fills them is done and
    /// the device was polled.
    pub(crate) fn map(&mut self, device: &GpuDevice, what: &'static str, bytes: u64) {
        device.note_read_back(what, bytes);
        // Its own, whatever is still said of one that was forgotten.
        self.arrival = Arc::default();
        let arrival = Arc::clone(&self.arrival);
        self.buffer.map_async(MapMode::Read, 0..bytes, move |result| {
            let found = if result.is_ok() { Arrival::Here } else { Arrival::Failed };
            arrival.store(found as u8, Ordering::Release);
        });
    }

    /// Nobody wants the map that was asked for: the buffer can be copied to again.
    pub(crate) fn forget(&mut self) {
        self.buffer.unmap();
    }

    /// Of the map that was asked for last.
    pub(crate) fn arrival(&self) -> Arrival {
        match self.arrival.load(Ordering::Acquire) {
            of if of == Arrival::Coming as u8 => Arrival::Coming,
            of if of == Arrival::Here as u8 => Arrival::Here,
            _ => Arrival::Failed,
        }
    }

    /// Waits until it is said how the map went, once its submission is done: another thread that polled the device meanwhile
    /// may have taken the news, and be about to tell it.
    pub(crate) fn hear(&self, device: &GpuDevice) {
        let begun = Instant::now();
        while self.arrival() == Arrival::Coming && device.check().is_ok() && begun.elapsed() < HEARD_WITHIN {
            std::thread::yield_now();
        }
    }

    /// Hands the first `bytes` bytes, which were mapped, to `read`.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], also if they have not arrived.
    pub(crate) fn take(
        &self,
        device: &GpuDevice,
        bytes: u64,
        read: impl FnOnce(&[u8]),
    ) -> Result<(), BackendError> {
        if self.arrival() != Arrival::Here {
            return Err(device.lose("a buffer could not be read"));
        }
        match self.buffer.get_mapped_range(0..bytes) {
            Ok(view) => read(&view),
            Err(error) => return Err(device.lose(&error.to_string())),
        }
        self.buffer.unmap();
        Ok(())
    }
}

/// Records `work`, then copies the first `bytes` bytes of `source`, submits, waits and returns them. `what` is waited for is
/// counted ([`GpuDevice::waits`]).
///
/// # Errors
/// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
pub(crate) fn read_now(
    device: &GpuDevice,
    what: &'static str,
    source: &Buffer,
    bytes: u64,
    work: impl FnOnce(&mut CommandEncoder),
) -> Result<Vec<u8>, BackendError> {
    let mut staging = Staging::new(device, bytes)?;
    let mut encoder = device.wgpu().create_command_encoder(&Default::default());
    work(&mut encoder);
    encoder.copy_buffer_to_buffer(source, 0, &staging.buffer, 0, bytes);
    let submission = device.queue().submit([encoder.finish()]);
    staging.map(device, what, bytes);
    device.wait(what, submission)?;
    staging.hear(device);
    let mut out = Vec::new();
    staging.take(device, bytes, |view| out.extend_from_slice(view))?;
    Ok(out)
}

/// A copy that somebody asks for now and then: on its way, or none.
#[derive(Debug, Default)]
pub(crate) struct Later {
    coming: Option<(Staging, u64, SubmissionIndex)>,
}

impl Later {
    /// Whether a copy is on its way, or here and not taken.
    pub(crate) fn is_coming(&self) -> bool {
        self.coming.is_some()
    }

    /// Sends for whole buffers, one after the other, as they are after all that was submitted; a copy that is on its way is
    /// forgotten. `what` they are is counted.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn send_for(
        &mut self,
        device: &GpuDevice,
        what: &'static str,
        sources: &[&Buffer],
    ) -> Result<(), BackendError> {
        self.coming = None;
        let bytes = sources.iter().map(|source| source.size()).sum();
        let mut staging = Staging::new(device, bytes)?;
        let mut encoder = device.wgpu().create_command_encoder(&Default::default());
        let mut at = 0;
        for source in sources {
            encoder.copy_buffer_to_buffer(source, 0, &staging.buffer, at, source.size());
            at += source.size();
        }
        let submission = device.queue().submit([encoder.finish()]);
        staging.map(device, what, bytes);
        self.coming = Some((staging, bytes, submission));
        Ok(())
    }

    /// The copy, once; nothing if none was sent for, or as long as it is on its way, unless it is `waited_for`.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`]: no copy is on its way then.
    pub(crate) fn take(
        &mut self,
        device: &GpuDevice,
        waited_for: Option<&'static str>,
    ) -> Result<Option<Vec<u8>>, BackendError> {
        let Some((staging, bytes, submission)) = self.coming.take() else { return Ok(None) };
        match waited_for {
            Some(what) => device.wait(what, submission.clone())?,
            None => device.poll()?,
        }
        if staging.arrival() == Arrival::Coming {
            self.coming = Some((staging, bytes, submission));
            return Ok(None);
        }
        let mut out = Vec::new();
        staging.take(device, bytes, |view| out.extend_from_slice(view))?;
        Ok(Some(out))
    }
}
