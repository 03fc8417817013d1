//! Light of a whole world by iterated sparse gathers: `I <- F (E + rho I) + outside`.
//!
//! O(non-zeros) a bounce and no matrix: for worlds far beyond a local matrix, and the honest baseline
//! against it. Each sum is over one row in the row's own order, so the light is the same to the bit at any
//! number of threads.

use earthshine_world::Rgb;
use rayon::prelude::*;

/// Terms summed in `f32` before they go to the `f64` sum.
const SEGMENT: usize = 256;
/// Rows a task takes at least.
const ROWS_MIN: usize = 64;

/// Rows that do not describe a square sparse matrix.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SparseRowsError {
    /// Starts must ascend from 0 to the number of entries.
    #[error("start {0} of the sparse rows is out of order")]
    Starts(usize),
    /// Columns and shares differ in number.
    #[error("{columns} columns for {shares} shares")]
    Lengths {
        /// Columns.
        columns: usize,
        /// Shares.
        shares: usize,
    },
    /// A column at or beyond the number of rows.
    #[error("entry {entry} names patch {column} of {rows}")]
    Column {
        /// Which entry.
        entry: usize,
        /// Its column.
        column: u32,
        /// Rows there are.
        rows: usize,
    },
    /// A share below zero, above one, or not a number.
    #[error("entry {entry} is {share}, which is not a share")]
    Share {
        /// Which entry.
        entry: usize,
        /// The offender.
        share: f32,
    },
}

/// Form factors of a whole world, compressed by row.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseRows {
    starts: Vec<usize>,
    columns: Vec<u32>,
    shares: Vec<f32>,
}

impl SparseRows {
    /// Row `i` is entries `starts[i]..starts[i + 1]`; `starts` is one longer than there are rows. Checked once, here.
    ///
    /// # Errors
    /// [`SparseRowsError`], the first fault found.
    pub fn new(starts: Vec<usize>, columns: Vec<u32>, shares: Vec<f32>) -> Result<Self, SparseRowsError> {
        if columns.len() != shares.len() {
            return Err(SparseRowsError::Lengths { columns: columns.len(), shares: shares.len() });
        }
        if starts.first() != Some(&0) {
            return Err(SparseRowsError::Starts(0));
        }
        if let Some(at) = starts.windows(2).position(|pair| pair[0] > pair[1]) {
            return Err(SparseRowsError::Starts(at + 1));
        }
        let rows = starts.len() - 1;
        if starts[rows] != columns.len() {
            return Err(SparseRowsError::Starts(rows));
        }
        if let Some(entry) = columns.iter().position(|&column| column as usize >= rows) {
            return Err(SparseRowsError::Column { entry, column: columns[entry], rows });
        }
        if let Some(entry) = shares.iter().position(|share| !(0.0..=1.0).contains(share)) {
            return Err(SparseRowsError::Share { entry, share: shares[entry] });
        }
        Ok(Self { starts, columns, shares })
    }

