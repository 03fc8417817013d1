//! Damage on disk, seen from above the tile reader: the engine and the service never trip over it.

use earthshine_client::Vec3;
use earthshine_engine::Engine;
use earthshine_gen::fixtures;
use earthshine_radiosity::{Backend, CpuBackend};
use earthshine_tests::agreement::{assert_between, served_patches};
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tests::served::ServedWorld;
use earthshine_tests::solved::SolvedWorld;
use earthshine_tests::viewer::{connect, settled_at};
use earthshine_tiles::{DirStore, Manifest, TileError, TileStore};
use earthshine_world::{ChunkId, LightRig, Rgb, Sky};

fn corridor(length_m: f32, chunk_edge_voxels: u32) -> BakedWorld {
    let scene = imported(&fixtures::corridor_glb(length_m));
    let lights = LightRig { sky: Sky::constant(Rgb::splat(1e4)), ..own_lights(&scene) };
    BakedWorld::new("corridor", &scene, lights, coarse(1.0, chunk_edge_voxels))
}

/// Goal: no byte of a manifest brings anything down. Method: every byte flipped in turn; what still reads as a
/// manifest is given to the store and to an engine.
#[test]
fn every_flipped_byte_of_a_manifest_is_an_error_or_a_world() {
    let world = corridor(8.0, 16);
    let path = world.path().join(Manifest::FILE_NAME);
    let good = std::fs::read(&path).expect("a manifest");
    let sound = Manifest::load(world.path()).expect("a manifest");
    let (mut refused, mut refused_later, mut accepted) = (0, 0, 0);
    for place in 0..good.len() {
        let mut bytes = good.clone();
        bytes[place] ^= 1 << (place % 8);
        std::fs::write(&path, &bytes).expect("a scratch folder");
        let store = match DirStore::open(world.path()) {
            Ok(store) => store,
            Err(error) => {
                assert!(error.to_string().contains("world.toml"), "{error}");
                refused += 1;
                continue;
            }
        };
        let index = store.manifest().index();
        // The same tiles are asked for the same: no need to read them again.
        let is_same =
            (&store.manifest().chunks, store.manifest().world_hash) == (&sound.chunks, sound.world_hash);
        let tiles = if is_same { &[] } else { &index.chunks[..] };
        let lost = tiles.iter().filter(|chunk| store.load(chunk.id).is_err()).count();
        let backends =
            |slots| Ok(Box::new(CpuBackend::new(slots).expect("a small matrix")) as Box<dyn Backend>);
        let engine = Engine::new(index, earthshine_engine::EngineConfig::default(), Box::new(backends));
        if lost > 0 || engine.is_err() {
            refused_later += 1;
        } else {
            accepted += 1;
        }
    }
    // Names, lights and parameters may read differently; structure may not.
    assert!(refused > good.len() / 4 && refused_later > 0, "{refused} {refused_later} {accepted}");
}

/// Goal: a tile that cannot be read costs its own light only. Method: one is damaged; the rest settles, says what is
/// missing, and is no brighter than the whole world, dazzling sky and all.
#[tokio::test]
async fn a_damaged_tile_is_missing_light_and_nothing_else() {
    let world = corridor(16.0, 8);
    let solved = SolvedWorld::load(world.path());
    let whole = solved.solve(&solved.lights);
    let manifest = Manifest::load(world.path()).expect("a manifest");
    let victim = manifest.chunks.iter().max_by_key(|chunk| chunk.patch_count).expect("a chunk");
    let path = world.path().join(&victim.file);
    let mut bytes = std::fs::read(&path).expect("a tile");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(&path, bytes).expect("a scratch folder");
    let error = DirStore::open(world.path()).expect("a manifest").load(victim.id()).expect_err("damage");
    assert!(matches!(error, TileError::Checksum { .. }), "{error}");

    let served =
        ServedWorld::start(world.path(), world.patch_count(), |config| config.engine.retries_max = 0).await;
    let mut client = connect(&served.uri).await;
    let light = settled_at(&mut client, Vec3::new(8.0, 1.6, 1.5)).await;
    let patches = served_patches(&light);
    let chunk = |id: ChunkId| solved.chunks().iter().find(|chunk| chunk.id == id).expect("it was there");
    let lost = chunk(victim.id());
    let lost = (0..lost.patches.len()).filter(|&local| lost.is_told(local)).count();
    assert_eq!(patches.len(), solved.told().count() - lost);
    let alone = solved.solve_among(&solved.lights, &patches.keys().copied().collect());
    // Shadow casters of the lost tile are lost with it; this world has no delta lights that would tell.
    assert!(solved.lights.lights.is_empty());
    let least = assert_between(&solved, &whole, &alone, &patches);
    assert!(least < 0.95, "neighbours say what they miss: {least}");
    client.close().await;
    served.stop().await.expect("a clean end");
}
