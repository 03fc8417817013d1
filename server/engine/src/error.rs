//! Why an engine cannot start, and why a tile is refused. A running engine has no errors: it counts.

use crate::config::ConfigError;
use earthshine_world::ChunkId;

/// Why [`Engine::new`](crate::Engine::new) refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EngineError {
    /// A setting is out of its range; change it in the configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The world's grid has no cells; bake the world again.
    #[error(
        "the world's grid is impossible: voxel edge {voxel_edge_m} m, chunk edge {chunk_edge_voxels} voxels"
    )]
    Grid {
        /// Edge of a voxel, m.
        voxel_edge_m: f32,
        /// Voxels along a chunk's edge.
        chunk_edge_voxels: u32,
    },
    /// The index lists a chunk twice; bake the world again.
    #[error("the world's index lists chunk {0} more than once")]
    DuplicateChunk(ChunkId),
}

/// What is wrong with a decoded chunk. The reader checks bytes; this is what the engine relies on.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub(crate) enum TileFault {
    #[error("its tables differ in length")]
    Lengths,
    #[error("patch {0} has no place in it: voxel, area, reflectance, emission or sample points")]
    Patch(usize),
    #[error("two patches share a voxel and a direction")]
    Duplicate,
    #[error("the row entries are not shares of known segments in ascending order")]
    Rows,
    #[error("row {row} sums to {sum}, not to one: patches, sky and absorbed; bake the chunk again")]
    RowSum { row: usize, sum: f32 },
    #[error("its receivers are out of order or place, stand where a patch is, or have no proper rows")]
    Receivers,
}
