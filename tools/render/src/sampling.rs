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
