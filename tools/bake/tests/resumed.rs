//! Bakes that do not go through in one piece: interrupted anywhere, shared between processes, repeated after an edit.
//! Each ends with the bytes of a bake in one piece.

use earthshine_bake::{
    BakeError, BakeOptions, BakeSummary, MemoryLimit, Progress, Shard, Silent, Stage, bake, work_folder,
};
use earthshine_gen::{GenOptions, WorldKind};
use earthshine_scene::{ImportOptions, Scene};
use earthshine_tiles::BakeParameters;
use earthshine_world::{Grid, LightRig, Vec3};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Eighty metres of corridor with a crate of half a metre at `crate_at`.
fn corridor(crate_at: Vec3) -> Scene {
    let shape = GenOptions { corridor_length_m: 80.0, ..GenOptions::default() };
    with_crate(WorldKind::Corridor, &shape, crate_at, 0.5)
}

/// A town of 5 by 5 blocks, most of them parks, with a crate of 4 m on a crossing. Nothing emits, so that what is buried
/// absorbs.
fn open_town(crate_at: Vec3) -> Scene {
    let shape = GenOptions { town_size_m: 200.0, town_triangles: Some(25_000), ..GenOptions::default() };
    let mut scene = with_crate(WorldKind::Town, &shape, crate_at, 4.0);
    scene.materials.iter_mut().for_each(|material| material.emitted_radiance = Vec3::ZERO);
    scene
}

fn with_crate(kind: WorldKind, shape: &GenOptions, crate_at: Vec3, edge_m: f32) -> Scene {
    let glb = earthshine_gen::generate(kind, shape, &|_, _| {}).expect("a generated scene");
    let mut scene = earthshine_scene::load_bytes(&glb.bytes, "generated", &ImportOptions::default())
        .expect("an importable scene");
    for axis in 0..3 {
        let (u, v) = (unit(axis + 1), unit(axis + 2));
        for (corner, turn) in [(Vec3::ZERO, true), (unit(axis), false)] {
            let quad = [corner, corner + u, corner + u + v, corner + v].map(|at| crate_at + at * edge_m);
            for [a, b, c] in [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]] {
                scene.triangles.push(if turn { [a, c, b] } else { [a, b, c] });
                scene.texture_coordinates.push([[0.0; 2]; 3]);
                scene.material_of.push(0);
            }
        }
    }
    scene
}

fn unit(axis: usize) -> Vec3 {
    [Vec3::X, Vec3::Y, Vec3::Z][axis % 3]
}

fn options() -> BakeOptions {
    let grid = Grid { voxel_edge_m: 0.8, chunk_edge_voxels: 4 };
    let parameters = BakeParameters {
        grid,
        rays_per_patch: 128,
        receiver_rays: 64,
        receiver_reach_voxels: 1,
        detail: 2,
        detail_rays: 16,
        ..BakeParameters::default()
    };
    BakeOptions::new("corridor", parameters, LightRig::emission_only())
}

fn baked(scene: &Scene, world: &Path, options: &BakeOptions) -> BakeSummary {
    bake(scene, world, options, &Silent).expect("a bake")
}

/// The manifest and all tiles; not the work folder.
fn files(world: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![world.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() && !path.ends_with(work_folder::FOLDER) {
                folders.push(path);
            } else if path.is_file() {
                let name = path.strip_prefix(world).expect("inside").display().to_string();
                found.insert(name, std::fs::read(&path).expect("a file"));
            }
        }
    }
    found
}

fn tiles_of(files: &BTreeMap<String, Vec<u8>>) -> Vec<&String> {
    files.keys().filter(|name| name.ends_with(".tile")).collect()
}

const HERE: Vec3 = Vec3::new(3.0, 0.3, 0.2);
const MOVED: Vec3 = Vec3::new(3.6, 0.3, 0.2);

/// Stands for a kill: panics in the middle of one stage.
struct PullThePlug {
    stage: Stage,
    left: AtomicU64,
}

