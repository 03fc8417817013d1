//! What a flight takes: resident memory lap by lap, bytes from storage, and pages dropped on purpose.

use anyhow::Context as _;
use rustix::fs::{Advice, fadvise};
use std::path::Path;

/// Memory and reads of this process while it flies.
pub(super) struct Footprint {
    /// Most resident memory in each lap.
    pub(super) rss_bytes: Vec<u64>,
    pub(super) dropped_bytes: u64,
    read_before: u64,
    read_after: u64,
}

impl Footprint {
    pub(super) fn new(laps: u32) -> Self {
        let read = storage_bytes();
        Self { rss_bytes: vec![0; laps as usize], dropped_bytes: 0, read_before: read, read_after: read }
    }

    /// In lap `lap`, or the last.
    pub(super) fn look(&mut self, lap: u32) {
        let last = self.rss_bytes.len() - 1;
        let most = &mut self.rss_bytes[(lap as usize).min(last)];
        *most = (*most).max(rss_bytes());
    }

    pub(super) fn end(&mut self) {
        self.read_after = storage_bytes();
    }

    pub(super) fn read_bytes(&self) -> u64 {
        self.read_after.saturating_sub(self.read_before)
    }
}

/// Tells the kernel to drop what it holds of the files of the world in `folder`. Returns their size.
///
/// Pages that some process maps at the moment stay.
pub(super) fn drop_pages(folder: &Path) -> anyhow::Result<u64> {
    let mut bytes = 0;
    for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let entry = entry.with_context(|| folder.display().to_string())?;
        let path = entry.path();
        let kind = entry.file_type().with_context(|| path.display().to_string())?;
        if kind.is_dir() {
            bytes += drop_pages(&path)?;
        } else if kind.is_file() {
            let file = std::fs::File::open(&path).with_context(|| path.display().to_string())?;
            fadvise(&file, 0, None, Advice::DontNeed).with_context(|| path.display().to_string())?;
            bytes += file.metadata().with_context(|| path.display().to_string())?.len();
        }
    }
    Ok(bytes)
}

/// Resident memory of this process; 0 where the system does not say.
fn rss_bytes() -> u64 {
    let resident = |text: String| text.split_whitespace().nth(1)?.parse::<u64>().ok();
    let pages = std::fs::read_to_string("/proc/self/statm").ok().and_then(resident);
    pages.unwrap_or(0) * rustix::param::page_size() as u64
}

/// Bytes that this process made the system fetch from storage; 0 where it does not say.
fn storage_bytes() -> u64 {
    let text = std::fs::read_to_string("/proc/self/io").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("read_bytes: "));
    line.and_then(|bytes| bytes.trim().parse().ok()).unwrap_or(0)
}
