//! Updates of `H` against fresh solves.

use super::*;
use crate::backend::Update;
use crate::bench::Streamed;
use crate::closed_box::ClosedBox;

/// Applies updates in blocks of at most `block`.
fn apply(matrix: &mut LocalMatrix, updates: &[Update], block: usize) {
    for updates in updates.chunks(block) {
        let mut arrivals = Vec::new();
        let mut leaving = Vec::new();
        for update in updates {
            match update {
                Update::Add { slot, reflectance, row, column } => {
                    arrivals.push(Arrival { slot: *slot, reflectance: *reflectance, row, column });
                }
                Update::Remove { slot } => leaving.push(*slot),
            }
        }
        assert_eq!(matrix.add_block(&arrivals).count_ones() as usize, arrivals.len());
        matrix.remove_block(&leaving);
    }
}

fn assert_solved(streamed: &Streamed, matrix: &LocalMatrix, context: &str) {
    let error = streamed.error_of(matrix).expect("small");
    assert!(error.frobenius_rel < 2e-6, "{context}: {error:?}");
}

/// Every entry, free slots included.
fn snapshot(matrix: &LocalMatrix) -> Vec<f32> {
    matrix.planes.iter().flat_map(|plane| plane.iter().copied()).collect()
}

/// Goal: `H` is the fresh solve after any order of updates, for any block size. Method: seeded lives, compared after each phase.
#[test]
fn any_order_of_updates_equals_a_fresh_solve() {
    for (seed, block) in [(1, 1), (2, 2), (3, 5), (4, 8), (5, 17), (6, 32)] {
        let mut streamed = Streamed::new(ClosedBox::new(130, seed), 101, seed);
        let mut matrix = LocalMatrix::new(101).expect("small");
        for (leave, enter) in [(0, 60), (20, 61), (101, 40), (3, 64), (90, 0)] {
            apply(&mut matrix, &streamed.leave(leave), block);
            apply(&mut matrix, &streamed.enter(enter), block);
            assert_eq!(matrix.taken_count(), streamed.taken().len());
            assert_solved(&streamed, &matrix, &format!("block {block}, {leave} out, {enter} in"));
        }
        apply(&mut matrix, &streamed.leave(200), block);
        assert!(snapshot(&matrix).iter().all(|&entry| entry == 0.0), "an empty matrix is zero");
    }
}

#[test]
fn sizes_around_tiles_and_groups_work() {
    for slots in [1, 2, 7, 8, 9, 31, 32, 33, 63, 64, 65] {
        let mut streamed = Streamed::new(ClosedBox::new(slots + 12, 9), slots, 9);
        let mut matrix = LocalMatrix::new(slots as u32).expect("small");
        apply(&mut matrix, &streamed.enter(slots), 32);
        apply(&mut matrix, &streamed.leave(slots / 2), 32);
        apply(&mut matrix, &streamed.enter(slots), 32);
        assert_solved(&streamed, &matrix, &format!("{slots} slots"));
    }
}

#[test]
fn add_then_remove_is_the_identity() {
    let mut streamed = Streamed::new(ClosedBox::new(120, 7), 100, 7);
    let mut matrix = LocalMatrix::new(100).expect("small");
    apply(&mut matrix, &streamed.enter(70), 32);
    let before = snapshot(&matrix);
    let guests = streamed.enter(30);
    apply(&mut matrix, &guests, 32);
    assert_ne!(snapshot(&matrix), before);
    let goodbye: Vec<Update> = guests
        .iter()
        .map(|update| match update {
            Update::Add { slot, .. } | Update::Remove { slot } => Update::Remove { slot: *slot },
        })
        .collect();
    apply(&mut matrix, &goodbye, 32);
    let most = before.iter().copied().fold(0.0, f32::max);
    for (after, before) in snapshot(&matrix).iter().zip(&before) {
        assert!((after - before).abs() < 1e-6 * most, "{after} was {before}");
    }
}

/// Goal: a block is its patches one by one. Method: the same updates at both sizes, entry by entry.
#[test]
fn blocks_equal_singles() {
    let mut streamed = Streamed::new(ClosedBox::new(150, 8), 90, 8);
    let (mut blocks, mut singles) =
        (LocalMatrix::new(90).expect("small"), LocalMatrix::new(90).expect("small"));
    for (leave, enter) in [(0, 90), (32, 32), (10, 9)] {
        for updates in [streamed.leave(leave), streamed.enter(enter)] {
            apply(&mut blocks, &updates, 32);
            apply(&mut singles, &updates, 1);
        }
    }
    let most = snapshot(&singles).iter().copied().fold(0.0, f32::max);
    for (block, single) in snapshot(&blocks).iter().zip(&snapshot(&singles)) {
        assert!((block - single).abs() < 2e-6 * most, "{block} for {single}");
    }
}

/// Goal: the comparison compares. Method: after 50 swaps the sources' update is off by more than a percent, and bright.
#[test]
fn the_truncated_update_is_visibly_wrong() {
    let mut streamed = Streamed::new(ClosedBox::new(120, 10), 60, 10);
    let mut matrix = LocalMatrix::new(60).expect("small");
    let truncated = |matrix: &mut LocalMatrix, updates: Vec<Update>| {
        for update in updates {
            match update {
                Update::Add { slot, reflectance, row, column } => {
                    matrix.add_truncated(&Arrival { slot, reflectance, row: &row, column: &column });
                }
                Update::Remove { slot } => matrix.remove_truncated(slot),
            }
        }
    };
    truncated(&mut matrix, streamed.enter(60));
    for _ in 0..50 {
        truncated(&mut matrix, streamed.leave(1));
        truncated(&mut matrix, streamed.enter(1));
    }
    let error = streamed.error_of(&matrix).expect("small");
    assert!(error.irradiance_rel > 0.01, "{error:?}");
    let light = |entry: &dyn Fn(Slot, Slot) -> f64| -> f64 {
        streamed
            .taken()
            .iter()
            .flat_map(|&i| streamed.taken().into_iter().map(move |j| (i, j)))
            .map(|(i, j)| entry(i, j))
            .sum()
    };
    let mut exact = LocalMatrix::new(60).expect("small");
    std::mem::swap(&mut exact.rows, &mut matrix.rows);
    exact.taken.clone_from(&matrix.taken);
    exact.reflectance.clone_from(&matrix.reflectance);
    exact.extent = matrix.extent;
    exact.resolve().expect("regular");
    let (wrong, right) =
        (light(&|i, j| f64::from(matrix.entry(1, i, j))), light(&|i, j| f64::from(exact.entry(1, i, j))));
    assert!(wrong > 1.01 * right, "{wrong} for {right}");
}
