//! Direct light on the device that backends compute on: after a loss on the next one, on the CPU in between.

use crate::on_device::OnDevice;
use earthshine_gpu::direct::GpuDirect;
use earthshine_light::{DirectLight, LightUnderWay, OccluderSet, PatchPoints};
use earthshine_world::Light;

/// Fewer points times lamps are left to the CPU. Reckoned from the CPU's rate and a way to a device and back, not measured:
/// look again with hardware.
const RAYS_MIN: usize = 1024;

/// Lights one level.
#[derive(Debug)]
pub(crate) struct DeviceLight(pub(crate) OnDevice<GpuDirect>);

impl DirectLight for DeviceLight {
    fn begin(
        &mut self,
        occluders: &OccluderSet,
        lights: &[Light],
        patches: &[PatchPoints<'_>],
    ) -> Option<Box<dyn LightUnderWay>> {
        let direct = self.0.get("direct light", |device| GpuDirect::new(device, RAYS_MIN))?;
        direct.begin(occluders, lights, patches)
    }
}
