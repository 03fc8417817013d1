//! Scene to world: sample points, patches, form-factor rows, tiles.
//!
//! The stages, in order, each a module:
//!
//! 1. [`sample`]: triangles are cut at voxel faces ([`clip`]) and covered with points, each side its own;
//! 2. [`exposure`]: points inside of something are dropped, points in crevices marked;
//! 3. [`patches`]: what faces one direction in one voxel becomes a patch;
//! 4. [`rows`]: cosine-weighted rays from each patch; what they hit is its row;
//! 5. [`reciprocity`]: both estimates of each pair become one, and rows sum to one again;
//! 6. [`emit`]: chunks become tiles, the manifest is written last.
//!
//! The bytes depend on the scene, the parameters and the seed alone: not on threads, nor on whether the bake
//! was interrupted ([`checkpoint`]). Start at [`bake`].

pub mod checkpoint;
pub mod clip;
pub mod emit;
mod error;
pub mod exposure;
pub mod hidden;
pub mod identity;
pub mod patches;
mod progress;
pub mod reciprocity;
pub mod rows;
pub mod sample;
mod stages;
mod summary;

pub use error::BakeError;
pub use progress::{Progress, Silent, Stage};
pub use stages::{BakeOptions, bake};
pub use summary::BakeSummary;
