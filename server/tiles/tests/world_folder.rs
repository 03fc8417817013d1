//! The manifest, the store, the store that fails.

mod chunks;

use chunks::{options, random_chunk, write_world};
use earthshine_tiles::{
    DirStore, FaultPlan, FaultyStore, Manifest, RowCodec, TileError, TileStore, encode, fault::Fault, format,
};
use earthshine_world::{Chunk, ChunkCoord, ChunkId, Light, Receivers, Vec3};
use std::path::Path;
use std::time::Duration;

/// Chunks at x = 0.. whose columns stay inside of each.
fn closed_chunks(count: i32) -> Vec<Chunk> {
    (0..count)
        .map(|x| {
            let mut chunk = random_chunk(3, 20, 5);
            chunk.id = ChunkId::new(0, ChunkCoord::new(x, 0, 0));
            chunk.rows.segments = vec![chunk.id];
            chunk.rows.row_starts.fill(0);
            chunk.rows.columns.clear();
            chunk.rows.shares.clear();
            chunk.receivers = Receivers::default();
            chunk
        })
        .collect()
}

fn world(count: i32) -> (tempfile::TempDir, Manifest) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let manifest = write_world(folder.path(), &closed_chunks(count), &options(RowCodec::Full));
    (folder, manifest)
}

#[test]
fn a_manifest_comes_back_and_is_readable() {
    let (folder, mut manifest) = world(2);
    manifest.lights.lights.push(Light::Point {
        position: Vec3::ONE,
        intensity: Vec3::splat(100.0),
        range_m: None,
    });
    manifest.lights.lights.push(Light::Directional {
        direction: Vec3::NEG_Y,
        illuminance: Vec3::splat(1e5),
        angular_diameter_rad: 0.0093,
    });
    manifest.parameters.seed = i64::MAX as u64;
    manifest.save(folder.path()).unwrap();
    assert_eq!(Manifest::load(folder.path()).unwrap(), manifest);
    let text = std::fs::read_to_string(folder.path().join("world.toml")).unwrap();
    for line in ["format_version = 6", "world_hash = \"00000000000000e4\"", "[[chunks]]", "[parameters.grid]"]
    {
        assert!(text.contains(line), "{line} not in\n{text}");
    }
    let index = manifest.index();
    assert_eq!(index.chunks.len(), 2);
    assert_eq!((index.chunks[1].id.coord.x, index.chunks[1].patch_count), (1, 20));
}

#[test]
fn broken_manifests_say_what_is_wrong() {
    let (folder, manifest) = world(2);
    let path = folder.path().join("world.toml");
    let good = std::fs::read_to_string(&path).unwrap();
    let file = &manifest.chunks[0].file;
    let cases = [
        ("scene = \"test\"", "scenery = \"test\"", "scenery"),
        ("scene = \"test\"", "", "scene"),
        ("scene = \"test\"", "scene = ", "line 4"),
        ("voxel_edge_m = 1.0", "voxel_edge_m = nan", "voxel_edge_m"),
        ("chunk_edge_voxels = 16", "chunk_edge_voxels = 23", "chunk_edge_voxels"),
        ("rays_per_patch", "rays_per_pitch", "rays_per_pitch"),
        ("emission_scale = 1.0", "emission_scale = -1.0", "emission scale"),
        ("00000000000000e4", "xyz", "16 hexadecimal digits"),
        ("-100.0", "inf", "bounds"),
        (file, "../../etc/passwd", "leads out"),
        (file, "/etc/passwd", "leads out"),
        (file, "C:\\\\windows", "leads out"),
        ("coord = [0, 0, 0]", "coord = [1, 0, 0]", "comes after"),
        ("level = 0", "level = 16", "level"),
        ("patch_count = 20", "patch_count = 65537", "patches"),
        ("patch_count = 20", "patch_count = -1", "patch_count"),
    ];
    for (from, to, words) in cases {
        assert!(good.contains(from), "{from} not in\n{good}");
        std::fs::write(&path, good.replace(from, to)).unwrap();
        let error = Manifest::load(folder.path()).expect_err(words);
        assert!(matches!(error, TileError::Manifest { .. }), "{error}");
        assert!(error.to_string().contains(words) && error.to_string().contains("world.toml"), "{error}");
    }
    std::fs::write(&path, good.replace("format_version = 6", "format_version = 7\nnews = 1")).unwrap();
    assert!(matches!(Manifest::load(folder.path()), Err(TileError::Version { found: 7, .. })));
    std::fs::write(&path, good.replace("format_version = 6", "format_version = 4")).unwrap();
    assert_eq!(Manifest::load(folder.path()).unwrap().format_version, format::VERSION_OLDEST);
    std::fs::write(&path, [0xFF, 0xFE]).unwrap();
    assert!(matches!(Manifest::load(folder.path()), Err(TileError::Manifest { .. })));
    std::fs::remove_file(&path).unwrap();
    for place in [folder.path(), Path::new("/no/such/world")] {
        let error = DirStore::open(place).expect_err("no manifest");
        assert!(matches!(error, TileError::NotAWorld { .. }), "{error}");
    }
}

