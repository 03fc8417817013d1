//! Far light: what a few rays a pixel bring from beyond the near radius, and what they would without a split.
//!
//! One pixel's rays are noise; [`super::mip_chain`] makes light of them. Emissive surfaces are kept apart:
//! looking at them on purpose is nearly free of noise, and their shadows are too sharp for a wide filter.

use super::g_buffer::{GBuffer, Texel};
use crate::path::PathTracer;
use crate::sampling::{PathStream, cosine_direction};
use crate::tracer::off_surface;
use earthshine_trace::hemisphere::spread_pair;
use earthshine_world::Rgb;
use earthshine_world::random::{Purpose, hash, unit_pair};
use glam::Vec4;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Streams of the far rays; the reference uses 0 and 1.
const STREAM: u64 = 2;

/// What the rays of one pixel found.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gathered {
    /// Irradiance from the rays that ended beyond the radius, lx; and their share of all rays.
    pub far: Vec4,
    /// Irradiance from all rays, reflected light and sky, lx.
    pub all: Rgb,
    /// Irradiance from emissive surfaces, near and far, lx.
    pub emitted: Rgb,
}

/// `samples` cosine-weighted rays a pixel into the scene, each answered by one path of all bounces.
///
/// `finished` hears of every row from any thread: how many pixels it had.
#[must_use]
pub fn gather(
    paths: &PathTracer<'_>,
    buffer: &GBuffer,
    samples: u32,
    radius_m: f32,
    seed: u64,
    finished: &(dyn Fn(u64) + Sync),
) -> Vec<Gathered> {
    let width = buffer.camera().width() as usize;
    let row = |(row, texels): (usize, &[Option<Texel>])| {
        let pixel = |(x, texel): (usize, &Option<Texel>)| {
            let index = (row * width + x) as u64;
            texel.map_or(Gathered::default(), |texel| pixel(paths, &texel, samples, radius_m, seed, index))
        };
        let found: Vec<Gathered> = texels.iter().enumerate().map(pixel).collect();
        finished(width as u64);
        found
    };
    buffer.texels().par_chunks(width).enumerate().with_max_len(1).flat_map_iter(row).collect()
}

fn pixel(
    paths: &PathTracer<'_>,
    texel: &Texel,
    samples: u32,
    radius_m: f32,
    seed: u64,
    index: u64,
) -> Gathered {
    let seed = hash(seed, Purpose::ReferencePath, index, STREAM);
    let (shift_u, shift_v) = unit_pair(seed);
    let (position, normal) = (texel.vertex.position, texel.vertex.normal);
    let origin = off_surface(position, normal);
    let mut found = Gathered::default();
    for sample in 0..samples {
        let mut stream = PathStream::new(seed, u64::from(sample));
        found.emitted += paths.looked_irradiance(position, normal, &mut stream);
        let direction = cosine_direction(normal, spread_pair(sample, shift_u, shift_v));
        let Some(hit) = paths.tracer.closest(origin, direction, 0.0, f32::INFINITY) else {
            let sky = PI * paths.sky_radiance(direction);
            found.all += sky;
            found.far += sky.extend(1.0);
            continue;
        };
        let vertex = paths.tracer.vertex(&hit);
        if vertex.emitted_radiance != Rgb::ZERO {
            let weight = paths.hit_weight(hit.triangle, hit.distance, direction, normal, vertex.normal);
            found.emitted += vertex.emitted_radiance * (PI * weight * paths.rig.emission_scale);
        }
        let reflected = PI * paths.reflected_radiance(&vertex, &mut stream);
        found.all += reflected;
        if hit.distance > radius_m {
            found.far += reflected.extend(1.0);
        }
    }
    let share = 1.0 / samples as f32;
    Gathered { far: found.far * share, all: found.all * share, emitted: found.emitted * share }
}
