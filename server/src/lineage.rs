//! Parents of the patches that tiles lead to, looked up as tiles are read and shared between them.
//!
//! A row's columns may lie in chunks that are not in memory; the engine then asks for their coarse parents. They are
//! kept for as long as some tile in memory needs them. What cannot be read is left out and said: a gap in far light.

use earthshine_tiles::TileStore;
use earthshine_world::lineage::{Lineage, Parents};
use earthshine_world::{Chunk, ChunkId};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// Entries after which those that nobody needs any more are swept out.
const SWEEP_EVERY: usize = 1024;

/// What is known, for all loader threads.
#[derive(Debug, Default)]
pub(crate) struct LineageCache {
    known: Mutex<Known>,
}

#[derive(Debug, Default)]
struct Known {
    parents: BTreeMap<ChunkId, Weak<[u16]>>,
    sweep_at: usize,
}

impl LineageCache {
    /// The ancestors of every patch that the rows of `chunk` lead to.
    pub(crate) fn of(&self, store: &dyn TileStore, chunk: &Chunk) -> Arc<Lineage> {
        let mut lineage = Lineage::default();
        for &segment in &chunk.rows.segments {
            let mut id = segment;
            while lineage.of(id).is_none()
                && let Some(parents) = self.parents(store, id)
            {
                lineage.insert(id, parents);
                id = id.parent();
            }
        }
        Arc::new(lineage)
    }

    fn parents(&self, store: &dyn TileStore, id: ChunkId) -> Option<Parents> {
        let held = |known: &Known| known.parents.get(&id).and_then(Weak::upgrade);
        let found = held(&self.known.lock().unwrap_or_else(PoisonError::into_inner));
        if found.is_some() {
            return found;
        }
        // Not under the lock: two threads may read the same tile, and one of them in vain.
        let read = match store.parents(id) {
            Ok(read) => read?,
            Err(error) => {
                tracing::warn!(chunk = %id, %error, "no parents: far light from there is missing");
                return None;
            }
        };
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        known.parents.insert(id, Arc::downgrade(&read));
        if known.parents.len() > known.sweep_at {
            known.parents.retain(|_, parents| parents.strong_count() > 0);
            known.sweep_at = known.parents.len() + SWEEP_EVERY;
        }
        Some(read)
    }
}
