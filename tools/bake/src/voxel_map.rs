//! Maps from voxels that every ray asks: hashed by a multiplication a word instead of the standard library's `SipHash`.
//!
//! Only looked up, never iterated. The keys are a scene's own voxels; who makes them collide slows his own bake.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// A map whose keys are small integers.
pub(crate) type VoxelMap<K, V> = HashMap<K, V, BuildHasherDefault<WordHasher>>;

/// Folds words as they come.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct WordHasher(u64);

impl WordHasher {
    fn fold(&mut self, word: u64) {
        // The golden ratio as a 64-bit fraction; the rotation brings the high bits, which it mixes best, down again.
        self.0 = (self.0 ^ word).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(29);
    }
}

impl Hasher for WordHasher {
    fn finish(&self) -> u64 {
        let mixed = self.0.wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed ^ mixed >> 32
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.fold(u64::from(byte)));
    }

    fn write_i32(&mut self, word: i32) {
        self.fold(u64::from(word.cast_unsigned()));
    }

    fn write_u32(&mut self, word: u32) {
        self.fold(u64::from(word));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::hash::BuildHasher as _;

    #[test]
    fn neighbouring_voxels_fill_all_buckets_alike() {
        let build = BuildHasherDefault::<WordHasher>::default();
        let (mut low, mut high) = ([0u32; 256], [0u32; 128]);
        for index in 0..32 * 32 * 32i32 {
            let voxel = glam::IVec3::new(index % 32 - 16, index / 32 % 32, index / 1024 - 5);
            let hash = build.hash_one(voxel);
            low[(hash & 255) as usize] += 1;
            high[(hash >> 57) as usize] += 1;
        }
        // The mean is 128 and 256: within six standard deviations of a random hash.
        assert!(low.iter().all(|count| (60..200).contains(count)), "{low:?}");
        assert!(high.iter().all(|count| (160..352).contains(count)), "{high:?}");
    }
}
