//! Memory stays where it is while a camera goes to and fro: counted by the allocator itself. A test of its own: the allocator is
//! the whole program's.

use earthshine_bake::Levels;
use earthshine_engine::{BackendFactory, Command, Engine, EngineConfig, Event, SessionId};
use earthshine_gen::fixtures;
use earthshine_light::Occluders;
use earthshine_radiosity::{Backend, CpuBackend};
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tiles::{DirStore, TileStore};
use earthshine_world::lineage::Lineage;
use earthshine_world::{Camera, ChunkId, Vec3};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes that are taken and not given back.
static HELD: AtomicUsize = AtomicUsize::new(0);

struct Counting;

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        HELD.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const ALICE: SessionId = SessionId(1);
/// Ticks of one lap: there and back.
const LAP_TICKS: u64 = 400;
const LAPS: usize = 8;

/// An engine whose tiles come in the tick after they were asked for.
struct Flight {
    engine: Engine,
    store: DirStore,
    answers: Vec<Event>,
    tick: u64,
}

impl Flight {
    fn new(world: &BakedWorld, config: EngineConfig) -> Self {
        let store = DirStore::open(world.path()).expect("a world");
        let backends: BackendFactory = Box::new(|slots| {
            Ok(Box::new(CpuBackend::new(slots).expect("a small matrix")) as Box<dyn Backend>)
        });
        let engine = Engine::new(store.manifest().index(), config, backends).expect("an engine");
        Self { engine, store, answers: vec![Event::SessionOpened { session: ALICE }], tick: 0 }
    }

    fn tick(&mut self) {
        self.tick += 1;
        let half = LAP_TICKS / 2;
        let way = self.tick % LAP_TICKS;
        let position = Vec3::new(1.0 + 0.1 * way.min(LAP_TICKS - way) as f32, 1.5, 1.5);
        let velocity = Vec3::X * if way < half { 6.0 } else { -6.0 };
        let camera = Camera { position, forward: Vec3::X, velocity };
        let mut events = std::mem::take(&mut self.answers);
        events.push(Event::Camera { session: ALICE, camera });
        let mut commands = Vec::new();
        self.engine.tick(self.tick as f64 / 60.0, events, &mut commands);
        for command in commands {
            if let Command::LoadTile { chunk } = command {
                let answer = self.load(chunk);
                self.answers.push(answer);
            }
        }
    }

    fn load(&self, id: ChunkId) -> Event {
        let mut chunk = self.store.load(id).expect("a sound tile");
        let occluders = Arc::new(Occluders::build(&std::mem::take(&mut chunk.occluders)));
        let mut lineage = Lineage::default();
        for &segment in &chunk.rows.segments {
            let mut id = segment;
            while lineage.of(id).is_none()
                && let Ok(Some(parents)) = self.store.parents(id)
            {
                lineage.insert(id, parents);
                id = id.parent();
            }
        }
        Event::TileDecoded { chunk: Arc::new(chunk), occluders, lineage: Arc::new(lineage) }
    }
}

/// Goal: what an engine holds depends on where its camera is, not on how long it has flown. Method: laps over a world of
/// which a part fits the memory for spare chunks; most bytes held in each lap but the first, which fills it.
#[test]
fn no_lap_takes_more_memory_than_the_one_before() {
    let scene = imported(&fixtures::corridor_glb(24.0));
    let lights = own_lights(&scene);
    let world = BakedWorld::with_levels("laps", &scene, lights, coarse(0.5, 8), Levels::Exactly(3));
    let config = EngineConfig {
        resident_patches_max: 300,
        coarse_patches_max: 200,
        load_radius_m: 6.0,
        spare_bytes_max: 500_000,
        ..EngineConfig::default()
    };
    let mut flight = Flight::new(&world, config);
    let before = HELD.load(Ordering::Relaxed);
    let mut most = [0; LAPS];
    for lap in &mut most {
        for _ in 0..LAP_TICKS {
            flight.tick();
            *lap = HELD.load(Ordering::Relaxed).saturating_sub(before).max(*lap);
        }
    }
    let stats = flight.engine.stats();
    assert!(stats.counters.evicted > 8 * LAPS as u64, "chunks come and go: {:?}", stats.counters);
    println!("most bytes held by lap: {most:?}; {} chunks evicted", stats.counters.evicted);
    for lap in &most[1..] {
        assert!(lap.abs_diff(most[1]) * 50 <= most[1], "more than 2 % off: {most:?}");
    }
}
