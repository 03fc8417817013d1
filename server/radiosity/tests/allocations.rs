//! Updates and frames take no memory once warm: counted by the allocator itself. A test of its own: the allocator is
//! the whole program's.

use earthshine_radiosity::bench::Streamed;
use earthshine_radiosity::closed_box::ClosedBox;
use earthshine_radiosity::{Backend, CpuBackend, Slot, Update};
use earthshine_world::Rgb;
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;

static TAKEN: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        TAKEN.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        TAKEN.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const SLOTS: usize = 200;

/// The same updates again and again: warm after the first round.
fn rounds() -> Vec<(Vec<Update>, Vec<Update>)> {
    let mut streamed = Streamed::new(ClosedBox::new(SLOTS, 4), SLOTS, 4);
    let enter = streamed.enter(SLOTS);
    let slots: Vec<Slot> = enter
        .iter()
        .map(|update| match update {
            Update::Add { slot, .. } | Update::Remove { slot } => *slot,
        })
        .collect();
    let leave =
        |count: usize| slots[SLOTS - count..].iter().rev().map(|&slot| Update::Remove { slot }).collect();
    [1, 3, 32, 70].map(|count| (leave(count), enter[SLOTS - count..].to_vec())).to_vec()
}

fn life(backend: &mut CpuBackend, rounds: &[(Vec<Update>, Vec<Update>)], slots: &[Slot], light: &[Rgb]) {
    for (leave, enter) in rounds {
        backend.apply(leave).expect("residents");
        backend.apply(enter).expect("free slots");
        backend.set_sources(slots, light, light).expect("taken slots");
        backend.step().expect("no device to lose");
        backend.repair(64).expect("no device to lose");
    }
}

#[test]
fn nothing_is_allocated_once_warm() {
    let mut streamed = Streamed::new(ClosedBox::new(SLOTS, 4), SLOTS, 4);
    let (rounds, slots) = (rounds(), (0..SLOTS as u32).map(Slot).collect::<Vec<_>>());
    let light: Vec<Rgb> = slots.iter().map(|slot| Rgb::splat(1.0 + slot.0 as f32)).collect();
    let mut backend = CpuBackend::new(SLOTS as u32).expect("small");
    backend.apply(&streamed.enter(SLOTS)).expect("free slots");
    // From within the pool: handing work to it from outside takes rayon a block of its queue every 63 times.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("a pool");
    let taken = pool.install(|| {
        for _ in 0..3 {
            life(&mut backend, &rounds, &slots, &light);
        }
        let before = TAKEN.load(Ordering::Relaxed);
        for _ in 0..10 {
            life(&mut backend, &rounds, &slots, &light);
        }
        TAKEN.load(Ordering::Relaxed) - before
    });
    assert_eq!(taken, 0);
    assert!(backend.drift(1) < 1e-6);
    assert!(TAKEN.load(Ordering::Relaxed) > 0, "the count counts");
}
