//! `bench gpu`: what a frame has beside the local matrix: direct light with shadow rays, and tables that are rebuilt under a
//! budget.
//!
//! Patches lie on random triangles of the generated town, whose triangles are in 27 chunks; a sun and lamps shine on them.

use super::gpu_news::NewsArguments;
use clap::Args;
use earthshine_gpu::alias::AliasBuilder;
use earthshine_gpu::direct::{GpuDirect, GpuLight};
use earthshine_gpu::{GpuDevice, PassTime};
use earthshine_light::{LightUnderWay as _, OccluderSet, Occluders, PatchPoints, direct_irradiance};
use earthshine_scene::Scene;
use earthshine_world::random::{Purpose, hash, unit_f32, unit_pair};
use earthshine_world::{Asked, ChunkCoord, ChunkId, Light, OccluderMesh, Rgb, SamplePoint, Vec3};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What is lit in a frame.
#[derive(Args)]
pub(super) struct FrameArguments {
    /// Patches whose direct light is computed in a frame.
    #[arg(long, default_value_t = 8192, value_parser = clap::value_parser!(u32).range(1..))]
    lit_patches: u32,
    /// Points of each of them.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    points: u32,
    /// Lights: a sun, the others lamps.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    lights: u32,
    /// Rows whose tables are rebuilt in a frame.
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u32).range(1..))]
    rebuilt_rows: u32,
}

/// Chunks along an edge of the town.
const CHUNKS: i32 = 3;
/// How far off their surface shadow rays begin, m.
const EPSILON_M: f32 = 1e-3;

/// Everything that a frame's direct light and tables need.
pub(super) struct FrameWork {
    device: GpuDevice,
    direct: GpuDirect,
    tables: AliasBuilder,
    casters: OccluderSet,
    lights: Vec<Light>,
    points: Vec<Vec<SamplePoint>>,
    has_timestamps: bool,
}

/// Direct light alone.
#[derive(Serialize)]
pub(super) struct DirectFigures {
    /// On the device, waits and readback included, ms.
    direct_ms: f64,
    /// The same on all cores of the CPU, ms.
    cpu_direct_ms: f64,
    /// What all of it is off the CPU's, as a share.
    direct_error_rel: f64,
    /// How many frames later than its own a frame's light comes, where nobody waits for it.
    direct_late_frames: f64,
    /// Bytes of light on all points.
    direct_whole_bytes: usize,
    /// Bytes that come back where somebody reads light on points.
    direct_points_bytes: u64,
    /// Bytes that come back where nobody does.
    direct_bytes: u64,
}

impl FrameWork {
    pub(super) fn new(
        device: &GpuDevice,
        arguments: &FrameArguments,
        scene: &Scene,
        items: u32,
        seed: u64,
    ) -> anyhow::Result<Self> {
        let mut direct = GpuDirect::new(device)?;
        let has_timestamps = direct.time_passes()?;
        let mut tables = AliasBuilder::new(device, &vec![items as usize; arguments.rebuilt_rows as usize])?;
        let weight = |at: u64| unit_f32(hash(seed, Purpose::Simulation, at, 1));
        let count = u64::from(items) * u64::from(arguments.rebuilt_rows);
        tables.set_weights(&(0..count).map(weight).collect::<Vec<f32>>())?;
        let points = (0..u64::from(arguments.lit_patches))
            .map(|patch| (0..u64::from(arguments.points)).map(|at| point(scene, seed, patch, at)).collect())
            .collect();
        let lights = (0..arguments.lights).map(|at| light(scene, seed, u64::from(at))).collect();
        let (device, casters) = (device.clone(), casters(scene));
        Ok(Self { device, direct, tables, casters, lights, points, has_timestamps })
    }

    /// Hands over direct light of all patches, and the tables.
    pub(super) fn begin(&mut self) -> anyhow::Result<GpuLight> {
        self.tables.build()?;
        Ok(self.direct.light(&self.casters, &self.lights, &asked(&self.points), false)?)
    }

    /// How many frames later than its own a frame's direct light comes, on average, at `period` a frame, every frame's asked for.
    fn late_frames(&mut self, frames: u32, period: Duration) -> anyhow::Result<f64> {
        let (mut under_way, mut late) = (VecDeque::new(), 0);
        for frame in 0..frames {
            let start = Instant::now();
            under_way.push_back((frame, self.begin()?));
            while let Some((asked, light)) = under_way.front_mut()
                && light.look() != Asked::UnderWay
            {
                late += frame - *asked;
                under_way.pop_front();
            }
            std::thread::sleep(period.saturating_sub(start.elapsed()));
        }
        late += under_way.iter().map(|(asked, _)| frames - asked).sum::<u32>();
        Ok(f64::from(late) / f64::from(frames))
    }

