//! Which chunks are in memory and which patches hold slots.

use super::backend::Faults;
use super::harness::{ALICE, BOB, Harness, generous, still};
use super::world::{Dice, RandomWorld, WorldShape};
use crate::{ChunkState, EngineConfig, Event};
use earthshine_world::{Camera, ChunkId, Direction, Vec3, VoxelCoord};
use std::collections::BTreeSet;

fn big_world(seed: u64) -> RandomWorld {
    RandomWorld::new(
        seed,
        WorldShape { chunks: [5, 2, 4], patches_per_chunk_max: 12, ..WorldShape::default() },
    )
}

fn resident(harness: &Harness) -> BTreeSet<([i32; 3], Direction)> {
    harness.frame(ALICE).patches.iter().map(|light| (light.voxel.to_array(), light.direction)).collect()
}

fn nearest(world: &RandomWorld, point: Vec3, how_many: usize) -> BTreeSet<([i32; 3], Direction)> {
    let key = |(_, voxel, direction): (f32, VoxelCoord, Direction)| (voxel.to_array(), direction);
    world.nearest(point).into_iter().take(how_many).map(key).collect()
}

/// Goal: at rest the resident set is the nearest M, whatever M is and wherever the camera was before.
#[test]
fn the_resident_set_at_rest_is_the_nearest_patches() {
    for capacity in [1, 5, 37, 5000] {
        let world = big_world(u64::from(capacity));
        let mut harness = Harness::new(world, generous(capacity), Faults::default());
        harness = harness.with_camera(Vec3::ZERO);
        let mut dice = Dice::new(u64::from(capacity), 7);
        for _ in 0..6 {
            let position = dice.vector() * Vec3::new(20.0, 8.0, 16.0) - 4.0;
            harness.look_from(ALICE, position);
            harness.settle();
            let expected = nearest(&harness.world, position, capacity as usize);
            assert_eq!(resident(&harness), expected, "M = {capacity} at {position}");
            let quality = harness.frame(ALICE).quality;
            assert!(quality.settled && quality.resident_patches == quality.wanted_patches, "{quality:?}");
        }
    }
}

/// Goal: with hysteresis what is clearly nearer is resident, and what is resident is not clearly farther.
#[test]
fn hysteresis_bounds_how_far_the_resident_set_lags() {
    let config = EngineConfig { hysteresis: 0.1, ..generous(30) };
    let mut harness = Harness::new(big_world(3), config, Faults::default()).with_camera(Vec3::ZERO);
    for step in 0..20 {
        let position = Vec3::new(step as f32 * 0.7, 1.0, 2.0);
        harness.look_from(ALICE, position);
        harness.settle();
        let order = harness.world.nearest(position);
        let limit = order[29].0;
        let held = resident(&harness);
        assert_eq!(held.len(), 30);
        for (distance, voxel, direction) in order {
            let is_held = held.contains(&(voxel.to_array(), direction));
            assert!(is_held || distance > limit / 1.1001, "{distance} m is missing, the limit is {limit} m");
            assert!(!is_held || distance < limit * 1.1001, "{distance} m is held, the limit is {limit} m");
        }
    }
}

#[test]
fn hysteresis_stops_flapping() {
    let swaps = |hysteresis| {
        let config = EngineConfig { hysteresis, ..generous(40) };
        let mut harness = Harness::new(big_world(5), config, Faults::default()).with_camera(Vec3::ZERO);
        harness.settle();
        let before = harness.engine.stats().counters;
        for turn in 0..20 {
            harness.look_from(ALICE, Vec3::X * if turn % 2 == 0 { 0.15 } else { -0.15 });
            harness.settle();
        }
        harness.engine.stats().counters.since(&before).adds
    };
    let (without, with) = (swaps(0.0), swaps(0.1));
    assert!(without >= 20, "{without} adds without hysteresis");
    assert!(with <= 2, "{with} adds with hysteresis");
}

#[test]
fn a_moving_camera_has_light_where_it_will_be() {
    let config = EngineConfig { look_ahead_s: 0.5, ..generous(20) };
    let mut harness = Harness::new(big_world(6), config, Faults::default()).with_camera(Vec3::ZERO);
    let camera = Camera { position: Vec3::ZERO, forward: Vec3::X, velocity: Vec3::X * 12.0 };
    harness.events.push(Event::Camera { session: ALICE, camera });
    harness.settle();
    assert_eq!(resident(&harness), nearest(&harness.world, Vec3::X * 6.0, 20));
}

