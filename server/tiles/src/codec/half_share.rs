//! Shares in 16 bits: `f16` after scaling by a power of two.
//!
//! `f16` alone loses precision below 6e-5 and everything below 6e-8, and small shares are most of a
//! row. Scaled so that the group's largest share lands in [2^14, 2^15), shares down to 2^-29 of it keep
//! all 11 bits. Rounding is to the nearest, until the errors of a row add up to [`CARRY_MAX`]: then
//! shares round to the other side while that brings the sum back. A row of a thousand equal shares
//! would else be off by up to 1/2048.

use half::f16;

/// Sum of rounding errors from which on a row is steered back.
const CARRY_MAX: f32 = 2e-5;
/// Scaled shares are below two to this.
const TOP_EXPONENT: i32 = 15;
/// Exponents that a group may have: its largest share is [`crate::limits::SHARE_MAX`] at most.
pub(crate) const EXPONENTS: std::ops::RangeInclusive<i32> = 13..=100;
/// High byte of the largest finite `f16`; above it are infinities, NaN and negative numbers.
pub(crate) const HIGH_BYTE_MAX: u8 = 0x7B;

/// Two to `exponent`, which is between -126 and 127.
pub(crate) fn power_of_two(exponent: i32) -> f32 {
    f32::from_bits(((exponent + 127).cast_unsigned()) << 23)
}

/// The exponent for a group whose largest share is `largest`.
pub(crate) fn exponent_for(largest: f32) -> i32 {
    let above = (largest.to_bits() >> 23).cast_signed() - 126;
    (TOP_EXPONENT - above).clamp(*EXPONENTS.start(), *EXPONENTS.end())
}

/// Appends the bits of one row's shares to `high` and `low`.
pub(crate) fn encode_row(shares: &[f32], exponent: i32, high: &mut Vec<u8>, low: &mut Vec<u8>) {
    let scale = power_of_two(exponent);
    let carry_max = CARRY_MAX * scale;
    let mut carry = 0.0f32;
    for &share in shares {
        // Plus zero: a negative zero is a zero.
        let scaled = share * scale + 0.0;
        let mut half = f16::from_f32(scaled);
        let mut after = carry + (scaled - half.to_f32());
        if after.abs() > carry_max && half.to_f32() != scaled {
            // The neighbour on the other side of `scaled`: bits of non-negative floats ascend with them.
            let other = f16::from_bits(if half.to_f32() < scaled {
                half.to_bits().saturating_add(1)
            } else {
                half.to_bits().saturating_sub(1)
            });
            let other_after = carry + (scaled - other.to_f32());
            if other_after.abs() < after.abs() {
                (half, after) = (other, other_after);
            }
        }
        carry = after;
        let [low_byte, high_byte] = half.to_bits().to_le_bytes();
        high.push(high_byte);
        low.push(low_byte);
    }
}

/// Appends the shares whose bits are in `high` and `low`.
///
/// The bits of a non-negative `f16`, moved to where an `f32` has them, are its value times 2^-112, for
/// normal and subnormal numbers alike; one multiplication undoes that and the scale. No branch, no call.
pub(crate) fn decode(high: &[u8], low: &[u8], exponent: i32, shares: &mut Vec<f32>) {
    let scale = power_of_two(112 - exponent);
    shares.extend(high.iter().zip(low).map(|(&high, &low)| {
        let bits = u32::from(high) << 8 | u32::from(low);
        f32::from_bits(bits << 13) * scale
    }));
}

/// `value` with 16 of its 23 bits of mantissa: its lowest byte becomes zero and costs nothing.
pub(crate) fn rounded(value: f32) -> f32 {
    f32::from_bits((value.to_bits() + 0x7F + ((value.to_bits() >> 8) & 1)) & !0xFF)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round_trip(shares: &[f32]) -> Vec<f32> {
        let exponent = exponent_for(shares.iter().copied().fold(0.0, f32::max));
        assert!(EXPONENTS.contains(&exponent), "{exponent}");
        let (mut high, mut low, mut back) = (vec![], vec![], vec![]);
        encode_row(shares, exponent, &mut high, &mut low);
        assert!(high.iter().all(|&byte| byte <= HIGH_BYTE_MAX));
        decode(&high, &low, exponent, &mut back);
        back
    }

    #[test]
    fn decoding_agrees_with_the_half_crate_for_all_finite_values() {
        for bits in 0..=0x7BFF_u16 {
            let [low, high] = bits.to_le_bytes();
            let mut share = vec![];
            decode(&[high], &[low], 20, &mut share);
            assert_eq!(share[0], f16::from_bits(bits).to_f32() * power_of_two(-20), "{bits:04x}");
        }
    }

    #[test]
    fn tiny_shares_beside_large_ones_keep_their_precision() {
        for share in [0.9, 1e-3, 3.3e-5, 6.1e-8, 2.2e-9] {
            let back = round_trip(&[1.0, share])[1];
            assert!((back - share).abs() <= share / 1024.0, "{share} came back as {back}");
        }
        assert_eq!(round_trip(&[0.0, 1.0, 2.0]), [0.0, 1.0, 2.0]);
        assert_eq!(round_trip(&[0.0]), [0.0]);
        assert!(round_trip(&[1e-38])[0] < 1e-30, "below 2^-100 the absolute error is nothing");
    }

    #[test]
    fn equal_shares_do_not_drift() {
        for count in [3, 7, 999, 1000, 1023, 4099] {
            let share = 1.0 / count as f32;
            let back = round_trip(&vec![share; count]);
            let sum: f64 = back.iter().map(|&s| f64::from(s)).sum();
            assert!((sum - 1.0).abs() < 2e-4, "{count}: {sum}");
            assert!(back.iter().all(|&s| (s - share).abs() <= share / 1024.0));
        }
    }

    #[test]
    fn encoding_again_changes_nothing() {
        let shares: Vec<f32> = (1..2000).map(|i| 0.7 / (i * i) as f32).collect();
        let back = round_trip(&shares);
        assert_eq!(round_trip(&back), back);
        for value in [0.0, 1.0, 0.333_333, 1e-20, 0.999_999_9] {
            assert_eq!(rounded(rounded(value)), rounded(value));
            assert!((rounded(value) - value).abs() <= value / 65536.0);
        }
    }
}
