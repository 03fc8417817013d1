//! Two estimates of every pair become one: `A_i F_ij = A_j F_ji`, and rows sum to one again.
//!
//! Patch `i`'s rays and patch `j`'s rays both measure the exchange `G_ij = A_i F_ij`. The estimate from `i`
//! has variance about `A_i G_ij / R_i`, so the two are averaged with weights `R / A`. The sums of rows are
//! then off by the noise that was averaged away; a symmetric scaling `d_i G_ij d_j` (Sinkhorn's, which keeps
//! reciprocity) brings them back, and whatever still exceeds one is shrunk on both sides. Nothing is scaled
//! above one; what is missing is booked as absorbed and shows in the summary.
//!
//! Scaling goes a fixed number of rounds and ends on steps of a thousandth, so that what changes in one place of a
//! world stops mattering a few exchanges away. Here are the rules for one row; `balance` applies them to all.

use crate::rows::RawRow;

/// By which power of its sum a row is scaled, round by round. A full step removes what differs from row to row, at
/// once; half steps then what neighbours have in common, which a full step overshoots.
pub const ROUNDS: [f32; 4] = [1.0, 0.5, 0.5, 0.5];
/// Scales stay within this factor of one: a sliver whose few rays say nothing is not blown up.
const SCALE_MAX: f32 = 2.0;
/// Scales are whole numbers of these.
const STEP: f32 = 1.0 / 1024.0;

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

/// The scale of a row after a round of power `power`, which found that its scaled `sum` is not one.
#[must_use]
pub fn rescaled(scale: f32, sum: f32, power: f32) -> f32 {
    let wanted = scale * sum.max(f32::MIN_POSITIVE).powf(-power);
    wanted.clamp(1.0 / SCALE_MAX, SCALE_MAX)
}

/// The nearest step.
#[must_use]
pub fn settled(scale: f32) -> f32 {
    (scale / STEP).round() * STEP
}

/// The step by which a row of that `sum` must be shrunk not to exceed one.
#[must_use]
pub fn shrinkage(sum: f32) -> f32 {
    if sum <= 1.0 { 1.0 } else { (1.0 / sum / STEP).floor() * STEP }
}

/// Scales row `own` and its entries, shrinks pairs above one by the smaller of both sides, and books what is
/// missing as absorbed. How much that was.
pub fn close(row: &mut RawRow, own: usize, scales: &[f32], shrinkages: &[f32]) -> f32 {
    for (patch, share) in &mut row.entries {
        let other = *patch as usize;
        *share *= scales[own] * scales[other] * shrinkages[own].min(shrinkages[other]);
    }
    let outside = scales[own] * shrinkages[own];
    row.sky.iter_mut().for_each(|share| *share *= outside);
    row.absorbed *= outside;
    let deficit = (1.0 - scaled_sum(row, None, 1.0)).max(0.0);
    row.absorbed += deficit;
    deficit
}

/// Own estimates and those of the other side, both ascending; a pair that one side missed counts as zero there.
#[must_use]
pub fn merge_estimates(
    i: usize,
    own: &[(u32, f32)],
    other: &[(u32, f32)],
    areas: &[f32],
    rays: &[u32],
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
        let (here, there) = (rays[i] as f32, rays[j as usize] as f32);
        // Weights R/A, exchange A_i F_ij from here and A_j F_ji from there, divided by A_i again.
        let exchange = (from_here * here + from_there * there) / (here / area + there / other_area);
        merged.push((j, exchange / area));
    }
}

/// The sum of `row`, itself scaled by `own` and its entries by `scales`.
#[must_use]
pub fn scaled_sum(row: &RawRow, scales: Option<&[f32]>, own: f32) -> f32 {
    let patches: f64 = match scales {
        Some(d) => row.entries.iter().map(|&(j, share)| f64::from(share * d[j as usize])).sum(),
        None => row.entries.iter().map(|&(_, share)| f64::from(share)).sum(),
    };
    let outside = f64::from(row.sky.iter().sum::<f32>() + row.absorbed);
    ((patches + outside) * f64::from(own)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(entries: &[(u32, f32)], sky: f32) -> RawRow {
        RawRow { entries: entries.to_vec(), sky: [sky, 0.0, 0.0, 0.0, 0.0, 0.0], absorbed: 0.0, rays: 64 }
    }

    fn enforce(rows: &mut [RawRow], areas: &[f32]) -> f32 {
        let rays: Vec<u32> = rows.iter().map(|row| row.rays).collect();
        let mut incoming = vec![Vec::new(); rows.len()];
        for (i, row) in rows.iter().enumerate() {
            row.entries.iter().for_each(|&(j, share)| incoming[j as usize].push((i as u32, share)));
        }
        for (i, row) in rows.iter_mut().enumerate() {
            row.entries = merge_estimates(i, &row.entries, &incoming[i], areas, &rays);
        }
        let mut scales = vec![1.0; rows.len()];
        for power in ROUNDS {
            let sum = |i: usize| scaled_sum(&rows[i], Some(&scales), scales[i]);
            scales = (0..rows.len()).map(|i| rescaled(scales[i], sum(i), power)).collect();
        }
        scales.iter_mut().for_each(|scale| *scale = settled(*scale));
        let sum = |i: usize| scaled_sum(&rows[i], Some(&scales), scales[i]);
        let shrinkages: Vec<f32> = (0..rows.len()).map(|i| shrinkage(sum(i))).collect();
        let closed = rows.iter_mut().enumerate().map(|(i, row)| close(row, i, &scales, &shrinkages));
        closed.fold(0.0, f32::max)
    }

    #[test]
    fn noisy_rows_become_reciprocal_and_sum_to_one() {
        let areas = [1.0, 2.0, 0.5];
        let mut rows = vec![
            row(&[(1, 0.62), (2, 0.18)], 0.2),
            row(&[(0, 0.29), (2, 0.11)], 0.6),
            row(&[(0, 0.41), (1, 0.39)], 0.2),
        ];
        let deficit_max = enforce(&mut rows, &areas);
        for (i, row) in rows.iter().enumerate() {
            assert!((scaled_sum(row, None, 1.0) - 1.0).abs() < 1e-5);
            for &(j, share) in &row.entries {
                let back = rows[j as usize].entries.iter().find(|e| e.0 == i as u32).expect("both sides").1;
                assert!((areas[i] * share - areas[j as usize] * back).abs() < 1e-6);
            }
        }
        assert!(deficit_max < 0.01, "{deficit_max}");
    }

    #[test]
    fn more_rays_weigh_more() {
        let merged = merge_estimates(0, &[(1, 0.3)], &[(1, 0.1)], &[1.0, 1.0], &[192, 64]);
        assert!((merged[0].1 - 0.25).abs() < 1e-6);
    }

    #[test]
    fn a_pair_that_one_side_missed_is_shared() {
        assert_eq!(merge_estimates(1, &[], &[(0, 0.1)], &[1.0, 1.0], &[64, 64]), vec![(0, 0.05)]);
    }

    #[test]
    fn scales_are_steps_and_never_blow_up() {
        assert_eq!(rescaled(1.0, 1e-9, 1.0), SCALE_MAX);
        assert_eq!(settled(1.000_3), 1.0);
        assert!(shrinkage(1.0) == 1.0 && shrinkage(1.0001) * 1.0001 <= 1.0 && shrinkage(1.3) * 1.3 > 0.99);
    }
}
