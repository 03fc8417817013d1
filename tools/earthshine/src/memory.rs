//! How the process takes memory from the system and gives it back: by jemalloc on Linux, by the C library elsewhere.
//!
//! Tiles are decoded on one thread and let go on another, some hundred kilobytes a list, for as long as a server runs, and each tick
//! takes lists as long for a moment. The GNU allocator lets the former share room with small things that stay, so that resident
//! memory grows lap by lap, and maps and unmaps the latter, which costs a tick a fifth of its time (DECISIONS.md).

#[cfg(target_os = "linux")]
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

/// Few arenas: each keeps room for itself. What is freed goes back after two seconds, by a thread that does nothing else: a tick
/// finds what the one before let go, and a server that rests gives it all back. A C string, by the name that jemalloc looks for.
#[cfg(target_os = "linux")]
#[used]
#[unsafe(export_name = "_rjem_malloc_conf")]
static SETTINGS: &[u8; 70] = b"narenas:4,dirty_decay_ms:2000,muzzy_decay_ms:0,background_thread:true\0";
