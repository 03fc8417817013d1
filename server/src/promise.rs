//! Computes what the service promises, from its configuration, the manifest, and the patches at the world's most
//! crowded places.
//!
//! The formula is the engine's ([`earthshine_engine::promise`]); here is what it takes from disk.

use crate::config::Config;
use earthshine_engine::{Crowding, Engine, Means, Prospect};
use earthshine_tiles::{DirStore, TileError};
use earthshine_world::{ChunkCoord, ChunkId, ChunkSummary, Patch, Vec3, WorldIndex};
use std::collections::BTreeMap;

/// Chunks around which the world is looked at: those with the most patches.
const CROWDED_CHUNKS: usize = 8;
/// Places looked from in each of them.
const PLACES_PER_CHUNK: usize = 48;

/// Has `engine` keep what is promised for the world of `store`, as long as ticks come at the configured rate. A tile that cannot
/// be read here costs a better guess, nothing else.
pub(crate) fn promising(engine: Engine, config: &Config, index: &WorldIndex, store: &DirStore) -> Engine {
    let means = Means {
        tick_rate_hz: config.tick_rate_hz as f32,
        tile_bytes_per_s: (config.tile_rate_mb_s * 1e6) as f32,
    };
    engine.with_promise(Prospect::of(index, &config.engine, &crowding(index, store)), means)
}

/// Of each level, finest first.
fn crowding(index: &WorldIndex, store: &DirStore) -> Vec<Crowding> {
    (0..index.level_count()).map(|level| crowding_of(level, index, store)).collect()
}

fn crowding_of(level: u8, index: &WorldIndex, store: &DirStore) -> Crowding {
    let mut crowding = Crowding::new(index.grid.at_level(level).voxel_edge_m);
    let mut known: BTreeMap<ChunkId, Vec<Vec3>> = BTreeMap::new();
    let mut chunks: Vec<&ChunkSummary> =
        index.chunks.iter().filter(|chunk| chunk.id.level == level).collect();
    chunks.sort_by_key(|chunk| std::cmp::Reverse((chunk.patch_count, chunk.id)));
    for crowded in chunks.into_iter().take(CROWDED_CHUNKS) {
        let mut patches = Vec::new();
        for id in with_neighbours(crowded.id) {
            let found = known.entry(id).or_insert_with(|| centroids(store, id));
            patches.extend_from_slice(found);
        }
        let own = &known[&crowded.id];
        let step = own.len().div_ceil(PLACES_PER_CHUNK).max(1);
        let places: Vec<Vec3> = own.iter().step_by(step).copied().collect();
        crowding.look(&places, &patches);
    }
    crowding
}

fn with_neighbours(id: ChunkId) -> impl Iterator<Item = ChunkId> {
    let around = |x: i32| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| ChunkCoord::new(x, y, z)));
    (-1..=1).flat_map(around).map(move |step| ChunkId::new(id.level, id.coord + step))
}

/// Where the patches of chunk `id` are; nowhere if there is no such chunk or its tile cannot be read.
fn centroids(store: &DirStore, id: ChunkId) -> Vec<Vec3> {
    let read = store.map(id).and_then(|tile| tile.decode_patches());
    match read {
        Ok(patches) => patches.iter().map(|patch: &Patch| patch.centroid).collect(),
        Err(TileError::UnknownChunk { .. }) => Vec::new(),
        Err(error) => {
            tracing::warn!(chunk = %id, %error, "left out of the promise");
            Vec::new()
        }
    }
}
