//! Screen-space indirect light: a few far rays a pixel, filtered along surfaces, refined by near occlusion.
//!
//! Light that arrives is split at a radius r. With N the share of the hemisphere that surfaces within r fill:
//!
//! ```text
//! I = near + (1 - N) * F        near: irradiance from surfaces within r
//!                               F: irradiance if everything beyond r filled the hemisphere
//! ```
//!
//! F varies slowly and is filtered widely; N and `near` hold the contact detail and are hardly filtered. Where
//! everything sends one radiance the split changes nothing, whatever N is: occlusion takes far light away only
//! to put near light in its place.
//!
//! Two ways to know what the ends of rays send: [`gathered`], a path of all bounces; [`served()`], light of volumes there.
//!
//! Not here: direct light, the camera's picture ([`crate::picture`]), volumes.

pub mod far_light;
pub mod g_buffer;
pub mod mip_chain;
pub mod occlusion;
pub mod screen_light;
pub mod served;

pub use served::served;

use crate::camera::Pinhole;
use crate::path::{EmitterSampling, PathTracer};
use crate::picture::IrradianceLookup;
use crate::sampling::PathStream;
use crate::tracer::{SceneTracer, Vertex};
use earthshine_world::{LightRig, Rgb, Vec3};
use far_light::Rays;
use g_buffer::{GBuffer, Texel};
use glam::Vec4;
use mip_chain::Reach;
use occlusion::{ShortRays, near_light};
use rayon::prelude::*;
use screen_light::ScreenLight;
use std::f32::consts::FRAC_1_PI;

/// Most far or near rays a pixel.
pub const RAYS_MAX: u32 = 1024;
/// Blocks of the far filter: 64 pixels.
const FAR_LEVELS: u32 = 6;
/// Blocks of the filter of near light, occlusion and emitters: 4 pixels.
const NEAR_LEVELS: u32 = 2;
/// Far light smooths out over this many radii along a surface.
const FAR_REACH_RADII: f32 = 1.0;

/// How the screen-space method looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenSpaceOptions {
    /// From where.
    pub camera: Pinhole,
    /// Far rays a pixel, 1 to [`RAYS_MAX`]; the method is meant for 4 to 16. Near and far rays of [`served()`], which is still
    /// some noisier with 16 than with 64.
    pub far_samples: u32,
    /// Short rays a pixel, 1 to [`RAYS_MAX`]. Not of [`served()`].
    pub near_samples: u32,
    /// Where near ends, m.
    pub radius_m: f32,
    /// Of the random numbers.
    pub seed: u64,
}

/// Options that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScreenSpaceError {
    /// No rays, or too many.
    #[error("{0} rays a pixel; it must be 1 to {RAYS_MAX}")]
    Rays(u32),
    /// Not a length.
    #[error("a near radius of {0} m; it must be positive and finite")]
    Radius(f32),
}

/// Irradiance of every pixel's surface with and without refinement, lx.
#[derive(Debug, Clone)]
pub struct ScreenIrradiance {
    /// The surfaces.
    pub buffer: GBuffer,
    /// As gathered: far rays without any filter. Empty for served light.
    pub raw: Vec<Rgb>,
    /// Without refinement: filtered far rays, or served light as looked up.
    pub plain: Vec<Rgb>,
    /// Refined by near light and occlusion.
    pub refined: Vec<Rgb>,
    /// Share of the hemisphere that near surfaces fill.
    pub occlusion: Vec<f32>,
}

impl ScreenIrradiance {
    /// Refined light where the picture shows the surface, that of `served` elsewhere; nothing where that knows nothing.
    pub fn refined_lookup<'a>(
        &'a self,
        served: &'a IrradianceLookup<'a>,
    ) -> impl Fn(Vec3, Vec3) -> Option<Rgb> + Sync + 'a {
        let screen = ScreenLight { buffer: &self.buffer, irradiance: &self.refined };
        move |position, normal| {
            let known = served(position, normal)?;
            Some(screen.at(position, normal).unwrap_or(known))
        }
    }
}

impl ScreenSpaceOptions {
    /// Whether the method can run.
    ///
    /// # Errors
    /// Names what cannot be.
    pub fn validate(&self) -> Result<(), ScreenSpaceError> {
        for rays in [self.far_samples, self.near_samples] {
            if !(1..=RAYS_MAX).contains(&rays) {
                return Err(ScreenSpaceError::Rays(rays));
            }
        }
        if self.radius_m > 0.0 && self.radius_m.is_finite() {
            Ok(())
        } else {
            Err(ScreenSpaceError::Radius(self.radius_m))
        }
    }

