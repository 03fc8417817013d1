//! Which protocol versions there are, and how two ranges agree.

/// Oldest version this code speaks.
pub const PROTOCOL_MIN: u32 = 1;
/// Newest version this code speaks.
pub const PROTOCOL_MAX: u32 = 1;

/// The newest version in both `min..=max` and our own range; `None` where they do not meet.
#[must_use]
pub fn agree(min: u32, max: u32) -> Option<u32> {
    let newest = max.min(PROTOCOL_MAX);
    (min <= max && newest >= min.max(PROTOCOL_MIN)).then_some(newest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_agree_on_the_newest_version_they_share() {
        assert_eq!(agree(0, 99), Some(PROTOCOL_MAX));
        assert_eq!(agree(PROTOCOL_MAX, PROTOCOL_MAX), Some(PROTOCOL_MAX));
        assert_eq!(agree(PROTOCOL_MAX + 1, PROTOCOL_MAX + 2), None);
        assert_eq!(agree(0, PROTOCOL_MIN - 1), None);
        assert_eq!(agree(2, 1), None, "an empty range");
    }
}
