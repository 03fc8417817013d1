//! Dense `f64` matrices and their LU factors: the oracle of this package and the way back from drift.
//!
//! [`LuFactors`] is a right-looking, blocked elimination with partial pivoting. Rows are padded for the
//! kernels of `kernel`; the padding stays zero and is never pivoted on.

use crate::buffer::Buffer;
use crate::kernel::{ROW_GROUP, RankUpdate, Scalar};
use crate::simd::InstructionSet;
use rayon::prelude::*;

/// Columns eliminated together.
const PANEL: usize = 32;
/// Rows a task updates.
const BAND_ROWS: usize = 64;
const TILE: usize = <f64 as Scalar>::TILE;

/// A matrix that cannot be inverted, or does not fit.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DenseError {
    /// Elimination met a column without a usable pivot.
    #[error("the matrix is singular at column {0}")]
    Singular(usize),
    /// The memory cannot be had.
    #[error("no memory for {rows} x {columns} numbers; use fewer patches")]
    Memory {
        /// Rows asked for.
        rows: usize,
        /// Columns asked for.
        columns: usize,
    },
}

/// A dense matrix of `f64`, rows in memory one after the other.
#[derive(Debug, Clone)]
pub struct DenseMatrix {
    rows: usize,
    columns: usize,
    stride: usize,
    values: Buffer<f64>,
}

impl DenseMatrix {
    /// All zero.
    ///
    /// # Errors
    /// [`DenseError::Memory`].
    pub fn zeros(rows: usize, columns: usize) -> Result<Self, DenseError> {
        let stride = columns.next_multiple_of(TILE).max(TILE);
        let values = rows
            .next_multiple_of(ROW_GROUP)
            .checked_mul(stride)
            .and_then(|len| Buffer::zeroed(len).ok())
            .ok_or(DenseError::Memory { rows, columns })?;
        Ok(Self { rows, columns, stride, values })
    }

    /// `value(i, j)` everywhere.
    ///
    /// # Errors
    /// [`DenseError::Memory`].
    pub fn from_fn(
        rows: usize,
        columns: usize,
        value: impl Fn(usize, usize) -> f64,
    ) -> Result<Self, DenseError> {
        let mut matrix = Self::zeros(rows, columns)?;
        for i in 0..rows {
            for (j, entry) in matrix.row_mut(i).iter_mut().enumerate() {
                *entry = value(i, j);
            }
        }
        Ok(matrix)
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Row `i`.
    ///
    /// # Panics
    /// If there is no such row.
    #[must_use]
    pub fn row(&self, i: usize) -> &[f64] {
        assert!(i < self.rows, "row {i} of {}", self.rows);
        &self.values[i * self.stride..][..self.columns]
    }

    /// Row `i`, to change.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row_mut(&mut self, i: usize) -> &mut [f64] {
        assert!(i < self.rows, "row {i} of {}", self.rows);
        &mut self.values[i * self.stride..][..self.columns]
    }

    /// `M x`.
    ///
    /// # Panics
    /// If `x` has not one number a column.
    #[must_use]
    pub fn multiply(&self, x: &[f64]) -> Vec<f64> {
        assert_eq!(x.len(), self.columns, "one number a column");
        (0..self.rows).map(|i| self.row(i).iter().zip(x).map(|(m, x)| m * x).sum()).collect()
    }

    /// `|self - other| / |other|`, Frobenius norms; 0 if both are zero.
    ///
    /// # Panics
    /// If the shapes differ.
    #[must_use]
    pub fn relative_distance(&self, other: &Self) -> f64 {
        assert_eq!((self.rows, self.columns), (other.rows, other.columns), "matrices of one shape");
        let (mut gap, mut norm) = (0.0, 0.0);
        for i in 0..self.rows {
            for (a, b) in self.row(i).iter().zip(other.row(i)) {
                gap += (a - b) * (a - b);
                norm += b * b;
            }
        }
        if gap == 0.0 { 0.0 } else { (gap / norm).sqrt() }
    }

    fn swap_rows(&mut self, a: usize, b: usize) {
        if a != b {
            let (first, second) = self.values.split_at_mut(a.max(b) * self.stride);
            first[a.min(b) * self.stride..][..self.stride].swap_with_slice(&mut second[..self.stride]);
        }
    }

    /// Rows `first..last`, from column `column` on, as the tiles [`RankUpdate`] wants.
    fn pack(&self, rows: std::ops::Range<usize>, column: usize, panels: &mut Vec<f64>) {
        panels.clear();
        for tile in (column..self.stride).step_by(TILE) {
            for row in rows.clone() {
                panels.extend_from_slice(&self.values[row * self.stride + tile..][..TILE]);
            }
        }
    }

