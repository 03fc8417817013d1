//! The points that are off by more than a factor of two, and why: at most one in a hundred may be.

use super::explained;
use super::measured::Measured;
use crate::causes::Cause;
use crate::output::out;
use crate::scene_source::SceneSource;
use anyhow::ensure;
use earthshine_render::compare_points::beyond_factor_two;
use earthshine_render::csv::ReferencePoint;
use earthshine_world::Rgb;
use serde::Serialize;

/// One of them.
#[derive(Debug, Serialize)]
pub(super) struct BeyondPoint {
    /// Its place in the reference.
    point: usize,
    /// m.
    position: [f32; 3],
    normal: [f32; 3],
    /// Mean of the channels, lx.
    served: f64,
    /// Mean of the channels, lx.
    reference: f64,
    /// What explains most of the error.
    cause: Cause,
}

/// Explains the points of `reference` at which `light` is beyond a factor of two.
pub(super) fn list(
    measured: &Measured,
    source: &SceneSource,
    reference: &[ReferencePoint],
    light: &[Option<Rgb>],
    quiet: bool,
) -> anyhow::Result<Vec<BeyondPoint>> {
    let indices = beyond_factor_two(reference, light);
    let points: Vec<ReferencePoint> = indices.iter().map(|&index| reference[index]).collect();
    let explained = explained(measured, source, &points, quiet)?;
    ensure!(explained.len() == points.len(), "{} of {} points explained", explained.len(), points.len());
    let beyond = indices.into_iter().zip(&explained).map(|(point, found)| BeyondPoint {
        point,
        position: found.position.to_array(),
        normal: found.normal.to_array(),
        served: found.served,
        reference: found.reference,
        cause: found.cause(),
    });
    Ok(beyond.collect())
}

/// Prints them for people.
pub(super) fn print(points: &[BeyondPoint]) {
    out!("\nbeyond a factor of two (lx)");
    out!("{:>6} {:>26} {:>12} {:>12}  cause", "point", "position, m", "served", "reference");
    for BeyondPoint { point, position: [x, y, z], served, reference, cause, .. } in points {
        let position = format!("{x:.3},{y:.3},{z:.3}");
        let (name, meaning) = (cause.name(), cause.meaning());
        out!("{point:>6} {position:>26} {served:>12.4} {reference:>12.4}  {name}: {meaning}");
    }
}
