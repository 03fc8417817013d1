//! A camera flies through a baked world whose disk fails it: the engine and real tiles in virtual time.

use earthshine_bake::Levels;
use earthshine_engine::{BackendFactory, ChunkState, Command, Engine, EngineConfig, Event, Frame, SessionId};
use earthshine_gen::fixtures;
use earthshine_light::Occluders;
use earthshine_radiosity::{Backend, CpuBackend};
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tiles::fault::Fault;
use earthshine_tiles::{DirStore, FaultPlan, FaultyStore, TileStore};
use earthshine_world::lineage::Lineage;
use earthshine_world::{Camera, Chunk, ChunkId, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

const TICK_S: f64 = 1.0 / 60.0;
const ALICE: SessionId = SessionId(1);

fn corridor(length_m: f32) -> BakedWorld {
    let scene = imported(&fixtures::corridor_glb(length_m));
    let lights = own_lights(&scene);
    BakedWorld::with_levels("corridor", &scene, lights, coarse(0.5, 8), Levels::Exactly(3))
}

/// An engine and a loader in virtual time: each load takes a tick, a slow one as long as the plan says.
struct Flight<'a> {
    engine: Engine,
    store: &'a FaultyStore<DirStore>,
    plan: FaultPlan,
    attempts: BTreeMap<ChunkId, u64>,
    now_s: f64,
    /// Answers by the tick in which they come.
    answers: BTreeMap<u64, Vec<Event>>,
    tick: u64,
    newest: Option<Arc<Frame>>,
    causes: Vec<String>,
}

impl<'a> Flight<'a> {
    fn new(store: &'a FaultyStore<DirStore>, plan: FaultPlan, config: EngineConfig) -> Self {
        let backends: BackendFactory = Box::new(|slots| {
            Ok(Box::new(CpuBackend::new(slots).expect("a small matrix")) as Box<dyn Backend>)
        });
        let engine = Engine::new(store.inner().manifest().index(), config, backends).expect("an engine");
        let answers = BTreeMap::from([(1, vec![Event::SessionOpened { session: ALICE }])]);
        let (attempts, causes) = (BTreeMap::new(), Vec::new());
        Self { engine, store, plan, attempts, now_s: 0.0, answers, tick: 0, newest: None, causes }
    }

    /// One tick with the camera at `position`. Returns whether all is settled.
    fn tick(&mut self, position: Vec3, velocity: Vec3) -> bool {
        self.tick += 1;
        self.now_s += TICK_S;
        let mut events = self.answers.remove(&self.tick).unwrap_or_default();
        events
            .push(Event::Camera { session: ALICE, camera: Camera { position, forward: Vec3::X, velocity } });
        let mut commands = Vec::new();
        let stats = self.engine.tick(self.now_s, events, &mut commands);
        self.engine.validate().expect("invariants hold after every tick");
        for command in commands {
            match command {
                Command::LoadTile { chunk } => self.load(chunk),
                Command::CancelTile { .. } => {}
                Command::PublishFrame { frame } => self.newest = Some(frame),
            }
        }
        stats.settled
    }

    fn load(&mut self, id: ChunkId) {
        let attempt = self.attempts.entry(id).or_default();
        let is_slow = self.plan.fault_of(id, *attempt) == Fault::Slow;
        *attempt += 1;
        let late = if is_slow { (self.plan.delay.as_secs_f64() / TICK_S).ceil() as u64 } else { 0 };
        let answer = match self.store.load(id) {
            Ok(chunk) => decoded(self.store.inner(), chunk),
            Err(error) => {
                self.causes.push(error.to_string());
                Event::TileFailed { chunk: id, cause: error.to_string() }
            }
        };
        self.answers.entry(self.tick + 1 + late).or_default().push(answer);
    }

    fn settle(&mut self, position: Vec3) {
        let settled = (0..4000).any(|_| self.tick(position, Vec3::ZERO) && self.answers.is_empty());
        assert!(settled, "not at rest after 4,000 ticks: {:?}", self.engine.stats());
    }

    fn newest(&self) -> &Frame {
        self.newest.as_ref().expect("a frame")
    }
}

fn decoded(store: &DirStore, mut chunk: Chunk) -> Event {
    let occluders = Arc::new(Occluders::build(&std::mem::take(&mut chunk.occluders)));
    let mut lineage = Lineage::default();
    for &segment in &chunk.rows.segments {
        let mut id = segment;
        while lineage.of(id).is_none()
            && let Ok(Some(parents)) = store.parents(id)
        {
            lineage.insert(id, parents);
            id = id.parent();
        }
    }
    Event::TileDecoded { chunk: Arc::new(chunk), occluders, lineage: Arc::new(lineage) }
}

fn config() -> EngineConfig {
    EngineConfig {
        resident_patches_max: 300,
        coarse_patches_max: 200,
        // What is resident at rest must not depend on the way there.
        hysteresis: 0.0,
        load_radius_m: 6.0,
        retry_after_s: 0.05,
        retries_max: 5,
        quarantine_s: 0.5,
        ..EngineConfig::default()
    }
}

fn along(tick: u64) -> Vec3 {
    Vec3::new(1.0 + tick as f32 * 0.1, 1.5, 1.5)
}

