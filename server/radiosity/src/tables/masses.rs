//! Weights of a row as integers: every item's probability in units of a bin's 65,536th part.
//!
//! ```text
//! mass_i = round(weight_i * n * 65536 / total)      half to even
//! ```
//!
//! and the heaviest item takes what rounding left over or short, so that the masses sum to `n * 65536` exactly. From here
//! on tables are integer arithmetic: prefix sums may run in any order, on any number of lanes, and give the same bits.
//! An item is off by at most half a unit, the heaviest by at most `n / 2`: a 32nd of a bin at 4,096 items, and then it
//! holds a bin at least.

/// Units of mass a bin holds.
pub const UNITS: u32 = 1 << 16;

/// Lanes of the sum of weights, as many as a shader's workgroup has: lane `t` takes items `t`, `t + 256`, and so on in
/// turn; then lane `t` takes lane `t + half` for halves 128, 64 .. 1. Sequential `f32` sums of a `1 / x^2` row are wrong
/// by up to 14 % of a bin.
pub const SUM_LANES: usize = 256;

/// A row whose weights sum to less than this has no weight: their reciprocal would not fit.
pub const TOTAL_MIN: f32 = 1e-30;

/// The sum of `weights` in the order that a workgroup sums them; negative weights count as zero.
#[must_use]
pub fn total_of(weights: &[f32]) -> f32 {
    let mut lanes = [0.0f32; SUM_LANES];
    for weights in weights.chunks(SUM_LANES) {
        for (lane, weight) in lanes.iter_mut().zip(weights) {
            *lane += weight.max(0.0);
        }
    }
    let mut half = SUM_LANES / 2;
    while half > 0 {
        let (low, high) = lanes.split_at_mut(half);
        for (low, high) in low.iter_mut().zip(high) {
            *low += *high;
        }
        half /= 2;
    }
    lanes[0]
}

/// Writes the masses of `weights` to `masses` (as long) so that they sum to `all`, at most `2^31`; returns the weights'
/// total. Without weight all items have the same mass and the total is zero.
///
/// # Panics
/// If the lengths differ.
pub fn masses_of(weights: &[f32], all: u32, masses: &mut [u32]) -> f32 {
    assert_eq!(weights.len(), masses.len(), "a mass an item");
    let total = total_of(weights);
    if total < TOTAL_MIN {
        masses.fill(all / weights.len().max(1) as u32);
        return 0.0;
    }
    let scale = all as f32 / total;
    let mut sum = 0u32;
    for (mass, &weight) in masses.iter_mut().zip(weights) {
        // Never fused, so that a shader can repeat it.
        *mass = round_to_u32(weight.max(0.0) * scale);
        sum = sum.wrapping_add(*mass);
    }
    let heaviest = heaviest_of(masses);
    masses[heaviest] = masses[heaviest].wrapping_add(all.wrapping_sub(sum));
    total
}

/// The first item of most mass.
fn heaviest_of(masses: &[u32]) -> usize {
    let most = masses.iter().copied().max().unwrap_or(0);
    masses.iter().position(|&mass| mass == most).unwrap_or(0)
}

/// Nearest integer, ties to even, of a number in `0..2^31`: what WGSL's `round` does.
#[inline]
fn round_to_u32(number: f32) -> u32 {
    /// From here on an `f32` has no fraction.
    const WHOLE: f32 = 8_388_608.0;
    // The sum's own rounding is the rounding; a library call for it would cost more than all the rest.
    let rounded = if number < WHOLE { (number + WHOLE) - WHOLE } else { number };
    rounded as i32 as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tables::edge_rows::edge_rows;

    #[test]
    fn rounding_is_to_even() {
        for number in [0.0f32, 0.49, 0.5, 0.51, 1.5, 2.5, 65535.5, 8_388_607.5, 8_388_609.0, 268_435_440.0] {
            assert_eq!(round_to_u32(number), number.round_ties_even() as u32, "{number}");
        }
    }

    /// Goal: masses sum to what they must, no item is off by more than said, and no weight is no mass.
    #[test]
    fn masses_of_edge_rows_sum_exactly() {
        for row in edge_rows() {
            let n = row.weights.len();
            let mut masses = vec![0; n];
            let total = masses_of(&row.weights, n as u32 * UNITS, &mut masses);
            assert_eq!(masses.iter().map(|&mass| u64::from(mass)).sum::<u64>(), n as u64 * u64::from(UNITS));
            let sum: f64 = row.weights.iter().map(|&weight| f64::from(weight)).sum();
            assert!((f64::from(total) - sum).abs() <= 1e-6 * sum, "{}: {total}, {sum}", row.name);
            if sum == 0.0 {
                continue;
            }
            let heaviest = heaviest_of(&masses);
            for (item, (&mass, &weight)) in masses.iter().zip(&row.weights).enumerate() {
                let exact = f64::from(weight) * n as f64 * f64::from(UNITS) / sum;
                // A rounded product is off by as much as its last bit.
                let most = if item == heaviest { n as f64 / 2.0 + 1.0 } else { 0.5 } + 2e-7 * exact;
                assert!((f64::from(mass) - exact).abs() <= most, "{} {item}: {mass}, {exact}", row.name);
                assert!(weight > 0.0 || mass == 0, "{} {item}", row.name);
            }
        }
    }
}
