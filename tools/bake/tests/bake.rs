//! Whole bakes of generated scenes: the same bytes however they come about, sound rows, refusals.

use earthshine_bake::pyramid::check::check_energy;
use earthshine_bake::{
    BakeError, BakeOptions, BakeSummary, Levels, MemoryLimit, Progress, Silent, Stage, bake, work_folder,
};
use earthshine_gen::{GenOptions, WorldKind};
use earthshine_scene::{ImportOptions, Scene};
use earthshine_tiles::{
    BakeMethod, BakeParameters, DirStore, PatchBuilder, RowEstimator, SampleSource, TileStore,
    check_receivers, check_rows,
};
use earthshine_world::{Chunk, ChunkRows, Grid, LightRig, PatchId, ReceiverPlace, Vec3, VoxelCoord};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

fn scene(kind: WorldKind) -> Scene {
    let glb = earthshine_gen::generate(kind, &GenOptions::default(), &|_, _| {}).expect("a generated scene");
    earthshine_scene::load_bytes(&glb.bytes, "generated", &ImportOptions::default())
        .expect("an importable scene")
}

fn options(voxel_edge_m: f32) -> BakeOptions {
    let grid = Grid { voxel_edge_m, chunk_edge_voxels: 4 };
    let parameters =
        BakeParameters { grid, rays_per_patch: 256, detail: 2, detail_rays: 64, ..BakeParameters::default() };
    BakeOptions::new("generated", parameters, LightRig::emission_only())
}

fn files(world: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![world.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.ends_with(work_folder::FOLDER) {
                continue;
            }
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(world).expect("inside").display().to_string();
                found.insert(name, std::fs::read(&path).expect("a file"));
            }
        }
    }
    found
}

fn bake_with(threads: usize, scene: &Scene, world: &Path, progress: &dyn Progress) -> BakeSummary {
    bake_as(&options(0.4), threads, scene, world, progress)
}

fn bake_as(
    options: &BakeOptions,
    threads: usize,
    scene: &Scene,
    world: &Path,
    progress: &dyn Progress,
) -> BakeSummary {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| bake(scene, world, options, progress).expect("a bake"))
}

/// One of everything that is not the default.
fn methods() -> [BakeMethod; 3] {
    let base = BakeMethod { emitter_factor: 1, ..BakeMethod::default() };
    [
        BakeMethod { samples: SampleSource::Hammersley, builder: PatchBuilder::Clustered, ..base },
        BakeMethod { row_error: 0.05, rays_min: 128, rays_max: 1024, ..base },
        BakeMethod { estimator: RowEstimator::Points, ..base },
    ]
}

/// Of level 0.
fn chunks(world: &Path) -> Vec<Chunk> {
    all_chunks(world).into_iter().filter(|chunk| chunk.id.level == 0).collect()
}

fn all_chunks(world: &Path) -> Vec<Chunk> {
    let store = DirStore::open(world).expect("a world");
    let index = store.manifest().index();
    index.chunks.iter().map(|chunk| store.load(chunk.id).expect("a sound tile")).collect()
}

/// Stands for a kill: panics once half of the rays are cast.
struct PullThePlug {
    total: AtomicU64,
    done: AtomicU64,
}

impl Progress for PullThePlug {
    fn begin(&self, stage: Stage, total: u64) {
        let rays = if stage == Stage::Rows { total } else { u64::MAX };
        self.total.store(rays, Ordering::Relaxed);
    }

    fn advance(&self, units: u64) {
        let done = self.done.fetch_add(units, Ordering::Relaxed) + units;
        let total = self.total.load(Ordering::Relaxed);
        assert!(total == u64::MAX || done < total / 2, "the plug is pulled");
        if total == u64::MAX {
            self.done.store(0, Ordering::Relaxed);
        }
    }

    fn device_failed(&self, cause: &str) {
        unreachable!("no device: {cause}");
    }
}

