//! A hemispherical id buffer: which patch a shooter sees in every direction.
//!
//! The hemisphere over the shooter's centre is projected stereographically onto a square of texels (GPU Gems 2,
//! ch. 39); each holds the id of the patch that is closest there. A receiver is visible if its patch is in the
//! texel it projects to or in one beside it. One buffer costs the same however many receivers there are, but sees from
//! one point and in steps of a texel: a patch much thinner than a texel may be missed.

use super::elements::{Elements, Patch};
use super::form_factor::centre;
use crate::tracer::{SceneTracer, off_surface};
use earthshine_world::Vec3;
use rayon::prelude::*;

/// Sees nothing.
const SKY: u32 = u32::MAX;

/// What one shooter sees.
#[derive(Debug)]
pub struct IdBuffer {
    edge_texels: u32,
    origin: Vec3,
    normal: Vec3,
    right: Vec3,
    up: Vec3,
    ids: Vec<u32>,
}

/// The root of a side in [`Elements`] and the barycentric weights of its corners, for a ray's hit.
#[must_use]
pub fn side_of(hit: &crate::tracer::Hit) -> (u32, [f32; 3]) {
    let root = 2 * hit.triangle as u32 + u32::from(!hit.front);
    let (a, b, c) = (1.0 - hit.u - hit.v, hit.u, hit.v);
    // Back sides are wound the other way: their second and third corner are swapped.
    (root, if hit.front { [a, b, c] } else { [a, c, b] })
}

impl IdBuffer {
    /// Looks around from the centre of `patch`.
    #[must_use]
    pub fn look(tracer: &SceneTracer<'_>, elements: &Elements, patch: &Patch, edge_texels: u32) -> Self {
        let (right, up) = patch.normal.any_orthonormal_pair();
        let origin = off_surface(centre(&patch.corners), patch.normal);
        let mut buffer = Self { edge_texels, origin, normal: patch.normal, right, up, ids: Vec::new() };
        buffer.ids = (0..edge_texels * edge_texels)
            .into_par_iter()
            .map(|texel| {
                let Some(direction) = buffer.direction(texel % edge_texels, texel / edge_texels) else {
                    return SKY;
                };
                let hit = tracer.closest(origin, direction, 0.0, f32::INFINITY);
                hit.map_or(SKY, |hit| {
                    let (root, weights) = side_of(&hit);
                    elements.patch_at(root, weights)
                })
            })
            .collect();
        buffer
    }

    /// Through the middle of a texel; `None` below the horizon (the corners of the square).
    fn direction(&self, x: u32, y: u32) -> Option<Vec3> {
        let along = |texel: u32| (texel as f32 + 0.5) / self.edge_texels as f32 * 2.0 - 1.0;
        let (x, y) = (along(x), along(y));
        let square = x * x + y * y;
        let height = (1.0 - square) / (1.0 + square);
        (height > 0.0).then(|| {
            let flat = 2.0 / (1.0 + square);
            self.right * (x * flat) + self.up * (y * flat) + self.normal * height
        })
    }

    /// Whether a place on `patch` is seen.
    #[must_use]
    pub fn sees(&self, place: Vec3, patch: u32) -> bool {
        let Some(towards) = (place - self.origin).try_normalize() else { return false };
        let height = towards.dot(self.normal);
        if height <= 0.0 {
            return false;
        }
        let texel =
            |along: f32| (((along / (1.0 + height)) * 0.5 + 0.5) * self.edge_texels as f32).floor() as i64;
        let (x, y) = (texel(towards.dot(self.right)), texel(towards.dot(self.up)));
        let inside = 0..i64::from(self.edge_texels);
        (-1..=1).any(|dy| {
            (-1..=1).any(|dx| {
                let (x, y) = (x + dx, y + dy);
                let is_inside = inside.contains(&x) && inside.contains(&y);
                is_inside && self.ids[(y * i64::from(self.edge_texels) + x) as usize] == patch
            })
        })
    }
}
