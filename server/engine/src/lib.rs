//! The deterministic heart of the server: which chunks are in memory, which patches hold slots, what light is on
//! them, and what each tick does about it.
//!
//! It is not a runtime: no I/O, no clock, no threads. Time, tiles, cameras and lights come in as [`Event`]s,
//! requests and frames go out as [`Command`]s; the same events give the same commands, to the bit where the backend
//! gives the same bits. Everything is bounded by a key of [`EngineConfig`]; what comes from outside never panics, a
//! broken invariant always does. Start at [`Engine::tick`].
//!
//! # One tick
//!
//! | step | where | bounded by |
//! |---|---|---|
//! | take events; take tiles that came | [`engine`], `intake` | what the shell hands over; `accepted_bytes_per_tick_max` |
//! | which chunks are wanted; let the others go | `schedule`, `chunks`, [`residency`] | `load_radius_m`, `decoded_bytes_max` |
//! | ask for tiles, most urgent first | `schedule`, `priority` | `tiles_in_flight_max` |
//! | which patches are nearest, and how many a camera at its speed is given | `priority`, `flow` | `resident_patches_max` |
//! | remove, add, light the new ones | `turns`, `swaps`, `swap_price`, `local_set`, `slots`, `row_split` | `removals_per_tick_max`, `adds_per_tick_max` |
//! | light what is out of date | `relight`, `direct`, `asked_light`, `shadow_reach` | `shadow_points_per_tick_max` |
//! | far light, sources to the backends, step, read, the coarsest level first | `far`, `far_device`, `relight`, `level_view` | |
//! | gather light in empty air | `air`, `air_light`, `air_device`, `receiver_columns` | `receiver_rows_per_tick_max` |
//! | hold the tick against the promise | `coverage`, [`promise`] | |
//! | publish | `session` | one frame a session |
//!
//! Work that does not fit is carried over: plans are lists that later ticks go on with.
//!
//! # The three parts of a row
//!
//! Of each resident patch's row the *resident* columns are in the backend's matrix, the *sky* lights the patch from
//! outside, and for the *far* columns (patches that exist but hold no slot) their coarse parents stand in, as far as a
//! coarser level holds them; what is left is a gap. The shares are in every frame; none is ever given to the sky.
//!
//! # Levels
//!
//! Each session has a local set a level, each around the same camera, each coarser one of larger patches that reach
//! farther. The top level is held whole if it fits, is asked for first and stays: there is never nothing to show.

mod air;
mod air_device;
mod air_light;
mod asked_light;
mod budget;
mod chunks;
pub mod config;
mod coverage;
pub mod crowding;
mod direct;
pub mod engine;
pub mod error;
pub mod event;
mod far;
mod far_device;
mod far_follow;
mod flow;
pub mod frame;
mod gatherer;
pub mod held;
mod intake;
pub mod invariant;
mod level_view;
mod levels;
mod local_set;
mod priority;
pub mod promise;
mod receiver_columns;
mod refusals;
mod relight;
pub mod residency;
mod row_split;
mod schedule;
mod session;
mod shadow_reach;
mod slots;
pub mod solver_config;
pub mod stats;
mod swap_price;
mod swaps;
#[cfg(test)]
mod tests;
mod tile;
mod turns;

pub use config::{ConfigError, EngineConfig};
pub use crowding::Crowding;
pub use engine::{BackendFactory, Engine, ReceiverLightFactory};
pub use error::EngineError;
pub use event::{Command, Event, SessionId};
pub use frame::{Frame, FrameQuality, LevelLight, PatchLight};
pub use held::EngineMemory;
pub use invariant::InvariantError;
pub use promise::{Means, Promise, Prospect};
pub use residency::ChunkState;
pub use solver_config::SolverConfig;
pub use stats::{
    ChunkCounts, Counters, EngineStats, IgnoredEvents, SessionStats, TickStats, ViolationCauses,
};
