//! What goes wrong outside, and that the engine counts it and goes on.

use super::backend::Faults;
use super::harness::{ALICE, BOB, Harness, factory, generous, lamp, still};
use super::world::{RandomWorld, WorldShape};
use crate::{Engine, EngineConfig, EngineError, Event, SessionId};
use earthshine_radiosity::BackendError;
use earthshine_world::{Camera, ChunkCoord, ChunkId, LightRig, Vec3};
use std::sync::Arc;

fn world(seed: u64) -> RandomWorld {
    RandomWorld::new(seed, WorldShape::default())
}

#[test]
fn events_that_cannot_be_are_ignored_and_counted() {
    let mut harness =
        Harness::new(world(1), EngineConfig { sessions_max: 1, ..generous(30) }, Faults::default());
    harness = harness.with_camera(Vec3::ZERO);
    harness.settle();
    let before = harness.frame(ALICE).clone();
    let nobody = SessionId(9);
    let chunk = *harness.world.chunks.keys().next().unwrap();
    let foreign = ChunkId::new(3, ChunkCoord::splat(77));
    let unwanted = harness.tile(chunk);
    let mut bad_lights = lamp(Vec3::ZERO);
    bad_lights.emission_scale = f32::NAN;
    harness.events = vec![
        Event::SessionOpened { session: ALICE },
        Event::SessionOpened { session: BOB },
        Event::SessionClosed { session: nobody },
        Event::Camera { session: ALICE, camera: still(Vec3::new(f32::NAN, 0.0, 0.0)) },
        Event::Camera { session: ALICE, camera: still(Vec3::X * f32::INFINITY) },
        Event::Camera { session: ALICE, camera: still(Vec3::X * 1.1 * Camera::POSITION_MAX_M) },
        Event::Camera { session: nobody, camera: still(Vec3::ZERO) },
        Event::Lights { session: ALICE, lights: bad_lights },
        Event::Lights { session: nobody, lights: LightRig::emission_only() },
        Event::Lights {
            session: ALICE,
            lights: LightRig { lights: vec![lamp(Vec3::ONE).lights[0]; 300], ..lamp(Vec3::ONE) },
        },
        unwanted,
        Event::TileFailed { chunk, cause: "late".to_owned() },
        Event::TileFailed { chunk: foreign, cause: "foreign".to_owned() },
    ];
    let done = harness.tick().done;
    let ignored = done.ignored;
    assert_eq!((ignored.sessions, ignored.cameras, ignored.lights, ignored.tiles), (3, 4, 3, 3));
    assert_eq!((ignored.total(), done.frames, done.tile_failures), (13, 0, 0));
    assert_eq!(*harness.frame(ALICE), before);
}

