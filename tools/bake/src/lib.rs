//! Scene to world: sample points, patches, form-factor rows, tiles.
//!
//! The stages, in order, each gone through chunk by chunk:
//!
//! 1. [`sample`]: triangles are cut at voxel faces ([`clip`]) and covered with points, each side its own
//!    (or [`hammersley`]: points on voxel faces traced inwards); [`exposure`]: points inside of something are dropped,
//!    points in crevices marked; [`patches`]: what faces one direction in one voxel becomes a patch (or what
//!    [`clusters`] says). [`surfaces`] does all three for one chunk;
//! 2. [`rows`]: cosine-weighted rays from each patch; what they hit is its row (or [`point_rows`]: sums over points);
//! 3. [`receivers`]: rows in the empty air near patches; `detail`: rows of parts of voxels;
//! 4. [`reciprocity`]: both estimates of each pair become one, and rows sum to one again;
//! 5. `emit`: chunks become tiles;
//! 6. [`pyramid`]: coarse levels are merged from finer tiles; the manifest is written last.
//!
//! Where there is a device, it follows the rays of 2 and 3 and adds up their ends: rows ask (`inquiry`), and are made here
//! of what comes back, or of the CPU's own rays.
//!
//! [`builder`] chooses among samples and patches, [`estimator`] among rows; `BUILDERS.md` compares them.
//!
//! The bytes depend on the scene, the parameters and the seed alone: not on threads, nor on how many processes
//! ([`shard`]) in how many runs made them, nor on what the world was before an edit. What a stage comes to for a chunk is
//! kept in the [`work_folder`]. After an edit, its rays are cast again from their seeds without looking ([`eye`]), and
//! only rows and points whose rays come to what changed (`changes`) are traced; [`stale`] says which were. How much memory it all takes is said first ([`memory`]). Start at [`bake`].

pub mod adaptive;
mod apart;
mod balance;
mod barriers;
pub mod builder;
pub mod buried;
pub mod cells;
mod changes;
pub mod clip;
pub mod clusters;
mod coarse_exchange;
pub mod content;
mod counted_exposure;
mod counted_receivers;
mod counted_rows;
mod crevice_rows;
mod crevices;
mod detail;
mod detail_exposure;
mod detail_stage;
mod emit;
mod emitted;
mod end_places;
mod error;
pub mod estimator;
pub mod exposure;
mod exposure_record;
pub mod eye;
pub mod fineness;
mod finished_world;
pub mod hammersley;
pub mod hidden;
pub mod identity;
mod inquiry;
mod kept_rows;
mod layers;
mod light_search;
pub mod memory;
mod offload;
pub mod overlap;
mod parameters_check;
pub mod patches;
mod pieces;
pub mod places;
pub mod point_rows;
mod progress;
pub mod pyramid;
mod questions;
mod receiver_places;
pub mod receivers;
pub mod reciprocity;
mod row_files;
pub mod rows;
pub mod sample;
pub mod shard;
pub mod spread;
mod stages;
pub mod stale;
mod states;
mod summary;
pub mod surfaces;
#[cfg(test)]
mod test_shapes;
mod tile_files;
mod tracing;
mod voxel_map;
mod walls;
mod words;
pub mod work_folder;

// Whoever drives the stages one by one needs it.
pub use earthshine_trace::ends;
pub use earthshine_trace::{CasterError, EndCounter, Query, RayDevice, RayFan, Rays, SceneTracer};
pub use error::BakeError;
pub use memory::MemoryLimit;
pub use parameters_check::check as check_parameters;
pub use progress::{Progress, Silent, Stage};
pub use pyramid::Levels;
pub use shard::Shard;
pub use stages::{BakeOptions, bake, bake_on};
pub use stale::StaleReport;
pub use summary::{BakeSummary, LevelSummary};
