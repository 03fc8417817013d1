//! The vocabulary every other package speaks: directions, voxels, chunks, patches, rows, lights, cameras.
//!
//! Right-handed, +Y up, metres; light is linear RGB in photometric units (GLOSSARY.md). There are no
//! algorithms here beyond what a definition needs, no I/O, no clock and no threads.
//!
//! Start at [`Chunk`]: what one cube of the world holds once its tile is decoded.
//!
//! | module | words |
//! |---|---|
//! | [`asked`] | how something stands that somebody else was asked for |
//! | [`direction`] | the six directions of a voxel and how a normal spreads over them |
//! | [`grid`] | voxels, chunks and where a point lies |
//! | [`patch`] | patches, their identity and their sample points |
//! | [`rows`] | form-factor rows: resident or far columns, sky, absorbed |
//! | [`receivers`] | rows without columns: light in empty air, and on surfaces in detail |
//! | [`surface_plane`] | the plane of what lies in a detail voxel |
//! | [`barrier`] | where a wall ends it |
//! | [`chunk`] | one chunk, whole |
//! | [`index`] | what a world holds, before any tile is read |
//! | [`lineage`] | which coarse patch stands for a patch |
//! | [`light`] | sun, lamps, sky |
//! | [`camera`] | who looks, from where, how fast |
//! | [`random`] | every random number is a hash of (seed, purpose, index) |

pub mod asked;
pub mod barrier;
pub mod camera;
pub mod chunk;
pub mod direction;
pub mod grid;
pub mod index;
pub mod light;
pub mod lineage;
pub mod patch;
pub mod random;
pub mod receivers;
pub mod rows;
pub mod surface_plane;

pub use asked::Asked;
pub use barrier::Barrier;
pub use camera::Camera;
pub use chunk::{Chunk, OccluderMesh};
pub use direction::{AxisWeights, Direction};
pub use glam::{Vec3, Vec4};
pub use grid::{Bounds, ChunkCoord, ChunkId, Grid, VoxelCoord};
pub use index::{ChunkSummary, WorldIndex};
pub use light::{Light, LightRig, Sky};
pub use patch::{Patch, PatchId, SamplePoint};
pub use receivers::{DetailVoxel, ReceiverPlace, Receivers};
pub use rows::{ChunkRows, Column, RowParts};
pub use surface_plane::SurfacePlane;

/// Linear RGB: reflectance, exitance, irradiance or radiance, as the name beside it says.
pub type Rgb = Vec3;
