//! Reference light at points: our own path tracer, under a progress bar.
//!
//! Light of other renderers comes from files: `earthshine_render::csv`.

use crate::progress_bars::counted;
use earthshine_render::csv::ReferencePoint;
use earthshine_render::{ReferenceOptions, SceneTracer, irradiance_at_points};
use earthshine_world::{LightRig, Vec3};

/// Traces the light at `places` (position, unit normal), in that order.
pub(crate) fn traced(
    tracer: &SceneTracer<'_>,
    lights: &LightRig,
    places: &[(Vec3, Vec3)],
    options: &ReferenceOptions,
    quiet: bool,
) -> Vec<ReferencePoint> {
    let bar = counted("reference", "points", places.len() as u64, quiet);
    let estimates = irradiance_at_points(tracer, lights, places, options, &|| bar.inc(1));
    bar.finish_and_clear();
    places.iter().zip(&estimates).map(|(&place, estimate)| ReferencePoint::of(place, estimate)).collect()
}
