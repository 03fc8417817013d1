//! Direct light computed, receivers and far light gathered on a device, in an engine that streams a world from disk: what it
//! tells is what an engine on the CPU tells. Without an adapter the test says why it is skipped.

use earthshine_bake::Levels;
use earthshine_engine::{Command, Engine, EngineConfig, Event, Frame, PatchLight, SessionId};
use earthshine_gen::fixtures;
use earthshine_gpu::GpuDevice;
use earthshine_gpu::direct::GpuDirect;
use earthshine_gpu::receivers::GpuReceivers;
use earthshine_light::{DirectLight, LightUnderWay, OccluderSet, Occluders, PatchPoints};
use earthshine_radiosity::CpuBackend;
use earthshine_radiosity::receivers::{ReceiverGather, ReceiverLight, ReceiverSums};
use earthshine_tests::adapter::device_or_skip;
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tiles::{BakeParameters, DirStore, TileStore};
use earthshine_world::lineage::Lineage;
use earthshine_world::{Asked, Camera, Chunk, ChunkId, Light, LightRig, Rgb, Sky, Vec3};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

const ALICE: SessionId = SessionId(1);
/// Ticks wait for no device, so how many it takes says nothing.
const PATIENCE: Duration = Duration::from_secs(120);

/// A device whose answers are counted.
#[derive(Debug)]
struct Counted {
    receivers: GpuReceivers,
    answers: Arc<AtomicU64>,
}

impl ReceiverLight for Counted {
    fn rows_max(&self) -> usize {
        self.receivers.rows_max()
    }

    fn begin(&mut self, gather: &ReceiverGather<'_>) -> bool {
        self.receivers.begin(gather)
    }

    fn take(&mut self) -> Asked<Vec<ReceiverSums>> {
        let gathering = self.receivers.take();
        let is_answer = matches!(&gathering, Asked::Done(sums) if !sums.is_empty());
        self.answers.fetch_add(u64::from(is_answer), Ordering::Relaxed);
        gathering
    }
}

/// A device that lights however few patches.
#[derive(Debug)]
struct Eager(GpuDirect);

impl DirectLight for Eager {
    fn rays_min(&self) -> usize {
        if self.0.rays_min() == usize::MAX { usize::MAX } else { 0 }
    }

    fn begin(
        &mut self,
        occluders: &OccluderSet,
        lights: &[Light],
        patches: &[PatchPoints<'_>],
        wants_points: bool,
    ) -> Option<Box<dyn LightUnderWay>> {
        self.0.begin(occluders, lights, patches, wants_points)
    }
}

/// One engine over a world on disk, whose tiles come at once.
struct Streamed {
    engine: Engine,
    store: DirStore,
    events: Vec<Event>,
    ticks: u32,
    frame: Option<Arc<Frame>>,
    /// Gathers that a device has answered.
    answers: Arc<AtomicU64>,
}

impl Streamed {
    /// With a third of the patches resident; lit and gathered on `device`, if any.
    fn new(world: &BakedWorld, device: Option<&GpuDevice>) -> Self {
        let store = DirStore::open(world.path()).expect("a world");
        let config = EngineConfig {
            resident_patches_max: world.patch_count() / 3,
            load_radius_m: 1000.0,
            adds_per_tick_max: 256,
            removals_per_tick_max: 256,
            shadow_points_per_tick_max: 1 << 20,
            ..EngineConfig::default()
        };
        let backend = |slots| Ok(Box::new(CpuBackend::new(slots).expect("a small matrix")) as _);
        let mut engine =
            Engine::new(store.manifest().index(), config, Box::new(backend)).expect("a sound index");
        let answers = Arc::new(AtomicU64::default());
        if let Some(device) = device.cloned() {
            engine = engine.lit_by(|| Box::new(Eager(GpuDirect::new(&device).expect("room"))));
            let answers = Arc::clone(&answers);
            let make = move || {
                let receivers = GpuReceivers::new(&device).expect("a small buffer");
                Box::new(Counted { receivers, answers: Arc::clone(&answers) }) as _
            };
            engine = engine.gathered_by(Box::new(make));
        }
        let events = vec![Event::SessionOpened { session: ALICE }];
        Self { engine, store, events, ticks: 0, frame: None, answers }
    }

    fn lineage_of(&self, chunk: &Chunk) -> Arc<Lineage> {
        let mut lineage = Lineage::default();
        for &segment in chunk.rows.segments.iter().chain(&chunk.receivers.rows.segments) {
            let mut id = segment;
            while lineage.of(id).is_none()
                && let Some(parents) = self.store.parents(id).expect("a sound tile")
            {
                lineage.insert(id, parents);
                id = id.parent();
            }
        }
        Arc::new(lineage)
    }

    fn tile(&self, id: ChunkId) -> Event {
        let chunk = self.store.load(id).expect("a sound tile");
        let (occluders, lineage) = (Arc::new(Occluders::build(&chunk.occluders)), self.lineage_of(&chunk));
        Event::TileDecoded { chunk: Arc::new(chunk), occluders, lineage }
    }

