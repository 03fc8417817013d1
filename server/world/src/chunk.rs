//! One chunk of the world, whole: what a decoded tile holds.

use crate::{ChunkId, ChunkRows, Patch, Receivers, SamplePoint};
use glam::Vec3;

/// Triangles that cast shadows, and what a viewer shows before any light arrives.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OccluderMesh {
    /// Corners, m.
    pub vertices: Vec<Vec3>,
    /// Three vertex indices a triangle. A triangle is stored in the chunk that holds its centre.
    pub triangles: Vec<[u32; 3]>,
    /// Reflectance (r, g, b) and opacity of each triangle, 0..=255 for 0..=1: an alpha mask is its mean.
    pub surfaces: Vec<[u8; 4]>,
}

impl OccluderMesh {
    /// Casters of coarse levels have their corners on a lattice with this edge, in voxels of their level.
    pub const COARSE_CELL_VOXELS: f32 = 0.125;

    /// How far a surface may lie from its caster, in voxels: nothing on level 0, half a diagonal of a lattice cell above.
    #[must_use]
    pub fn displacement_voxels(level: u8) -> f32 {
        if level == 0 { 0.0 } else { 0.5 * 3f32.sqrt() * Self::COARSE_CELL_VOXELS }
    }
}

/// Patches, rows and occluders of one chunk.
#[derive(Debug, Clone, PartialEq)]
pub struct Chunk {
    /// Which.
    pub id: ChunkId,
    /// At most 65,536, ordered by direction, then by the Morton code of the voxel.
    pub patches: Vec<Patch>,
    /// Sample points of all patches; each patch owns a run.
    pub points: Vec<SamplePoint>,
    /// One row a patch.
    pub rows: ChunkRows,
    /// Rows in the chunk's empty air.
    pub receivers: Receivers,
    /// Shadow casters.
    pub occluders: OccluderMesh,
}

impl Chunk {
    /// Most patches a chunk may hold: locals are `u16`.
    pub const PATCHES_MAX: usize = 1 << 16;

    /// The sample points of `patch`.
    ///
    /// # Panics
    /// If the patch is not of this chunk.
    #[must_use]
    pub fn points_of(&self, patch: &Patch) -> &[SamplePoint] {
        let first = patch.point_first as usize;
        &self.points[first..first + patch.point_count as usize]
    }

    /// Whether the light on patch `local` is what is told of its voxel and direction. What emits there beside what does not
    /// is a patch of its own and comes second: it sends light, and what arrives at it nobody reads. Of other patches that share
    /// a place, as clusters may, each is told.
    ///
    /// # Panics
    /// If there is no such patch.
    #[must_use]
    pub fn is_told(&self, local: usize) -> bool {
        local.checked_sub(1).is_none_or(|before| {
            let [before, own] = [before, local].map(|local| &self.patches[local]);
            let is_same_place = (before.voxel, before.direction) == (own.voxel, own.direction);
            !(is_same_place && own.emits() && !before.emits())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ChunkCoord, Direction, Rgb, VoxelCoord};

    #[test]
    fn what_emits_beside_what_does_not_is_not_told_and_all_else_is() {
        let patch = |x: i32, emission: f32| Patch {
            voxel: VoxelCoord::new(x, 0, 0),
            direction: Direction::PosX,
            area: 1.0,
            centroid: Vec3::ZERO,
            reflectance: Rgb::ZERO,
            emission: Rgb::splat(emission),
            point_first: 0,
            point_count: 1,
        };
        let told = |second: Patch, emission: f32| {
            let chunk = Chunk {
                id: ChunkId::new(0, ChunkCoord::ZERO),
                patches: vec![patch(0, emission), second],
                points: Vec::new(),
                rows: ChunkRows::default(),
                receivers: Receivers::default(),
                occluders: OccluderMesh::default(),
            };
            [chunk.is_told(0), chunk.is_told(1)]
        };
        assert_eq!(told(patch(0, 1.0), 0.0), [true, false]);
        assert_eq!(told(patch(1, 1.0), 0.0), [true; 2], "of another place");
        assert_eq!(told(patch(0, 0.0), 0.0), [true; 2], "clusters");
        assert_eq!(told(patch(0, 0.0), 1.0), [true; 2]);
        assert_eq!(told(patch(0, 1.0), 1.0), [true; 2]);
    }
}