    /// The short rays that find near light.
    #[must_use]
    pub fn short_rays(&self) -> ShortRays {
        ShortRays { samples: self.near_samples, radius_m: self.radius_m, seed: self.seed }
    }

    fn near_reach(&self) -> Reach {
        Reach { levels: NEAR_LEVELS, distance_m: 0.25 * self.radius_m }
    }
}

/// Pixels that [`gathered`] reports as finished: each is worked on twice.
#[must_use]
pub fn work_pixels(camera: &Pinhole) -> u64 {
    2 * u64::from(camera.width()) * u64::from(camera.height())
}

/// The method in its own right: far light from the picture's own rays.
///
/// `finished` hears of finished pixels ([`work_pixels`] in all), from any thread.
///
/// # Errors
/// The options cannot be.
pub fn gathered(
    tracer: &SceneTracer<'_>,
    rig: &LightRig,
    options: &ScreenSpaceOptions,
    finished: &(dyn Fn(u64) + Sync),
) -> Result<ScreenIrradiance, ScreenSpaceError> {
    options.validate()?;
    let paths = PathTracer { tracer, rig, emitter_sampling: EmitterSampling::Balanced };
    let buffer = GBuffer::trace(tracer, &options.camera);
    let reflected = |vertex: &Vertex, stream: &mut PathStream| paths.reflected_radiance(vertex, stream);
    let rays = Rays { samples: options.far_samples, radius_m: options.radius_m, seed: options.seed };
    let found = far_light::gather(&paths, &buffer, rays, &reflected, finished);
    let wide = Reach { levels: FAR_LEVELS, distance_m: FAR_REACH_RADII * options.radius_m };
    let layer = |value: fn(&far_light::Gathered) -> Vec4, reach: Reach| {
        mip_chain::filter(&buffer, &found.iter().map(value).collect::<Vec<_>>(), reach)
    };
    let far = layer(|pixel| pixel.far, wide);
    let all = layer(|pixel| pixel.all.extend(0.0), wide);
    let emitted = layer(|pixel| pixel.emitted.extend(0.0), options.near_reach());
    // An occluder stands in about the light that its neighbour stands in: the far light is its ambient colour.
    let near = near_pixels(tracer, &buffer, options, finished, &|pixel, vertex, stream| {
        let lamps = paths.lamp_irradiance(vertex, stream, &mut 0);
        let emitters = paths.emitter_sample(vertex.position, vertex.normal, stream);
        vertex.reflectance * FRAC_1_PI * (lamps + emitters + all[pixel].truncate())
    });
    let refined = (0..near.len())
        .map(|pixel| emitted[pixel].truncate() + far_and_near(far[pixel], near[pixel], all[pixel].truncate()))
        .collect();
    Ok(ScreenIrradiance {
        raw: found.iter().map(|pixel| pixel.all + pixel.emitted).collect(),
        plain: all.iter().zip(&emitted).map(|(all, emitted)| (*all + *emitted).truncate()).collect(),
        refined,
        occlusion: near.iter().map(|near| near.w).collect(),
        buffer,
    })
}

/// Light of a place: what is near, and in the rest of its hemisphere what is far, both irradiance and the share of all rays
/// that it is of; `otherwise` where no ray went far.
fn far_and_near(far: Vec4, near: Vec4, otherwise: Rgb) -> Rgb {
    let full = if far.w > 0.0 { far.truncate() / far.w } else { otherwise };
    near.truncate() + (1.0 - near.w) * full
}

/// Near light and occlusion of every pixel, hardly filtered.
fn near_pixels(
    tracer: &SceneTracer<'_>,
    buffer: &GBuffer,
    options: &ScreenSpaceOptions,
    finished: &(dyn Fn(u64) + Sync),
    radiance: &(dyn Fn(usize, &Vertex, &mut PathStream) -> Rgb + Sync),
) -> Vec<Vec4> {
    let width = buffer.camera().width() as usize;
    let row = |(row, texels): (usize, &[Option<Texel>])| {
        let pixel = |(x, texel): (usize, &Option<Texel>)| {
            let index = row * width + x;
            let place = texel.as_ref().map(|texel| (texel.vertex.position, texel.vertex.normal));
            let sent = |vertex: &Vertex, stream: &mut PathStream| radiance(index, vertex, stream);
            place.map_or(Vec4::ZERO, |place| {
                near_light(tracer, place, options.short_rays(), index as u64, &sent)
            })
        };
        let found: Vec<Vec4> = texels.iter().enumerate().map(pixel).collect();
        finished(width as u64);
        found
    };
    let near: Vec<Vec4> =
        buffer.texels().par_chunks(width).enumerate().with_max_len(1).flat_map_iter(row).collect();
    mip_chain::filter(buffer, &near, options.near_reach())
}

#[cfg(test)]
mod tests;
