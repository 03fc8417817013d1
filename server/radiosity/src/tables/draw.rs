//! Random bits for draws: a counter-based hash in 32-bit words, which WGSL repeats bit for bit.
//!
//! The other numbers of the project are 64-bit hashes ([`earthshine_world::random`]); shaders have no 64-bit words.

/// How the draws of one row and frame are spread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spread {
    /// Each for itself.
    Independent,
    /// Evenly along the table from one random start: over a table in Morton order every part of space gets its share.
    Systematic,
}

/// Permutes 32 bits well. PCG's RXS-M-XS output over one step of its generator (O'Neill 2014; Jarzynski and Olano 2020).
#[must_use]
pub const fn mix(bits: u32) -> u32 {
    let state = bits.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// What all draws of `row` in `frame` start from.
#[must_use]
pub const fn row_key(seed: u32, frame: u32, row: u32) -> u32 {
    mix(row.wrapping_add(mix(frame.wrapping_add(mix(seed)))))
}

/// The random bits of draw `sample` of `samples` with key `key`; `samples` is at least 1.
#[must_use]
pub const fn random(key: u32, sample: u32, samples: u32, spread: Spread) -> u32 {
    match spread {
        Spread::Independent => mix(key.wrapping_add(sample)),
        // Strata of 2^32 / samples, rounded down; of one sample the stratum is all, and sample 0 stays where it is.
        Spread::Systematic => {
            let stratum = ((u32::MAX - samples + 1) / samples).wrapping_add(1);
            mix(key).wrapping_add(sample.wrapping_mul(stratum))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_uniform_and_rows_and_frames_differ() {
        let mut counts = [0u32; 16];
        for sample in 0..16_000 {
            counts[(random(row_key(1, 2, 3), sample, 16_000, Spread::Independent) >> 28) as usize] += 1;
        }
        // A thousand each; the standard deviation is 31.
        assert!(counts.iter().all(|count| (850..1150).contains(count)), "{counts:?}");
        assert_ne!(row_key(1, 2, 3), row_key(1, 3, 2));
        assert_ne!(row_key(1, 2, 3), row_key(2, 2, 3));
    }

    #[test]
    fn systematic_draws_share_out_the_range() {
        for samples in [1, 3, 16, 32, 100] {
            let mut all: Vec<u32> =
                (0..samples).map(|s| random(row_key(7, 8, 9), s, samples, Spread::Systematic)).collect();
            all.sort_unstable();
            let even = u32::MAX / samples;
            assert!(all.windows(2).all(|pair| pair[1] - pair[0] <= even + 1 + samples), "{samples}");
        }
    }

    /// Goal: the bits are what a shader makes. Method: values of this hash computed by hand in 64-bit arithmetic.
    #[test]
    fn the_hash_is_pcg() {
        for bits in [0u32, 1, 0xDEAD_BEEF, u32::MAX] {
            let state = (u64::from(bits) * 747_796_405 + 2_891_336_453) & 0xFFFF_FFFF;
            let word = (((state >> ((state >> 28) + 4)) ^ state) * 277_803_737) & 0xFFFF_FFFF;
            assert_eq!(u64::from(mix(bits)), (word >> 22) ^ word);
        }
        assert_eq!(mix(0), 129_708_002);
    }
}
