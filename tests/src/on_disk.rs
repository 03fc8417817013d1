//! [`OnDisk`]: one engine over a world on disk, without a server: whoever holds it ticks it, and tiles come at once.

use crate::baked::BakedWorld;
use earthshine_engine::{Command, Engine, EngineConfig, Event, Frame, SessionId};
use earthshine_light::Occluders;
use earthshine_radiosity::CpuBackend;
use earthshine_tiles::{DirStore, TileStore};
use earthshine_world::lineage::Lineage;
use earthshine_world::{Camera, Chunk, ChunkId, LightRig, Vec3};
use std::sync::Arc;
use std::time::{Duration, Instant};

const ALICE: SessionId = SessionId(1);
/// Ticks wait for no device, so how many it takes says nothing.
const PATIENCE: Duration = Duration::from_secs(120);

/// An engine with one session, on the CPU but for what its maker added.
#[derive(Debug)]
pub struct OnDisk {
    engine: Engine,
    store: DirStore,
    events: Vec<Event>,
    commands: Vec<Command>,
    ticks: u32,
    frame: Option<Arc<Frame>>,
}

impl OnDisk {
    /// Over `world`, with a third of its patches resident; `added` may give the engine a device.
    ///
    /// # Panics
    /// If there is no such world.
    #[must_use]
    pub fn new(world: &BakedWorld, added: impl FnOnce(Engine) -> Engine) -> Self {
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
        let engine = Engine::new(store.manifest().index(), config, Box::new(backend)).expect("a sound index");
        let events = vec![Event::SessionOpened { session: ALICE }];
        Self { engine: added(engine), store, events, commands: Vec::new(), ticks: 0, frame: None }
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

    /// Ticks once, with what has happened since the last time; whether nothing is left to do.
    ///
    /// # Panics
    /// If a tile is damaged.
    pub fn tick(&mut self) -> bool {
        self.ticks += 1;
        let now_s = f64::from(self.ticks) / 60.0;
        let mut commands = std::mem::take(&mut self.commands);
        let stats = self.engine.tick(now_s, std::mem::take(&mut self.events), &mut commands);
        for command in commands.drain(..) {
            match command {
                Command::LoadTile { chunk } => self.events.push(self.tile(chunk)),
                Command::CancelTile { .. } => {}
                Command::PublishFrame { frame } => self.frame = Some(frame),
            }
        }
        self.commands = commands;
        stats.settled && self.events.is_empty()
    }

    /// Looks from `position` until the light is settled; the frame that says so.
    ///
    /// # Panics
    /// If it never does, or an invariant of the engine breaks.
    pub fn settled_at(&mut self, position: Vec3, lights: &LightRig) -> Arc<Frame> {
        self.events.push(Event::Lights { session: ALICE, lights: lights.clone() });
        let camera = Camera { position, forward: Vec3::X, velocity: Vec3::ZERO };
        self.events.push(Event::Camera { session: ALICE, camera });
        let began = Instant::now();
        loop {
            let is_settled = self.tick();
            self.engine.validate().expect("invariants hold");
            if is_settled {
                break;
            }
            assert!(began.elapsed() < PATIENCE, "not settled: {:?}", self.engine.stats());
        }
        Arc::clone(self.frame.as_ref().expect("settled light is published"))
    }
}
