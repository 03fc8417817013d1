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
//! Two sources of far light. [`gathered`]: rays of the picture itself. [`served`]: irradiance `I_v` looked up in
//! volumes, which is a mean over a voxel and so already holds the mean occlusion there. F then follows from the
//! means of N and `near` over as much surface, `F = (I_v - near_mean) / (1 - N_mean)`: light is moved about
//! within a voxel, and none is lost or counted twice. The means are taken over what the picture shows of the
//! surface; a surface of which little shows is left nearly as served.
//!
//! Not here: direct light, the camera's picture ([`crate::picture`]), volumes.

pub mod far_light;
pub mod g_buffer;
pub mod mip_chain;
pub mod occlusion;
pub mod screen_light;

use crate::camera::Pinhole;
use crate::path::{EmitterSampling, PathTracer};
use crate::picture::IrradianceLookup;
use crate::sampling::PathStream;
use crate::tracer::{SceneTracer, Vertex, off_surface};
use earthshine_world::{LightRig, Rgb, Vec3};
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
/// Where nearer surfaces fill more than this on average, what they leave says nothing about far light.
const OCCLUDED_MAX: f32 = 0.9;

/// How the screen-space method looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenSpaceOptions {
    /// From where.
    pub camera: Pinhole,
    /// Far rays a pixel, 1 to [`RAYS_MAX`]; the method is meant for 4 to 16.
    pub far_samples: u32,
    /// Short rays a pixel, 1 to [`RAYS_MAX`].
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

/// Pixels that [`gathered`] and [`served`] report as finished: each is worked on twice.
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
    let samples = options.far_samples;
    let found = far_light::gather(&paths, &buffer, samples, options.radius_m, options.seed, finished);
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
        .map(|pixel| {
            let (near, far) = (near[pixel], far[pixel]);
            let full = if far.w > 0.0 { far.truncate() / far.w } else { all[pixel].truncate() };
            emitted[pixel].truncate() + near.truncate() + (1.0 - near.w) * full
        })
        .collect();
    Ok(ScreenIrradiance {
        raw: found.iter().map(|pixel| pixel.all + pixel.emitted).collect(),
        plain: all.iter().zip(&emitted).map(|(all, emitted)| (*all + *emitted).truncate()).collect(),
        refined,
        occlusion: near.iter().map(|near| near.w).collect(),
        buffer,
    })
}

/// Served light refined below the radius, which should be about a voxel of what is served. The means that the served
/// light holds already are taken over as much of the picture's surface. Where nothing is served nothing is known:
/// `plain` and `refined` are zero.
///
/// `finished` hears of finished pixels ([`work_pixels`] in all), from any thread.
///
/// # Errors
/// The options cannot be.
pub fn served(
    tracer: &SceneTracer<'_>,
    rig: &LightRig,
    options: &ScreenSpaceOptions,
    lookup: &IrradianceLookup<'_>,
    finished: &(dyn Fn(u64) + Sync),
) -> Result<ScreenIrradiance, ScreenSpaceError> {
    options.validate()?;
    let buffer = GBuffer::trace(tracer, &options.camera);
    let lit = lit_radiance(tracer, rig, lookup);
    let near = near_pixels(tracer, &buffer, options, finished, &|_, vertex, stream| lit(vertex, stream));
    let voxel = Reach { levels: mip_chain::LEVELS_MAX, distance_m: options.radius_m };
    let means = mip_chain::filter(&buffer, &near, voxel);
    let refine = |((texel, &near), &mean): ((&Option<Texel>, &Vec4), &Vec4)| {
        let Some(Texel { vertex, .. }) = texel else { return (Rgb::ZERO, Rgb::ZERO) };
        let place = off_surface(vertex.position, vertex.normal);
        let known = lookup(place, vertex.normal);
        known.map_or((Rgb::ZERO, Rgb::ZERO), |plain| (plain, redistributed(plain, mean, near)))
    };
    let (plain, refined) = buffer.texels().par_iter().zip(&near).zip(&means).map(refine).unzip();
    finished(work_pixels(&options.camera) / 2);
    let occlusion = near.iter().map(|near| near.w).collect();
    Ok(ScreenIrradiance { buffer, raw: Vec::new(), plain, refined, occlusion })
}

/// `served` light of a voxel whose near light and occlusion are `mean`, at a place where they are `near`.
///
/// The mean over the voxel stays `served`, exactly, unless near light alone exceeds it.
#[must_use]
pub fn redistributed(served: Rgb, mean: Vec4, near: Vec4) -> Rgb {
    if mean.w > OCCLUDED_MAX {
        return served;
    }
    let far = ((served - mean.truncate()) / (1.0 - mean.w)).max(Rgb::ZERO);
    near.truncate() + (1.0 - near.w) * far
}

/// What a surface sends under served light, cd/m2: its emission, and what it reflects of lamps and of `lookup`.
pub fn lit_radiance<'a>(
    tracer: &'a SceneTracer<'a>,
    rig: &'a LightRig,
    lookup: &'a IrradianceLookup<'a>,
) -> impl Fn(&Vertex, &mut PathStream) -> Rgb + Sync + 'a {
    let paths = PathTracer { tracer, rig, emitter_sampling: EmitterSampling::Hits };
    move |vertex, stream| {
        let lamps = paths.lamp_irradiance(vertex, stream, &mut 0);
        let place = off_surface(vertex.position, vertex.normal);
        let around = lookup(place, vertex.normal).unwrap_or(Rgb::ZERO);
        vertex.emitted_radiance * rig.emission_scale + vertex.reflectance * FRAC_1_PI * (lamps + around)
    }
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
