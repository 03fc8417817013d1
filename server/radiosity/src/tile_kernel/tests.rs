//! Every kernel over tiles on every instruction set of this machine against the plain loop.

use super::*;
use crate::exchange::{entry_at, stripe_at};
use crate::simd::InstructionSet;
use earthshine_world::random::{Purpose, hash, unit_f32};

const STRIPES: usize = 3;
const SLOTS: usize = STRIPES * TILE_EDGE;

fn numbers(seed: u64, count: usize) -> Vec<f32> {
    (0..count as u64).map(|i| unit_f32(hash(seed, Purpose::Simulation, i, 0)) - 0.5).collect()
}

/// A symmetric matrix as it is stored.
fn plane(seed: u64) -> Vec<f32> {
    let values = numbers(seed, SLOTS * SLOTS);
    let mut plane = vec![0.0; stripe_at(STRIPES)];
    for (a, b) in (0..SLOTS).flat_map(|a| (0..=a).map(move |b| (a, b))) {
        plane[entry_at(a, b)] = values[a * SLOTS + b];
        plane[entry_at(b, a)] = values[a * SLOTS + b];
    }
    plane
}

fn assert_close(actual: &[f32], expected: &[f64], set: InstructionSet) {
    assert_eq!(actual.len(), expected.len());
    for (at, (&actual, &expected)) in actual.iter().zip(expected).enumerate() {
        assert!((f64::from(actual) - expected).abs() < 1e-5, "{set:?} at {at}: {actual} for {expected}");
    }
}

#[test]
fn a_stripe_update_is_the_plain_product() {
    for depth in [1, 2, 7, BLOCK] {
        let (left, right) = (numbers(1, TILE_EDGE * BLOCK), numbers(2, 2 * depth * TILE_EDGE));
        let before = numbers(3, 2 * TILE_LEN);
        let mut expected: Vec<f64> = before.iter().map(|&entry| f64::from(entry)).collect();
        for (at, entry) in expected.iter_mut().enumerate() {
            let (tile, row, column) = (at / TILE_LEN, at % TILE_LEN / TILE_EDGE, at % TILE_EDGE);
            *entry += (0..depth)
                .map(|k| {
                    let right = right[(tile * depth + k) * TILE_EDGE + column];
                    f64::from(left[row * BLOCK + k]) * f64::from(right)
                })
                .sum::<f64>();
        }
        for set in InstructionSet::available() {
            let mut tiles = before.clone();
            let mut finished = Vec::new();
            let finish = |place: usize, tile: &mut [f32]| finished.push((place, tile[5]));
            f32::dispatch(set, StripeUpdate { tiles: &mut tiles, left: &left, right: &right, depth, finish });
            assert_close(&tiles, &expected, set);
            assert_eq!(finished, [(0, tiles[5]), (1, tiles[TILE_LEN + 5])], "finished once, when done");
        }
    }
}

#[test]
fn gathered_stripes_are_the_plain_product() {
    let plane = plane(4);
    // All of the first stripe, none of the second, some of the third.
    let slots: Vec<u32> =
        (0..SLOTS as u32).filter(|slot| *slot < 64 || *slot % 5 == 2 && *slot >= 128).collect();
    let starts = [0, 64, 64, slots.len() as u32];
    let operand = numbers(5, slots.len() * BLOCK);
    for stripe in 0..STRIPES {
        let mut expected = vec![0.0f64; TILE_EDGE * BLOCK];
        for (at, entry) in expected.iter_mut().enumerate() {
            let (row, lane) = (stripe * TILE_EDGE + at / BLOCK, at % BLOCK);
            let terms = slots.iter().enumerate().map(|(k, &slot)| {
                f64::from(plane[entry_at(row, slot as usize)]) * f64::from(operand[k * BLOCK + lane])
            });
            *entry = terms.sum();
        }
        for set in InstructionSet::available() {
            let mut out = vec![9.0; TILE_EDGE * BLOCK];
            let named = NamedColumns { slots: &slots, starts: &starts, operand: &operand };
            f32::dispatch(set, StripeGather { plane: &plane, stripe, named, out: &mut out });
            assert_close(&out, &expected, set);
        }
    }
}

