//! Worlds as a reader of glTF sees them: loaded with the `gltf` crate, instances expanded, nothing taken on trust.

mod reading;

use earthshine_gen::{GenError, GenOptions, Glb, WorldKind, fixtures, generate, generate_town_cell};
use earthshine_world::Vec3;
use reading::Loaded;

fn made(kind: WorldKind, options: &GenOptions) -> Glb {
    generate(kind, options, &|_, _| {}).expect("options within their ranges")
}

fn town(size: f32, triangles: Option<u64>, flatten: bool) -> GenOptions {
    GenOptions { town_size_m: size, town_triangles: triangles, flatten, ..GenOptions::default() }
}

#[test]
fn every_world_loads_and_holds_what_it_says() {
    for kind in WorldKind::ALL {
        let glb = made(kind, &town(80.0, None, false));
        let loaded = Loaded::from(&glb.bytes);
        assert_eq!(loaded.triangles.len() as u64, glb.triangles, "{kind}");
        assert_eq!((loaded.lights, loaded.materials), (glb.lights, glb.materials), "{kind}");
        for [a, b, c] in &loaded.triangles {
            assert!(a.is_finite() && b.is_finite() && c.is_finite(), "{kind}");
            assert!((b - a).cross(c - a).length() > 1e-7, "{kind}: no area at {a}, {b}, {c}");
        }
        assert!(loaded.emissive_materials > 0, "{kind} is dark");
    }
}

#[test]
fn same_seed_same_bytes_and_another_seed_another_world() {
    for kind in WorldKind::ALL {
        let options = town(80.0, None, false);
        let glb = made(kind, &options);
        assert_eq!(glb, made(kind, &options), "{kind}");
        let other = made(kind, &GenOptions { seed: 2, ..options });
        let seeded = !matches!(kind, WorldKind::Cornell | WorldKind::Furnace);
        assert_eq!(Loaded::from(&glb.bytes).binary != Loaded::from(&other.bytes).binary, seeded, "{kind}");
    }
}

#[test]
fn a_cell_made_alone_is_the_cell_of_the_whole_town() {
    for flatten in [false, true] {
        let options = town(160.0, Some(140_000), flatten);
        let whole = Loaded::from(&made(WorldKind::Town, &options).bytes);
        for cell in [(-2, -2), (-1, 0), (1, 1)] {
            let alone = generate_town_cell(&options, cell);
            let name = format!("cell {},{}", cell.0, cell.1);
            let (translation, bytes) = &whole.meshes[&name];
            assert_eq!(*translation, alone.origin, "{name}");
            let mut expected = Vec::new();
            for surface in alone.mesh.surfaces.values() {
                expected.extend_from_slice(bytemuck::cast_slice::<Vec3, u8>(&surface.positions));
                expected.extend_from_slice(bytemuck::cast_slice::<Vec3, u8>(&surface.normals));
                expected.extend_from_slice(bytemuck::cast_slice::<u32, u8>(&surface.indices));
            }
            assert!(*bytes == expected, "{name}, flattened: {flatten}");
            for (prop, placements) in &alone.props {
                let found = &whole.instances[&format!("{name} {prop}")];
                assert_eq!(found.len(), placements.len(), "{name} {prop}");
                for (found, placement) in found.iter().zip(placements) {
                    assert_eq!(found.translation, placement.translation, "{name} {prop}");
                    assert_eq!(found.rotation, placement.rotation.to_array(), "{name} {prop}");
                }
            }
        }
    }
}

#[test]
fn flattened_towns_hold_the_same_triangles() {
    let (instanced, flat) =
        (made(WorldKind::Town, &town(80.0, None, false)), made(WorldKind::Town, &town(80.0, None, true)));
    assert_eq!(instanced.triangles, flat.triangles);
    assert_eq!(flat.stored_triangles, flat.triangles);
    assert!(instanced.stored_triangles < instanced.triangles);
    let (a, b) = (Loaded::from(&instanced.bytes), Loaded::from(&flat.bytes));
    assert_eq!(a.triangles.len(), b.triangles.len());
    let (a, b) = (a.bounds(), b.bounds());
    assert!(a.0.distance(b.0) < 1e-4 && a.1.distance(b.1) < 1e-4, "{a:?} {b:?}");
}

