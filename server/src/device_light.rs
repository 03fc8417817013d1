//! Direct light on the device that backends compute on: after a loss on the next one, on the CPU in between.

use crate::device_source::CurrentDevice;
use earthshine_gpu::direct::GpuDirect;
use earthshine_light::{DirectLight, OccluderSet, PatchPoints};
use earthshine_world::{Light, Rgb};

/// Fewer points times lamps are left to the CPU. Reckoned from the CPU's rate and a way to a device and back, not measured:
/// look again with hardware.
const RAYS_MIN: usize = 1024;

/// Lights one level.
#[derive(Debug)]
pub(crate) struct DeviceLight {
    current: CurrentDevice,
    on_device: Option<GpuDirect>,
    /// Whether trees were refused: once said is enough.
    is_refused: bool,
}

impl DeviceLight {
    pub(crate) fn new(current: CurrentDevice) -> Self {
        Self { current, on_device: None, is_refused: false }
    }
}

impl DirectLight for DeviceLight {
    fn on_points(
        &mut self,
        occluders: &OccluderSet,
        lights: &[Light],
        patches: &[PatchPoints<'_>],
    ) -> Option<Vec<Rgb>> {
        if self.on_device.as_ref().is_none_or(GpuDirect::is_lost) {
            let device = self.current.get().filter(|device| !device.is_lost() && !self.is_refused)?;
            match GpuDirect::new(&device, RAYS_MIN) {
                Ok(direct) => self.on_device = Some(direct),
                Err(error) => {
                    tracing::warn!(%error, "direct light is computed on the CPU");
                    self.is_refused = true;
                }
            }
        }
        self.on_device.as_mut()?.on_points(occluders, lights, patches)
    }
}
