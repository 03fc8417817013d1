//! Errors of drawn light and of tables, on rows of a world whose light is solved.

use super::LitWorld;
use earthshine_radiosity::tables::draw::{Spread, random, row_key};
use earthshine_radiosity::tables::edge_rows::edge_rows;
use earthshine_radiosity::tables::{AliasTable, BuildRoom, CdfTable, RowTable};
use earthshine_world::Rgb;
use serde::Serialize;

/// Numbers of draws that are looked at.
const KS: [u32; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
/// Rows that are drawn from at most, spread over the world.
const ROWS_MAX: usize = 2000;
/// Frames of each.
const FRAMES: u32 = 16;

/// Relative RMSE of a row's irradiance, by number of draws.
#[derive(Debug, Serialize)]
pub(super) struct RmseByK {
    pub(super) k: Vec<u32>,
    pub(super) alias: Vec<f64>,
    pub(super) alias_systematic: Vec<f64>,
    /// Columns along a Z-curve.
    pub(super) cdf_systematic: Vec<f64>,
    /// Columns as tiles hold them: chunk, direction, Z-curve within the chunk.
    pub(super) cdf_tile_order_systematic: Vec<f64>,
}

/// A row's items: weights and what each brings, the sky last.
pub(super) struct Items {
    pub(super) weights: Vec<f32>,
    pub(super) light: Vec<Rgb>,
}

impl Items {
    /// Row `row` with columns as `(column, share)`.
    pub(super) fn of(
        lit: &LitWorld,
        exitance: &[Rgb],
        row: usize,
        entries: impl Iterator<Item = (u32, f32)>,
    ) -> Self {
        let (mut weights, mut light) = (Vec::new(), Vec::new());
        for (column, share) in entries {
            weights.push(share);
            light.push(exitance[column as usize]);
        }
        let sky = lit.sky_shares[row];
        weights.push(sky);
        light.push(if sky > 0.0 { lit.light.sky_irradiance[row] / sky } else { Rgb::ZERO });
        Self { weights, light }
    }

    /// What the row brings, exactly.
    pub(super) fn exact(&self) -> Rgb {
        self.weights.iter().zip(&self.light).map(|(&weight, &light)| light * weight).sum()
    }

    /// What `k` draws say.
    pub(super) fn drawn<T: RowTable>(&self, table: &T, key: u32, k: u32, spread: Spread) -> Rgb {
        let sum: Rgb = (0..k).map(|sample| self.light[table.draw(random(key, sample, k, spread))]).sum();
        sum * (table.total() / k as f32)
    }
}

/// Squared errors and what they are relative to.
#[derive(Default, Clone, Copy)]
pub(super) struct Squares {
    gap: f64,
    norm: f64,
}

impl Squares {
    pub(super) fn add(&mut self, found: Rgb, exact: Rgb) {
        self.gap += f64::from((found - exact).length_squared());
        self.norm += f64::from(exact.length_squared());
    }

    pub(super) fn rel_rmse(self) -> f64 {
        (self.gap / self.norm.max(f64::MIN_POSITIVE)).sqrt()
    }
}

/// Every kind of table and spread, on the same rows and frames.
pub(super) fn measure(lit: &LitWorld, seed: u32) -> anyhow::Result<RmseByK> {
    let exitance = lit.exitance();
    let mut squares = [[Squares::default(); KS.len()]; 4];
    let mut room = BuildRoom::default();
    let (mut alias, mut cdf, mut tile_cdf) =
        (AliasTable::default(), CdfTable::default(), CdfTable::default());
    for row in sampled_rows(lit) {
        let entries = |rows: &earthshine_radiosity::gather::SparseRows| {
            let (columns, shares) = rows.row(row);
            columns.iter().copied().zip(shares.iter().copied()).collect::<Vec<_>>()
        };
        let items = Items::of(lit, &exitance, row, entries(&lit.rows).into_iter());
        let tile_items = Items::of(lit, &exitance, row, entries(&lit.world.rows).into_iter());
        alias.rebuild(&items.weights, &mut room)?;
        cdf.rebuild(&items.weights, &mut room)?;
        tile_cdf.rebuild(&tile_items.weights, &mut room)?;
        let exact = items.exact();
        for frame in 0..FRAMES {
            let key = row_key(seed, frame, row as u32);
            for (at, &k) in KS.iter().enumerate() {
                squares[0][at].add(items.drawn(&alias, key, k, Spread::Independent), exact);
                squares[1][at].add(items.drawn(&alias, key, k, Spread::Systematic), exact);
                squares[2][at].add(items.drawn(&cdf, key, k, Spread::Systematic), exact);
                squares[3][at].add(tile_items.drawn(&tile_cdf, key, k, Spread::Systematic), exact);
            }
        }
    }
    let [alias, alias_systematic, cdf_systematic, cdf_tile_order_systematic] =
        squares.map(|squares| squares.iter().map(|squares| squares.rel_rmse()).collect());
    Ok(RmseByK { k: KS.to_vec(), alias, alias_systematic, cdf_systematic, cdf_tile_order_systematic })
}

/// Rows spread evenly over the world's.
pub(super) fn sampled_rows(lit: &LitWorld) -> impl Iterator<Item = usize> {
    let count = lit.rows.row_count();
    (0..count).step_by(count.div_ceil(ROWS_MAX).max(1))
}

/// The worst of all alias tables: rows of the world, and those on which tables go wrong first.
pub(super) fn max_mass_error_bins(lit: &LitWorld) -> anyhow::Result<f64> {
    let (mut table, mut room, mut worst) = (AliasTable::default(), BuildRoom::default(), 0.0f64);
    let mut look = |weights: &[f32]| -> anyhow::Result<()> {
        table.rebuild(weights, &mut room)?;
        let total: f64 = weights.iter().map(|&weight| f64::from(weight)).sum();
        if total > 0.0 {
            for (share, &weight) in table.shares().iter().zip(weights) {
                worst = worst.max((share - f64::from(weight) / total).abs() * weights.len() as f64);
            }
        }
        Ok(())
    };
    for row in sampled_rows(lit) {
        look(lit.rows.row(row).1)?;
    }
    for row in edge_rows() {
        look(&row.weights)?;
    }
    Ok(worst)
}
