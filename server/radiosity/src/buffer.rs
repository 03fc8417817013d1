//! Memory for matrices: zeroed, aligned to a cache line, asked for politely.
//!
//! A vector load that straddles two cache lines costs two; `Vec<f32>` promises four bytes.

use crate::kernel::Scalar;

/// One cache line of plain numbers; any bit pattern is valid.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Line([u64; 8]);

/// Bytes of a [`Line`].
const LINE_BYTES: usize = 64;
const _: () = assert!(size_of::<Line>() == LINE_BYTES && align_of::<Line>() == LINE_BYTES);

/// A fixed run of numbers that starts on a cache line.
#[derive(Debug, Clone)]
pub(crate) struct Buffer<T> {
    lines: Vec<Line>,
    len: usize,
    scalar: std::marker::PhantomData<T>,
}

impl<T: Scalar> Buffer<T> {
    /// `len` zeros.
    ///
    /// # Errors
    /// When the memory cannot be had.
    pub(crate) fn zeroed(len: usize) -> Result<Self, std::collections::TryReserveError> {
        let line_count = (len * size_of::<T>()).div_ceil(LINE_BYTES);
        let mut lines = Vec::new();
        lines.try_reserve_exact(line_count)?;
        lines.resize(line_count, Line([0; 8]));
        Ok(Self { lines, len, scalar: std::marker::PhantomData })
    }
}

impl<T: Scalar> std::ops::Deref for Buffer<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        // SAFETY: `zeroed` made at least `len * size_of::<T>()` initialised bytes, aligned for any scalar;
        // a `Scalar` (f32, f64) accepts every bit pattern; the borrow of `self` keeps the lines alive.
        unsafe { std::slice::from_raw_parts(self.lines.as_ptr().cast::<T>(), self.len) }
    }
}

impl<T: Scalar> std::ops::DerefMut for Buffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: as in `deref`; the unique borrow of `self` makes this the only view, and `Line` accepts
        // every bit pattern that is written through it.
        unsafe { std::slice::from_raw_parts_mut(self.lines.as_mut_ptr().cast::<T>(), self.len) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_is_zero_and_starts_on_a_cache_line() {
        let mut buffer = Buffer::<f32>::zeroed(37).expect("37 numbers fit");
        assert_eq!((buffer.len(), buffer.as_ptr() as usize % LINE_BYTES), (37, 0));
        assert!(buffer.iter().all(|&value| value == 0.0));
        buffer[36] = 1.5;
        assert_eq!(buffer[36], 1.5);
    }

    #[test]
    fn memory_that_cannot_be_had_is_an_error() {
        assert!(Buffer::<f64>::zeroed(usize::MAX / 64).is_err());
    }
}
