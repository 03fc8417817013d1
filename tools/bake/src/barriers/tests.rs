//! Floors in a detail voxel of a metre, and what stands on them: which of it parts a layer, and where layers then end.

use super::*;
use crate::exposure::Exposure;
use crate::layers::{Layers, layers_of};
use crate::test_shapes::{boxed, quad, scene_of};
use earthshine_scene::Scene;
use earthshine_tiles::BakeParameters;
use earthshine_trace::SceneTracer;
use earthshine_world::{Grid, Rgb};

/// Height of the floor in the voxel of one metre at the origin.
const FLOOR_M: f32 = 0.3;

/// 256 points of a floor that fills the voxel.
fn floor() -> Vec<SurfaceSample> {
    let middle = |i: u32| (i as f32 + 0.5) / 16.0;
    (0..256)
        .map(|i| SurfaceSample {
            position: Vec3::new(middle(i % 16), FLOOR_M, middle(i / 16)),
            normal: Vec3::Y,
            side: 0,
            voxel: VoxelCoord::ZERO,
            area: 1.0 / 256.0,
            reflectance: Rgb::ONE,
            emission: Rgb::ZERO,
            exposure: Exposure::Open(1.0),
            is_suspect: false,
        })
        .collect()
}

/// A sheet that stands on the floor from `from` to `to`, so much higher than it.
fn sheet(from: [f32; 2], to: [f32; 2], height: f32) -> Vec<[Vec3; 3]> {
    let [from, to] = [from, to].map(|[x, z]| Vec3::new(x, FLOOR_M, z));
    quad(from, to - from, Vec3::Y * height).to_vec()
}

/// A box on the floor.
fn block(low: [f32; 2], high: [f32; 2], height: f32) -> Vec<[Vec3; 3]> {
    let corner = |[x, z]: [f32; 2], y: f32| Vec3::new(x, y, z);
    boxed(corner(low, FLOOR_M), corner(high, FLOOR_M + height)).triangles
}

/// The floor's layers where `triangles` stand.
fn layers(triangles: Vec<[Vec3; 3]>) -> Layers {
    layers_of_samples(&floor(), &scene_of(triangles))
}

fn layers_of_samples(samples: &[SurfaceSample], scene: &Scene) -> Layers {
    let parameters = BakeParameters {
        grid: Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 16 },
        ..BakeParameters::default()
    };
    layers_of(samples, &parameters, (&SceneTracer::new(scene)).into())
}

fn barriers(layers: &Layers, layer: u8) -> Vec<(Vec3, f32)> {
    let of = layers.barriers(VoxelCoord::ZERO, Direction::PosY, layer);
    of.into_iter().flatten().map(|it| (it.towards(Direction::PosY), it.middle_distance())).collect()
}

fn of_floor(layers: &Layers) -> Vec<u8> {
    layers.of_samples.iter().map(|of| of[Direction::PosY.index()]).collect()
}

fn is_one_layer(layers: &Layers) -> bool {
    of_floor(layers).iter().all(|&layer| layer == 0)
}

/// Asserts that the floor is two layers, parted where `side` changes its sign, and that each ends there; `side` is a distance
/// in m, growing towards `towards`.
fn assert_parted(layers: &Layers, towards: Vec3, side: impl Fn(Vec3) -> f32) {
    let own = of_floor(layers);
    let near = own[floor().iter().position(|sample| side(sample.position) < 0.0).expect("a near side")];
    for (sample, &layer) in floor().iter().zip(&own) {
        let expected = if side(sample.position) < 0.0 { near } else { 1 - near };
        assert_eq!(layer, expected, "at {}", sample.position);
    }
    let middle = Vec3::new(0.5, FLOOR_M, 0.5);
    for (layer, sign) in [(near, 1.0), (1 - near, -1.0)] {
        let [(own_towards, distance)] = barriers(layers, layer)[..] else { panic!("one a layer") };
        assert!(own_towards.distance(sign * towards) < 0.02, "{own_towards}");
        assert!((distance + sign * side(middle)).abs() < 0.03, "{distance} for {}", -sign * side(middle));
        // However it was rounded, what is the layer's own lies before it.
        for sample in floor().iter().filter(|sample| sign * side(sample.position) < 0.0) {
            assert!(own_towards.dot(sample.position - middle) <= distance, "{}", sample.position);
        }
    }
}

#[test]
fn both_sides_of_a_wall_are_layers_that_end_at_it() {
    let wall = layers(sheet([0.63, -3.0], [0.63, 4.0], 2.0));
    assert_parted(&wall, Vec3::X, |place| place.x - 0.63);
    // Not along an axis.
    let towards = Vec3::new(0.8, 0.0, 0.6);
    let slanted = layers(sheet([0.5 - 2.4, 0.5 + 3.2], [0.5 + 2.4, 0.5 - 3.2], 2.0));
    assert_parted(&slanted, towards, |place| towards.dot(place - 0.5));
}

/// A thick wall's two faces: what lies within is of no layer.
#[test]
fn sides_end_where_the_wall_faces_them() {
    let mut samples = floor();
    let is_inside = |sample: &SurfaceSample| (0.45..0.6).contains(&sample.position.x);
    samples.iter_mut().filter(|sample| is_inside(sample)).for_each(|s| s.exposure = Exposure::Buried);
    let found = layers_of_samples(&samples, &scene_of(block([0.45, -3.0], [0.6, 4.0], 2.0)));
    let (low, high) = (of_floor(&found)[0], of_floor(&found)[15]);
    assert_ne!(low, high);
    let [(towards, distance)] = barriers(&found, low)[..] else { panic!("one") };
    assert!(towards.distance(Vec3::X) < 0.02 && (distance + 0.05).abs() < 0.03, "{distance}");
    let [(towards, distance)] = barriers(&found, high)[..] else { panic!("one") };
    assert!(towards.distance(Vec3::NEG_X) < 0.02 && (distance + 0.1).abs() < 0.03, "{distance}");
}