    /// The passes since the last call.
    pub(super) fn take_times(&mut self) -> anyhow::Result<Vec<PassTime>> {
        Ok(if self.has_timestamps { self.direct.take_times()? } else { Vec::new() })
    }

    /// Direct light by both.
    pub(super) fn measure(&mut self, rounds: u32, rate: &NewsArguments) -> anyhow::Result<DirectFigures> {
        let asked = asked(&self.points);
        let start = Instant::now();
        let lit = |of: &PatchPoints<'_>| {
            direct_irradiance(&self.casters, &self.lights, of.points, of.epsilon_m, of.seed)
        };
        let expected: Vec<Rgb> = asked.par_iter().map(lit).collect();
        let cpu_direct_ms = start.elapsed().as_secs_f64() * 1e3;
        let (mut direct_ms, mut found) = (f64::INFINITY, Vec::new());
        for _ in 0..rounds {
            let start = Instant::now();
            found = self.direct.light(&self.casters, &self.lights, &asked, false)?.wait()?;
            direct_ms = direct_ms.min(start.elapsed().as_secs_f64() * 1e3);
        }
        let found = found.iter().map(|&(mean, _)| mean);
        let sum =
            |light: &mut dyn Iterator<Item = Rgb>| light.map(|rgb| f64::from(rgb.element_sum())).sum::<f64>();
        let off = sum(&mut found.zip(&expected).map(|(a, b)| (a - *b).abs()));
        let direct_error_rel = off / sum(&mut expected.iter().copied()).max(1e-9);
        // Of two answers the second, whose copy is guessed from the first.
        let mut bytes = |wants_points: bool| -> anyhow::Result<u64> {
            let mut bytes = 0;
            for _ in 0..2 {
                let read_back =
                    || self.device.read_back_bytes().get("direct light").copied().unwrap_or_default();
                let before = read_back();
                self.direct.light(&self.casters, &self.lights, &asked, wants_points)?.wait()?;
                bytes = read_back() - before;
            }
            Ok(bytes)
        };
        let (direct_points_bytes, direct_bytes) = (bytes(true)?, bytes(false)?);
        let direct_late_frames = self.late_frames(rate.news_frames, rate.period())?;
        let direct_whole_bytes = 16 * self.points.iter().map(Vec::len).sum::<usize>();
        Ok(DirectFigures {
            direct_ms,
            cpu_direct_ms,
            direct_error_rel,
            direct_late_frames,
            direct_whole_bytes,
            direct_points_bytes,
            direct_bytes,
        })
    }
}

fn asked(points: &[Vec<SamplePoint>]) -> Vec<PatchPoints<'_>> {
    (0..).zip(points).map(|(seed, points)| PatchPoints { points, epsilon_m: EPSILON_M, seed }).collect()
}

/// The scene's triangles as casters of chunks, by where they begin.
fn casters(scene: &Scene) -> OccluderSet {
    let bounds = scene.bounds();
    let chunk = |at: Vec3| {
        let share = (at - bounds.min) / bounds.size().max(Vec3::splat(1e-3));
        (share * CHUNKS as f32).floor().as_ivec3().clamp(glam::IVec3::ZERO, glam::IVec3::splat(CHUNKS - 1))
    };
    let mut meshes = std::collections::BTreeMap::<[i32; 3], OccluderMesh>::new();
    for corners in &scene.triangles {
        let mesh = meshes.entry(chunk(corners[0]).to_array()).or_default();
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(corners);
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.surfaces.push([0, 0, 0, 255]);
    }
    let mut set = OccluderSet::new();
    for (at, mesh) in meshes {
        set.insert(ChunkId::new(0, ChunkCoord::from_array(at)), Arc::new(Occluders::build(&mesh)));
    }
    set
}

fn point(scene: &Scene, seed: u64, patch: u64, at: u64) -> SamplePoint {
    let triangle = hash(seed, Purpose::SamplePoint, patch, 0) as usize % scene.triangles.len().max(1);
    let [a, b, c] = scene.triangles[triangle];
    let (u, v) = unit_pair(hash(seed, Purpose::SamplePoint, patch, 1 + at));
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    SamplePoint { position: a + (b - a) * u + (c - a) * v, normal: scene.normal(triangle) }
}

/// A sun, then lamps above the town.
fn light(scene: &Scene, seed: u64, at: u64) -> Light {
    if at == 0 {
        let direction = Vec3::new(0.36, -0.8, 0.48);
        return Light::Directional { direction, illuminance: Rgb::splat(1e5), angular_diameter_rad: 0.0 };
    }
    let (u, v) = unit_pair(hash(seed, Purpose::Simulation, at, 2));
    let bounds = scene.bounds();
    let position = bounds.min + bounds.size() * Vec3::new(u, 0.9, v);
    Light::Point { position, intensity: Rgb::splat(1e5), range_m: None }
}
