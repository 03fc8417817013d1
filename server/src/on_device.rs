//! Something on the device that backends compute on: made once a device is there, after a loss on the next one.
//!
//! In between, and where a device had no room for it, the CPU does its work; the engine decides when to ask again. Who
//! opens devices is [`crate::device_source`].

use crate::device_source::CurrentDevice;
use earthshine_gpu::GpuDevice;
use std::fmt::Display;

/// A `T` on the current device, as far as there is one.
#[derive(Debug)]
pub(crate) struct OnDevice<T> {
    current: CurrentDevice,
    made: Option<(GpuDevice, T)>,
}

impl<T> OnDevice<T> {
    pub(crate) fn new(current: CurrentDevice) -> Self {
        Self { current, made: None }
    }

    /// Whether a device is there.
    pub(crate) fn is_possible(&self) -> bool {
        self.current.get().is_some_and(|device| !device.is_lost())
    }

    /// What was made last, on a device that may be lost by now.
    pub(crate) fn last(&mut self) -> Option<&mut T> {
        self.made.as_mut().map(|(_, made)| made)
    }

    /// What was made on a device that is there, or what `make` makes there. `work` is what a refusal leaves to the CPU.
    pub(crate) fn get<E: Display>(
        &mut self,
        work: &'static str,
        make: impl FnOnce(&GpuDevice) -> Result<T, E>,
    ) -> Option<&mut T> {
        if self.made.as_ref().is_none_or(|(device, _)| device.is_lost()) {
            self.made = None;
            let device = self.current.get().filter(|device| !device.is_lost())?;
            match make(&device) {
                Ok(made) => self.made = Some((device, made)),
                Err(error) => device.warn_once(work, &error),
            }
        }
        self.last()
    }
}
