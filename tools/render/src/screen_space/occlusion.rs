//! Ambient occlusion at short range, and the light of what occludes.
//!
//! Short rays against the scene, not against the depth picture: what hides behind an edge occludes as well.
//! Which light an occluder sends is its caller's business. Nothing here knows of far light.

use crate::sampling::{PathStream, cosine_direction};
use crate::tracer::{SceneTracer, Vertex, off_surface};
use earthshine_trace::hemisphere::spread_pair;
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{Rgb, Vec3};
use glam::Vec4;
use std::f32::consts::PI;

/// Streams of the short rays; the reference uses 0 and 1, the far rays 2.
const STREAM: u64 = 3;

/// Short rays of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShortRays {
    /// How many.
    pub samples: u32,
    /// How far they go, m.
    pub radius_m: f32,
    /// Of the random numbers.
    pub seed: u64,
}

/// Irradiance from surfaces within the radius, lx, and the share of the (cosine-weighted) hemisphere they fill.
///
/// `radiance` says what a hit surface sends, cd/m2; `index` makes the rays of one point differ from another's.
#[must_use]
pub fn near_light(
    tracer: &SceneTracer<'_>,
    (position, normal): (Vec3, Vec3),
    rays: ShortRays,
    index: u64,
    radiance: &dyn Fn(&Vertex, &mut PathStream) -> Rgb,
) -> Vec4 {
    let seed = hash(rays.seed, Purpose::ReferencePath, index, STREAM);
    let (shift_u, shift_v) = unit_pair(seed);
    let origin = off_surface(position, normal);
    let mut sum = Vec4::ZERO;
    for sample in 0..rays.samples {
        let direction = cosine_direction(normal, spread_pair(sample, shift_u, shift_v));
        if let Some(hit) = tracer.closest(origin, direction, 0.0, rays.radius_m) {
            let mut stream = PathStream::new(seed, u64::from(sample));
            sum += (PI * radiance(&tracer.vertex(&hit), &mut stream)).extend(1.0);
        }
    }
    sum / rays.samples.max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::{SceneBuilder, grey};

    /// Floor, wall at x = 0, and with `walls` of 2 one at z = 0 too; all much larger than the radius.
    fn corner(walls: usize) -> SceneBuilder {
        let mut builder = SceneBuilder::default();
        let wall = builder.material(grey(0.5));
        builder.quad(Vec3::ZERO, Vec3::Z * 50.0, Vec3::X * 50.0, wall);
        if walls > 0 {
            builder.quad(Vec3::NEG_Z * 50.0, Vec3::Y * 50.0, Vec3::Z * 100.0, wall);
        }
        if walls > 1 {
            builder.quad(Vec3::NEG_X * 50.0, Vec3::X * 100.0, Vec3::Y * 50.0, wall);
        }
        builder
    }

    fn occluded(walls: usize, place: Vec3, radius_m: f32) -> f32 {
        let builder = corner(walls);
        let tracer = SceneTracer::new(&builder.scene);
        let rays = ShortRays { samples: 1 << 14, radius_m, seed: 1 };
        near_light(&tracer, (place, Vec3::Y), rays, 0, &|_, _| Rgb::ONE).w
    }

    /// Share of the unit disc beyond the chord at `offset`: what a wall at that share of the radius occludes,
    /// since cosine-weighted directions are uniform on the disc (Nusselt).
    fn segment(offset: f32) -> f32 {
        (offset.acos() - offset * (1.0 - offset * offset).sqrt()) / PI
    }

    #[test]
    fn two_perpendicular_planes_have_their_closed_form() {
        assert_eq!(occluded(0, Vec3::new(1.0, 0.0, 9.0), 0.5), 0.0);
        for distance in [0.001, 0.1, 0.25, 0.4] {
            let found = occluded(1, Vec3::new(distance, 0.0, 9.0), 0.5);
            let expected = segment(distance / 0.5);
            assert!((found - expected).abs() < 3e-3, "{distance}: {found} for {expected}");
        }
        assert!((occluded(1, Vec3::new(1e-4, 0.0, 9.0), 0.5) - 0.5).abs() < 3e-3, "in the very corner");
    }

    #[test]
    fn three_perpendicular_planes_have_their_closed_form() {
        // Two segments; both at once over the part of the disc with x and z beyond their chords.
        let both = |offset: f32| {
            let steps = 2000;
            let end = (1.0 - offset * offset).sqrt();
            let strip = |i: i32| {
                let x = offset + (end - offset) * (i as f32 + 0.5) / steps as f32;
                ((1.0 - x * x).sqrt() - offset).max(0.0)
            };
            (0..steps).map(strip).sum::<f32>() * (end - offset).max(0.0) / steps as f32 / PI
        };
        for distance in [0.0005, 0.1, 0.3] {
            let found = occluded(2, Vec3::new(distance, 0.0, distance), 0.5);
            let offset = distance / 0.5;
            let expected = 2.0 * segment(offset) - both(offset);
            assert!((found - expected).abs() < 4e-3, "{distance}: {found} for {expected}");
        }
        assert!((occluded(2, Vec3::new(1e-4, 0.0, 1e-4), 0.5) - 0.75).abs() < 4e-3, "in the very corner");
    }

    #[test]
    fn light_comes_from_what_occludes() {
        let builder = corner(1);
        let tracer = SceneTracer::new(&builder.scene);
        let rays = ShortRays { samples: 4096, radius_m: 0.5, seed: 1 };
        let place = (Vec3::new(0.001, 0.0, 9.0), Vec3::Y);
        let found = near_light(&tracer, place, rays, 0, &|vertex, _| vertex.reflectance * 4.0);
        assert!((found.x / (found.w * PI) - 2.0).abs() < 1e-4, "{found}");
    }
}
