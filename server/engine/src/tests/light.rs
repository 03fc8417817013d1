//! What light is published: closed forms, rows in three parts, lights that change.

use super::backend::Faults;
use super::harness::{ALICE, Harness, factory, generous, lamp};
use super::world::{PatchDraft, RandomWorld, WorldShape};
use crate::{EngineConfig, Means, PatchLight};
use earthshine_light::Occluders;
use earthshine_radiosity::CpuBackend;
use earthshine_world::{
    ChunkCoord, ChunkId, Direction, Light, LightRig, OccluderMesh, Rgb, Sky, Vec3, VoxelCoord,
};
use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::sync::Arc;

const SHARE: f32 = 0.3;
/// Has no patches.
const WALL_CHUNK: ChunkCoord = ChunkCoord::new(0, 0, 5);

/// Two plates that face each other, the first emitting, areas 1 and 2, in two chunks.
fn two_plates() -> RandomWorld {
    let plate = |x, direction, area, emission| PatchDraft {
        voxel: VoxelCoord::new(x, 0, 0),
        direction,
        area,
        reflectance: Rgb::new(0.5, 0.25, 0.0),
        emission,
        sky_portion: 0.5,
    };
    let drafts =
        [plate(1, Direction::PosX, 1.0, Rgb::splat(10.0)), plate(5, Direction::NegX, 2.0, Rgb::ZERO)];
    RandomWorld::from_drafts(&[ChunkCoord::ZERO, ChunkCoord::X, WALL_CHUNK], &drafts, &[(0, 1, SHARE)])
}

fn close(a: Rgb, b: Rgb) -> bool {
    (a - b).abs().max_element() <= 1e-5 * b.abs().max_element().max(1.0)
}

fn at(patches: &[PatchLight], x: i32) -> PatchLight {
    *patches.iter().find(|light| light.voxel.x == x).expect("the plate is resident")
}

/// `I_1 = f (rho I_2) + o_1`, `I_2 = f/2 (E + rho I_1) + o_2` in closed form, with and without a sky.
#[test]
fn two_plates_have_their_closed_form() {
    for radiance in [0.0, 7.0] {
        let mut harness = Harness::new(two_plates(), generous(8), Faults::default()).with_camera(Vec3::ZERO);
        harness
            .light(ALICE, LightRig { sky: Sky::constant(Rgb::splat(radiance)), ..LightRig::emission_only() });
        harness.settle();
        let (forth, back) = (SHARE, SHARE / 2.0);
        let sky = |share: f32| 0.5 * (1.0 - share) * PI * radiance;
        let rho = Rgb::new(0.5, 0.25, 0.0);
        let second = (back * (Rgb::splat(10.0) + rho * sky(forth)) + sky(back))
            / (Rgb::ONE - rho * rho * forth * back);
        let first = forth * rho * second + sky(forth);
        let patches = &harness.frame(ALICE).patches;
        assert!(close(at(patches, 1).irradiance, first), "{patches:?}, expected {first}");
        assert!(close(at(patches, 5).irradiance, second), "{patches:?}, expected {second}");
        assert!(close(at(patches, 5).sky_irradiance, Rgb::splat(sky(back))));
        assert!(patches.iter().all(|light| light.far_share == 0.0 && (light.known_share - 1.0).abs() < 1e-6));
    }
}

