//! What a flight takes: resident memory lap by lap, bytes from storage, and pages dropped on purpose.

use anyhow::Context as _;
use rustix::fs::{Advice, fadvise};
use std::path::Path;

/// Memory and reads of this process while it flies.
pub(super) struct Footprint {
    /// Most resident memory in each lap.
    pub(super) rss_bytes: Vec<u64>,
    /// The most of it in each lap that is the process's own: no mapped file.
    pub(super) anonymous_bytes: Vec<u64>,
    pub(super) dropped_bytes: u64,
    read_before: u64,
    read_after: u64,
}

impl Footprint {
    pub(super) fn new(laps: u32) -> Self {
        let read = storage_bytes();
        let none = vec![0; laps as usize];
        Self {
            rss_bytes: none.clone(),
            anonymous_bytes: none,
            dropped_bytes: 0,
            read_before: read,
            read_after: read,
        }
    }

    /// In lap `lap`, or the last.
    pub(super) fn look(&mut self, lap: u32) {
        let lap = (lap as usize).min(self.rss_bytes.len() - 1);
        let [resident, of_files] = resident_bytes();
        let raise = |most: &mut u64, now: u64| *most = now.max(*most);
        raise(&mut self.rss_bytes[lap], resident);
        raise(&mut self.anonymous_bytes[lap], resident.saturating_sub(of_files));
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

/// Resident memory of this process, and what of it are mapped files; 0 where the system does not say.
fn resident_bytes() -> [u64; 2] {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages = |field: usize| text.split_whitespace().nth(field)?.parse::<u64>().ok();
    [1, 2].map(|field| pages(field).unwrap_or(0) * rustix::param::page_size() as u64)
}

/// Bytes that this process made the system fetch from storage; 0 where it does not say.
fn storage_bytes() -> u64 {
    let text = std::fs::read_to_string("/proc/self/io").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("read_bytes: "));
    line.and_then(|bytes| bytes.trim().parse().ok()).unwrap_or(0)
}
