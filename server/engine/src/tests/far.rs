//! Far light: what coarse levels bring, that the top level is always there, that nothing jumps.

use super::backend::Faults;
use super::harness::{ALICE, Harness, factory, generous};
use super::world::{PatchDraft, RandomWorld, WorldShape};
use crate::{EngineConfig, Frame, PatchLight};
use earthshine_world::{ChunkCoord, Direction, LightRig, Rgb, Sky, Vec3, VoxelCoord};
use std::collections::BTreeMap;

/// A row of plates along x, each facing its neighbours; those beyond x = 40 glow. Chunks are 4 m.
pub(super) fn corridor() -> RandomWorld {
    const LENGTH: i32 = 64;
    let plate = |x: i32| PatchDraft {
        voxel: VoxelCoord::new(x, 0, 0),
        direction: if x % 2 == 0 { Direction::PosY } else { Direction::NegY },
        area: 1.0,
        reflectance: Rgb::new(0.8, 0.6, 0.4),
        emission: if x >= 40 { Rgb::splat(100.0) } else { Rgb::ZERO },
        sky_portion: 0.1,
    };
    let drafts: Vec<_> = (0..LENGTH).map(plate).collect();
    let mut links = Vec::new();
    for i in 0..LENGTH as usize {
        for step in [1, 3, 5, 9, 15] {
            if i + step < LENGTH as usize {
                links.push((i, i + step, 0.1));
            }
        }
    }
    let chunks: Vec<_> = (0..LENGTH / 4).map(|x| ChunkCoord::new(x, 0, 0)).collect();
    RandomWorld::from_drafts(&chunks, &drafts, &links)
}

fn light_of(frame: &Frame) -> BTreeMap<([i32; 3], Direction), PatchLight> {
    frame.patches.iter().map(|light| ((light.voxel.to_array(), light.direction), *light)).collect()
}

/// Relative RMSE of the light of what `frame` holds against `whole`.
fn error(frame: &Frame, whole: &Frame) -> f64 {
    let whole = light_of(whole);
    let (mut gap, mut norm) = (0.0f64, 0.0f64);
    for (place, light) in light_of(frame) {
        let truth = whole[&place].irradiance;
        gap += f64::from((light.irradiance - truth).length_squared());
        norm += f64::from(truth.length_squared());
    }
    (gap / norm).sqrt()
}

fn settled(world: RandomWorld, config: EngineConfig, from: Vec3, rig: &LightRig) -> Harness {
    let mut harness = Harness::new(world, config, Faults::default()).with_camera(from);
    harness.light(ALICE, rig.clone());
    harness.settle();
    harness
}

fn sky() -> LightRig {
    LightRig { sky: Sky::constant(Rgb::splat(2.0)), ..LightRig::emission_only() }
}

/// Goal: streamed in pieces, the corridor has the light of the whole one within what coarse patches explain; without
/// coarse levels it has not. Method: 16 of 64 plates resident at the dark end, the glow 24 plates away.
#[test]
fn a_corridor_in_pieces_has_the_light_of_the_whole() {
    let start = Vec3::new(20.0, 0.5, 0.5);
    let whole = settled(corridor(), generous(1000), start, &sky());
    let few = EngineConfig { load_radius_m: 9.0, coarse_patches_max: 32, ..generous(16) };
    let alone = settled(corridor(), few.clone(), start, &sky());
    let fed = settled(corridor().with_levels(4), few, start, &sky());
    let (with, without) =
        (error(fed.frame(ALICE), whole.frame(ALICE)), error(alone.frame(ALICE), whole.frame(ALICE)));
    assert_eq!((fed.frame(ALICE).patches.len(), fed.frame(ALICE).coarse.len()), (16, 3));
    assert!(with < 0.1 && without > 0.3, "{with} with coarse levels, {without} without");
    for light in fed.frame(ALICE).patches.iter() {
        assert!((light.far_share - light.fed_share).abs() < 1e-5, "no gap: {light:?}");
        assert!((light.known_share + light.far_share - 1.0).abs() < 1e-5, "{light:?}");
    }
}

/// Goal: far light is exact where coarse patches are. Method: a world whose coarse level has one child a parent.
#[test]
fn parents_with_one_child_bring_exact_light() {
    let plate = |x: i32, direction, emission| PatchDraft {
        voxel: VoxelCoord::new(x, 0, 0),
        direction,
        area: 1.0 + x as f32 / 8.0,
        reflectance: Rgb::new(0.5, 0.25, 0.0),
        emission,
        sky_portion: 0.5,
    };
    let drafts = [
        plate(1, Direction::PosX, Rgb::splat(10.0)),
        plate(5, Direction::NegX, Rgb::ZERO),
        plate(9, Direction::PosY, Rgb::splat(3.0)),
    ];
    let chunks = [ChunkCoord::ZERO, ChunkCoord::X, ChunkCoord::X * 2];
    let world = || RandomWorld::from_drafts(&chunks, &drafts, &[(0, 1, 0.3), (1, 2, 0.2), (0, 2, 0.1)]);
    let near = Vec3::new(1.0, 0.5, 0.5);
    let whole = settled(world(), generous(8), near, &sky());
    for levels in [2, 3] {
        for config in [generous(1), EngineConfig { load_radius_m: 1.0, ..generous(8) }] {
            let fed = settled(world().with_levels(levels), config, near, &sky());
            assert_eq!(fed.frame(ALICE).patches.len(), 1);
            assert!(error(fed.frame(ALICE), whole.frame(ALICE)) < 1e-5, "{levels} levels");
        }
    }
}

