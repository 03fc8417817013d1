//! One bounce of every row, exactly: the classic iterated sparse product, a bounce a frame with warm start.

use super::links::LinkRows;
use super::{Light, add_scaled};
use rayon::prelude::*;

/// Rows a task takes at least.
const ROWS_MIN: usize = 64;

/// `sum_j F_ij sent_j` of one row.
#[inline]
pub fn gathered(links: &LinkRows, slot: usize, sent: &[Light]) -> Light {
    let mut sums = [[0.0f32; 4]; 4];
    let (fours, rest) = links.row(slot).as_chunks::<4>();
    for four in fours {
        for (link, sum) in four.iter().zip(&mut sums) {
            add_scaled(sum, link.share, &sent[link.slot as usize]);
        }
    }
    for link in rest {
        add_scaled(&mut sums[0], link.share, &sent[link.slot as usize]);
    }
    let [a, b, c, d] = sums;
    std::array::from_fn(|channel| (a[channel] + b[channel]) + (c[channel] + d[channel]))
}

/// Writes `outside + F sent` to `next`, free slots zero.
pub fn bounce(links: &LinkRows, sent: &[Light], outside: &[Light], next: &mut [Light]) {
    next.par_iter_mut().with_min_len(ROWS_MIN).enumerate().for_each(|(slot, next)| {
        *next = [0.0; 4];
        if links.is_taken(slot) {
            *next = gathered(links, slot, sent);
            add_scaled(next, 1.0, &outside[slot]);
        }
    });
}

/// `|new - old|^2 / |new|^2` of the worst channel; 0 where nothing changed.
pub fn change(old: &[Light], new: &[Light]) -> f64 {
    let (mut gap, mut norm) = ([0.0f64; 3], [0.0f64; 3]);
    for (old, new) in old.iter().zip(new) {
        for channel in 0..3 {
            let (old, new) = (f64::from(old[channel]), f64::from(new[channel]));
            gap[channel] += (new - old) * (new - old);
            norm[channel] += new * new;
        }
    }
    (0..3).map(|c| if gap[c] == 0.0 { 0.0 } else { gap[c] / norm[c] }).fold(0.0, f64::max)
}
