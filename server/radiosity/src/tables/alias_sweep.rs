//! The sequential builder, oracle of the others: two cursors, one over light items and one over heavy ones.
//!
//! Sweeping after Lehmann, Huebschle-Schneider and Sanders (2021, section 4.2), which is Vose's method without his
//! stacks: items are taken in the row's own order, so the parallel forms make the same table.

use super::alias_table::AliasBin;
use super::masses::UNITS;

/// Room for [`sweep`], kept between rows.
#[derive(Debug, Default, Clone)]
pub struct SweepScratch {
    light: Vec<Item>,
    heavy: Vec<Item>,
}

/// An item and its mass.
#[derive(Debug, Default, Clone, Copy)]
struct Item {
    place: u32,
    mass: u32,
}

/// Fills `bins` for `masses` that sum to `length * UNITS`. O(n), no branch that data decide.
///
/// # Panics
/// If the lengths differ.
pub fn sweep(masses: &[u32], scratch: &mut SweepScratch, bins: &mut [AliasBin]) {
    let n = masses.len();
    assert_eq!(n, bins.len(), "a bin an item");
    let SweepScratch { light, heavy } = scratch;
    // One place more: each list ends with an item that is never placed but may be looked at.
    for list in [&mut *light, &mut *heavy] {
        if list.len() < n + 2 {
            list.resize(n + 2, Item::default());
        }
    }
    let (mut lights, mut heavies) = (0, 0);
    for (place, &mass) in masses.iter().enumerate() {
        let item = Item { place: place as u32, mass };
        light[lights] = item;
        heavy[heavies] = item;
        lights += usize::from(mass < UNITS);
        heavies += usize::from(mass >= UNITS);
    }
    // The sums meet at the last heavy item: it is full, whoever comes after it.
    heavy[heavies] = Item { place: 0, mass: UNITS };
    let (mut i, mut j) = (0, 0);
    let mut left = heavy[0].mass;
    for _ in 0..n {
        // What is left of a heavy item fills the next light one, until it is light itself.
        let is_over = left > UNITS;
        let (next_light, this, next) = (light[i], heavy[j], heavy[j + 1]);
        let placed = if is_over { next_light.place } else { this.place };
        let keep = if is_over { next_light.mass } else { left };
        let alias = if is_over { this.place } else { next.place };
        bins[placed as usize] = AliasBin::new(placed, keep, alias);
        left = left + if is_over { next_light.mass } else { next.mass } - UNITS;
        i += usize::from(is_over);
        j += usize::from(!is_over);
    }
}
