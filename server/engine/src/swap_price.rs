//! What swaps cost: an add to a matrix, or a removal from one, by the square of how full it is.
//!
//! Prices are counted in parts of what a swap of the largest matrix costs, [`PARTS`] of them; below one part a swap is no
//! cheaper, however empty the matrix: its row, its light and its place among its neighbours cost the same anywhere.

use crate::config::EngineConfig;
use crate::levels::LevelPlan;

/// Parts of a swap's price in the largest matrix.
pub(crate) const PARTS: u32 = EngineConfig::CHEAPER_SWAPS_LIMIT;

/// Slots of the largest matrix of `levels`, whose swaps cost the whole price.
pub(crate) fn largest_matrix(levels: &[LevelPlan]) -> u32 {
    levels.iter().map(|plan| plan.capacity).max().unwrap_or(1).max(1)
}

/// Parts that a swap of a matrix with `filled` slots in use costs, where `largest` slots cost [`PARTS`].
pub(crate) fn price(filled: u32, largest: u32) -> u32 {
    let square = |slots: u32| u64::from(slots) * u64::from(slots);
    let parts = (u64::from(PARTS) * square(filled)).div_ceil(square(largest).max(1));
    u32::try_from(parts).unwrap_or(PARTS).clamp(1, PARTS)
}

/// How many adds `parts` pay for, and at which price each, where `residents` slots are in use and at most `most` will be.
pub(crate) fn adds_for(parts: u32, residents: u32, most: u32, largest: u32) -> (u32, u32) {
    let filled = |adds: u32| residents.saturating_add(adds).min(most.max(residents));
    let offers = (1..=PARTS).map(|each| (parts / each, each));
    let mut holding = offers.filter(|&(adds, each)| price(filled(adds), largest) <= each);
    holding.next().unwrap_or((parts / PARTS, PARTS))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swap_costs_by_the_square_of_what_is_there() {
        assert_eq!([price(2048, 2048), price(1024, 2048), price(0, 2048)], [PARTS, 2, 1]);
        assert_eq!(adds_for(32 * PARTS, 2048, 2048, 2048), (32, PARTS));
        assert_eq!(adds_for(32 * PARTS, 0, 2048, 2048), (32 * PARTS, 1));
        assert_eq!(adds_for(32 * PARTS, 1024, 1024, 2048), (128, 2), "what is displaced makes room");
        assert_eq!(adds_for(PARTS - 1, 2048, 2048, 2048).0, 0, "not enough for one");
        for residents in 0..2048 {
            let (adds, each) = adds_for(20 * PARTS, residents, 2048, 2048);
            let filled = f64::from((residents + adds).min(2048)) / 2048.0;
            assert!(adds * each <= 20 * PARTS && adds >= 20, "{residents}: {adds}");
            assert!(f64::from(each) >= (f64::from(PARTS) * filled * filled).ceil(), "{residents}: {each}");
        }
    }
}
