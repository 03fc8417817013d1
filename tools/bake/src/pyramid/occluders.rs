//! Shadow casters of coarse chunks: the children's triangles with their corners on a lattice.
//!
//! Corners are moved to the nearest point of a lattice of [`OccluderMesh::COARSE_CELL_VOXELS`]; triangles that become a line or a point
//! are dropped, and so are doubles (vertex clustering after Rossignac and Borrel, 1993). Chunk faces
//! lie on lattice planes, so neighbours stay tight. What is smaller than a cell casts no shadow afar: leaves, legs
//! of chairs; walls and roofs stay. A surface may move by half a cell's diagonal: shadow rays of coarse patches have
//! to start that far off.

use earthshine_world::{Grid, OccluderMesh, Vec3};
use glam::{I64Vec3, IVec3};
use std::collections::{BTreeMap, HashMap};

/// The casters of `meshes` together, for a level with `grid`.
pub(super) fn merged<'a>(meshes: impl Iterator<Item = &'a OccluderMesh>, grid: Grid) -> OccluderMesh {
    let cell_m = grid.voxel_edge_m * OccluderMesh::COARSE_CELL_VOXELS;
    let mut found: BTreeMap<[[i32; 3]; 3], [u8; 4]> = BTreeMap::new();
    for mesh in meshes {
        let snapped: Vec<IVec3> =
            mesh.vertices.iter().map(|&corner| (corner / cell_m).round().as_ivec3()).collect();
        for (triangle, &surface) in mesh.triangles.iter().zip(&mesh.surfaces) {
            let corners = triangle.map(|vertex| snapped[vertex as usize]);
            if is_flat(corners) {
                continue;
            }
            // Shadows have no front: the order of corners does not matter.
            let mut key = corners.map(|corner| corner.to_array());
            key.sort_unstable();
            let kept = found.entry(key).or_insert(surface);
            if surface[3] > kept[3] {
                *kept = surface;
            }
        }
    }
    let mut mesh = OccluderMesh::default();
    let mut numbers: HashMap<[i32; 3], u32> = HashMap::new();
    for (corners, surface) in found {
        mesh.triangles.push(corners.map(|corner| {
            *numbers.entry(corner).or_insert_with(|| {
                mesh.vertices.push(IVec3::from_array(corner).as_vec3() * Vec3::splat(cell_m));
                mesh.vertices.len() as u32 - 1
            })
        }));
        mesh.surfaces.push(surface);
    }
    mesh
}

/// Whether three lattice points span no area.
fn is_flat([a, b, c]: [IVec3; 3]) -> bool {
    let wide = |v: IVec3| I64Vec3::new(v.x.into(), v.y.into(), v.z.into());
    (wide(b) - wide(a)).cross(wide(c) - wide(a)) == I64Vec3::ZERO
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid { voxel_edge_m: 8.0, chunk_edge_voxels: 4 };

    fn mesh(corners: &[[f32; 3]], opacity: u8) -> OccluderMesh {
        let count = corners.len() as u32 / 3;
        OccluderMesh {
            vertices: corners.iter().map(|&c| Vec3::from_array(c)).collect(),
            triangles: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
            surfaces: vec![[1, 2, 3, opacity]; count as usize],
        }
    }

    #[test]
    fn walls_stay_and_trifles_go() {
        let wall = [[0.1, 0.2, -0.3], [8.3, 0.0, 0.0], [8.0, 8.0, 0.2]];
        let leaf = [[3.1, 3.0, 3.0], [3.3, 3.0, 3.0], [3.2, 3.2, 3.0]];
        let fine = mesh(&[wall, leaf].concat(), 255);
        let coarse = merged([&fine].into_iter(), GRID);
        assert_eq!(coarse.triangles.len(), 1);
        assert_eq!(coarse.vertices, [Vec3::ZERO, Vec3::new(8.0, 0.0, 0.0), Vec3::new(8.0, 8.0, 0.0)]);
    }

    #[test]
    fn doubles_count_once_and_the_densest_wins() {
        let corners = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        let back = [corners[2], corners[1], corners[0]];
        let coarse = merged([&mesh(&corners, 40), &mesh(&back, 200)].into_iter(), GRID);
        assert_eq!((coarse.triangles.len(), coarse.surfaces[0][3]), (1, 200));
    }
}
