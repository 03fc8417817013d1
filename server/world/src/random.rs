//! Random numbers as hashes: the same seed, purpose and indices give the same number anywhere.
//!
//! There is no state, so that a chunk made alone, on any thread, is the chunk made with the whole world.

/// What a number is for, so that two uses never share a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Purpose {
    /// Places on triangles.
    SamplePoint = 1,
    /// Rays that find buried points.
    BuriedTest = 2,
    /// Rays of form-factor rows.
    RowRay = 3,
    /// Which sample points a patch keeps.
    PointChoice = 4,
    /// Generated worlds.
    WorldShape = 5,
    /// Paths of the reference tracer.
    ReferencePath = 6,
    /// Places where light is compared.
    MeasurePoint = 7,
    /// Directions towards the sun's disc.
    SunDisc = 8,
    /// Camera paths and faults of simulations.
    Simulation = 9,
    /// Rays of receivers' rows, and which of their columns stay.
    ReceiverRay = 10,
    /// Ways along surfaces that find walls.
    WallSegment = 11,
}

/// 64 well-mixed bits of (seed, purpose, a, b). The finaliser of `SplitMix64`, once a word.
#[must_use]
pub fn hash(seed: u64, purpose: Purpose, a: u64, b: u64) -> u64 {
    let mut state = seed ^ 0x9E37_79B9_7F4A_7C15;
    for word in [purpose as u64, a, b] {
        state = mix(state.wrapping_add(0x9E37_79B9_7F4A_7C15) ^ word);
    }
    mix(state)
}

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// The upper 24 bits of `bits` as a number in `[0, 1)`.
#[must_use]
pub fn unit_f32(bits: u64) -> f32 {
    (bits >> 40) as f32 * (1.0 / (1u64 << 24) as f32)
}

/// Two independent numbers in `[0, 1)` from one hash.
#[must_use]
pub fn unit_pair(bits: u64) -> (f32, f32) {
    (unit_f32(bits), unit_f32(bits << 24))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_uniform_and_differ_by_purpose() {
        let mean = (0..10_000).map(|i| unit_f32(hash(7, Purpose::RowRay, i, 0))).sum::<f32>() / 10_000.0;
        assert!((mean - 0.5).abs() < 0.01, "{mean}");
        assert_ne!(hash(7, Purpose::RowRay, 1, 2), hash(7, Purpose::SunDisc, 1, 2));
        let (a, b) = unit_pair(hash(1, Purpose::RowRay, 3, 4));
        assert!((0.0..1.0).contains(&a) && (0.0..1.0).contains(&b) && a != b);
    }
}
