//! Items a second that one core turns from weights into bins.

use super::LitWorld;
use earthshine_radiosity::gather::SparseRows;
use earthshine_radiosity::tables::{
    AliasBin, AliasTable, BuildRoom, CdfTable, RowTable, UNITS, masses::masses_of, merge, split_pack,
};
use earthshine_world::random::{Purpose, hash, unit_f32};
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// A builder goes over its rows again until so much time has passed, s.
const ROUND_SECONDS: f64 = 0.25;
/// Rounds; the best counts, as others use the machine too.
const ROUNDS: u32 = 5;
/// Parts of a row that split and pack: one a thread of a workgroup.
const PARTS: usize = 256;

/// One builder's speed, weights to bins, one thread.
#[derive(Debug, Serialize)]
pub(super) struct Build {
    pub(super) builder: &'static str,
    pub(super) made_up_mitems_s: f64,
    pub(super) world_mitems_s: f64,
}

/// Memory of the tables of the world's rows.
#[derive(Debug, Serialize)]
pub(super) struct Bytes {
    pub(super) alias: f64,
    pub(super) cdf: f64,
}

/// Builds a row's table and returns something of it.
type Builder<'a> = Box<dyn FnMut(&[f32]) -> u32 + 'a>;

/// All builders, the sequential one first.
pub(super) fn measure(lit: &LitWorld, rows: usize, items: usize, seed: u64) -> anyhow::Result<Vec<Build>> {
    let made_up = made_up(rows.max(1), items.max(1), seed)?;
    let (mut alias, mut cdf, mut room) = (AliasTable::default(), CdfTable::default(), BuildRoom::default());
    let both = |builder, mut build: Builder<'_>| Build {
        builder,
        made_up_mitems_s: mitems_s(&made_up, &mut build),
        world_mitems_s: mitems_s(&lit.rows, &mut build),
    };
    let sequential = both(
        "alias, sequential",
        Box::new(|weights| {
            black_box(alias.rebuild(weights, &mut room).expect("shares are weights"));
            alias.bins().first().map_or(0, |bin| bin.0)
        }),
    );
    let mut split_masses = Vec::new();
    let mut split_bins = Vec::new();
    let split = both(
        "alias, split and pack in 256 parts",
        Box::new(|weights| {
            with_masses(weights, &mut split_masses, &mut split_bins, |masses, bins| {
                split_pack(masses, PARTS, bins);
            })
        }),
    );
    let (mut merge_masses, mut merge_bins) = (Vec::new(), Vec::new());
    let merged = both(
        "alias, merge",
        Box::new(|weights| with_masses(weights, &mut merge_masses, &mut merge_bins, merge)),
    );
    let mut room = BuildRoom::default();
    let cumulative = both(
        "cdf",
        Box::new(|weights| {
            black_box(cdf.rebuild(weights, &mut room).expect("shares are weights"));
            cdf.ends().first().copied().unwrap_or(0)
        }),
    );
    Ok(vec![sequential, split, merged, cumulative])
}

/// Bytes an item of tables of the world's rows.
pub(super) fn bytes(lit: &LitWorld) -> anyhow::Result<Bytes> {
    let (mut alias, mut cdf, mut room) = (AliasTable::default(), CdfTable::default(), BuildRoom::default());
    let (mut of_alias, mut of_cdf) = (0, 0);
    for row in 0..lit.rows.row_count() {
        alias.rebuild(lit.rows.row(row).1, &mut room)?;
        cdf.rebuild(lit.rows.row(row).1, &mut room)?;
        of_alias += alias.bytes();
        of_cdf += cdf.bytes();
    }
    let items = lit.rows.nonzero_count().max(1) as f64;
    Ok(Bytes { alias: of_alias as f64 / items, cdf: of_cdf as f64 / items })
}

fn with_masses(
    weights: &[f32],
    masses: &mut Vec<u32>,
    bins: &mut Vec<AliasBin>,
    build: impl Fn(&[u32], &mut [AliasBin]),
) -> u32 {
    masses.resize(weights.len(), 0);
    bins.resize(weights.len(), AliasBin::default());
    masses_of(weights, weights.len() as u32 * UNITS, masses);
    build(masses, bins);
    bins.first().map_or(0, |bin| bin.0)
}

/// Rows like those of a town: a few large shares, many small ones, in no order.
fn made_up(rows: usize, items: usize, seed: u64) -> anyhow::Result<SparseRows> {
    let columns = (0..rows).flat_map(|_| (0..items).map(|item| (item % rows) as u32)).collect();
    let share = |at: u64| unit_f32(hash(seed, Purpose::Simulation, at, 2)).powi(4).max(1e-6) / items as f32;
    let shares = (0..(rows * items) as u64).map(share).collect();
    Ok(SparseRows::new((0..=rows).map(|row| row * items).collect(), columns, shares)?)
}

fn mitems_s(rows: &SparseRows, build: &mut dyn FnMut(&[f32]) -> u32) -> f64 {
    let round = |build: &mut dyn FnMut(&[f32]) -> u32| {
        let (started, mut items, mut row) = (Instant::now(), 0, 0);
        loop {
            let weights = rows.row(row).1;
            black_box(build(weights));
            items += weights.len();
            row = (row + 1) % rows.row_count();
            if row.is_multiple_of(64) && started.elapsed().as_secs_f64() > ROUND_SECONDS {
                return items as f64 / started.elapsed().as_secs_f64() / 1e6;
            }
        }
    };
    (0..ROUNDS).map(|_| round(build)).fold(0.0, f64::max)
}
