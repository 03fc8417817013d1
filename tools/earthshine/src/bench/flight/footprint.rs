//! What a flight takes: memory lap by lap and by who holds it, bytes from storage, and pages dropped on purpose.

use crate::memory::{self, Heap};
use anyhow::Context as _;
use earthshine_server::ServerMemory;
use rustix::fs::{Advice, fadvise};
use serde::Serialize;
use std::path::Path;

/// Memory and reads of this process while it flies.
pub(super) struct Footprint {
    pub(super) laps: Vec<LapMemory>,
    pub(super) dropped_bytes: u64,
    read_before: u64,
    read_after: u64,
}

/// Memory in one lap, bytes: what it was when most was resident.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub(super) struct LapMemory {
    /// Of the whole process: server, client and mapped files.
    pub(super) resident_bytes: u64,
    /// The process's own, when that was most.
    pub(super) anonymous_bytes: u64,
    /// Of what is resident, pages of mapped files: the program and tiles.
    pub(super) mapped_bytes: u64,
    /// What the allocator holds; nothing where it does not say.
    pub(super) heap: Option<Heap>,
    /// Who holds it in the server.
    pub(super) stores: ServerMemory,
    /// Asked for by others: the client, messages on their way, lists of a moment.
    pub(super) others_bytes: u64,
}

/// What is called how, and how to read it.
type Column = (&'static str, fn(&LapMemory) -> u64);

impl LapMemory {
    /// What is printed of a lap, one line each.
    pub(super) const COLUMNS: [Column; 15] = [
        ("resident", |lap| lap.resident_bytes),
        ("mapped files", |lap| lap.mapped_bytes),
        ("heap, resident", |lap| lap.heap.map_or(0, |heap| heap.resident_bytes)),
        ("heap, active", |lap| lap.heap.map_or(0, |heap| heap.active_bytes)),
        ("heap, allocated", |lap| lap.heap.map_or(0, |heap| heap.allocated_bytes)),
        ("tiles", |lap| lap.stores.engine.tile_bytes),
        ("spare tiles", |lap| lap.stores.engine.spare_tile_bytes),
        ("matrices", |lap| lap.stores.engine.matrix_bytes),
        ("rows", |lap| lap.stores.engine.row_bytes),
        ("resident patches", |lap| lap.stores.engine.resident_bytes),
        ("receivers", |lap| lap.stores.engine.receiver_bytes),
        ("frames", |lap| lap.stores.engine.frame_bytes),
        ("parents", |lap| lap.stores.parent_bytes),
        ("told", |lap| lap.stores.told_bytes),
        ("others", |lap| lap.others_bytes),
    ];

    fn now(stores: ServerMemory) -> Self {
        let [resident_bytes, mapped_bytes] = resident_bytes();
        let heap = memory::heap();
        let allocated = heap.map_or(0, |heap| heap.allocated_bytes);
        Self {
            resident_bytes,
            anonymous_bytes: resident_bytes.saturating_sub(mapped_bytes),
            mapped_bytes,
            heap,
            stores,
            others_bytes: allocated.saturating_sub(stores.total_bytes()),
        }
    }
}

impl Footprint {
    pub(super) fn new(laps: u32) -> Self {
        let read = storage_bytes();
        let laps = vec![LapMemory::default(); laps as usize];
        Self { laps, dropped_bytes: 0, read_before: read, read_after: read }
    }

    /// In lap `lap`, or the last, while the server holds `stores`.
    pub(super) fn look(&mut self, lap: u32, stores: ServerMemory) {
        let last = self.laps.len() - 1;
        let most = &mut self.laps[(lap as usize).min(last)];
        let now = LapMemory::now(stores);
        let anonymous_bytes = now.anonymous_bytes.max(most.anonymous_bytes);
        if now.resident_bytes > most.resident_bytes {
            *most = now;
        }
        most.anonymous_bytes = anonymous_bytes;
    }

    /// One number of each lap.
    pub(super) fn by_lap(&self, of: impl Fn(&LapMemory) -> u64) -> Vec<u64> {
        self.laps.iter().map(of).collect()
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
