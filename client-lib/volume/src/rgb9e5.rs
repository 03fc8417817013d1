//! RGB9E5: three 9-bit mantissas that share a 5-bit exponent, in 32 bits.
//!
//! As in `EXT_texture_shared_exponent` and Vulkan's `E5B9G9R9_UFLOAT_PACK32`: red in the lowest bits, rounded to
//! nearest. Relative error of the largest channel is at most 2^-9; the others lose what it gains.

use glam::Vec3;

const MANTISSA_BITS: i32 = 9;
const EXPONENT_BIAS: i32 = 15;
const MANTISSA_MASK: u32 = (1 << MANTISSA_BITS) - 1;

/// Largest value of a channel: `511/512 * 2^16`. More is clamped to it.
pub const MAX: f32 = 65408.0;

/// The nearest code of `value`. Negative channels and NaN become 0, infinity becomes [`MAX`].
#[must_use]
pub fn encode(value: Vec3) -> u32 {
    // NaN fails the comparison and becomes 0.
    let channels = value.to_array().map(|channel| if channel > 0.0 { channel.min(MAX) } else { 0.0 });
    let largest = channels.iter().copied().fold(0.0, f32::max);
    let mut exponent = floor_log2(largest).max(-EXPONENT_BIAS - 1) + 1 + EXPONENT_BIAS;
    // Rounding may carry the largest channel over the top of its exponent.
    if (largest / step(exponent)).round() as u32 > MANTISSA_MASK {
        exponent += 1;
    }
    let scale = step(exponent);
    let [red, green, blue] = channels.map(|channel| (channel / scale + 0.5).floor() as u32);
    red | green << 9 | blue << 18 | exponent.cast_unsigned() << 27
}

/// What `code` stands for. Every code is a finite, non-negative colour.
#[must_use]
pub fn decode(code: u32) -> Vec3 {
    let scale = step((code >> 27).cast_signed());
    let channel = |shift: u32| (code >> shift & MANTISSA_MASK) as f32 * scale;
    Vec3::new(channel(0), channel(9), channel(18))
}

/// Value of the lowest mantissa bit: `2^(exponent - 15 - 9)`, built from the bits of an `f32`.
fn step(exponent: i32) -> f32 {
    f32::from_bits((exponent - EXPONENT_BIAS - MANTISSA_BITS + 127).cast_unsigned() << 23)
}

/// Exact for normal numbers; zero and denormal ones give -127.
fn floor_log2(value: f32) -> i32 {
    (value.to_bits() >> 23).cast_signed() - 127
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_codes() {
        assert_eq!(encode(Vec3::ZERO), 0);
        // 1 = 256 * 2^(16 - 24).
        assert_eq!(encode(Vec3::ONE), 256 | 256 << 9 | 256 << 18 | 16 << 27);
        assert_eq!(encode(Vec3::splat(f32::INFINITY)), u32::MAX);
        assert_eq!(decode(u32::MAX), Vec3::splat(MAX));
        assert_eq!(encode(Vec3::new(f32::NAN, -1.0, 0.0)), 0);
    }

    #[test]
    fn every_canonical_code_survives_a_round_trip() {
        // The largest channel in the upper half of its range (or exponent 0) makes a code canonical.
        for exponent in 0..32u32 {
            for mantissa in (0..512u32).step_by(3).chain([511]) {
                let largest = if exponent == 0 { mantissa } else { 256 | mantissa };
                let code =
                    largest | (mantissa >> 1) << 9 | (511 - mantissa).min(largest) << 18 | exponent << 27;
                assert_eq!(encode(decode(code)), code, "{code:032b}");
            }
        }
    }

    #[test]
    fn the_code_is_the_nearest() {
        let mut value = 1e-7f32;
        while value < MAX {
            let colour = Vec3::new(value, value * 0.37, value * 0.011);
            let read = decode(encode(colour));
            // Half a step of the shared exponent, which is at most 2^-9 of the largest channel.
            let half_step = (value / 512.0).max(0.5 * 2f32.powi(-24)) * 1.0001;
            assert!((read - colour).abs().max_element() <= half_step, "{colour} became {read}");
            value *= 1.0137;
        }
    }

    #[test]
    fn rounding_carries_into_the_exponent() {
        // 1.9995 needs mantissa 511.9 at exponent 16, which rounds to 512.
        let code = encode(Vec3::new(1.9995, 0.0, 0.0));
        assert_eq!(decode(code).x, 2.0);
    }
}
