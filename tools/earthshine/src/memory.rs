//! How the process takes memory from the system and gives it back.
//!
//! Tiles are decoded on one thread and let go on another, some hundred kilobytes a list, for as long as a server runs. The GNU
//! allocator answers that with an arena a thread and a threshold that grows, up to which lists share pages with small things
//! and keep them: in the same flight 994 MB resident where 645 do (DECISIONS.md). So the arenas are few and the threshold stays.

/// Lists from this size on have pages of their own, which go back as soon as they are let go, bytes.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const OWN_PAGES_BYTES: i32 = 128 << 10;
/// Free memory at the end of an arena that is kept, bytes.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const KEPT_BYTES: i32 = 1 << 20;
/// Arenas: one for the engine's thread and one for all the others, as far as chance has it.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const ARENAS: i32 = 2;

/// Has the allocator give memory back. To be called before there are threads; elsewhere than with GNU's it does nothing.
pub(crate) fn give_back_what_is_freed() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    for (setting, value) in [
        (libc::M_MMAP_THRESHOLD, OWN_PAGES_BYTES),
        (libc::M_TRIM_THRESHOLD, KEPT_BYTES),
        (libc::M_ARENA_MAX, ARENAS),
    ] {
        // SAFETY: `mallopt` takes two numbers and changes how the allocator goes on; no memory is touched by it, and one that it
        // does not know it refuses.
        let is_set = unsafe { libc::mallopt(setting, value) };
        if is_set == 0 {
            eprintln!("the allocator refused setting {setting}: memory may stay taken longer");
        }
    }
}
