//! Errors in order: which causes, voxels and points make up most of them.

use super::{Cause, Explained};
use earthshine_render::compare_points::DARK_SHARE;
use serde::Serialize;
use std::collections::BTreeMap;

/// What a cause has to do with the errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct CauseShare {
    pub cause: Cause,
    /// Points that it explains more of than any other.
    pub points: usize,
    /// Their share of the sum of squared errors.
    pub squared_error_share: f64,
    /// Their share of the sum of relative errors.
    pub relative_error_share: f64,
    /// Its part of all squared errors, `sum e e_cause / sum e^2`: adds up to one, below zero where it mends others.
    pub part_of_squared_error: f64,
    /// What it adds to the mean light, as a share of the mean reference: adds up to the bias.
    pub bias: f64,
}

/// A voxel's errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct VoxelErrors {
    pub voxel: [i32; 3],
    pub points: usize,
    pub squared_error_share: f64,
    pub mean_relative_error: f64,
    /// The cause with the largest part of its squared errors.
    pub cause: Cause,
}

/// All of it, worst first.
#[derive(Debug)]
pub(crate) struct Ranking<'a> {
    pub causes: Vec<CauseShare>,
    pub voxels: Vec<VoxelErrors>,
    pub points: Vec<RankedPoint<'a>>,
}

/// A point with its rank's figures.
#[derive(Debug)]
pub(crate) struct RankedPoint<'a> {
    pub explained: &'a Explained,
    pub relative_error: f64,
    pub squared_error_share: f64,
    pub cause: Cause,
}

/// Ranks points by their squared error.
pub(crate) fn rank(explained: &[Explained]) -> Ranking<'_> {
    let mean_reference =
        explained.iter().map(|point| point.reference).sum::<f64>() / explained.len().max(1) as f64;
    let floor = (DARK_SHARE * mean_reference).max(f64::MIN_POSITIVE);
    let total: f64 = explained.iter().map(|point| point.error().powi(2)).sum();
    let share_of = |squared: f64| if total > 0.0 { squared / total } else { 0.0 };
    let mut points: Vec<RankedPoint<'_>> = explained
        .iter()
        .map(|point| RankedPoint {
            explained: point,
            relative_error: point.error() / point.reference.max(floor),
            squared_error_share: share_of(point.error().powi(2)),
            cause: point.cause(),
        })
        .collect();
    points.sort_by(|a, b| {
        let size = |point: &RankedPoint<'_>| point.explained.error().abs();
        size(b).total_cmp(&size(a)).then(a.explained.index.cmp(&b.explained.index))
    });
    let causes = cause_shares(&points, total, mean_reference);
    let voxels = voxels(&points);
    Ranking { causes, voxels, points }
}

fn cause_shares(points: &[RankedPoint<'_>], total: f64, mean_reference: f64) -> Vec<CauseShare> {
    let relative_total: f64 = points.iter().map(|point| point.relative_error.abs()).sum();
    let over = |sum: f64, whole: f64| if whole > 0.0 { sum / whole } else { 0.0 };
    let mut shares: Vec<CauseShare> = Cause::ALL
        .into_iter()
        .map(|cause| {
            let mine = || points.iter().filter(|point| point.cause == cause && point.relative_error != 0.0);
            let part = |point: &RankedPoint<'_>| point.explained.parts.of(cause);
            let sum = |value: &dyn Fn(&RankedPoint<'_>) -> f64| points.iter().map(value).sum::<f64>();
            CauseShare {
                cause,
                points: mine().count(),
                squared_error_share: mine().map(|point| point.squared_error_share).sum(),
                relative_error_share: over(
                    mine().map(|point| point.relative_error.abs()).sum(),
                    relative_total,
                ),
                part_of_squared_error: over(sum(&|point| part(point) * point.explained.error()), total),
                bias: over(sum(&part), mean_reference * points.len() as f64),
            }
        })
        .collect();
    shares
        .sort_by(|a, b| b.squared_error_share.total_cmp(&a.squared_error_share).then(a.cause.cmp(&b.cause)));
    shares
}

fn voxels(points: &[RankedPoint<'_>]) -> Vec<VoxelErrors> {
    let mut by_voxel: BTreeMap<[i32; 3], Vec<&RankedPoint<'_>>> = BTreeMap::new();
    for point in points {
        by_voxel.entry(point.explained.voxel.to_array()).or_default().push(point);
    }
    let mut voxels: Vec<VoxelErrors> = by_voxel
        .into_iter()
        .map(|(voxel, points)| {
            let part = |cause: Cause| -> f64 {
                points.iter().map(|p| p.explained.parts.of(cause) * p.explained.error()).sum()
            };
            let cause = Cause::ALL.into_iter().max_by(|a, b| part(*a).total_cmp(&part(*b)));
            VoxelErrors {
                voxel,
                points: points.len(),
                squared_error_share: points.iter().map(|point| point.squared_error_share).sum(),
                mean_relative_error: points.iter().map(|p| p.relative_error.abs()).sum::<f64>()
                    / points.len() as f64,
                cause: cause.unwrap_or(Cause::Noise),
            }
        })
        .collect();
    voxels
        .sort_by(|a, b| b.squared_error_share.total_cmp(&a.squared_error_share).then(a.voxel.cmp(&b.voxel)));
    voxels
}
