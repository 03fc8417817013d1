//! One zstd frame a section, made so that planes of different nature do not share a Huffman table.

use super::Decoded;
use crate::limits;
use zstd::zstd_safe::{
    CCtx, CParameter, DCtx, InBuffer, OutBuffer, ResetDirective, compress_bound, get_error_name,
    get_frame_content_size, zstd_sys::ZSTD_EndDirective,
};

const ZSTD_MAGIC: [u8; 4] = [0x28, 0xB5, 0x2F, 0xFD];
/// Shortest match: shorter ones save 1 % of a row's bytes and cost a tenth of its decoding.
const MATCH_MIN: u32 = 6;
/// What a flush may add to a block: its header and a table that did not pay.
const FLUSH_BYTES_MAX: usize = 512;

/// Compresses frames.
pub(crate) struct Packer {
    context: CCtx<'static>,
    level: i32,
}

impl Packer {
    pub(crate) fn new(level: i32) -> Self {
        let range = zstd::compression_level_range();
        Self { context: CCtx::create(), level: level.clamp(*range.start(), *range.end()) }
    }

    /// `parts`, one after the other, as one frame. Each part begins a new block.
    pub(crate) fn pack(&mut self, parts: &[&[u8]]) -> Decoded<Vec<u8>> {
        let total: usize = parts.iter().map(|part| part.len()).sum();
        let context = &mut self.context;
        context.reset(ResetDirective::SessionAndParameters).map_err(message)?;
        context.set_parameter(CParameter::CompressionLevel(self.level)).map_err(message)?;
        context.set_parameter(CParameter::MinMatch(MATCH_MIN)).map_err(message)?;
        context.set_pledged_src_size(Some(total as u64)).map_err(message)?;
        let mut frame = Vec::with_capacity(compress_bound(total) + (parts.len() + 1) * FLUSH_BYTES_MAX);
        let mut output = OutBuffer::around(&mut frame);
        let ends = std::iter::repeat_n(ZSTD_EndDirective::ZSTD_e_flush, parts.len())
            .chain([ZSTD_EndDirective::ZSTD_e_end]);
        for (part, end) in parts.iter().copied().chain([&[][..]]).zip(ends) {
            let mut input = InBuffer::around(part);
            while context.compress_stream2(&mut output, &mut input, end).map_err(message)? > 0 {
                if output.pos() == output.capacity() {
                    return Err("zstd filled its own bound".to_owned());
                }
            }
        }
        Ok(frame)
    }
}

/// Decompresses frames into one buffer that is used again and again.
pub(crate) struct Unpacker {
    context: DCtx<'static>,
    raw: Vec<u8>,
}

impl Unpacker {
    pub(crate) fn new() -> Self {
        Self { context: DCtx::create(), raw: Vec::new() }
    }

    /// The `raw_bytes` bytes in `frame`. The caller has held `raw_bytes` against its limit.
    pub(crate) fn unpack(&mut self, frame: &[u8], raw_bytes: u32) -> Decoded<&[u8]> {
        debug_assert!(u64::from(raw_bytes) <= limits::TILE_BYTES_MAX);
        if !frame.starts_with(&ZSTD_MAGIC) {
            return Err("it is not a zstd frame".to_owned());
        }
        let announced = get_frame_content_size(frame).ok().flatten();
        if announced != Some(u64::from(raw_bytes)) {
            return Err(format!("zstd announces {announced:?} bytes, the section table {raw_bytes}"));
        }
        self.raw.clear();
        self.raw.reserve(raw_bytes as usize);
        self.context.decompress(&mut self.raw, frame).map_err(message)?;
        if self.raw.len() != raw_bytes as usize {
            return Err(format!("{} bytes came out of {raw_bytes}", self.raw.len()));
        }
        Ok(&self.raw)
    }
}

fn message(code: usize) -> String {
    format!("zstd: {}", get_error_name(code))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_come_back_joined_and_a_wrong_size_is_refused() {
        let noise: Vec<u8> = (0..5000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        for parts in [vec![], vec![&[][..]], vec![&noise[..], &[7; 300_000], &noise[..9]]] {
            let frame = Packer::new(3).pack(&parts).unwrap();
            let whole = parts.concat();
            let mut unpacker = Unpacker::new();
            assert_eq!(unpacker.unpack(&frame, whole.len() as u32), Ok(&whole[..]));
            assert!(unpacker.unpack(&frame, whole.len() as u32 + 1).is_err());
        }
    }
}