    /// Number of rows, and of columns.
    #[must_use]
    pub fn row_count(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of entries.
    #[must_use]
    pub fn nonzero_count(&self) -> usize {
        self.columns.len()
    }

    /// Columns and shares of row `row`.
    ///
    /// # Panics
    /// If there is no such row.
    #[must_use]
    pub fn row(&self, row: usize) -> (&[u32], &[f32]) {
        let range = self.starts[row]..self.starts[row + 1];
        (&self.columns[range.clone()], &self.shares[range])
    }

    /// `sum_j F[row, j] exitance[j]`; the fourth number of each exitance is padding.
    fn gather(&self, row: usize, exitance: &[[f32; 4]]) -> [f64; 3] {
        let (columns, shares) = self.row(row);
        let mut total = [0.0f64; 3];
        for (columns, shares) in columns.chunks(SEGMENT).zip(shares.chunks(SEGMENT)) {
            let mut sums = [[0.0f32; 4]; 4];
            let (fours, rest) = columns.as_chunks::<4>();
            let (share_fours, share_rest) = shares.as_chunks::<4>();
            for (columns, shares) in fours.iter().zip(share_fours) {
                for ((&column, &share), sum) in columns.iter().zip(shares).zip(&mut sums) {
                    add_product(sum, share, &exitance[column as usize]);
                }
            }
            for (&column, &share) in rest.iter().zip(share_rest) {
                add_product(&mut sums[0], share, &exitance[column as usize]);
            }
            for (channel, total) in total.iter_mut().enumerate() {
                *total += sums.iter().map(|sum| f64::from(sum[channel])).sum::<f64>();
            }
        }
        total
    }
}

#[inline]
fn add_product(sum: &mut [f32; 4], share: f32, exitance: &[f32; 4]) {
    for (sum, exitance) in sum.iter_mut().zip(exitance) {
        *sum += share * exitance;
    }
}

/// What shines, what reflects, and what comes from elsewhere; one of each a patch.
#[derive(Debug, Clone, Copy)]
pub struct Sources<'a> {
    /// `E`, lm/m2.
    pub direct_exitance: &'a [Rgb],
    /// `rho`.
    pub reflectance: &'a [Rgb],
    /// Irradiance from beyond the rows (sky, far patches), lx.
    pub outside_irradiance: &'a [Rgb],
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GatherLimits {
    /// Residual, see [`GatherReport::residual`], at which the light counts as settled.
    pub tolerance: f64,
    /// Most bounces.
    pub iterations_max: u32,
}

impl Default for GatherLimits {
    fn default() -> Self {
        Self { tolerance: 1e-6, iterations_max: 1000 }
    }
}

/// How it went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GatherReport {
    /// Bounces computed.
    pub iterations: u32,
    /// `|I_new - I_old| / |I_new|` (2-norms over patches) of the worst channel. The error left is at most
    /// about `rho / (1 - rho)` times this.
    pub residual: f64,
    /// Whether the tolerance was reached.
    pub converged: bool,
}

/// Iterates until the light settles. `irradiance` (lx) is the warm start and the result.
///
/// # Panics
/// If the slices have not one value a row.
pub fn gather(
    rows: &SparseRows,
    sources: Sources<'_>,
    irradiance: &mut [Rgb],
    limits: GatherLimits,
) -> GatherReport {
    let n = rows.row_count();
    let lengths =
        [sources.direct_exitance.len(), sources.reflectance.len(), sources.outside_irradiance.len()];
    assert_eq!((lengths, irradiance.len()), ([n; 3], n), "one value a row");
    let mut exitance = vec![[0.0f32; 4]; n];
    let mut next = vec![Rgb::ZERO; n];
    let mut report = GatherReport { iterations: 0, residual: f64::INFINITY, converged: false };
    while report.iterations < limits.iterations_max && !report.converged {
        exitance.par_iter_mut().with_min_len(ROWS_MIN).enumerate().for_each(|(i, exitance)| {
            let leaving = sources.direct_exitance[i] + sources.reflectance[i] * irradiance[i];
            *exitance = [leaving.x, leaving.y, leaving.z, 0.0];
        });
        next.par_iter_mut().with_min_len(ROWS_MIN).enumerate().for_each(|(row, next)| {
            let sum = rows.gather(row, &exitance);
            let outside = sources.outside_irradiance[row];
            let channel = |c: usize| (sum[c] + f64::from(outside[c])) as f32;
            *next = Rgb::new(channel(0), channel(1), channel(2));
        });
        report.iterations += 1;
        report.residual = residual(irradiance, &next);
        report.converged = report.residual <= limits.tolerance;
        irradiance.copy_from_slice(&next);
    }
    report
}

