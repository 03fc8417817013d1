//! A tree over meshes, and one tree a mesh however often it is placed: for scenes whose one tree would not fit.
//!
//! Boxes of a mesh are in the frame of its first placement, with room for the rounding of all others; what they hold are
//! triangles of the scene, in world space. So a ray meets the same triangles, at the same bits, as in one tree.

use crate::follow::Follower;
use crate::{Hit, build_tree, farthest, roomy_box};
use earthshine_light::ray_triangle::{RayTriangle, ray};
use earthshine_light::tree_layout::{PlacedTriangle, TreeLayout};
use earthshine_scene::{PlacedMesh, Scene};
use earthshine_world::Vec3;
use glam::DAffine3;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::ray::Ray;
use std::collections::BTreeMap;

/// A mesh placed once goes with others into one tree if it has fewer triangles.
const ALONE_MIN: u32 = 64;

/// Boxes in the frame of a shape have so many times the room: the way there rounds as well.
const SHAPE_ROOM: f32 = 2.0;

/// The trees, and where each stands.
#[derive(Debug)]
pub(crate) struct TwoLevel {
    /// Over [`Self::standing`].
    top: CwBvh,
    standing: Vec<Standing>,
    shapes: Vec<CwBvh>,
    follower: Follower,
}

/// One placement of a shape.
#[derive(Debug)]
struct Standing {
    shape: u32,
    /// What the shape's numbers of triangles count from.
    first: u32,
    /// From the world to the frame of the shape's tree.
    to_shape: DAffine3,
}

impl TwoLevel {
    /// Builds the trees: about 1 s a million triangles of different shapes, some four times as long for shapes that
    /// are small enough to be refined.
    pub(crate) fn new(scene: &Scene) -> Self {
        let mut by_shape: BTreeMap<u32, Vec<PlacedMesh>> = BTreeMap::new();
        for placed in &scene.placements {
            by_shape.entry(placed.shape).or_default().push(*placed);
        }
        by_shape.retain(|_, all| all.len() > 1 || all[0].count >= ALONE_MIN);
        let farthest = farthest(&scene.triangles);
        let mut is_placed = vec![false; scene.triangles.len()];
        let (mut standing, mut bounds, mut shapes) = (Vec::new(), Vec::new(), Vec::new());
        for all in by_shape.values() {
            let shape = shapes.len() as u32;
            shapes.push(shape_tree(scene, farthest, all, |placed, to_shape| {
                let own = placed.first as usize..(placed.first + placed.count) as usize;
                bounds.push(whole(&scene.triangles[own.clone()], farthest));
                is_placed[own].fill(true);
                standing.push(Standing { shape, first: placed.first, to_shape });
            }));
        }
        let loose: Vec<u32> = (0..scene.triangles.len() as u32).filter(|&i| !is_placed[i as usize]).collect();
        if !loose.is_empty() {
            let roomy = |&index: &u32| roomy_box(&scene.triangles[index as usize], farthest);
            let boxes: Vec<Aabb> = loose.iter().map(roomy).collect();
            let mut tree = build_tree(&boxes);
            tree.primitive_indices.iter_mut().for_each(|place| *place = loose[*place as usize]);
            bounds.push(tree.total_aabb);
            standing.push(Standing { shape: shapes.len() as u32, first: 0, to_shape: DAffine3::IDENTITY });
            shapes.push(tree);
        }
        Self { top: build_tree(&bounds), standing, shapes, follower: Follower::available() }
    }

    /// Bytes that it takes.
    pub(crate) fn bytes(&self) -> usize {
        let of = |tree: &CwBvh| size_of_val(&tree.nodes[..]) + size_of_val(&tree.primitive_indices[..]);
        of(&self.top) + self.shapes.iter().map(of).sum::<usize>() + size_of_val(&self.standing[..])
    }

