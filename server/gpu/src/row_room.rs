//! What all who gather rows on a device hold of its memory together, and each one's part of that.

use crate::device::GpuDevice;

/// Memory for the columns of one gatherer's rows; given back when it is dropped.
#[derive(Debug)]
pub(crate) struct RowRoom {
    device: GpuDevice,
    bytes: u64,
}

impl RowRoom {
    /// None yet.
    pub(crate) fn new(device: &GpuDevice) -> Self {
        Self { device: device.clone(), bytes: 0 }
    }

    /// Gives back what it has and takes `wanted` bytes, or what is left of `most` for all on the device, but `least` at least.
    /// Returns what it has then.
    ///
    /// # Errors
    /// What is left, if that is less; it has nothing then.
    pub(crate) fn take(&mut self, wanted: u64, least: u64, most: u64) -> Result<u64, u64> {
        let mut taken = self.device.row_bytes();
        *taken -= std::mem::take(&mut self.bytes);
        let left = most.saturating_sub(*taken);
        if least > left {
            return Err(left);
        }
        self.bytes = wanted.min(left);
        *taken += self.bytes;
        Ok(self.bytes)
    }
}

impl Drop for RowRoom {
    fn drop(&mut self) {
        *self.device.row_bytes() -= self.bytes;
    }
}
