//! Something on the device that backends compute on: made once a device is there, after a loss on the next one.
//!
//! In between, and where a device had no room for it, the CPU does its work. Who opens devices is [`crate::device_source`].

use crate::device_source::CurrentDevice;
use earthshine_gpu::GpuDevice;
use std::fmt::Display;

/// After a device had no room for something, so many calls go by before it is asked again.
const CALLS_BETWEEN_ATTEMPTS: u32 = 64;

/// A `T` on the current device, as far as there is one.
#[derive(Debug)]
pub(crate) struct OnDevice<T> {
    current: CurrentDevice,
    made: Option<(GpuDevice, T)>,
    /// Calls that go by before a device that had no room is asked again.
    left_to_cpu: u32,
}

impl<T> OnDevice<T> {
    pub(crate) fn new(current: CurrentDevice) -> Self {
        Self { current, made: None, left_to_cpu: 0 }
    }

    /// Whether a device is there.
    pub(crate) fn is_possible(&self) -> bool {
        self.current.get().is_some_and(|device| !device.is_lost())
    }

    /// What was made last, on a device that may be lost by now.
    pub(crate) fn last(&mut self) -> Option<&mut T> {
        self.made.as_mut().map(|(_, made)| made)
    }

    /// What was made on a device that is there, or what `make` makes there. `work` is what a refusal leaves to the CPU for a while.
    pub(crate) fn get<E: Display>(
        &mut self,
        work: &'static str,
        make: impl FnOnce(&GpuDevice) -> Result<T, E>,
    ) -> Option<&mut T> {
        if self.made.as_ref().is_none_or(|(device, _)| device.is_lost()) {
            self.made = None;
            if self.left_to_cpu > 0 {
                self.left_to_cpu -= 1;
                return None;
            }
            let device = self.current.get().filter(|device| !device.is_lost())?;
            match make(&device) {
                Ok(made) => self.made = Some((device, made)),
                Err(error) => {
                    device.warn_once(work, &error);
                    self.left_to_cpu = CALLS_BETWEEN_ATTEMPTS;
                }
            }
        }
        self.last()
    }
}
