//! The inner loops: four small kernels that do nearly all the arithmetic of this package.
//!
//! All keep a tile of [`ROW_GROUP`] (or four) rows by one cache line or two in registers and stream the
//! rest past it. Every element of a result is summed in an order that depends on the operands alone, so
//! however rayon cuts the work, the bits are the same.
//!
//! | kernel | computes | used for |
//! |---|---|---|
//! | [`RankUpdate`] | `out += C P`, few columns in `C` | changes of `H`, trailing blocks of the LU |
//! | [`GatherColumns`] | `out = H[:, list] X` | column of `H` before its loop is closed |
//! | [`ScatterRows`] | `out += Y H[list, :]` | row of `H` before its loop is closed |
//! | [`RowProducts`] | `out = H x` over lit columns | the light of a frame |

use crate::simd::{InstructionSet, Lanes, Portable};

/// Rows are padded to a multiple of this, so that no kernel has a tail.
pub(crate) const ROW_GROUP: usize = 8;

/// Most rows of a [`RankUpdate`]'s right factor.
const DEPTH_MAX: usize = 32;

/// Tiles between what is computed and what is fetched from memory meanwhile.
const AHEAD: usize = 2;

/// Products summed in `f32` before they go to the next, longer-lived sum.
const SEGMENT: usize = 128;

/// `f32` or `f64`, with the kernels compiled for each instruction set.
pub(crate) trait Scalar: Copy + Default + Send + Sync + Into<f64> + 'static {
    /// Columns of a tile: two cache lines.
    const TILE: usize;
    /// Runs `kernel` with the instructions of `set`.
    fn dispatch<K: Kernel<Self>>(set: InstructionSet, kernel: K);
}

/// A loop nest, generic over the registers it runs on: tiles of `R` rows by `N` registers.
pub(crate) trait Kernel<T: Scalar> {
    /// Does the work.
    fn run<S: Lanes<T>, const R: usize, const N: usize>(self, simd: S);
}

macro_rules! scalar {
    ($scalar:ty) => {
        impl Scalar for $scalar {
            const TILE: usize = 128 / size_of::<Self>();

            fn dispatch<K: Kernel<Self>>(set: InstructionSet, kernel: K) {
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx2,fma")]
                fn avx2<K: Kernel<$scalar>>(kernel: K, simd: crate::simd::Avx2) {
                    kernel.run::<_, 4, 2>(simd);
                }
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx512f")]
                fn avx512<K: Kernel<$scalar>>(kernel: K, simd: crate::simd::Avx512) {
                    kernel.run::<_, 8, 2>(simd);
                }
                match set {
                    InstructionSet::Portable(simd) => kernel.run::<Portable, 4, 1>(simd),
                    #[cfg(target_arch = "x86_64")]
                    // SAFETY: the value `simd` exists only where the processor has the instruction set.
                    InstructionSet::Avx2(simd) => unsafe { avx2(kernel, simd) },
                    #[cfg(target_arch = "x86_64")]
                    // SAFETY: as above.
                    InstructionSet::Avx512(simd) => unsafe { avx512(kernel, simd) },
                }
            }
        }
    };
}

scalar!(f32);
scalar!(f64);

/// `sum[r] += coefficients[r] * panel` over all steps `(coefficients, panel)`: the loop all time goes to.
#[inline(always)]
fn accumulate<'a, T: Scalar, S: Lanes<T>, const R: usize, const N: usize>(
    simd: S,
    steps: impl Iterator<Item = ([T; R], &'a [T])>,
    sum: &mut [[S::Vector; N]; R],
) {
    for (coefficients, panel) in steps {
        let panel: [S::Vector; N] = std::array::from_fn(|n| simd.load(&panel[n * S::WIDTH..]));
        for (&coefficient, sum) in coefficients.iter().zip(sum.iter_mut()) {
            let coefficient = simd.splat(coefficient);
            for (lanes, sum) in panel.iter().zip(sum.iter_mut()) {
                *sum = simd.multiply_add(coefficient, *lanes, *sum);
            }
        }
    }
}

/// `R` rows of `length` numbers, `stride` apart.
#[inline(always)]
fn rows_of<T, const R: usize>(group: &[T], stride: usize, length: usize) -> [&[T]; R] {
    std::array::from_fn(|r| &group[r * stride..][..length])
}

