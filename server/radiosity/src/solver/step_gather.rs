//! One bounce of every row, exactly: the classic iterated sparse product, a bounce a frame with warm start.

use super::links::LinkRows;
use super::{Light, add_scaled};
use rayon::prelude::*;

/// Light that is as good as none, lx: the least that clients are told.
pub const DARKEST: f32 = 1e-6;
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

/// What a bounce changed, as a share of each patch's light: the mean square over `taken` patches, of the worst channel.
///
/// A patch's light is its brightest channel, as it is for the code that clients are told; below [`DARKEST`] nobody can tell.
/// Not a share of all light: a dark corner of a bright room is the last that light comes to. A mean nevertheless: one dark patch
/// among thousands may still change by their root times as much.
pub fn change(old: &[Light], new: &[Light], taken: usize) -> f64 {
    let mut squares = [0.0f64; 3];
    for (old, new) in old.iter().zip(new) {
        let light = new[..3].iter().fold(DARKEST, |light, channel| light.max(channel.abs()));
        for ((square, new), old) in squares.iter_mut().zip(new).zip(old) {
            *square += f64::from((new - old) / light).powi(2);
        }
    }
    squares.into_iter().fold(0.0, f64::max) / taken.max(1) as f64
}
