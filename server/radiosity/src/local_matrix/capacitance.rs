//! The small matrix of a block, one a channel, inverted in `f64`.
//!
//! Swept in the order of the block and without exchanging rows: the pivot met at a patch is then exactly
//! the `1 - c s` it would have had entering alone, after those before it. So a block refuses whom one
//! at a time would refuse, and a refused patch is as if it had not come. Devices do
//! the same sweep in `f32` (`solve_block`), and are held against this one.

use super::LocalMatrix;
use earthshine_world::Rgb;

/// Three square matrices of the size of a block, row-major, one a channel.
#[derive(Debug, Clone)]
pub struct SmallMatrices {
    size: usize,
    planes: [[f64; LocalMatrix::BLOCK_MAX * LocalMatrix::BLOCK_MAX]; 3],
}

impl SmallMatrices {
    /// Zeros.
    ///
    /// # Panics
    /// If `size` is above [`LocalMatrix::BLOCK_MAX`].
    #[must_use]
    pub fn zero(size: usize) -> Self {
        assert!(size <= LocalMatrix::BLOCK_MAX, "{size} patches in a block");
        Self { size, planes: [[0.0; LocalMatrix::BLOCK_MAX * LocalMatrix::BLOCK_MAX]; 3] }
    }

    /// One channel.
    #[must_use]
    pub fn plane(&self, channel: usize) -> &[f64] {
        &self.planes[channel][..self.size * self.size]
    }

    /// One channel, to write.
    pub fn plane_mut(&mut self, channel: usize) -> &mut [f64] {
        &mut self.planes[channel][..self.size * self.size]
    }

    /// Inverts all three. A patch whose pivot is below `pivot_min` in any channel is left out:
    /// its rows and columns of the inverses are zero. Returns who stayed, a bit each.
    fn invert(&mut self, pivot_min: f64) -> u32 {
        let size = self.size;
        let mut kept = 0u32;
        for p in 0..size {
            // Written so that a pivot that is not a number is refused too.
            let usable = (0..3).all(|channel| self.plane(channel)[p * size + p] >= pivot_min);
            if usable {
                kept |= 1 << p;
                (0..3).for_each(|channel| sweep(self.plane_mut(channel), size, p));
            }
        }
        for channel in 0..3 {
            self.keep(channel, kept);
        }
        kept
    }

    /// Zeroes the rows and columns of who is not in `kept`.
    fn keep(&mut self, channel: usize, kept: u32) {
        let size = self.size;
        for (at, entry) in self.plane_mut(channel).iter_mut().enumerate() {
            if kept >> (at / size) & 1 == 0 || kept >> (at % size) & 1 == 0 {
                *entry = 0.0;
            }
        }
    }
}

/// What makes a block of patches part of the matrix; see [`LocalMatrix::add_block`] for the formulas.
#[derive(Debug, Clone)]
pub struct Entering {
    /// Who enters, a bit each.
    pub kept: u32,
    /// `N`: columns of `G` before the loop is closed, times it, are the new columns of `G`.
    pub inverse: SmallMatrices,
    /// `T N`: what the new patches exchange among themselves, all bounces included.
    pub among: SmallMatrices,
    /// `K = N c A^-1`, symmetric: the middle of the update of all other entries.
    pub factor: SmallMatrices,
}

impl Entering {
    /// `returned` is `T`, the light that comes back to each patch of each; `patch` gives reflectance and area (m2) of a
    /// place in the block. A patch whose pivot is below `pivot_min` in any channel does not enter.
    #[must_use]
    pub fn solve(returned: &SmallMatrices, pivot_min: f64, patch: impl Fn(usize) -> (Rgb, f32)) -> Self {
        let size = returned.size;
        let scale = |place: usize, channel: usize| {
            let (reflectance, area) = patch(place);
            f64::from(reflectance[channel]) / f64::from(area)
        };
        let mut inverse = SmallMatrices::zero(size);
        for channel in 0..3 {
            let system = inverse.plane_mut(channel).iter_mut().zip(returned.plane(channel));
            for (at, (entry, &returned)) in system.enumerate() {
                let identity = f64::from(u8::from(at / size == at % size));
                *entry = identity - scale(at / size, channel) * returned;
            }
        }
        let kept = inverse.invert(pivot_min);
        let (mut among, mut factor) = (SmallMatrices::zero(size), SmallMatrices::zero(size));
        for channel in 0..3 {
            product(returned.plane(channel), inverse.plane(channel), size, among.plane_mut(channel));
            among.keep(channel, kept);
            symmetrise(among.plane_mut(channel), size);
            let pairs = factor.plane_mut(channel).iter_mut().zip(inverse.plane(channel));
            for (at, (factor, &inverse)) in pairs.enumerate() {
                *factor = inverse * scale(at % size, channel);
            }
            symmetrise(factor.plane_mut(channel), size);
        }
        Self { kept, inverse, among, factor }
    }
}

