//! Rays against a scene: closest hits that honour alpha masks, and directions to shoot them in.
//!
//! The tree is `obvhs`'s eight-wide compressed BVH. What a hit means (reflectance, emission, which patch)
//! is its caller's business. Start at [`SceneTracer::closest`].

pub mod hemisphere;

use earthshine_scene::Scene;
use earthshine_world::Vec3;
use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;

/// A scene and the tree over its triangles.
pub struct SceneTracer<'s> {
    scene: &'s Scene,
    tree: CwBvh,
    /// In the tree's order, so that a leaf reads neighbours.
    triangles: Vec<Triangle>,
    /// Which materials have an alpha mask; empty when none has.
    masked: Vec<bool>,
}

impl std::fmt::Debug for SceneTracer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SceneTracer").field("triangles", &self.triangles.len()).finish_non_exhaustive()
    }
}

/// Where a ray ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Index into the scene's triangles.
    pub triangle: usize,
    /// Barycentric weight of corner 1.
    pub u: f32,
    /// Barycentric weight of corner 2.
    pub v: f32,
    /// m.
    pub distance: f32,
    /// Whether the front face was hit.
    pub front: bool,
    /// Unit geometric normal of the side that was hit.
    pub normal: Vec3,
}

impl<'s> SceneTracer<'s> {
    /// Builds the tree: about 1 s a million triangles on one core.
    #[must_use]
    pub fn new(scene: &'s Scene) -> Self {
        let corners = |[a, b, c]: [Vec3; 3]| Triangle { v0: a.into(), v1: b.into(), v2: c.into() };
        let mut triangles: Vec<Triangle> = scene.triangles.iter().map(|&t| corners(t)).collect();
        let mut parameters = BvhBuildParams::medium_build();
        parameters.pre_split = false;
        let tree = build_cwbvh_from_tris(&triangles, parameters, &mut std::time::Duration::default());
        triangles = tree.primitive_indices.iter().map(|&i| triangles[i as usize]).collect();
        let masked = if scene.has_masks() {
            scene.materials.iter().map(|material| material.alpha_cutoff.is_some()).collect()
        } else {
            Vec::new()
        };
        Self { scene, tree, triangles, masked }
    }

    /// What was given to [`Self::new`].
    #[must_use]
    pub fn scene(&self) -> &'s Scene {
        self.scene
    }

    /// The first thing that is not a hole along unit `direction`, between `nearest` and `farthest` metres.
    #[must_use]
    pub fn closest(&self, origin: Vec3, direction: Vec3, nearest: f32, farthest: f32) -> Option<Hit> {
        let ray = Ray::new(origin.into(), direction.into(), nearest, farthest);
        let mut hit = RayHit::none();
        if self.triangles.is_empty() {
            return None;
        }
        let found = self.tree.ray_traverse(ray, &mut hit, |ray, index| {
            let distance = self.triangles[index].intersect(ray);
            if distance < ray.tmax && self.is_hole(index, ray, distance) { f32::INFINITY } else { distance }
        });
        found.then(|| self.describe(hit.primitive_id as usize, &ray, hit.t))
    }

    /// Whether nothing solid lies along unit `direction` between `nearest` and `farthest` metres.
    #[must_use]
    pub fn is_clear(&self, origin: Vec3, direction: Vec3, nearest: f32, farthest: f32) -> bool {
        if self.triangles.is_empty() {
            return true;
        }
        let ray = Ray::new(origin.into(), direction.into(), nearest, farthest);
        self.tree.ray_traverse_miss(ray, |ray, index| {
            let distance = self.triangles[index].intersect(ray);
            if distance < ray.tmax && self.is_hole(index, ray, distance) { f32::INFINITY } else { distance }
        })
    }

    fn is_hole(&self, index: usize, ray: &Ray, distance: f32) -> bool {
        if self.masked.is_empty() {
            return false;
        }
        let triangle = self.tree.primitive_indices[index] as usize;
        if !self.masked[self.scene.material_of[triangle] as usize] {
            return false;
        }
        let (u, v) = self.barycentric(index, ray, distance);
        self.scene.surface(triangle, u, v, true).is_hole
    }

    fn barycentric(&self, index: usize, ray: &Ray, distance: f32) -> (f32, f32) {
        let Triangle { v0, v1, v2 } = self.triangles[index];
        let point = ray.origin + ray.direction * distance - v0;
        let (e1, e2) = (v1 - v0, v2 - v0);
        let normal: Vec3A = e1.cross(e2);
        let scale = 1.0 / normal.length_squared().max(f32::MIN_POSITIVE);
        let u = point.cross(e2).dot(normal) * scale;
        let v = e1.cross(point).dot(normal) * scale;
        (u.clamp(0.0, 1.0), v.clamp(0.0, 1.0))
    }

    fn describe(&self, index: usize, ray: &Ray, distance: f32) -> Hit {
        let (u, v) = self.barycentric(index, ray, distance);
        let triangle = self.tree.primitive_indices[index] as usize;
        let normal = self.scene.normal(triangle);
        let front = normal.dot(ray.direction.into()) < 0.0;
        Hit { triangle, u, v, distance, front, normal: if front { normal } else { -normal } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet() -> Scene {
        Scene {
            triangles: vec![[Vec3::ZERO, Vec3::X, Vec3::Y]],
            texture_coordinates: vec![[[0.0; 2]; 3]],
            material_of: vec![0],
            ..Scene::default()
        }
    }

    #[test]
    fn a_ray_knows_which_side_it_hits_and_where() {
        let scene = sheet();
        let tracer = SceneTracer::new(&scene);
        let hit = tracer.closest(Vec3::new(0.25, 0.5, 1.0), Vec3::NEG_Z, 0.0, 10.0).expect("a hit");
        assert!(hit.front && hit.normal == Vec3::Z && (hit.distance - 1.0).abs() < 1e-6);
        assert!((hit.u - 0.25).abs() < 1e-6 && (hit.v - 0.5).abs() < 1e-6);
        let back = tracer.closest(Vec3::new(0.25, 0.5, -1.0), Vec3::Z, 0.0, 10.0).expect("a hit");
        assert!(!back.front && back.normal == Vec3::NEG_Z);
        assert!(tracer.is_clear(Vec3::new(0.25, 0.5, 1.0), Vec3::NEG_Z, 0.0, 0.9));
        assert!(tracer.closest(Vec3::new(0.9, 0.9, 1.0), Vec3::NEG_Z, 0.0, 10.0).is_none());
    }
}