/// Goal: tiles that are missing, torn, flipped and 100 ms late cost a while of light, never a crash, a black frame or a stall.
/// Method: the same flight over a sound store and over a third of faulty loads, for some seeds; both end with the same
/// light.
#[test]
fn a_flight_over_a_failing_disk_ends_with_the_light_of_a_sound_one() {
    let world = corridor(24.0);
    let delay = Duration::from_millis(100);
    let end = along(200);
    let sound_plan = FaultPlan::none(1);
    // The store itself need not sleep: lateness is virtual.
    let store = |plan: FaultPlan| {
        let inner = DirStore::open(world.path()).expect("a world");
        FaultyStore::new(inner, FaultPlan { delay: Duration::ZERO, ..plan })
    };
    let sound_store = store(sound_plan);
    let mut sound = Flight::new(&sound_store, sound_plan, config());
    sound.settle(end);
    for seed in 0..4 {
        let plan = FaultPlan {
            seed,
            slow_rate: 0.2,
            missing_rate: 0.12,
            torn_rate: 0.12,
            flipped_rate: 0.12,
            delay,
        };
        let faulty_store = store(plan);
        let mut flight = Flight::new(&faulty_store, plan, config());
        let mut dark = 0;
        for tick in 0..200 {
            flight.tick(along(tick), Vec3::X * 6.0);
            let has_light = flight.newest.as_ref().is_some_and(|frame| {
                !frame.patches.is_empty() || frame.coarse.iter().any(|level| !level.patches.is_empty())
            });
            dark += u64::from(tick > 60 && !has_light);
        }
        assert_eq!(dark, 0, "seed {seed}: once there is light there is always some");
        flight.settle(end);
        let counters = flight.engine.stats().counters;
        assert!(counters.tile_failures > 3 && !flight.causes.is_empty(), "{counters:?}");
        // A quarantined chunk comes back when its time is up and its tile is sound.
        while flight.engine.chunk_states().any(|(_, state)| state == ChunkState::Quarantined) {
            flight.tick(end, Vec3::ZERO);
        }
        flight.settle(end);
        assert_eq!(flight.newest().patches.len(), sound.newest().patches.len(), "seed {seed}");
        for (a, b) in flight.newest().patches.iter().zip(sound.newest().patches.iter()) {
            assert_eq!((a.voxel, a.direction), (b.voxel, b.direction));
            let close = (a.irradiance - b.irradiance).abs().max_element();
            assert!(close <= 2e-3 * b.irradiance.max_element() + 1e-3, "{a:?} {b:?}");
        }
    }
}

/// Goal: where every read takes 100 ms a flight goes on: every tick has light, it rests on less for a while, and on all again
/// once the camera stands. Method: one read at a time, and a camera that outruns it.
#[test]
fn a_disk_that_takes_100_ms_a_read_costs_quality_for_a_while() {
    let world = corridor(24.0);
    let plan = FaultPlan { slow_rate: 1.0, delay: Duration::from_millis(100), ..FaultPlan::none(1) };
    let inner = DirStore::open(world.path()).expect("a world");
    // The store itself need not sleep: lateness is virtual.
    let store = FaultyStore::new(inner, FaultPlan { delay: Duration::ZERO, ..plan });
    let config = EngineConfig {
        // All that is in reach has a slot: what is missing is not loaded.
        resident_patches_max: 3000,
        tiles_in_flight_max: 1,
        tile_look_ahead_s: 0.0,
        spare_bytes_max: 0,
        ..config()
    };
    let mut flight = Flight::new(&store, plan, config);
    let resident = |flight: &Flight<'_>| {
        let quality = flight.newest().quality;
        f64::from(quality.resident_patches) / f64::from(quality.wanted_patches)
    };
    flight.settle(along(0));
    assert_eq!(resident(&flight), 1.0);
    let mut worst = 1.0f64;
    for tick in 0..50 {
        flight.tick(along(tick * 4), Vec3::X * 24.0);
        worst = worst.min(resident(&flight));
        assert!(flight.newest().coarse.iter().any(|level| !level.patches.is_empty()), "tick {tick} is black");
    }
    assert!(worst < 0.8, "the camera outruns the disk: {worst}");
    flight.settle(along(200));
    assert_eq!((resident(&flight), flight.newest().quality.stale_direct), (1.0, 0));
    assert!(flight.causes.is_empty(), "{:?}", flight.causes);
}

/// Goal: files that are deleted or replaced by another world's under a running engine cost what is not loaded yet, and say so;
/// what is loaded stays. Method: both are done to all tiles while the camera stands at one end.
#[test]
fn files_deleted_and_swapped_under_a_flight_cost_only_what_comes_later() {
    for is_swapped in [false, true] {
        let (world, other) = (corridor(24.0), corridor(20.0));
        let plan = FaultPlan::none(1);
        let store = FaultyStore::new(DirStore::open(world.path()).expect("a world"), plan);
        let mut flight = Flight::new(&store, plan, EngineConfig { retries_max: 0, ..config() });
        flight.settle(along(0));
        let before = flight.newest().patches.len();
        assert!(before > 0);
        let others = DirStore::open(other.path()).expect("a world");
        for chunk in &store.inner().manifest().chunks {
            let path = store.inner().path_of(chunk.id()).expect("a path");
            match others.path_of(chunk.id()).filter(|_| is_swapped) {
                Some(foreign) => drop(std::fs::copy(foreign, path).expect("a scratch folder")),
                None => std::fs::remove_file(path).expect("a scratch folder"),
            }
        }
        flight.settle(along(0));
        assert_eq!((flight.newest().patches.len(), flight.causes.len()), (before, 0));
        for tick in 0..200 {
            flight.tick(along(tick), Vec3::X * 6.0);
        }
        let stats = flight.engine.stats();
        assert!(stats.counters.quarantined > 0, "{stats:?}");
        assert!(!flight.causes.is_empty(), "each failure has its cause");
        assert!(flight.causes.iter().all(|cause| cause.contains("tile")), "{:?}", flight.causes);
    }
}
