//! Rays against a scene: the closest surface along a ray, whether a segment is free, and directions to shoot in.
//!
//! Trees are `obvhs`'s eight-wide compressed BVHs: one over all triangles, or one a mesh under one over placements, which
//! takes a quarter of the memory or less and finds the same hits, bit for bit; `follow` goes down them. Holes of alpha
//! masks are asked for at every crossing.
//! Everything is two-sided here; what a hit means (reflectance, emission, which patch) is its caller's
//! business. Start at [`SceneTracer::closest`].

mod caster;
pub mod ends;
mod fan;
mod flat;
mod follow;
pub mod hemisphere;
mod two_level;

pub use crate::caster::{CasterError, Query};
pub use crate::ends::{EndCounter, RayDevice};
pub use crate::fan::{RayFan, Rays};

use crate::flat::Flat;
use crate::two_level::TwoLevel;
use earthshine_light::TreeLayout;
use earthshine_light::ray_triangle::{Crossing, RayTriangle, ray};
use earthshine_scene::{Scene, Surface};
use earthshine_world::{Rgb, Vec3};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::Ray;
use std::time::Duration;

/// Rays begin this far behind their origin, m, and count from the origin on: the tree skips boxes that end nearer than
/// 0.1 mm, and a wall that near would let the ray out.
pub const RUN_UP_M: f32 = 2e-4;

/// Boxes that begin this share of a hit's distance behind it are still looked into: what is as near as the hit may lie in
/// one, and boxes are met to rounding only.
pub const TIE_ROOM: f32 = 2e-6;

/// Roundings of world coordinates that boxes have room for, and the share of a triangle's extent by which a crossing may lie
/// outside of it: with that room what a ray hits does not hang on how a tree is built.
const BOX_ROUNDINGS: f32 = 16.0;
const BOX_OUTSIDE: f32 = 4e-6;

/// Trees over at most so many boxes have all of their nodes put elsewhere where that makes them better: rays come by 8 % fewer
/// nodes in Sponza. It takes three times as long as the rest of the building, 3 s a million boxes.
const REFINED_BOXES_MAX: usize = 1 << 18;

/// The ray that begins a little behind `origin` for crossings between two distances from it.
fn run_up(origin: Vec3, direction: Vec3, distance_min: f32, distance_max: f32) -> Ray {
    let start = origin - direction * RUN_UP_M;
    ray(start, direction, distance_min + RUN_UP_M, distance_max + RUN_UP_M)
}

/// The box of a triangle with `corners`, with room for rounding where coordinates are up to `farthest`.
fn roomy_box(corners: &[Vec3; 3], farthest: f32) -> Aabb {
    let [a, b, c] = corners;
    let (low, high) = (a.min(*b).min(*c), a.max(*b).max(*c));
    let room = BOX_ROUNDINGS * f32::EPSILON * farthest + BOX_OUTSIDE * (high - low).max_element();
    Aabb { min: (low - room).into(), max: (high + room).into() }
}

/// The largest coordinate of any corner, either way.
fn farthest<'a>(triangles: impl IntoIterator<Item = &'a [Vec3; 3]>) -> f32 {
    triangles.into_iter().flatten().map(|corner| corner.abs().max_element()).fold(0.0, f32::max)
}

fn build_tree(boxes: &[Aabb]) -> CwBvh {
    if boxes.is_empty() {
        return CwBvh::default();
    }
    let mut how = BvhBuildParams::medium_build();
    if boxes.len() <= REFINED_BOXES_MAX {
        how.reinsertion_batch_ratio = 1.0;
    }
    build_cwbvh(boxes, how, &mut Duration::default())
}

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

impl Hit {
    fn of(triangle: u32, Crossing { distance, u, v, front }: Crossing) -> Self {
        Self { triangle: triangle as usize, u, v, distance, front }
    }

    fn is_before(&self, other: &Self) -> bool {
        (self.distance, self.triangle) < (other.distance, other.triangle)
    }
}

/// A scene ready for rays.
#[derive(Debug)]
pub struct SceneTracer<'scene> {
    scene: &'scene Scene,
    trees: Trees,
    has_masks: bool,
}

#[derive(Debug)]
enum Trees {
    Flat(Flat),
    TwoLevel(TwoLevel),
}

impl<'scene> SceneTracer<'scene> {
    /// With one tree over all triangles: about 1 s a million triangles on one core, some four times as long where the tree
    /// is refined (small scenes).
    #[must_use]
    pub fn new(scene: &'scene Scene) -> Self {
        Self { scene, trees: Trees::Flat(Flat::new(scene)), has_masks: scene.has_masks() }
    }

    /// With one tree a mesh, however often it is placed: less memory, fewer rays a second, the same hits. The scene's
    /// triangles must be those of its [`Scene::placements`].
    #[must_use]
    pub fn of_meshes(scene: &'scene Scene) -> Self {
        Self { scene, trees: Trees::TwoLevel(TwoLevel::new(scene)), has_masks: scene.has_masks() }
    }

    /// Bytes that the trees take, beside the scene.
    #[must_use]
    pub fn tree_bytes(&self) -> usize {
        match &self.trees {
            Trees::Flat(flat) => flat.bytes(),
            Trees::TwoLevel(two_level) => two_level.bytes(),
        }
    }

