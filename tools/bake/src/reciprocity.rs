//! Two estimates of every pair become one: `A_i F_ij = A_j F_ji`, and rows sum to one again.
//!
//! Patch `i`'s rays and patch `j`'s rays both measure the exchange `G_ij = A_i F_ij`. The estimate from `i`
//! has variance about `A_i G_ij / R_i`, so the two are averaged with weights `R / A`. The sums of rows are
//! then off by the noise that was averaged away; a symmetric scaling `d_i G_ij d_j` (Sinkhorn's, which keeps
//! reciprocity) brings them back, and whatever still exceeds one is shrunk on both sides. Nothing is scaled
//! above one; what is missing is booked as absorbed and shows in the summary.

use crate::rows::RawRow;
use rayon::prelude::*;

/// Rounds of scaling; rows that start within a few percent settle in well under this.
const ROUNDS: usize = 24;
/// Rounds end when no row is farther from one than this.
const CLOSE: f32 = 1e-4;
/// Scales stay within this factor of one: a sliver whose few rays say nothing is not blown up.
const SCALE_MAX: f32 = 2.0;

/// How far the rows were from one, before and after.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct Balance {
    /// Root mean square of `row sum - 1` after averaging.
    pub rms_before: f32,
    /// Largest deficit after scaling, booked as absorbed.
    pub deficit_max: f32,
    /// Mean deficit after scaling.
    pub deficit_mean: f32,
    /// Rounds of scaling.
    pub rounds: u32,
}

/// Makes `rows` reciprocal for patches of `areas` (m2) and balances their sums.
///
/// Memory: one transposed copy of the entries.
pub fn enforce(rows: &mut [RawRow], areas: &[f32]) -> Balance {
    average(rows, areas);
    let mut balance = Balance::default();
    let sums: Vec<f32> = rows.par_iter().map(|row| scaled_sum(row, None, 1.0)).collect();
    let squares: f64 = sums.iter().map(|s| f64::from(s - 1.0).powi(2)).sum();
    balance.rms_before = (squares / rows.len().max(1) as f64).sqrt() as f32;
    let scales = settle(rows, &mut balance);
    rows.par_iter_mut().enumerate().for_each(|(i, row)| {
        let own = scales[i];
        row.entries.iter_mut().for_each(|(j, share)| *share *= own * scales[*j as usize]);
        row.sky.iter_mut().for_each(|share| *share *= own);
        row.absorbed *= own;
    });
    shrink(rows, &mut balance);
    balance
}

/// Replaces both shares of each pair by their weighted mean.
fn average(rows: &mut [RawRow], areas: &[f32]) {
    let mut incoming: Vec<Vec<(u32, f32)>> = vec![Vec::new(); rows.len()];
    let weights: Vec<f32> = rows.iter().map(|row| row.rays as f32).collect();
    for (i, row) in rows.iter().enumerate() {
        for &(j, share) in &row.entries {
            incoming[j as usize].push((i as u32, share));
        }
    }
    rows.par_iter_mut().zip(incoming).enumerate().for_each(|(i, (row, seen_from))| {
        row.entries = merge_estimates(i, &row.entries, &seen_from, areas, &weights);
    });
}

/// Own estimates and those of the other side, both ascending; a pair that one side missed counts as zero there.
fn merge_estimates(
    i: usize,
    own: &[(u32, f32)],
    other: &[(u32, f32)],
    areas: &[f32],
    rays: &[f32],
) -> Vec<(u32, f32)> {
    let mut merged = Vec::with_capacity(own.len().max(other.len()));
    let (mut a, mut b) = (own.iter().peekable(), other.iter().peekable());
    loop {
        let j = match (a.peek(), b.peek()) {
            (None, None) => return merged,
            (Some(x), None) => x.0,
            (None, Some(y)) => y.0,
            (Some(x), Some(y)) => x.0.min(y.0),
        };
        let from_here = a.next_if(|x| x.0 == j).map_or(0.0, |x| x.1);
        let from_there = b.next_if(|y| y.0 == j).map_or(0.0, |y| y.1);
        let (area, other_area) = (areas[i], areas[j as usize]);
        let (here, there) = (rays[i], rays[j as usize]);
        // Weights R/A, exchange A_i F_ij from here and A_j F_ji from there, divided by A_i again.
        let exchange = (from_here * here + from_there * there) / (here / area + there / other_area);
        merged.push((j, exchange / area));
    }
}