impl Progress for PullThePlug {
    fn begin(&self, stage: Stage, total: u64) {
        let left = if stage == self.stage { total / 2 } else { u64::MAX };
        self.left.store(left, Ordering::Relaxed);
    }

    fn advance(&self, units: u64) {
        let left = self.left.load(Ordering::Relaxed);
        assert!(left == u64::MAX || left > units, "the plug is pulled");
        if left != u64::MAX {
            self.left.store(left - units, Ordering::Relaxed);
        }
    }

    fn device_failed(&self, cause: &str) {
        unreachable!("no device: {cause}");
    }
}

#[test]
fn a_bake_goes_on_after_an_interruption_in_any_stage() {
    let scene = corridor(HERE);
    let folder = tempfile::tempdir().expect("a folder");
    let whole = folder.path().join("whole");
    let summary = baked(&scene, &whole, &options());
    let expected = files(&whole);
    let cut = folder.path().join("cut");
    for stage in [
        Stage::Exposure,
        Stage::Rows,
        Stage::Receivers,
        Stage::Detail,
        Stage::Reciprocity,
        Stage::Tiles,
        Stage::Pyramid,
    ] {
        let plug = PullThePlug { stage, left: AtomicU64::new(u64::MAX) };
        let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            bake(&scene, &cut, &options(), &plug).map(|_| ())
        }));
        assert!(stopped.is_err(), "{}", stage.name());
        assert!(!cut.join("world.toml").is_file(), "no manifest before the world is whole");
    }
    let resumed = baked(&scene, &cut, &options());
    assert_eq!((resumed.rays, resumed.exposure_rays, resumed.receiver_rays), (0, 0, 0), "all was kept");
    assert!(
        resumed.detail_rays == 0 && summary.detail_rays > 0,
        "{} and {}",
        resumed.detail_rays,
        summary.detail_rays
    );
    assert!(summary.rays > 0 && summary.exposure_rays > 0 && summary.receiver_rays > 0);
    assert!(expected == files(&cut), "the bytes differ");
}

#[test]
fn half_of_every_stage_is_not_done_twice() {
    let scene = corridor(HERE);
    let folder = tempfile::tempdir().expect("a folder");
    let whole = baked(&scene, &folder.path().join("whole"), &options());
    for stage in [Stage::Exposure, Stage::Rows] {
        let cut = folder.path().join(stage.name());
        let plug = PullThePlug { stage, left: AtomicU64::new(u64::MAX) };
        let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            bake(&scene, &cut, &options(), &plug).map(|_| ())
        }));
        assert!(stopped.is_err());
        let resumed = baked(&scene, &cut, &options());
        let (left, all) = match stage {
            Stage::Rows => (resumed.rays, whole.rays),
            _ => (resumed.exposure_rays, whole.exposure_rays),
        };
        assert!(left > 0 && left * 5 < all * 4, "{}: {left} of {all} rays again", stage.name());
    }
}

#[test]
fn damaged_work_is_done_again() {
    let scene = corridor(HERE);
    let folder = tempfile::tempdir().expect("a folder");
    let [whole, spoilt] = ["whole", "spoilt"].map(|name| folder.path().join(name));
    baked(&scene, &whole, &options());
    baked(&scene, &spoilt, &options());
    std::fs::remove_file(spoilt.join("world.toml")).expect("a manifest");
    for kind in ["surfaces", "rows", "receivers"] {
        let mut victims: Vec<_> = std::fs::read_dir(spoilt.join(work_folder::FOLDER).join(kind))
            .expect("a folder")
            .map(|entry| entry.expect("an entry").path())
            .collect();
        victims.sort();
        let mut bytes = std::fs::read(&victims[0]).expect("a file");
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(&victims[0], &bytes).expect("written");
        std::fs::write(&victims[1], &bytes[..middle]).expect("written");
    }
    let again = baked(&scene, &spoilt, &options());
    assert!(again.rays > 0 && again.exposure_rays > 0 && again.receiver_rays > 0, "{again:?}");
    assert!(files(&whole) == files(&spoilt), "the bytes differ");
}

