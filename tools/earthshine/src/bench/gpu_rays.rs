//! `bench gpu`: rays of a bake through a generated town, on a device and on all cores of the CPU.
//!
//! Rays begin on random surfaces, 256 from each place over its hemisphere by the cosine, as rows' rays do.

use crate::ray_device::words;
use clap::Args;
use earthshine_bake::{Query, SceneTracer};
use earthshine_gen::{GenOptions, WorldKind};
use earthshine_gpu::rays::{DISPATCH_RAYS_MAX, GpuRays, NO_TRIANGLE, RayQuery};
use earthshine_gpu::{GpuDevice, PassTime};
use earthshine_scene::{ImportOptions, Scene, load_bytes};
use earthshine_world::Vec3;
use earthshine_world::random::{Purpose, hash, unit_pair};
use rayon::prelude::*;
use std::f32::consts::TAU;
use std::time::Instant;

/// Which rays.
#[derive(Args)]
pub(super) struct RayArguments {
    /// Rays traced through the town at once.
    #[arg(long, default_value_t = 1 << 19, value_parser = clap::value_parser!(u32).range(1..=DISPATCH_RAYS_MAX as i64))]
    rays: u32,
    /// Edge of the town, m.
    #[arg(long, default_value_t = 200.0)]
    town: f32,
}

/// The quickest of some rounds.
pub(super) struct RayFigures {
    /// On the device: by its own clock where it has one, else with the wait for it.
    pub(super) mrays_s: f64,
    /// The same rays on all cores of the CPU.
    pub(super) cpu_mrays_s: f64,
    /// Of those rays, the share that the device ends elsewhere.
    pub(super) elsewhere: f64,
    /// Of the town.
    pub(super) triangles: usize,
    /// All passes of all rounds.
    pub(super) passes: Vec<PassTime>,
}

/// Rays from one place.
const FROM_ONE_PLACE: u64 = 256;

impl RayArguments {
    /// The town.
    pub(super) fn town(&self, seed: u64) -> anyhow::Result<Scene> {
        let options = GenOptions { town_size_m: self.town, seed, ..GenOptions::default() };
        let glb = earthshine_gen::generate(WorldKind::Town, &options, &|_, _| {})?;
        Ok(load_bytes(&glb.bytes, "town", &ImportOptions::default())?)
    }
}

/// Measures both.
pub(super) fn measure(
    device: &GpuDevice,
    arguments: &RayArguments,
    scene: &Scene,
    rounds: u32,
    seed: u64,
) -> anyhow::Result<RayFigures> {
    let tracer = SceneTracer::new(scene);
    let queries: Vec<Query> = (0..u64::from(arguments.rays)).map(|ray| query(scene, seed, ray)).collect();
    let started = Instant::now();
    let closest = |q: &Query| tracer.closest(q.origin, q.direction, 0.0, q.distance_max);
    let expected: Vec<Option<usize>> =
        queries.par_iter().map(|query| closest(query).map(|hit| hit.triangle)).collect();
    let cpu_s = started.elapsed().as_secs_f64();
    let mut rays = GpuRays::new(device, &tracer.layout(), queries.len())?;
    let words: Vec<RayQuery> = queries.iter().map(words).collect();
    let found = rays.closest(&words)?;
    let named = |hit: u32| (hit != NO_TRIANGLE).then_some(hit as usize);
    let elsewhere = found.iter().zip(&expected).filter(|(hit, other)| named(hit.triangle) != **other).count();
    let is_timed = rays.time_passes()?;
    let (mut best, mut passes) = (f64::INFINITY, Vec::new());
    for _ in 0..rounds {
        let start = Instant::now();
        rays.again(queries.len())?;
        let wall_ms = start.elapsed().as_secs_f64() * 1e3;
        let times = rays.take_times()?;
        best = best.min(if is_timed { times.iter().map(|pass| pass.ms).sum() } else { wall_ms });
        passes.extend(times);
    }
    let count = queries.len() as f64;
    Ok(RayFigures {
        mrays_s: count / 1e3 / best.max(1e-9),
        cpu_mrays_s: count / 1e6 / cpu_s.max(1e-9),
        elsewhere: elsewhere as f64 / count,
        triangles: scene.triangles.len(),
        passes,
    })
}

/// Ray `ray`, from a place of its 256.
fn query(scene: &Scene, seed: u64, ray: u64) -> Query {
    let place = ray / FROM_ONE_PLACE;
    let draw = |of: u64, part: u64| unit_pair(hash(seed, Purpose::RowRay, of, part));
    let triangle = (hash(seed, Purpose::RowRay, place, 0) % scene.triangles.len().max(1) as u64) as usize;
    let [a, b, c] = scene.triangles[triangle];
    let (root, across) = (draw(place, 1).0.sqrt(), draw(place, 1).1);
    let position = a + (b - a) * (root * (1.0 - across)) + (c - a) * (root * across);
    let normal = scene.normal(triangle);
    // A point of the unit sphere on the normal's end: directions by the cosine.
    let (turn, height) = draw(ray, 2);
    let up = 2.0 * height - 1.0;
    let (sin, cos) = (turn * TAU).sin_cos();
    let flat = (1.0 - up * up).max(0.0).sqrt();
    let direction = (normal + Vec3::new(flat * cos, up, flat * sin)).normalize_or(normal);
    Query { origin: position + normal * 1e-4, direction, distance_max: f32::INFINITY }
}