#[test]
fn a_leaning_wall_ends_a_layer_at_its_foot() {
    for lean in [-0.4, 0.4] {
        let along = Vec3::new(0.0, 0.0, 7.0);
        let wall = quad(Vec3::new(0.6, FLOOR_M, -3.0), along, Vec3::new(lean, 1.0, 0.0));
        assert_parted(&layers(wall.to_vec()), Vec3::X, |place| place.x - 0.6);
    }
}

#[test]
fn a_wall_beside_the_voxel_ends_its_layer_and_a_corner_ends_it_twice() {
    let beside = layers(sheet([1.2, -3.0], [1.2, 4.0], 2.0));
    assert!(is_one_layer(&beside));
    let [(towards, distance)] = barriers(&beside, 0)[..] else { panic!("one wall") };
    assert!(towards.distance(Vec3::X) < 0.02 && (distance - 0.7).abs() < 0.03, "{distance}");
    let corner = [sheet([1.1, -3.0], [1.1, 4.0], 2.0), sheet([-3.0, 1.05], [4.0, 1.05], 2.0)].concat();
    let corner = layers(corner);
    assert!(is_one_layer(&corner));
    let mut found = barriers(&corner, 0);
    found.sort_by(|a, b| b.0.x.total_cmp(&a.0.x));
    let [(first, to_first), (second, to_second)] = found[..] else { panic!("two walls: {found:?}") };
    assert!(first.distance(Vec3::X) < 0.02 && (to_first - 0.6).abs() < 0.03, "{to_first}");
    assert!(second.distance(Vec3::Z) < 0.02 && (to_second - 0.55).abs() < 0.03, "{to_second}");
    assert!(barriers(&layers(sheet([1.7, -3.0], [1.7, 4.0], 2.0)), 0).is_empty(), "nobody reads it there");
}

#[test]
fn what_light_passes_over_around_or_beneath_is_no_wall() {
    let kerb = block([0.55, -3.0], [0.65, 4.0], 0.12);
    let post = block([0.55, 0.45], [0.65, 0.55], 2.0);
    let raised = sheet([0.6, -3.0], [0.6, 4.0], 2.0).into_iter();
    let slit = raised.map(|corners| corners.map(|corner| corner + Vec3::Y * 0.06)).collect();
    let door = [sheet([0.6, -3.0], [0.6, 0.1], 2.0), sheet([0.6, 0.9], [0.6, 4.0], 2.0)].concat();
    let ramp = quad(Vec3::new(0.6, FLOOR_M, -3.0), Vec3::Z * 7.0, Vec3::new(2.0, 1.0, 0.0)).to_vec();
    for (name, shape) in
        [("kerb", kerb), ("post", post), ("slit", slit), ("door", door), ("ramp", ramp), ("nothing", vec![])]
    {
        let found = layers(shape);
        assert!(is_one_layer(&found), "{name}");
        assert!(barriers(&found, 0).is_empty(), "{name}");
    }
}

/// A ledge that goes on inside of a pillar, which light passes beside: nobody sees the half plane as a whole.
#[test]
fn a_ledge_is_parted_by_a_pillar_it_goes_on_in() {
    let mut samples = floor();
    samples.retain(|sample| sample.position.x < 0.2);
    let pillar = layers_of_samples(&samples, &scene_of(block([-0.05, -0.4], [0.22, 0.3], 2.0)));
    let own = of_floor(&pillar);
    let (inside, outside) = (own[0], own[own.len() - 1]);
    assert_ne!(inside, outside);
    for (sample, &layer) in samples.iter().zip(&own) {
        assert_eq!(layer, if sample.position.z < 0.3 { inside } else { outside }, "at {}", sample.position);
    }
    let ends_there = |(towards, distance): &(Vec3, f32)| towards.z < -0.99 && (distance - 0.2).abs() < 0.03;
    assert!(barriers(&pillar, outside).iter().any(ends_there), "{:?}", barriers(&pillar, outside));
}

/// Under a ceiling lower than segments would lie, a wall of its height is one.
#[test]
fn a_low_wall_under_a_low_ceiling_is_a_wall() {
    let ceiling = quad(Vec3::new(-3.0, FLOOR_M + 0.1, -3.0), Vec3::X * 7.0, Vec3::Z * 7.0);
    let wall = sheet([0.63, -3.0], [0.63, 4.0], 0.1);
    assert_parted(&layers([ceiling.to_vec(), wall].concat()), Vec3::X, |place| place.x - 0.63);
}

#[test]
fn layers_are_the_same_whatever_the_threads() {
    let walls = [sheet([0.63, -3.0], [0.63, 20.0], 2.0), sheet([-3.0, 0.4], [20.0, 0.4], 2.0)].concat();
    let scene = scene_of(walls);
    // As many voxels as threads share: batches are of 64.
    let samples: Vec<SurfaceSample> = (0..256)
        .flat_map(|x| {
            let at = VoxelCoord::new(x % 16, 0, x / 16);
            let moved = move |sample: SurfaceSample| SurfaceSample {
                position: sample.position + at.as_vec3(),
                voxel: at,
                ..sample
            };
            floor().into_iter().map(moved)
        })
        .collect();
    let all = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let found = pool.install(|| layers_of_samples(&samples, &scene));
        (found.of_samples.clone(), found.rays, format!("{found:?}"))
    };
    let alone = all(1);
    assert!(alone.0.iter().flatten().any(|&layer| layer == 3), "two walls that cross make four sides");
    assert!(alone == all(3) && alone == all(8));
}
