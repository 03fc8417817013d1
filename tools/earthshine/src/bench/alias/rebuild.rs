//! What rebuilding tables gains when only half of a world is resident.
//!
//! Rebuilt: a row of its resident columns, one item for all that is far, one for the sky. Not rebuilt: the full row, a
//! draw of a column that is not resident looks at what stands for it. Both bring the same light on average.

use super::LitWorld;
use super::error::{Items, Squares, sampled_rows};
use earthshine_radiosity::tables::draw::{Spread, random, row_key};
use earthshine_radiosity::tables::{AliasTable, BuildRoom, RowTable};
use earthshine_world::Rgb;
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Draws a rebuilt row and frame.
const DRAWS: u32 = 32;
/// Frames of each row.
const FRAMES: u32 = 16;

/// Times are a row's and a frame's, on one core.
#[derive(Debug, Serialize)]
pub(super) struct RebuildWaste {
    resident_share: f64,
    /// Draws of full rows that look at what is not resident.
    pub(super) wasted_share: f64,
    pub(super) rebuilt_ns: f64,
    pub(super) rebuilt_rel_rmse: f64,
    /// As many draws of the full row as take the time of the rebuilt row's.
    pub(super) full_draws: u32,
    pub(super) full_ns: f64,
    pub(super) full_rel_rmse: f64,
    /// One rebuild of one row.
    pub(super) rebuild_ns: f64,
}

struct Row {
    number: usize,
    full: AliasTable,
    /// Item of each column, then the sky.
    items: Items,
    /// Whether each column's patch is resident; the sky counts as such.
    is_resident: Vec<bool>,
    rebuilt: AliasTable,
    rebuilt_items: Items,
}

pub(super) fn measure(lit: &LitWorld, seed: u32) -> anyhow::Result<RebuildWaste> {
    let order = lit.nearest_first();
    let half = order.len().div_ceil(2);
    let mut resident = vec![false; order.len()];
    order[..half].iter().for_each(|&patch| resident[patch as usize] = true);
    let exitance = lit.exitance();
    let rows: Vec<Row> = sampled_rows(lit)
        .filter(|&row| resident[row])
        .map(|row| Row::new(lit, &exitance, &resident, row))
        .collect::<anyhow::Result<_>>()?;
    let (mut wasted, mut all) = (0.0f64, 0.0f64);
    for row in &rows {
        for (&weight, &is_resident) in row.items.weights.iter().zip(&row.is_resident) {
            all += f64::from(weight);
            wasted += if is_resident { 0.0 } else { f64::from(weight) };
        }
    }
    let rebuilt_ns =
        nanoseconds(&rows, |row, key| row.rebuilt_items.drawn(&row.rebuilt, key, DRAWS, Spread::Independent));
    let probe_ns = nanoseconds(&rows, |row, key| row.drawn_in_full(key, DRAWS));
    let full_draws = ((f64::from(DRAWS) * rebuilt_ns / probe_ns).round() as u32).max(1);
    let full_ns = nanoseconds(&rows, |row, key| row.drawn_in_full(key, full_draws));
    let (mut of_rebuilt, mut of_full) = (Squares::default(), Squares::default());
    for row in &rows {
        let exact = row.items.exact();
        for frame in 0..FRAMES {
            let key = row_key(seed, frame, row.number as u32);
            of_rebuilt.add(row.rebuilt_items.drawn(&row.rebuilt, key, DRAWS, Spread::Independent), exact);
            of_full.add(row.drawn_in_full(key, full_draws), exact);
        }
    }
    let mut table = AliasTable::default();
    let mut room = BuildRoom::default();
    let rebuild_ns = nanoseconds(&rows, |row, _| {
        black_box(table.rebuild(&row.rebuilt_items.weights, &mut room).expect("shares are weights"));
        Rgb::splat(table.total())
    });
    Ok(RebuildWaste {
        resident_share: 0.5,
        wasted_share: wasted / all.max(f64::MIN_POSITIVE),
        rebuilt_ns,
        rebuilt_rel_rmse: of_rebuilt.rel_rmse(),
        full_draws,
        full_ns,
        full_rel_rmse: of_full.rel_rmse(),
        rebuild_ns,
    })
}

impl Row {
    fn new(lit: &LitWorld, exitance: &[Rgb], resident: &[bool], row: usize) -> anyhow::Result<Self> {
        let (columns, shares) = lit.rows.row(row);
        let entries = || columns.iter().copied().zip(shares.iter().copied());
        let items = Items::of(lit, exitance, row, entries());
        let near = entries().filter(|&(column, _)| resident[column as usize]);
        let mut rebuilt_items = Items::of(lit, exitance, row, near);
        let far = entries().filter(|&(column, _)| !resident[column as usize]);
        let (mut share, mut light) = (0.0f32, Rgb::ZERO);
        for (column, own) in far {
            share += own;
            light += exitance[column as usize] * own;
        }
        rebuilt_items.weights.push(share);
        rebuilt_items.light.push(if share > 0.0 { light / share } else { Rgb::ZERO });
        let is_resident = columns.iter().map(|&column| resident[column as usize]).chain([true]).collect();
        let (mut full, mut rebuilt, mut room) =
            (AliasTable::default(), AliasTable::default(), BuildRoom::default());
        full.rebuild(&items.weights, &mut room)?;
        rebuilt.rebuild(&rebuilt_items.weights, &mut room)?;
        Ok(Self { number: row, full, items, is_resident, rebuilt, rebuilt_items })
    }

    /// Draws of the full row with the test of residency that it needs. Here a column's parent sends what it sends itself.
    fn drawn_in_full(&self, key: u32, draws: u32) -> Rgb {
        let (mut near, mut far) = (Rgb::ZERO, Rgb::ZERO);
        for sample in 0..draws {
            let item = self.full.draw(random(key, sample, draws, Spread::Independent));
            if self.is_resident[item] {
                near += self.items.light[item];
            } else {
                far += self.items.light[item];
            }
        }
        (near + far) * (self.full.total() / draws as f32)
    }
}

/// Of one call a row, best of several rounds over all.
fn nanoseconds(rows: &[Row], mut work: impl FnMut(&Row, u32) -> Rgb) -> f64 {
    let mut best = f64::INFINITY;
    for round in 0..8 {
        let started = Instant::now();
        for row in rows {
            black_box(work(row, row_key(1, round, row.number as u32)));
        }
        best = best.min(started.elapsed().as_secs_f64() * 1e9 / rows.len().max(1) as f64);
    }
    best
}
