//! Served light refined: volumes answer where the picture's rays end, one bounce later than where they are looked at.
//!
//! What a volume smears over a voxel, or reads from the wrong surface in it, is smeared once more by the bounce and hardly
//! seen. Lamps light the ends of rays directly, with shadows. Near light is kept as sharp as the picture, far light and
//! that of emitters is filtered along surfaces; the picture is looked at in twice as many pixels along each edge, since
//! mouldings are thinner than a pixel.

use super::far_light::{self, Gathered, Rays};
use super::g_buffer::{GBuffer, Texel};
use super::mip_chain::{self, Reach};
use super::{
    FAR_LEVELS, FAR_REACH_RADII, ScreenIrradiance, ScreenSpaceError, ScreenSpaceOptions, far_and_near,
};
use crate::camera::Pinhole;
use crate::path::{EmitterSampling, PathTracer};
use crate::picture::IrradianceLookup;
use crate::sampling::PathStream;
use crate::tracer::{SceneTracer, Vertex, off_surface};
use earthshine_world::{LightRig, Rgb};
use glam::Vec4;
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

/// Texels along a pixel's edge.
const FINER: u32 = 2;

/// Texels that [`served`] reports as finished.
#[must_use]
pub fn work_texels(camera: &Pinhole) -> u64 {
    let finer = camera.finer(FINER);
    u64::from(finer.width()) * u64::from(finer.height())
}

/// Served light refined by `options.far_samples` rays a pixel, whose ends `lookup` answers for. Where `lookup` knows nothing
/// of a surface that is in view, `plain` and `refined` are zero; of one that a ray meets, nothing but lamps lights it.
///
/// `finished` hears of finished texels ([`work_texels`] in all), from any thread. Costs a ray for each sample, and at its end a
/// ray to an emitter and to each of a few lamps.
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
    let paths = PathTracer { tracer, rig, emitter_sampling: EmitterSampling::Balanced };
    let finer = options.camera.finer(FINER);
    let texels_a_pixel = (finer.width() / options.camera.width()).pow(2);
    let buffer = GBuffer::trace(tracer, &finer);
    let known = |vertex: &Vertex| lookup(off_surface(vertex.position, vertex.normal), vertex.normal);
    let reflected = |vertex: &Vertex, stream: &mut PathStream| {
        let lamps = paths.lamp_irradiance(vertex, stream, &mut 0);
        vertex.reflectance * FRAC_1_PI * (lamps + known(vertex).unwrap_or(Rgb::ZERO))
    };
    let rays = Rays {
        samples: options.far_samples.div_ceil(texels_a_pixel),
        radius_m: options.radius_m,
        seed: options.seed,
    };
    let found = far_light::gather(&paths, &buffer, rays, &reflected, finished);
    let wide = Reach { levels: FAR_LEVELS, distance_m: FAR_REACH_RADII * options.radius_m };
    let layer = |value: fn(&Gathered) -> Vec4, reach: Reach| {
        mip_chain::filter(&buffer, &found.iter().map(value).collect::<Vec<_>>(), reach)
    };
    let far = layer(|pixel| pixel.far, wide);
    let near = layer(Gathered::near, options.near_reach());
    // A few looks at emitters are noise on near texels (SSIM .92 for .99 served, in a room that they light).
    let emitted = layer(|pixel| pixel.emitted.extend(0.0), wide);
    let light_of = |(index, texel): (usize, &Option<Texel>)| {
        let plain = texel.and_then(|texel| known(&texel.vertex));
        plain.map_or((Rgb::ZERO, Rgb::ZERO), |plain| {
            (plain, emitted[index].truncate() + far_and_near(far[index], near[index], plain))
        })
    };
    let (plain, refined) = buffer.texels().par_iter().enumerate().map(light_of).unzip();
    let occlusion = near.iter().map(|near| near.w).collect();
    Ok(ScreenIrradiance { buffer, raw: Vec::new(), plain, refined, occlusion })
}
