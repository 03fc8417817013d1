//! The shadow casters of all resident chunks under one top-level tree.
//!
//! The set changes when chunks come and go, many times between questions or never; the top level is
//! therefore built by the first question after a change. Chunks are visited in id order when it is
//! built, so the same set answers with the same bits whatever order it was filled in.

use crate::occluders::{Occluders, TRANSMITTANCE_MIN};
use crate::ray_triangle::ray;
use crate::tree_layout::{NodeWords, depth, over, words};
use earthshine_world::{ChunkId, Vec3};
use glam::UVec2;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::ray::Ray;
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

/// Resident chunks' shadow casters.
#[derive(Debug, Default)]
pub struct OccluderSet {
    chunks: BTreeMap<ChunkId, Arc<Occluders>>,
    top: OnceLock<TopLevel>,
    changes: u64,
}

#[derive(Debug)]
struct TopLevel {
    tree: CwBvh,
    /// In the tree's leaf order.
    chunks: Vec<Arc<Occluders>>,
}

impl OccluderSet {
    /// Without any chunk: everything is lit.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds `occluders` as those of `chunk`, instead of any it had.
    pub fn insert(&mut self, chunk: ChunkId, occluders: Arc<Occluders>) {
        self.chunks.insert(chunk, occluders);
        self.top = OnceLock::new();
        self.changes += 1;
    }

    /// Takes `chunk`'s away; without effect if it has none.
    pub fn remove(&mut self, chunk: ChunkId) {
        if self.chunks.remove(&chunk).is_some() {
            self.top = OnceLock::new();
            self.changes += 1;
        }
    }

    /// Counts how often chunks came and went.
    #[must_use]
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// The chunks that cast shadows, in the order of the top tree's leaves, with the nodes of that tree and its depth.
    #[must_use]
    pub fn top_level(&self) -> (Vec<NodeWords>, u32, &[Arc<Occluders>]) {
        let top = self.top();
        (words(&top.tree).collect(), depth(&top.tree), &top.chunks)
    }

    fn top(&self) -> &TopLevel {
        self.top.get_or_init(|| TopLevel::build(&self.chunks))
    }

    /// How many chunks there are, those without casters too.
    #[must_use]
    pub fn len(&self) -> usize {
        self.chunks.len()
    }

    /// Whether there is no chunk.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.chunks.is_empty()
    }

    /// Share of light that passes from `from` along unit `direction` for `distance_m` (may be infinite):
    /// the product over crossed triangles of what each lets through. 0 is fully shadowed.
    ///
    /// A triangle at zero distance does not count, but one that rounding puts a hair ahead does: move
    /// `from` off its own surface first.
    #[must_use]
    pub fn transmittance(&self, from: Vec3, direction: Vec3, distance_m: f32) -> f32 {
        let top = self.top();
        if top.chunks.is_empty() {
            return 1.0;
        }
        top.transmittance(&ray(from, direction, 0.0, distance_m))
    }
}

impl TopLevel {
    fn build(chunks: &BTreeMap<ChunkId, Arc<Occluders>>) -> Self {
        let casting: Vec<&Arc<Occluders>> =
            chunks.values().filter(|occluders| occluders.triangle_count() > 0).collect();
        if casting.is_empty() {
            return Self { tree: CwBvh::default(), chunks: Vec::new() };
        }
        let boxes: Vec<Aabb> = casting
            .iter()
            .map(|occluders| occluders.bounds())
            .map(|bounds| Aabb::new(bounds.min.into(), bounds.max.into()))
            .collect();
        let tree = over(&boxes);
        let chunks =
            tree.primitive_indices.iter().map(|&index| Arc::clone(casting[index as usize])).collect();
        Self { tree, chunks }
    }