#[test]
fn shards_alone_together_and_one_after_another_make_the_same_world() {
    let scene = corridor(HERE);
    let folder = tempfile::tempdir().expect("a folder");
    let [whole, alone, together] = ["whole", "alone", "together"].map(|name| folder.path().join(name));
    baked(&scene, &whole, &options());
    let of = |index, count| BakeOptions { shard: Shard { index, count }, ..options() };
    baked(&scene, &alone, &of(1, 3));
    assert!(files(&whole) == files(&alone), "the bytes differ");
    assert!(baked(&scene, &alone, &of(2, 3)).up_to_date);
    let rays: Vec<u64> = std::thread::scope(|scope| {
        let run = |index| {
            let (scene, together, of) = (&scene, &together, &of);
            scope.spawn(move || {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
                pool.install(|| baked(scene, together, &of(index, 2)).rays)
            })
        };
        let running = [run(0), run(1)];
        running.into_iter().map(|shard| shard.join().expect("a bake")).collect()
    });
    assert!(rays.iter().all(|&rays| rays > 0), "both have worked: {rays:?}");
    assert!(files(&whole) == files(&together), "the bytes differ");
    baked(&scene, &together, &options());
    assert!(
        !together.join(work_folder::FOLDER).join("averages").is_dir(),
        "cleared by the one without --shard"
    );
}

#[test]
fn an_edit_traces_what_sees_it_and_comes_to_the_bytes_of_a_fresh_bake() {
    let folder = tempfile::tempdir().expect("a folder");
    let [edited, fresh] = ["edited", "fresh"].map(|name| folder.path().join(name));
    let first = baked(&corridor(HERE), &edited, &options());
    let before = files(&edited);
    assert!(first.stale.stages.is_empty(), "and has nothing to explain");

    let again = baked(&corridor(MOVED), &edited, &options());
    let whole = baked(&corridor(MOVED), &fresh, &options());
    let after = files(&edited);
    assert!(after == files(&fresh), "the bytes differ");
    assert!(again.rays > 0 && again.rays * 2 < whole.rays, "{} of {} rays", again.rays, whole.rays);
    let stale = &again.stale;
    assert!(stale.changed_tiles > 0 && stale.kept_tiles > 0, "{stale:?}");
    let why = |text: &str| stale.stages.iter().any(|stage| stage.why.contains(text));
    assert!(why("its own surfaces changed") && why(" can see changed"), "{stale:?}");
    // The far end of the corridor is many turns away.
    assert!(stale.changed_chunks.iter().all(|chunk| (chunk[0] as f32) < 60.0 / 3.2), "{stale:?}");
    let kept = tiles_of(&after).into_iter().filter(|name| before.contains_key(*name)).count() as u64;
    assert_eq!(kept, stale.kept_tiles);

    let back = baked(&corridor(HERE), &edited, &options());
    assert!(back.rays < first.rays && files(&edited) == before, "there and back again");
}

