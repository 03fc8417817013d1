//! A tick that has nothing to do takes no memory but lists of its sessions: counted by the allocator itself. A test of its own:
//! the allocator is the whole program's.

use earthshine_bake::Levels;
use earthshine_gen::fixtures;
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tests::on_disk::OnDisk;
use earthshine_tiles::BakeParameters;
use earthshine_world::Vec3;
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;

/// Bytes.
static TAKEN: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        TAKEN.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        TAKEN.fetch_add(size, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// What a tick lists its one session in, and its levels, B.
const LISTS_BYTES: usize = 512;

/// Goal: light at rest costs no memory, however large the world is. Method: a corridor with detail, coarse levels and light in the
/// air, of which a third fits; ticks after its light has settled.
#[test]
fn a_settled_tick_takes_no_memory_for_its_world() {
    let scene = imported(&fixtures::corridor_glb(16.0));
    let lights = own_lights(&scene);
    let parameters = BakeParameters { detail: 2, detail_rays: 64, ..coarse(1.0, 8) };
    let world = BakedWorld::with_levels("corridor", &scene, lights.clone(), parameters, Levels::Exactly(3));
    let mut engine = OnDisk::new(&world, |engine| engine);
    let before_light = TAKEN.load(Ordering::Relaxed);
    engine.settled_at(Vec3::new(4.0, 1.6, 1.5), &lights);
    assert!(TAKEN.load(Ordering::Relaxed) > before_light, "the count counts");
    // Room that is left over is given back meanwhile.
    (0..100).for_each(|_| assert!(engine.tick()));
    for tick in 0..1000 {
        let before = TAKEN.load(Ordering::Relaxed);
        assert!(engine.tick());
        let taken = TAKEN.load(Ordering::Relaxed) - before;
        assert!(taken <= LISTS_BYTES, "{taken} B in tick {tick}");
    }
}
