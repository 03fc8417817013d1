//! Direct light on the device that backends compute on: after a loss on the next one, on the CPU in between.

use crate::on_device::OnDevice;
use earthshine_gpu::direct::{GpuDirect, RAYS_MIN};
use earthshine_light::{DirectLight, LightUnderWay, OccluderSet, PatchPoints};
use earthshine_world::Light;

/// Lights one level.
#[derive(Debug)]
pub(crate) struct DeviceLight(pub(crate) OnDevice<GpuDirect>);

impl DirectLight for DeviceLight {
    fn rays_min(&self) -> usize {
        if self.0.is_possible() { RAYS_MIN } else { usize::MAX }
    }

    fn begin(
        &mut self,
        occluders: &OccluderSet,
        lights: &[Light],
        patches: &[PatchPoints<'_>],
        wants_points: bool,
    ) -> Option<Box<dyn LightUnderWay>> {
        let direct = self.0.get("direct light", GpuDirect::new)?;
        direct.begin(occluders, lights, patches, wants_points)
    }
}
