//! Both sides of a wall have their own light, from the bake through server and client to the lookup at its feet.
//!
//! The oracle is the path tracer, in the scene itself.

use earthshine_client::Vec3;
use earthshine_render::{PointEstimate, ReferenceOptions, SceneTracer, irradiance_at_points};
use earthshine_scene::{Material, Scene};
use earthshine_tests::baked::{BakedWorld, coarse};
use earthshine_tests::served::ServedWorld;
use earthshine_tests::viewer::{connect, settled_at};
use earthshine_tiles::BakeParameters;
use earthshine_volume::{Volume, barrier, lookup};
use earthshine_world::{Light, LightRig, Rgb};

/// Inside of both rooms together, m.
const HOUSE: Vec3 = Vec3::new(6.0, 2.4, 3.0);
/// Where the wall between them stands: in the middle of detail voxels, not at their borders.
const WALL_M: f32 = 2.7;
const WALL_HALF_M: f32 = 0.03;
const VOXEL_M: f32 = 0.4;

/// The six sides of a solid, counter-clockwise from outside.
fn solid(low: Vec3, high: Vec3) -> impl Iterator<Item = [Vec3; 3]> {
    let size = high - low;
    [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(move |axis| {
        let (across, up) =
            (size * Vec3::new(axis.z, axis.x, axis.y), size * Vec3::new(axis.y, axis.z, axis.x));
        let quad = |corner: Vec3, across: Vec3, up: Vec3| {
            [[corner, corner + across, corner + across + up], [corner, corner + across + up, corner + up]]
        };
        let near = quad(low, up, across);
        let far = quad(low + size * axis, across, up);
        near.into_iter().chain(far)
    })
}

/// Two rooms on one floor under one ceiling.
fn house() -> Scene {
    const OUT: f32 = 0.3;
    let (low, high) = (Vec3::ZERO, HOUSE);
    let (outer_low, outer_high) = (low - OUT, high + OUT);
    let slab = |axis: Vec3| {
        let below = outer_high - (outer_high - low) * axis;
        let above = outer_low + (high - outer_low) * axis;
        [(outer_low, below), (above, outer_high)]
    };
    let shell = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(slab);
    let across = Vec3::X * WALL_HALF_M;
    let middle = Vec3::X * WALL_M;
    let wall = (
        middle - across - Vec3::new(0.0, 0.1, 0.1),
        middle + across + Vec3::new(0.0, high.y + 0.1, high.z + 0.1),
    );
    let triangles: Vec<_> = shell.chain([wall]).flat_map(|(low, high)| solid(low, high)).collect();
    let white = Material::grey("white", 0.6);
    Scene {
        texture_coordinates: vec![[[0.0; 2]; 3]; triangles.len()],
        material_of: vec![0; triangles.len()],
        triangles,
        materials: vec![white],
        ..Scene::default()
    }
}

/// A lamp in each room, one three times as bright as the other. Not more: a patch in a voxel that the wall crosses
/// has one light for both sides, and sends it to both.
fn lamps() -> LightRig {
    let lamp = |x: f32, intensity: f32| Light::Point {
        position: Vec3::new(x, 1.5, 1.4),
        intensity: Rgb::splat(intensity),
        range_m: None,
    };
    LightRig { lights: vec![lamp(1.2, 300.0), lamp(4.5, 100.0)], ..LightRig::emission_only() }
}

/// Floor and ceiling at both feet of the wall, and a little before it.
fn feet() -> Vec<(Vec3, Vec3)> {
    let mut feet = Vec::new();
    for z in [0.5, 0.9, 1.4, 1.9, 2.4] {
        for before in [0.04, 0.1, 0.25] {
            for x in [WALL_M - WALL_HALF_M - before, WALL_M + WALL_HALF_M + before] {
                feet.push((Vec3::new(x, 0.0, z), Vec3::Y));
                feet.push((Vec3::new(x, HOUSE.y, z), Vec3::NEG_Y));
            }
        }
    }
    feet
}

/// The same light for who does not know of walls.
fn without_barriers(volume: &Volume) -> Volume {
    let mut blind = volume.clone();
    for (voxel, _) in volume.iter() {
        for direction in 0..6 {
            blind.set_barriers(voxel, direction, barrier::NONE);
        }
    }
    blind
}

/// Goal: who stands before a thin wall reads the light on this side of it, in whatever voxels it stands. Method: two rooms with one
/// floor and one ceiling, a wall of six centimetres in detail voxels of twenty, three times as much light on one side; what
/// a client reads at both feet of the wall, and what it would read without the barriers that it is told.
#[tokio::test]
async fn both_sides_of_a_thin_wall_have_their_own_light() {
    let scene = house();
    let parameters = BakeParameters {
        detail: 2,
        detail_rays: 256,
        rays_per_patch: 256,
        samples_per_voxel_face: 64,
        buried_rays: 64,
        ..coarse(VOXEL_M, 8)
    };
    let world = BakedWorld::new("rooms", &scene, lamps(), parameters);
    let served = ServedWorld::start(world.path(), world.patch_count(), |_| ()).await;
    let mut client = connect(&served.uri).await;
    let light = settled_at(&mut client, Vec3::new(WALL_M - 0.5, 1.2, 1.5)).await;
    let feet = feet();
    let options =
        ReferenceOptions { target_error_rel: 0.02, samples_max: 1 << 14, ..ReferenceOptions::default() };
    let arriving = irradiance_at_points(&SceneTracer::new(&scene), &lamps(), &feet, &options, &|| ());
    let worst = |volumes: &[Volume]| {
        let factor = |(&(position, normal), arriving): (&(Vec3, Vec3), &PointEstimate)| {
            let found = lookup(volumes, position, normal).expect("there is light").irradiance.x;
            let factor = found / arriving.irradiance.x;
            (factor.max(1.0 / factor), position)
        };
        feet.iter().zip(&arriving).map(factor).max_by(|a, b| a.0.total_cmp(&b.0)).expect("there are feet")
    };
    let ((told, at), (blind, _)) =
        (worst(light.volumes()), worst(&light.volumes().iter().map(without_barriers).collect::<Vec<_>>()));
    eprintln!("{told} at {at}, {blind} without barriers");
    assert!(told < 1.3, "off by {told} at {at}");
    assert!(blind > 1.5, "off by {blind} without barriers: they make no difference");
    client.close().await;
    served.stop().await.expect("a clean end");
}
