//! A symmetric matrix on the device: the lower triangle in tiles of 64 x 64, stripe after stripe, in as many parts as the
//! largest binding asks for. A part holds whole stripes.

use earthshine_shaders::limits::TILE_EDGE;
use std::ops::Range;
use wgpu::Buffer;

/// Where a stripe begins, in numbers; for the number of stripes, how many numbers a plane has.
pub(crate) fn stripe_at(stripe: u64) -> u64 {
    stripe * (stripe + 1) / 2 * u64::from(TILE_EDGE * TILE_EDGE)
}

/// Some stripes of a plane, in a buffer or in what stands for one.
#[derive(Debug)]
pub(crate) struct PlanePart<B = Buffer> {
    pub(crate) stripes: Range<u32>,
    pub(crate) buffer: B,
}

/// All stripes of a plane, zero at first.
#[derive(Debug)]
pub(crate) struct Plane<B = Buffer> {
    pub(crate) parts: Vec<PlanePart<B>>,
}

impl<B> Plane<B> {
    /// In parts of at most `part_bytes_max` bytes, each of as many numbers as `make` is told.
    ///
    /// # Errors
    /// Those of `make`.
    pub(crate) fn lay_out<E>(
        stripes: u32,
        part_bytes_max: u64,
        mut make: impl FnMut(u64) -> Result<B, E>,
    ) -> Result<Self, E> {
        let mut parts = Vec::new();
        for stripes in split(stripes, part_bytes_max) {
            let numbers = stripe_at(u64::from(stripes.end)) - stripe_at(u64::from(stripes.start));
            parts.push(PlanePart { stripes, buffer: make(numbers)? });
        }
        Ok(Self { parts })
    }
}

/// Cuts `stripes` stripes into parts of at most `bytes_max` bytes, or of one stripe.
fn split(stripes: u32, bytes_max: u64) -> Vec<Range<u32>> {
    let mut parts = Vec::new();
    let mut first = 0;
    while first < stripes {
        let begin = stripe_at(u64::from(first));
        let fits = |end: &u32| 4 * (stripe_at(u64::from(*end)) - begin) <= bytes_max;
        let end = (first + 1..=stripes).take_while(fits).last().unwrap_or(first + 1);
        parts.push(first..end);
        first = end;
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_cover_all_stripes_and_keep_to_the_limit() {
        for (stripes, bytes) in [(0, 100), (1, 100), (7, 1 << 16), (64, 1 << 20), (64, u64::MAX)] {
            let parts = split(stripes, bytes);
            assert!(parts.iter().flat_map(Clone::clone).eq(0..stripes), "{parts:?}");
            for part in parts {
                let size = 4 * (stripe_at(u64::from(part.end)) - stripe_at(u64::from(part.start)));
                assert!(size <= bytes || part.len() == 1, "{part:?}");
            }
        }
    }
}
