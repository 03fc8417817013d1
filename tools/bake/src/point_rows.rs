//! The sources' rows: sums over pairs of sample points, with a visibility ray each.
//!
//! `F_ij = mean over i's points p of sum over j's points q of V(p,q) cos_p cos_q A_q / (pi r^2 + A_q)`, each point
//! standing for an equal share `A_q` of its patch. The `A_q` below keeps points that almost touch from giving more
//! than all (the disc form of GPU Gems 2, ch. 39). Quadratic in patches: a reference for small scenes.
//!
//! The sources give to the sky what is left of one. Here sky and absorbed shares come from rays, as they do for the
//! other estimators, and what the sums are off by is for [`reciprocity`](crate::reciprocity) to balance.

use crate::BakeError;
use crate::rows::{RAY_OFFSET, RawRow, RowCaster};
use earthshine_trace::SceneTracer;
use earthshine_world::Vec3;

/// Most pairs of points of a bake: minutes on a core.
pub const PAIRS_MAX: u64 = 1 << 30;
/// Shares below this are nothing.
const SHARE_MIN: f32 = 1e-7;

/// The points of all patches.
#[derive(Debug)]
pub struct PointSums {
    points: Vec<Point>,
    /// One longer than there are patches.
    first: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Point {
    /// A little off its surface, m.
    position: Vec3,
    normal: Vec3,
    /// m2.
    area: f32,
}

impl PointSums {
    /// Chooses each patch's points.
    ///
    /// # Errors
    /// [`BakeError::TooManyPairs`] above [`PAIRS_MAX`].
    pub fn new(caster: &RowCaster<'_>) -> Result<Self, BakeError> {
        let parameters = caster.parameters;
        let (mut points, mut first) = (Vec::new(), vec![0]);
        for patch in caster.sources {
            let chosen = patch.representative_samples(parameters.points_per_patch, parameters.seed);
            let area = patch.patch.area / chosen.len() as f32;
            points.extend(chosen.iter().map(|&sample| {
                let sample = &caster.samples[sample as usize];
                let off = sample.normal * (RAY_OFFSET * parameters.grid.voxel_edge_m);
                Point { position: sample.position + off, normal: sample.normal, area }
            }));
            first.push(points.len() as u32);
        }
        let pairs = (points.len() as u64).saturating_mul(points.len() as u64);
        if pairs > PAIRS_MAX {
            let patches = caster.set.len();
            return Err(BakeError::TooManyPairs { patches, pairs, max: PAIRS_MAX });
        }
        Ok(Self { points, first })
    }

    /// The row of patch `index`; it weighs as much as any other.
    #[must_use]
    pub fn row(&self, caster: &RowCaster<'_>, index: u32) -> RawRow {
        // Rays find what points cannot: what is not a patch.
        let mut row = caster.row(index, caster.parameters.rays_per_patch);
        row.entries.clear();
        let own = self.of(index as usize);
        for other in 0..self.first.len() - 1 {
            let sum: f32 = own.iter().map(|p| self.arriving(caster.tracer.tracer(), p, other)).sum();
            let share = (sum / own.len() as f32).min(1.0);
            if share > SHARE_MIN {
                row.entries.push((other as u32, share));
            }
        }
        row
    }

    fn of(&self, patch: usize) -> &[Point] {
        &self.points[self.first[patch] as usize..self.first[patch + 1] as usize]
    }

    /// The form factor from the surface at `p` to patch `other`.
    fn arriving(&self, tracer: &SceneTracer<'_>, p: &Point, other: usize) -> f32 {
        let mut sum = 0.0;
        for q in self.of(other) {
            let between = q.position - p.position;
            let squared = between.length_squared();
            let (here, there) = (p.normal.dot(between), -q.normal.dot(between));
            if here <= 0.0 || there <= 0.0 || squared <= f32::MIN_POSITIVE {
                continue;
            }
            let distance = squared.sqrt();
            // A hair short of the other point, which lies off its surface already.
            if !tracer.is_blocked(p.position, between / distance, distance * 0.9999) {
                sum += here * there / squared * q.area / (std::f32::consts::PI * squared + q.area);
            }
        }
        sum
    }
}