fn residual(old: &[Rgb], new: &[Rgb]) -> f64 {
    let (mut gap, mut norm) = ([0.0f64; 3], [0.0f64; 3]);
    for (old, new) in old.iter().zip(new) {
        for channel in 0..3 {
            let (old, new) = (f64::from(old[channel]), f64::from(new[channel]));
            gap[channel] += (new - old) * (new - old);
            norm[channel] += new * new;
        }
    }
    let relative = |channel: usize| if gap[channel] == 0.0 { 0.0 } else { gap[channel] / norm[channel] };
    (0..3).map(relative).fold(0.0, f64::max).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_box::ClosedBox;
    use crate::multibounce::multibounce;

    fn sparse(room: &ClosedBox) -> SparseRows {
        let (mut starts, mut columns, mut shares) = (vec![0], Vec::new(), Vec::new());
        for i in 0..room.len() {
            for (j, share) in (0..room.len()).map(|j| (j, room.form_factor(i, j))).filter(|&(_, f)| f > 0.0) {
                columns.push(j as u32);
                shares.push(share);
            }
            starts.push(columns.len());
        }
        SparseRows::new(starts, columns, shares).expect("a room's rows")
    }

    /// Goal: the gather solves the balance. Method: the dense `f64` solve, `I = H (E + rho g) + g`, a channel at a time.
    #[test]
    fn the_gather_is_the_dense_solve() {
        let room = ClosedBox::new(180, 5);
        let rows = sparse(&room);
        let reflectance: Vec<Rgb> = (0..180).map(|i| room.reflectance(i)).collect();
        let direct: Vec<Rgb> =
            (0..180u16).map(|i| Rgb::new(f32::from(i % 7), 1.0, f32::from(i % 2))).collect();
        let outside: Vec<Rgb> = (0..180u16).map(|i| Rgb::new(0.5, f32::from(i % 3), 0.0)).collect();
        let sources =
            Sources { direct_exitance: &direct, reflectance: &reflectance, outside_irradiance: &outside };
        let mut irradiance = vec![Rgb::ZERO; 180];
        let report =
            gather(&rows, sources, &mut irradiance, GatherLimits { tolerance: 1e-7, iterations_max: 200 });
        assert!(report.converged && report.iterations > 10, "{report:?}");
        for channel in 0..3 {
            let of = |values: &[Rgb]| values.iter().map(|rgb| f64::from(rgb[channel])).collect::<Vec<_>>();
            let (direct, outside, reflectance) = (of(&direct), of(&outside), of(&reflectance));
            let matrix =
                multibounce(&room.dense_form_factors().expect("small"), &reflectance).expect("regular");
            let first: Vec<f64> = (0..180).map(|i| direct[i] + reflectance[i] * outside[i]).collect();
            for (i, solved) in matrix.multiply(&first).iter().enumerate() {
                let solved = solved + outside[i];
                assert!((f64::from(irradiance[i][channel]) - solved).abs() < 2e-6 * solved, "{i}");
            }
        }
        let warm = gather(&rows, sources, &mut irradiance, GatherLimits::default());
        assert_eq!(warm.iterations, 1, "a warm start that has settled stays");
    }

    #[test]
    fn a_cap_stops_what_does_not_settle() {
        let rows = SparseRows::new(vec![0, 1], vec![0], vec![1.0]).expect("one patch that sees itself");
        let one = [Rgb::ONE];
        let sources = Sources { direct_exitance: &one, reflectance: &one, outside_irradiance: &one };
        let limits = GatherLimits { tolerance: 1e-6, iterations_max: 7 };
        let report = gather(&rows, sources, &mut [Rgb::ZERO], limits);
        assert!(report.iterations == 7 && !report.converged, "{report:?}");
    }

    #[test]
    fn rows_that_cannot_be_are_named() {
        let error = |starts: &[usize], columns: &[u32], shares: &[f32]| {
            SparseRows::new(starts.to_vec(), columns.to_vec(), shares.to_vec()).expect_err("a fault")
        };
        assert_eq!(error(&[], &[], &[]), SparseRowsError::Starts(0));
        assert_eq!(error(&[0, 2, 1], &[0], &[0.5]), SparseRowsError::Starts(2));
        assert_eq!(error(&[0, 0], &[0], &[0.5]), SparseRowsError::Starts(1));
        assert_eq!(error(&[0, 1], &[1], &[0.5]), SparseRowsError::Column { entry: 0, column: 1, rows: 1 });
        assert_eq!(error(&[0, 1], &[0], &[1.5]), SparseRowsError::Share { entry: 0, share: 1.5 });
        assert_eq!(error(&[0, 1], &[0], &[]), SparseRowsError::Lengths { columns: 1, shares: 0 });
    }
}
