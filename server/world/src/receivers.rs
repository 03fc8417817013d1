//! Receivers: rows without a column, in the air and on surfaces.
//!
//! A receiver says where the light comes from that arrives at a plane facing one direction. It receives and never sends,
//! so it has no area, no reflectance and no slot. *In the air* it stands in the open part of a voxel, for objects that
//! move. *On surfaces* it stands for what faces its direction in one *detail voxel*, a part of a voxel of half or a quarter of its edge: the
//! light there in more detail than the voxel's patch has. Surfaces that share a detail voxel and a direction, but no plane
//! (moulding and the wall behind it) or no side of a wall (a floor that goes on behind it), are *layers*: each has a
//! receiver of its own.

use crate::{Barrier, ChunkRows, Direction, SurfacePlane, VoxelCoord};
use glam::IVec3;

/// A part of a voxel, and one of the surfaces in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct DetailVoxel {
    /// Counted in detail voxels from the low corner of the voxel: bits 0 and 1 of x, y and z in turn, then bit 2 of each.
    pub index: u16,
    /// Which of the layers that share the detail voxel and the direction, below [`Self::LAYERS_MAX`]. None is left out.
    pub layer: u8,
    /// The plane it lies in, in the detail voxel.
    pub plane: SurfacePlane,
    /// Where walls end it; what is one comes before what is none.
    pub barriers: [Option<Barrier>; Barrier::PER_LAYER_MAX],
}

impl DetailVoxel {
    /// Most detail voxels along a voxel's edge.
    pub const PER_EDGE_MAX: u32 = 8;
    /// Most layers of one direction in a detail voxel.
    pub const LAYERS_MAX: u8 = 4;

    /// Layer `layer` in the detail voxel at `offset` (detail voxels from the low corner of the voxel, each below 8), without
    /// barriers.
    #[must_use]
    pub fn new(offset: IVec3, layer: u8, plane: SurfacePlane) -> Self {
        let bits = |along: i32, axis: i32| (along & 3) << (2 * axis) | (along >> 2 & 1) << (6 + axis);
        let index = (bits(offset.x, 0) | bits(offset.y, 1) | bits(offset.z, 2)) as u16;
        Self { index, layer, plane, barriers: [None; Barrier::PER_LAYER_MAX] }
    }

    /// The detail voxel in a grid of detail voxels, `detail` along an edge of `voxel`.
    #[must_use]
    pub fn coord(self, voxel: VoxelCoord, detail: u32) -> VoxelCoord {
        let index = i32::from(self.index);
        let along = |axis: i32| index >> (2 * axis) & 3 | (index >> (6 + axis) & 1) << 2;
        voxel * detail.cast_signed() + IVec3::new(along(0), along(1), along(2))
    }
}

/// Where one receiver is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ReceiverPlace {
    /// The voxel. In the air it has no patch on `direction`, on surfaces it has one.
    pub voxel: VoxelCoord,
    /// Where the receiving plane faces.
    pub direction: Direction,
    /// Of which detail voxel's surfaces; `None` in the air.
    pub detail: Option<DetailVoxel>,
}

impl ReceiverPlace {
    /// In the air of `voxel`.
    #[must_use]
    pub fn in_air(voxel: VoxelCoord, direction: Direction) -> Self {
        Self { voxel, direction, detail: None }
    }

    /// What places ascend by: voxel (x, y, z), then direction, then detail voxel, then layer.
    #[must_use]
    pub fn order(&self) -> ([i32; 3], Direction, (u16, u8)) {
        let part = self.detail.map_or((0, 0), |detail| (detail.index, detail.layer));
        (self.voxel.to_array(), self.direction, part)
    }
}

/// All receivers of one chunk.
#[derive(Debug, Clone, PartialEq)]
pub struct Receivers {
    /// Ascending by [`ReceiverPlace::order`]; none twice.
    pub places: Vec<ReceiverPlace>,
    /// One row a place. Columns are patches, of any chunk; the segment table is the receivers' own.
    pub rows: ChunkRows,
}

impl Receivers {
    /// Most receivers a chunk may hold.
    pub const COUNT_MAX: usize = 1 << 18;
}

impl Default for Receivers {
    fn default() -> Self {
        Self { places: Vec::new(), rows: ChunkRows { row_starts: vec![0], ..ChunkRows::default() } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detail_voxels_have_coordinates_of_their_own() {
        for (detail, last) in [(2, 1), (4, 3), (8, 7), (8, 5)] {
            let part = DetailVoxel::new(IVec3::new(last, 0, 1), 3, SurfacePlane::new(glam::Vec3::Y, 0.0));
            let voxel = VoxelCoord::new(-3, 0, 7);
            let coord = part.coord(voxel, detail);
            assert_eq!(coord, voxel * detail as i32 + IVec3::new(last, 0, 1));
            assert_eq!(coord.div_euclid(IVec3::splat(detail as i32)), voxel);
        }
    }
}
