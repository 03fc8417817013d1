//! Random streams and directions for paths.

use earthshine_world::Vec3;
use earthshine_world::random::{Purpose, hash, unit_pair};
use std::f32::consts::TAU;

pub use earthshine_trace::hemisphere::spread_pair;

/// Numbers in `[0, 1)`, two at a time: hashes of (seed, path, how many were taken).
#[derive(Debug, Clone)]
pub struct PathStream {
    seed: u64,
    path: u64,
    taken: u64,
}

impl PathStream {
    /// The stream of path number `path` under `seed`.
    #[must_use]
    pub fn new(seed: u64, path: u64) -> Self {
        Self { seed, path, taken: 0 }
    }

    /// The next two numbers.
    pub fn pair(&mut self) -> (f32, f32) {
        self.taken += 1;
        unit_pair(hash(self.seed, Purpose::ReferencePath, self.path, self.taken))
    }
}

/// Point `index` of the R4 sequence (M. Roberts, 2018), shifted by `shifts`, as two pairs: any run of consecutive indices
/// covers the hypercube evenly, and the square of each pair too.
#[must_use]
pub fn spread_pairs(index: u32, shifts: [f32; 4]) -> [(f32, f32); 2] {
    // 1/g to 1/g^4 for the positive root of g^5 = g + 1, as 32-bit fractions: exact for any index.
    const STEPS: [u32; 4] = [3_679_390_609, 3_152_041_523, 2_700_274_806, 2_313_257_605];
    let along = |k: usize| {
        let turn = index.wrapping_mul(STEPS[k]) >> 8;
        (turn as f32 * (1.0 / (1u32 << 24) as f32) + shifts[k]).fract().min(1.0 - f32::EPSILON)
    };
    [(along(0), along(1)), (along(2), along(3))]
}

/// A direction in the hemisphere around unit `normal` with density `cos / pi`.
#[must_use]
pub fn cosine_direction(normal: Vec3, (a, b): (f32, f32)) -> Vec3 {
    let (side, up) = normal.any_orthonormal_pair();
    let radius = a.sqrt();
    let (sin, cos) = (TAU * b).sin_cos();
    (side * (radius * cos) + up * (radius * sin) + normal * (1.0 - a).max(0.0).sqrt()).normalize_or(normal)
}

/// Barycentric `(u, v)` uniform over a triangle.
#[must_use]
pub fn triangle_point((a, b): (f32, f32)) -> (f32, f32) {
    let root = a.sqrt();
    (root * (1.0 - b), root * b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_have_the_mean_cosine_of_a_lambertian() {
        let normal = Vec3::new(0.48, -0.6, 0.64);
        let mut stream = PathStream::new(1, 2);
        let mean =
            (0..20_000).map(|_| cosine_direction(normal, stream.pair()).dot(normal)).sum::<f32>() / 2e4;
        assert!((mean - 2.0 / 3.0).abs() < 0.005, "{mean}");
    }

    /// Goal: four numbers together are even, not each pair alone. Method: the means of a product of four, and of a step in one number
    /// of each pair, over shifts: against what as many random numbers are off.
    #[test]
    fn four_numbers_are_spread_evenly_together() {
        let mut stream = PathStream::new(7, 0);
        let count = 4096;
        let (mut products, mut quarters) = (0.0f64, 0.0f64);
        for _ in 0..16 {
            let ((a, b), (c, d)) = (stream.pair(), stream.pair());
            let (mut product, mut quarter) = (0.0, 0.0);
            for [(a, b), (c, d)] in (0..count).map(|i| spread_pairs(i, [a, b, c, d])) {
                product += f64::from(a * b * c * d) / f64::from(count);
                quarter += if a < 0.5 && d < 0.5 { 1.0 } else { 0.0 } / f64::from(count);
            }
            products += (product - 0.0625).powi(2) / 16.0;
            quarters += (quarter - 0.25).powi(2) / 16.0;
        }
        // Of random numbers 0.0014 and 0.0068.
        assert!(products.sqrt() < 7e-4 && quarters.sqrt() < 2e-3, "{} {}", products.sqrt(), quarters.sqrt());
    }

    #[test]
    fn triangle_points_have_the_centroid_as_their_mean() {
        let mut stream = PathStream::new(1, 3);
        let mut sum = (0.0, 0.0);
        for _ in 0..20_000 {
            let (u, v) = triangle_point(stream.pair());
            assert!(u >= 0.0 && v >= 0.0 && u + v <= 1.0 + 1e-6);
            sum = (sum.0 + u / 2e4, sum.1 + v / 2e4);
        }
        assert!((sum.0 - 1.0 / 3.0).abs() < 0.01 && (sum.1 - 1.0 / 3.0).abs() < 0.01, "{sum:?}");
    }
}
