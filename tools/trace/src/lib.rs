//! Rays against a scene: the closest surface along a ray, whether a segment is free, and directions to shoot in.
//!
//! The tree is `obvhs`'s eight-wide compressed BVH. Holes of alpha masks are asked for at every crossing.
//! Everything is two-sided here; what a hit means (reflectance, emission, which patch) is its caller's
//! business. Start at [`SceneTracer::closest`].

pub mod hemisphere;

use earthshine_light::ray_triangle::{RayTriangle, ray};
use earthshine_scene::{Scene, Surface};
use earthshine_world::Vec3;
use glam::UVec2;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::triangle::Triangle;
use std::time::Duration;

/// Rays begin this far behind their origin, m, and count from the origin on: the tree skips boxes that end nearer than
/// 0.1 mm, and a wall that near would let the ray out.
const RUN_UP_M: f32 = 2e-4;

/// Where a ray meets the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Index into [`Scene::triangles`].
    pub triangle: usize,
    /// Barycentric weight of corner 1.
    pub u: f32,
    /// Barycentric weight of corner 2.
    pub v: f32,
    /// In lengths of the ray's direction.
    pub distance: f32,
    /// Whether the front face was hit.
    pub front: bool,
}

/// A scene ready for rays.
#[derive(Debug)]
pub struct SceneTracer<'scene> {
    scene: &'scene Scene,
    tree: CwBvh,
    /// In the tree's leaf order.
    triangles: Vec<RayTriangle>,
    has_masks: bool,
}

impl<'scene> SceneTracer<'scene> {
    /// Builds the tree: about 1 s a million triangles on one core.
    #[must_use]
    pub fn new(scene: &'scene Scene) -> Self {
        let boxed: Vec<Triangle> = scene
            .triangles
            .iter()
            .map(|&[a, b, c]| Triangle { v0: a.into(), v1: b.into(), v2: c.into() })
            .collect();
        let tree = if boxed.is_empty() {
            CwBvh::default()
        } else {
            build_cwbvh_from_tris(&boxed, BvhBuildParams::medium_build(), &mut Duration::default())
        };
        let triangles =
            tree.primitive_indices.iter().map(|&i| RayTriangle::new(scene.triangles[i as usize])).collect();
        Self { scene, tree, triangles, has_masks: scene.has_masks() }
    }

    /// What is traced.
    #[must_use]
    pub fn scene(&self) -> &'scene Scene {
        self.scene
    }

    /// The closest crossing with `distance_min < distance < distance_max` that is not a hole.
    #[must_use]
    pub fn closest(
        &self,
        origin: Vec3,
        direction: Vec3,
        distance_min: f32,
        distance_max: f32,
    ) -> Option<Hit> {
        if self.triangles.is_empty() {
            return None;
        }
        let start = origin - direction * RUN_UP_M;
        let mut ray = ray(start, direction, distance_min + RUN_UP_M, distance_max + RUN_UP_M);
        let mut state = self.tree.new_traversal(ray.direction);
        let mut node: &CwBvhNode;
        let mut closest = None;
        obvhs::traverse!(self.tree, node, state, node.intersect_ray(&ray, state.oct_inv4), {
            let leaf = state.primitive_id as usize;
            if let Some(hit) = self.hit_at(leaf, &ray) {
                ray.tmax = hit.distance;
                closest = Some(hit);
            }
        });
        closest.map(|hit| Hit { distance: hit.distance - RUN_UP_M, ..hit })
    }

    /// Whether anything but holes lies between `origin` and `distance` along `direction`.
    #[must_use]
    pub fn is_blocked(&self, origin: Vec3, direction: Vec3, distance: f32) -> bool {
        if self.triangles.is_empty() {
            return false;
        }
        let ray = ray(origin - direction * RUN_UP_M, direction, RUN_UP_M, distance + RUN_UP_M);
        let mut state = self.tree.new_traversal(ray.direction);
        let mut node: &CwBvhNode;
        obvhs::traverse!(self.tree, node, state, node.intersect_ray(&ray, state.oct_inv4), {
            if self.hit_at(state.primitive_id as usize, &ray).is_some() {
                return true;
            }
        });
        false
    }

    #[inline]
    fn hit_at(&self, leaf: usize, ray: &obvhs::ray::Ray) -> Option<Hit> {
        let crossing = self.triangles[leaf].crossing(ray)?;
        let triangle = self.tree.primitive_indices[leaf] as usize;
        let hit = Hit {
            triangle,
            u: crossing.u,
            v: crossing.v,
            distance: crossing.distance,
            front: crossing.front,
        };
        if self.has_masks && self.surface(&hit).is_hole {
            return None;
        }
        Some(hit)
    }

    /// What is at `hit`, seen from the side that was hit.
    #[must_use]
    pub fn surface(&self, hit: &Hit) -> Surface {
        self.scene.surface(hit.triangle, hit.u, hit.v, hit.front)
    }

    /// Whether a hit is on the back of something that has but one side.
    #[must_use]
    pub fn is_back(&self, hit: &Hit) -> bool {
        !hit.front && !self.scene.materials[self.scene.material_of[hit.triangle] as usize].double_sided
    }

    /// Unit geometric normal of the side that was hit.
    #[must_use]
    pub fn normal(&self, hit: &Hit) -> Vec3 {
        let normal = self.scene.normal(hit.triangle);
        if hit.front { normal } else { -normal }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_knows_which_side_it_hits_and_where() {
        let scene = Scene {
            triangles: vec![[Vec3::ZERO, Vec3::X, Vec3::Y]],
            texture_coordinates: vec![[[0.0; 2]; 3]],
            material_of: vec![0],
            ..Scene::default()
        };
        let tracer = SceneTracer::new(&scene);
        let hit = tracer.closest(Vec3::new(0.25, 0.5, 1.0), Vec3::NEG_Z, 0.0, 10.0).expect("a hit");
        assert!(hit.front && tracer.normal(&hit) == Vec3::Z && (hit.distance - 1.0).abs() < 1e-6);
        assert!((hit.u - 0.25).abs() < 1e-6 && (hit.v - 0.5).abs() < 1e-6);
        let back = tracer.closest(Vec3::new(0.25, 0.5, -1.0), -Vec3::NEG_Z, 0.0, 10.0).expect("a hit");
        assert!(!back.front && tracer.normal(&back) == Vec3::NEG_Z);
        assert!(!tracer.is_blocked(Vec3::new(0.25, 0.5, 1.0), Vec3::NEG_Z, 0.9));
        assert!(tracer.closest(Vec3::new(0.9, 0.9, 1.0), Vec3::NEG_Z, 0.0, 10.0).is_none());
    }
}
