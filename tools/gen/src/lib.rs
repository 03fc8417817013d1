//! Deterministic worlds from a seed, written as `.glb`: rooms with a known answer, and towns of any size.
//!
//! No clock, no state, no randomness but hashes of (seed, cell, use, index): the same options give the same
//! bytes, and a cell of a town made alone is the cell of the whole town. What is written here is read by
//! whatever reads glTF; this package never reads it back outside its tests.
//!
//! Start at [`generate`].
//!
//! | module | words |
//! |---|---|
//! | [`options`] | which world, how large |
//! | [`material`], [`mesh`] | triangles by material, in metres |
//! | `masonry` | walls, rooms and openings as one watertight rectilinear solid |
//! | `solids` | cones, blobs and gables: what masonry cannot be |
//! | `glb`, `document` | meshes, instances and lamps as a binary glTF 2.0 file |
//! | `cornell`, `furnace`, `rooms`, `study`, `corridor` | closed worlds |
//! | [`town`] | streets, houses, squares, cell by cell |
//! | [`fixtures`] | ready worlds for the tests of other packages |

mod cornell;
mod corridor;
mod document;
mod draw;
mod error;
pub mod fixtures;
mod furnace;
mod glb;
mod masonry;
pub mod material;
pub mod mesh;
pub mod options;
mod rooms;
mod solids;
mod study;
pub mod town;

pub use error::GenError;
pub use glb::Glb;
pub use options::{GenOptions, WorldKind};
pub use town::{CellMesh, generate_town_cell};

/// Makes the world `kind`. `progress` hears (done, total) in units of work, at least once, the last time equal.
///
/// # Errors
/// An option out of its range, a triangle count this size of town cannot hold, or more bytes than a `.glb` may have.
pub fn generate(kind: WorldKind, options: &GenOptions, progress: &dyn Fn(u64, u64)) -> Result<Glb, GenError> {
    options.validate(kind)?;
    if kind == WorldKind::Town {
        return town::generate(options, progress);
    }
    let glb = match kind {
        WorldKind::Furnace => furnace::generate(options),
        WorldKind::TwoRooms => rooms::generate(options),
        WorldKind::Corridor => corridor::generate(options),
        WorldKind::Study => study::generate(options),
        WorldKind::Cornell | WorldKind::Town => cornell::generate(options),
    }?;
    progress(1, 1);
    Ok(glb)
}