#[test]
fn the_same_bytes_at_any_thread_count_and_after_an_interruption() {
    let scene = scene(WorldKind::Cornell);
    let folder = tempfile::tempdir().expect("a folder");
    let [one, two, cut] = ["one", "two", "cut"].map(|name| folder.path().join(name));
    let summary = bake_with(1, &scene, &one, &Silent);
    bake_with(2, &scene, &two, &Silent);
    assert_eq!(files(&one), files(&two));

    let plug = PullThePlug { total: AtomicU64::new(u64::MAX), done: AtomicU64::new(0) };
    let stopped =
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| bake_with(1, &scene, &cut, &plug)));
    assert!(stopped.is_err());
    assert!(!cut.join("world.toml").is_file(), "no manifest before the world is whole");
    let resumed = bake_with(2, &scene, &cut, &Silent);
    assert!(resumed.resumed_chunks > 0 && resumed.rays < summary.rays, "{resumed:?}");
    assert_eq!(files(&one), files(&cut));
    let left: Vec<_> = std::fs::read_dir(cut.join(work_folder::FOLDER))
        .expect("what an edit would use")
        .map(|entry| entry.expect("an entry").file_name())
        .collect();
    assert!(left.len() == 6 && !left.contains(&"averages".into()), "{left:?}");
    let thrifty = BakeOptions { discard_work: true, ..options(0.4) };
    assert!(bake_as(&thrifty, 1, &scene, &cut, &Silent).up_to_date);
    assert!(!cut.join(work_folder::FOLDER).is_dir());
}

#[test]
fn other_methods_are_as_reproducible_and_their_rows_as_sound() {
    let scene = scene(WorldKind::Cornell);
    for (index, method) in methods().into_iter().enumerate() {
        let mut options = options(0.4);
        options.parameters = BakeParameters { method, points_per_patch: 4, ..options.parameters };
        let folder = tempfile::tempdir().expect("a folder");
        let [one, cut] = ["one", "cut"].map(|name| folder.path().join(name));
        let summary = bake_as(&options, 1, &scene, &one, &Silent);
        let plug = PullThePlug { total: AtomicU64::new(u64::MAX), done: AtomicU64::new(0) };
        let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            bake_as(&options, 2, &scene, &cut, &plug)
        }));
        assert!(stopped.is_err());
        let resumed = bake_as(&options, 2, &scene, &cut, &Silent);
        assert!(resumed.rays < summary.rays, "{method:?}");
        assert_eq!(files(&one), files(&cut), "{method:?}");
        for chunk in chunks(&one) {
            assert_eq!(check_rows(&chunk), Vec::new(), "{method:?}, chunk {}", chunk.id);
        }
        let fixed = 256 * summary.patches;
        assert_eq!(index == 1, summary.rays != fixed, "{method:?}: {} rays, not {fixed}", summary.rays);
        assert!(summary.mrays_s_core_whole > 0.0 && summary.mrays_s_core_whole < 2.0 * summary.mrays_s_core);
    }
}

#[test]
fn rows_are_sound_and_reciprocal() {
    let folder = tempfile::tempdir().expect("a folder");
    let summary = bake_with(2, &scene(WorldKind::Cornell), folder.path(), &Silent);
    assert!(summary.patches > 100 && summary.buried_samples > 0, "{summary:?}");
    assert!(summary.balance.deficit_max < 0.06, "{summary:?}");
    for chunk in chunks(folder.path()) {
        assert_eq!((check_rows(&chunk), check_receivers(&chunk)), (vec![], vec![]), "chunk {}", chunk.id);
        for patch in &chunk.patches {
            assert!(patch.area > 0.0 && patch.point_count > 0);
        }
    }
}

#[test]
fn lamps_cast_more_rays_and_a_world_of_lamps_does_not() {
    let rays = |kind: WorldKind, emitter_factor: u32| {
        let mut options = options(0.4);
        options.parameters.method.emitter_factor = emitter_factor;
        let folder = tempfile::tempdir().expect("a folder");
        let summary = bake_as(&options, 2, &scene(kind), folder.path(), &Silent);
        let lit = |chunk: &Chunk| chunk.patches.iter().filter(|p| p.emission.max_element() > 0.0).count();
        let lamps: usize = chunks(folder.path()).iter().map(lit).sum();
        (summary.rays, summary.patches * 256, lamps as u64)
    };
    let (cast, base, lamps) = rays(WorldKind::Cornell, 8);
    assert!(lamps > 0 && cast == base + 7 * 256 * lamps, "{cast} rays, {base} and {lamps} lamps");
    let (cast, base, lamps) = rays(WorldKind::Furnace, 8);
    assert!(lamps > 0 && cast <= 2 * base, "{cast} rays, {base} and {lamps} lamps");
}

