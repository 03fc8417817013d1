//! Bytes on disk: what a world's folder and its tiles look like, and nothing else.
//!
//! A chunk is a cube of the world; a tile is the bytes of one chunk. A tile lives so: [encoded](fn@encode) from
//! a chunk, written under a temporary name, synced and renamed ([`write_atomic`]), listed in the
//! [`Manifest`], mapped ([`MappedTile`]), checked against the manifest ([`DirStore`]), verified and decoded.
//! It is never changed: a new bake of the chunk is a new file with a new name.
//!
//! This package knows no light, no solver and no network. No row leaves it unverified: every frame is
//! held against its checksum before it is decompressed, every count against [`limits`] before memory is
//! taken for it, and every index against its table before anyone follows it.
//!
//! | module | what is in it |
//! |---|---|
//! | [`format`](mod@format) | drawing of the file; header and section table |
//! | `codec` | what is inside the frames |
//! | [`encode`](fn@encode), [`decode_bytes`] | one chunk to bytes and back |
//! | [`limits`] | what a file may ask for |
//! | [`manifest`] | `world.toml` |
//! | [`parameters`], [`method`] | what a bake was asked for |
//! | [`store`], [`fault`] | where chunks come from, and what goes wrong there |
//! | [`invariant`] | the row invariants that `inspect verify` checks |
//! | [`measure`](mod@measure) | bytes a non-zero and non-zeros a second |

pub mod checksum;
mod codec;
mod encode;
pub mod error;
pub mod fault;
pub mod format;
#[cfg(test)]
mod hostile;
pub mod invariant;
pub mod limits;
pub mod manifest;
pub mod measure;
pub mod method;
pub mod parameters;
mod reader;
pub mod store;
mod structure;
mod writer;

pub use codec::RowCodec;
pub use encode::{EncodeOptions, encode};
pub use error::{TileError, io_cure};
pub use fault::{FaultPlan, FaultyStore};
pub use format::{Frame, TileHeader, tile_file_name, tile_hash};
pub use invariant::{RowFault, RowFaultKind, check_receivers, check_rows, check_targets};
pub use manifest::{ChunkEntry, Manifest};
pub use measure::{TileFigures, measure};
pub use method::{BakeMethod, PatchBuilder, RaySpread, RowEstimator, SampleSource};
pub use parameters::BakeParameters;
pub use reader::{MappedTile, decode_bytes};
pub use store::{DirStore, TileStore};
pub use writer::write_atomic;
