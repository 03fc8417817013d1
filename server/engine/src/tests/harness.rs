//! One engine over one in-memory world, with a loader that answers at once.

use super::backend::{Faults, GatherBackend};
use super::world::RandomWorld;
use crate::{BackendFactory, Command, Engine, EngineConfig, Event, Frame, SessionId, TickStats};
use earthshine_world::{Camera, ChunkId, Light, LightRig, Rgb, Vec3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

pub(crate) const ALICE: SessionId = SessionId(1);
pub(crate) const BOB: SessionId = SessionId(2);

pub(crate) struct Harness {
    pub(crate) engine: Engine,
    pub(crate) world: RandomWorld,
    pub(crate) now_s: f64,
    pub(crate) frames: BTreeMap<SessionId, Arc<Frame>>,
    pub(crate) requests: Vec<ChunkId>,
    pub(crate) cancels: Vec<ChunkId>,
    /// Tiles that cannot be had.
    pub(crate) broken: BTreeSet<ChunkId>,
    pub(crate) events: Vec<Event>,
}

pub(crate) fn factory(faults: Faults) -> BackendFactory {
    let steps = Arc::new(AtomicU64::new(0));
    Box::new(move |capacity| Ok(Box::new(GatherBackend::new(capacity, faults, Arc::clone(&steps)))))
}

pub(crate) fn still(position: Vec3) -> Camera {
    Camera { position, forward: Vec3::X, velocity: Vec3::ZERO }
}

pub(crate) fn lamp(position: Vec3) -> LightRig {
    let light = Light::Point { position, intensity: Rgb::splat(100.0), range_m: None };
    LightRig { lights: vec![light], ..LightRig::emission_only() }
}

/// Everything in reach and memory, no hysteresis, generous budgets.
pub(crate) fn generous(resident_patches_max: u32) -> EngineConfig {
    EngineConfig { resident_patches_max, load_radius_m: 100.0, hysteresis: 0.0, ..EngineConfig::default() }
}

impl Harness {
    pub(crate) fn new(world: RandomWorld, config: EngineConfig, faults: Faults) -> Self {
        Self::with_backends(world, config, factory(faults))
    }

    pub(crate) fn with_backends(world: RandomWorld, config: EngineConfig, backends: BackendFactory) -> Self {
        let engine = Engine::new(world.index.clone(), config, backends).unwrap();
        Self {
            engine,
            world,
            now_s: 0.0,
            frames: BTreeMap::new(),
            requests: Vec::new(),
            cancels: Vec::new(),
            broken: BTreeSet::new(),
            events: Vec::new(),
        }
    }

    /// With one session whose camera stands at `position`.
    pub(crate) fn with_camera(mut self, position: Vec3) -> Self {
        self.events.push(Event::SessionOpened { session: ALICE });
        self.look_from(ALICE, position);
        self
    }

    pub(crate) fn look_from(&mut self, session: SessionId, position: Vec3) {
        self.events.push(Event::Camera { session, camera: still(position) });
    }

    pub(crate) fn light(&mut self, session: SessionId, lights: LightRig) {
        self.events.push(Event::Lights { session, lights });
    }

    pub(crate) fn tile(&self, chunk: ChunkId) -> Event {
        Event::TileDecoded {
            chunk: Arc::clone(&self.world.chunks[&chunk]),
            occluders: Arc::clone(&self.world.occluders[&chunk]),
            lineage: self.world.lineage_of(&self.world.chunks[&chunk]),
        }
    }

    /// One tick with the waiting events; answers to its requests wait for the next.
    pub(crate) fn tick(&mut self) -> TickStats {
        let mut commands = Vec::new();
        self.now_s += 1.0 / 60.0;
        let stats = self.engine.tick(self.now_s, std::mem::take(&mut self.events), &mut commands);
        self.engine.validate().unwrap();
        for command in commands {
            match command {
                Command::LoadTile { chunk } => {
                    self.requests.push(chunk);
                    let answer = if self.broken.contains(&chunk) {
                        Event::TileFailed { chunk, cause: "broken for the test".to_owned() }
                    } else {
                        self.tile(chunk)
                    };
                    self.events.push(answer);
                }
                Command::CancelTile { chunk } => {
                    self.cancels.push(chunk);
                    self.events.retain(
                        |event| !matches!(event, Event::TileDecoded { chunk: held, .. } if held.id == chunk),
                    );
                }
                Command::PublishFrame { frame } => {
                    let before = self.frames.insert(frame.session, Arc::clone(&frame));
                    assert_eq!(frame.number, before.map_or(0, |frame| frame.number) + 1);
                }
            }
        }
        stats
    }

    /// Ticks until the engine says that nothing is left to do.
    pub(crate) fn settle(&mut self) -> u32 {
        for ticks in 1..2000 {
            if self.tick().settled && self.events.is_empty() {
                return ticks;
            }
        }
        panic!("not settled after 2000 ticks: {:?}", self.engine.stats());
    }

    pub(crate) fn frame(&self, session: SessionId) -> &Frame {
        &self.frames[&session]
    }
}
