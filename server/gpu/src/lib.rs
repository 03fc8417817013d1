//! The wgpu backend: the local matrix and the light on it, computed by the kernels of `earthshine-shaders`.
//!
//! What it is not: an oracle. Every kernel has a twin on the CPU, and [`GpuBackend`] passes the suite that
//! `CpuBackend` passes. Nothing outside this package names wgpu, and nothing in it knows tiles, chunks or cameras.
//!
//! ```text
//! adapter ──open──▶ GpuDevice (queue, pipelines) ──▶ GpuBackend ... one for each level of each session
//!
//! apply:  scatter rows ▶ gather G x rows ▶ combine ▶ return_light ▶ solve_block (32 x 32, who is refused)
//!         ▶ times_small ▶ rank_update (three planes) ▶ write_columns (four planes)
//! step:   emit_exitance ▶ multiply_tiles (three planes) ▶ sum_tiles
//!         ▶ news ┄┄16 bytes a slot that changed, a bit a slot: its patch was refused┄┄▶ host, not waited for
//! ```
//!
//! Four planes are held, each the lower triangle of a symmetric matrix in tiles as on the CPU: `G = A H` of three
//! channels, and the exchange `X = A F` it was made from, so that drift, repair and a fresh solve need nothing from the
//! host. `8 M^2` bytes and a little: [`memory`].
//!
//! No kernel uses float atomics and every sum has one order: the same calls give the same bits on the same device and
//! driver. Other devices round differently.
//!
//! A tick waits for nothing: whatever comes back is copied while later work runs, and taken when it is here. Where somebody
//! does wait, to open a device, to measure, it is counted ([`GpuDevice::waits`]).
//!
//! Start at [`adapter`], then [`GpuBackend`]; `matrix` holds the passes, `recorder` how one is run. [`news`] is what comes
//! back of a step's light. [`rows`] advances light over sparse rows, by any method but the matrix; [`alias`] builds tables
//! by themselves, to measure. [`rays`] follows rays through the CPU's trees, [`ends`] adds up where they end, [`direct`]
//! lights patches through those of resident chunks, [`receivers`] gathers light in the air and of detail. [`copy_bench`] is
//! what kernels are measured against.

pub mod adapter;
pub mod alias;
mod arena;
mod backend;
pub mod copy_bench;
mod device;
pub mod direct;
pub mod ends;
mod flight;
#[cfg(test)]
mod life_tests;
mod lit_patches;
#[cfg(test)]
mod lookup_tests;
mod matrix;
pub mod memory;
mod mirror;
pub mod news;
mod packed_rows;
mod pipeline;
mod pipeline_cache;
mod plane;
pub mod rays;
mod readback;
#[cfg(test)]
mod receiver_tests;
pub mod receivers;
mod recorder;
mod row_room;
pub mod rows;
mod subgroups;
mod timing;
mod told_sums;
#[cfg(test)]
mod twins;
pub mod work;

pub use adapter::{AdapterChoice, AdapterReport, GpuError};
pub use backend::GpuBackend;
pub use device::GpuDevice;
pub use news::NewsTotals;
pub use pipeline_cache::{CachedPipelines, Given};
pub use rows::GpuRowLight;
pub use timing::{PassTime, PassTotal};
pub use work::Work;
