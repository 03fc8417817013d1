//! One chunk's shadow casters: triangles with opacity under a compressed wide tree.
//!
//! Built once when a tile is decoded, then only read. Not for pictures: there are no normals,
//! no materials and no closest hit here.

use crate::ray_triangle::RayTriangle;
use crate::tree_layout::{NodeWords, PlacedTriangle, depth, words};
use earthshine_world::{Bounds, OccluderMesh, Vec3};
use glam::UVec2;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::ray::Ray;
use obvhs::triangle::Triangle;
use std::time::Duration;

/// Below this share a ray counts as blocked: what is left is invisible, and more triangles cost time.
pub const TRANSMITTANCE_MIN: f32 = 1e-3;

/// One chunk's shadow casters, ready for rays.
#[derive(Debug)]
pub struct Occluders {
    tree: CwBvh,
    /// In the tree's leaf order, so that a leaf reads neighbours.
    triangles: Vec<RayTriangle>,
    /// What a crossing lets through, beside each triangle.
    transmittances: Vec<f32>,
    bounds: Bounds,
}

impl Occluders {
    /// Builds the tree over `mesh`, which may be empty.
    ///
    /// Triangles that no light can meet cast no shadow: fully transparent ones, and those with a corner
    /// that is missing from the mesh or not finite (tile readers refuse such tiles before this).
    #[must_use]
    pub fn build(mesh: &OccluderMesh) -> Self {
        let mut corners = Vec::with_capacity(mesh.triangles.len());
        let mut opacities = Vec::with_capacity(mesh.triangles.len());
        let mut bounds = Bounds::EMPTY;
        for (indices, surface) in mesh.triangles.iter().zip(&mesh.surfaces) {
            let Some(triangle) = corners_of(mesh, *indices) else { continue };
            if surface[3] == 0 {
                continue;
            }
            triangle.iter().for_each(|&corner| bounds.grow(corner));
            corners.push(triangle);
            opacities.push(f32::from(surface[3]) / 255.0);
        }
        let boxed: Vec<Triangle> = corners.iter().map(|&[v0, v1, v2]| triangle_of(v0, v1, v2)).collect();
        let mut tree = if boxed.is_empty() {
            CwBvh::default()
        } else {
            build_cwbvh_from_tris(&boxed, BvhBuildParams::fast_build(), &mut Duration::default())
        };
        // The builder makes room for the worst tree, some seven times what this one needs.
        tree.nodes.shrink_to_fit();
        tree.primitive_indices.shrink_to_fit();
        let in_leaf_order = tree.primitive_indices.iter().map(|&index| index as usize);
        let triangles = in_leaf_order.clone().map(|index| RayTriangle::new(corners[index])).collect();
        let transmittances = in_leaf_order.map(|index| 1.0 - opacities[index]).collect();
        Self { tree, triangles, transmittances, bounds }
    }

    /// Box around all casters, m; [`Bounds::EMPTY`] without any.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// How many triangles cast shadows.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// How many nodes the tree has for a device: one at least.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.tree.nodes.len().max(1)
    }

    /// Memory held, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(self.tree.nodes.as_slice())
            + size_of_val(self.tree.primitive_indices.as_slice())
            + size_of_val(self.triangles.as_slice())
            + size_of_val(self.transmittances.as_slice())
    }

    /// The tree and its triangles for a device, and how deep it is.
    #[must_use]
    pub fn layout(&self) -> (Vec<NodeWords>, Vec<PlacedTriangle>, u32) {
        let placed = (0..).zip(self.triangles.iter().zip(&self.transmittances));
        let placed = placed
            .map(|(index, (triangle, &transmittance))| PlacedTriangle::new(triangle, index, transmittance));
        (words(&self.tree).collect(), placed.collect(), depth(&self.tree))
    }

    /// Share of light that passes along `ray`, below `remaining` by what this chunk takes away.
    pub(crate) fn attenuate(&self, ray: &Ray, mut remaining: f32) -> f32 {
        if self.triangles.is_empty() {
            return remaining;
        }
        let mut state = self.tree.new_traversal(ray.direction);
        let mut node: &CwBvhNode;
        obvhs::traverse!(self.tree, node, state, node.intersect_ray(ray, state.oct_inv4), {
            let index = state.primitive_id as usize;
            if self.triangles[index].crossing(ray).is_some() {
                remaining *= self.transmittances[index];
                if remaining < TRANSMITTANCE_MIN {
                    return 0.0;
                }
            }
        });
        remaining
    }
}

fn corners_of(mesh: &OccluderMesh, indices: [u32; 3]) -> Option<[Vec3; 3]> {
    let corner = |index: u32| mesh.vertices.get(index as usize).copied().filter(|v| v.is_finite());
    Some([corner(indices[0])?, corner(indices[1])?, corner(indices[2])?])
}

fn triangle_of(v0: Vec3, v1: Vec3, v2: Vec3) -> Triangle {
    Triangle { v0: v0.into(), v1: v1.into(), v2: v2.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn broken_triangles_are_left_out_and_an_empty_mesh_is_allowed() {
        let mesh = OccluderMesh {
            vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::NAN],
            triangles: vec![[0, 1, 2], [0, 1, 9], [0, 1, 3], [2, 1, 0]],
            surfaces: vec![[0, 0, 0, 255], [0, 0, 0, 255], [0, 0, 0, 255], [0, 0, 0, 0]],
        };
        let occluders = Occluders::build(&mesh);
        assert_eq!(occluders.triangle_count(), 1);
        assert_eq!(occluders.bounds(), Bounds { min: Vec3::ZERO, max: Vec3::new(1.0, 1.0, 0.0) });
        assert!(occluders.bytes() > 0);
        let empty = Occluders::build(&OccluderMesh::default());
        assert_eq!((empty.triangle_count(), empty.bytes()), (0, 0));
        let ray = Ray::new_inf(glam::Vec3A::ZERO, glam::Vec3A::X);
        assert_eq!(empty.attenuate(&ray, 1.0), 1.0);
    }

    #[test]
    fn casters_take_no_more_memory_than_they_say() {
        let vertices: Vec<Vec3> =
            (0..1002u16).map(|at| Vec3::splat(f32::from(at)).with_y(f32::from(at % 7))).collect();
        let triangles: Vec<[u32; 3]> = (0..1000).map(|first| [first, first + 1, first + 2]).collect();
        let surfaces = vec![[0, 0, 0, 255]; triangles.len()];
        let occluders = Occluders::build(&OccluderMesh { vertices, triangles, surfaces });
        let held = occluders.tree.nodes.capacity() * size_of::<CwBvhNode>()
            + occluders.tree.primitive_indices.capacity() * size_of::<u32>()
            + occluders.triangles.capacity() * size_of::<RayTriangle>()
            + occluders.transmittances.capacity() * size_of::<f32>();
        assert_eq!((occluders.triangle_count(), held), (1000, occluders.bytes()));
    }
}
