//! Trees and triangles laid out for a device that follows rays by itself: two levels of trees, no tree built anew.
//!
//! One tree over *placements*, each of which says which tree stands there, and triangles in the order of its leaves. What
//! is laid out are the very trees that rays follow on the CPU, so both look into the same boxes and meet the same triangles.

use crate::ray_triangle::RayTriangle;
use glam::{DAffine3, Vec3};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use std::time::Duration;

/// A node of a tree: 80 bytes, as `obvhs` has it.
pub type NodeWords = [u32; 20];

/// One tree where it stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// From the world to the frame of the tree.
    pub to_tree: DAffine3,
    /// Its root among all nodes.
    pub first_node: u32,
    /// Where the triangles of its leaves begin.
    pub first_triangle: u32,
}

/// A triangle in the world, as rays meet it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedTriangle {
    /// Corner 0, m.
    pub corner: Vec3,
    /// Corner 0 minus corner 1, m.
    pub edge_1: Vec3,
    /// Corner 2 minus corner 0, m.
    pub edge_2: Vec3,
    /// What the host calls it.
    pub index: u32,
    /// What a crossing lets through.
    pub transmittance: f32,
}

impl PlacedTriangle {
    /// `triangle`, called `index`.
    #[must_use]
    pub fn new(triangle: &RayTriangle, index: u32, transmittance: f32) -> Self {
        let [corner, edge_1, edge_2] = triangle.corner_and_edges();
        Self { corner, edge_1, edge_2, index, transmittance }
    }
}

/// Everything that rays can meet.
#[derive(Debug, Clone, Default)]
pub struct TreeLayout {
    /// Of the tree over placements first, then of all others.
    pub nodes: Vec<NodeWords>,
    /// In the order of that tree's leaves.
    pub placements: Vec<Placement>,
    /// In the order of leaves, placement by placement.
    pub triangles: Vec<PlacedTriangle>,
    /// Groups of nodes that a ray may leave waiting in both levels together.
    pub depth: u32,
}

impl TreeLayout {
    /// Lays out `top`, whose leaves are `standing`: each the number of a tree of `trees`, how to come into its frame, and its
    /// triangles in the order of its leaves.
    #[must_use]
    pub fn new(
        top: &CwBvh,
        trees: &[&CwBvh],
        standing: impl IntoIterator<Item = (usize, DAffine3, Vec<PlacedTriangle>)>,
    ) -> Self {
        let mut layout = Self { depth: depth(top), ..Self::default() };
        layout.nodes.extend(words(top));
        let mut first_nodes = Vec::new();
        for tree in trees {
            first_nodes.push(layout.nodes.len() as u32);
            layout.nodes.extend(words(tree));
        }
        layout.depth += trees.iter().map(|tree| depth(tree)).max().unwrap_or(0);
        for (tree, to_tree, triangles) in standing {
            let first_triangle = layout.triangles.len() as u32;
            layout.placements.push(Placement { to_tree, first_node: first_nodes[tree], first_triangle });
            layout.triangles.extend(triangles);
        }
        layout
    }

    /// Lays out one tree that stands in the world as it is.
    #[must_use]
    pub fn of_one(tree: &CwBvh, triangles: Vec<PlacedTriangle>) -> Self {
        if triangles.is_empty() {
            return Self::default();
        }
        let top = over(&[tree.total_aabb]);
        Self::new(&top, &[tree], [(0, DAffine3::IDENTITY, triangles)])
    }
}

/// The tree over some boxes, none of them empty.
pub(crate) fn over(boxes: &[Aabb]) -> CwBvh {
    build_cwbvh(boxes, BvhBuildParams::fast_build(), &mut Duration::default())
}

/// The nodes of `tree`; one without children for a tree without any.
pub fn words(tree: &CwBvh) -> impl Iterator<Item = NodeWords> {
    let nothing = tree.nodes.is_empty().then_some([0; 20]);
    tree.nodes.iter().map(|node| bytemuck::cast(*node)).chain(nothing)
}

/// Levels of `tree`.
#[must_use]
pub fn depth(tree: &CwBvh) -> u32 {
    let (mut deepest, mut open) = (1, vec![(0usize, 1u32)]);
    while let Some((at, level)) = open.pop() {
        let Some(node) = tree.nodes.get(at) else { continue };
        deepest = deepest.max(level);
        let inner =
            (0..node.imask.count_ones()).map(|child| ((node.child_base_idx + child) as usize, level + 1));
        open.extend(inner);
    }
    deepest
}
