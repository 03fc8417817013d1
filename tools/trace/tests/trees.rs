//! Both kinds of trees against each other: the same hits, bit for bit.

#![expect(clippy::print_stdout, reason = "a skipped test says why, and figures are wanted beside a pass")]

use earthshine_gen::{GenOptions, WorldKind};
use earthshine_scene::{ImportOptions, Scene, load, load_bytes, scenes_dir};
use earthshine_trace::SceneTracer;
use earthshine_world::Vec3;
use earthshine_world::random::{Purpose, hash, unit_pair};
use std::time::Instant;

/// Rays from all over the scene in all directions, one in four along an axis.
fn rays(scene: &Scene, count: u64) -> Vec<(Vec3, Vec3)> {
    let bounds = scene.bounds();
    let one = |index: u64| {
        let ([a, b], [c, d], [e, _]) = (draw(index, 0), draw(index, 1), draw(index, 2));
        let origin = bounds.min + bounds.size() * Vec3::new(a, b, e);
        let up = 2.0 * c - 1.0;
        let (sin, cos) = (d * std::f32::consts::TAU).sin_cos();
        let flat = (1.0 - up * up).max(0.0).sqrt();
        let direction = Vec3::new(flat * cos, up, flat * sin).normalize_or(Vec3::Y);
        let along = [Vec3::X, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_X][index as usize / 4 % 4];
        (origin, if index.is_multiple_of(4) { along } else { direction })
    };
    (0..count).map(one).collect()
}

fn draw(index: u64, part: u64) -> [f32; 2] {
    unit_pair(hash(7, Purpose::RowRay, index, part)).into()
}

/// Shares of rays a second and of bytes of the two levels against one tree.
fn compare(name: &str, scene: &Scene, count: u64) -> (f64, f64) {
    let (flat, two_level) = (SceneTracer::new(scene), SceneTracer::of_meshes(scene));
    let rays = rays(scene, count);
    let closest = |tracer: &SceneTracer<'_>| -> (Vec<_>, f64) {
        let started = Instant::now();
        let hit = |&(origin, direction): &(Vec3, Vec3)| tracer.closest(origin, direction, 0.0, f32::INFINITY);
        (rays.iter().map(hit).collect(), started.elapsed().as_secs_f64())
    };
    let ((hits, flat_s), (others, two_level_s)) = (closest(&flat), closest(&two_level));
    for ((ray, hit), other) in rays.iter().zip(&hits).zip(&others) {
        assert_eq!(hit, other, "{name}: {ray:?}");
        let way = hit.map_or(50.0, |hit| 0.999 * hit.distance);
        for distance in [way, 1.1 * way] {
            let blocked = [&flat, &two_level].map(|tracer| tracer.is_blocked(ray.0, ray.1, distance));
            assert_eq!(blocked[0], blocked[1], "{name}: {ray:?}");
        }
    }
    let found = hits.iter().flatten().count();
    assert!(found * 20 > rays.len(), "{name}: {found} of {} rays hit", rays.len());
    let (bytes, others) = (flat.tree_bytes() as f64, two_level.tree_bytes() as f64);
    println!(
        "{name}: {} triangles, {} placements; one tree {:.1} MB, {:.2} M rays/s; two levels {:.1} MB, {:.2} M rays/s",
        scene.triangles.len(),
        scene.placements.len(),
        bytes / 1e6,
        count as f64 / flat_s / 1e6,
        others / 1e6,
        count as f64 / two_level_s / 1e6,
    );
    (flat_s / two_level_s, others / bytes)
}

#[test]
fn a_town_of_instances_is_hit_alike_with_a_quarter_of_the_memory() {
    let options = GenOptions { town_size_m: 200.0, ..GenOptions::default() };
    let glb = earthshine_gen::generate(WorldKind::Town, &options, &|_, _| {}).expect("a town");
    let mut scene = load_bytes(&glb.bytes, "town", &ImportOptions::default()).expect("an importable town");
    let (_, memory) = compare("town", &scene, 40_000);
    assert!(memory < 0.25, "{memory}");
    // What no mesh placed is found as well.
    let top = scene.bounds().max.y + 1.0;
    let corner = |x: f32, z: f32| Vec3::new(x, top, z);
    scene.triangles.push([corner(-60.0, -60.0), corner(-60.0, 90.0), corner(90.0, -60.0)]);
    scene.texture_coordinates.push([[0.0; 2]; 3]);
    scene.material_of.push(0);
    compare("town with a roof", &scene, 4_000);
}

#[test]
fn shared_scenes_are_hit_alike() {
    let Some(folder) = scenes_dir() else {
        println!("skipped: no shared scenes beside the project");
        return;
    };
    let files = std::fs::read_dir(folder).expect("a folder").map(|file| file.expect("a file").path());
    for file in files.filter(|file| file.extension().is_some_and(|extension| extension == "glb")) {
        let scene = load(&file, &ImportOptions::default()).expect("a good file");
        compare(&file.display().to_string(), &scene, 20_000);
    }
}