#[test]
fn coarse_levels_have_the_energy_of_level_0_and_are_reciprocal() {
    let folder = tempfile::tempdir().expect("a folder");
    let options = BakeOptions { levels: Levels::Exactly(4), ..options(0.4) };
    let summary = bake(&scene(WorldKind::Cornell), folder.path(), &options, &Silent).expect("a bake");
    let patches: Vec<u64> = summary.levels.iter().map(|level| level.patches).collect();
    assert!(patches.len() == 4 && patches.is_sorted_by(|fine, coarse| fine > coarse), "{patches:?}");
    assert_eq!(summary.levels[3].voxel_edge_m, 3.2);
    let mut world: BTreeMap<_, _> =
        all_chunks(folder.path()).into_iter().map(|chunk| (chunk.id, chunk)).collect();
    let total = |level: u8, of: fn(&Chunk, usize) -> f32| -> f32 {
        let of_level = world.values().filter(|chunk| chunk.id.level == level);
        of_level.flat_map(|chunk| (0..chunk.patches.len()).map(move |i| of(chunk, i))).sum()
    };
    let area = total(0, |chunk, i| chunk.patches[i].area);
    for level in 1..4 {
        assert!((total(level, |chunk, i| chunk.patches[i].area) / area - 1.0).abs() < 1e-5);
        let own = |chunk: &Chunk, i: usize| {
            let here = |column| chunk.rows.patch_id(column) == PatchId { chunk: chunk.id, local: i as u16 };
            chunk.rows.row(i).filter(|&(column, _)| here(column)).map(|(_, share)| share).sum::<f32>()
        };
        assert!(level < 3 || total(level, own) > 0.0, "half a box sees itself");
    }
    for chunk in world.values() {
        assert_eq!(check_rows(chunk), Vec::new(), "chunk {}", chunk.id);
        for (i, patch) in chunk.patches.iter().enumerate() {
            assert!((1..=64).contains(&chunk.points_of(patch).len()));
            let bounds = Grid { voxel_edge_m: 0.4, chunk_edge_voxels: 4 }.at_level(chunk.id.level);
            assert_eq!(bounds.chunk_of(patch.voxel), chunk.id.coord, "patch {i}");
        }
    }
    assert_eq!(check_energy(&world), Vec::new());
    // The check is worth nothing if it finds nothing.
    let victim = *world.keys().find(|id| id.level == 2).expect("a chunk of level 2");
    world.get_mut(&victim).expect("it is there").patches[0].reflectance *= 1.01;
    let faults = check_energy(&world);
    assert!(!faults.is_empty() && faults[0].patch.chunk == victim, "{faults:?}");
    assert!(faults[0].what.starts_with("reflected"), "{faults:?}");
}

#[test]
fn levels_are_changed_without_tracing() {
    let folder = tempfile::tempdir().expect("a folder");
    let (scene, [one, three]) =
        (scene(WorldKind::Cornell), ["one", "three"].map(|name| folder.path().join(name)));
    let with = |levels| BakeOptions { levels, ..options(0.4) };
    bake(&scene, &three, &with(Levels::Exactly(3)), &Silent).expect("a bake");
    bake(&scene, &one, &with(Levels::Exactly(1)), &Silent).expect("a bake");
    let finest = files(&one);
    let raised = bake(&scene, &one, &with(Levels::Exactly(3)), &Silent).expect("coarse levels");
    assert!(!raised.up_to_date && raised.rays == 0 && raised.levels.len() == 3, "{raised:?}");
    assert_eq!(files(&one), files(&three));
    assert!(bake(&scene, &one, &with(Levels::Exactly(3)), &Silent).expect("nothing to do").up_to_date);
    bake(&scene, &one, &with(Levels::Exactly(1)), &Silent).expect("coarse levels go");
    assert_eq!(files(&one), finest);
}

