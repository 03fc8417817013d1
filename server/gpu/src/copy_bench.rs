//! What the device can do at best: a copy in its own memory, to hold kernels against.

use crate::device::GpuDevice;
use earthshine_radiosity::BackendError;
use wgpu::BufferUsages;

/// Two buffers to copy between.
#[derive(Debug)]
pub struct CopyBench {
    device: GpuDevice,
    buffers: [wgpu::Buffer; 2],
    bytes: u64,
}

impl CopyBench {
    /// For copies of `bytes` bytes.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub fn new(device: &GpuDevice, bytes: u64) -> Result<Self, BackendError> {
        let buffer = || device.buffer("copy", bytes, BufferUsages::COPY_SRC | BufferUsages::COPY_DST);
        Ok(Self { device: device.clone(), buffers: [buffer()?, buffer()?], bytes })
    }

    /// Copies `times` times there and back, and waits.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn run(&self, times: u32) -> Result<(), BackendError> {
        let mut encoder = self.device.wgpu().create_command_encoder(&Default::default());
        let [a, b] = &self.buffers;
        for _ in 0..times {
            encoder.copy_buffer_to_buffer(a, 0, b, 0, self.bytes);
            encoder.copy_buffer_to_buffer(b, 0, a, 0, self.bytes);
        }
        self.device.wait("copy", self.device.queue().submit([encoder.finish()]))
    }
}
