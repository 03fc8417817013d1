//! The one hash of everything on disk: xxh3, 64 bits.
//!
//! It finds accidents, not attackers; a file made to deceive is met by limits and structure checks.
//! It is applied to each frame as stored (compressed), to the section table and to the header. The
//! header's hash covers the table's hash, which covers the frames' hashes: it names the whole tile.

use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// Hash of `bytes`.
#[must_use]
pub fn hash(bytes: &[u8]) -> u64 {
    xxh3_64(bytes)
}

/// Hash of several pieces. Their lengths count: moving a byte from one piece to the next changes it.
#[must_use]
pub fn hash_parts(parts: &[&[u8]]) -> u64 {
    let mut state = Xxh3::new();
    for part in parts {
        state.update(&(part.len() as u64).to_le_bytes());
        state.update(part);
    }
    state.digest()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_the_published_one_and_parts_keep_their_borders() {
        assert_eq!(hash(b""), 0x2D06_8005_38D3_94C2, "xxh3-64 of nothing, seed 0");
        assert_ne!(hash_parts(&[b"ab", b"c"]), hash_parts(&[b"a", b"bc"]));
    }
}
