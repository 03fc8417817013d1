//! Whether a device's subgroups are what kernels may count on: as many consecutive lanes in each as the adapter says.

use crate::device::GpuDevice;
use crate::readback::read_now;
use crate::recorder::{Recorder, uniform_buffer};
use earthshine_radiosity::BackendError;
use earthshine_shaders::host::Pass;
use earthshine_shaders::limits::LANES;
use earthshine_shaders::subgroups::{NUMBER_LANES, SUBGROUP_LANES_RANGE, numbered};
use wgpu::{AdapterInfo, BufferUsages, Features};

/// Workgroups that are looked at.
const GROUPS: u32 = 64;

/// Lanes of each subgroup by what the adapter says; none where they differ, or kernels do not know so many.
pub(crate) fn lanes_of(info: &AdapterInfo, features: Features) -> Option<u32> {
    let lanes = info.subgroup_min_size;
    let is_usable = features.contains(Features::SUBGROUP)
        && info.subgroup_max_size == lanes
        && lanes.is_power_of_two()
        && SUBGROUP_LANES_RANGE.contains(&lanes);
    is_usable.then_some(lanes)
}

/// Whether `device`, which has [`NUMBER_LANES`], lays its subgroups out so.
///
/// # Errors
/// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
pub(crate) fn are_in_order(device: &GpuDevice, lanes: u32) -> Result<bool, BackendError> {
    let bytes = u64::from(16 * GROUPS * LANES);
    let found = device.buffer("lanes", bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC)?;
    let uniforms = uniform_buffer(device)?;
    let mut recorder = Recorder::new(device, &uniforms, None);
    recorder.dispatch(&NUMBER_LANES, &[&found], Pass::default(), [GROUPS, 1, 1]);
    recorder.submit()?;
    let words: Vec<[u32; 4]> =
        bytemuck::pod_collect_to_vec(&read_now(device, "subgroups", &found, bytes, |_| {})?);
    Ok((0..).zip(&words).all(|(at, found)| is_as_expected(at % LANES, *found, lanes)))
}

fn is_as_expected(lane: u32, found: [u32; 4], lanes: u32) -> bool {
    let expected = numbered(lane, lanes);
    let is_last = lane % lanes == lanes - 1;
    found[..3] == expected[..3] && (is_last || found[3] == expected[3])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: subgroups of any other shape are noticed. Method: one word at a time is another.
    #[test]
    fn other_orders_are_noticed() {
        assert!((0..LANES).all(|lane| is_as_expected(lane, numbered(lane, 32), 32)));
        for (lane, word) in (0..LANES).flat_map(|lane| (0..3).map(move |word| (lane, word))) {
            let mut other = numbered(lane, 32);
            other[word] ^= 1;
            assert!(!is_as_expected(lane, other, 32), "{lane} {word}");
        }
        assert!(!is_as_expected(5, [32, 0, 5, 7], 32), "a neighbour that is none");
        assert!(!is_as_expected(5, numbered(5, 16), 32) && !is_as_expected(40, numbered(40, 64), 32));
    }
}