/// Goal: what emits beside what does not sends its light, and what arrives at the other is told of the place. Method: the
/// first plate of two carries a lamp of a tenth of its area, a patch of the same voxel and direction.
#[test]
fn of_two_patches_in_one_place_the_one_that_does_not_emit_is_told() {
    let rho = Rgb::new(0.5, 0.25, 0.0);
    let plate = |x, direction, area, emission| PatchDraft {
        voxel: VoxelCoord::new(x, 0, 0),
        direction,
        area,
        reflectance: rho,
        emission: Rgb::splat(emission),
        sky_portion: 0.5,
    };
    let [wall, lamp] =
        [(1.0, 0.0), (0.1, 10.0)].map(|(area, emission)| plate(1, Direction::PosX, area, emission));
    let drafts = [wall, lamp, plate(5, Direction::NegX, 2.0, 0.0)];
    let links = [(0, 2, SHARE), (1, 2, SHARE)];
    let world = RandomWorld::from_drafts(&[ChunkCoord::ZERO, ChunkCoord::X], &drafts, &links);
    let mut harness = Harness::new(world, generous(8), Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    let (of_wall, of_lamp) = (SHARE / 2.0, SHARE * 0.05);
    let far = 10.0 * of_lamp / (Rgb::ONE - rho * rho * SHARE * (of_wall + of_lamp));
    let patches = &harness.frame(ALICE).patches;
    assert_eq!(patches.len(), 2, "{patches:?}");
    assert!(close(at(patches, 5).irradiance, far), "{patches:?}, expected {far}");
    assert!(close(at(patches, 1).irradiance, SHARE * rho * far), "{patches:?}");
}

/// Goal: what is not resident is dropped and reported, and the sky does not shine through it.
#[test]
fn far_light_is_never_the_skys() {
    let rig = LightRig { sky: Sky::constant(Rgb::ONE), ..LightRig::emission_only() };
    let near = Vec3::new(1.0, 0.5, 0.5);
    let few_slots = generous(1);
    let short_radius = EngineConfig { load_radius_m: 1.0, ..generous(8) };
    for config in [few_slots, short_radius] {
        let mut harness = Harness::new(two_plates(), config, Faults::default()).with_camera(near);
        harness.light(ALICE, rig.clone());
        harness.settle();
        let [light] = harness.frame(ALICE).patches[..] else { panic!("one patch is resident") };
        let sky = Rgb::splat(0.5 * (1.0 - SHARE) * PI);
        assert!(close(light.irradiance, sky) && close(light.sky_irradiance, sky), "{light:?}");
        assert!((light.far_share - SHARE).abs() < 1e-6 && (light.known_share - (1.0 - SHARE)).abs() < 1e-6);
    }
}

#[test]
fn a_lamp_lights_what_faces_it_through_the_other_plate() {
    let mut harness = Harness::new(two_plates(), generous(8), Faults::default()).with_camera(Vec3::ZERO);
    harness.light(ALICE, LightRig { emission_scale: 0.0, ..lamp(Vec3::new(1.75, 0.5, 3.5)) });
    harness.settle();
    // 3 m beside the first plate's centroid and half a metre in front of it, well in front of the second's.
    let plate = |x: f32, normal: f32| {
        let towards = Vec3::new(1.75, 0.5, 3.5) - Vec3::new(x, 0.5, 0.5);
        100.0 * (towards.x * normal).max(0.0) / towards.length().powi(3)
    };
    let (direct_first, direct_second) = (plate(1.75, 1.0), plate(5.25, -1.0));
    assert!(direct_first < 1e-3, "the lamp is in the plate's plane");
    let rho = Rgb::new(0.5, 0.25, 0.0);
    let exitance = rho * direct_second;
    let first = SHARE * exitance / (Rgb::ONE - rho * rho * SHARE * SHARE / 2.0);
    let patches = &harness.frame(ALICE).patches;
    let found = at(patches, 1).irradiance;
    // Sample points spread over some centimetres.
    assert!((found - first).abs().max_element() < 0.02 * first.max_element(), "{found}, expected {first}");
}

#[test]
fn light_off_returns_to_the_same_values() {
    let world = RandomWorld::new(21, WorldShape::default());
    let mut harness = Harness::new(world, generous(500), Faults::default()).with_camera(Vec3::ZERO);
    harness.settle();
    let dark = harness.frame(ALICE).patches.clone();
    harness.light(ALICE, lamp(Vec3::new(2.0, 2.0, 2.0)));
    harness.settle();
    let lit = harness.frame(ALICE).patches.clone();
    let brighter =
        lit.iter().zip(dark.iter()).filter(|(a, b)| a.irradiance.x > b.irradiance.x + 1e-4).count();
    assert!(brighter > dark.len() / 4, "{brighter} of {} patches got brighter", dark.len());
    harness.light(ALICE, LightRig::emission_only());
    harness.settle();
    assert_eq!(harness.frame(ALICE).patches, dark);
}

/// Goal: light rests on the resident set alone. A flight away and back gives the light of before.
#[test]
fn a_flight_returns_to_the_same_light() {
    let world = RandomWorld::new(22, WorldShape::default());
    let mut harness = Harness::new(world, generous(15), Faults::default()).with_camera(Vec3::ZERO);
    harness.light(ALICE, lamp(Vec3::new(2.0, 2.0, 2.0)));
    harness.settle();
    let before = harness.frame(ALICE).patches.clone();
    harness.look_from(ALICE, Vec3::new(12.0, 2.0, 8.0));
    harness.settle();
    assert_ne!(harness.frame(ALICE).patches, before);
    harness.look_from(ALICE, Vec3::ZERO);
    harness.settle();
    let after = &harness.frame(ALICE).patches;
    assert_eq!(after.len(), before.len());
    for (a, b) in after.iter().zip(before.iter()) {
        assert!(a.voxel == b.voxel && close(a.irradiance, b.irradiance), "{a:?} {b:?}");
    }
}

/// Goal: light that a backend tells late is whole, belongs to the patch that is told of, and is the same in the end; a patch
/// without light yet is not shown, black or with its predecessor's light, and counts as missing. Method: a flight on which
/// every slot changes hands, its lights told at once and some ticks later; what is shown on the way is held against the
/// light that its patch had in any of the frames told at once.
#[test]
fn light_that_is_told_late_is_the_patchs_own() {
    type Shown = BTreeMap<([i32; 3], Direction), Vec<Rgb>>;
    let fly = |late_ticks| {
        let world = RandomWorld::new(25, WorldShape { chunks: [6, 1, 2], ..WorldShape::default() });
        let prospect = world.prospect(&generous(12));
        let faults = Faults { late_ticks, ..Faults::default() };
        let mut harness = Harness::new(world, generous(12), faults);
        let means = Means { tick_rate_hz: 60.0, tile_bytes_per_s: 1e9 };
        harness.engine = harness.engine.with_promise(prospect, means);
        let mut harness = harness.with_camera(Vec3::ZERO);
        harness.light(ALICE, LightRig { sky: Sky::constant(Rgb::ONE), ..LightRig::emission_only() });
        let (mut shown, mut fewer) = (Shown::new(), 0);
        for step in 0..30 {
            harness.look_from(ALICE, Vec3::new(step as f32, 0.5, 1.0));
            for _ in 0..3 {
                harness.tick();
                let Some(frame) = harness.frames.get(&ALICE) else { continue };
                fewer += u32::from(frame.quality.resident_patches as usize > frame.patches.len());
                for light in frame.patches.iter() {
                    let place = (light.voxel.to_array(), light.direction);
                    shown.entry(place).or_default().push(light.irradiance);
                }
            }
        }
        harness.settle();
        (shown, fewer, harness.frame(ALICE).patches.clone())
    };
    let (at_once, fewer, end) = fly(0);
    assert_eq!(fewer, 0, "who is told at once shows everybody");
    let (late, fewer, late_end) = fly(2);
    assert!(fewer > 20, "{fewer} frames wait for light");
    assert_eq!(late_end, end);
    for (place, lights) in late {
        for light in lights {
            assert!(at_once[&place].contains(&light), "{place:?} was never lit like {light}");
        }
    }
}

/// Goal: the local matrix and plain iteration agree on the same world after the same flight, through this engine.
#[test]
fn the_cpu_backend_gives_the_light_of_plain_iteration() {
    let shape =
        WorldShape { chunks: [5, 2, 4], patches_per_chunk_max: 12, links_per_patch: 8, has_occluders: true };
    let fly = |backends| {
        let world = RandomWorld::new(24, shape);
        let mut harness = Harness::with_backends(world, generous(60), backends).with_camera(Vec3::ZERO);
        harness.light(ALICE, LightRig { sky: Sky::constant(Rgb::ONE), ..lamp(Vec3::splat(2.0)) });
        for step in 0..8 {
            harness.look_from(ALICE, Vec3::new(step as f32 * 2.0, 1.0, step as f32));
            harness.settle();
        }
        harness.frame(ALICE).patches.clone()
    };
    let cpu = fly(Box::new(|capacity| Ok(Box::new(CpuBackend::new(capacity).unwrap()))));
    let iterated = fly(factory(Faults::default()));
    assert_eq!((cpu.len(), iterated.len()), (60, 60));
    for (a, b) in cpu.iter().zip(iterated.iter()) {
        assert_eq!((a.voxel, a.direction, a.known_share), (b.voxel, b.direction, b.known_share));
        let error = (a.irradiance - b.irradiance).abs().max_element();
        assert!(error <= 1e-4 * b.irradiance.max_element().max(1.0), "{a:?} {b:?}");
    }
}

/// Goal: every tile in memory casts shadows, whether it has patches or not, and only while it is there. Method: a lamp
/// between the plates and a wall between lamp and second plate, in a chunk that is loaded from 4 m along z on: behind
/// the wall all light on the first plate comes from what it gave the second.
#[test]
fn walls_of_chunks_without_patches_cast_shadows() {
    let wall = OccluderMesh {
        vertices: [[4.5, -9.0, -9.0], [4.5, 9.0, -9.0], [4.5, 9.0, 9.0], [4.5, -9.0, 9.0]]
            .map(Vec3::from)
            .to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        surfaces: vec![[255; 4]; 2],
    };
    let mut world = two_plates();
    let id = ChunkId::new(0, WALL_CHUNK);
    world.occluders.insert(id, Arc::new(Occluders::build(&wall)));
    Arc::get_mut(world.chunks.get_mut(&id).unwrap()).unwrap().occluders = wall;
    let config = EngineConfig { load_radius_m: 18.0, ..generous(8) };
    let mut harness = Harness::new(world, config, Faults::default()).with_camera(Vec3::ZERO);
    harness.light(ALICE, LightRig { emission_scale: 0.0, ..lamp(Vec3::new(3.0, 0.5, 0.5)) });
    let rho = Rgb::new(0.5, 0.25, 0.0);
    for is_walled in [false, true, false] {
        harness.look_from(ALICE, Vec3::Z * if is_walled { 4.0 } else { 0.0 });
        harness.settle();
        let patches = &harness.frame(ALICE).patches;
        let (first, second) = (at(patches, 1).irradiance, at(patches, 5).irradiance);
        let by_first_alone = SHARE * rho * second;
        assert!(second.x > 0.1 && close(first, by_first_alone) == is_walled, "{is_walled}: {first} {second}");
        assert!(is_walled || first.x > 2.0 * by_first_alone.x, "{first} {second}");
    }
}

#[test]
fn a_changed_sky_costs_no_rays_and_an_equal_rig_no_frame() {
    let world = RandomWorld::new(23, WorldShape::default());
    let mut harness = Harness::new(world, generous(500), Faults::default()).with_camera(Vec3::ZERO);
    harness.light(ALICE, lamp(Vec3::ONE));
    harness.settle();
    harness.light(ALICE, LightRig { sky: Sky::constant(Rgb::ONE), ..lamp(Vec3::ONE) });
    let stats = harness.tick();
    assert_eq!((stats.done.rays, stats.done.frames, stats.settled), (0, 1, true));
    harness.light(ALICE, LightRig { sky: Sky::constant(Rgb::ONE), ..lamp(Vec3::ONE) });
    harness.look_from(ALICE, Vec3::ZERO);
    assert_eq!(harness.tick().done.frames, 0);
}

#[test]
fn lights_beyond_all_measure_give_finite_light() {
    let mut harness = Harness::new(two_plates(), generous(8), Faults::default()).with_camera(Vec3::ZERO);
    let sun = Light::Directional {
        direction: Vec3::NEG_X,
        illuminance: Rgb::splat(f32::MAX),
        angular_diameter_rad: 0.01,
    };
    let sky = Sky::constant(Rgb::splat(f32::MAX));
    harness.light(ALICE, LightRig { lights: vec![sun; 3], sky, emission_scale: f32::MAX });
    harness.settle();
    assert!(harness.frame(ALICE).patches.iter().all(|light| light.irradiance.is_finite()));
    assert!(harness.engine.stats().counters.limited_sources > 0);
}