/// Goal: where everything sees far, an edit traces the rows and points whose rays come to it, and no more. Method: a crate
/// moves down a street of an open town, back and forth often enough that earlier states are given up.
#[test]
fn an_edit_of_an_open_town_traces_a_few_rows_of_many_chunks() {
    let folder = tempfile::tempdir().expect("a folder");
    let [edited, fresh] = ["edited", "fresh"].map(|name| folder.path().join(name));
    let mut options = options();
    options.parameters.grid = Grid { voxel_edge_m: 4.0, chunk_edge_voxels: 8 };
    options.parameters.rays_per_patch = 32;
    options.parameters.samples_per_voxel_face = 4;
    let at = |step: u8| open_town(Vec3::new(-2.0, 0.05, f32::from(step) * 6.0));
    baked(&at(0), &edited, &options);
    let before = files(&edited);
    let again = baked(&at(1), &edited, &options);
    let whole = baked(&at(1), &fresh, &options);
    assert!(files(&edited) == files(&fresh), "the bytes differ");
    assert!(again.rays > 0 && again.rays * 4 < whole.rays, "{} of {} rays", again.rays, whole.rays);
    let (points, all) = (again.exposure_rays, whole.exposure_rays);
    assert!(points > 0 && points * 2 < all, "{points} of {all} rays of points");
    assert!(again.receiver_rays * 3 < whole.receiver_rays, "{again:?}");
    let (detail, all) = (again.detail_rays, whole.detail_rays);
    assert!(detail > 0 && detail < all, "{detail} of {all} rays of detail");
    assert!(
        again.stale.stages.iter().any(|stage| stage.why.contains(" can see changed")),
        "{:?}",
        again.stale
    );
    for step in [2, 3, 4, 5, 0] {
        baked(&at(step), &edited, &options);
    }
    assert!(files(&edited) == before, "there and back again");
    let states = std::fs::read_dir(edited.join(work_folder::FOLDER).join("states")).expect("a folder");
    assert!(states.count() <= 10, "earlier states go");
}

/// Goal: trees of meshes save memory and change no byte. Method: a town baked with just so much memory that one tree over
/// all triangles does not fit, against one without a limit.
#[test]
fn the_bytes_do_not_hang_on_the_trees() {
    let folder = tempfile::tempdir().expect("a folder");
    let [one, of_meshes] = ["one", "of_meshes"].map(|name| folder.path().join(name));
    let shape = GenOptions { town_size_m: 120.0, ..GenOptions::default() };
    let scene = with_crate(WorldKind::Town, &shape, Vec3::Y, 4.0);
    let mut options = options();
    options.parameters.grid = Grid { voxel_edge_m: 4.0, chunk_edge_voxels: 8 };
    options.parameters.rays_per_patch = 32;
    options.parameters.samples_per_voxel_face = 4;
    let whole = baked(&scene, &one, &options);
    options.memory = MemoryLimit(Some(whole.memory_estimate_bytes * 9 / 10));
    let thrifty = baked(&scene, &of_meshes, &options);
    assert!(
        thrifty.tree_bytes * 4 < whole.tree_bytes,
        "{} of {} bytes",
        thrifty.tree_bytes,
        whole.tree_bytes
    );
    assert!(files(&one) == files(&of_meshes), "the bytes differ");
}

#[test]
fn paint_is_not_traced() {
    let folder = tempfile::tempdir().expect("a folder");
    let [edited, fresh] = ["edited", "fresh"].map(|name| folder.path().join(name));
    let mut scene = corridor(HERE);
    baked(&scene, &edited, &options());
    let painted = scene.material_of[scene.material_of.len() / 2] as usize;
    scene.materials[painted].base_colour = [0.1, 0.2, 0.3, 1.0];
    let again = baked(&scene, &edited, &options());
    assert_eq!((again.rays, again.exposure_rays, again.receiver_rays), (0, 0, 0));
    assert!(again.stale.changed_tiles > 0 && again.stale.traced_chunks == 0, "{:?}", again.stale);
    baked(&scene, &fresh, &options());
    assert!(files(&fresh) == files(&edited), "the bytes differ");
}

#[test]
fn too_little_memory_is_said_before_anything_is_traced() {
    let folder = tempfile::tempdir().expect("a folder");
    let options = BakeOptions { memory: MemoryLimit(Some(16 << 20)), ..options() };
    let refused = bake(&corridor(HERE), folder.path(), &options, &Silent).expect_err("too little");
    assert!(matches!(refused, BakeError::Memory { limit_mib: 16, .. }), "{refused}");
    assert!(refused.to_string().contains("--voxel"), "{refused}");
}
