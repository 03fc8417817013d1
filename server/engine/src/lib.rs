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
//! | take events | [`engine`] | what the shell hands over |
//! | which chunks are wanted; let the others go | `schedule`, `chunks`, [`residency`] | `load_radius_m`, `decoded_bytes_max` |
//! | ask for tiles, nearest first | `schedule` | `tiles_in_flight_max` |
//! | which patches are nearest | `priority` | `resident_patches_max` |
//! | remove, add, light the new ones | `session`, `local_set`, `slots` | `removals_per_tick_max`, `adds_per_tick_max` |
//! | light what is out of date | `relight`, `direct` | `shadow_points_per_tick_max` |
//! | sources to the backend, step, read | `relight`, `session` | |
//! | gather light in empty air | `air` | `receiver_rows_per_tick_max` |
//! | publish | `session` | one frame a session |
//!
//! Work that does not fit is carried over: plans are lists that later ticks go on with.
//!
//! # The three parts of a row
//!
//! Of each resident patch's row the *resident* columns are in the backend's matrix, the *sky* lights the patch from
//! outside, and the *far* columns (patches that exist but hold no slot) bring no light in this version. Their share
//! is in every frame; it is never given to the sky.

mod air;
mod budget;
mod chunks;
pub mod config;
mod direct;
pub mod engine;
pub mod error;
pub mod event;
pub mod frame;
pub mod invariant;
mod local_set;
mod priority;
mod relight;
pub mod residency;
mod schedule;
mod session;
mod slots;
pub mod stats;
#[cfg(test)]
mod tests;
mod tile;

pub use config::{ConfigError, EngineConfig};
pub use engine::{BackendFactory, Engine};
pub use error::EngineError;
pub use event::{Command, Event, SessionId};
pub use frame::{Frame, FrameQuality, PatchLight};
pub use invariant::InvariantError;
pub use residency::ChunkState;
pub use stats::{ChunkCounts, Counters, EngineStats, IgnoredEvents, SessionStats, TickStats};
