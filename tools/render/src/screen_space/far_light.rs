//! Far light: what a few rays a pixel bring from beyond the near radius, and what they would without a split.
//!
//! One pixel's rays are noise; [`super::mip_chain`] makes light of them. Pixels take turns in one sequence of directions
//! (interleaved sampling), so that those of a block together are as evenly spread as one pixel's would be. Emissive surfaces are kept apart:
//! looking at them on purpose is nearly free of noise, and their shadows are too sharp for a wide filter.

use super::g_buffer::{GBuffer, Texel};
use crate::path::PathTracer;
use crate::sampling::{PathStream, cosine_direction};
use crate::tracer::{Vertex, off_surface};
use earthshine_trace::hemisphere::spread_pair;
use earthshine_world::Rgb;
use earthshine_world::random::{Purpose, hash, unit_pair};
use glam::Vec4;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Streams of the far rays; the reference uses 0 and 1.
const STREAM: u64 = 2;

/// Edge of the blocks within which pixels take turns, a power of two.
const BLOCK_PIXELS: usize = 8;

/// What a surface reflects towards who hit it, cd/m2, for the pixel whose ray it was.
pub type Reflected<'a> = dyn Fn(&Vertex, &mut PathStream) -> Rgb + Sync + 'a;

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

impl Gathered {
    /// Irradiance from reflecting surfaces within the radius, lx; and the share of all rays that ended there.
    pub(super) fn near(&self) -> Vec4 {
        (self.all - self.far.truncate()).extend(1.0 - self.far.w)
    }
}

/// Rays of each pixel.
#[derive(Debug, Clone, Copy)]
pub struct Rays {
    /// How many.
    pub samples: u32,
    /// Where near ends, m.
    pub radius_m: f32,
    /// Of the random numbers.
    pub seed: u64,
}

/// Cosine-weighted `rays` a pixel into the scene, each answered by what `reflected` says of where it ends.
///
/// `finished` hears of every row from any thread: how many of the camera's pixels it had.
#[must_use]
pub fn gather(
    paths: &PathTracer<'_>,
    buffer: &GBuffer,
    rays: Rays,
    reflected: &Reflected<'_>,
    finished: &(dyn Fn(u64) + Sync),
) -> Vec<Gathered> {
    let width = buffer.camera().width() as usize;
    let row = |(row, texels): (usize, &[Option<Texel>])| {
        let pixel = |(x, texel): (usize, &Option<Texel>)| {
            let place = ((row * width + x) as u64, turn(x, row));
            texel.map_or(Gathered::default(), |texel| pixel(paths, &texel, rays, place, reflected))
        };
        let found: Vec<Gathered> = texels.iter().enumerate().map(pixel).collect();
        finished(width as u64);
        found
    };
    buffer.texels().par_chunks(width).enumerate().with_max_len(1).flat_map_iter(row).collect()
}

/// Number of pixel `(x, y)` in its block along a Z-curve: blocks of 2, 4 and 8 pixels hold consecutive ones.
fn turn(x: usize, y: usize) -> u32 {
    let bits = BLOCK_PIXELS.trailing_zeros();
    (0..bits).map(|bit| ((x >> bit & 1) << (2 * bit) | (y >> bit & 1) << (2 * bit + 1)) as u32).sum()
}

/// Rays of the pixel of number `index` in the picture and `turn` in its block.
fn pixel(
    paths: &PathTracer<'_>,
    texel: &Texel,
    rays: Rays,
    (index, turn): (u64, u32),
    reflected: &Reflected<'_>,
) -> Gathered {
    let Rays { samples, radius_m, .. } = rays;
    let seed = hash(rays.seed, Purpose::ReferencePath, index, STREAM);
    // One sequence for the whole picture.
    let (shift_u, shift_v) = unit_pair(hash(rays.seed, Purpose::ReferencePath, 0, STREAM));
    let (position, normal) = (texel.vertex.position, texel.vertex.normal);
    let origin = off_surface(position, normal);
    let mut found = Gathered::default();
    for sample in 0..samples {
        let mut stream = PathStream::new(seed, u64::from(sample));
        found.emitted += paths.looked_irradiance(position, normal, &mut stream);
        let number = sample * (BLOCK_PIXELS * BLOCK_PIXELS) as u32 + turn;
        let direction = cosine_direction(normal, spread_pair(number, shift_u, shift_v));
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
        let reflected = PI * reflected(&vertex, &mut stream);
        found.all += reflected;
        if hit.distance > radius_m {
            found.far += reflected.extend(1.0);
        }
    }
    let share = 1.0 / samples as f32;
    Gathered { far: found.far * share, all: found.all * share, emitted: found.emitted * share }
}