    /// What is traced.
    #[must_use]
    pub fn scene(&self) -> &'scene Scene {
        self.scene
    }

    /// The closest crossing with `distance_min < distance < distance_max` that is not a hole. Of several at the same
    /// distance that of the first triangle: it does not hang on how the tree came about.
    #[must_use]
    pub fn closest(
        &self,
        origin: Vec3,
        direction: Vec3,
        distance_min: f32,
        distance_max: f32,
    ) -> Option<Hit> {
        let ray = run_up(origin, direction, distance_min, distance_max);
        self.closest_of(ray, |hit| !self.is_hole(hit))
    }

    /// Where `query` crosses `triangle`, which somebody else found to be the first on its way; `None` where it is a hole, or
    /// passes an edge here.
    #[must_use]
    pub fn crossing(&self, query: &Query, triangle: u32) -> Option<Hit> {
        let corners = *self.scene.triangles.get(triangle as usize)?;
        let hit = Hit::of(triangle, RayTriangle::new(corners).crossing(&query.ray())?);
        (!self.is_hole(&hit)).then_some(Hit { distance: hit.distance - RUN_UP_M, ..hit })
    }

    /// As [`Self::closest`] from a distance of zero on, where holes count as well.
    fn first(&self, query: &Query) -> Option<Hit> {
        self.closest_of(query.ray(), |_| true)
    }

    #[inline]
    fn closest_of(&self, mut ray: Ray, counts: impl Fn(&Hit) -> bool) -> Option<Hit> {
        let mut closest: Option<Hit> = None;
        self.offer(&mut ray, |hit, ray| {
            if closest.is_none_or(|other| hit.is_before(&other)) && counts(&hit) {
                ray.tmax = ray.tmax.min(hit.distance * (1.0 + TIE_ROOM) + RUN_UP_M);
                closest = Some(hit);
            }
            false
        });
        closest.map(|hit| Hit { distance: hit.distance - RUN_UP_M, ..hit })
    }

    /// Whether anything but holes lies between `origin` and `distance` along `direction`.
    #[must_use]
    pub fn is_blocked(&self, origin: Vec3, direction: Vec3, distance: f32) -> bool {
        let mut ray = run_up(origin, direction, 0.0, distance);
        let mut is_blocked = false;
        self.offer(&mut ray, |hit, _| {
            is_blocked = !self.is_hole(&hit);
            is_blocked
        });
        is_blocked
    }

    /// The same trees for a device that traces by itself.
    #[must_use]
    pub fn layout(&self) -> TreeLayout {
        match &self.trees {
            Trees::Flat(flat) => flat.layout(),
            Trees::TwoLevel(two_level) => two_level.layout(self.scene),
        }
    }

    #[inline]
    fn offer(&self, ray: &mut Ray, take: impl FnMut(Hit, &mut Ray) -> bool) {
        match &self.trees {
            Trees::Flat(flat) => flat.offer(ray, take),
            Trees::TwoLevel(two_level) => two_level.offer(self.scene, ray, take),
        }
    }

    #[inline]
    fn is_hole(&self, hit: &Hit) -> bool {
        self.has_masks && self.surface(hit).is_hole
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

    /// Whether light is emitted at `hit`, to the side that was hit.
    #[must_use]
    pub fn emits(&self, hit: &Hit) -> bool {
        let material = &self.scene.materials[self.scene.material_of[hit.triangle] as usize];
        material.emitted_radiance != Rgb::ZERO && self.surface(hit).emitted_radiance != Rgb::ZERO
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
    fn of_many_surfaces_in_one_place_the_first_is_hit() {
        let triangle = |z: f32| [Vec3::new(-1.0, -1.0, z), Vec3::new(3.0, -1.0, z), Vec3::new(-1.0, 3.0, z)];
        // Behind, in one plane, and behind again, so that the tree sorts them.
        let triangles: Vec<_> = (0..300)
            .map(|i| triangle(if (100..200).contains(&i) { 0.0 } else { -f32::from(i as u16) }))
            .collect();
        let count = triangles.len();
        let scene = Scene {
            triangles,
            texture_coordinates: vec![[[0.0; 2]; 3]; count],
            material_of: vec![0; count],
            ..Scene::default()
        };
        let tracer = SceneTracer::new(&scene);
        for i in 0..100 {
            let from = Vec3::new(0.3, 0.001 * i as f32, 700.0);
            let to = Vec3::new(0.1 + 0.003 * i as f32, 0.2, -0.5);
            let hit =
                tracer.closest(from, (to - from).normalize_or_zero(), 0.0, f32::INFINITY).expect("a hit");
            assert_eq!(hit.triangle, 0, "at zero as well");
            let blind =
                tracer.closest(from - Vec3::Z * 700.0 - Vec3::Z * 0.5, Vec3::NEG_Z, 0.0, f32::INFINITY);
            assert_eq!(blind.expect("a hit").triangle, 1);
        }
        let mut raised = scene.clone();
        raised.triangles[..100].iter_mut().flatten().for_each(|corner| corner.z -= 1000.0);
        let hit = SceneTracer::new(&raised).closest(Vec3::Z, Vec3::NEG_Z, 0.0, 10.0).expect("a hit");
        assert_eq!(hit.triangle, 100);
    }

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