/// `out += C P`: rows of `C` hold `depth` coefficients, `P` comes packed in tiles.
pub(crate) struct RankUpdate<'a, T> {
    /// Rows to change, `stride` apart, a multiple of [`ROW_GROUP`] of them.
    pub(crate) out: &'a mut [T],
    /// Distance of the rows of `out`.
    pub(crate) stride: usize,
    /// First column to change, a multiple of the tile.
    pub(crate) first_column: usize,
    /// One row of coefficients for each row of `out`.
    pub(crate) coefficients: &'a [T],
    /// Distance of the rows of `coefficients`.
    pub(crate) coefficient_stride: usize,
    /// Rows of `P`, at most 32.
    pub(crate) depth: usize,
    /// Tiles of `P`: row after row of one tile, then the next tile.
    pub(crate) panels: &'a [T],
    /// Distance of the tiles of `panels`.
    pub(crate) panel_stride: usize,
}

impl<T: Scalar> Kernel<T> for RankUpdate<'_, T> {
    #[inline(always)]
    fn run<S: Lanes<T>, const R: usize, const N: usize>(self, simd: S) {
        let groups = self.out.chunks_exact_mut(R * self.stride);
        let coefficients = self.coefficients.chunks_exact(R * self.coefficient_stride);
        let mut packed = [[T::default(); R]; DEPTH_MAX];
        for (out, coefficients) in groups.zip(coefficients) {
            let coefficients = rows_of::<T, R>(coefficients, self.coefficient_stride, self.depth);
            for (k, packed) in packed[..self.depth].iter_mut().enumerate() {
                *packed = coefficients.map(|row| row[k]);
            }
            for (tile, panel) in self.panels.chunks_exact(self.panel_stride).enumerate() {
                for part in (0..T::TILE).step_by(N * S::WIDTH) {
                    let column = self.first_column + tile * T::TILE + part;
                    let mut sum: [[S::Vector; N]; R] = std::array::from_fn(|r| {
                        let row = &out[r * self.stride + column..];
                        simd.prefetch(row, AHEAD * T::TILE);
                        simd.prefetch(row, AHEAD * T::TILE + T::TILE / 2);
                        std::array::from_fn(|n| simd.load(&row[n * S::WIDTH..]))
                    });
                    let panel = panel.chunks_exact(T::TILE).map(|row| &row[part..]);
                    accumulate(simd, packed[..self.depth].iter().copied().zip(panel), &mut sum);
                    for (r, sum) in sum.iter().enumerate() {
                        let row = &mut out[r * self.stride + column..];
                        for (n, &sum) in sum.iter().enumerate() {
                            simd.store(sum, &mut row[n * S::WIDTH..]);
                        }
                    }
                }
            }
        }
    }
}

/// `out = M[:, columns] X`, `X` and `out` one tile wide.
pub(crate) struct GatherColumns<'a, T> {
    /// Rows of `M`, `stride` apart, a multiple of [`ROW_GROUP`] of them.
    pub(crate) matrix: &'a [T],
    /// Distance of the rows of `matrix`.
    pub(crate) stride: usize,
    /// Columns that have a row in `panel`, ascending.
    pub(crate) columns: &'a [u32],
    /// `X`: a tile for each of `columns`.
    pub(crate) panel: &'a [T],
    /// A tile for each row of `matrix`; overwritten.
    pub(crate) out: &'a mut [T],
}

impl<T: Scalar> Kernel<T> for GatherColumns<'_, T> {
    #[inline(always)]
    fn run<S: Lanes<T>, const R: usize, const N: usize>(self, simd: S) {
        let groups = self.matrix.chunks_exact(R * self.stride);
        for (matrix, out) in groups.zip(self.out.chunks_exact_mut(R * T::TILE)) {
            let matrix = rows_of::<T, R>(matrix, self.stride, self.stride);
            for part in (0..T::TILE).step_by(N * S::WIDTH) {
                let zero = [[simd.splat(T::default()); N]; R];
                let mut total = zero;
                for (columns, panel) in self.columns.chunks(SEGMENT).zip(self.panel.chunks(SEGMENT * T::TILE))
                {
                    let mut sum = zero;
                    let steps = columns.iter().zip(panel.chunks_exact(T::TILE));
                    let steps =
                        steps.map(|(&column, row)| (matrix.map(|row| row[column as usize]), &row[part..]));
                    accumulate(simd, steps, &mut sum);
                    for (total, sum) in total.as_flattened_mut().iter_mut().zip(sum.as_flattened()) {
                        *total = simd.add(*total, *sum);
                    }
                }
                for (out, total) in out.chunks_exact_mut(T::TILE).zip(&total) {
                    for (n, &total) in total.iter().enumerate() {
                        simd.store(total, &mut out[part + n * S::WIDTH..]);
                    }
                }
            }
        }
    }
}