#[test]
fn towns_have_the_triangles_asked_for() {
    let default = made(WorldKind::Town, &GenOptions::default());
    assert!(default.triangles >= 100_000, "{}", default.triangles);
    for (size, asked) in [(160.0, 120_000), (160.0, 1_000_000), (400.0, 500_000)] {
        let glb = made(WorldKind::Town, &town(size, Some(asked), false));
        assert!(glb.triangles.abs_diff(asked) <= asked / 10, "{asked}: {}", glb.triangles);
        assert!(glb.lights <= 64, "{}", glb.lights);
    }
    let error = generate(WorldKind::Town, &town(400.0, Some(10_000), false), &|_, _| {}).unwrap_err();
    assert!(matches!(error, GenError::Triangles { asked: 10_000, .. }), "{error}");
    let error = generate(WorldKind::Town, &town(40.0, Some(10_000_000), false), &|_, _| {}).unwrap_err();
    assert!(matches!(error, GenError::Triangles { asked: 10_000_000, .. }), "{error}");
}

#[test]
fn cells_join_into_one_closed_ground() {
    let loaded = Loaded::from(&made(WorldKind::Town, &town(80.0, None, false)).bytes);
    let (mut gap, mut volume) = (glam::DVec3::ZERO, 0.0);
    for [a, b, c] in loaded.triangles.iter().map(|corners| corners.map(|p| p.as_dvec3())) {
        gap += (b - a).cross(c - a) / 2.0;
        volume += a.dot(b.cross(c)) / 6.0;
    }
    assert!(gap.length() < 0.05, "open by {gap} m2");
    // The slab under four cells is 9,600 m3; each of its sides counts for 1,600 of them. The rest is houses.
    assert!((9_600.0..15_000.0).contains(&volume), "{volume} m3");
}

#[test]
fn sunlight_enters_houses() {
    // Rays from the sun that pass a window opening reach a floor: some of what the sun sees lies under a ceiling.
    let options = town(40.0, None, true);
    let loaded = Loaded::from(&made(WorldKind::Town, &options).bytes);
    let towards_sun = Vec3::new(0.45, 0.72, 0.53).try_normalize().unwrap();
    let lit_under_a_ceiling = (0..40).flat_map(|i| (0..40).map(move |k| (i, k))).filter(|&(i, k)| {
        // A little above the lowest floor, which is the one place at this height inside houses.
        let point = Vec3::new(7.25 + 0.65 * i as f32, 0.5, 7.25 + 0.65 * k as f32);
        let up = loaded.first_hit(point, Vec3::Y).is_some_and(|distance| distance < 2.7);
        up && loaded.first_hit(point, towards_sun).is_none()
    });
    let lit = lit_under_a_ceiling.count();
    assert!((3..400).contains(&lit), "{lit} of 1,600 places are sunlit under a ceiling");
}

#[test]
fn no_two_faces_share_a_plane_and_a_place() {
    for seed in 1..4 {
        for cell in [(0, 0), (-1, -1), (-2, 0), (1, 1)] {
            let options = GenOptions { seed, flatten: true, ..town(160.0, None, true) };
            let mesh = generate_town_cell(&options, cell).mesh;
            reading::assert_no_shared_planes(
                &mesh.corners().collect::<Vec<_>>(),
                &format!("cell {cell:?} of {seed}"),
            );
        }
    }
    for bytes in [fixtures::cornell_glb(), fixtures::two_rooms_glb(), fixtures::corridor_glb(130.0)] {
        reading::assert_no_shared_planes(&Loaded::from(&bytes).triangles, "fixture");
    }
}

#[test]
fn files_are_whole_or_absent() {
    let folder = tempfile::tempdir().unwrap();
    let glb = made(WorldKind::Cornell, &GenOptions::default());
    let path = folder.path().join("cornell.glb");
    glb.write(&path).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), glb.bytes);
    let blocked = folder.path().join("folder.glb");
    std::fs::create_dir(&blocked).unwrap();
    let error = glb.write(&blocked).unwrap_err();
    assert!(matches!(&error, GenError::Write { path, .. } if *path == blocked), "{error}");
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 2, "{left:?}");
}

#[test]
fn progress_begins_at_nothing_and_ends_at_everything() {
    let heard = std::cell::RefCell::new(Vec::new());
    generate(WorldKind::Town, &town(80.0, None, false), &|done, total| {
        heard.borrow_mut().push((done, total));
    })
    .unwrap();
    assert_eq!(heard.into_inner(), [(0, 4), (1, 4), (2, 4), (3, 4), (4, 4)]);
}
