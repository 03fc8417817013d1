//! Light in a box of voxels, and the one rule by which a point reads it.
//!
//! A [`Volume`] holds up to six irradiances a voxel, one a direction (an "ambient cube"): what the server
//! sends and what offline tools fill from a solve. [`lookup()`] is the lookup rule of GLOSSARY.md, the same for
//! the client, the tools and (as a snippet) the shader. [`rgb9e5`] is how light travels, [`ShaderVolumes`] how a shader
//! is given it.
//!
//! There is no wire format and no I/O here; values are exact `f32`.
//! Directions are indices 0..6 in the order +X -X +Y -Y +Z -Z.

pub mod barrier;
pub mod layout;
mod level_blend;
pub mod lookup;
mod places;
pub mod plane;
pub mod rgb9e5;
pub mod shader_volumes;
pub mod tilt;
pub mod volume;

pub use layout::{Layout, LayoutError};
pub use lookup::{LookedUp, lookup};
pub use shader_volumes::ShaderVolumes;
pub use volume::{Volume, VoxelLight};