/// `out += Y M[rows, :]` for a stripe of columns, `out` packed in tiles.
pub(crate) struct ScatterRows<'a, T> {
    /// `M`.
    pub(crate) matrix: &'a [T],
    /// Distance of the rows of `matrix`.
    pub(crate) stride: usize,
    /// First column of the stripe, a multiple of the tile.
    pub(crate) first_column: usize,
    /// Rows of `M` that have coefficients, ascending.
    pub(crate) rows: &'a [u32],
    /// `Y` transposed: `depth` numbers for each of `rows`.
    pub(crate) coefficients: &'a [T],
    /// Rows of `Y`, a multiple of [`ROW_GROUP`].
    pub(crate) depth: usize,
    /// Tiles: `depth` rows, then the next tile.
    pub(crate) out: &'a mut [T],
}

/// Rows of `M` that stay in the nearest cache while all of `Y` goes over them.
const SCATTER_ROWS: usize = 16;

impl<T: Scalar> Kernel<T> for ScatterRows<'_, T> {
    #[inline(always)]
    fn run<S: Lanes<T>, const R: usize, const N: usize>(self, simd: S) {
        let depth = self.depth;
        let blocks = self.rows.chunks(SCATTER_ROWS).zip(self.coefficients.chunks(SCATTER_ROWS * depth));
        for (rows, coefficients) in blocks {
            for (tile, out) in self.out.chunks_exact_mut(depth * T::TILE).enumerate() {
                for (group, out) in out.chunks_exact_mut(R * T::TILE).enumerate() {
                    for part in (0..T::TILE).step_by(N * S::WIDTH) {
                        let column = self.first_column + tile * T::TILE + part;
                        let mut sum = [[simd.splat(T::default()); N]; R];
                        let steps = rows.iter().zip(coefficients.chunks_exact(depth));
                        let steps = steps.map(|(&row, coefficients)| {
                            let row = &self.matrix[row as usize * self.stride + column..];
                            if group == 0 {
                                simd.prefetch(row, AHEAD * T::TILE);
                                simd.prefetch(row, AHEAD * T::TILE + T::TILE / 2);
                            }
                            let coefficients = &coefficients[group * R..][..R];
                            (std::array::from_fn(|r| coefficients[r]), row)
                        });
                        accumulate(simd, steps, &mut sum);
                        for (out, sum) in out.chunks_exact_mut(T::TILE).zip(&sum) {
                            for (n, &sum) in sum.iter().enumerate() {
                                let out = &mut out[part + n * S::WIDTH..];
                                simd.store(simd.add(simd.load(out), sum), out);
                            }
                        }
                    }
                }
            }
        }
    }
}

/// `out = M x` over runs of columns: lanes in `T`, their sums in `f64`.
pub(crate) struct RowProducts<'a, T> {
    /// Rows of `M`, `stride` apart, a multiple of [`ROW_GROUP`] of them.
    pub(crate) matrix: &'a [T],
    /// Distance of the rows of `matrix`.
    pub(crate) stride: usize,
    /// `x`, `stride` numbers.
    pub(crate) vector: &'a [T],
    /// Runs of tiles in which `x` is not all zero.
    pub(crate) runs: &'a [std::ops::Range<usize>],
    /// One number for each row; overwritten.
    pub(crate) out: &'a mut [f64],
}

/// Tiles summed in lanes of `T` before they go to the `f64` sum.
const PRODUCT_TILES: usize = 32;

impl<T: Scalar> Kernel<T> for RowProducts<'_, T> {
    #[inline(always)]
    fn run<S: Lanes<T>, const R: usize, const N: usize>(self, simd: S) {
        let mut lanes = [T::default(); 64];
        for (matrix, out) in self.matrix.chunks_exact(R * self.stride).zip(self.out.chunks_exact_mut(R)) {
            let matrix = rows_of::<T, R>(matrix, self.stride, self.stride);
            out.fill(0.0);
            for run in self.runs {
                for first in run.clone().step_by(PRODUCT_TILES) {
                    let columns = first * T::TILE..(first + PRODUCT_TILES).min(run.end) * T::TILE;
                    let mut sum = [[simd.splat(T::default()); N]; R];
                    for column in columns.step_by(N * S::WIDTH) {
                        for (n, vector) in self.vector[column..].chunks_exact(S::WIDTH).take(N).enumerate() {
                            let vector = simd.load(vector);
                            for (row, sum) in matrix.iter().zip(&mut sum) {
                                let entries = simd.load(&row[column + n * S::WIDTH..]);
                                sum[n] = simd.multiply_add(entries, vector, sum[n]);
                            }
                        }
                    }
                    for (out, sum) in out.iter_mut().zip(&sum) {
                        for &sum in sum {
                            simd.store(sum, &mut lanes);
                            *out += lanes[..S::WIDTH].iter().map(|&lane| lane.into()).sum::<f64>();
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
