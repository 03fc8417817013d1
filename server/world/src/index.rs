//! What a world holds, before any tile is read: enough to plan streaming.

use crate::{Bounds, ChunkId, Grid, LightRig};

/// One chunk as the manifest lists it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChunkSummary {
    /// Which.
    pub id: ChunkId,
    /// Patches in it.
    pub patch_count: u32,
    /// Form factors in it, receivers' included.
    pub nonzero_count: u64,
    /// Size of its tile on disk.
    pub tile_bytes: u64,
}

/// The manifest's contents as the engine needs them.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldIndex {
    /// Level 0's grid.
    pub grid: Grid,
    /// Detail voxels along a voxel's edge in which receivers on surfaces stand: 1 where there are none, 2, 4 or 8.
    pub detail: u32,
    /// Box around all geometry, m.
    pub bounds: Bounds,
    /// Every chunk that has a tile, ascending by id.
    pub chunks: Vec<ChunkSummary>,
    /// The lights that came with the scene.
    pub lights: LightRig,
}

impl WorldIndex {
    /// Levels from 0 on without a gap: those above a missing one cannot be used, since parents are found level by level.
    #[must_use]
    pub fn level_count(&self) -> u8 {
        let has = |level: &u8| self.chunks.iter().any(|chunk| chunk.id.level == *level);
        (0..=Grid::LEVEL_MAX).take_while(has).count() as u8
    }
}
