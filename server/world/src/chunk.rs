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
    /// is a patch of its own and comes second: it sends light, and what arrives at it nobody reads.
    ///
    /// # Panics
    /// If there is no such patch.
    #[must_use]
    pub fn is_told(&self, local: usize) -> bool {
        let place = |local: usize| (self.patches[local].voxel, self.patches[local].direction);
        local.checked_sub(1).is_none_or(|before| place(before) != place(local))
    }
}