    /// For a device: every placement has triangles of its own, in the order of its tree's leaves.
    pub(crate) fn layout(&self, scene: &Scene) -> TreeLayout {
        if self.standing.is_empty() {
            return TreeLayout::default();
        }
        let trees: Vec<&CwBvh> = self.shapes.iter().collect();
        let in_leaf_order = self.top.primitive_indices.iter().map(|&at| &self.standing[at as usize]);
        let placed = in_leaf_order.map(|standing| {
            let indices = &self.shapes[standing.shape as usize].primitive_indices;
            let placed = indices.iter().map(|&place| {
                let index = standing.first + place;
                PlacedTriangle::new(&RayTriangle::new(scene.triangles[index as usize]), index, 0.0)
            });
            (standing.shape as usize, standing.to_shape, placed.collect())
        });
        TreeLayout::new(&self.top, &trees, placed)
    }

    /// Gives `take` every triangle that `ray` meets, in any order; ends early where it says so.
    pub(crate) fn offer(&self, scene: &Scene, ray: &mut Ray, mut take: impl FnMut(Hit, &mut Ray) -> bool) {
        if self.standing.is_empty() {
            return;
        }
        self.follower.follow(&self.top, ray, |leaf, ray| {
            let standing = &self.standing[self.top.primitive_indices[leaf as usize] as usize];
            self.offer_shape(standing, scene, ray, &mut take)
        });
    }

    /// Whether `take` has enough.
    fn offer_shape(
        &self,
        standing: &Standing,
        scene: &Scene,
        world_ray: &mut Ray,
        take: &mut impl FnMut(Hit, &mut Ray) -> bool,
    ) -> bool {
        let tree = &self.shapes[standing.shape as usize];
        let origin = Vec3::from(world_ray.origin).as_dvec3();
        let direction = Vec3::from(world_ray.direction).as_dvec3();
        // As long as in the world: distances are the same.
        let mut own_ray = ray(
            standing.to_shape.transform_point3(origin).as_vec3(),
            standing.to_shape.transform_vector3(direction).as_vec3(),
            world_ray.tmin,
            world_ray.tmax,
        );
        self.follower.follow(tree, &mut own_ray, |leaf, own_ray| {
            let index = standing.first + tree.primitive_indices[leaf as usize];
            let crossing = RayTriangle::new(scene.triangles[index as usize]).crossing(world_ray);
            let is_enough = crossing.is_some_and(|crossing| take(Hit::of(index, crossing), world_ray));
            own_ray.tmax = world_ray.tmax;
            is_enough
        })
    }
}

/// The tree of the shape that `all` are placements of; says of each how to come from the world into its frame.
fn shape_tree(
    scene: &Scene,
    farthest: f32,
    all: &[PlacedMesh],
    mut each: impl FnMut(&PlacedMesh, DAffine3),
) -> CwBvh {
    let proto = &all[0];
    let triangles = &scene.triangles[proto.first as usize..(proto.first + proto.count) as usize];
    let bounds = whole(triangles, 0.0);
    // Near its own middle a mesh has fine coordinates wherever it stands.
    let middle = Vec3::from(0.5 * (bounds.min + bounds.max)).as_dvec3();
    let to_middle = DAffine3::from_translation(-middle);
    let mut reach = 0.0f64;
    for placed in all {
        let to_shape = to_middle * proto.to_world * placed.to_world.inverse();
        let scale = to_shape.matrix3.to_cols_array().iter().map(|part| part * part).sum::<f64>().sqrt();
        reach = reach.max(f64::from(farthest) * scale);
        each(placed, to_shape);
    }
    let local = |corners: &[Vec3; 3]| corners.map(|at| (at.as_dvec3() - middle).as_vec3());
    let boxes: Vec<Aabb> =
        triangles.iter().map(|corners| roomy_box(&local(corners), reach as f32 * SHAPE_ROOM)).collect();
    build_tree(&boxes)
}

/// The box of all `triangles`, with room as their own have.
fn whole(triangles: &[[Vec3; 3]], farthest: f32) -> Aabb {
    let mut bounds = Aabb::INVALID;
    for corners in triangles {
        let own = roomy_box(corners, farthest);
        bounds.extend(own.min).extend(own.max);
    }
    bounds
}
