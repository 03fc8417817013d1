//! What a file may ask for. Checked before memory is taken, so that a hostile file costs
//! at most about two GiB for the moment of its decoding.

use earthshine_world::{Chunk, Receivers};

/// Patches in a tile: locals are `u16`.
pub const PATCHES_MAX: u32 = Chunk::PATCHES_MAX as u32;
/// Receivers in a tile.
pub const RECEIVERS_MAX: u32 = Receivers::COUNT_MAX as u32;
/// Sample points in a tile: 64 a patch, for four times the bake's default.
pub const POINTS_MAX: u32 = 1 << 22;
/// Chunks that one tile's columns may point into: segments are `u16`.
pub const SEGMENTS_MAX: u32 = 1 << 16;
/// Form factors in a tile, and receivers' once more: 1,024 for each of the most patches; 512 MiB decoded.
pub const NONZEROS_MAX: u64 = 1 << 26;
/// Form factors in a row. Rows have one a ray, and the transposed ones: thousands.
pub const ROW_NONZEROS_MAX: u32 = 1 << 16;
/// Corners of a tile's occluders: 48 MiB.
pub const VERTICES_MAX: u32 = 1 << 22;
/// Triangles of a tile's occluders: 64 MiB.
pub const TRIANGLES_MAX: u32 = 1 << 22;
/// Size of a tile's file.
pub const TILE_BYTES_MAX: u64 = 1 << 30;
/// A row group once decompressed: full rows at the lossless codec's 9 bytes an entry, and their heads.
pub const GROUP_RAW_BYTES_MAX: u64 = ROWS_PER_GROUP as u64 * (ROW_NONZEROS_MAX as u64 * 9 + 64) + (1 << 18);
/// Size of `world.toml`: some 500,000 chunks.
pub const MANIFEST_BYTES_MAX: u64 = 1 << 28;
/// Levels of a pyramid: `Grid::at_level` doubles so often.
pub const LEVEL_MAX: u8 = 15;
/// Patches whose rows share a frame: few enough to read part of a chunk, enough to compress well.
pub const ROWS_PER_GROUP: u32 = 32;
/// Largest form factor that is stored. One, but for `AxisWeights::Absolute`, which makes up to 1.73 of it.
pub const SHARE_MAX: f32 = 2.0;
/// Largest coordinate of a sample point, m.
pub const POSITION_MAX_M: f32 = 1e9;
