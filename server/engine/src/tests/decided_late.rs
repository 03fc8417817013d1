//! A backend that finds out later who is refused and how far it has drifted: ticks go on meanwhile, and end where one that
//! knows at once ends.

use super::backend::Faults;
use super::harness::{ALICE, Harness, generous, lamp};
use super::world::{RandomWorld, WorldShape};
use crate::EngineConfig;
use earthshine_world::{LightRig, Patch, Rgb, Sky, Vec3};
use std::collections::BTreeSet;

const WEAK_ONE_IN: u64 = 3;

fn world(seed: u64) -> RandomWorld {
    RandomWorld::new(seed, WorldShape::default())
}

fn lit() -> LightRig {
    LightRig { sky: Sky::constant(Rgb::splat(1e3)), ..lamp(Vec3::new(2.0, 3.0, 2.0)) }
}

/// Where patches are that a backend with weak pivots refuses.
fn weak_places(world: &RandomWorld) -> BTreeSet<([i32; 3], usize)> {
    let patches = world.chunks.values().flat_map(|chunk| chunk.patches.iter());
    let is_weak = |patch: &&Patch| {
        let reflectance = patch.reflectance.min(Rgb::splat(Patch::REFLECTANCE_MAX));
        u64::from(reflectance.x.to_bits() >> 3).is_multiple_of(WEAK_ONE_IN)
    };
    patches.filter(is_weak).map(|patch| (patch.voxel.to_array(), patch.direction as usize)).collect()
}

fn assert_nothing_of_the_weak(harness: &Harness, weak: &BTreeSet<([i32; 3], usize)>) {
    for frame in harness.frames.values() {
        for light in frame.patches.iter() {
            let place = (light.voxel.to_array(), light.direction as usize);
            assert!(!weak.contains(&place), "light of a refused patch at {place:?}");
        }
    }
}

/// Goal: who is refused late is as if it had been refused at once: its place goes to the next, it is offered once and counted,
/// and no frame ever has light of it. Method: the same life with refusals at once and up to five ticks late, the light of
/// every patch compared at rest.
#[test]
fn who_is_refused_late_has_never_been_there() {
    let at_once = Faults { weak_one_in: WEAK_ONE_IN, ..Faults::default() };
    let ends = [(false, 0), (true, 0), (true, 1), (true, 5)].map(|(decides_late, late_ticks)| {
        let faults = Faults { decides_late, late_ticks, ..at_once };
        let mut harness = Harness::new(world(5), generous(20), faults).with_camera(Vec3::ZERO);
        harness.light(ALICE, lit());
        let weak = weak_places(&harness.world);
        let mut ticks = 0;
        while !(harness.tick().settled && harness.events.is_empty()) {
            assert_nothing_of_the_weak(&harness, &weak);
            ticks += 1;
            assert!(ticks < 2000, "{:?}", harness.engine.stats());
        }
        let stats = harness.engine.stats();
        assert!(stats.counters.weak_pivots > 3, "{stats:?}");
        assert_eq!(stats.counters.weak_pivots, u64::from(stats.sessions[0].refused_patches), "offered once");
        (harness.frame(ALICE).patches.to_vec(), stats.counters.weak_pivots)
    });
    let [(at_once, refused), late @ ..] = &ends;
    assert_eq!(at_once.len(), 20);
    for (patches, refused_late) in late {
        assert_eq!(refused_late, refused);
        assert_eq!(patches.len(), at_once.len());
        for (late, now) in patches.iter().zip(at_once) {
            assert_eq!((late.voxel, late.direction), (now.voxel, now.direction));
            let gap = (late.irradiance - now.irradiance).abs().max_element();
            assert!(gap <= 1e-4 * now.irradiance.max_element(), "{late:?} for {now:?}");
            assert!((late.known_share - now.known_share).abs() < 1e-5, "{late:?} for {now:?}");
        }
    }
}

/// Goal: a refusal never hits the patch that has the slot by then. Method: a camera that jumps every other tick, so that most
/// who are refused have left before that is told; invariants are checked after every tick, and in the end all is in order.
#[test]
fn a_refusal_is_of_the_patch_that_was_refused() {
    for late_ticks in [0, 2, 5] {
        let faults = Faults { weak_one_in: WEAK_ONE_IN, decides_late: true, late_ticks, ..Faults::default() };
        let config = EngineConfig { adds_per_tick_max: 16, removals_per_tick_max: 16, ..generous(12) };
        let mut harness = Harness::new(world(9), config, faults).with_camera(Vec3::ZERO);
        let weak = weak_places(&harness.world);
        for turn in 0..200 {
            let places = [Vec3::ZERO, Vec3::new(8.0, 0.0, 0.0), Vec3::new(4.0, 0.0, 8.0)];
            harness.look_from(ALICE, places[turn / 2 % 3]);
            harness.tick();
            assert_nothing_of_the_weak(&harness, &weak);
        }
        harness.settle();
        let stats = harness.engine.stats();
        assert!(stats.counters.weak_pivots > 0, "{stats:?}");
        assert_eq!(stats.sessions[0].resident_patches, stats.sessions[0].wanted_patches);
        assert_nothing_of_the_weak(&harness, &weak);
    }
}

/// Goal: a probe that is told late is asked for once, and starts a repair then. Method: a backend that has drifted.
#[test]
fn a_probe_that_is_told_late_starts_a_repair_then() {
    let config = EngineConfig { drift_probe_every_swaps: 10, drift_max: 1e-4, ..generous(10) };
    let faults = Faults { drift: 1e-3, decides_late: true, late_ticks: 4, ..Faults::default() };
    let mut harness = Harness::new(world(8), config, faults).with_camera(Vec3::ZERO);
    harness.settle();
    let counters = harness.engine.stats().counters;
    assert_eq!((counters.drift_probes, counters.resolves), (1, 1));
    assert!(counters.adds >= 10 && counters.adds < 20, "swaps for one probe: {counters:?}");
    assert!((harness.engine.stats().sessions[0].drift - 1e-3).abs() < 1e-9);
}
