//! Where the numbers of the exchange matrix lie: the lower triangle, in tiles.
//!
//! ```text
//! tile (0,0)                          a stripe is TILE_EDGE rows: its tiles lie one after the other,
//! tile (1,0)  tile (1,1)              stripe after stripe, each tile row-major;
//! tile (2,0)  tile (2,1)  tile (2,2)  diagonal tiles are whole, both halves kept equal
//! ```
//!
//! So a stripe is one stream through memory, and what is above the diagonal is never stored: with `M` slots a plane
//! takes `2 M (M + 64)` bytes, rounded up to whole tiles. No arithmetic here.

use std::ops::Range;

/// Rows and columns of a tile: 16 KiB, half of the nearest cache of most cores.
pub(crate) const TILE_EDGE: usize = 64;
/// Numbers in a tile.
pub(crate) const TILE_LEN: usize = TILE_EDGE * TILE_EDGE;
/// Most patches that enter or leave together, and the width of matrices with one column for each.
pub(crate) const BLOCK: usize = 32;

/// Where the tile begins whose rows are those of stripe `row` and whose columns are those of stripe `column <= row`.
pub(crate) fn tile_at(row: usize, column: usize) -> usize {
    stripe_at(row) + column * TILE_LEN
}

/// Where a stripe begins; for the number of stripes, how many numbers a plane has.
pub(crate) fn stripe_at(stripe: usize) -> usize {
    stripe * (stripe + 1) / 2 * TILE_LEN
}

/// Where entry `(a, b)` is, or its mirror image `(b, a)`.
pub(crate) fn entry_at(a: usize, b: usize) -> usize {
    // Within a diagonal tile both exist; either will do.
    let (row, column) = if a / TILE_EDGE >= b / TILE_EDGE { (a, b) } else { (b, a) };
    tile_at(row / TILE_EDGE, column / TILE_EDGE) + row % TILE_EDGE * TILE_EDGE + column % TILE_EDGE
}

/// Copies what is below the diagonal of a diagonal tile above it.
pub(crate) fn mirror_diagonal(tile: &mut [[f32; TILE_EDGE]]) {
    for row in 1..tile.len() {
        let (above, below) = tile.split_at_mut(row);
        for (above, &entry) in above.iter_mut().zip(&below[0]) {
            above[row] = entry;
        }
    }
}

/// Calls `work` with each of `stripes` and its tiles, on rayon's threads. `plane` begins with the first stripe.
pub(crate) fn for_each_stripe(
    plane: &mut [f32],
    stripes: Range<usize>,
    work: &(impl Fn(usize, &mut [f32]) + Sync),
) {
    if stripes.len() <= 1 {
        if let Some(stripe) = stripes.clone().next() {
            work(stripe, &mut plane[..(stripe + 1) * TILE_LEN]);
        }
        return;
    }
    let first = stripe_at(stripes.start);
    let middle = middle_of(&stripes);
    let (above, below) = plane.split_at_mut(stripe_at(middle) - first);
    rayon::join(
        || for_each_stripe(above, stripes.start..middle, work),
        || for_each_stripe(below, middle..stripes.end, work),
    );
}

/// A stripe within, not at the start of, `stripes` that has about as many tiles before it as after.
fn middle_of(stripes: &Range<usize>) -> usize {
    let (first, last) = (stripe_at(stripes.start), stripe_at(stripes.end));
    (stripes.start + 1..stripes.end - 1)
        .find(|&middle| 2 * stripe_at(middle) >= first + last)
        .unwrap_or(stripes.end - 1)
}

/// Cuts `stripe_count` stripes into at most `most` bands of about as many tiles each; says where each ends.
pub(crate) fn bands(stripe_count: usize, most: usize) -> impl Iterator<Item = Range<usize>> {
    let all = stripe_at(stripe_count);
    let mut start = 0;
    (1..=most).filter_map(move |band| {
        let first = start;
        while start < stripe_count && stripe_at(start) * most < all * band {
            start += 1;
        }
        (first < start).then_some(first..start)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_has_one_place_and_diagonal_tiles_two() {
        let slots = 3 * TILE_EDGE;
        let mut seen = vec![0u32; stripe_at(3)];
        for (a, b) in (0..slots).flat_map(|a| (0..slots).map(move |b| (a, b))) {
            seen[entry_at(a, b)] += 1;
        }
        // Off the diagonal a pair and its mirror image share a place.
        assert!(seen[tile_at(1, 0)..tile_at(1, 1)].iter().all(|&count| count == 2));
        assert!(seen[tile_at(1, 1)..tile_at(2, 0)].iter().all(|&count| count == 1));
        assert!(seen.iter().all(|&count| count > 0));
        assert_eq!(entry_at(130, 5), entry_at(5, 130));
    }

    #[test]
    fn stripes_and_bands_cover_everything_once() {
        for stripes in [0, 1, 2, 3, 7, 20] {
            let mut plane = vec![0.0; stripe_at(stripes)];
            for_each_stripe(&mut plane, 0..stripes, &|stripe, tiles| {
                assert_eq!(tiles.len(), (stripe + 1) * TILE_LEN);
                tiles.iter_mut().for_each(|entry| *entry += 1.0 + stripe as f32);
            });
            for stripe in 0..stripes {
                let tiles = &plane[stripe_at(stripe)..stripe_at(stripe + 1)];
                assert!(tiles.iter().all(|&entry| entry == 1.0 + stripe as f32));
            }
            let bands: Vec<Range<usize>> = bands(stripes, 5).collect();
            assert!(bands.len() <= 5 && bands.iter().all(|band| !band.is_empty()));
            assert!(bands.iter().flat_map(Clone::clone).eq(0..stripes), "{bands:?}");
        }
    }

    #[test]
    fn a_mirrored_tile_is_symmetric() {
        let mut tile: Vec<f32> = (0..TILE_LEN).map(|at| at as f32).collect();
        mirror_diagonal(tile.as_chunks_mut().0);
        assert_eq!((tile[3], tile[3 * TILE_EDGE]), (192.0, 192.0));
    }
}