#[test]
fn tiles_are_asked_for_nearest_first_once_and_within_the_limit() {
    let config = EngineConfig { tiles_in_flight_max: 3, load_radius_m: 9.0, view_bias: 0.0, ..generous(50) };
    let mut harness = Harness::new(big_world(7), config, Faults::default()).with_camera(Vec3::ZERO);
    harness.events.push(Event::SessionOpened { session: BOB });
    harness.look_from(BOB, Vec3::ZERO);
    harness.tick();
    assert_eq!(harness.requests.len(), 3);
    harness.settle();
    let distance = |id: &ChunkId| harness.world.index.grid.chunk_bounds(id.coord).distance(Vec3::ZERO);
    let distances: Vec<f32> = harness.requests.iter().map(distance).collect();
    assert!(distances.is_sorted(), "{distances:?}");
    assert!(distances.iter().all(|&d| d <= 9.0));
    let once: BTreeSet<_> = harness.requests.iter().collect();
    let near = harness.world.chunks.keys().filter(|&id| distance(id) <= 9.0).count();
    assert_eq!((once.len(), harness.requests.len()), (near, near));
    assert_eq!(harness.frames[&ALICE].patches, harness.frames[&BOB].patches);
}

/// Goal: chunks whose camera has gone leave memory through Leaving, those of another session stay.
#[test]
fn unwanted_chunks_leave_and_come_back() {
    let config = EngineConfig { load_radius_m: 2.0, removals_per_tick_max: 1, ..generous(100) };
    let mut harness = Harness::new(big_world(8), config, Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    let states =
        |harness: &Harness, state| harness.engine.chunk_states().filter(|&(_, s)| s == state).count();
    let near = states(&harness, ChunkState::Resident);
    assert!(near > 1);
    // Part of what is resident is still wanted: the rest leaves one by one.
    harness.look_from(ALICE, Vec3::new(4.0, 0.0, 0.0));
    harness.tick();
    assert!(states(&harness, ChunkState::Leaving) > 0);
    harness.look_from(ALICE, Vec3::ZERO);
    harness.settle();
    assert_eq!((states(&harness, ChunkState::Leaving), states(&harness, ChunkState::Resident)), (0, near));
    let asked = harness.requests.len();
    harness.look_from(ALICE, Vec3::new(5000.0, 0.0, 0.0));
    harness.settle();
    assert!(harness.frame(ALICE).patches.is_empty());
    let stats = harness.engine.stats();
    let spare = usize::try_from(stats.spare_chunks).unwrap();
    assert_eq!((states(&harness, ChunkState::Decoded), states(&harness, ChunkState::Resident)), (spare, 0));
    assert!(spare >= near && stats.counters.evicted == 0, "there is room: nothing goes");
    harness.look_from(ALICE, Vec3::ZERO);
    harness.settle();
    assert_eq!(harness.requests.len(), asked, "who comes back finds it");
}

/// Goal: after a jump nothing of before is in the way, and the first light comes sooner than a full matrix could take it in.
/// Method: a jump beyond all that is loaded, with a small budget; patches are counted tick by tick.
#[test]
fn a_jump_clears_the_local_set_at_once() {
    let config =
        EngineConfig { load_radius_m: 6.0, adds_per_tick_max: 3, removals_per_tick_max: 1, ..generous(60) };
    let mut harness = Harness::new(big_world(8), config, Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    let before = u64::from(harness.frame(ALICE).quality.resident_patches);
    assert!(before > 20);
    harness.look_from(ALICE, Vec3::new(40.0, 0.0, 0.0));
    let done = harness.tick().done;
    assert_eq!((done.cleared, done.removes), (before, 0));
    harness.look_from(ALICE, Vec3::ZERO);
    let fastest = (0..20).map(|_| harness.tick().done.adds).max();
    assert!(fastest > Some(2 * 3), "{fastest:?} adds in the fastest tick");
    harness.settle();
}

/// Goal: what nobody wants goes when room is needed, the longest unwanted and farthest first, and nothing else goes.
#[test]
fn spare_chunks_make_room_by_age_and_distance() {
    let world = big_world(12);
    let all: u64 = {
        let mut harness =
            Harness::new(world.clone(), generous(100), Faults::default()).with_camera(Vec3::ZERO);
        harness.settle();
        harness.engine.stats().decoded_bytes
    };
    let decoded_bytes_max = all / 6;
    let config = EngineConfig { decoded_bytes_max, load_radius_m: 2.0, ..generous(100) };
    let mut harness = Harness::new(world, config, Faults::default()).with_camera(Vec3::ZERO);
    for step in 0..24 {
        harness.look_from(ALICE, Vec3::X * step as f32 * 0.75);
        harness.settle();
        assert!(harness.engine.stats().decoded_bytes <= decoded_bytes_max);
    }
    let stats = harness.engine.stats();
    assert!(stats.counters.evicted > 0 && stats.spare_chunks > 0, "{stats:?}");
    // Behind the camera the nearest are the youngest: what is left of the spare ones lies nearer than what went.
    let at = Vec3::X * 23.0 * 0.75;
    let distance = |id: &ChunkId| harness.world.index.grid.chunk_bounds(id.coord).distance(at);
    let gone = harness.requests.iter().filter(|&&id| {
        harness.engine.chunk_states().any(|(other, state)| other == id && state == ChunkState::Absent)
    });
    let nearest_gone = gone.map(distance).fold(f32::INFINITY, f32::min);
    let held = harness.engine.chunk_states().filter(|&(_, state)| state == ChunkState::Decoded);
    let mean_held: f32 = {
        let distances: Vec<f32> = held.map(|(id, _)| distance(&id)).collect();
        distances.iter().sum::<f32>() / distances.len() as f32
    };
    assert!(nearest_gone > 2.0 && mean_held < 18.0, "{nearest_gone} m, {mean_held} m");
}

/// Goal: chunks that nobody wants take no more than they may, all the way of a flight.
#[test]
fn spare_chunks_take_no_more_than_they_may() {
    let flown = |spare_bytes_max: u64| {
        let config = EngineConfig { spare_bytes_max, load_radius_m: 2.0, ..generous(100) };
        let mut harness = Harness::new(big_world(12), config, Faults::default()).with_camera(Vec3::ZERO);
        let mut most = 0;
        for step in 0..24 {
            harness.look_from(ALICE, Vec3::X * step as f32 * 0.75);
            harness.settle();
            most = most.max(harness.engine.stats().spare_chunks);
        }
        (most, harness.engine.stats().decoded_bytes, harness.frame(ALICE).patches.len())
    };
    let (all, none) = (flown(1 << 30), flown(0));
    assert!(all.0 > 2 && all.1 > none.1, "{all:?} {none:?}");
    assert_eq!((none.0, none.2), (0, all.2), "what is wanted is there either way");
}

/// Goal: what is on its way takes the place of what is spare, in every tick: a burst of tiles is no peak of memory.
#[test]
fn tiles_on_their_way_take_the_place_of_spare_ones() {
    let flown = |spare_bytes_max: u64| {
        let config = EngineConfig { spare_bytes_max, load_radius_m: 2.0, ..generous(100) };
        let mut harness = Harness::new(big_world(12), config, Faults::default()).with_camera(Vec3::ZERO);
        let mut seen = Vec::new();
        for step in 0..96 {
            harness.look_from(ALICE, Vec3::X * step as f32 * 0.2);
            harness.tick();
            let chunks = &harness.engine.chunks;
            seen.push([chunks.spare_bytes(), chunks.in_flight_bytes()]);
        }
        seen
    };
    let most = flown(1 << 30).into_iter().map(|[spare, _]| spare).max().unwrap();
    let spare_bytes_max = most / 2;
    let seen = flown(spare_bytes_max);
    assert!(seen.iter().any(|&[spare, coming]| spare > 0 && coming > 0), "of {most}: {seen:?}");
    let is_held = |&[spare, coming]: &[u64; 2]| spare == 0 || spare + coming <= spare_bytes_max;
    assert!(seen.iter().all(is_held), "of {spare_bytes_max}: {seen:?}");
}

/// Goal: a burst of tiles is taken a few a tick, nobody's work is lost, and what is cancelled meanwhile is forgotten.
#[test]
fn tiles_that_came_wait_for_their_turn() {
    let config = EngineConfig { accepted_bytes_per_tick_max: 1, tiles_in_flight_max: 64, ..generous(100) };
    let mut harness = Harness::new(big_world(13), config, Faults::default()).with_camera(Vec3::ZERO);
    harness.tick();
    let asked = harness.requests.len();
    assert!(asked > 10);
    for taken in 1..=5 {
        assert_eq!(harness.tick().done.tiles_decoded, 1);
        assert_eq!(harness.engine.stats().chunks.requested as usize, asked - taken);
    }
    harness.events.push(Event::SessionClosed { session: ALICE });
    harness.tick();
    let stats = harness.engine.stats();
    assert_eq!((stats.chunks.requested, stats.counters.ignored.total()), (0, 0), "{stats:?}");
}

/// Goal: memory holds, the nearest chunks win, and the engine comes to rest where not everything fits.
#[test]
fn memory_is_bounded_and_goes_to_the_nearest() {
    for decoded_bytes_max in [1, 5_000, 20_000, 60_000] {
        let config =
            EngineConfig { decoded_bytes_max, tiles_in_flight_max: 2, hysteresis: 0.1, ..generous(100) };
        let mut harness = Harness::new(big_world(9), config, Faults::default()).with_camera(Vec3::ZERO);
        harness.settle();
        for step in 0..10 {
            harness.look_from(ALICE, Vec3::X * step as f32);
            harness.settle();
            assert!(harness.engine.stats().decoded_bytes <= decoded_bytes_max);
        }
        let requested = harness.requests.len();
        for _ in 0..10 {
            harness.tick();
        }
        assert_eq!(harness.requests.len(), requested, "nothing is asked for at rest");
        assert_eq!(harness.frame(ALICE).patches.is_empty(), decoded_bytes_max == 1);
    }
}

#[test]
fn a_session_that_closes_cancels_its_requests() {
    let mut harness = Harness::new(big_world(10), generous(50), Faults::default()).with_camera(Vec3::ZERO);
    harness.tick();
    let asked: BTreeSet<_> = harness.requests.iter().copied().collect();
    harness.events.clear();
    harness.events.push(Event::SessionClosed { session: ALICE });
    harness.tick();
    assert_eq!(harness.cancels.iter().copied().collect::<BTreeSet<_>>(), asked);
    let late: Vec<_> = asked.iter().map(|&id| harness.tile(id)).collect();
    harness.events = late;
    let stats = harness.tick();
    assert_eq!(stats.done.ignored.tiles, asked.len() as u64);
    assert_eq!(harness.engine.stats().chunks.absent as usize, harness.world.chunks.len());
}

#[test]
fn two_sessions_far_apart_have_their_own_patches() {
    let config = EngineConfig { load_radius_m: 4.0, ..generous(10) };
    let mut harness = Harness::new(big_world(11), config, Faults::default()).with_camera(Vec3::ZERO);
    harness.events.push(Event::SessionOpened { session: BOB });
    harness.events.push(Event::Camera { session: BOB, camera: still(Vec3::new(14.0, 0.0, 10.0)) });
    harness.settle();
    let voxels = |session| harness.frame(session).patches.iter().map(|p| p.voxel.x).collect::<BTreeSet<_>>();
    assert!(voxels(ALICE).iter().max() < voxels(BOB).iter().min());
    harness.events.push(Event::SessionClosed { session: ALICE });
    harness.settle();
    assert_eq!(harness.engine.stats().sessions.len(), 1);
    assert!(harness.engine.chunk_states().any(|(_, state)| state == ChunkState::Resident));
}

/// Goal: sessions share tiles. Method: what two cameras at one place ask for and hold is what one does.
#[test]
fn two_sessions_at_one_place_share_their_tiles() {
    let config = || EngineConfig { load_radius_m: 6.0, ..generous(40) };
    let mut alone = Harness::new(big_world(8), config(), Faults::default()).with_camera(Vec3::ZERO);
    alone.settle();
    let mut both = Harness::new(big_world(8), config(), Faults::default()).with_camera(Vec3::ZERO);
    both.events.push(Event::SessionOpened { session: BOB });
    both.look_from(BOB, Vec3::ZERO);
    both.settle();
    let (one, two) = (alone.engine.stats(), both.engine.stats());
    assert!(one.counters.tiles_requested > 1 && one.decoded_bytes > 0);
    assert_eq!(two.counters.tiles_requested, one.counters.tiles_requested);
    assert_eq!((two.decoded_bytes, two.counters.tile_bytes), (one.decoded_bytes, one.counters.tile_bytes));
}
