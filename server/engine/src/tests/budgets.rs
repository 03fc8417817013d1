//! What one tick may do, and that what it could not do is done later.

use super::backend::Faults;
use super::harness::{ALICE, BOB, Harness, generous, lamp, still};
use super::world::{RandomWorld, WorldShape};
use crate::{EngineConfig, Event};
use earthshine_world::{Camera, LightRig, Vec3};

fn world(seed: u64) -> RandomWorld {
    RandomWorld::new(
        seed,
        WorldShape { chunks: [4, 2, 3], patches_per_chunk_max: 12, ..WorldShape::default() },
    )
}

#[test]
fn adds_and_removals_keep_their_budgets_over_all_sessions() {
    for (adds_per_tick_max, removals_per_tick_max) in [(1, 1), (3, 2), (2, 7), (100, 100)] {
        let config =
            EngineConfig { adds_per_tick_max, removals_per_tick_max, coarse_patches_max: 1, ..generous(25) };
        let mut harness = Harness::new(world(1), config, Faults::default()).with_camera(Vec3::ZERO);
        harness.events.push(Event::SessionOpened { session: BOB });
        harness.look_from(BOB, Vec3::new(9.0, 0.0, 0.0));
        for round in 0..3 {
            for _ in 0..400 {
                let stats = harness.tick();
                // Where slots are free adds are cheap; a full matrix has to make room for each.
                let is_full = stats.done.removes >= stats.done.adds;
                let cheaper = if is_full { 1 } else { EngineConfig::CHEAPER_SWAPS_LIMIT };
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

/// Goal: ticks that take too long do less of what can wait, and all of it gets done. Method: a fifth of the effort, and efforts that
/// cannot be.
#[test]
fn an_effort_scales_what_a_tick_does() {
    let config = EngineConfig { adds_per_tick_max: 10, coarse_patches_max: 1, ..generous(25) };
    let mut harness = Harness::new(world(6), config, Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    for share in [0.0, -1.0, 1.5, f32::NAN] {
        harness.events.push(Event::Effort { share });
    }
    assert_eq!(harness.tick().done.ignored.paces, 4);
    assert_eq!(harness.engine.stats().effort, 1.0);
    harness.events.push(Event::Effort { share: 0.2 });
    harness.look_from(ALICE, Vec3::new(3.0, 1.0, 2.0));
    let mut swaps = 0;
    for _ in 0..400 {
        let stats = harness.tick();
        assert!(
            stats.done.adds <= 2 && stats.done.swap_work <= 2 * u64::from(EngineConfig::CHEAPER_SWAPS_LIMIT)
        );
        swaps += stats.done.adds;
        if stats.settled && harness.events.is_empty() {
            break;
        }
    }
    assert!(swaps > 4, "{swaps}");
    harness.settle();
    assert_eq!(harness.frame(ALICE).patches.len(), 25);
}

/// Goal: a fast camera gets as many slots as can be kept filled, and all of them back when it stands; in between there is never
/// less light than that.
#[test]
fn fast_cameras_have_smaller_sets() {
    let config =
        EngineConfig { adds_per_tick_max: 1, removals_per_tick_max: 1, load_radius_m: 30.0, ..generous(60) };
    let world = world(7);
    let prospect = world.prospect(&config);
    let means = crate::Means { tick_rate_hz: 60.0, tile_bytes_per_s: 1e9 };
    let mut harness = Harness::new(world, config, Faults::default());
    harness.engine = harness.engine.with_promise(prospect, means);
    harness = harness.with_camera(Vec3::ZERO);
    harness.settle();
    let slots = |harness: &Harness| harness.frame(ALICE).patches.len();
    assert_eq!(slots(&harness), 60);
    let look_at = |harness: &mut Harness, velocity: Vec3| {
        let camera = Camera { velocity, ..still(Vec3::ZERO) };
        harness.events.push(Event::Camera { session: ALICE, camera });
        harness.settle();
        slots(harness)
    };
    let fast = look_at(&mut harness, Vec3::X * 200.0);
    assert!((1..30).contains(&fast), "{fast}");
    let quality = harness.frame(ALICE).quality;
    assert_eq!((quality.resident_patches, quality.wanted_patches), (fast as u32, fast as u32));
    assert_eq!(look_at(&mut harness, Vec3::ZERO), 60);
}
