//! How the process takes memory from the system and gives it back: by jemalloc on Linux, by the C library elsewhere.
//!
//! Tiles are decoded on one thread and let go on another, some hundred kilobytes a list, for as long as a server runs, and each tick
//! takes lists as long for a moment. The GNU allocator lets the former share room with small things that stay, so that resident
//! memory grows lap by lap, and maps and unmaps the latter, which costs a tick a fifth of its time (DECISIONS.md). What the allocator
//! holds at a moment is told by [`heap`].

#[cfg(target_os = "linux")]
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

/// Few arenas: each keeps room for itself. What is freed goes back after a quarter of a second, by a thread that does nothing else: a
/// tick finds what the one before let go, and tiles that left are not memory for long. A C string, by the name that jemalloc looks
/// for.
#[cfg(target_os = "linux")]
#[used]
#[unsafe(export_name = "_rjem_malloc_conf")]
static SETTINGS: &[u8; 69] = b"narenas:4,dirty_decay_ms:250,muzzy_decay_ms:0,background_thread:true\0";

/// What the allocator holds, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub(crate) struct Heap {
    /// Asked for by the program, rounded up to what is handed out.
    pub(crate) allocated_bytes: u64,
    /// Pages with anything of that on them.
    pub(crate) active_bytes: u64,
    /// The same, those waiting to be used again or given back, and the allocator's own lists.
    pub(crate) resident_bytes: u64,
    /// The allocator's own lists.
    pub(crate) metadata_bytes: u64,
    /// Addresses that are kept without memory behind them.
    pub(crate) retained_bytes: u64,
}

/// What the allocator holds now; nothing where it does not say.
pub(crate) fn heap() -> Option<Heap> {
    #[cfg(target_os = "linux")]
    {
        use tikv_jemalloc_ctl::{epoch, stats};
        // The numbers are of the moment in which the epoch was advanced.
        epoch::advance().ok()?;
        let bytes = |read: tikv_jemalloc_ctl::Result<usize>| read.ok().map(|bytes| bytes as u64);
        Some(Heap {
            allocated_bytes: bytes(stats::allocated::read())?,
            active_bytes: bytes(stats::active::read())?,
            resident_bytes: bytes(stats::resident::read())?,
            metadata_bytes: bytes(stats::metadata::read())?,
            retained_bytes: bytes(stats::retained::read())?,
        })
    }
    #[cfg(not(target_os = "linux"))]
    None
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use tikv_jemalloc_ctl::{background_thread, opt};

    /// Goal: the settings above are in force, as a name that jemalloc does not look for would be passed over in silence.
    #[test]
    fn the_settings_are_in_force() {
        assert_eq!(opt::narenas::read().ok(), Some(4));
        assert_eq!(background_thread::read().ok(), Some(true));
        // SAFETY: both are numbers of this type, by jemalloc's documentation.
        let decay_ms = |name: &[u8]| unsafe { tikv_jemalloc_ctl::raw::read::<isize>(name) }.ok();
        assert_eq!(decay_ms(b"opt.dirty_decay_ms\0"), Some(250));
        assert_eq!(decay_ms(b"opt.muzzy_decay_ms\0"), Some(0));
    }

    #[test]
    fn the_heap_holds_what_is_taken() {
        let before = heap().expect("the allocator counts");
        // Far more than tests beside this one may give back meanwhile; not touched.
        let taken = vec![0u8; 512 << 20];
        let during = heap().expect("the allocator counts");
        assert!(during.allocated_bytes >= before.allocated_bytes + (256 << 20), "{before:?} {during:?}");
        assert!(
            during.active_bytes >= during.allocated_bytes && during.resident_bytes >= during.active_bytes
        );
        drop(taken);
    }
}
