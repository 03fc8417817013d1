//! A closed room with known form factors, for tests and benches: patches on the inside of a unit cube.
//!
//! Not a bake: there is no geometry and nothing is occluded. The exchange `A_i F_ij` is
//! `A_i A_j d_i d_j cos cos / (pi r^2 + mean area)`, symmetric, with scales `d` found by symmetric Sinkhorn
//! iteration so that every row sums to one, from below. Rows are computed when asked for.

use crate::dense::{DenseError, DenseMatrix};
use earthshine_world::random::{Purpose, hash, unit_f32, unit_pair};
use earthshine_world::{Direction, Rgb, Vec3};
use rayon::prelude::*;

/// Rounds of the Sinkhorn iteration; each about squares away half of what is left.
const ROUNDS: u32 = 40;

/// Patches that see nothing but each other.
#[derive(Debug, Clone)]
pub struct ClosedBox {
    seed: u64,
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    areas: Vec<f32>,
    scales: Vec<f32>,
}

impl ClosedBox {
    /// A room of `patch_count` patches at seeded places, areas within a factor of three.
    #[must_use]
    pub fn new(patch_count: usize, seed: u64) -> Self {
        Self::build(patch_count, seed, |number| 0.5 + number)
    }

    /// A room whose areas are spread evenly in their logarithms over a ratio of `least` to one.
    #[must_use]
    pub fn uneven(patch_count: usize, seed: u64, least: f32) -> Self {
        Self::build(patch_count, seed, |number| least.powf(number))
    }

    /// Patches of `spread` times an even share of the walls, given a seeded number in 0..1.
    fn build(patch_count: usize, seed: u64, spread: impl Fn(f32) -> f32) -> Self {
        let mut room = Self {
            seed,
            positions: Vec::with_capacity(patch_count),
            normals: Vec::with_capacity(patch_count),
            areas: Vec::with_capacity(patch_count),
            scales: vec![1.0; patch_count],
        };
        for patch in 0..patch_count {
            let wall = Direction::ALL[patch % 6];
            let (s, t) = unit_pair(hash(seed, Purpose::WorldShape, patch as u64, 0));
            let mut position = Vec3::splat(if wall.index().is_multiple_of(2) { 0.0 } else { 1.0 });
            position[(wall.axis() + 1) % 3] = s;
            position[(wall.axis() + 2) % 3] = t;
            room.positions.push(position);
            room.normals.push(wall.vector());
            let number = unit_f32(hash(seed, Purpose::WorldShape, patch as u64, 1));
            room.areas.push(6.0 / patch_count as f32 * spread(number));
        }
        room.normalise();
        room
    }

    fn normalise(&mut self) {
        for _ in 0..ROUNDS {
            let sums = self.row_sums();
            for (scale, sum) in self.scales.iter_mut().zip(&sums) {
                *scale /= (sum.max(f64::from(f32::MIN_POSITIVE)) as f32).sqrt();
            }
        }
        let most = self.row_sums().into_iter().fold(0.0, f64::max);
        if most > 0.0 {
            let down = (most.sqrt().recip() * (1.0 - 1e-6)) as f32;
            self.scales.iter_mut().for_each(|scale| *scale *= down);
        }
    }

    fn row_sums(&self) -> Vec<f64> {
        let sum = |i| (0..self.len()).map(|j| f64::from(self.form_factor(i, j))).sum();
        (0..self.len()).into_par_iter().map(sum).collect()
    }

    /// Number of patches.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether it has no patches.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Area of a patch, m2.
    ///
    /// # Panics
    /// If there is no such patch.
    #[must_use]
    pub fn area(&self, patch: usize) -> f32 {
        self.areas[patch]
    }

    /// `F[i, j]`.
    ///
    /// # Panics
    /// If there is no such patch.
    #[must_use]
    pub fn form_factor(&self, i: usize, j: usize) -> f32 {
        let across = self.positions[j] - self.positions[i];
        let cosines = across.dot(self.normals[i]) * -across.dot(self.normals[j]);
        if cosines <= 0.0 {
            return 0.0;
        }
        let square = across.length_squared();
        // The mean area keeps neighbours across an edge finite; the same for both ways, or exchange would not be mutual.
        let kernel = cosines / (square * (std::f32::consts::PI * square + 6.0 / self.len() as f32));
        self.scales[i] * self.scales[j] * kernel * self.areas[j]
    }

    /// A seeded reflectance of a patch, 0.2..0.8 a channel.
    #[must_use]
    pub fn reflectance(&self, patch: usize) -> Rgb {
        let channel = |c| 0.2 + 0.6 * unit_f32(hash(self.seed, Purpose::WorldShape, patch as u64, c));
        Rgb::new(channel(2), channel(3), channel(4))
    }

    /// All form factors.
    ///
    /// # Errors
    /// [`DenseError::Memory`].
    pub fn dense_form_factors(&self) -> Result<DenseMatrix, DenseError> {
        DenseMatrix::from_fn(self.len(), self.len(), |i, j| f64::from(self.form_factor(i, j)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::invariant::{exchange_is_mutual, row_sums_to_one, shares_are_shares};

    #[test]
    fn the_room_is_closed_and_mutual() {
        let room = ClosedBox::new(200, 1);
        for i in 0..room.len() {
            let row: Vec<f32> = (0..room.len()).map(|j| room.form_factor(i, j)).collect();
            shares_are_shares(i, row.iter().copied().enumerate()).expect("shares");
            let sum: f64 = row.iter().map(|&share| f64::from(share)).sum();
            row_sums_to_one(i, sum).expect("closed");
            assert!(sum <= 1.0, "row {i} makes energy: {sum}");
            for (j, &share) in row.iter().enumerate() {
                let (forth, back) = ((room.area(i), share), (room.area(j), room.form_factor(j, i)));
                exchange_is_mutual(i, j, forth, back, 1e-5).expect("mutual");
            }
        }
    }
}
