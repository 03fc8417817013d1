//! Imports built by hand, one feature or fault each, and the shared scenes where they are present.
//!
//! Start at `glb`: the builder that every test uses.

mod extensions;
mod faults;
mod features;
mod glb;
mod lights;
mod materials;
mod shared;
