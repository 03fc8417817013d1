//! What light takes on a device. A matrix of so many slots, and how many slots fit, is reckoned from the list of buffers by
//! which it is allocated; lists that grow (rows, trees) by what an element takes.

use crate::plane::stripe_at;
use crate::{matrix, news, rows};
use earthshine_light::tree_layout::NodeWords;
use earthshine_radiosity::LocalMatrix;
use earthshine_shaders::host::TreeTriangle;
use earthshine_shaders::limits::TILE_EDGE;
use wgpu::BufferUsages;

/// Bytes of one plane of `slots` slots.
#[must_use]
pub fn plane_bytes(slots: u32) -> u64 {
    4 * stripe_at(u64::from(slots.div_ceil(TILE_EDGE)))
}

/// Bytes of everything on the device for `slots` slots, planes in one part each.
#[must_use]
pub fn device_bytes(slots: u32) -> u64 {
    device_bytes_within(slots, u64::MAX)
}

/// As [`device_bytes`], planes in parts of at most `part_bytes_max` bytes: each part has sums of its own.
pub(crate) fn device_bytes_within(slots: u32, part_bytes_max: u64) -> u64 {
    let of_matrix: u64 = matrix::sizes(slots, part_bytes_max).iter().map(|(bytes, _)| bytes).sum();
    of_matrix + news::sizes(slots).sum::<u64>()
}

/// Bytes of light over rows, for `slots` slots with `links` links in all, by shooting and drawing, the method that takes most.
/// Lists grow by doubling, and rows lie in powers of two: of what links take it may be four times as much.
#[must_use]
pub fn row_bytes(slots: u32, links: u64) -> u64 {
    u64::from(slots) * rows::SLOT_BYTES + links * rows::LINK_BYTES + news::sizes(slots).sum::<u64>()
}

/// Bytes of a triangle in the trees through which direct light is traced; they have room for twice what is resident, as long as
/// that fits into one binding.
pub const TREE_TRIANGLE_BYTES: u64 = size_of::<TreeTriangle>() as u64;
/// Bytes of a node of those trees, in a list of its own.
pub const TREE_NODE_BYTES: u64 = size_of::<NodeWords>() as u64;

/// Bytes of the largest buffer that a kernel is given.
fn largest_binding(slots: u32, part_bytes_max: u64) -> u64 {
    let of_matrix = matrix::sizes(slots, part_bytes_max);
    let bound = of_matrix.iter().filter(|(_, usage)| usage.contains(BufferUsages::STORAGE));
    bound.map(|&(bytes, _)| bytes).chain(news::sizes(slots)).max().unwrap_or(0)
}

/// Most slots whose planes fit into one binding each.
#[must_use]
pub fn slots_unsplit_max(binding_bytes: u64) -> u32 {
    largest(|slots| largest_binding(slots, u64::MAX) <= binding_bytes)
}

/// Most slots at all, planes split: every part, and every buffer beside them, fits into one binding.
#[must_use]
pub fn slots_max(binding_bytes: u64) -> u32 {
    largest(|slots| largest_binding(slots, binding_bytes) <= binding_bytes)
}

