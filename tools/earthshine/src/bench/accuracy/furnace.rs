//! The furnaces: closed boxes of one reflectance and one emission, whose exitance is known exactly.

use super::measured;
use crate::bench::Report;
use crate::quality::QualityArguments;
use crate::scene_source;
use earthshine_gen::GenOptions;
use serde::Serialize;
use std::time::Instant;

/// Reflectances of the two furnaces.
const FURNACES: [f32; 2] = [0.5, 0.8];

#[derive(Serialize)]
struct FurnaceFigures {
    patches: u64,
    max_exitance_error_rel: f32,
    max_exitance_error_rel_by_reflectance: [f32; 2],
    bake_seconds: f64,
    world_bytes: u64,
}

pub(super) fn run(quality: &QualityArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let mut figures = FurnaceFigures {
        patches: 0,
        max_exitance_error_rel: 0.0,
        max_exitance_error_rel_by_reflectance: [0.0; 2],
        bake_seconds: 0.0,
        world_bytes: 0,
    };
    for (index, reflectance) in FURNACES.into_iter().enumerate() {
        let shape = GenOptions { furnace_reflectance: reflectance, ..GenOptions::default() };
        let source = scene_source::load_generated("furnace", None, false, &shape)?;
        let measured = measured::baked(&source, quality.parameters_of_patches(&source), json)?;
        let worst = measured.world.furnace_error();
        figures.max_exitance_error_rel_by_reflectance[index] = worst;
        figures.max_exitance_error_rel = figures.max_exitance_error_rel.max(worst);
        figures.patches += measured.patches;
        figures.bake_seconds += measured.bake_seconds.unwrap_or(0.0);
        figures.world_bytes += measured.world_bytes;
    }
    let seconds = started.elapsed().as_secs_f64();
    Report::new("accuracy", "furnace", "gather", quality.seed, seconds, figures).print(json)
}
