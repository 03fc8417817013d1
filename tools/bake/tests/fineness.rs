//! Patches are counted without a bake: counts, and the voxel edges chosen by them, against the patches that are made.

use earthshine_bake::builder::Builder;
use earthshine_bake::fineness::PatchCounter;
use earthshine_bake::{SceneTracer, Silent};
use earthshine_gen::{GenOptions, WorldKind};
use earthshine_scene::{ImportOptions, Scene, scenes_dir};
use earthshine_tiles::BakeParameters;
use earthshine_world::Grid;
use std::io::Write as _;

/// What a choice of edge may be off by.
const WITHIN: f64 = 0.15;

fn generated(kind: WorldKind, shape: &GenOptions) -> Scene {
    let glb = earthshine_gen::generate(kind, shape, &|_, _| {}).expect("a generated scene");
    earthshine_scene::load_bytes(&glb.bytes, "generated", &ImportOptions::default())
        .expect("an importable scene")
}

/// Patches as a bake makes them.
fn made(scene: &Scene, parameters: &BakeParameters) -> f64 {
    let tracer = SceneTracer::new(scene);
    Builder { tracer: &tracer, parameters }.surfaces(&Silent).set.len() as f64
}

fn at(voxel_edge_m: f32, parameters: &BakeParameters) -> BakeParameters {
    BakeParameters { grid: Grid { voxel_edge_m, ..parameters.grid }, ..*parameters }
}

/// The edge for `wanted` patches makes about so many, and has three digits at most.
#[track_caller]
fn assert_chosen(name: &str, scene: &Scene, parameters: &BakeParameters, wanted: f64) {
    let guess = PatchCounter::new(scene, parameters).edge_for(wanted, &(0.001..=1000.0));
    let made = made(scene, &at(guess.voxel_edge_m, parameters));
    let line = format!("{name}: {wanted} wanted, {guess:?}, {made} made");
    writeln!(std::io::stderr(), "{line}").expect("standard error");
    assert!((made / wanted - 1.0).abs() < WITHIN, "{line}");
    let counted = guess.patches.expect("a count").count;
    assert!((counted / made - 1.0).abs() < WITHIN / 2.0, "{line}");
    let digits = format!("{}", guess.voxel_edge_m);
    assert!(digits.trim_start_matches(['0', '.']).replace('.', "").len() <= 3, "{digits}");
}

#[test]
fn generated_worlds_get_about_as_many_patches_as_wanted() {
    let shape = GenOptions { town_size_m: 60.0, ..GenOptions::default() };
    let one_sided = BakeParameters { two_sided: false, ..BakeParameters::default() };
    assert_chosen("cornell", &generated(WorldKind::Cornell, &shape), &one_sided, 2_000.0);
    let two_sided = BakeParameters::default();
    assert_chosen("two rooms", &generated(WorldKind::TwoRooms, &shape), &two_sided, 3_000.0);
    assert_chosen("corridor", &generated(WorldKind::Corridor, &shape), &two_sided, 2_000.0);
    assert_chosen("town", &generated(WorldKind::Town, &shape), &two_sided, 4_000.0);
}

#[test]
fn shared_scenes_get_about_as_many_patches_as_wanted() {
    let Some(folder) = scenes_dir() else {
        writeln!(std::io::stderr(), "SKIPPED edges of shared scenes: there are none")
            .expect("standard error");
        return;
    };
    // Half of the office is buried; few of the atrium's surfaces are, and many are smaller than a voxel.
    let parameters = BakeParameters { samples_per_voxel_face: 4, ..BakeParameters::default() };
    for (name, wanted) in [("office.glb", 13_000.0), ("sponza.glb", 8_000.0)] {
        let scene = earthshine_scene::load(&folder.join(name), &ImportOptions::default());
        assert_chosen(name, &scene.expect("a scene"), &parameters, wanted);
    }
}

#[test]
fn what_is_far_too_much_is_not_counted_and_edges_stay_in_their_range() {
    let scene = generated(WorldKind::TwoRooms, &GenOptions::default());
    let parameters = BakeParameters::default();
    let counter = PatchCounter::new(&scene, &parameters);
    assert_eq!(counter.patches_at(0.25, 100.0), None);
    // Nobody waits for a thousand billion pieces.
    assert_eq!(counter.patches_at(1e-5, 100.0), None);
    let coarse = counter.edge_for(10.0, &(0.125..=0.5));
    assert_eq!((coarse.voxel_edge_m, coarse.patches), (0.5, None));
    let fine = counter.edge_for(1e9, &(0.5..=4.0));
    assert_eq!(fine.voxel_edge_m, 0.5);
    assert_eq!(fine.patches, counter.patches_at(0.5, 1e9));
    // The same on one thread.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    assert_eq!(pool.install(|| counter.edge_for(1e3, &(0.01..=4.0))), counter.edge_for(1e3, &(0.01..=4.0)));
}
