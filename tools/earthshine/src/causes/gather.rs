//! Final gathers: light at a place from the patches that rays from there hit, channels averaged, lx.

use super::mean;
use super::scene_light::SceneLight;
use earthshine_bake::exposure::{NEAR_SHARE, NEAR_VOXELS};
use earthshine_bake::rows::RAY_OFFSET;
use earthshine_render::sampling::{PathStream, cosine_direction, spread_pair};
use earthshine_render::tracer::offset_at;
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{Rgb, SamplePoint, Vec3};
use std::f32::consts::PI;

/// Independent gathers of each place: their spread says how exact they are.
pub(crate) const BLOCKS: u32 = 4;
/// How far off a sample point rays begin, in voxel edges: tiles round points to steps that are wider than [`RAY_OFFSET`].
const POINT_OFFSET: f32 = 1e-3;
/// A point more of whose rays end on backs is inside of something.
const BACK_SHARE: f32 = 0.5;

/// A point that a patch stands for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PointLight {
    pub point: SamplePoint,
    /// Gathered there.
    pub light: f64,
    /// In a crevice, or inside of something.
    pub is_hidden: bool,
}

/// What rows should have brought to a patch.
#[derive(Debug, Clone)]
pub(crate) struct PatchGather {
    pub points: Vec<PointLight>,
    /// Mean over the points.
    pub light: f64,
    /// Standard deviation of a row with the bake's number of rays.
    pub row_noise: f64,
}

/// What arrives at a place.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PlaceGather {
    /// From patches and sky.
    pub light: f64,
    /// Standard error of it.
    pub noise: f64,
    /// Emission, lamp light and reflectance of the patches hit, less those of the surface itself.
    pub emission_excess: f64,
    pub lamp_excess: f64,
    pub reflectance_excess: f64,
    /// Light of surfaces that no patch stands for, above zero.
    pub unseen: f64,
    /// Share of rays that end there.
    pub unseen_share: f64,
}

/// Mean and standard deviation of blocks.
fn spread(blocks: &[f64]) -> (f64, f64) {
    let count = blocks.len() as f64;
    let mean = blocks.iter().sum::<f64>() / count;
    let squares: f64 = blocks.iter().map(|value| (value - mean).powi(2)).sum();
    (mean, (squares / (count - 1.0).max(1.0)).sqrt())
}

