//! Ready worlds as bytes, for the tests and benches of other packages.

use crate::{GenOptions, WorldKind, generate};

/// The Cornell box: 32 triangles.
#[must_use]
pub fn cornell_glb() -> Vec<u8> {
    bytes(WorldKind::Cornell, &GenOptions::default())
}

/// A furnace that emits 1 cd/m2: exitance is `pi / (1 - reflectance)` everywhere.
///
/// # Panics
/// If `reflectance` is outside 0 to 0.98.
#[must_use]
pub fn furnace_glb(reflectance: f32) -> Vec<u8> {
    bytes(WorldKind::Furnace, &GenOptions { furnace_reflectance: reflectance, ..GenOptions::default() })
}

/// Two rooms and a doorway.
#[must_use]
pub fn two_rooms_glb() -> Vec<u8> {
    bytes(WorldKind::TwoRooms, &GenOptions::default())
}

/// A corridor of `length_m`.
///
/// # Panics
/// If the length is outside 8 m to 10 km.
#[must_use]
pub fn corridor_glb(length_m: f32) -> Vec<u8> {
    bytes(WorldKind::Corridor, &GenOptions { corridor_length_m: length_m, ..GenOptions::default() })
}

/// The smallest town: one block and its streets, 40 m; flattened, or with instances.
#[must_use]
pub fn small_town_glb(flatten: bool) -> Vec<u8> {
    bytes(
        WorldKind::Town,
        &GenOptions { town_size_m: GenOptions::TOWN_CELL_M, flatten, ..GenOptions::default() },
    )
}

fn bytes(kind: WorldKind, options: &GenOptions) -> Vec<u8> {
    generate(kind, options, &|_, _| {}).expect("a world within the documented ranges").bytes
}
