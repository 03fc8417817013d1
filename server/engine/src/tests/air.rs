//! Light in empty air: the test worlds have, behind patches, receivers with the patch's own row.

use super::backend::Faults;
use super::harness::{ALICE, BOB, Harness, generous, lamp};
use super::world::{RandomWorld, WorldShape};
use crate::{EngineConfig, Event, Frame, PatchLight};
use earthshine_world::{Direction, LightRig, Rgb, Sky, Vec3};
use std::collections::BTreeMap;

fn world(seed: u64) -> RandomWorld {
    RandomWorld::new(
        seed,
        WorldShape { chunks: [4, 2, 3], patches_per_chunk_max: 12, ..WorldShape::default() },
    )
}

fn rig() -> LightRig {
    LightRig { sky: Sky::constant(Rgb::new(1.0, 2.0, 3.0)), ..lamp(Vec3::ONE) }
}

/// Each receiver beside the patch whose row it has.
fn pairs(frame: &Frame) -> Vec<(PatchLight, PatchLight)> {
    let place = |light: &PatchLight| (light.voxel.to_array(), light.direction);
    let patches: BTreeMap<_, _> = frame.patches.iter().map(|light| (place(light), *light)).collect();
    frame
        .receivers
        .iter()
        .map(|air| {
            let opposite = Direction::ALL[air.direction.index() ^ 1];
            (*air, patches[&(air.voxel.to_array(), opposite)])
        })
        .collect()
}

/// Goal: a receiver gathers what a patch with its row receives. Method: both are published; they must agree.
#[test]
fn air_with_a_patch_s_row_has_the_patch_s_light() {
    let mut harness = Harness::new(world(5), generous(1000), Faults::default()).with_camera(Vec3::ZERO);
    harness.light(ALICE, rig());
    harness.settle();
    let compare = |harness: &Harness| {
        let pairs = pairs(harness.frame(ALICE));
        assert!(pairs.len() > 40, "{} receivers", pairs.len());
        for (air, patch) in &pairs {
            let gap = (air.irradiance - patch.irradiance).abs().max_element();
            assert!(gap <= 1e-4 * patch.irradiance.max_element(), "{air:?} beside {patch:?}");
            assert_eq!(air.sky_irradiance, patch.sky_irradiance);
            assert!((air.known_share - patch.known_share).abs() < 1e-5);
        }
        pairs.iter().map(|(air, _)| air.irradiance.x).sum::<f32>()
    };
    let dim = compare(&harness);
    harness.light(ALICE, LightRig { emission_scale: 100.0, ..rig() });
    harness.settle();
    assert!(compare(&harness) > 1.5 * dim, "the air follows the light");
}

#[test]
fn rows_of_receivers_keep_their_budget_and_nobody_starves() {
    let config = EngineConfig { receiver_rows_per_tick_max: 7, ..generous(1000) };
    let mut harness = Harness::new(world(6), config, Faults::default()).with_camera(Vec3::ZERO);
    harness.events.push(Event::SessionOpened { session: BOB });
    harness.look_from(BOB, Vec3::new(9.0, 0.0, 0.0));
    for step in 0..200 {
        // The light never stands still.
        let emission_scale = 1.0 + step as f32;
        harness.light(ALICE, LightRig { emission_scale, ..rig() });
        let done = harness.tick().done.receiver_rows;
        // A voxel has up to six rows, and each session's first is always gathered.
        assert!(done <= 7 + 6, "{done}");
    }
    assert!(pairs(harness.frame(ALICE)).len() > 40);
    harness.settle();
    for session in [ALICE, BOB] {
        for (air, patch) in pairs(harness.frame(session)) {
            let gap = (air.irradiance - patch.irradiance).abs().max_element();
            assert!(gap <= 1e-4 * patch.irradiance.max_element(), "{air:?} beside {patch:?}");
        }
    }
}

#[test]
fn the_nearest_voxels_are_told_of_and_none_is_an_answer() {
    for receiver_voxels_max in [0, 5] {
        let config = EngineConfig { receiver_voxels_max, ..generous(1000) };
        let camera = Vec3::new(2.0, 1.0, 1.0);
        let mut harness = Harness::new(world(7), config, Faults::default()).with_camera(camera);
        harness.settle();
        let mut voxels: Vec<_> =
            harness.frame(ALICE).receivers.iter().map(|air| air.voxel.to_array()).collect();
        voxels.dedup();
        let grid = harness.world.index.grid;
        let mut all: Vec<_> = harness
            .world
            .chunks
            .values()
            .flat_map(|chunk| chunk.receivers.places.iter().map(|place| place.voxel.to_array()))
            .collect();
        all.sort_unstable();
        all.dedup();
        let distance = |voxel: &[i32; 3]| grid.voxel_centre((*voxel).into()).distance_squared(camera);
        all.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        let farthest = all.get(receiver_voxels_max as usize).map_or(f32::MAX, distance);
        assert_eq!(voxels.len(), receiver_voxels_max as usize);
        assert!(voxels.iter().all(|voxel| distance(voxel) <= farthest));
    }
}

/// Goal: air whose light is mostly not resident is left to others instead of told dark.
#[test]
fn air_that_knows_too_little_is_silent() {
    let mut harness = Harness::new(world(8), generous(4), Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    let frame = harness.frame(ALICE);
    assert!(frame.receivers.iter().all(|air| air.known_share >= 0.5));
    let all: usize = harness.world.chunks.values().map(|chunk| chunk.receivers.places.len()).sum();
    assert!(frame.receivers.len() < all, "{} of {all}", frame.receivers.len());
}