/// `-K` of a block that leaves ([`LocalMatrix::remove_block`]): `exchange` is what its patches exchange among themselves,
/// `G[p, p]`; `patch` gives reflectance and area (m2) of a place in the block.
#[must_use]
pub fn leaving(exchange: SmallMatrices, patch: impl Fn(usize) -> (Rgb, f32)) -> SmallMatrices {
    let size = exchange.size;
    let mut matrices = exchange;
    let reflectance = |place: usize, channel: usize| f64::from(patch(place).0[channel]);
    let area = |place: usize| f64::from(patch(place).1);
    for channel in 0..3 {
        for (at, entry) in matrices.plane_mut(channel).iter_mut().enumerate() {
            let (receiver, sender) = (at / size, at % size);
            let identity = f64::from(u8::from(receiver == sender));
            *entry = identity + *entry / area(receiver) * reflectance(sender, channel);
        }
    }
    matrices.invert(0.0);
    for channel in 0..3 {
        for (at, entry) in matrices.plane_mut(channel).iter_mut().enumerate() {
            *entry *= -reflectance(at / size, channel) / area(at % size);
        }
        symmetrise(matrices.plane_mut(channel), size);
    }
    matrices
}

/// One step of the in-place Gauss-Jordan inverse.
fn sweep(matrix: &mut [f64], size: usize, p: usize) {
    let reciprocal = 1.0 / matrix[p * size + p];
    let mut pivot_row = [0.0; LocalMatrix::BLOCK_MAX];
    for (scaled, entry) in pivot_row.iter_mut().zip(&mut matrix[p * size..(p + 1) * size]) {
        *entry *= reciprocal;
        *scaled = *entry;
    }
    for (i, row) in matrix.chunks_exact_mut(size).enumerate() {
        if i != p {
            let factor = row[p];
            for (entry, pivot) in row.iter_mut().zip(&pivot_row) {
                *entry -= factor * pivot;
            }
            row[p] = -factor * reciprocal;
        }
    }
    matrix[p * size + p] = reciprocal;
}

/// `a * b`, square.
fn product(a: &[f64], b: &[f64], size: usize, out: &mut [f64]) {
    out.fill(0.0);
    for (a, out) in a.chunks_exact(size).zip(out.chunks_exact_mut(size)) {
        for (factor, b) in a.iter().zip(b.chunks_exact(size)) {
            for (out, b) in out.iter_mut().zip(b) {
                *out += factor * b;
            }
        }
    }
}

/// Replaces a matrix that is symmetric but for rounding by the mean of itself and its mirror image.
pub fn symmetrise(matrix: &mut [f64], size: usize) {
    for row in 1..size {
        for column in 0..row {
            let mean = 0.5 * (matrix[row * size + column] + matrix[column * size + row]);
            matrix[row * size + column] = mean;
            matrix[column * size + row] = mean;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> SmallMatrices {
        let mut matrices = SmallMatrices::zero(3);
        for channel in 0..3 {
            let values = [1.0, -0.2, -0.1, -0.3, 0.9, -0.2, -0.1, -0.4, 0.8];
            matrices.plane_mut(channel).copy_from_slice(&values);
        }
        matrices
    }

    #[test]
    fn the_inverse_times_the_matrix_is_one() {
        let (original, mut inverse) = (example(), example());
        assert_eq!(inverse.invert(0.05), 0b111);
        let mut identity = [0.0; 9];
        product(original.plane(1), inverse.plane(1), 3, &mut identity);
        for (at, entry) in identity.iter().enumerate() {
            assert!((entry - f64::from(u8::from(at % 4 == 0))).abs() < 1e-12, "{at}: {entry}");
        }
    }

    /// Goal: a refused patch is as if it had not come. Method: refuse the middle one in one channel only;
    /// what stays is the inverse of the matrix without it, in all channels.
    #[test]
    fn a_weak_pivot_is_left_out() {
        let mut matrices = example();
        matrices.plane_mut(2)[4] = 0.06 + 0.04;
        assert_eq!(matrices.invert(0.05), 0b101, "1 - 0.9 - 0.06 is weak");
        let determinant = 1.0 * 0.8 - 0.1 * 0.1;
        let plane = matrices.plane(0);
        let expected = [0.8, 0.0, 0.1, 0.0, 0.0, 0.0, 0.1, 0.0, 1.0].map(|value| value / determinant);
        assert!(plane.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12), "{plane:?}");
    }
}
