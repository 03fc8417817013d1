//! Light of receivers and far light on the device that backends compute on: after a loss on the next one, on the CPU in
//! between.

use crate::on_device::OnDevice;
use earthshine_gpu::receivers::{GpuReceivers, ROWS_MAX};
use earthshine_radiosity::receivers::{ReceiverGather, ReceiverLight, ReceiverSums};
use earthshine_world::Asked;

/// Gathers receivers of one session, or far light of one of its levels.
#[derive(Debug)]
pub(crate) struct DeviceReceivers(pub(crate) OnDevice<GpuReceivers>);

impl ReceiverLight for DeviceReceivers {
    fn rows_max(&self) -> usize {
        if self.0.is_possible() { ROWS_MAX } else { 0 }
    }

    fn begin(&mut self, gather: &ReceiverGather<'_>) -> bool {
        let receivers = self.0.get("light of receivers, or far light,", GpuReceivers::new);
        receivers.is_some_and(|receivers| receivers.begin(gather))
    }

    fn take(&mut self) -> Asked<Vec<ReceiverSums>> {
        self.0.last().map_or(Asked::Lost, ReceiverLight::take)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device_source::CurrentDevice;
    use earthshine_radiosity::receivers::RowsOf;
    use earthshine_world::Sky;

    #[test]
    fn without_a_device_the_cpu_gathers() {
        let mut receivers = DeviceReceivers(OnDevice::new(CurrentDevice::default()));
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
        assert_eq!(receivers.take(), Asked::Lost);
    }
}