    fn transmittance(&self, ray: &Ray) -> f32 {
        let mut remaining = 1.0;
        let mut state = self.tree.new_traversal(ray.direction);
        let mut node: &CwBvhNode;
        obvhs::traverse!(self.tree, node, state, node.intersect_ray(ray, state.oct_inv4), {
            remaining = self.chunks[state.primitive_id as usize].attenuate(ray, remaining);
            if remaining < TRANSMITTANCE_MIN {
                return 0.0;
            }
        });
        remaining
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::random::{Purpose, hash, unit_f32, unit_pair};
    use earthshine_world::{ChunkCoord, OccluderMesh};

    fn id(x: i32) -> ChunkId {
        ChunkId::new(0, ChunkCoord::new(x, 0, 0))
    }

    /// A square plate of half edge 1 at height `y`, above `x`.
    fn plate(x: f32, y: f32, opacity: u8) -> Arc<Occluders> {
        let corner = |dx: f32, dz: f32| Vec3::new(x + dx, y, dz);
        Arc::new(Occluders::build(&OccluderMesh {
            vertices: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
            triangles: vec![[0, 2, 1], [0, 3, 2]],
            surfaces: vec![[128, 128, 128, opacity]; 2],
        }))
    }

    #[test]
    fn plates_multiply_until_none_is_left() {
        let mut set = OccluderSet::new();
        let up = |set: &OccluderSet, distance| set.transmittance(Vec3::new(0.3, 0.0, 0.2), Vec3::Y, distance);
        assert_eq!(up(&set, f32::INFINITY), 1.0);
        set.insert(id(0), plate(0.0, 1.0, 102));
        assert!((up(&set, f32::INFINITY) - 0.6).abs() < 1e-6);
        set.insert(id(1), plate(0.0, 2.0, 51));
        assert!((up(&set, f32::INFINITY) - 0.48).abs() < 1e-6);
        assert!((up(&set, 1.5) - 0.6).abs() < 1e-6, "the second plate is beyond the lamp");
        assert_eq!(up(&set, 0.5), 1.0);
        set.insert(id(2), plate(0.0, 3.0, 255));
        assert_eq!(up(&set, f32::INFINITY), 0.0);
        let minus_zeros = -Vec3::NEG_Y;
        assert_eq!(set.transmittance(Vec3::new(0.3, 0.0, 0.2), minus_zeros, f32::INFINITY), 0.0);
        set.remove(id(2));
        set.remove(id(9));
        assert_eq!(set.len(), 2);
        assert!((up(&set, f32::INFINITY) - 0.48).abs() < 1e-6);
    }

    #[test]
    fn a_set_of_empty_chunks_is_lit() {
        let mut set = OccluderSet::new();
        set.insert(id(0), Arc::new(Occluders::build(&OccluderMesh::default())));
        assert!(!set.is_empty());
        assert_eq!(set.transmittance(Vec3::ZERO, Vec3::X, f32::INFINITY), 1.0);
    }

    #[test]
    fn trees_agree_with_every_triangle_asked_in_turn() {
        let number = |a: u64, b: u64| unit_f32(hash(5, Purpose::WorldShape, a, b)) * 8.0;
        let mut set = OccluderSet::new();
        let mut meshes = Vec::new();
        for chunk in 0..12u64 {
            let corner = |k: u64| {
                let base =
                    Vec3::new(number(chunk, k / 3 * 6), number(chunk, k / 3 * 6 + 1), number(k / 3, chunk));
                base + Vec3::new(number(k, 50), number(k, 51), number(k, 52)) * 0.2
            };
            let mesh = OccluderMesh {
                vertices: (0..120).map(corner).collect(),
                triangles: (0..40).map(|t| [t * 3, t * 3 + 1, t * 3 + 2]).collect(),
                surfaces: vec![[0, 0, 0, 64]; 40],
            };
            set.insert(id(chunk as i32), Arc::new(Occluders::build(&mesh)));
            meshes.push(mesh);
        }
        let mut crossed = 0;
        for ray_index in 0..2000 {
            let from = Vec3::new(number(ray_index, 90), number(ray_index, 91), number(ray_index, 92));
            let (a, b) = unit_pair(hash(6, Purpose::SunDisc, ray_index, 0));
            let z = 2.0 * b - 1.0;
            let (sin, cos) = (a * std::f32::consts::TAU).sin_cos();
            let towards = Vec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z);
            let ray = Ray::new(from.into(), towards.into(), 0.0, 5.0);
            let mut expected = 1.0f32;
            for mesh in &meshes {
                for t in &mesh.triangles {
                    let corners = t.map(|i| mesh.vertices[i as usize]);
                    if crate::ray_triangle::RayTriangle::new(corners).crossing(&ray).is_some() {
                        expected *= 1.0 - 64.0 / 255.0;
                    }
                }
            }
            crossed += u32::from(expected < 1.0);
            let expected = if expected < TRANSMITTANCE_MIN { 0.0 } else { expected };
            let found = set.transmittance(from, towards, 5.0);
            assert!((found - expected).abs() < 1e-5, "ray {ray_index}: {found} for {expected}");
        }
        assert!(crossed > 300, "only {crossed} rays met anything");
    }
}