#[test]
fn a_manifest_that_could_not_be_loaded_is_not_saved() {
    let (folder, manifest) = world(1);
    let mut broken = manifest.clone();
    broken.parameters.seed = u64::MAX;
    assert!(broken.save(folder.path()).unwrap_err().to_string().contains("seed"));
    let mut broken = manifest.clone();
    broken.chunks[0].file = "../x".to_owned();
    assert!(broken.save(folder.path()).is_err());
    assert_eq!(Manifest::load(folder.path()).unwrap(), manifest, "the old one is untouched");
}

#[test]
fn a_store_loads_its_chunks_and_no_others() {
    let (folder, manifest) = world(3);
    let store = DirStore::open(folder.path()).unwrap();
    let chunks = closed_chunks(3);
    for chunk in &chunks {
        assert_eq!(store.load(chunk.id).unwrap().rows, chunk.rows);
        assert!(store.path_of(chunk.id).unwrap().is_file());
    }
    let elsewhere = ChunkId::new(1, ChunkCoord::ZERO);
    assert!(matches!(store.load(elsewhere), Err(TileError::UnknownChunk { .. })));
    assert_eq!(store.path_of(elsewhere), None);
    std::fs::remove_file(folder.path().join(&manifest.chunks[0].file)).unwrap();
    let error = store.load(chunks[0].id).expect_err("no file");
    assert!(matches!(error, TileError::Missing { .. }) && !error.is_transient(), "{error}");
}

#[test]
fn swapped_tiles_are_refused() {
    let (folder, manifest) = world(2);
    let store = DirStore::open(folder.path()).unwrap();
    let path = folder.path().join(&manifest.chunks[0].file);
    let refused = |bytes: &[u8], words: &str| {
        std::fs::write(&path, bytes).unwrap();
        let error = store.load(manifest.chunks[0].id()).expect_err(words);
        assert!(matches!(error, TileError::Foreign { .. }), "{error}");
        assert!(error.to_string().contains(words), "{error}");
    };
    let mut chunks = closed_chunks(2);
    let mut other_world = options(RowCodec::Full);
    other_world.world_hash = 7;
    refused(&encode(&chunks[0], &other_world).unwrap(), "its world hash is 0000000000000007");
    refused(&encode(&chunks[1], &options(RowCodec::Full)).unwrap(), "its chunk is L0(1,0,0)");
    chunks[0].rows.absorbed_shares[0] += 1e-4;
    refused(&encode(&chunks[0], &options(RowCodec::Full)).unwrap(), "its tile hash is");
}

#[test]
fn columns_beyond_the_world_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut chunks = closed_chunks(2);
    let neighbour = chunks[1].id;
    let rows = &mut chunks[0].rows;
    rows.segments = vec![neighbour];
    rows.columns = vec![earthshine_world::Column { segment: 0, local: 20 }];
    rows.shares = vec![0.5];
    rows.row_starts[1..].fill(1);
    write_world(folder.path(), &chunks, &options(RowCodec::Half));
    let error = DirStore::open(folder.path()).unwrap().load(chunks[0].id).expect_err("20 of 20");
    assert!(error.to_string().contains("patch 20 of segment 0, which has 20"), "{error}");

    chunks[0].rows.columns[0].local = 19;
    write_world(folder.path(), &chunks, &options(RowCodec::Half));
    DirStore::open(folder.path()).unwrap().load(chunks[0].id).expect("19 of 20");

    write_world(folder.path(), &chunks[..1], &options(RowCodec::Half));
    let error = DirStore::open(folder.path()).unwrap().load(chunks[0].id).expect_err("no neighbour");
    assert!(error.to_string().contains("chunk L0(1,0,0), which the world lacks"), "{error}");
}

#[test]
fn faults_come_by_seed_and_rate() {
    let (folder, manifest) = world(3);
    let plan = FaultPlan {
        slow_rate: 0.1,
        missing_rate: 0.2,
        torn_rate: 0.2,
        flipped_rate: 0.2,
        delay: Duration::from_micros(1),
        ..FaultPlan::none(5)
    };
    let store = || FaultyStore::new(DirStore::open(folder.path()).unwrap(), plan);
    let run = |store: FaultyStore<DirStore>| -> Vec<Option<String>> {
        let loads = (0..300).map(|i| store.load(manifest.chunks[i % 3].id()));
        loads.map(|load| load.err().map(|error| error.to_string())).collect()
    };
    let results = run(store());
    assert_eq!(results, run(store()), "the same seed gives the same faults");
    for (i, result) in results.iter().enumerate() {
        let fault = plan.fault_of(manifest.chunks[i % 3].id(), i as u64 / 3);
        assert_eq!(result.is_none(), matches!(fault, Fault::None | Fault::Slow), "{fault:?}: {result:?}");
    }
    let share = results.iter().flatten().count() as f32 / 300.0;
    assert!((share - 0.6).abs() < 0.1, "{share}");
    for words in ["missing-", "torn-", "flipped-"] {
        assert!(results.iter().flatten().any(|error| error.contains(words)), "{words}");
    }
    let quiet = FaultyStore::new(DirStore::open(folder.path()).unwrap(), FaultPlan::none(5));
    assert!(run(quiet).iter().all(Option::is_none));
}
