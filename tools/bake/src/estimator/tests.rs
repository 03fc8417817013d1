//! Closed forms for every estimator, and sums of one.

use super::*;
use crate::builder::Builder;
use crate::progress::Silent;
use crate::test_shapes::{quad, scene_of};
use earthshine_scene::{Material, Scene};
use earthshine_tiles::{BakeMethod, BakeParameters, PatchBuilder, RaySpread, SampleSource};
use earthshine_trace::SceneTracer;
use earthshine_world::{Direction, Grid, Rgb, Vec3};

fn parameters(method: BakeMethod) -> BakeParameters {
    BakeParameters {
        grid: Grid { voxel_edge_m: 8.0, chunk_edge_voxels: 4 },
        method,
        rays_per_patch: 16_384,
        points_per_patch: 256,
        samples_per_voxel_face: 1 << 14,
        two_sided: false,
        buried_rays: 0,
        ..BakeParameters::default()
    }
}

/// Unit squares that face each other at distance 1; unit squares that share an edge.
fn pairs() -> [(Scene, [Direction; 2], f32); 2] {
    let low = Vec3::ONE;
    let floor = quad(low, Vec3::Z, Vec3::X);
    let ceiling = quad(low + Vec3::Y, Vec3::X, Vec3::Z);
    let wall = quad(low, Vec3::Y, Vec3::Z);
    [
        (scene_of([floor, ceiling].concat()), [Direction::PosY, Direction::NegY], 0.199_825),
        (scene_of([floor, wall].concat()), [Direction::PosY, Direction::PosX], 0.200_044),
    ]
}

fn methods() -> Vec<BakeMethod> {
    let base = BakeMethod::default();
    let spreads = [RaySpread::R2, RaySpread::Sobol, RaySpread::Stratified, RaySpread::White];
    let mut methods: Vec<_> = spreads.iter().map(|&spread| BakeMethod { spread, ..base }).collect();
    methods.push(BakeMethod { row_error: 0.004, rays_max: 1 << 15, ..base });
    methods.push(BakeMethod { estimator: RowEstimator::Points, ..base });
    methods.push(BakeMethod { samples: SampleSource::Hammersley, ..base });
    methods.push(BakeMethod { builder: PatchBuilder::Clustered, ..base });
    methods
}

#[test]
fn every_estimator_and_builder_agrees_with_the_closed_forms() {
    for (scene, directions, expected) in pairs() {
        let tracer = SceneTracer::new(&scene);
        for method in methods() {
            let parameters = parameters(method);
            let surfaces = Builder { tracer: &tracer, parameters: &parameters }.surfaces(&Silent);
            let set = &surfaces.set;
            assert_eq!(set.len(), 2, "{method:?}");
            let caster = RowCaster::of_world(&tracer, &surfaces, &parameters);
            let estimator = Estimator::new(caster).unwrap();
            let of = |direction| set.patches.iter().position(|p| p.patch.direction == direction).unwrap();
            let [here, there] = directions.map(of);
            for (from, to) in [(here, there), (there, here)] {
                let row = estimator.row(from as u32);
                let found =
                    row.entries.iter().find(|entry| entry.0 == to as u32).map_or(0.0, |entry| entry.1);
                let white = matches!(method.spread, RaySpread::White | RaySpread::Stratified);
                // Points that almost touch give too little: the price of the disc form where squares share an edge.
                let rough = white || method.row_error > 0.0 || method.estimator == RowEstimator::Points;
                let near = if rough { 0.012 } else { 0.004 };
                assert!((found - expected).abs() < near, "{method:?}: {found}, not {expected}");
                let sum: f32 = row.entries.iter().map(|entry| entry.1).sum::<f32>() + row.absorbed;
                let whole = sum + row.sky.iter().sum::<f32>();
                assert!((whole - 1.0).abs() < 0.012, "{method:?}: {whole}");
            }
        }
    }
}

#[test]
fn rows_by_rays_sum_to_one() {
    let (scene, ..) = pairs().into_iter().next().unwrap();
    let tracer = SceneTracer::new(&scene);
    for method in methods().into_iter().filter(|method| method.estimator == RowEstimator::Rays) {
        let parameters = BakeParameters { rays_per_patch: 1000, ..parameters(method) };
        let surfaces = Builder { tracer: &tracer, parameters: &parameters }.surfaces(&Silent);
        let caster = RowCaster::of_world(&tracer, &surfaces, &parameters);
        let row = Estimator::new(caster).unwrap().row(0);
        let sum: f32 = row.entries.iter().map(|entry| entry.1).chain(row.sky).sum::<f32>() + row.absorbed;
        assert!((sum - 1.0).abs() < 1e-4, "{method:?}: {sum}");
        assert!(row.entries.windows(2).all(|pair| pair[0].0 < pair[1].0));
    }
}

