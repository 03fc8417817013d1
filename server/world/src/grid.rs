//! Voxels, chunks and where a point lies.
//!
//! Level 0 has the bake's voxel edge; each level doubles it. A chunk is a cube of
//! `chunk_edge_voxels`^3 voxels at every level.

use glam::{IVec3, Vec3};

/// Integer coordinates of a voxel: it spans `[c, c + 1) * voxel_edge_m` on each axis.
pub type VoxelCoord = IVec3;
/// Integer coordinates of a chunk: it spans `[c, c + 1) * chunk_edge_m`.
pub type ChunkCoord = IVec3;

/// A chunk of one level of the pyramid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ChunkId {
    /// 0 is the finest.
    pub level: u8,
    /// Where, in chunk edges of that level.
    pub coord: ChunkCoord,
}

impl ChunkId {
    /// The chunk at `coord` of `level`.
    #[must_use]
    pub fn new(level: u8, coord: ChunkCoord) -> Self {
        Self { level, coord }
    }

    /// The chunk of the next coarser level that covers this one and seven others.
    #[must_use]
    pub fn parent(self) -> Self {
        Self { level: self.level + 1, coord: self.coord.div_euclid(IVec3::splat(2)) }
    }
}

impl PartialOrd for ChunkId {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// Level first, then x, y, z: the order of manifests and of everything that must be deterministic.
impl Ord for ChunkId {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.level, self.coord.to_array()).cmp(&(other.level, other.coord.to_array()))
    }
}

impl std::fmt::Display for ChunkId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "L{}({},{},{})", self.level, self.coord.x, self.coord.y, self.coord.z)
    }
}

/// Edge lengths of one level.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Grid {
    /// Edge of a voxel, m. Positive and finite.
    pub voxel_edge_m: f32,
    /// Voxels along a chunk's edge, 1 to [`Self::CHUNK_EDGE_VOXELS_MAX`].
    pub chunk_edge_voxels: u32,
}

impl Grid {
    /// Largest chunk edge: 22^3 voxels x 6 directions still number in a `u16`.
    pub const CHUNK_EDGE_VOXELS_MAX: u32 = 22;

    /// Most steps of coarsening.
    pub const LEVEL_MAX: u8 = 15;

    /// Edge of a chunk, m.
    #[must_use]
    pub fn chunk_edge_m(&self) -> f32 {
        self.voxel_edge_m * self.chunk_edge_voxels as f32
    }

    /// The same world `level` steps coarser.
    #[must_use]
    pub fn at_level(&self, level: u8) -> Self {
        Self { voxel_edge_m: self.voxel_edge_m * f32::from(1u16 << level.min(Self::LEVEL_MAX)), ..*self }
    }

    /// The voxel that holds `position`.
    #[must_use]
    pub fn voxel_at(&self, position: Vec3) -> VoxelCoord {
        (position / self.voxel_edge_m).floor().as_ivec3()
    }

    /// The chunk that holds `voxel`.
    #[must_use]
    pub fn chunk_of(&self, voxel: VoxelCoord) -> ChunkCoord {
        voxel.div_euclid(IVec3::splat(self.chunk_edge_voxels.cast_signed()))
    }

    /// The voxel of the next coarser level that covers `voxel` and seven others.
    #[must_use]
    pub fn parent_voxel(voxel: VoxelCoord) -> VoxelCoord {
        voxel.div_euclid(IVec3::splat(2))
    }

    /// Centre of `voxel`, m.
    #[must_use]
    pub fn voxel_centre(&self, voxel: VoxelCoord) -> Vec3 {
        (voxel.as_vec3() + 0.5) * self.voxel_edge_m
    }

    /// The cube of `chunk`.
    #[must_use]
    pub fn chunk_bounds(&self, chunk: ChunkCoord) -> Bounds {
        let min = chunk.as_vec3() * self.chunk_edge_m();
        Bounds { min, max: min + self.chunk_edge_m() }
    }
}

/// An axis-aligned box, m.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Bounds {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Bounds {
    /// Contains nothing; growing it by a point gives that point.
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// Grows to hold `point`.
    pub fn grow(&mut self, point: Vec3) {
        self.min = self.min.min(point);
        self.max = self.max.max(point);
    }

    /// Distance from `point` to the box, m; zero inside.
    #[must_use]
    pub fn distance(&self, point: Vec3) -> f32 {
        (self.min - point).max(point - self.max).max(Vec3::ZERO).length()
    }

    /// Edge lengths, m.
    #[must_use]
    pub fn size(&self) -> Vec3 {
        self.max - self.min
    }

    /// The middle, m.
    #[must_use]
    pub fn centre(&self) -> Vec3 {
        (self.min + self.max) * 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn negative_voxels_belong_to_negative_chunks() {
        let grid = Grid { voxel_edge_m: 0.5, chunk_edge_voxels: 16 };
        assert_eq!(grid.voxel_at(Vec3::new(-0.1, 0.0, 0.6)), IVec3::new(-1, 0, 1));
        assert_eq!(grid.chunk_of(IVec3::new(-1, 0, 16)), IVec3::new(-1, 0, 1));
        assert_eq!(grid.chunk_bounds(IVec3::new(-1, 0, 0)).max.x, 0.0);
    }

    #[test]
    fn parents_cover_their_children() {
        let fine = Grid { voxel_edge_m: 0.5, chunk_edge_voxels: 3 };
        let coarse = fine.at_level(1);
        for x in -20..20 {
            let voxel = IVec3::new(x, -x, 2 * x + 1);
            let parent = Grid::parent_voxel(voxel);
            assert_eq!(parent, coarse.voxel_at(fine.voxel_centre(voxel)));
            let chunk = ChunkId::new(0, fine.chunk_of(voxel));
            assert_eq!(chunk.parent(), ChunkId::new(1, coarse.chunk_of(parent)));
        }
    }

    #[test]
    fn distance_to_a_box_is_zero_inside() {
        let bounds = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
        assert_eq!(bounds.distance(Vec3::splat(0.5)), 0.0);
        assert_eq!(bounds.distance(Vec3::new(2.0, 0.5, 0.5)), 1.0);
    }
}