impl SceneLight<'_> {
    /// Where rays from a surface begin.
    pub(crate) fn lifted(&self, position: Vec3, normal: Vec3) -> Vec3 {
        position + normal * (RAY_OFFSET * self.voxel_edge_m()).max(offset_at(position))
    }

    /// Pairs that spread over the square, of block `block` at `place`.
    fn pairs(&self, place: Vec3, block: u32) -> impl Fn(u32) -> (f32, f32) + use<> {
        let bits = |v: f32| u64::from(v.to_bits());
        let key = bits(place.x) ^ bits(place.y).rotate_left(21) ^ bits(place.z).rotate_left(42);
        let (u, v) = unit_pair(hash(self.parameters.seed, Purpose::MeasurePoint, key, u64::from(block)));
        move |index| spread_pair(index, u, v)
    }

    /// Gathers at the points of one patch, `rays` in each of [`BLOCKS`] runs. The noise is scaled to `row_rays`.
    pub(crate) fn gather_patch(&self, points: &[SamplePoint], rays: u32, row_rays: u32) -> PatchGather {
        let Some(first) = points.first() else {
            return PatchGather { points: Vec::new(), light: 0.0, row_noise: 0.0 };
        };
        let count = points.len().max(1) as u32;
        let rays_a_point = rays.div_ceil(count);
        let mut sums = vec![(0.0f64, 0u32, 0u32); points.len()];
        let mut blocks = Vec::with_capacity(BLOCKS as usize);
        for block in 0..BLOCKS {
            let mut block_sum = 0.0;
            let pair = self.pairs(first.position, block);
            for (index, (point, sum)) in points.iter().zip(&mut sums).enumerate() {
                for ray in 0..rays_a_point {
                    let direction = cosine_direction(point.normal, pair(index as u32 * rays_a_point + ray));
                    let (light, near, back) = self.along(point, direction);
                    sum.0 += light;
                    sum.1 += u32::from(near);
                    sum.2 += u32::from(back);
                    block_sum += light;
                }
            }
            blocks.push(block_sum / f64::from(rays_a_point * count));
        }
        let (light, deviation) = spread(&blocks);
        let rays_in_all = (rays_a_point * BLOCKS) as f32;
        let lights = points.iter().zip(sums).map(|(&point, (sum, near, back))| PointLight {
            point,
            light: sum / f64::from(rays_in_all),
            is_hidden: near as f32 > NEAR_SHARE * rays_in_all || back as f32 > BACK_SHARE * rays_in_all,
        });
        let scale = f64::from(rays_a_point * count) / f64::from(row_rays.max(1));
        PatchGather { points: lights.collect(), light, row_noise: deviation * scale.sqrt() }
    }

    /// Light along one ray; whether it ends near by; whether on a back.
    fn along(&self, point: &SamplePoint, direction: Vec3) -> (f64, bool, bool) {
        let origin = point.position + point.normal * (POINT_OFFSET * self.voxel_edge_m());
        match self.tracer.closest(origin, direction, 0.0, f32::INFINITY) {
            None => (mean(self.rig.sky.radiance(direction) * PI), false, false),
            Some(hit) => {
                let near = hit.distance < NEAR_VOXELS * self.voxel_edge_m();
                let back = self.tracer.is_back(&hit);
                (mean(self.at(&self.tracer.vertex(&hit)).exitance()), near, back)
            }
        }
    }

    /// Gathers at a place on a surface with `rays` rays in each of [`BLOCKS`] runs, and compares what they hit with
    /// the patches that stand for it.
    pub(crate) fn gather_place(&self, position: Vec3, normal: Vec3, rays: u32) -> PlaceGather {
        let mut blocks = Vec::with_capacity(BLOCKS as usize);
        let mut sum = PlaceGather::default();
        let origin = self.lifted(position, normal);
        for block in 0..BLOCKS {
            let pair = self.pairs(position, block);
            let mut block_sum = 0.0;
            for ray in 0..rays {
                let direction = cosine_direction(normal, pair(ray));
                let Some(hit) = self.tracer.closest(origin, direction, 0.0, f32::INFINITY) else {
                    block_sum += mean(self.rig.sky.radiance(direction) * PI);
                    continue;
                };
                let vertex = self.tracer.vertex(&hit);
                let patches = self.at(&vertex);
                block_sum += mean(patches.exitance());
                let own = vertex.emitted_radiance * (PI * self.rig.emission_scale);
                let mut stream = PathStream::new(self.parameters.seed, u64::from(block * rays + ray));
                let lamps = vertex.reflectance * self.lamp_irradiance(&vertex, &mut stream);
                // The irradiance where no patch is stays unknown: it counts as that of the patches there are.
                let arriving =
                    if patches.covered > 0.0 { patches.irradiance / patches.covered } else { Rgb::ZERO };
                let bounced = vertex.reflectance * arriving;
                let covered = patches.covered.min(1.0);
                sum.emission_excess += mean(patches.emission - own * covered);
                sum.lamp_excess += mean(patches.lamps - lamps * covered);
                sum.reflectance_excess += mean(patches.bounced - bounced * covered);
                sum.unseen += mean((own + lamps + bounced) * (1.0 - covered));
                sum.unseen_share += f64::from(1.0 - covered);
            }
            blocks.push(block_sum / f64::from(rays));
        }
        let (light, deviation) = spread(&blocks);
        let share = 1.0 / f64::from(rays * BLOCKS);
        PlaceGather {
            light,
            noise: deviation / f64::from(BLOCKS).sqrt(),
            emission_excess: sum.emission_excess * share,
            lamp_excess: sum.lamp_excess * share,
            reflectance_excess: sum.reflectance_excess * share,
            unseen: sum.unseen * share,
            unseen_share: sum.unseen_share * share,
        }
    }

    /// How far a place may be lifted before something is in the way: at most `most` m, half the way at that.
    pub(crate) fn headroom(&self, position: Vec3, normal: Vec3, most: f32) -> f32 {
        let origin = self.lifted(position, normal);
        self.tracer.closest(origin, normal, 0.0, 2.0 * most).map_or(most, |hit| 0.5 * hit.distance)
    }
}
