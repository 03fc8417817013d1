//! The shared scenes: all of them bake, two of them are held against another renderer, and a server serves them.

use earthshine_client::Vec3;
use earthshine_render::{LightErrors, ReferencePoint, SceneTracer, compare_points};
use earthshine_tests::agreement::{assert_between, served_patches};
use earthshine_tests::baked::{BakedWorld, coarse};
use earthshine_tests::served::ServedWorld;
use earthshine_tests::shared::{folder, reference, say, scene_and_lights, scene_files};
use earthshine_tests::solved::SolvedWorld;
use earthshine_tests::viewer::{connect, settled_at};
use earthshine_tiles::{BakeParameters, DirStore, TileStore, check_rows, check_targets};
use earthshine_volume::lookup;
use earthshine_world::Rgb;
use std::path::Path;

/// Voxels along the diagonal of a scene that only has to bake.
const VOXELS_ON_DIAGONAL: f32 = 40.0;
/// Above it the search for buried points is left out: it would take longer than all the rest, and has its own tests.
const TRIANGLES_SEARCHED_MAX: usize = 200_000;
/// These two have tests of their own below.
const COMPARED: [&str; 2] = ["cornell", "sponza"];

/// Every row invariant, in the chunk and across the world.
fn assert_sound(world: &Path) {
    let store = DirStore::open(world).expect("a world");
    let index = store.manifest().index();
    for entry in &store.manifest().chunks {
        let chunk = store.load(entry.id()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(check_rows(&chunk), [], "{}", chunk.id);
        assert_eq!(check_targets(&chunk.rows, &index), [], "{}", chunk.id);
    }
}

#[test]
fn every_shared_scene_bakes_and_its_rows_are_sound() {
    let Some(folder) = folder("baking of the shared scenes") else { return };
    for file in scene_files(&folder) {
        let name = file.file_stem().and_then(|stem| stem.to_str()).expect("a name");
        if COMPARED.contains(&name) {
            continue;
        }
        let (scene, lights) = scene_and_lights(&file);
        let mut parameters = coarse(scene.bounds().size().length() / VOXELS_ON_DIAGONAL, 16);
        if scene.triangles.len() > TRIANGLES_SEARCHED_MAX {
            parameters.buried_rays = 0;
        }
        let world = BakedWorld::new(name, &scene, lights, parameters);
        assert!(world.summary.patches > 500, "{name}: {:?}", world.summary);
        assert_sound(world.path());
        let summary = &world.summary;
        println!("{name}: {} patches, {} chunks, {:.1} s", summary.patches, summary.chunks, summary.seconds);
    }
}

/// A scene baked, solved as a whole, and compared with its reference.
struct Compared {
    world: BakedWorld,
    solved: SolvedWorld,
    errors: LightErrors,
    /// Of the points that lie on surfaces; nothing where none do, to two millimetres.
    on_surfaces: Option<LightErrors>,
}

/// Points on surfaces are no further off than this, m: those of the Cornell box are lifted by a millimetre.
const ON_SURFACE_M: f32 = 2e-3;

fn lies_on_a_surface(tracer: &SceneTracer<'_>, point: &ReferencePoint) -> bool {
    let origin = point.position + ON_SURFACE_M * point.normal;
    tracer.closest(origin, -point.normal, 0.0, 2.0 * ON_SURFACE_M).is_some()
}

fn compared(folder: &Path, name: &str, parameters: BakeParameters) -> Compared {
    let (scene, lights) = scene_and_lights(&folder.join(format!("{name}.glb")));
    let world = BakedWorld::new(name, &scene, lights, parameters);
    assert_sound(world.path());
    let solved = SolvedWorld::load(world.path());
    let volume = solved.volume(&solved.solve(&solved.lights));
    let reference = reference(folder, name);
    let measured: Vec<Option<Rgb>> = reference
        .iter()
        .map(|point| lookup(&[&volume], point.position, point.normal).map(|found| found.irradiance))
        .collect();
    let errors = compare_points(&reference, &measured).expect("comparable light");
    let tracer = SceneTracer::new(&scene);
    let pairs = reference.into_iter().zip(measured).filter(|(point, _)| lies_on_a_surface(&tracer, point));
    let (reference, measured): (Vec<_>, Vec<_>) = pairs.unzip();
    let on_surfaces = compare_points(&reference, &measured).ok();
    say(&format!("{name} against its reference: {errors:?}; on surfaces {on_surfaces:?}"));
    Compared { world, solved, errors, on_surfaces }
}

/// Serves a compared scene with `slots` slots and holds what a client at `camera` gets against the whole solution.
async fn assert_served(compared: &Compared, slots: u32, camera: Vec3) {
    let served = ServedWorld::start(compared.world.path(), slots, |_| ()).await;
    let mut client = connect(&served.uri).await;
    let light = settled_at(&mut client, camera).await;
    let patches = served_patches(&light);
    let solved = &compared.solved;
    let (told, all) = (solved.told().count(), compared.world.patch_count());
    assert_eq!(light.frame().resident_patches, slots.min(all));
    // What emits beside what does not takes a slot, and is not told.
    assert!(patches.len() <= told && patches.len() + all as usize >= told + slots.min(all) as usize);
    let whole = solved.solve(&solved.lights);
    let alone = solved.solve_among(&solved.lights, &patches.keys().copied().collect());
    assert_between(solved, &whole, &alone, &patches);
    client.close().await;
    served.stop().await.expect("a clean end");
}

#[tokio::test]
async fn the_measured_cornell_box_has_the_light_of_its_reference() {
    let Some(folder) = folder("the measured Cornell box") else { return };
    let parameters = BakeParameters { rays_per_patch: 1024, ..BakeParameters::default() };
    let grid = coarse(0.045, 16).grid;
    let compared = compared(&folder, "cornell", BakeParameters { grid, ..parameters });
    let surfaces = compared.on_surfaces.as_ref().expect("points on surfaces");
    assert_eq!(
        (surfaces.points, surfaces.uncovered, surfaces.beyond_factor_two),
        (27, 0, 0.0),
        "{surfaces:?}"
    );
    assert!(surfaces.median_rel < 0.04 && surfaces.rel_rmse < 0.05, "{surfaces:?}");
    assert!(surfaces.bias.abs() < 0.03, "{surfaces:?}");
    // The others lie in the air, where a bake without receivers mostly has no light, or inside of the sealed blocks.
    assert!(compared.errors.points >= 40, "{:?}", compared.errors);
    assert!(compared.errors.median_rel < 0.06, "{:?}", compared.errors);
    assert_served(&compared, 900, Vec3::new(0.28, 0.27, 0.1)).await;
}

#[tokio::test]
async fn the_sponza_atrium_has_the_light_of_its_reference() {
    let Some(folder) = folder("the Sponza atrium") else { return };
    let grid = coarse(1.5, 16).grid;
    let parameters =
        BakeParameters { rays_per_patch: 256, buried_rays: 8, grid, ..BakeParameters::default() };
    let compared = compared(&folder, "sponza", parameters);
    assert!(compared.errors.points >= 490, "{:?}", compared.errors);
    assert!(compared.errors.median_rel < 0.15, "{:?}", compared.errors);
    assert!(compared.errors.bias.abs() < 0.15, "{:?}", compared.errors);
    assert_served(&compared, 700, Vec3::new(0.0, 2.0, 0.0)).await;
}
