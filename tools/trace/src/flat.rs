//! One tree over all triangles of a scene: the fastest where it fits.

use crate::follow::Follower;
use crate::{Hit, build_tree, farthest, roomy_box};
use earthshine_light::ray_triangle::RayTriangle;
use earthshine_light::tree_layout::{PlacedTriangle, TreeLayout};
use earthshine_scene::Scene;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::ray::Ray;

/// The tree and its triangles.
#[derive(Debug)]
pub(crate) struct Flat {
    tree: CwBvh,
    /// In the tree's leaf order.
    triangles: Vec<RayTriangle>,
    follower: Follower,
}

impl Flat {
    /// Builds the tree: about 1 s a million triangles on one core, some four times as long for trees that
    /// are refined, [`crate::REFINED_BOXES_MAX`] boxes at most.
    pub(crate) fn new(scene: &Scene) -> Self {
        let farthest = farthest(&scene.triangles);
        let boxes: Vec<Aabb> = scene.triangles.iter().map(|corners| roomy_box(corners, farthest)).collect();
        let tree = build_tree(&boxes);
        let triangles =
            tree.primitive_indices.iter().map(|&i| RayTriangle::new(scene.triangles[i as usize])).collect();
        Self { tree, triangles, follower: Follower::available() }
    }

    /// Bytes that it takes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.tree.nodes[..])
            + size_of_val(&self.tree.primitive_indices[..])
            + size_of_val(&self.triangles[..])
    }

    /// For a device.
    pub(crate) fn layout(&self) -> TreeLayout {
        let placed = self.triangles.iter().zip(&self.tree.primitive_indices);
        let placed = placed.map(|(triangle, &index)| PlacedTriangle::new(triangle, index, 0.0));
        TreeLayout::of_one(&self.tree, placed.collect())
    }

    /// Gives `take` every triangle that `ray` meets, in any order; ends early where it says so.
    #[inline]
    pub(crate) fn offer(&self, ray: &mut Ray, mut take: impl FnMut(Hit, &mut Ray) -> bool) {
        if self.triangles.is_empty() {
            return;
        }
        self.follower.follow(&self.tree, ray, |leaf, ray| {
            let leaf = leaf as usize;
            let crossing = self.triangles[leaf].crossing(ray);
            crossing.is_some_and(|crossing| take(Hit::of(self.tree.primitive_indices[leaf], crossing), ray))
        });
    }
}