    /// `self[band, column..] -= coefficients * panels` for all rows from `first_row` to the end or before `last_row`.
    fn subtract(
        &mut self,
        band_rows: std::ops::Range<usize>,
        column: usize,
        coefficients: &[f64],
        panels: &[f64],
        set: InstructionSet,
    ) {
        let stride = self.stride;
        self.values[band_rows.start * stride..band_rows.end * stride]
            .par_chunks_mut(BAND_ROWS * stride)
            .zip(coefficients.par_chunks(BAND_ROWS * PANEL))
            .for_each(|(out, coefficients)| {
                let kernel = RankUpdate {
                    out,
                    stride,
                    first_column: column,
                    coefficients,
                    coefficient_stride: PANEL,
                    depth: PANEL,
                    panels,
                    panel_stride: PANEL * TILE,
                };
                f64::dispatch(set, kernel);
            });
    }
}

/// `P M = L U` of a square matrix.
#[derive(Debug)]
pub struct LuFactors {
    /// `L` below the diagonal (its own is one), `U` on and above it.
    factors: DenseMatrix,
    /// Row swapped with row `i` when column `i` was eliminated.
    pivots: Vec<usize>,
    set: InstructionSet,
}

impl LuFactors {
    /// Factors `matrix`. O(n^3).
    ///
    /// # Errors
    /// [`DenseError::Singular`].
    ///
    /// # Panics
    /// If the matrix is not square.
    pub fn new(matrix: DenseMatrix) -> Result<Self, DenseError> {
        assert_eq!(matrix.rows, matrix.columns, "only a square matrix has factors");
        let n = matrix.rows;
        let mut this = Self { factors: matrix, pivots: Vec::with_capacity(n), set: InstructionSet::widest() };
        let (mut coefficients, mut panels) = (Vec::new(), Vec::new());
        for first in (0..n).step_by(PANEL) {
            let last = (first + PANEL).min(n);
            for column in first..last {
                this.eliminate_column(column, last)?;
            }
            if last == n {
                break;
            }
            this.finish_upper_rows(first, last);
            this.coefficients_below(first, last..n, &mut coefficients);
            this.factors.pack(first..last, last, &mut panels);
            let rows = last..n.next_multiple_of(ROW_GROUP);
            this.factors.subtract(rows, last, &coefficients, &panels, this.set);
        }
        Ok(this)
    }

    /// Swaps the pivot of `column` up, scales what is below it, updates the rest of the panel up to `last`.
    fn eliminate_column(&mut self, column: usize, last: usize) -> Result<(), DenseError> {
        let (n, stride) = (self.factors.rows, self.factors.stride);
        let size = |row: usize| self.factors.values[row * stride + column].abs();
        let pivot = (column..n).fold(column, |best, row| if size(row) > size(best) { row } else { best });
        if !(size(pivot).is_normal()) {
            return Err(DenseError::Singular(column));
        }
        self.factors.swap_rows(column, pivot);
        self.pivots.push(pivot);
        let (above, below) = self.factors.values.split_at_mut((column + 1) * stride);
        let top = &above[column * stride..];
        let reciprocal = 1.0 / top[column];
        for row in below.chunks_exact_mut(stride).take(n - column - 1) {
            let factor = row[column] * reciprocal;
            row[column] = factor;
            for (entry, top) in row[column + 1..last].iter_mut().zip(&top[column + 1..last]) {
                *entry -= factor * top;
            }
        }
        Ok(())
    }

    /// Rows of `U` right of the panel: the unit lower triangle of the panel solved away.
    fn finish_upper_rows(&mut self, first: usize, last: usize) {
        let stride = self.factors.stride;
        for row in first..last {
            let (above, below) = self.factors.values.split_at_mut(row * stride);
            for source in first..row {
                let factor = below[source];
                let source = &above[source * stride + last..(source + 1) * stride];
                for (entry, source) in below[last..stride].iter_mut().zip(source) {
                    *entry -= factor * source;
                }
            }
        }
    }

    /// Minus the columns `first..first + PANEL` of `rows`, padded to whole groups of rows.
    fn coefficients_below(&self, first: usize, rows: std::ops::Range<usize>, out: &mut Vec<f64>) {
        out.clear();
        let padded = rows.start + rows.len().next_multiple_of(ROW_GROUP);
        for row in rows.start..padded {
            let from = &self.factors.values[row * self.factors.stride + first..][..PANEL];
            out.extend(from.iter().map(|value| -value));
        }
    }