#[test]
fn a_closed_box_has_no_sky_and_its_area() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene(WorldKind::Furnace);
    let area: f32 = scene.triangles.iter().map(|[a, b, c]| (b - a).cross(c - a).length() * 0.5).sum();
    bake_with(2, &scene, folder.path(), &Silent);
    let (mut inside, mut sky) = (0.0, 0.0f32);
    for chunk in chunks(folder.path()) {
        for (row, patch) in chunk.patches.iter().enumerate() {
            if patch.emission.max_element() > 0.0 {
                inside += patch.area;
                sky = sky.max(chunk.rows.sky_shares[row].iter().sum());
            }
        }
    }
    // A point in the very corner may be hidden: a 2,400th of the area.
    assert!((inside / area - 1.0).abs() < 1e-3, "{inside} of {area}");
    assert_eq!(sky, 0.0);
}

/// Goal: air in a room sees what its walls do. Method: the furnace, a closed box: every row of every receiver ends on
/// its glowing sides, so that the air is as bright as they are; outside of the box there is no air to light.
#[test]
fn the_air_of_a_closed_box_sees_its_walls_and_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene(WorldKind::Furnace);
    let summary = bake_with(2, &scene, folder.path(), &Silent);
    assert!(summary.receivers > 0 && summary.receiver_rays > 0, "{summary:?}");
    let chunks = chunks(folder.path());
    let glows = |rows: &ChunkRows, row: usize| -> f32 {
        let of = |column| {
            let id = rows.patch_id(column);
            let chunk = chunks.iter().find(|chunk| chunk.id == id.chunk).expect("a chunk of the world");
            chunk.patches[usize::from(id.local)].emission.max_element() > 0.0
        };
        rows.row(row).filter(|&(column, _)| of(column)).map(|(_, share)| share).sum()
    };
    let (mut receivers, mut least) = (0, 1.0f32);
    for chunk in &chunks {
        for (row, place) in chunk.receivers.places.iter().enumerate() {
            let centre = (place.voxel.as_vec3() + 0.5) * 0.4;
            let bounds = scene.bounds();
            if centre.cmpgt(bounds.min).all() && centre.cmplt(bounds.max).all() {
                assert_eq!(chunk.receivers.rows.sky_shares[row], [0.0; 6], "{place:?}");
                least = least.min(glows(&chunk.receivers.rows, row));
                receivers += 1;
            }
        }
    }
    assert!(receivers > 20 && least > 0.98, "{receivers} receivers, {least} of a row glows");
}

/// Goal: detail is all of a patch and nothing else. Method: every patch has parts, as many as its surface can meet, in
/// its own voxel; and their mean row is the patch's own, as far as so few rays tell.
#[test]
fn detail_voxels_are_parts_of_their_patch() {
    let folder = tempfile::tempdir().expect("a folder");
    let summary = bake_with(2, &scene(WorldKind::Furnace), folder.path(), &Silent);
    assert!(summary.detail_receivers > 2 * summary.patches, "{summary:?}");
    for chunk in chunks(folder.path()) {
        for (local, patch) in chunk.patches.iter().enumerate() {
            let is_part = |(_, place): &(usize, &ReceiverPlace)| {
                (place.voxel, place.direction) == (patch.voxel, patch.direction)
            };
            let parts: Vec<_> = chunk.receivers.places.iter().enumerate().filter(is_part).collect();
            assert!((1..=8).contains(&parts.len()), "{patch:?} has {} parts", parts.len());
            for (_, place) in &parts {
                let part = place.detail.expect("where a patch is, receivers are of its detail");
                let coord = part.coord(patch.voxel, 2);
                assert_eq!(coord.div_euclid(VoxelCoord::splat(2)), patch.voxel);
            }
            let seen = |rows: &ChunkRows, row: usize| rows.row(row).map(|(_, share)| share).sum::<f32>();
            let rows = parts.iter().map(|&(row, _)| seen(&chunk.receivers.rows, row));
            let mean = rows.sum::<f32>() / parts.len() as f32;
            let own = seen(&chunk.rows, local);
            assert!((mean - own).abs() < 0.1, "{patch:?} sees {own} of patches, its parts {mean}");
        }
    }
}

