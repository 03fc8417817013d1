//! Receivers: light where there is no surface, for objects that move.
//!
//! A receiver is a row without a column: it says where the light comes from that would arrive at a plane facing one
//! direction in the open part of a voxel. It receives and never sends, so it has no area, no reflectance and no slot.

use crate::{ChunkRows, Direction, VoxelCoord};

/// Where one receiver is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ReceiverPlace {
    /// The voxel, which has no patch on `direction`.
    pub voxel: VoxelCoord,
    /// Where the receiving plane faces.
    pub direction: Direction,
}

impl ReceiverPlace {
    /// What places ascend by: voxel (x, y, z), then direction.
    #[must_use]
    pub fn order(&self) -> ([i32; 3], Direction) {
        (self.voxel.to_array(), self.direction)
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

impl Default for Receivers {
    fn default() -> Self {
        Self { places: Vec::new(), rows: ChunkRows { row_starts: vec![0], ..ChunkRows::default() } }
    }
}
