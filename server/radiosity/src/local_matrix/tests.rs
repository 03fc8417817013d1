//! Updates of `H` against fresh solves.

use super::*;
use crate::backend::{Repaired, Update};
use crate::bench::Streamed;
use crate::closed_box::ClosedBox;
use crate::exchange::entry_at;
use earthshine_world::random::{Purpose, hash, unit_f32};

/// Applies updates in blocks of at most `block`.
fn apply(matrix: &mut LocalMatrix, updates: &[Update], block: usize) {
    for updates in updates.chunks(block) {
        let mut arrivals = Vec::new();
        let mut leaving = Vec::new();
        for update in updates {
            match update {
                Update::Add { slot, reflectance, area, row, column: _ } => {
                    arrivals.push(Arrival { slot: *slot, reflectance: *reflectance, area: *area, row });
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

/// Goal: patches of any size side by side. Method: areas from 1e-4 to 1 m2, light compared row by row, so that no
/// large patch hides the error of a small one.
#[test]
fn areas_four_decades_apart_stay_exact() {
    for block in [1, 5, 32] {
        let mut streamed = Streamed::new(ClosedBox::uneven(150, 12, 1e-4), 110, 12);
        let areas: Vec<f32> = (0..150).map(|patch| streamed.room().area(patch)).collect();
        let (least, most) = areas.iter().fold((f32::MAX, 0.0f32), |(a, b), &area| (a.min(area), b.max(area)));
        assert!(most > 3e3 * least, "{least}..{most} m2");
        let mut matrix = LocalMatrix::new(110).expect("small");
        for (leave, enter) in [(0, 110), (50, 45), (20, 25)] {
            apply(&mut matrix, &streamed.leave(leave), block);
            apply(&mut matrix, &streamed.enter(enter), block);
        }
        assert_solved(&streamed, &matrix, &format!("block {block}"));
        let solved = streamed.solved(1).expect("small");
        for (i, receiver) in matrix.taken_slots().enumerate() {
            let (mut wrong, mut right) = (0.0, 0.0);
            for (j, sender) in matrix.taken_slots().enumerate() {
                wrong += (f64::from(matrix.entry(1, receiver, sender)) - solved.row(i)[j]).abs();
                right += solved.row(i)[j];
            }
            assert!(wrong < 1e-5 * right, "{receiver:?}: {wrong} of {right}");
        }
    }
}

/// Goal: what two patches exchange is the same both ways, to the bit, whatever happened. Method: the stored matrix
/// after a life and a repair, diagonal tiles included.
#[test]
fn the_exchange_is_symmetric() {
    let mut streamed = Streamed::new(ClosedBox::new(190, 13), 150, 13);
    let mut matrix = LocalMatrix::new(150).expect("small");
    for (leave, enter) in [(0, 150), (70, 40), (3, 20)] {
        apply(&mut matrix, &streamed.leave(leave), 32);
        apply(&mut matrix, &streamed.enter(enter), 32);
    }
    matrix.repair(64);
    for (a, b) in (0..150).flat_map(|a| (0..a).map(move |b| (a, b))) {
        let (forth, back) = (matrix.planes[2][entry_at(a, b)], matrix.planes[2][entry_at(b, a)]);
        assert_eq!(forth.to_bits(), back.to_bits(), "{a} and {b}");
    }
}

/// Goal: a repair brings drift down, in bounded steps, between updates. Method: every entry off by up to a thousandth
/// (seeded, symmetric), as 1e-3 of drift would have it.
#[test]
fn a_repair_takes_noise_away() {
    let mut streamed = Streamed::new(ClosedBox::new(220, 14), 200, 14);
    let mut matrix = LocalMatrix::new(200).expect("small");
    apply(&mut matrix, &streamed.enter(190), 32);
    apply(&mut matrix, &streamed.leave(20), 32);
    for (a, b) in (0..200).flat_map(|a| (0..=a).map(move |b| (a, b))) {
        let noise = 2e-3 * (unit_f32(hash(5, Purpose::Simulation, a as u64, b as u64)) - 0.5);
        (0..3).for_each(|channel| matrix.corrupt(channel, a, b, 1.0 + noise));
    }
    let before = streamed.error_of(&matrix).expect("small").frobenius_rel;
    assert!((1e-4..1e-2).contains(&before) && matrix.drift(1) > 1e-5, "{before} {}", matrix.drift(1));
    let first = matrix.repair(40);
    assert_eq!(first, Repaired { columns: 32, is_complete: false });
    apply(&mut matrix, &streamed.leave(5), 32);
    apply(&mut matrix, &streamed.enter(5), 32);
    let mut columns = first.columns;
    let mut calls = 1;
    while !matrix.repair(64).is_complete {
        calls += 1;
        columns += 64;
        assert!(calls < 10, "a round ends");
    }
    assert!(columns >= 128, "{columns} before the last call");
    let after = streamed.error_of(&matrix).expect("small").frobenius_rel;
    assert!(after < 1e-5 && matrix.drift(1) < 1e-6, "{before} became {after}, {}", matrix.drift(1));
}

#[test]
fn sizes_around_tiles_and_groups_work() {
    for slots in [1, 2, 7, 8, 9, 31, 32, 33, 63, 64, 65, 127, 128, 129] {
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
                Update::Add { slot, reflectance, area, row, column: _ } => {
                    matrix.add_truncated(&Arrival { slot, reflectance, area, row: &row });
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
    exact.areas.clone_from(&matrix.areas);
    exact.extent = matrix.extent;
    exact.resolve().expect("regular");
    let (wrong, right) =
        (light(&|i, j| f64::from(matrix.entry(1, i, j))), light(&|i, j| f64::from(exact.entry(1, i, j))));
    assert!(wrong > 1.01 * right, "{wrong} for {right}");
}
