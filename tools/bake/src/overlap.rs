//! Which triangles touch which cubes of a grid, by box and plane: never too few, seldom too many.

use crate::sample::OFF_SURFACE;
use earthshine_scene::Scene;
use earthshine_world::{Grid, Vec3};
use glam::IVec3;
use std::collections::BTreeMap;

/// Calls `touched` for every cube of edge `edge_m` that the triangle comes nearer to than `margin_m`.
pub(crate) fn touched_cubes(
    [a, b, c]: [Vec3; 3],
    edge_m: f32,
    margin_m: f32,
    mut touched: impl FnMut(IVec3),
) {
    let (low, high) = (a.min(b).min(c) - margin_m, a.max(b).max(c) + margin_m);
    let first = (low / edge_m).floor().as_ivec3();
    let last = (high / edge_m).floor().as_ivec3();
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let is_small = (last - first).cmple(IVec3::ONE).all();
    let half = 0.5 * edge_m;
    let reach = half * normal.abs().element_sum() + margin_m;
    for x in first.x..=last.x {
        for y in first.y..=last.y {
            for z in first.z..=last.z {
                let cube = IVec3::new(x, y, z);
                let centre = (cube.as_vec3() + 0.5) * edge_m;
                if is_small || normal.dot(centre - a).abs() <= reach {
                    touched(cube);
                }
            }
        }
    }
}

/// The triangles of each chunk: those that are in it, and those of a side that belongs to it.
#[derive(Debug, Default)]
pub struct ChunkTriangles {
    by_chunk: BTreeMap<[i32; 3], Vec<u32>>,
}

impl ChunkTriangles {
    /// Sorts the triangles of `scene` into chunks. 4 bytes a triangle and chunk.
    #[must_use]
    pub fn new(scene: &Scene, grid: Grid) -> Self {
        let mut by_chunk: BTreeMap<[i32; 3], Vec<u32>> = BTreeMap::new();
        let margin_m = 2.0 * OFF_SURFACE * grid.voxel_edge_m;
        for (index, &corners) in scene.triangles.iter().enumerate() {
            touched_cubes(corners, grid.chunk_edge_m(), margin_m, |chunk| {
                by_chunk.entry(chunk.to_array()).or_default().push(index as u32);
            });
        }
        Self { by_chunk }
    }

    /// Every chunk that may have a surface, ascending.
    #[must_use]
    pub fn coords(&self) -> Vec<[i32; 3]> {
        self.by_chunk.keys().copied().collect()
    }

    /// The triangles of `chunk`, ascending.
    #[must_use]
    pub fn of(&self, chunk: [i32; 3]) -> &[u32] {
        self.by_chunk.get(&chunk).map_or(&[], Vec::as_slice)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::clip_to_grid;
    use std::collections::BTreeSet;

    #[test]
    fn every_cube_with_a_piece_is_touched_and_few_others() {
        let triangle = [Vec3::new(-3.3, 0.2, 0.7), Vec3::new(5.9, 3.1, -4.4), Vec3::new(0.3, 3.7, 6.2)];
        let (mut cut, mut touched) = (BTreeSet::new(), BTreeSet::new());
        clip_to_grid(triangle, 0.5, |cell, _| {
            cut.insert(cell.to_array());
        });
        touched_cubes(triangle, 0.5, 0.001, |cell| {
            touched.insert(cell.to_array());
        });
        assert!(cut.is_subset(&touched));
        let all = 19 * 8 * 22;
        assert!(touched.len() < all / 4, "{} of {all} for {}", touched.len(), cut.len());
    }
}
