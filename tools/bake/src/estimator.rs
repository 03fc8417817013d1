//! Who finds rows: rays in a fixed number, rays until an error is met, or sums over pairs of points.
//!
//! All give a [`RawRow`] a patch, alike in all that comes after. Start at [`Estimator::new`].

use crate::BakeError;
use crate::adaptive::{ErrorTarget, refined_row};
use crate::point_rows::PointSums;
use crate::rows::{RawRow, RowCaster};
use earthshine_tiles::RowEstimator;

/// Finds rows as the bake's parameters say.
#[derive(Debug)]
pub struct Estimator<'a> {
    caster: RowCaster<'a>,
    way: Way,
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
        let method = &caster.parameters.method;
        let way = match method.estimator {
            RowEstimator::Points => Way::Points(PointSums::new(&caster)?),
            RowEstimator::Rays if method.row_error > 0.0 => Way::Refined(ErrorTarget {
                error: method.row_error,
                rays_min: method.rays_min,
                rays_max: method.rays_max,
            }),
            RowEstimator::Rays => Way::Rays(caster.parameters.rays_per_patch),
        };
        Ok(Self { caster, way })
    }

    /// The row of patch `index`. Its `rays` are those cast for it, or what it weighs as much as.
    #[must_use]
    pub fn row(&self, index: u32) -> RawRow {
        match &self.way {
            Way::Rays(rays) => self.caster.row(index, *rays),
            Way::Refined(target) => refined_row(&self.caster, index, *target),
            Way::Points(points) => points.row(&self.caster, index),
        }
    }
}

#[cfg(test)]
#[path = "estimator/tests.rs"]
mod tests;
