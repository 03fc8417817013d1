//! The order of a row's items along a [`CdfTable`](super::CdfTable): a Z-curve through space.

/// Bits a coordinate keeps: voxels within a million of the origin.
const BITS: u32 = 21;

/// Place of a voxel along the Z-curve (Morton code). Coordinates are taken from the corner of the world at -2^20;
/// what lies further out is clamped to the border.
#[must_use]
pub fn morton(voxel: [i32; 3]) -> u64 {
    let offset = 1i64 << (BITS - 1);
    let within = voxel.map(|c| (i64::from(c) + offset).clamp(0, (1 << BITS) - 1) as u64);
    (0..BITS).fold(0, |code, bit| {
        let of_bit = (within[0] >> bit & 1) | (within[1] >> bit & 1) << 1 | (within[2] >> bit & 1) << 2;
        code | of_bit << (3 * bit)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_fills_a_cube_before_the_next() {
        let mut codes: Vec<u64> = (0..8).map(|i| morton([i & 1, i >> 1 & 1, i >> 2])).collect();
        let first = codes[0];
        codes.sort_unstable();
        assert!(codes.iter().zip(first..).all(|(&code, expected)| code == expected));
        assert!(morton([2, 0, 0]) > codes[7] && morton([-1, -1, -1]) < first);
        assert_eq!(morton([i32::MIN; 3]), 0);
    }
}
