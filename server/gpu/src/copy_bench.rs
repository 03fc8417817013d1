//! What the device can do at best: a copy in its own memory, to hold kernels against, timed as they are.

use crate::device::GpuDevice;
use crate::timing::{PassTime, Timing};
use crate::work::Work;
use earthshine_radiosity::BackendError;
use wgpu::{BufferUsages, CommandEncoder};

/// Two buffers to copy between.
#[derive(Debug)]
pub struct CopyBench {
    device: GpuDevice,
    buffers: [wgpu::Buffer; 2],
    bytes: u64,
    timing: Option<Timing>,
}

impl CopyBench {
    /// For copies of `bytes` bytes.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub fn new(device: &GpuDevice, bytes: u64) -> Result<Self, BackendError> {
        let buffer = || device.buffer("copy", bytes, BufferUsages::COPY_SRC | BufferUsages::COPY_DST);
        Ok(Self { device: device.clone(), buffers: [buffer()?, buffer()?], bytes, timing: None })
    }

    /// Times every run from now on, on the device; false where it cannot.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub fn time_passes(&mut self) -> Result<bool, BackendError> {
        self.timing = Timing::new(&self.device)?;
        Ok(self.timing.is_some())
    }

    /// The runs since the last call, a pass each. Waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn take_times(&mut self) -> Result<Vec<PassTime>, BackendError> {
        self.timing.as_mut().map_or(Ok(Vec::new()), |timing| timing.take(&self.device))
    }

    /// Bytes read and written by a run of `times`.
    #[must_use]
    pub fn moved_bytes(&self, times: u32) -> f64 {
        4.0 * self.bytes as f64 * f64::from(times)
    }

    /// Copies `times` times there and back, and waits.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn run(&mut self, times: u32) -> Result<(), BackendError> {
        let mut encoder = self.device.wgpu().create_command_encoder(&Default::default());
        let work = Work { bytes: self.moved_bytes(times), flops: 0.0 };
        let ([a, b], bytes) = (&self.buffers, self.bytes);
        let copies = |encoder: &mut CommandEncoder| {
            for _ in 0..times {
                encoder.copy_buffer_to_buffer(a, 0, b, 0, bytes);
                encoder.copy_buffer_to_buffer(b, 0, a, 0, bytes);
            }
        };
        match &mut self.timing {
            Some(timing) => timing.around(&mut encoder, "copy", work, copies),
            None => copies(&mut encoder),
        }
        self.device.wait("copy", self.device.queue().submit([encoder.finish()]))
    }
}
