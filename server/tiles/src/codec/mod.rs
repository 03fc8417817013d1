//! What is inside the frames of a tile, before zstd and after.
//!
//! Decoders get exactly the bytes that the section table announced, check every number that anyone
//! will index with, and complain with a sentence; [`crate::TileError`] adds file and frame.

pub(crate) mod half_share;
pub(crate) mod occluders;
pub(crate) mod patches;
pub(crate) mod planes;
pub(crate) mod points;
pub(crate) mod receivers;
pub(crate) mod row_decode;
pub(crate) mod row_encode;
pub(crate) mod row_group;
pub(crate) mod segments;
pub(crate) mod zstd_frame;

/// What a decoder gives back: the value, or what is wrong with the bytes.
pub(crate) type Decoded<T> = Result<T, String>;

/// How rows are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum RowCodec {
    /// Shares as `f16` scaled by a power of two a group, relative error below 1/1024, row sums kept to
    /// about 1e-4; sky and absorbed shares with 16 bits of mantissa. About 2 bytes a non-zero.
    #[default]
    Half = 1,
    /// Shares as `f32`: lossless. About 4 bytes a non-zero.
    Full = 2,
}

impl RowCodec {
    /// The codec with the number `number` in headers.
    pub(crate) fn from_number(number: u32) -> Option<Self> {
        [Self::Half, Self::Full].into_iter().find(|&codec| codec as u32 == number)
    }

    /// Bytes of one share before zstd.
    pub(crate) fn share_bytes(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Full => 4,
        }
    }
}

/// Cuts the first `length` bytes off `bytes`.
pub(crate) fn take<'a>(bytes: &mut &'a [u8], length: usize, what: &str) -> Decoded<&'a [u8]> {
    let (first, rest) = bytes.split_at_checked(length).ok_or_else(|| format!("it ends inside its {what}"))?;
    *bytes = rest;
    Ok(first)
}
