//! What every [`TileStore`] promises of a sound world, whatever is behind it.

use earthshine_tiles::{Manifest, TileError, TileStore, check_rows, check_targets};
use earthshine_world::{Chunk, ChunkCoord, ChunkId};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Runs the suite against `store`, which holds the world that `manifest` describes.
///
/// # Panics
/// At the first promise that is broken.
pub fn store_conformance<S: TileStore + 'static>(store: S, manifest: &Manifest) {
    assert!(manifest.chunks.len() >= 2, "a world of one chunk tests too little");
    let chunks = every_chunk_is_what_the_manifest_says(&store, manifest);
    loads_repeat_in_any_order(&store, &chunks);
    unknown_chunks_are_named_and_not_tried_again(&store, manifest);
    // After refusals, through pointers, and from threads it is the same store.
    let boxed: Box<dyn TileStore> = Box::new(store);
    loads_repeat_in_any_order(&boxed, &chunks);
    threads_load_the_same(&Arc::new(boxed), &chunks);
}

fn every_chunk_is_what_the_manifest_says(
    store: &dyn TileStore,
    manifest: &Manifest,
) -> BTreeMap<ChunkId, Chunk> {
    let index = manifest.index();
    let mut chunks = BTreeMap::new();
    for entry in &manifest.chunks {
        let chunk = store.load(entry.id()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(chunk.id, entry.id());
        assert_eq!(chunk.patches.len(), entry.patch_count as usize, "{}", chunk.id);
        assert_eq!(chunk.rows.columns.len() as u64, entry.nonzero_count, "{}", chunk.id);
        assert_eq!(check_rows(&chunk), [], "{}", chunk.id);
        assert_eq!(check_targets(&chunk.rows, &index), [], "{}", chunk.id);
        for patch in &chunk.patches {
            assert_eq!(manifest.parameters.grid.chunk_of(patch.voxel), chunk.id.coord);
            assert!(!chunk.points_of(patch).is_empty(), "a patch without points in {}", chunk.id);
        }
        chunks.insert(chunk.id, chunk);
    }
    chunks
}

fn loads_repeat_in_any_order(store: &dyn TileStore, chunks: &BTreeMap<ChunkId, Chunk>) {
    for (id, chunk) in chunks.iter().rev() {
        assert!(store.load(*id).expect("as before") == *chunk, "{id} changed");
    }
}

fn unknown_chunks_are_named_and_not_tried_again(store: &dyn TileStore, manifest: &Manifest) {
    for id in [ChunkId::new(0, ChunkCoord::splat(i32::MAX)), ChunkId::new(15, manifest.chunks[0].id().coord)]
    {
        let error = store.load(id).expect_err("no such chunk");
        assert!(matches!(error, TileError::UnknownChunk { chunk, .. } if chunk == id), "{error}");
        assert!(!error.is_transient(), "{error}");
        assert!(error.to_string().contains(&id.to_string()), "{error}");
    }
}

fn threads_load_the_same(store: &Arc<Box<dyn TileStore>>, chunks: &BTreeMap<ChunkId, Chunk>) {
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let store: Arc<Box<dyn TileStore>> = Arc::clone(store);
                loads_repeat_in_any_order(&store, chunks);
            });
        }
    });
}