/// Goal: what is dark or not wanted is skipped and never changes what is wanted, to the bit. Method: three patterns
/// of light and interest; tiles that need not be read hold what is not a number.
#[test]
fn band_products_read_what_they_need() {
    let x = numbers(6, SLOTS);
    let all = [u64::MAX; STRIPES];
    let patterns: [([u64; 3], [u64; 3]); 4] =
        [(all, all), ([0xf0, 0, 0], all), (all, [0, 0, 3]), ([1 << 63, 0, 0], [0, 7, 0])];
    for (lit, wanted) in patterns {
        let has = |bits: &[u64; 3], slot: usize| bits[slot / TILE_EDGE] >> (slot % TILE_EDGE) & 1 == 1;
        let x: Vec<f32> = (0..SLOTS).map(|slot| if has(&lit, slot) { x[slot] } else { 0.0 }).collect();
        let mut plane = plane(7);
        for stripe in 0..STRIPES {
            for column in 0..=stripe {
                let forth = lit[column] != 0 && wanted[stripe] != 0;
                let back = lit[stripe] != 0 && wanted[column] != 0;
                if !(forth || back) {
                    plane[tile_at(stripe, column)..][..TILE_LEN].fill(f32::NAN);
                }
            }
        }
        for set in InstructionSet::available() {
            let mut out = vec![0.0; SLOTS];
            for stripes in [0..1, 1..STRIPES] {
                let kernel =
                    BandProduct { plane: &plane, stripes, x: &x, lit: &lit, wanted: &wanted, out: &mut out };
                f32::dispatch(set, kernel);
            }
            for row in (0..SLOTS).filter(|&row| has(&wanted, row)) {
                let terms = (0..SLOTS).filter(|&slot| x[slot] != 0.0);
                let terms = terms.map(|slot| f64::from(plane[entry_at(row, slot)]) * f64::from(x[slot]));
                let expected = terms.sum::<f64>();
                assert!((out[row] - expected).abs() < 1e-5, "{set:?} row {row}: {} for {expected}", out[row]);
            }
        }
    }
}

#[test]
fn block_products_and_sparse_rows_are_the_plain_products() {
    let slots: Vec<u32> = (0..SLOTS as u32).filter(|slot| slot % 3 != 1).collect();
    let (operand, columns) = (numbers(8, slots.len() * BLOCK), numbers(9, SLOTS * BLOCK));
    let mut expected = vec![0.0f64; BLOCK * BLOCK];
    for (at, entry) in expected.iter_mut().enumerate() {
        let terms = slots.iter().enumerate().map(|(k, &slot)| {
            let column = columns[slot as usize * BLOCK + at % BLOCK];
            f64::from(operand[k * BLOCK + at / BLOCK]) * f64::from(column)
        });
        *entry = terms.sum();
    }
    let entries = slots.iter().map(|&slot| (slot as usize, 0.25 * slot as f32 / SLOTS as f32));
    let row: Vec<f64> = (0..BLOCK)
        .map(|lane| {
            let term =
                |(slot, share): (usize, f32)| f64::from(share) * f64::from(columns[slot * BLOCK + lane]);
            entries.clone().map(term).sum()
        })
        .collect();
    for set in InstructionSet::available() {
        let mut out = vec![0.0; BLOCK * BLOCK];
        let kernel = BlockProduct { operand: &operand, slots: &slots, columns: &columns, out: &mut out };
        f32::dispatch(set, kernel);
        let out: Vec<f32> = out.iter().map(|&value| value as f32).collect();
        assert_close(&out, &expected, set);
        let mut out = vec![7.0; BLOCK];
        f32::dispatch(set, SparseRow { entries: entries.clone(), rows: &columns, out: &mut out });
        assert_close(&out, &row, set);
    }
}
