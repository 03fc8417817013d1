//! Why a bake stopped.

use earthshine_tiles::{TileError, io_cure};
use std::path::PathBuf;

/// Why a bake stopped. What was finished stays on disk; running the same command again goes on from there.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// A parameter that cannot be.
    #[error("{name} = {value}: {cause}")]
    Parameter {
        /// As in the manifest.
        name: &'static str,
        /// What was given.
        value: String,
        /// What it may be.
        cause: &'static str,
    },
    /// One chunk holds more patches than a tile can number.
    #[error(
        "chunk {chunk:?} holds {patches} patches, more than {max}: bake with fewer voxels a chunk (--chunk-voxels)"
    )]
    TooManyPatches {
        /// Chunk coordinates.
        chunk: [i32; 3],
        /// How many.
        patches: usize,
        /// How many are possible.
        max: usize,
    },
    /// The voxels are so small that the samples would not fit in memory.
    #[error(
        "a voxel edge of {voxel_edge_m} m makes about {samples} samples: more than memory or time suffices for; try --voxel {suggested_m:.3}"
    )]
    TooFine {
        /// m.
        voxel_edge_m: f32,
        /// How many points would cover the surfaces.
        samples: u64,
        /// m.
        suggested_m: f32,
    },
    /// A sum over points would take hours.
    #[error(
        "--estimator points takes {pairs} pairs of points for {patches} patches, and is for {max} at most: use fewer points (--points-per-patch), larger voxels (--voxel), or --estimator rays"
    )]
    TooManyPairs {
        /// How many patches there are.
        patches: usize,
        /// How many pairs their points make.
        pairs: u64,
        /// How many are possible.
        max: u64,
    },
    /// Nothing that light could leave or reach.
    #[error(
        "no patches: every surface is buried, a hole or without area; check the scene's scale against the voxel edge of {voxel_edge_m} m"
    )]
    NoPatches {
        /// m.
        voxel_edge_m: f32,
    },
    /// The world holds another scene or other parameters.
    #[error(
        "{path:?} holds another bake (of scene {scene:?}, other contents or parameters); bake into an empty folder, or pass --overwrite"
    )]
    OtherWorld {
        /// The folder.
        path: PathBuf,
        /// What is in it.
        scene: String,
    },
    /// More memory than was allowed.
    #[error(
        "{what} take about {needed_mib} MiB, and --memory allows {limit_mib} MiB: allow more, use larger voxels (--voxel {suggested_m}), or cut the scene into worlds"
    )]
    Memory {
        /// What takes it.
        what: &'static str,
        /// MiB.
        needed_mib: u64,
        /// MiB.
        limit_mib: u64,
        /// A voxel edge that might do, m.
        suggested_m: f32,
    },
    /// The work folder is not as the bake left it.
    #[error(
        "the work folder changed under the bake (chunk {chunk:?}): let processes of the same program bake the same scene into it, and run the command again"
    )]
    WorkChanged {
        /// Chunk coordinates.
        chunk: [i32; 3],
    },
    /// A folder could not be made, read or cleared.
    #[error("{path:?}: {source}{}", io_cure(source))]
    Io {
        /// What was touched.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A tile or the manifest could not be written or read.
    #[error(transparent)]
    Tile(#[from] TileError),
}

impl BakeError {
    /// An [`Self::Io`] about `path`.
    pub(crate) fn io(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { path, source }
    }
}
