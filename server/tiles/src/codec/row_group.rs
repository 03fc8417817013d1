//! The layout of a row group before zstd: up to 32 rows, readable without the other groups.
//!
//! ```text
//! │ GroupHead                     20 B │ counts, scale of the shares
//! │ segment list  u16 x segment_count  │ indices into the tile's segments, ascending
//! │ row lengths   u32 x row_count      │ non-zeros of each row
//! │ tails         28 B x row_count     │ f32: six sky shares, absorbed share; byte planes
//! ├────────────────────────────────────┤ <- a new zstd block, with its own Huffman table
//! │ gaps          gap_bytes            │ LEB128: key - previous key - 1, from -1 on in each row
//! ├────────────────────────────────────┤    key = (place in the segment list) << 16 | local
//! │ shares, high bytes first           │ one plane a byte of f16 or f32, each in blocks of its own
//! └────────────────────────────────────┘
//! ```
//!
//! Gaps cannot be negative, so columns ascend and none appears twice by construction.

use bytemuck::{Pod, Zeroable};

const _: () = assert!(size_of::<GroupHead>() == 20, "the head of a row group is 20 bytes before zstd");

/// First bytes of a row group.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct GroupHead {
    pub(crate) row_count: u32,
    pub(crate) segment_count: u32,
    pub(crate) nonzero_count: u32,
    pub(crate) gap_bytes: u32,
    /// Shares are stored times two to this; 0 for the lossless codec.
    pub(crate) share_exponent: i32,
}

/// `f32`s of a row besides its entries: six sky shares and the absorbed one.
pub(crate) const TAIL_VALUES: usize = 7;
/// Bytes of them.
pub(crate) const TAIL_BYTES: usize = TAIL_VALUES * 4;
