//! WGSL sources and what they share with Rust: sizes, structs, bindings. No graphics API here: whoever has a device
//! compiles them.
//!
//! - `wgsl/common/lookup_irradiance.wgsl`: the lookup rule, for engines that read Earthshine's volumes in a shader.
//! - `wgsl/kernels`: the compute kernels of the GPU backend, one entry point a file, named as the file; each names its
//!   twin on the CPU. [`kernel`] describes their buffers, [`host`] their structs, [`limits`] their sizes.
//! - `wgsl/subgroups`: what kernels do otherwise on devices with [`subgroups`].
//!
//! `tests/reflection.rs` has naga validate every source and compares names, offsets, types, bindings, access, workgroup
//! sizes and constants with the Rust side: the two cannot drift apart.

pub mod host;
pub mod kernel;
pub mod limits;
pub mod subgroups;

/// Irradiance at a position and normal from a volume in storage buffers: `lookup_irradiance(position, normal)`.
pub const LOOKUP_IRRADIANCE: &str = include_str!("../wgsl/common/lookup_irradiance.wgsl");