#[test]
fn sums_over_points_are_refused_where_they_would_take_hours() {
    let floor = quad(Vec3::splat(0.5), Vec3::Z * 400.0, Vec3::X * 400.0);
    let scene = scene_of(floor.to_vec());
    let tracer = SceneTracer::new(&scene);
    let method = BakeMethod { estimator: RowEstimator::Points, ..BakeMethod::default() };
    let parameters = BakeParameters { samples_per_voxel_face: 16, ..parameters(method) };
    let surfaces = Builder { tracer: &tracer, parameters: &parameters }.surfaces(&Silent);
    let caster = RowCaster::of_world(&tracer, &surfaces, &parameters);
    let refused = Estimator::new(caster).unwrap_err();
    assert!(matches!(refused, BakeError::TooManyPairs { patches: 2601, .. }), "{refused}");
    assert!(refused.to_string().contains("--points-per-patch"));
}

/// Goal: what emits in a voxel and direction sends its own light, from where it is. Method: a lamp of 0.1 m a hand above the
/// middle of a floor, both facing up in one voxel; its share of the ceiling against the double integral of
/// `cos cos / (pi r^2)` over both.
#[test]
fn a_lamp_above_a_floor_is_a_patch_of_its_own() {
    let low = Vec3::ONE;
    let floor = quad(low, Vec3::Z, Vec3::X);
    let lamp = quad(low + Vec3::new(0.45, 0.1, 0.45), Vec3::Z * 0.1, Vec3::X * 0.1);
    let ceiling = quad(low + Vec3::Y, Vec3::X, Vec3::Z);
    let mut scene = scene_of([floor, lamp, ceiling].concat());
    let glow = Material { emitted_radiance: Rgb::splat(100.0), ..scene.materials[0].clone() };
    scene.materials.push(glow);
    scene.material_of[2..4].fill(1);
    let (tracer, parameters) = (SceneTracer::new(&scene), parameters(BakeMethod::default()));
    let surfaces = Builder { tracer: &tracer, parameters: &parameters }.surfaces(&Silent);
    let set = &surfaces.set;
    let areas: Vec<f32> = set.patches.iter().map(|source| source.patch.area).collect();
    assert_eq!(set.len(), 3, "{areas:?}");
    // Patches are ordered by direction; what emits comes after what does not.
    let [floor, lamp, ceiling] = [0, 1, 2];
    assert!((areas[0] - 1.0).abs() < 1e-3 && (areas[1] - 0.01).abs() < 1e-5, "{areas:?}");
    assert_eq!([floor, lamp].map(|of| emits(set, of as usize)), [false, true]);
    let grid = &parameters.grid;
    for index in [floor, lamp, ceiling] {
        let id = set.stable_id(index, grid);
        let chunk = grid.chunk_of(set.patches[index as usize].patch.voxel).to_array();
        assert_eq!(set.by_stable_id(chunk, id, grid), Some(index));
    }
    let middle = |i: i32, steps: i32| (f64::from(i) + 0.5) / f64::from(steps);
    let mut expected = 0.0;
    for i in 0..8 * 8 {
        let (x, z) = (0.45 + 0.1 * middle(i % 8, 8), 0.45 + 0.1 * middle(i / 8, 8));
        for j in 0..128 * 128 {
            let (across, along) = (middle(j % 128, 128) - x, middle(j / 128, 128) - z);
            let squared = across * across + along * along + 0.81;
            expected += 0.81 / (std::f64::consts::PI * squared * squared) / (64.0 * 16_384.0);
        }
    }
    let caster = RowCaster::of_world(&tracer, &surfaces, &parameters);
    let estimator = Estimator::new(caster).unwrap();
    let share = |from: u32, to: u32| {
        let row = estimator.row(from);
        row.entries.iter().find(|entry| entry.0 == to).map_or(0.0, |entry| f64::from(entry.1))
    };
    let found = share(lamp, ceiling);
    assert!((found - expected).abs() < 0.002, "{found}, not {expected}");
    // As the ceiling's own rays find it: a hundredth as likely.
    let back = share(ceiling, lamp);
    assert!((back - expected * 0.01).abs() < 0.001, "{back}, not {}", expected * 0.01);
    assert!(share(ceiling, floor) > 0.18, "the floor is there all the same");
}
