//! Plain words to bytes and back, for the files of the work folder. Nothing here trusts a length.

/// Appends words.
#[derive(Debug, Default)]
pub(crate) struct Writer(pub(crate) Vec<u8>);

impl Writer {
    pub(crate) fn u32(&mut self, word: u32) {
        self.0.extend(word.to_le_bytes());
    }

    pub(crate) fn u64(&mut self, word: u64) {
        self.0.extend(word.to_le_bytes());
    }

    pub(crate) fn u32s(&mut self, words: impl IntoIterator<Item = u32>) {
        words.into_iter().for_each(|word| self.u32(word));
    }

    pub(crate) fn i32s(&mut self, words: [i32; 3]) {
        self.u32s(words.map(i32::cast_unsigned));
    }

    pub(crate) fn f32s(&mut self, words: impl IntoIterator<Item = f32>) {
        self.u32s(words.into_iter().map(f32::to_bits));
    }
}

/// Takes words off the front; `None` once they run out.
#[derive(Debug)]
pub(crate) struct Reader<'a>(pub(crate) &'a [u8]);

impl<'a> Reader<'a> {
    /// The next `count` bytes.
    pub(crate) fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        let (word, rest) = self.0.split_first_chunk::<4>()?;
        self.0 = rest;
        Some(u32::from_le_bytes(*word))
    }

    pub(crate) fn u64(&mut self) -> Option<u64> {
        let (word, rest) = self.0.split_first_chunk::<8>()?;
        self.0 = rest;
        Some(u64::from_le_bytes(*word))
    }

    /// A number of things of which each takes `bytes` at least: no more than there can be.
    pub(crate) fn count(&mut self, bytes: usize) -> Option<usize> {
        let count = self.u32()? as usize;
        (count.checked_mul(bytes)? <= self.0.len()).then_some(count)
    }

    pub(crate) fn f32(&mut self) -> Option<f32> {
        self.u32().map(f32::from_bits)
    }

    pub(crate) fn f32s<const N: usize>(&mut self) -> Option<[f32; N]> {
        let mut words = [0.0; N];
        for word in &mut words {
            *word = self.f32()?;
        }
        Some(words)
    }

    pub(crate) fn i32s(&mut self) -> Option<[i32; 3]> {
        let mut words = [0; 3];
        for word in &mut words {
            *word = self.u32()?.cast_signed();
        }
        Some(words)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}
