//! Light of receivers and far light on the device that backends compute on: after a loss on the next one, on the CPU in
//! between.

use crate::device_source::CurrentDevice;
use earthshine_gpu::receivers::{GpuReceivers, ROWS_MAX};
use earthshine_radiosity::receivers::{Gathering, ReceiverGather, ReceiverLight};

/// Gathers receivers of one session, or far light of one of its levels.
#[derive(Debug)]
pub(crate) struct DeviceReceivers {
    current: CurrentDevice,
    on_device: Option<GpuReceivers>,
    /// Whether the device had no room to begin with: once said is enough.
    is_refused: bool,
}

impl DeviceReceivers {
    pub(crate) fn new(current: CurrentDevice) -> Self {
        Self { current, on_device: None, is_refused: false }
    }

    /// On a device that is there, if any is.
    fn on_device(&mut self) -> Option<&mut GpuReceivers> {
        if self.on_device.as_ref().is_none_or(GpuReceivers::is_lost) {
            self.on_device = None;
            let device = self.current.get().filter(|device| !device.is_lost() && !self.is_refused)?;
            match GpuReceivers::new(&device) {
                Ok(receivers) => self.on_device = Some(receivers),
                Err(error) => {
                    tracing::warn!(%error, "light of receivers, or far light, is gathered on the CPU");
                    self.is_refused = true;
                }
            }
        }
        self.on_device.as_mut()
    }
}

impl ReceiverLight for DeviceReceivers {
    fn rows_max(&self) -> usize {
        let is_there = self.current.get().is_some_and(|device| !device.is_lost());
        if is_there && !self.is_refused { ROWS_MAX } else { 0 }
    }

    fn begin(&mut self, gather: &ReceiverGather<'_>) -> bool {
        self.on_device().is_some_and(|device| device.begin(gather))
    }

    fn take(&mut self) -> Gathering {
        self.on_device.as_mut().map_or(Gathering::Idle, ReceiverLight::take)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_radiosity::receivers::RowsOf;
    use earthshine_world::Sky;

    #[test]
    fn without_a_device_the_cpu_gathers() {
        let mut receivers = DeviceReceivers::new(CurrentDevice::default());
        let nothing = ReceiverGather {
            rows_of: RowsOf::Receivers,
            chunks: &[],
            first_spans: &[],
            spans: &[],
            columns: &[],
            sources: &[],
            slot_count: 0,
            sky: &Sky::default(),
            rows: &[],
        };
        assert_eq!(receivers.rows_max(), 0);
        assert!(!receivers.begin(&nothing));
        assert_eq!(receivers.take(), Gathering::Idle);
    }
}
