//! Held against the masses themselves: what a table gives each item, summed over its bins, is the item's mass.

use super::*;
use crate::closed_box::ClosedBox;
use crate::tables::draw::{Spread, random, row_key};
use crate::tables::edge_rows::{EdgeRow, edge_rows};
use crate::tables::{SweepScratch, merge, split_pack};

/// Rows as a room has them, besides those that are hard.
fn rows() -> Vec<EdgeRow> {
    let room = ClosedBox::new(700, 3);
    let of_room = (0..40).map(|i| EdgeRow {
        name: "a room's",
        weights: (0..room.len()).map(|j| room.form_factor(i, j)).collect(),
    });
    edge_rows().into_iter().chain(of_room).collect()
}

/// Goal: no mass is lost or invented. Method: for each item the mass over all bins is exactly its integer mass.
#[test]
fn the_mass_over_all_bins_is_the_items_mass() {
    for row in rows().iter().filter(|row| row.weights.len() <= SECTION_ITEMS_MAX) {
        let (mut masses, mut bins) =
            (vec![0; row.weights.len()], vec![AliasBin::default(); row.weights.len()]);
        masses_of(&row.weights, row.weights.len() as u32 * UNITS, &mut masses);
        sweep(&masses, &mut SweepScratch::default(), &mut bins);
        let found = bin_masses(&bins);
        assert!(found.iter().zip(&masses).all(|(&found, &mass)| found == u64::from(mass)), "{}", row.name);
    }
}

/// Goal: a GPU's builders make this table. Method: bits of all three forms, at part counts that divide nothing.
#[test]
fn every_builder_makes_the_same_bits() {
    for row in rows().iter().filter(|row| row.weights.len() <= SECTION_ITEMS_MAX) {
        let n = row.weights.len();
        let mut masses = vec![0; n];
        masses_of(&row.weights, row.weights.len() as u32 * UNITS, &mut masses);
        let mut expected = vec![AliasBin::default(); n];
        sweep(&masses, &mut SweepScratch::default(), &mut expected);
        let mut bins = vec![AliasBin(u32::MAX); n];
        merge(&masses, &mut bins);
        assert!(bins == expected, "merge, {}", row.name);
        for parts in [1, 2, 7, 64, 256] {
            bins.fill(AliasBin(u32::MAX));
            split_pack(&masses, parts, &mut bins);
            assert!(bins == expected, "{parts} parts, {}", row.name);
        }
    }
}

#[test]
fn shares_are_the_weights_also_across_sections() {
    for row in rows() {
        let mut table = AliasTable::default();
        assert_eq!(table.rebuild(&row.weights, &mut BuildRoom::default()), Ok(0));
        let total: f64 = row.weights.iter().map(|&weight| f64::from(weight)).sum();
        if total == 0.0 {
            assert_eq!(table.total(), 0.0, "{}", row.name);
            continue;
        }
        let n = row.weights.len() as f64;
        for (item, (share, &weight)) in table.shares().iter().zip(&row.weights).enumerate() {
            let error_bins = (share - f64::from(weight) / total).abs() * n;
            assert!(error_bins < 0.03, "{} {item}: {error_bins}", row.name);
            assert!(weight > 0.0 || *share == 0.0, "{} {item}", row.name);
        }
    }
}

#[test]
fn equal_weights_keep_everything() {
    let mut table = AliasTable::default();
    table.rebuild(&[0.01; 300], &mut BuildRoom::default()).expect("finite");
    assert!(table.bins().iter().zip(0..).all(|(bin, place)| *bin == AliasBin::new(place, UNITS, 9)));
}

/// Goal: draws follow the table. Method: as many systematic draws as resolve every unit of a few items' bins.
#[test]
fn draws_come_as_often_as_weights_say() {
    let weights = [0.5, 0.0, 0.125, 0.25, 0.125];
    let mut table = AliasTable::default();
    table.rebuild(&weights, &mut BuildRoom::default()).expect("finite");
    let count = 1u32 << 20;
    let mut counts = [0u32; 5];
    for sample in 0..count {
        counts[table.draw(random(row_key(1, 1, 1), sample, count, Spread::Systematic))] += 1;
    }
    for (count_of_item, weight) in counts.iter().zip(weights) {
        let share = f64::from(*count_of_item) / f64::from(count);
        assert!((share - f64::from(weight)).abs() < 1e-4, "{counts:?}");
    }
    assert_eq!(counts[1], 0);
}

#[test]
fn sections_are_drawn_by_their_totals() {
    let weights: Vec<f32> = (0..10_000).map(|i| if i < 5000 { 1.0 } else { 0.25 }).collect();
    let mut table = AliasTable::default();
    table.rebuild(&weights, &mut BuildRoom::default()).expect("finite");
    let draws = 200_000u32;
    let low = (0..draws)
        .filter(|&sample| table.draw(random(row_key(3, 4, 5), sample, draws, Spread::Independent)) < 5000)
        .count();
    assert!((low as f64 / f64::from(draws) - 0.8).abs() < 0.004, "{low}");
}

#[test]
fn weights_that_cannot_be_are_named_and_negative_ones_counted() {
    let mut table = AliasTable::default();
    table.rebuild(&[0.5, 0.25], &mut BuildRoom::default()).expect("finite");
    let before = table.bins().to_vec();
    let error = table.rebuild(&[0.5, f32::NAN], &mut BuildRoom::default()).expect_err("no number");
    assert!(matches!(error, TableError::NotFinite { item: 1, .. }), "{error}");
    assert!(table.rebuild(&[f32::INFINITY], &mut BuildRoom::default()).is_err());
    assert!(table.bins() == before && table.total() == 0.75, "a refused row changes nothing");
    assert_eq!(table.rebuild(&[0.5, -1e-9, 0.5], &mut BuildRoom::default()), Ok(1));
    assert_eq!(table.shares(), [0.5, 0.0, 0.5]);
}
