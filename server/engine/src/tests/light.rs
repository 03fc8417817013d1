//! What light is published: closed forms, rows in three parts, lights that change.

use super::backend::Faults;
use super::harness::{ALICE, Harness, generous, lamp};
use super::world::{PatchDraft, RandomWorld, WorldShape};
use crate::{EngineConfig, PatchLight};
use earthshine_light::Occluders;
use earthshine_world::{
    ChunkCoord, ChunkId, Direction, Light, LightRig, OccluderMesh, Rgb, Sky, Vec3, VoxelCoord,
};
use std::f32::consts::PI;
use std::sync::Arc;

const SHARE: f32 = 0.3;

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
    RandomWorld::from_drafts(&[ChunkCoord::ZERO, ChunkCoord::X, ChunkCoord::Y], &drafts, &[(0, 1, SHARE)])
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
    let brighter = lit.iter().zip(&dark).filter(|(a, b)| a.irradiance.x > b.irradiance.x + 1e-4).count();
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
    for (a, b) in after.iter().zip(&before) {
        assert!(a.voxel == b.voxel && close(a.irradiance, b.irradiance), "{a:?} {b:?}");
    }
}

/// Goal: every tile in memory casts shadows, whether it has patches or not. Method: a lamp between the plates and a wall
/// between lamp and second plate, in a chunk of its own: all light on the first comes from what it gave the second.
#[test]
fn walls_of_chunks_without_patches_cast_shadows() {
    let wall = OccluderMesh {
        vertices: [[4.5, -9.0, -9.0], [4.5, 9.0, -9.0], [4.5, 9.0, 9.0], [4.5, -9.0, 9.0]]
            .map(Vec3::from)
            .to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        surfaces: vec![[255; 4]; 2],
    };
    let plates = |wall: OccluderMesh| {
        let mut world = two_plates();
        let id = ChunkId::new(0, ChunkCoord::Y);
        world.occluders.insert(id, Arc::new(Occluders::build(&wall)));
        let chunk = Arc::get_mut(world.chunks.get_mut(&id).unwrap()).unwrap();
        chunk.occluders = wall;
        let mut harness = Harness::new(world, generous(8), Faults::default()).with_camera(Vec3::ZERO);
        harness.light(ALICE, LightRig { emission_scale: 0.0, ..lamp(Vec3::new(3.0, 0.5, 0.5)) });
        harness.settle();
        let patches = &harness.frame(ALICE).patches;
        (at(patches, 1).irradiance, at(patches, 5).irradiance)
    };
    let rho = Rgb::new(0.5, 0.25, 0.0);
    let (first, second) = plates(wall);
    assert!(second.x > 0.1 && close(first, SHARE * rho * second), "{first} {second}");
    let (first, second) = plates(OccluderMesh::default());
    assert!(first.x > 2.0 * SHARE * rho.x * second.x, "{first} {second}");
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
