//! The furnaces: closed boxes of one reflectance and one emission, whose light is known exactly: `B = E / (1 - rho)`
//! leaves every wall, and as much arrives.
//!
//! Two quantities are held against it: the exitance of every patch, and the light served at points, both as shares of the
//! closed form, so that both boxes weigh the same.

use super::{AccuracyArguments, measured, points};
use crate::bench::Report;
use crate::exit_code::WrongUse;
use crate::scene_source;
use crate::volume_light;
use earthshine_gen::GenOptions;
use earthshine_render::compare_points::{LightErrors, compare_points};
use earthshine_render::csv::ReferencePoint;
use earthshine_world::Rgb;
use serde::Serialize;
use std::f32::consts::PI;
use std::time::Instant;

/// Reflectances of the two furnaces.
const FURNACES: [f32; 2] = [0.5, 0.8];

#[derive(Serialize)]
struct FurnaceFigures {
    /// Of both boxes, like seconds and bytes.
    patches: u64,
    /// At points of both boxes.
    #[serde(flatten)]
    errors: LightErrors,
    max_exitance_error_rel: f32,
    max_exitance_error_rel_by_reflectance: [f32; 2],
    bake_seconds: f64,
    solve_seconds: f64,
    world_bytes: u64,
}

/// Measures both boxes.
pub(super) fn run(arguments: &AccuracyArguments, json: bool) -> anyhow::Result<()> {
    check(arguments)?;
    let started = Instant::now();
    let (quality, solving) = (&arguments.quality, &arguments.solving);
    let (mut patches, mut world_bytes) = (0, 0);
    let (mut bake_seconds, mut solve_seconds) = (0.0, 0.0);
    let mut exitance_errors = [0.0; 2];
    let (mut reference, mut light) = (Vec::new(), Vec::new());
    for (reflectance, exitance_error) in FURNACES.into_iter().zip(&mut exitance_errors) {
        let shape = GenOptions { furnace_reflectance: reflectance, ..GenOptions::default() };
        let source = scene_source::load_generated("furnace", None, false, &shape)?;
        let found = measured::baked_for(solving, &source, quality.parameters_of_patches(&source), json)?;
        *exitance_error = found.world.furnace_error(&found.light);
        let closed_form = PI * shape.furnace_radiance / (1.0 - reflectance);
        for (position, normal) in points::places(arguments, &source)? {
            let served = volume_light::at(&found.volumes, position, normal);
            light.push(served.map(|served| served / closed_form));
            reference.push(ReferencePoint {
                position,
                normal,
                irradiance: Rgb::ONE,
                standard_error: Rgb::ZERO,
            });
        }
        patches += found.patches;
        bake_seconds += found.bake_seconds.unwrap_or(0.0);
        solve_seconds += found.solve_seconds;
        world_bytes += found.world_bytes;
    }
    let figures = FurnaceFigures {
        patches,
        errors: compare_points(&reference, &light)?,
        max_exitance_error_rel: exitance_errors.into_iter().fold(0.0, f32::max),
        max_exitance_error_rel_by_reflectance: exitance_errors,
        bake_seconds,
        solve_seconds,
        world_bytes,
    };
    let seconds = started.elapsed().as_secs_f64();
    Report::new("accuracy", "furnace", solving.name(), quality.seed, seconds, figures)
        .on(solving.backend.name())
        .print(json)
}

/// Options that would be ignored are refused.
fn check(arguments: &AccuracyArguments) -> Result<(), WrongUse> {
    let faults = [
        (
            arguments.reference.is_some() || arguments.write_reference.is_some(),
            "--scene furnace has a closed form for its reference: leave --reference and --write-reference out",
        ),
        (
            arguments.noise.is_some(),
            "--scene furnace has a closed form for its reference, which has no noise: leave --noise out",
        ),
        (arguments.lights.is_some(), "--scene furnace is lit by its walls alone: leave --lights out"),
        (
            arguments.world.is_some(),
            "--scene furnace bakes two boxes, one for each reflectance: leave --world out",
        ),
        (
            arguments.sweep.is_some() || arguments.seeds > 1,
            "--scene furnace is measured once, for two reflectances: leave --sweep and --seeds out, and run it with \
             another --voxel, --rays or --seed",
        ),
        (
            arguments.report.is_some() || arguments.worst || arguments.out.is_some(),
            "--scene furnace has even light and nothing to explain: leave --report, --worst and --out out",
        ),
    ];
    faults.into_iter().find(|fault| fault.0).map_or(Ok(()), |fault| Err(WrongUse(fault.1)))
}
