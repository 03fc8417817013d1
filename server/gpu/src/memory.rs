//! What a matrix of so many slots takes on a device, and how many slots fit.

use crate::news::{self, FLIGHTS_MAX};
use crate::plane::stripe_at;
use earthshine_radiosity::LocalMatrix;
use earthshine_shaders::limits::{BLOCK, RETURN_BANDS, SECTIONS, TILE_EDGE};

/// Planes: three channels of all bounces, and the exchange they were made from.
pub(crate) const PLANES: u64 = 4;

fn stripes(slots: u32) -> u64 {
    u64::from(slots.div_ceil(TILE_EDGE))
}

/// Bytes of one plane of `slots` slots.
#[must_use]
pub fn plane_bytes(slots: u32) -> u64 {
    4 * stripe_at(stripes(slots))
}

/// Bytes of the largest buffer beside the planes: the sums of a product, tile by tile.
#[must_use]
pub fn tile_sums_bytes(slots: u32) -> u64 {
    3 * stripes(slots).pow(2) * u64::from(TILE_EDGE) * 4
}

/// Bytes of everything on the device for `slots` slots, planes in one part each.
#[must_use]
pub fn device_bytes(slots: u32) -> u64 {
    let rows = stripes(slots) * u64::from(TILE_EDGE);
    let columns = rows * u64::from(BLOCK) * 4;
    // The exchange of a block, three channels of its columns before, after and between, the sections of a gather, the
    // entries of its rows.
    let blocks = columns * (1 + 3 * 3 + 3 * u64::from(SECTIONS) + 2);
    let vectors = rows * (2 * 16 + 6 * 12);
    let lists = stripes(slots) * (stripes(slots) + 1) * 2 + stripes(slots) * 20;
    let small = u64::from(BLOCK).pow(2) * 4 * (9 + 3 + 3 * u64::from(RETURN_BANDS)) + rows / 8;
    let news = FLIGHTS_MAX as u64 * news::list_bytes(slots) + 5 * u64::from(slots);
    PLANES * plane_bytes(slots) + tile_sums_bytes(slots) + blocks + vectors + lists + small + news
}

/// Most slots whose planes fit into one binding each.
#[must_use]
pub fn slots_unsplit_max(binding_bytes: u64) -> u32 {
    largest(|slots| plane_bytes(slots) <= binding_bytes && tile_sums_bytes(slots) <= binding_bytes)
}

/// Most slots at all: a stripe of tiles and the sums of a product each fit into one binding.
#[must_use]
pub fn slots_max(binding_bytes: u64) -> u32 {
    let stripe = |slots: u32| stripes(slots) * u64::from(TILE_EDGE).pow(2) * 4;
    largest(|slots| stripe(slots) <= binding_bytes && tile_sums_bytes(slots) <= binding_bytes)
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

    #[test]
    fn memory_grows_with_the_square_and_fits_where_it_says() {
        assert_eq!(plane_bytes(64), 64 * 64 * 4);
        assert_eq!(plane_bytes(65), 3 * 64 * 64 * 4);
        for binding in [1 << 20, 128 << 20, 2 << 30] {
            let most = slots_unsplit_max(binding);
            assert!(plane_bytes(most) <= binding && (most == 23_170 || plane_bytes(most + 64) > binding));
            assert!(slots_max(binding) >= most);
        }
        assert!(slots_unsplit_max(128 << 20) > 8_000, "{}", slots_unsplit_max(128 << 20));
        assert_eq!(slots_unsplit_max(2 << 30), 23_170);
        assert_eq!(slots_max(0), 0);
        let slots = 4096;
        assert!(device_bytes(slots) > 8 * 4096 * 4096 && device_bytes(slots) < 10 * 4096 * 4096);
    }
}
