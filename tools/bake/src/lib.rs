//! Scene to world: sample points, patches, form-factor rows, tiles.
//!
//! The stages, in order, each a module:
//!
//! 1. [`sample`]: triangles are cut at voxel faces ([`clip`]) and covered with points, each side its own
//!    (or [`hammersley`]: points on voxel faces traced inwards);
//! 2. [`exposure`]: points inside of something are dropped, points in crevices marked;
//! 3. [`patches`]: what faces one direction in one voxel becomes a patch (or what [`clusters`] says);
//! 4. [`rows`]: cosine-weighted rays from each patch; what they hit is its row (or [`point_rows`]: sums over points);
//! 5. [`reciprocity`]: both estimates of each pair become one, and rows sum to one again;
//! 6. [`receivers`]: rows in the empty air near patches;
//! 7. [`emit`]: chunks become tiles;
//! 8. [`pyramid`]: coarse levels are merged from finer tiles; the manifest is written last.
//!
//! [`builder`] chooses among samples and patches, [`estimator`] among rows; `BUILDERS.md` compares them.
//!
//! The bytes depend on the scene, the parameters and the seed alone: not on threads, nor on whether the bake
//! was interrupted ([`checkpoint`]). Start at [`bake`].

pub mod adaptive;
pub mod builder;
pub mod checkpoint;
pub mod clip;
pub mod clusters;
mod coarse_exchange;
pub mod emit;
mod error;
pub mod estimator;
pub mod exposure;
pub mod hammersley;
pub mod hidden;
pub mod identity;
pub mod patches;
pub mod places;
pub mod point_rows;
mod progress;
pub mod pyramid;
mod receiver_places;
pub mod receivers;
pub mod reciprocity;
pub mod rows;
pub mod sample;
pub mod spread;
mod stages;
mod summary;
#[cfg(test)]
mod test_shapes;
mod tile_files;
mod voxel_map;

// Whoever drives the stages one by one needs it.
pub use earthshine_trace::SceneTracer;
pub use error::BakeError;
pub use progress::{Progress, Silent, Stage};
pub use pyramid::Levels;
pub use stages::{BakeOptions, bake};
pub use summary::{BakeSummary, LevelSummary};
