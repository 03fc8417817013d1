//! From the device to the host: at once where a caller waits for it, or started now and fetched when asked for.

use crate::device::GpuDevice;
use earthshine_radiosity::BackendError;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use wgpu::{Buffer, BufferUsages, CommandEncoder, MapMode, PollType, SubmissionIndex};

/// A buffer that the host can read, and whether it may yet.
#[derive(Debug)]
struct Staging {
    buffer: Buffer,
    bytes: u64,
    is_mapped: Arc<AtomicBool>,
}

impl Staging {
    fn new(device: &GpuDevice, bytes: u64) -> Result<Self, BackendError> {
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let buffer = device.buffer("readback", bytes, usage)?;
        Ok(Self { buffer, bytes, is_mapped: Arc::default() })
    }

    /// Asks for the map; it is there once the submission that fills the buffer is done and the device was polled.
    fn map(&self) {
        self.is_mapped.store(false, Ordering::Release);
        let is_mapped = Arc::clone(&self.is_mapped);
        self.buffer.map_async(MapMode::Read, 0..self.bytes, move |result| {
            is_mapped.store(result.is_ok(), Ordering::Release);
        });
    }

    fn take(&self, device: &GpuDevice, read: impl FnOnce(&[u8])) -> Result<(), BackendError> {
        if !self.is_mapped.load(Ordering::Acquire) {
            return Err(device.lose("a buffer could not be read"));
        }
        match self.buffer.get_mapped_range(0..self.bytes) {
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
    staging.map();
    device.wait(submission)?;
    let mut out = Vec::new();
    staging.take(device, |view| out.extend_from_slice(view))?;
    Ok(out)
}

/// The newest copy of some buffers, on its way or here. Two staging buffers, so that a copy that nobody fetched does not
/// hold up the next.
#[derive(Debug)]
pub(crate) struct Readback {
    staging: [Staging; 2],
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
        self.staging[self.next].map();
        self.pending = Some((self.next, submission));
        self.next = 1 - self.next;
    }

    /// Whether the newest copy is here, so that nobody waits for it. Looks without waiting.
    pub(crate) fn is_here(&self, device: &GpuDevice) -> bool {
        let Some((at, _)) = &self.pending else { return false };
        // What a device has to say of its end is said by whoever fetches.
        let _ = device.wgpu().poll(PollType::Poll);
        self.staging[*at].is_mapped.load(Ordering::Acquire)
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
                self.staging[at].take(device, read)
            }
        }
    }
}