#[test]
fn time_that_runs_backwards_counts_as_the_last() {
    let mut harness = Harness::new(world(2), generous(30), Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    for now_s in [f64::NAN, f64::NEG_INFINITY, -5.0] {
        let stats = harness.engine.tick(now_s, Vec::new(), &mut Vec::new());
        assert_eq!(stats.done.ignored.times, 1);
    }
    assert_eq!(harness.tick().done.ignored.times, 0);
}

#[test]
fn a_broken_tile_is_tried_again_later_then_quarantined() {
    let config = EngineConfig { retry_after_s: 0.1, retries_max: 2, ..generous(500) };
    let mut harness = Harness::new(world(3), config, Faults::default()).with_camera(Vec3::ZERO);
    let broken = *harness.world.chunks.iter().find(|(_, chunk)| chunk.patches.len() > 2).unwrap().0;
    harness.broken.insert(broken);
    let mut asked_at = Vec::new();
    for _ in 0..200 {
        let asked = harness.requests.len();
        harness.tick();
        if harness.requests[asked..].contains(&broken) {
            asked_at.push(harness.now_s);
        }
    }
    assert_eq!(asked_at.len(), 3, "once and twice again");
    assert!(asked_at[1] - asked_at[0] >= 0.1 && asked_at[2] - asked_at[1] >= 0.2, "{asked_at:?}");
    let stats = harness.engine.stats();
    assert_eq!(
        (stats.chunks.quarantined, stats.counters.quarantined, stats.counters.tile_failures),
        (1, 1, 3)
    );
    assert!(harness.frame(ALICE).quality.settled, "what is given up is not waited for");
    let lost = harness.world.chunks[&broken].patches.len();
    assert_eq!(harness.frame(ALICE).patches.len(), harness.world.patch_count() - lost);
    assert!(harness.frame(ALICE).patches.iter().any(|light| light.far_share > 0.0));
}

#[test]
fn a_tile_that_holds_nonsense_is_a_failed_tile() {
    let config = EngineConfig { retries_max: 0, ..generous(500) };
    let mut harness = Harness::new(world(4), config, Faults::default()).with_camera(Vec3::ZERO);
    let spoiled = *harness.world.chunks.iter().find(|(_, chunk)| chunk.patches.len() > 2).unwrap().0;
    let mut chunk = earthshine_world::Chunk::clone(&harness.world.chunks[&spoiled]);
    chunk.patches[1].area = f32::NAN;
    harness.world.chunks.insert(spoiled, Arc::new(chunk));
    harness.settle();
    assert_eq!(harness.engine.stats().counters.quarantined, 1);
}

/// Goal: a patch that the backend refuses costs its place to the next, is not offered for ever, and is counted.
#[test]
fn weak_pivots_are_passed_over() {
    for is_strict in [false, true] {
        let faults = Faults { weak_one_in: 3, is_strict, ..Faults::default() };
        let mut harness = Harness::new(world(5), generous(20), faults).with_camera(Vec3::ZERO);
        harness.settle();
        let stats = harness.engine.stats();
        assert!(stats.counters.weak_pivots + stats.counters.refused_adds > 0);
        let refused = u64::from(stats.sessions[0].refused_patches);
        assert_eq!(
            stats.counters.weak_pivots + stats.counters.refused_adds,
            refused,
            "each was offered once"
        );
        assert_eq!(harness.frame(ALICE).patches.len(), 20);
    }
}

#[test]
fn a_backend_that_fails_is_replaced_and_filled_again() {
    let config = EngineConfig { retry_after_s: 0.05, adds_per_tick_max: 8, ..generous(20) };
    let faults = Faults { fail_step_every: 7, ..Faults::default() };
    let mut sound = Harness::new(world(6), config.clone(), Faults::default()).with_camera(Vec3::ZERO);
    sound.settle();
    let mut harness = Harness::new(world(6), config, faults).with_camera(Vec3::ZERO);
    harness.settle();
    for step in 0..12 {
        harness.look_from(ALICE, Vec3::X * f32::from(step as u8 % 3));
        harness.settle();
        // No frame goes out while the new backend is empty: the client keeps the last light.
        assert!(!harness.frame(ALICE).patches.is_empty());
    }
    assert!(harness.engine.stats().counters.backend_failures > 0);
    harness.look_from(ALICE, Vec3::ZERO);
    harness.settle();
    let (a, b) = (&harness.frame(ALICE).patches, &sound.frame(ALICE).patches);
    assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(b.iter()) {
        assert!((a.irradiance - b.irradiance).abs().max_element() < 1e-4);
    }
}

#[test]
fn a_backend_that_cannot_be_built_is_tried_again() {
    let mut attempts = 0;
    let mut sound = factory(Faults { capacity_max: Some(7), ..Faults::default() });
    let backends = Box::new(move |capacity| {
        attempts += 1;
        if attempts < 4 { Err(BackendError::Length { expected: 1, actual: 0 }) } else { sound(capacity) }
    });
    let config = EngineConfig { retry_after_s: 0.1, ..generous(20) };
    let mut harness = Harness::with_backends(world(7), config, backends).with_camera(Vec3::ZERO);
    harness.settle();
    assert_eq!(harness.engine.stats().counters.backend_failures, 3);
    assert_eq!(harness.frame(ALICE).patches.len(), 7, "the device had room for seven");
    assert!(harness.now_s > 0.3);
}

#[test]
fn drift_is_probed_and_too_much_of_it_solved_afresh() {
    for (drift, resolves) in [(0.0, false), (1e-3, true), (f32::NAN, true)] {
        let config = EngineConfig { drift_probe_every_swaps: 10, ..generous(10) };
        let mut harness =
            Harness::new(world(8), config, Faults { drift, ..Faults::default() }).with_camera(Vec3::ZERO);
        for step in 0..10 {
            harness.look_from(ALICE, Vec3::X * step as f32);
            harness.settle();
        }
        let counters = harness.engine.stats().counters;
        let swaps = counters.adds + counters.removes;
        assert!(counters.drift_probes > 0 && counters.drift_probes <= swaps / 10);
        assert_eq!(counters.resolves, if resolves { counters.drift_probes } else { 0 });
    }
}

#[test]
fn an_engine_that_cannot_be_is_refused() {
    let world = world(9);
    let build = |spoil: &dyn Fn(&mut earthshine_world::WorldIndex, &mut EngineConfig)| {
        let (mut index, mut config) = (world.index.clone(), EngineConfig::default());
        spoil(&mut index, &mut config);
        Engine::new(index, config, factory(Faults::default())).map(|_| ())
    };
    assert!(build(&|_, _| ()).is_ok());
    let error = build(&|_, config| config.hysteresis = 9.0).unwrap_err();
    assert!(matches!(&error, EngineError::Config(cause) if cause.key == "hysteresis"), "{error}");
    assert!(matches!(build(&|index, _| index.grid.voxel_edge_m = 0.0), Err(EngineError::Grid { .. })));
    assert!(matches!(build(&|index, _| index.grid.chunk_edge_voxels = 99), Err(EngineError::Grid { .. })));
    let twice = build(&|index, _| index.chunks.push(index.chunks[0]));
    assert_eq!(twice, Err(EngineError::DuplicateChunk(world.index.chunks[0].id)));
}

/// The shell moves the engine to a thread of its own.
#[test]
fn an_engine_may_change_threads() {
    fn may_change_threads<T: Send>(_: &T) {}
    let harness = Harness::new(world(10), generous(1), Faults::default());
    may_change_threads(&harness.engine);
}
