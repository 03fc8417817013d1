//! What rays meet first on a device, against the tracer whose trees it was given: random rays over every shared scene and a generated town,
//! with one tree and with two levels of them.
//!
//! Both look into the same boxes and compute the same crossings, but a device rounds by itself: of two triangles that a ray
//! meets within rounding (a shared edge, two walls in one plane) it may name the other, and a ray along an edge may pass.
//! Those are counted; everything else has to be the same triangle, at the same distance but for rounding.

use crate::asked::{device_or_skip, device_within, generated, queries, say, words};
use earthshine_gen::WorldKind;
use earthshine_gpu::GpuDevice;
use earthshine_gpu::rays::GpuRays;
use earthshine_light::TreeLayout;
use earthshine_scene::{ImportOptions, Scene, load, scenes_dir};
use earthshine_shaders::host::RayHit;
use earthshine_shaders::limits::NO_TRIANGLE;
use earthshine_trace::{Query, SceneTracer};
use earthshine_world::Vec3;

/// What a distance may be off by, as a share of it and of the place's coordinates.
const ROUNDING: f32 = 1e-5;
/// Of all rays of a scene, those that may end elsewhere by rounding.
const ELSEWHERE_MAX: f64 = 2e-3;

fn named(hit: &RayHit) -> Option<u32> {
    (hit.triangle != NO_TRIANGLE).then_some(hit.triangle)
}

/// Holds a device against `tracer`.
fn compare(device: &GpuDevice, name: &str, tracer: &SceneTracer<'_>, queries: &[Query]) {
    let mut rays = GpuRays::new(device, &tracer.layout(), 1 << 14).expect("trees that fit");
    let hits = rays.closest(&words(queries)).expect("a device that works");
    assert_eq!(hits.len(), queries.len());
    let (mut met, mut ties, mut edges) = (0u32, 0u32, 0u32);
    for (query, hit) in queries.iter().zip(&hits) {
        let expected = tracer.closest(query.origin, query.direction, 0.0, query.distance_max);
        met += u32::from(expected.is_some());
        let room = |distance: f32| ROUNDING * (distance + query.origin.abs().max_element() + 1.0);
        let distance = hit.distance_m - query.as_asked().2;
        match (expected, named(hit)) {
            (Some(a), Some(b)) if a.triangle as u32 == b => {
                let off = (distance - a.distance).abs();
                assert!(off <= room(a.distance), "{name}: {query:?}: {hit:?} for {a:?}");
            }
            (Some(a), Some(_)) if (a.distance - distance).abs() <= room(a.distance) => ties += 1,
            (None, None) => {}
            _ => edges += 1,
        }
    }
    let count = queries.len();
    println!("{name}: {count} rays, {met} hit, {ties} ties, {edges} along edges");
    assert!(met as usize * 20 > count, "{name}: {met} rays hit");
    let share = f64::from(ties + edges) / count as f64;
    assert!(share <= ELSEWHERE_MAX, "{name}: {ties} ties and {edges} along edges");
}

#[test]
fn a_town_is_hit_as_on_the_cpu() {
    let Some(device) = device_or_skip() else { return };
    for (seed, town_size_m) in [(1, 60.0), (2, 150.0)] {
        let scene = generated(WorldKind::Town, seed, town_size_m);
        let queries = queries(&scene, 20_000);
        compare(&device, "town, one tree", &SceneTracer::new(&scene), &queries);
        compare(&device, "town, two levels", &SceneTracer::of_meshes(&scene), &queries);
    }
}

#[test]
fn shared_scenes_are_hit_as_on_the_cpu() {
    let Some(device) = device_or_skip() else { return };
    let Some(folder) = scenes_dir() else {
        say("SKIPPED a test of rays: no shared scenes beside the project");
        return;
    };
    let files = std::fs::read_dir(folder).expect("a folder").map(|file| file.expect("a file").path());
    for file in files.filter(|file| file.extension().is_some_and(|extension| extension == "glb")) {
        let mut scene = load(&file, &ImportOptions::default()).expect("a good file");
        // Holes are not the device's business.
        scene.materials.iter_mut().for_each(|material| material.alpha_cutoff = None);
        let queries = queries(&scene, 10_000);
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        compare(&device, &name, &SceneTracer::new(&scene), &queries);
        compare(&device, &format!("{name}, two levels"), &SceneTracer::of_meshes(&scene), &queries);
    }
}

/// Goal: a part of a workgroup, several dispatches and no rays at all are as good as any.
#[test]
fn any_number_of_rays_is_traced_and_nothing_is_met_in_nothing() {
    let Some(device) = device_or_skip() else { return };
    let corners = |z: f32| [Vec3::new(-1.0, -1.0, z), Vec3::new(3.0, -1.0, z), Vec3::new(-1.0, 3.0, z)];
    // Two in one plane: the first is named.
    let triangles: Vec<[Vec3; 3]> = [-2.0, -1.0, -1.0, -3.0].map(corners).to_vec();
    let count = triangles.len();
    let scene = Scene {
        triangles,
        texture_coordinates: vec![[[0.0; 2]; 3]; count],
        material_of: vec![0; count],
        ..Scene::default()
    };
    let layout = SceneTracer::new(&scene).layout();
    let mut rays = GpuRays::new(&device, &layout, 64).expect("trees that fit");
    for count in [0, 1, 63, 64, 65, 200] {
        let away = |index: usize| if index.is_multiple_of(3) { Vec3::Z } else { Vec3::NEG_Z };
        let query = |index| Query { origin: Vec3::ZERO, direction: away(index), distance_max: f32::INFINITY };
        let queries: Vec<Query> = (0..count).map(query).collect();
        let hits = rays.closest(&words(&queries)).expect("a device that works");
        assert_eq!(hits.len(), count);
        for (index, hit) in hits.iter().enumerate() {
            assert_eq!(named(hit), (index % 3 > 0).then_some(1), "ray {index} of {count}");
        }
    }
    let mut nothing = GpuRays::new(&device, &TreeLayout::default(), 64).expect("no trees");
    let ray = words(&[Query { origin: Vec3::ZERO, direction: Vec3::X, distance_max: 1.0 }]);
    assert_eq!(named(&nothing.closest(&ray).expect("a device that works")[0]), None);
}

#[test]
fn trees_that_a_device_cannot_hold_are_refused() {
    let Some(small) = device_within(1 << 10) else { return };
    let nodes = vec![[0; 20]; 1000];
    let wide = TreeLayout { nodes, ..TreeLayout::default() };
    let refused = GpuRays::new(&small, &wide, 64).expect_err("80,000 bytes").to_string();
    assert!(refused.contains("80000") && refused.contains("CPU"), "{refused}");
    let deep = TreeLayout { depth: 99, ..TreeLayout::default() };
    let refused = GpuRays::new(&small, &deep, 64).expect_err("99 levels").to_string();
    assert!(refused.contains("99") && refused.contains("CPU"), "{refused}");
}
