//! A list on the device that follows one on the host: what differs is uploaded, and nothing else.

use crate::device::GpuDevice;
use crate::rays::STORAGE;
use earthshine_radiosity::BackendError;
use wgpu::Buffer;

/// Elements that are compared and uploaded together.
const RUN: usize = 64;

/// A list on the device, and what it holds.
#[derive(Debug)]
pub(crate) struct Mirror<T> {
    label: &'static str,
    buffer: Buffer,
    held: Vec<T>,
    /// Bytes that the last [`Self::bring`] uploaded.
    uploaded: u64,
}

impl<T: bytemuck::NoUninit + PartialEq> Mirror<T> {
    /// Empty.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn new(device: &GpuDevice, label: &'static str) -> Result<Self, BackendError> {
        let buffer = device.buffer(label, 0, STORAGE)?;
        Ok(Self { label, buffer, held: Vec::new(), uploaded: 0 })
    }

    pub(crate) fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Makes the list `wanted`; one that has grown gets a buffer of its own.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`] for more than a binding holds too, [`BackendError::DeviceLost`]. The list is what it was.
    pub(crate) fn bring(&mut self, device: &GpuDevice, wanted: &[T]) -> Result<(), BackendError> {
        let bytes = size_of_val(wanted) as u64;
        if bytes > self.buffer.size() {
            let most = device.binding_bytes_max();
            if bytes > most {
                return Err(BackendError::OutOfMemory { slots: 0, bytes });
            }
            self.buffer = device.buffer(self.label, bytes.next_power_of_two().min(most), STORAGE)?;
            self.held.clear();
        }
        self.uploaded = 0;
        let mut first = 0;
        while first < wanted.len() {
            let end = run_that_differs(&self.held, wanted, first);
            if end > first {
                let changed = &wanted[first..end];
                let at = (first * size_of::<T>()) as u64;
                device.queue().write_buffer(&self.buffer, at, bytemuck::cast_slice(changed));
                self.uploaded += size_of_val(changed) as u64;
            }
            first = end.max(first + RUN).min(wanted.len());
        }
        self.held.clear();
        self.held.extend_from_slice(wanted);
        Ok(())
    }
}

/// One past the runs from `first` on that differ one after the other; `first` if the first does not.
fn run_that_differs<T: PartialEq>(held: &[T], wanted: &[T], first: usize) -> usize {
    let mut end = first;
    while end < wanted.len() {
        let next = (end + RUN).min(wanted.len());
        if held.get(end..next) == Some(&wanted[end..next]) {
            break;
        }
        end = next;
    }
    end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::readback::read_now;
    use crate::twins::{device_or_skip, device_within};

    /// Goal: the device has what is wanted, and was told no more than what changed. Method: read back after each change.
    #[test]
    fn only_what_differs_is_uploaded() {
        let Some(device) = device_or_skip() else { return };
        let mut mirror = Mirror::new(&device, "test").expect("a small buffer");
        let mut list: Vec<u32> = Vec::new();
        let mut check = |list: &[u32], uploaded: usize| {
            mirror.bring(&device, list).expect("a device that works");
            assert_eq!(mirror.uploaded, 4 * uploaded as u64);
            if !list.is_empty() {
                let bytes = read_now(&device, "test", mirror.buffer(), 4 * list.len() as u64, |_| {});
                let found: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes.expect("a device that works"));
                assert_eq!(found, list);
            }
        };
        check(&list, 0);
        list.extend(0..200);
        check(&list, 200);
        check(&list, 0);
        list[70] = 7;
        check(&list, 64);
        list[199] = 7;
        list[64] = 9;
        check(&list, 64 + 8);
        list.truncate(64);
        check(&list, 0);
        // As many as the buffer has room for, and one more.
        list.extend(64..256);
        check(&list, 192);
        list.push(1);
        check(&list, 257);
    }

    #[test]
    fn more_than_a_binding_holds_is_refused_and_the_list_stays() {
        let Some(device) = device_within(1 << 10) else { return };
        let mut mirror = Mirror::new(&device, "test").expect("a small buffer");
        mirror.bring(&device, &[5u32; 256]).expect("as much as a binding holds");
        let refused = mirror.bring(&device, &[5u32; 257]);
        assert!(matches!(refused, Err(BackendError::OutOfMemory { bytes: 1028, .. })), "{refused:?}");
        mirror.bring(&device, &[5u32; 256]).expect("what is there");
        assert_eq!(mirror.uploaded, 0);
    }
}
