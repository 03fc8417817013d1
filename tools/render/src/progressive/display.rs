//! Light at any point from the leaves' means: corners take the mean of the leaves around them on one plane.
//!
//! A corner in the middle of a larger neighbour's edge does not hear of that neighbour; the step is small where
//! leaves were not split for a gradient. Not the solution itself: for showing it.

use super::id_buffer::side_of;
use super::shooting::Progressive;
use crate::tracer::{SceneTracer, off_surface, offset_at};
use earthshine_world::{Rgb, Vec3};
use std::collections::BTreeMap;

/// Corners nearer than this share of the scene are one.
const WELD_SHARE: f32 = 1e-5;
/// Normals that agree to this part of one are one.
const NORMAL_STEPS: f32 = 64.0;

/// A solution's light, ready to be read.
#[derive(Debug)]
pub struct Shading<'a> {
    solved: &'a Progressive<'a>,
    tracer: &'a SceneTracer<'a>,
    /// Irradiance at the corners of every leaf, lx.
    corners: Vec<[Rgb; 3]>,
}

impl<'a> Shading<'a> {
    /// Reads the light of `solved`; `ambient` is added everywhere, lx.
    #[must_use]
    pub fn of(solved: &'a Progressive<'a>, tracer: &'a SceneTracer<'a>, ambient: Rgb) -> Self {
        let leaves = &solved.elements().leaves;
        let weld_m = WELD_SHARE * tracer.scene().bounds().size().max_element().max(f32::MIN_POSITIVE);
        let key = |corner: Vec3, normal: Vec3| {
            let place = (corner / weld_m).round().as_i64vec3().to_array();
            (place, (normal * NORMAL_STEPS).round().as_ivec3().to_array())
        };
        let mut shared: BTreeMap<_, (Rgb, f32)> = BTreeMap::new();
        for leaf in leaves {
            for corner in leaf.corners {
                let sum = shared.entry(key(corner, leaf.normal)).or_default();
                sum.0 += leaf.irradiance;
                sum.1 += 1.0;
            }
        }
        let corners = leaves
            .iter()
            .map(|leaf| {
                leaf.corners.map(|corner| {
                    let around = shared.get(&key(corner, leaf.normal));
                    ambient + around.map_or(leaf.irradiance, |&(sum, count)| sum / count)
                })
            })
            .collect();
        Self { solved, tracer, corners }
    }

    /// Irradiance at `position` (on a surface, or a hair off it) for unit `normal`, lx; `None` off all surfaces.
    #[must_use]
    pub fn at(&self, position: Vec3, normal: Vec3) -> Option<Rgb> {
        let origin = off_surface(position, normal);
        let hit = self.tracer.closest(origin, -normal, 0.0, 8.0 * offset_at(position))?;
        let (root, weights) = side_of(&hit);
        let (leaf, weights) = self.solved.elements().leaf_at(root, weights)?;
        let corners = &self.corners[leaf as usize];
        Some(corners.iter().zip(weights).map(|(&light, weight)| light * weight).sum::<Rgb>().max(Rgb::ZERO))
    }
}
