//! WGSL sources and the numbers they share with Rust. No graphics API here: whoever has a device compiles them.
//!
//! Today: the lookup rule, for engines that read Earthshine's volumes in a shader. A test validates it with
//! naga and holds its constants against the Rust rule. The compute kernels of the GPU backend will live in
//! `wgsl/kernels`, one entry point a file.

/// Irradiance at a position and normal from a volume in storage buffers: `lookup_irradiance(position, normal)`.
pub const LOOKUP_IRRADIANCE: &str = include_str!("../wgsl/common/lookup_irradiance.wgsl");
