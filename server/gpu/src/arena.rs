//! A list on the device that is filled from the front; when it is full, whoever owns it makes a new one and puts into it what
//! still counts.

use crate::device::GpuDevice;
use crate::rays::STORAGE;
use earthshine_radiosity::BackendError;
use wgpu::Buffer;

/// Room for elements, some of it used.
#[derive(Debug)]
pub(crate) struct Arena {
    buffer: Buffer,
    /// Bytes of an element.
    stride: u64,
    used: u64,
    capacity: u64,
}

impl Arena {
    /// Room for `capacity` elements of `stride` bytes.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn new(
        device: &GpuDevice,
        label: &str,
        stride: usize,
        capacity: u64,
    ) -> Result<Self, BackendError> {
        let stride = stride as u64;
        let buffer = device.buffer(label, stride * capacity, STORAGE)?;
        Ok(Self { buffer, stride, used: 0, capacity })
    }

    pub(crate) fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// One past the number of the last element.
    pub(crate) fn used(&self) -> u32 {
        self.used as u32
    }

    pub(crate) fn has_room(&self, count: usize) -> bool {
        self.used + count as u64 <= self.capacity
    }

    /// Appends `values`, for which there is room; returns the number of the first.
    pub(crate) fn push<T: bytemuck::NoUninit>(&mut self, device: &GpuDevice, values: &[T]) -> u32 {
        let first = self.used;
        device.queue().write_buffer(&self.buffer, first * self.stride, bytemuck::cast_slice(values));
        self.used += values.len() as u64;
        first as u32
    }
}
