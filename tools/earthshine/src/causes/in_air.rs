//! Points where light in the air answers, alone or beside surfaces: its error is what a final gather at the point finds
//! better, taken as one part. Which receiver is off, and by rays, place or the six directions, is not told apart.

use super::Cause;
use super::explain::{Evidence, Explained, Explainer, PointSum};
use super::mean;
use earthshine_bake::sample::voxel_of;
use earthshine_render::csv::ReferencePoint;

/// Light that differs by less than this share is the same: rounding.
const SAME_LIGHT_REL: f64 = 1e-5;

/// Whether two lookups of a point agree.
pub(super) fn is_same(one: f64, other: f64) -> bool {
    (one - other).abs() <= SAME_LIGHT_REL * one.abs().max(other.abs())
}

impl Explainer<'_> {
    /// The error of `served` light at `point`, which is not that of surfaces alone.
    pub(super) fn in_air(&self, index: usize, point: &ReferencePoint, served: f64) -> Explained {
        let seen = self.scene.gather_place(point.position, point.normal, self.options.point_rays);
        let mut sum = PointSum::new(self, point, seen.light);
        sum.parts.add(Cause::Air, served - seen.light);
        let (reference, reference_noise) = (mean(point.irradiance), mean(point.standard_error));
        let (parts, evidence) = sum.finish(&seen, reference, reference_noise);
        Explained {
            index,
            position: point.position,
            normal: point.normal,
            voxel: voxel_of(point.position, point.normal, self.scene.voxel_edge_m()),
            reference,
            reference_noise,
            served,
            parts,
            evidence: Evidence { in_air: true, ..evidence },
        }
    }
}
