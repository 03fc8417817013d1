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
    let config = EngineConfig { retry_after_s: 0.1, retries_max: 2, quarantine_s: 4.0, ..generous(500) };
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
    // It is tried again when its time is up, fails once more, and is mended at last.
    for _ in 0..200 {
        harness.tick();
    }
    let counters = harness.engine.stats().counters;
    assert_eq!((counters.quarantined, counters.tile_failures), (2, 4));
    harness.broken.clear();
    for _ in 0..400 {
        harness.tick();
    }
    harness.settle();
    assert_eq!(harness.frame(ALICE).patches.len(), harness.world.patch_count());
    assert_eq!(harness.engine.stats().chunks.quarantined, 0);
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

/// Goal: a coarse level that is missing, in the index or as tiles, costs far light and says so; nothing else.
#[test]
fn a_missing_coarse_level_is_a_gap() {
    let whole = world(11).with_levels(4);
    let mut harness = Harness::new(whole.clone(), generous(8), Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    let fed = |harness: &Harness| harness.engine.stats().sessions[0].fed_share;
    assert!(fed(&harness) > 0.05, "{}", fed(&harness));

    let mut unlisted = whole.clone();
    unlisted.index.chunks.retain(|chunk| chunk.id.level != 1);
    let mut harness = Harness::new(unlisted, generous(8), Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    assert_eq!((fed(&harness), harness.frame(ALICE).coarse.len()), (0.0, 0));
    assert!(harness.requests.iter().all(|chunk| chunk.level == 0), "what cannot be used is not loaded");
    assert_eq!(harness.frame(ALICE).patches.len(), 8);

    let mut harness = Harness::new(whole, EngineConfig { retries_max: 0, ..generous(8) }, Faults::default());
    harness.broken = harness.world.chunks.keys().filter(|id| id.level == 1).copied().collect();
    harness = harness.with_camera(Vec3::ZERO);
    harness.settle();
    let levels: Vec<usize> = harness.frame(ALICE).coarse.iter().map(|level| level.patches.len()).collect();
    assert!(levels[0] == 0 && levels[2] > 0, "{levels:?}");
    assert!(fed(&harness) > 0.05, "grandparents stand in for parents: {}", fed(&harness));
    assert!(harness.engine.stats().counters.quarantined > 0);
}

/// Goal: no camera, however far or fast, stops the engine, and who comes back finds light. Method: the camera crosses the
/// world at 10 km/s, leaves it for places that are none, and returns.
#[test]
fn cameras_beyond_all_measure_are_survived() {
    let config = EngineConfig { load_radius_m: 6.0, tiles_in_flight_max: 2, ..generous(30) };
    let mut harness =
        Harness::new(world(12).with_levels(3), config, Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    let before = harness.frame(ALICE).patches.clone();
    let velocity = Vec3::X * 10_000.0;
    for step in 0..60 {
        let position = Vec3::X * (step as f32 - 30.0) * 166.7;
        let camera = Camera { position, forward: Vec3::NEG_X, velocity };
        harness.events.push(Event::Camera { session: ALICE, camera });
        harness.tick();
    }
    for position in [Vec3::NAN, Vec3::splat(f32::INFINITY), Vec3::splat(9e5), Vec3::NEG_Y * 5e5] {
        let camera = Camera { position, forward: Vec3::NAN.min(Vec3::ONE), velocity: Vec3::splat(f32::MAX) };
        harness.events.push(Event::Camera { session: ALICE, camera });
        harness.look_from(ALICE, position);
        harness.tick();
    }
    // The top level is held wherever the camera is: there is never nothing to show.
    assert!(!harness.frame(ALICE).coarse.last().unwrap().patches.is_empty());
    harness.look_from(ALICE, Vec3::ZERO);
    harness.settle();
    let places = |lights: &[crate::PatchLight]| {
        lights.iter().map(|light| (light.voxel.to_array(), light.direction)).collect::<Vec<_>>()
    };
    assert_eq!(places(&harness.frame(ALICE).patches), places(&before));
}

/// Goal: a thousand lights are followed within the budget of rays, patch by patch, and the age of what is not lit yet is told.
#[test]
fn a_thousand_lights_take_their_time() {
    let config = EngineConfig { lights_max: 1000, shadow_points_per_tick_max: 4000, ..generous(60) };
    let mut harness = Harness::new(world(13), config, Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    let lights =
        (0..1000).map(|at| lamp(Vec3::new(at as f32 % 16.0, 2.0, at as f32 % 13.0)).lights[0]).collect();
    harness.light(ALICE, LightRig { lights, ..lamp(Vec3::ZERO) });
    let done = harness.tick().done;
    assert!(done.rays < 8000 && done.slots_lit > 0, "{done:?}");
    assert!(harness.frame(ALICE).quality.stale_direct > 0 && !harness.frame(ALICE).quality.settled);
    harness.settle();
    assert_eq!(harness.frame(ALICE).quality.stale_direct, 0);
}

/// Goal: what is promised is counted: kept by a sound world, broken and told where a tile near the camera is missing.
#[test]
fn a_broken_promise_is_counted_and_told() {
    let means = crate::Means { tick_rate_hz: 60.0, tile_bytes_per_s: 1e9 };
    for is_broken in [false, true] {
        let (world, config) = (world(14), generous(60));
        let prospect = world.prospect(&config);
        let promise = prospect.promise(means);
        assert!(promise.radius_m > 1.0 && promise.recovery_s < 5.0, "{promise:?}");
        let mut harness = Harness::new(world, config, Faults::default());
        harness.engine = harness.engine.with_promise(prospect, means);
        let fullest = harness.world.chunks.values().max_by_key(|chunk| chunk.patches.len()).unwrap();
        let (id, place) = (fullest.id, fullest.patches[0].centroid);
        if is_broken {
            harness.broken.insert(id);
        }
        harness = harness.with_camera(place);
        for _ in 0..400 {
            harness.tick();
        }
        let (stats, quality) = (harness.engine.stats(), harness.frame(ALICE).quality);
        assert!(stats.counters.promised_ticks > 50, "{stats:?}");
        assert_eq!(stats.counters.violations > 0, is_broken, "{stats:?}");
        let causes = stats.counters.violation_causes;
        assert_eq!([causes.tiles, causes.slots, causes.light], [stats.counters.violations, 0, 0]);
        assert_eq!((quality.missing_near > 0, stats.sessions[0].violations > 0), (is_broken, is_broken));
        assert!(stats.counters.misses_by_level[0] > 0, "the first ticks have no light yet");
    }
}

/// Goal: the promise follows the rate at which ticks really come, down and up again; a rate that cannot be changes nothing.
#[test]
fn the_promise_follows_the_pace_of_ticks() {
    let config = EngineConfig { adds_per_tick_max: 1, ..generous(60) };
    let world = world(14);
    let prospect = world.prospect(&config);
    let means = crate::Means { tick_rate_hz: 60.0, tile_bytes_per_s: 1e9 };
    let first = prospect.promise(means);
    let mut harness = Harness::new(world, config, Faults::default());
    harness.engine = harness.engine.with_promise(prospect, means);
    let mut at = |tick_rate_hz: f32| {
        harness.events.push(Event::Pace { tick_rate_hz });
        harness.tick();
        crate::Promise::clone(harness.engine.promise())
    };
    let slow = at(6.0);
    assert_eq!(slow.means.tick_rate_hz, 6.0);
    assert!(
        slow.speed_m_s < 0.5 * first.speed_m_s && slow.recovery_s > first.recovery_s,
        "{slow:?} {first:?}"
    );
    for impossible in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(at(impossible), slow);
    }
    assert_eq!(at(60.0), first);
    assert_eq!(harness.engine.stats().counters.ignored.paces, 4);
}