    /// Ticks once; whether nothing is left to do.
    fn tick(&mut self) -> bool {
        self.ticks += 1;
        let mut commands = Vec::new();
        let now_s = f64::from(self.ticks) / 60.0;
        let stats = self.engine.tick(now_s, std::mem::take(&mut self.events), &mut commands);
        self.engine.validate().expect("invariants hold");
        for command in commands {
            match command {
                Command::LoadTile { chunk } => self.events.push(self.tile(chunk)),
                Command::CancelTile { .. } => {}
                Command::PublishFrame { frame } => self.frame = Some(frame),
            }
        }
        stats.settled && self.events.is_empty()
    }

    /// Looks from `position` until the light is settled.
    fn settled_at(&mut self, position: Vec3, lights: &LightRig) -> Arc<Frame> {
        self.events.push(Event::Lights { session: ALICE, lights: lights.clone() });
        let camera = Camera { position, forward: Vec3::X, velocity: Vec3::ZERO };
        self.events.push(Event::Camera { session: ALICE, camera });
        let began = Instant::now();
        while !self.tick() {
            assert!(began.elapsed() < PATIENCE, "not settled: {:?}", self.engine.stats());
        }
        Arc::clone(self.frame.as_ref().expect("settled light is published"))
    }
}

fn assert_lights(found: &[PatchLight], expected: &[PatchLight], what: &str) {
    let place = |light: &PatchLight| (light.voxel.to_array(), light.direction);
    assert!(found.iter().map(place).eq(expected.iter().map(place)), "{what}: the same are told");
    assert!(found.len() > 20, "{what}: {}", found.len());
    let brightest = expected.iter().map(|light| light.irradiance.max_element()).fold(0.0, f32::max);
    for (found, expected) in found.iter().zip(expected) {
        let light = |of: &PatchLight| [of.irradiance, of.sky_irradiance];
        for (found, expected) in light(found).into_iter().zip(light(expected)) {
            let gap = (found - expected).abs().max_element();
            assert!(gap <= 1e-5 * brightest, "{what}: {found} for {expected}, of {brightest}");
        }
        let shares = |of: &PatchLight| [of.known_share, of.far_share, of.fed_share];
        for (found, expected) in shares(found).into_iter().zip(shares(expected)) {
            assert!((found - expected).abs() <= 1e-5, "{what}: {found} for {expected}");
        }
    }
}

/// Goal: a device tells the light of the air and of detail that the CPU tells, wherever the camera is, and nobody notices
/// when it is gone. Method: a corridor with detail, three levels and a third of its patches resident; a lamp near a wall; places
/// one after the other, before the last of which the device is destroyed.
#[test]
fn an_engine_that_gathers_on_a_device_tells_what_the_cpu_tells() {
    let Some(device) = device_or_skip() else { return };
    let scene = imported(&fixtures::corridor_glb(16.0));
    let parameters = BakeParameters { detail: 2, detail_rays: 64, ..coarse(1.0, 8) };
    let world =
        BakedWorld::with_levels("corridor", &scene, own_lights(&scene), parameters, Levels::Exactly(3));
    let lamp = |x: f32| {
        let light =
            Light::Point { position: Vec3::new(x, 1.6, 0.4), intensity: Rgb::splat(200.0), range_m: None };
        let sky = Sky { lobes: [1.0, 2.0, 4.0, 8.0, 16.0, 32.0].map(Rgb::splat) };
        LightRig { lights: vec![light], sky, ..own_lights(&scene) }
    };
    let (mut on_cpu, mut on_device) = (Streamed::new(&world, None), Streamed::new(&world, Some(&device)));
    for x in [2.0, 8.0, 14.0, 2.0, 5.0] {
        let answers_before = on_device.answers.load(Ordering::Relaxed);
        if x == 5.0 {
            device.destroy();
        }
        let position = Vec3::new(x, 1.6, 1.5);
        let expected = on_cpu.settled_at(position, &lamp(x));
        let found = on_device.settled_at(position, &lamp(x));
        let answers = on_device.answers.load(Ordering::Relaxed) - answers_before;
        assert_eq!(answers > 0, !device.is_lost(), "{answers} answers");
        assert!(expected.receivers.iter().any(|light| light.fed_share > 0.01), "far light takes part");
        assert_lights(&found.receivers, &expected.receivers, "air");
        assert_lights(&found.details, &expected.details, "detail");
        assert_lights(&found.patches, &expected.patches, "patches");
        // Light at rest crosses no bus, and what changes for a moment only as far as it changes.
        let read_back = device.read_back_bytes();
        (0..20).for_each(|_| assert!(on_device.tick()));
        assert_eq!(device.read_back_bytes(), read_back, "nothing changes");
    }
    let read_back = device.read_back_bytes();
    for what in ["direct light", "far light", "receivers"] {
        assert!(read_back.get(what).is_some_and(|&bytes| bytes > 0), "{what}: {read_back:?}");
    }
}
