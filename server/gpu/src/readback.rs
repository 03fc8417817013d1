//! From the device to the host: at once where a caller waits for it, or started now and fetched when asked for.

use crate::device::GpuDevice;
use earthshine_radiosity::BackendError;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use wgpu::{Buffer, BufferUsages, CommandEncoder, MapMode, SubmissionIndex};

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

    /// Asks for the map of the first `bytes` bytes; it is there once the submission that fills them is done and the device
    /// was polled.
    pub(crate) fn map(&self, bytes: u64) {
        self.arrival.store(Arrival::Coming as u8, Ordering::Release);
        let arrival = Arc::clone(&self.arrival);
        self.buffer.map_async(MapMode::Read, 0..bytes, move |result| {
            let found = if result.is_ok() { Arrival::Here } else { Arrival::Failed };
            arrival.store(found as u8, Ordering::Release);
        });
    }

    /// Of the map that was asked for last.
    pub(crate) fn arrival(&self) -> Arrival {
        match self.arrival.load(Ordering::Acquire) {
            of if of == Arrival::Coming as u8 => Arrival::Coming,
            of if of == Arrival::Here as u8 => Arrival::Here,
            _ => Arrival::Failed,
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

/// Records `work`, then copies the first `bytes` bytes of `source`, submits, waits and returns them.
///
/// # Errors
/// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
pub(crate) fn read_now(
    device: &GpuDevice,
    source: &Buffer,
    bytes: u64,
    work: impl FnOnce(&mut CommandEncoder),
) -> Result<Vec<u8>, BackendError> {
    let staging = Staging::new(device, bytes)?;
    let mut encoder = device.wgpu().create_command_encoder(&Default::default());
    work(&mut encoder);
    encoder.copy_buffer_to_buffer(source, 0, &staging.buffer, 0, bytes);
    let submission = device.queue().submit([encoder.finish()]);
    staging.map(bytes);
    device.wait(submission)?;
    let mut out = Vec::new();
    staging.take(device, bytes, |view| out.extend_from_slice(view))?;
    Ok(out)
}

/// The newest copy of some buffers, on its way or here. Two staging buffers, so that a copy that nobody fetched does not
/// hold up the next.
#[derive(Debug)]
pub(crate) struct Readback {
    staging: [Staging; 2],
    bytes: u64,
    /// Which of them the newest copy goes to, and what to wait for; none when it was fetched.
    pending: Option<(usize, SubmissionIndex)>,
    next: usize,
}

impl Readback {
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn new(device: &GpuDevice, bytes: u64) -> Result<Self, BackendError> {
        Ok(Self {
            staging: [Staging::new(device, bytes)?, Staging::new(device, bytes)?],
            bytes,
            pending: None,
            next: 0,
        })
    }

    /// Records the copy of whole buffers, one after the other; [`Self::submitted`] has to follow.
    pub(crate) fn record(&mut self, encoder: &mut CommandEncoder, sources: &[&Buffer]) {
        if let Some((at, _)) = self.pending.take() {
            // Nobody fetched it, and nobody will.
            self.staging[at].buffer.unmap();
        }
        let mut at = 0;
        for source in sources {
            encoder.copy_buffer_to_buffer(source, 0, &self.staging[self.next].buffer, at, source.size());
            at += source.size();
        }
    }

    pub(crate) fn submitted(&mut self, submission: SubmissionIndex) {
        self.staging[self.next].map(self.bytes);
        self.pending = Some((self.next, submission));
        self.next = 1 - self.next;
    }

    /// Whether [`Self::fetch`] has nothing to wait for. Looks without waiting.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn has_come(&self, device: &GpuDevice) -> Result<bool, BackendError> {
        device.poll()?;
        let coming = |&(at, _): &(usize, SubmissionIndex)| self.staging[at].arrival() == Arrival::Coming;
        Ok(!self.pending.as_ref().is_some_and(coming))
    }

    /// Hands the newest copy to `read` if it was not fetched yet; waits for it if it is still on its way.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn fetch(&mut self, device: &GpuDevice, read: impl FnOnce(&[u8])) -> Result<(), BackendError> {
        match self.pending.take() {
            None => device.check(),
            Some((at, submission)) => {
                device.wait(submission)?;
                self.staging[at].take(device, self.bytes, read)
            }
        }
    }
}