/// Goal: once the top level is in, there is light wherever the camera goes, at once, and it does not jump.
/// Method: teleports between the ends of the corridor and a slow walk; after every tick the top is whole.
#[test]
fn there_is_never_nothing_to_show() {
    let config =
        EngineConfig { load_radius_m: 9.0, coarse_patches_max: 32, adds_per_tick_max: 4, ..generous(12) };
    let mut harness = settled(corridor().with_levels(4), config, Vec3::ZERO, &sky());
    let top = harness.world.patches_of_level(3);
    let brightest =
        |frame: &Frame| frame.coarse[2].patches.iter().map(|light| light.irradiance.x).fold(0.0, f32::max);
    let rest = brightest(harness.frame(ALICE));
    let step = |harness: &mut Harness, x: f32| {
        harness.look_from(ALICE, Vec3::new(x, 0.5, 0.5));
        harness.tick();
        let frame = harness.frame(ALICE);
        assert_eq!(frame.coarse[2].patches.len(), top);
        assert!((brightest(frame) / rest - 1.0).abs() < 1e-4, "the top level is fed by nobody");
        for light in frame.patches.iter() {
            assert!(
                (light.far_share - light.fed_share).abs() < 1e-4,
                "no gap while the top is whole: {light:?}"
            );
        }
    };
    for x in [63.0, 1.0, 40.0, 20.0] {
        (0..15).for_each(|_| step(&mut harness, x));
    }
    let mut before: BTreeMap<_, PatchLight> = BTreeMap::new();
    for tick in 0..200 {
        step(&mut harness, 20.0 + tick as f32 * 0.1);
        let now = light_of(harness.frame(ALICE));
        for (place, light) in &now {
            if let Some(before) = before.get(place) {
                let jump = (light.irradiance - before.irradiance).abs().max_element();
                assert!(jump < 0.25 * before.irradiance.max_element(), "{place:?} {before:?} {light:?}");
            }
        }
        before = now;
    }
    harness.settle();
}

/// Goal: what no level holds stays a gap: it is told and brings nothing, not even the sky.
#[test]
fn what_no_level_holds_is_a_gap() {
    let start = Vec3::new(20.0, 0.5, 0.5);
    let config = EngineConfig { load_radius_m: 3.0, coarse_patches_max: 4, ..generous(4) };
    // Two levels, of which the upper has far more patches than slots: it is not pinned.
    let harness = settled(corridor().with_levels(2), config, start, &sky());
    let frame = harness.frame(ALICE);
    assert_eq!((frame.patches.len(), frame.coarse[0].patches.len()), (4, 4));
    assert!(frame.patches.iter().any(|light| light.fed_share + 0.05 < light.far_share), "{frame:?}");
    let whole = settled(corridor(), generous(1000), start, &sky());
    let whole = light_of(whole.frame(ALICE));
    for (place, light) in light_of(frame) {
        assert!(light.irradiance.x < whole[&place].irradiance.x * 1.05, "{light:?}");
    }
}

/// Goal: coarse sets swap, forget and come back without a trace. Method: there and back again.
#[test]
fn a_flight_returns_to_the_same_far_light() {
    let world =
        RandomWorld::new(31, WorldShape { chunks: [7, 2, 6], ..WorldShape::default() }).with_levels(3);
    let config = EngineConfig { load_radius_m: 9.0, coarse_patches_max: 20, ..generous(15) };
    let backends = factory(Faults::default());
    let mut harness = Harness::with_backends(world, config, backends).with_camera(Vec3::ZERO);
    harness.light(ALICE, sky());
    harness.settle();
    let before = light_of(harness.frame(ALICE));
    assert!(before.values().any(|light| light.fed_share > 0.05));
    harness.look_from(ALICE, Vec3::new(18.0, 2.0, 12.0));
    harness.settle();
    assert_ne!(light_of(harness.frame(ALICE)), before);
    harness.look_from(ALICE, Vec3::ZERO);
    harness.settle();
    for (place, light) in light_of(harness.frame(ALICE)) {
        let gap = (light.irradiance - before[&place].irradiance).abs().max_element();
        assert!(gap < 1e-5 * before[&place].irradiance.max_element().max(1.0), "{place:?}");
    }
}
