//! What one tick may do, and that what it could not do is done later.

use super::backend::Faults;
use super::harness::{ALICE, BOB, Harness, generous, lamp};
use super::world::{RandomWorld, WorldShape};
use crate::{EngineConfig, Event};
use earthshine_world::{LightRig, Vec3};

fn world(seed: u64) -> RandomWorld {
    RandomWorld::new(
        seed,
        WorldShape { chunks: [4, 2, 3], patches_per_chunk_max: 12, ..WorldShape::default() },
    )
}

#[test]
fn adds_and_removals_keep_their_budgets_over_all_sessions() {
    for (adds_per_tick_max, removals_per_tick_max) in [(1, 1), (3, 2), (2, 7), (100, 100)] {
        let config = EngineConfig { adds_per_tick_max, removals_per_tick_max, ..generous(25) };
        let mut harness = Harness::new(world(1), config, Faults::default()).with_camera(Vec3::ZERO);
        harness.events.push(Event::SessionOpened { session: BOB });
        harness.look_from(BOB, Vec3::new(9.0, 0.0, 0.0));
        for round in 0..3 {
            for _ in 0..400 {
                let stats = harness.tick();
                // Where slots are free adds are cheap; a full matrix has to make room for each.
                let is_full = stats.done.removes >= stats.done.adds;
                let cheaper = if is_full { 1 } else { EngineConfig::CHEAPER_ADDS_LIMIT };
                assert!(stats.done.adds <= u64::from(adds_per_tick_max * cheaper));
                assert!(stats.done.removes <= u64::from(removals_per_tick_max));
                if stats.settled && harness.events.is_empty() {
                    break;
                }
            }
            harness.look_from(ALICE, Vec3::new(9.0 - 4.0 * round as f32, 0.0, 4.0));
        }
        harness.settle();
        assert_eq!(harness.frame(ALICE).patches.len(), 25);
        assert_eq!(harness.frame(BOB).patches.len(), 25);
    }
}

/// Goal: making room never leaves slots empty: what is displaced goes when its better comes.
#[test]
fn a_full_local_set_stays_full_while_patches_are_displaced() {
    let config = EngineConfig { adds_per_tick_max: 2, removals_per_tick_max: 50, ..generous(25) };
    let mut harness = Harness::new(world(2), config, Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    harness.look_from(ALICE, Vec3::new(8.0, 2.0, 6.0));
    for _ in 0..40 {
        harness.tick();
        assert_eq!(harness.frame(ALICE).patches.len(), 25);
    }
}

#[test]
fn shadow_points_keep_their_budget_and_nobody_starves() {
    let config = EngineConfig { shadow_points_per_tick_max: 20, ..generous(40) };
    let mut harness = Harness::new(world(3), config, Faults::default()).with_camera(Vec3::ZERO);
    harness.light(ALICE, lamp(Vec3::ONE));
    harness.settle();
    let capacity = harness.frame(ALICE).patches.len() as u64;
    // A lamp that moves every tick: everything is always stale, and still everyone's turn comes.
    let mut rays = 0;
    for step in 1..=60 {
        harness.light(ALICE, lamp(Vec3::ONE * (1.0 + 0.01 * step as f32)));
        let stats = harness.tick();
        assert!(stats.done.rays <= 20 && stats.done.slots_lit > 0);
        assert!(harness.frame(ALICE).quality.stale_direct > 0);
        rays += stats.done.slots_lit;
    }
    assert!(rays > 5 * capacity, "{rays} slots lit");
    let moved = harness.frame(ALICE).patches.clone();
    harness.settle();
    assert_eq!(harness.frame(ALICE).quality.stale_direct, 0);
    let mut fresh = Harness::new(world(3), generous(40), Faults::default()).with_camera(Vec3::ZERO);
    fresh.light(ALICE, lamp(Vec3::ONE * (1.0 + 0.01 * 60.0)));
    fresh.settle();
    let worst = |a: &[crate::PatchLight]| {
        a.iter()
            .zip(fresh.frame(ALICE).patches.iter())
            .map(|(a, b)| {
                (a.irradiance - b.irradiance).abs().max_element() / b.irradiance.max_element().max(0.1)
            })
            .fold(0.0, f32::max)
    };
    assert!(worst(&harness.frame(ALICE).patches) < 1e-4, "at rest the light is that of the last lamp");
    assert!(worst(&moved) < 0.5, "on the way it follows");
}

#[test]
fn new_patches_are_published_with_their_direct_light() {
    let config = EngineConfig { shadow_points_per_tick_max: 12, ..generous(60) };
    let mut harness = Harness::new(world(4), config, Faults::default()).with_camera(Vec3::ZERO);
    // Without triangles no tile that comes later makes light old.
    for occluders in harness.world.occluders.values_mut() {
        *occluders = std::sync::Arc::new(earthshine_light::Occluders::build(&Default::default()));
    }
    harness.light(ALICE, lamp(Vec3::ONE));
    for _ in 0..100 {
        harness.tick();
        assert_eq!(harness.frame(ALICE).quality.stale_direct, 0);
    }
    assert_eq!(harness.frame(ALICE).patches.len(), 60);
}

#[test]
fn nothing_new_is_not_published() {
    let mut harness = Harness::new(world(5), generous(40), Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    for _ in 0..10 {
        harness.look_from(ALICE, Vec3::ZERO);
        harness.light(ALICE, LightRig::emission_only());
        let done = harness.tick().done;
        assert_eq!((done.frames, done.adds, done.removes, done.slots_lit), (0, 0, 0, 0));
    }
    harness.light(ALICE, LightRig { emission_scale: 2.0, ..LightRig::emission_only() });
    assert_eq!(harness.tick().done.frames, 1);
}