fn scaled_sum(row: &RawRow, scales: Option<&[f32]>, own: f32) -> f32 {
    let patches: f64 = match scales {
        Some(d) => row.entries.iter().map(|&(j, share)| f64::from(share * d[j as usize])).sum(),
        None => row.entries.iter().map(|&(_, share)| f64::from(share)).sum(),
    };
    let outside = f64::from(row.sky.iter().sum::<f32>() + row.absorbed);
    ((patches + outside) * f64::from(own)) as f32
}

fn settle(rows: &[RawRow], balance: &mut Balance) -> Vec<f32> {
    let mut scales = vec![1.0f32; rows.len()];
    for round in 0..ROUNDS {
        let sums: Vec<f32> =
            rows.par_iter().enumerate().map(|(i, row)| scaled_sum(row, Some(&scales), scales[i])).collect();
        balance.rounds = round as u32;
        if sums.iter().all(|sum| (sum - 1.0).abs() < CLOSE) {
            break;
        }
        for (scale, sum) in scales.iter_mut().zip(&sums) {
            let wanted = *scale / sum.max(f32::MIN_POSITIVE).sqrt();
            *scale = wanted.clamp(1.0 / SCALE_MAX, SCALE_MAX);
        }
    }
    scales
}

/// Shrinks the pairs of rows above one, on both sides alike, and books every deficit as absorbed.
fn shrink(rows: &mut [RawRow], balance: &mut Balance) {
    let factors: Vec<f32> = rows.par_iter().map(|row| 1.0 / scaled_sum(row, None, 1.0).max(1.0)).collect();
    let deficits: Vec<f32> = rows
        .par_iter_mut()
        .enumerate()
        .map(|(i, row)| {
            let own = factors[i];
            row.entries.iter_mut().for_each(|(j, share)| *share *= own.min(factors[*j as usize]));
            row.sky.iter_mut().for_each(|share| *share *= own);
            row.absorbed *= own;
            let deficit = (1.0 - scaled_sum(row, None, 1.0)).max(0.0);
            row.absorbed += deficit;
            deficit
        })
        .collect();
    balance.deficit_max = deficits.iter().copied().fold(0.0, f32::max);
    balance.deficit_mean = deficits.iter().sum::<f32>() / rows.len().max(1) as f32;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(entries: &[(u32, f32)], sky: f32) -> RawRow {
        RawRow { entries: entries.to_vec(), sky: [sky, 0.0, 0.0, 0.0, 0.0, 0.0], absorbed: 0.0, rays: 64 }
    }

    #[test]
    fn noisy_rows_become_reciprocal_and_sum_to_one() {
        let areas = [1.0, 2.0, 0.5];
        let mut rows = vec![
            row(&[(1, 0.62), (2, 0.18)], 0.2),
            row(&[(0, 0.29), (2, 0.11)], 0.6),
            row(&[(0, 0.41), (1, 0.39)], 0.2),
        ];
        let balance = enforce(&mut rows, &areas);
        for (i, row) in rows.iter().enumerate() {
            assert!((scaled_sum(row, None, 1.0) - 1.0).abs() < 1e-5);
            for &(j, share) in &row.entries {
                let back = rows[j as usize].entries.iter().find(|e| e.0 == i as u32).expect("both sides").1;
                assert!((areas[i] * share - areas[j as usize] * back).abs() < 1e-6);
            }
        }
        assert!(balance.deficit_max < 0.05, "{balance:?}");
    }

    #[test]
    fn more_rays_weigh_more() {
        let mut rows = vec![row(&[(1, 0.3)], 0.7), row(&[(0, 0.1)], 0.9)];
        rows[0].rays = 192;
        average(&mut rows, &[1.0, 1.0]);
        assert!((rows[0].entries[0].1 - 0.25).abs() < 1e-6 && rows[1].entries[0].1 == rows[0].entries[0].1);
    }

    #[test]
    fn a_pair_that_one_side_missed_is_shared() {
        let mut rows = vec![row(&[(1, 0.1)], 0.9), row(&[], 1.0)];
        average(&mut rows, &[1.0, 1.0]);
        assert_eq!(rows[1].entries, vec![(0, 0.05)]);
        assert_eq!(rows[0].entries, vec![(1, 0.05)]);
    }
}
