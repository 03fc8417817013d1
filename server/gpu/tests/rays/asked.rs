//! Scenes, rays through them, and what is asked of a device in its own words.

use earthshine_gen::{GenOptions, WorldKind};
use earthshine_gpu::ends::{
    BURIED_IN_PLACES, EndRun, EndSide, RayFan as FanWords, SIDE_BACK_BURIED, SIDE_FOR_HOST,
    SIDE_FOR_HOST_IN_PLACES, SIDE_FRONT_BURIED, SIDE_TWO_SIDED, SUM_ABSORBED, SUM_WHOLE,
};
use earthshine_gpu::{AdapterChoice, GpuDevice};
use earthshine_scene::{ImportOptions, Scene, load_bytes};
use earthshine_shaders::host::RayQuery;
use earthshine_trace::ends::{Buried, EndTriangle, Run, RunSum};
use earthshine_trace::{Query, RayFan};
use earthshine_world::Vec3;
use earthshine_world::random::{Purpose, hash, unit_pair};
use std::io::Write as _;

/// Past the test harness, which swallows what passing tests print.
pub(crate) fn say(line: &str) {
    writeln!(std::io::stderr(), "{line}").expect("standard error");
}

/// Any adapter, or none with the reason printed; none is a failure where CI says so.
pub(crate) fn device_or_skip() -> Option<GpuDevice> {
    device_within(u64::MAX)
}

/// As [`device_or_skip`], one that binds no more than so many bytes.
pub(crate) fn device_within(binding_bytes_max: u64) -> Option<GpuDevice> {
    let choice = AdapterChoice { allow_software: true, ..AdapterChoice::default() };
    match GpuDevice::open_within(&choice, binding_bytes_max) {
        Ok(device) => Some(device),
        Err(error) => {
            assert!(std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none(), "{error}");
            say(&format!("SKIPPED a test of rays: {error}"));
            None
        }
    }
}

/// A generated world; a town has this edge.
pub(crate) fn generated(kind: WorldKind, seed: u64, town_size_m: f32) -> Scene {
    let options = GenOptions { seed, town_size_m, ..GenOptions::default() };
    let glb = earthshine_gen::generate(kind, &options, &|_, _| {}).expect("a world");
    load_bytes(&glb.bytes, "test", &ImportOptions::default()).expect("an importable world")
}

/// Rays from all over the scene in all directions, one in four along an axis, one in eight not far.
pub(crate) fn queries(scene: &Scene, count: u64) -> Vec<Query> {
    let bounds = scene.bounds();
    let draw = |index: u64, part: u64| unit_pair(hash(11, Purpose::RowRay, index, part));
    let one = |index: u64| {
        let ((a, b), (c, d), (e, f)) = (draw(index, 0), draw(index, 1), draw(index, 2));
        let origin = bounds.min + bounds.size() * Vec3::new(a, b, e);
        let up = 2.0 * c - 1.0;
        let (sin, cos) = (d * std::f32::consts::TAU).sin_cos();
        let flat = (1.0 - up * up).max(0.0).sqrt();
        let direction = Vec3::new(flat * cos, up, flat * sin).normalize_or(Vec3::Y);
        let along = [Vec3::X, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_X][index as usize / 4 % 4];
        let direction = if index.is_multiple_of(4) { along } else { direction };
        let far = if index % 8 == 3 { 10.0 * f } else { f32::INFINITY };
        Query { origin, direction, distance_max: far }
    };
    (0..count).map(one).collect()
}

pub(crate) fn words(queries: &[Query]) -> Vec<RayQuery> {
    let word = |query: &Query| {
        let (origin, direction, distance_min_m, distance_max_m) = query.as_asked();
        let (origin, direction) = (origin.to_array(), direction.to_array());
        RayQuery { origin, distance_min_m, direction, distance_max_m }
    };
    queries.iter().map(word).collect()
}

pub(crate) fn fan_words(fans: &[RayFan]) -> Vec<FanWords> {
    let word = |fan: &RayFan| FanWords {
        origin: fan.origin.to_array(),
        normal: fan.normal.to_array(),
        shift: fan.shift.into(),
        first_pair: fan.first_pair,
        ray_count: fan.ray_count,
        ..FanWords::default()
    };
    fans.iter().map(word).collect()
}

pub(crate) fn run_words(run: &Run) -> EndRun {
    let sum = match run.sum {
        RunSum::Whole => SUM_WHOLE,
        RunSum::Facing(direction) => direction.index() as u32,
        RunSum::Absorbed => SUM_ABSORBED,
    };
    EndRun { first_ray: run.first_ray, ray_count: run.ray_count, sum }
}

pub(crate) fn sides(triangles: &[EndTriangle]) -> Vec<EndSide> {
    let buried = |(flag, buried): (u32, Buried)| match buried {
        Buried::Nowhere => 0,
        Buried::InPlaces => flag << BURIED_IN_PLACES,
        Buried::Everywhere => flag,
    };
    let sides_buried = |triangle: &EndTriangle| -> u32 {
        [SIDE_FRONT_BURIED, SIDE_BACK_BURIED].into_iter().zip(triangle.buried).map(buried).sum()
    };
    let side = |triangle: &EndTriangle| EndSide {
        normal: triangle.normal.to_array(),
        flags: u32::from(triangle.is_for_host) * SIDE_FOR_HOST
            + u32::from(triangle.is_for_host_in_places) * SIDE_FOR_HOST_IN_PLACES
            + u32::from(triangle.is_two_sided) * SIDE_TWO_SIDED
            + sides_buried(triangle),
        parts: triangle.parts,
        spare: 0,
    };
    triangles.iter().map(side).collect()
}
