//! Who finds rows: rays in a fixed number, rays until an error is met, or sums over pairs of points.
//!
//! Patches that emit may cast more rays than others ([`BakeMethod::emitter_factor`]): most light comes from few of them,
//! and what a small lamp sends to a large wall its own rays tell better than the wall's. All ways give a [`RawRow`] a patch, alike in all that comes after. Start at [`Estimator::new`].

use crate::BakeError;
use crate::adaptive::{BATCH_RAYS, ErrorTarget, Refinement, refined_row};
use crate::counted_rows::{RayPlan, RowInquiry};
use crate::patches::PatchSet;
use crate::point_rows::PointSums;
use crate::rows::{RawRow, RowCaster};
use earthshine_tiles::{BakeMethod, BakeParameters, RowEstimator};
use earthshine_world::Rgb;

/// Finds rows as the bake's parameters say.
#[derive(Debug)]
pub struct Estimator<'a> {
    caster: RowCaster<'a>,
    way: Way,
    /// How many times the rays of others an emitter casts.
    emitter_factor: u32,
}

#[derive(Debug)]
enum Way {
    Rays(u32),
    Refined(ErrorTarget),
    Points(PointSums),
}

impl<'a> Estimator<'a> {
    /// The estimator that the parameters name.
    ///
    /// # Errors
    /// [`BakeError::TooManyPairs`] for a sum over points on more patches than it is for.
    pub fn new(caster: RowCaster<'a>) -> Result<Self, BakeError> {
        let factor = emitter_factor(caster.set, caster.parameters);
        let of_rays = Self::with_factor(caster, factor);
        match caster.parameters.method.estimator {
            RowEstimator::Points => Ok(Self { way: Way::Points(PointSums::new(&caster)?), ..of_rays }),
            RowEstimator::Rays => Ok(of_rays),
        }
    }

    /// The one that casts rays, where it is known that emitters cast `emitter_factor` times the rays of others.
    pub(crate) fn with_factor(caster: RowCaster<'a>, emitter_factor: u32) -> Self {
        let method = &caster.parameters.method;
        let way = match method.estimator {
            RowEstimator::Rays if method.row_error > 0.0 => Way::Refined(ErrorTarget {
                error: method.row_error,
                rays_min: method.rays_min,
                rays_max: method.rays_max,
            }),
            RowEstimator::Rays | RowEstimator::Points => Way::Rays(caster.parameters.rays_per_patch),
        };
        Self { caster, way, emitter_factor }
    }

    /// The row of patch `index`. Its `rays` are those cast for it, or what it weighs as much as.
    #[must_use]
    pub fn row(&self, index: u32) -> RawRow {
        match &self.way {
            Way::Rays(rays) => self.caster.row(index, self.times(index, *rays)),
            Way::Refined(target) => refined_row(&self.caster, index, self.own_target(index, target)),
            Way::Points(points) => points.row(&self.caster, index),
        }
    }

    /// How often the usual rays patch `index` casts.
    fn factor(&self, index: u32) -> u32 {
        if emits(self.caster.set, index as usize) { self.emitter_factor } else { 1 }
    }

    fn times(&self, index: u32, rays: u32) -> u32 {
        rays.saturating_mul(self.factor(index)).min(BakeMethod::RAYS_MAX)
    }

    fn own_target(&self, index: u32, target: &ErrorTarget) -> ErrorTarget {
        // So many more rays are worth the root of it.
        let error = target.error / (self.factor(index) as f32).sqrt();
        ErrorTarget { error, rays_max: self.times(index, target.rays_max), ..*target }
    }
}

impl<'a> Estimator<'a> {
    /// The row of patch `index` for a device to count the ends of: of the same rays as [`Self::row`].
    ///
    /// # Panics
    /// If rows are sums over points: they have no rays.
    pub(crate) fn inquiry(&self, index: u32) -> RowInquiry<'a> {
        let (plan, most) = match &self.way {
            Way::Rays(rays) => {
                let rays = self.times(index, *rays);
                (RayPlan::Fixed(rays), rays)
            }
            Way::Refined(target) => {
                let target = self.own_target(index, target);
                (RayPlan::Refined(Refinement::new(target)), target.rays_max)
            }
            Way::Points(_) => unreachable!("sums over points have the whole world, and no device"),
        };
        let (caster, source, spread) =
            (self.caster, self.caster.source(index), self.caster.spread(index, most));
        RowInquiry { caster, source, spread, plan }
    }

    /// Casts the rays that [`Self::row`] casts for a row that comes to rest on `rays` of them, whatever they find.
    pub(crate) fn recast(&self, index: u32, rays: u32) {
        let Way::Refined(target) = &self.way else {
            drop(self.row(index));
            return;
        };
        let spread = self.caster.spread(index, self.times(index, target.rays_max));
        for first in (0..rays).step_by(BATCH_RAYS as usize) {
            drop(self.caster.run(index, &spread, first..first + BATCH_RAYS));
        }
    }
}

pub(crate) fn emits(set: &PatchSet, patch: usize) -> bool {
    set.patches[patch].patch.emission != Rgb::ZERO
}

/// What the parameters allow, but no more rays for all emitters than for all patches. A power of two, so that it
/// seldom changes with the scene.
pub(crate) fn emitter_factor(set: &PatchSet, parameters: &BakeParameters) -> u32 {
    let emitters = (0..set.len()).filter(|&patch| emits(set, patch)).count();
    let room = (set.len() / emitters.max(1)).clamp(1, BakeMethod::EMITTER_FACTOR_MAX as usize) as u32;
    let allowed = parameters.method.emitter_factor.clamp(1, room);
    1 << allowed.ilog2()
}

#[cfg(test)]
#[path = "estimator/tests.rs"]
mod tests;
