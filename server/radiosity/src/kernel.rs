//! How inner loops are compiled for each instruction set, and the one that all share.
//!
//! A kernel keeps a tile of a few rows by one to four registers in registers and streams the rest past it. Every
//! element of a result is summed in an order that depends on the operands alone, so however rayon cuts the work, the
//! bits are the same. Here: [`RankUpdate`], `out += C P` with few columns in `C`, for the LU and for products with
//! small matrices. The loops over the local matrix are in [`crate::tile_kernel`].

use crate::simd::{InstructionSet, Lanes, Portable};

/// Rows are padded to a multiple of this, so that no kernel has a tail.
pub(crate) const ROW_GROUP: usize = 8;

/// Most rows of a [`RankUpdate`]'s right factor.
const DEPTH_MAX: usize = 32;

/// Tiles between what is computed and what is fetched from memory meanwhile.
const AHEAD: usize = 2;

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
pub(crate) fn accumulate<'a, T: Scalar, S: Lanes<T>, const R: usize, const N: usize>(
    simd: S,
    steps: impl Iterator<Item = ([T; R], &'a [T])>,
    sum: &mut [[S::Vector; N]; R],
) {
    for (coefficients, panel) in steps {
        // A loop, not `array::from_fn`: its closure is not always inlined, and then vectors go through memory.
        let mut lanes = [simd.splat(T::default()); N];
        for (n, lanes) in lanes.iter_mut().enumerate() {
            *lanes = simd.load(&panel[n * S::WIDTH..]);
        }
        for (&coefficient, sum) in coefficients.iter().zip(sum.iter_mut()) {
            let coefficient = simd.splat(coefficient);
            for (lanes, sum) in lanes.iter().zip(sum.iter_mut()) {
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

#[cfg(test)]
mod tests;
