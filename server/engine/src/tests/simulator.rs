//! Hundreds of seeded lives of an engine in virtual time: flights, teleports, faults, sessions that come and go.
//!
//! Goal: every invariant holds after every tick, the same seed gives the same bits, and when the world calms down the
//! engine comes to rest. Method: a loader that is late, fails, spoils tiles and answers cancelled requests, all by
//! seed; invalid events among the valid ones.

use super::backend::Faults;
use super::harness::factory;
use super::world::{Dice, RandomWorld, WorldShape};
use crate::{Command, Engine, EngineConfig, Event, Frame, Means, SessionId, SolverConfig};
use earthshine_world::{Camera, Chunk, ChunkId, Light, LightRig, Rgb, Sky, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

const SEEDS: u64 = 300;
const TICKS: u64 = 90;

struct Simulation {
    dice: Dice,
    world: RandomWorld,
    engine: Engine,
    now_s: f64,
    tick: u64,
    cameras: BTreeMap<SessionId, Camera>,
    frames: BTreeMap<SessionId, u64>,
    next_session: u64,
    /// Answers by the tick they arrive in.
    answers: BTreeMap<u64, Vec<Event>>,
    digest: u64,
}

impl Simulation {
    /// `decides_late`: backends find out later whom they refuse, and how far they have drifted.
    fn new(seed: u64, decides_late: bool) -> Self {
        let mut dice = Dice::new(seed, 100);
        let shape = WorldShape {
            chunks: [dice.pick(&[2, 4, 7]), 1, dice.pick(&[1, 3])],
            patches_per_chunk_max: dice.pick(&[3, 10]),
            links_per_patch: dice.pick(&[1, 4]),
            has_occluders: dice.chance(0.5),
        };
        let world = RandomWorld::new(seed, shape).with_levels(dice.pick(&[1, 2, 4]));
        let config = EngineConfig {
            seed,
            resident_patches_max: dice.pick(&[1, 6, 20, 1000]),
            coarse_patches_max: dice.pick(&[1, 8, 1000]),
            sessions_max: 3,
            tiles_in_flight_max: dice.pick(&[1, 4]),
            decoded_bytes_max: dice.pick(&[8_000, 30_000, 1 << 30]),
            spare_bytes_max: dice.pick(&[0, 9_000, 1 << 30]),
            load_radius_m: dice.pick(&[3.0, 9.0, 40.0]),
            hysteresis: dice.pick(&[0.0, 0.1, 1.0]),
            look_ahead_s: dice.pick(&[0.0, 0.3]),
            tile_look_ahead_s: dice.pick(&[0.0, 0.2, 2.0]),
            accepted_bytes_per_tick_max: dice.pick(&[1, 3_000, 1 << 30]),
            quarantine_s: dice.pick(&[0.2, 1000.0]),
            view_bias: dice.pick(&[0.0, 0.5, 4.0]),
            adds_per_tick_max: dice.pick(&[1, 5, 64]),
            removals_per_tick_max: dice.pick(&[1, 4, 64]),
            shadow_points_per_tick_max: dice.pick(&[1, 30, 10_000]),
            receiver_voxels_max: dice.pick(&[0, 3, 1000]),
            receiver_rows_per_tick_max: dice.pick(&[1, 7, 1000]),
            lights_max: 3,
            retry_after_s: dice.pick(&[0.0, 0.05]),
            retries_max: dice.pick(&[0, 2, 50]),
            drift_probe_every_swaps: 20,
            drift_max: 1e-4,
            solver: SolverConfig::default(),
        };
        let faults = Faults {
            weak_one_in: dice.pick(&[0, 0, 5]),
            is_strict: dice.chance(0.5),
            fail_step_every: dice.pick(&[0, 0, 23]),
            drift: dice.pick(&[0.0, 1e-3]),
            capacity_max: None,
            late_ticks: dice.pick(&[0, 0, 2]),
            decides_late,
        };
        let prospect = world.prospect(&config);
        let means = Means { tick_rate_hz: 60.0, tile_bytes_per_s: 1e6 };
        let engine =
            Engine::new(world.index.clone(), config, factory(faults)).unwrap().with_promise(prospect, means);
        Self {
            dice,
            world,
            engine,
            now_s: 0.0,
            tick: 0,
            cameras: BTreeMap::new(),
            frames: BTreeMap::new(),
            next_session: 0,
            answers: BTreeMap::new(),
            digest: 0xCBF2_9CE4_8422_2325,
        }
    }

    fn digest(&mut self, word: u64) {
        self.digest = (self.digest ^ word).wrapping_mul(0x0000_0100_0000_01B3).rotate_left(23);
    }

    fn tile(&mut self, id: ChunkId) -> Event {
        let mut chunk = Arc::clone(&self.world.chunks[&id]);
        if self.dice.chance(0.02) && !chunk.rows.shares.is_empty() {
            let mut spoiled = Chunk::clone(&chunk);
            spoiled.rows.shares[0] = f32::NAN;
            chunk = Arc::new(spoiled);
        }
        let lineage = self.world.lineage_of(&chunk);
        Event::TileDecoded { chunk, occluders: Arc::clone(&self.world.occluders[&id]), lineage }
    }

    fn place(&mut self) -> Vec3 {
        self.dice.vector() * Vec3::new(30.0, 6.0, 14.0) - 5.0
    }

    /// What clients do in one tick.
    fn clients(&mut self, events: &mut Vec<Event>) {
        if self.dice.chance(0.08) || self.next_session == 0 {
            let session = SessionId(self.next_session);
            self.next_session += 1;
            events.push(Event::SessionOpened { session });
            if self.cameras.len() < 3 {
                let (position, velocity) = (self.place(), (self.dice.vector() - 0.5) * 60.0);
                self.cameras.insert(session, Camera { position, forward: Vec3::X, velocity });
            }
        }
        for session in self.cameras.keys().copied().collect::<Vec<_>>() {
            if self.dice.chance(0.01) {
                self.cameras.remove(&session);
                self.frames.remove(&session);
                events.push(Event::SessionClosed { session });
                continue;
            }
            let teleport = if self.dice.chance(0.03) { Some(self.place()) } else { None };
            let camera = self.cameras.get_mut(&session).unwrap();
            camera.position = teleport.unwrap_or(camera.position + camera.velocity / 60.0);
            let mut camera = *camera;
            if self.dice.chance(0.02) {
                camera.velocity.y = f32::NAN;
            }
            if self.dice.chance(0.8) {
                events.push(Event::Camera { session, camera });
            }
            if self.dice.chance(0.1) {
                let lights = self.lights();
                events.push(Event::Lights { session, lights });
            }
        }
        if self.dice.chance(0.05) {
            let ids: Vec<_> = self.world.chunks.keys().copied().collect();
            let unasked = self.dice.pick(&ids);
            let tile = self.tile(unasked);
            events.push(tile);
        }
    }

    fn lights(&mut self) -> LightRig {
        let mut lights = Vec::new();
        for _ in 0..self.dice.below(3) {
            let position = self.place();
            let intensity = self.dice.vector() * self.dice.pick(&[1.0, 1000.0, 1e38]);
            lights.push(Light::Point { position, intensity, range_m: None });
        }
        if self.dice.chance(0.3) {
            let direction = (self.dice.vector() - 0.5).normalize_or(Vec3::NEG_Y);
            lights.push(Light::Directional {
                direction,
                illuminance: Rgb::splat(1e5),
                angular_diameter_rad: 0.01,
            });
        }
        let emission_scale = self.dice.pick(&[0.0, 1.0, f32::NAN]);
        LightRig { lights, sky: Sky::constant(self.dice.vector()), emission_scale }
    }

    fn step(&mut self, is_calm: bool) -> bool {
        self.tick += 1;
        let backwards = !is_calm && self.dice.chance(0.02);
        self.now_s += if backwards { -0.1 } else { 1.0 / 60.0 };
        let mut events = self.answers.remove(&self.tick).unwrap_or_default();
        if !is_calm {
            self.clients(&mut events);
        }
        let mut commands = Vec::new();
        let stats = self.engine.tick(self.now_s, events, &mut commands);
        self.engine.validate().unwrap();
        for command in commands {
            match command {
                Command::LoadTile { chunk } => self.load(chunk, is_calm),
                Command::CancelTile { chunk } => {
                    self.digest(2);
                    let answered_all_the_same = self.dice.chance(0.3);
                    if !answered_all_the_same {
                        self.forget(chunk);
                    }
                }
                Command::PublishFrame { frame } => self.publish(&frame),
            }
        }
        stats.settled && self.answers.is_empty()
    }

    fn load(&mut self, chunk: ChunkId, is_calm: bool) {
        for coordinate in chunk.coord.to_array() {
            self.digest(u64::from(coordinate.cast_unsigned()));
        }
        assert!(self.world.chunks.contains_key(&chunk));
        let due = self.tick + 1 + self.dice.below(8);
        let failed = !is_calm && self.dice.chance(0.15);
        let cause = || "a fault of the simulation".to_owned();
        let answer = if failed { Event::TileFailed { chunk, cause: cause() } } else { self.tile(chunk) };
        self.answers.entry(due).or_default().push(answer);
    }

    fn forget(&mut self, id: ChunkId) {
        for answers in self.answers.values_mut() {
            answers.retain(|answer| match answer {
                Event::TileDecoded { chunk, .. } => chunk.id != id,
                Event::TileFailed { chunk, .. } => *chunk != id,
                _ => true,
            });
        }
        self.answers.retain(|_, answers| !answers.is_empty());
    }

    fn publish(&mut self, frame: &Frame) {
        assert!(self.cameras.contains_key(&frame.session), "only open sessions get frames");
        let last = self.frames.insert(frame.session, frame.number);
        assert_eq!(frame.number, last.unwrap_or(0) + 1);
        self.digest(frame.session.0 << 32 | frame.number);
        self.digest(frame.time_s.to_bits());
        self.digest(u64::from(frame.quality.stale_direct) << 32 | u64::from(frame.quality.wanted_patches));
        let coarse = frame.coarse.iter().flat_map(|level| level.patches.iter());
        for light in frame.patches.iter().chain(coarse) {
            let sum = light.known_share + light.far_share;
            assert!((sum - 1.0).abs() < 2e-3 && light.fed_share <= light.far_share + 2e-3, "{light:?}");
            self.digest(light.fed_share.to_bits().into());
            for value in light.irradiance.to_array().into_iter().chain(light.sky_irradiance.to_array()) {
                self.digest(u64::from(value.to_bits()));
            }
            self.digest(u64::from(light.known_share.to_bits()) << 32 | u64::from(light.far_share.to_bits()));
        }
    }
}

fn live(seed: u64, decides_late: bool) -> (u64, crate::EngineStats) {
    let mut simulation = Simulation::new(seed, decides_late);
    for _ in 0..TICKS {
        simulation.step(false);
    }
    let is_settled = (0..1500).any(|_| simulation.step(true));
    let stats = simulation.engine.stats();
    // A backend that fails every so often is replaced for ever, each time a little later.
    assert!(
        is_settled || stats.counters.backend_failures > 0,
        "seed {seed} does not come to rest: {stats:?}"
    );
    if stats.chunks.quarantined == 0 && is_settled {
        let complete =
            stats.sessions.iter().all(|session| session.resident_patches == session.wanted_patches);
        assert!(complete, "seed {seed}: {stats:?}");
    }
    (simulation.digest, stats)
}

#[test]
fn every_life_keeps_the_invariants_and_repeats_to_the_bit() {
    let mut total = crate::Counters::default();
    let mut digests = std::collections::BTreeSet::new();
    for seed in 0..SEEDS {
        let (digest, stats) = live(seed, false);
        let (again, stats_again) = live(seed, false);
        assert_eq!((digest, &stats), (again, &stats_again), "seed {seed} does not repeat");
        digests.insert(digest);
        let done = stats.counters;
        total.frames += done.frames;
        total.adds += done.adds;
        total.removes += done.removes;
        total.weak_pivots += done.weak_pivots;
        total.tile_failures += done.tile_failures;
        total.tiles_cancelled += done.tiles_cancelled;
        total.backend_failures += done.backend_failures;
        total.resolves += done.resolves;
        total.evicted += done.evicted;
        total.promised_ticks += done.promised_ticks;
        total.violations += done.violations;
    }
    assert_eq!(digests.len() as u64, SEEDS, "every seed is another life");
    // To be held against those of another state of the program.
    println!("digests of all lives: {:016x}", digests.iter().fold(0u64, |all, one| all.rotate_left(1) ^ one));
    // The simulation is worth nothing if what it is for does not happen.
    assert!(total.frames > 5 * SEEDS && total.adds > 20 * SEEDS && total.removes > 10 * SEEDS, "{total:?}");
    let rare = [
        total.weak_pivots,
        total.tile_failures,
        total.tiles_cancelled,
        total.backend_failures,
        total.resolves,
        total.evicted,
        total.promised_ticks,
        total.violations,
    ];
    assert!(rare.iter().all(|&count| count > 20), "{total:?}");
}

/// Goal: nothing is out of order, ever, where a backend tells later whom it refused and how far it drifted. Method: the same
/// lives, invariants after every tick.
#[test]
fn lives_that_are_told_late_keep_the_invariants() {
    let mut total = crate::Counters::default();
    for seed in 0..SEEDS {
        let done = live(seed, true).1.counters;
        total.weak_pivots += done.weak_pivots;
        total.resolves += done.resolves;
    }
    assert!(total.weak_pivots > 20 && total.resolves > 20, "{total:?}");
}