/// The largest number of slots for which `fits`, which holds for all smaller ones.
fn largest(fits: impl Fn(u32) -> bool) -> u32 {
    let (mut low, mut high) = (0, LocalMatrix::CAPACITY_MAX);
    while low < high {
        let middle = (low + high).div_ceil(2);
        if fits(middle) { low = middle } else { high = middle - 1 }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GpuRowLight;
    use crate::twins::device_or_skip;
    use crate::{AdapterChoice, GpuBackend, GpuDevice};
    use earthshine_radiosity::BackendError;
    use earthshine_radiosity::solver::row_light::{Frame, RowLight as _};
    use earthshine_radiosity::solver::{Method, Residents, SolverSettings};
    use earthshine_world::Rgb;

    #[test]
    fn memory_grows_with_the_square_and_fits_where_it_says() {
        assert_eq!(plane_bytes(64), 64 * 64 * 4);
        assert_eq!(plane_bytes(65), 3 * 64 * 64 * 4);
        for binding in [1 << 20, 3 << 20, 128 << 20, 256 << 20, 2 << 30] {
            let (unsplit, most) = (slots_unsplit_max(binding), slots_max(binding));
            assert!(most >= unsplit, "{binding}: {most} below {unsplit}");
            assert!(
                largest_binding(unsplit, u64::MAX) <= binding && largest_binding(most, binding) <= binding
            );
            let is_most = |slots: u32, part| {
                slots == LocalMatrix::CAPACITY_MAX || largest_binding(slots + 1, part) > binding
            };
            assert!(is_most(unsplit, u64::MAX) && is_most(most, binding), "{binding}: {unsplit}, {most}");
        }
        // The sums of a gather are a set for each part: they are what fits last where bindings are small.
        assert_eq!((slots_unsplit_max(128 << 20), slots_max(128 << 20)), (8128, 17_472));
        assert_eq!(slots_unsplit_max(2 << 30), LocalMatrix::CAPACITY_MAX);
        assert_eq!(slots_max(0), 0);
        let slots = 4096;
        assert!(device_bytes(slots) > 8 * 4096 * 4096 && device_bytes(slots) < 10 * 4096 * 4096);
        assert!(device_bytes_within(slots, 1 << 20) > device_bytes(slots), "sums of many parts");
    }

    /// Goal: what a matrix is said to take is what it takes, and no buffer is above the binding limit. Method: every buffer
    /// of opened ones is counted, planes whole and split.
    #[test]
    fn a_matrix_takes_what_is_said_and_binds_no_more_than_it_may() {
        let Some(whole) = device_or_skip() else { return };
        let choice = AdapterChoice { allow_software: true, ..AdapterChoice::default() };
        let split = GpuDevice::open_splitting(&choice, 2 << 14).expect("there was one");
        let within = GpuDevice::open_within(&choice, 3 << 20).expect("there was one");
        let most = slots_max(within.binding_bytes_max());
        assert!(most > 64, "{most}");
        for (device, slots) in
            [&whole, &split, &within].into_iter().flat_map(|device| [1, 64, 65, most].map(|n| (device, n)))
        {
            device.take_made();
            let backend = GpuBackend::new(device, slots).expect("a small matrix");
            let made = device.take_made();
            drop(backend);
            let on_device = made.iter().filter(|(_, usage)| !usage.contains(BufferUsages::MAP_READ));
            let bytes: u64 = on_device.clone().map(|(bytes, _)| bytes).sum();
            assert_eq!(bytes, device_bytes_within(slots, device.part_bytes_max()), "{slots} slots");
            let bound = on_device.filter(|(_, usage)| usage.contains(BufferUsages::STORAGE));
            let largest = bound.map(|&(bytes, _)| bytes).max().expect("some");
            assert!(largest <= device.binding_bytes_max(), "{slots} slots: {largest}");
        }
        let refused = GpuBackend::new(&within, most + 1).map(drop);
        assert!(matches!(refused, Err(BackendError::OutOfMemory { slots, .. }) if slots == most + 1));
        let above = within.buffer("test", within.binding_bytes_max() + 1, BufferUsages::STORAGE);
        assert!(matches!(above, Err(BackendError::OutOfMemory { .. })) && !within.is_lost());
    }

    /// Goal: what rows are said to take is what they take, but for room to grow and what builds tables. Method: as above.
    #[test]
    fn light_over_rows_takes_about_what_is_said() {
        let Some(device) = device_or_skip() else { return };
        let (slots, links) = (2000u32, 120u32);
        let mut residents = Residents::new(slots as usize);
        for row in 0..slots {
            let others = (0..links / 2).map(|link| ((row * 7 + link * 13) % row.max(1), 1e-3));
            let others = others.filter(|_| row > 0).map(|(slot, share)| (slot as usize, share));
            residents.links.add(row as usize, 1.0, Rgb::splat(0.5), others);
        }
        let count: usize = (0..slots as usize).map(|slot| residents.links.row(slot).len()).sum();
        let settings = SolverSettings {
            method: Method::Hybrid,
            rebuild_items_per_step: u32::MAX,
            ..SolverSettings::default()
        };
        device.take_made();
        let dark = vec![[0.0; 4]; slots as usize];
        let mut light = GpuRowLight::new(&device, &residents, &settings, &dark).expect("a small one");
        light
            .advance(&mut residents, Frame { settings: &settings, number: 0, order: &[], matrix: None })
            .expect("a device that works");
        let made = device.take_made();
        let on_device = made.iter().filter(|(_, usage)| !usage.contains(BufferUsages::MAP_READ));
        let bytes: u64 = on_device.map(|(bytes, _)| bytes).sum();
        let said = row_bytes(slots, count as u64);
        assert!(count > 100_000 && (said..4 * said).contains(&bytes), "{count} links: {bytes} for {said}");
    }
}