    /// Solves `M X = right` in place; `right` becomes `X`.
    ///
    /// # Panics
    /// If `right` has not the matrix's number of rows.
    pub fn solve(&self, right: &mut DenseMatrix) {
        let n = self.factors.rows;
        assert_eq!(right.rows, n, "one row a row of the matrix");
        for (row, &pivot) in self.pivots.iter().enumerate() {
            right.swap_rows(row, pivot);
        }
        let (mut coefficients, mut panels) = (Vec::new(), Vec::new());
        for first in (0..n).step_by(PANEL) {
            let last = (first + PANEL).min(n);
            for row in first..last {
                self.subtract_rows(right, row, first..row);
            }
            if last < n {
                self.coefficients_below(first, last..n, &mut coefficients);
                right.pack(first..last, 0, &mut panels);
                right.subtract(last..n.next_multiple_of(ROW_GROUP), 0, &coefficients, &panels, self.set);
            }
        }
        for first in (0..n).step_by(PANEL).rev() {
            let last = (first + PANEL).min(n);
            for row in (first..last).rev() {
                self.subtract_rows(right, row, row + 1..last);
                let reciprocal = 1.0 / self.factors.values[row * self.factors.stride + row];
                right.row_mut(row).iter_mut().for_each(|entry| *entry *= reciprocal);
            }
            if first > 0 {
                self.coefficients_above(first..last, &mut coefficients);
                self.pack_padded(right, first..last, &mut panels);
                right.subtract(0..first, 0, &coefficients, &panels, self.set);
            }
        }
    }

    /// `right[row] -= sum factors[row][source] * right[source]`.
    fn subtract_rows(&self, right: &mut DenseMatrix, row: usize, sources: std::ops::Range<usize>) {
        let stride = right.stride;
        for source in sources {
            let factor = self.factors.values[row * self.factors.stride + source];
            let (low, high) = right.values.split_at_mut(row.max(source) * stride);
            let (row, source) = if row < source {
                (&mut low[row * stride..][..stride], &high[..stride])
            } else {
                (&mut high[..stride], &low[source * stride..][..stride])
            };
            for (entry, source) in row.iter_mut().zip(source) {
                *entry -= factor * source;
            }
        }
    }

    /// Minus `U[..panel.start, panel]`, columns beyond the matrix as zero.
    fn coefficients_above(&self, panel: std::ops::Range<usize>, out: &mut Vec<f64>) {
        out.clear();
        for row in 0..panel.start {
            let from = &self.factors.values[row * self.factors.stride + panel.start..][..panel.len()];
            out.extend(from.iter().map(|value| -value));
            out.resize((row + 1) * PANEL, 0.0);
        }
    }

    /// Like [`DenseMatrix::pack`], with zero rows up to a whole panel.
    fn pack_padded(&self, right: &DenseMatrix, rows: std::ops::Range<usize>, panels: &mut Vec<f64>) {
        panels.clear();
        for (tile, column) in (0..right.stride).step_by(TILE).enumerate() {
            for row in rows.clone() {
                panels.extend_from_slice(&right.values[row * right.stride + column..][..TILE]);
            }
            panels.resize((tile + 1) * PANEL * TILE, 0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::random::{Purpose, hash, unit_f32};

    fn random(rows: usize, columns: usize, seed: u64) -> DenseMatrix {
        let number = |i: usize, j: usize| {
            f64::from(unit_f32(hash(seed, Purpose::Simulation, i as u64, j as u64))) - 0.5
        };
        DenseMatrix::from_fn(rows, columns, number).expect("small")
    }

    fn product(a: &DenseMatrix, b: &DenseMatrix) -> DenseMatrix {
        DenseMatrix::from_fn(a.rows(), b.columns(), |i, j| {
            (0..a.columns()).map(|k| a.row(i)[k] * b.row(k)[j]).sum()
        })
        .expect("small")
    }

    #[test]
    fn the_solution_times_the_matrix_is_the_right_side() {
        for n in [1, 2, 7, 31, 32, 33, 64, 100, 129] {
            let (matrix, right) = (random(n, n, n as u64), random(n, 5 + n / 3, 1));
            let mut solution = right.clone();
            LuFactors::new(matrix.clone()).expect("random matrices are regular").solve(&mut solution);
            let distance = product(&matrix, &solution).relative_distance(&right);
            assert!(distance < 1e-10, "{n}: {distance}");
        }
    }

    /// Goal: rows are exchanged where they must be. Method: a zero in the first pivot's place.
    #[test]
    fn a_zero_on_the_diagonal_is_not_the_end() {
        let matrix = DenseMatrix::from_fn(2, 2, |i, j| if i == j { 0.0 } else { 2.0 }).expect("small");
        let mut solution = DenseMatrix::from_fn(2, 1, |i, _| i as f64).expect("small");
        LuFactors::new(matrix).expect("regular").solve(&mut solution);
        assert_eq!((solution.row(0)[0], solution.row(1)[0]), (0.5, 0.0));
    }

    #[test]
    fn a_singular_matrix_is_an_error() {
        let matrix = DenseMatrix::from_fn(3, 3, |_, j| j as f64).expect("small");
        assert!(matches!(LuFactors::new(matrix), Err(DenseError::Singular(_))));
        assert!(matches!(DenseMatrix::zeros(usize::MAX / 8, 2), Err(DenseError::Memory { .. })));
    }
}