/// Goal: solid blocks hold no air. Method: the Cornell box, from voxels small enough that some lie inside of a block.
#[test]
fn air_inside_of_a_block_is_left_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut options = options(0.1);
    options.parameters.rays_per_patch = 16;
    options.parameters.receiver_rays = 128;
    options.parameters.two_sided = false;
    bake(&scene(WorldKind::Cornell), folder.path(), &options, &Silent).expect("a bake");
    let at = |place: Vec3| -> usize {
        let voxel: VoxelCoord = options.parameters.grid.voxel_at(place);
        let chunks = chunks(folder.path());
        let places = chunks.iter().flat_map(|chunk| &chunk.receivers.places);
        places.filter(|place| place.voxel == voxel && place.detail.is_none()).count()
    };
    assert_eq!(at(Vec3::new(0.33, 0.75, 0.4)), 6, "over the short block");
    assert_eq!(at(Vec3::new(0.33, 0.3, 0.4)), 0, "inside of it");
}

#[test]
fn a_whole_world_is_left_alone_and_another_one_is_not_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene(WorldKind::Furnace);
    bake(&scene, folder.path(), &options(1.0), &Silent).expect("a bake");
    let before = files(folder.path());
    assert!(bake(&scene, folder.path(), &options(1.0), &Silent).expect("nothing to do").up_to_date);
    let other = bake(&scene, folder.path(), &options(0.5), &Silent);
    assert!(matches!(other, Err(BakeError::OtherWorld { .. })), "{other:?}");
    assert_eq!(files(folder.path()), before);
    let replaced = BakeOptions { overwrite: true, ..options(0.5) };
    assert!(!bake(&scene, folder.path(), &replaced, &Silent).expect("replaced").up_to_date);
    let listed = DirStore::open(folder.path()).expect("a world").manifest().chunks.len();
    let tiles = files(folder.path()).keys().filter(|name| name.ends_with(".tile")).count();
    assert_eq!(tiles, listed, "tiles of the old world are gone");
}

#[test]
fn impossible_parameters_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let world = folder.path().join("world");
    for edge in [f32::NAN, 0.0, 1e9] {
        let result = bake(&scene(WorldKind::Furnace), &world, &options(edge), &Silent);
        assert!(matches!(result, Err(BakeError::Parameter { name: "voxel edge", .. })), "{edge}");
    }
    let mut crowded = options(1.0);
    crowded.parameters.method.clusters_per_voxel = 40;
    let result = bake(&scene(WorldKind::Furnace), &world, &crowded, &Silent);
    assert!(matches!(result, Err(BakeError::Parameter { name: "clusters a voxel", .. })));
    assert!(!world.is_dir(), "nothing is made before parameters are checked");
}

/// Notes which stages begin.
#[derive(Default)]
struct Begun(Mutex<Vec<Stage>>);

impl Progress for Begun {
    fn begin(&self, stage: Stage, _total: u64) {
        self.0.lock().expect("no holder panics").push(stage);
    }
    fn advance(&self, _units: u64) {}
    fn device_failed(&self, _cause: &str) {}
}

/// Goal: what emitters see is known to be too much before rows take their time. Method: a room with a lamp, within a limit that
/// leaves no choice of trees, and within a byte less than its bake is then said to take.
#[test]
fn too_little_memory_for_emitters_is_said_before_rows() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene(WorldKind::Cornell);
    let limited = |bytes, progress: &dyn Progress| {
        let options = BakeOptions { memory: MemoryLimit(Some(bytes)), ..options(0.4) };
        bake(&scene, &folder.path().join(bytes.to_string()), &options, progress)
    };
    let needed = limited(84 << 20, &Silent).expect("enough").memory_estimate_bytes;
    let begun = Begun::default();
    let refused = limited(needed - 1, &begun).expect_err("too little").to_string();
    assert!(refused.contains("what its emitters see"), "{refused}");
    assert_eq!(begun.0.into_inner().expect("no holder panics"), [Stage::Tree, Stage::Exposure]);
}
