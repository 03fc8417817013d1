//! Parents of the patches that tiles lead to, looked up as tiles are read and shared between them.
//!
//! A row's columns may lie in chunks that are not in memory; the engine then asks for their coarse parents. They take two bytes a
//! patch and the reading of two tiles, so they are kept while there is room, and for as long as some tile in memory needs
//! them. What cannot be read is left out and said: a gap in far light.

use earthshine_tiles::TileStore;
use earthshine_world::lineage::{Lineage, Parents};
use earthshine_world::{Chunk, ChunkId};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes after which entries that no tile in memory needs are swept out: 32 million patches.
const KEPT_BYTES: usize = 64 << 20;

/// What is known, for all loader threads.
#[derive(Debug, Default)]
pub(crate) struct LineageCache {
    known: Mutex<Known>,
}

#[derive(Debug, Default)]
struct Known {
    parents: BTreeMap<ChunkId, Parents>,
    bytes: usize,
}

impl Known {
    fn insert(&mut self, id: ChunkId, parents: &Parents, bytes_max: usize) {
        if self.parents.insert(id, Arc::clone(parents)).is_none() {
            self.bytes += size_of_val(&**parents);
        }
        if self.bytes > bytes_max {
            self.parents.retain(|_, parents| Arc::strong_count(parents) > 1);
            self.bytes = self.parents.values().map(|parents| size_of_val(&**parents)).sum();
        }
    }
}

impl LineageCache {
    /// Memory of what is known, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.known.lock().unwrap_or_else(PoisonError::into_inner).bytes
    }

    /// The ancestors of every patch that the rows of `chunk` lead to, those of its receivers included.
    pub(crate) fn of(&self, store: &dyn TileStore, chunk: &Chunk) -> Arc<Lineage> {
        let mut lineage = Lineage::default();
        for &segment in chunk.rows.segments.iter().chain(&chunk.receivers.rows.segments) {
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
        let held = |known: &Known| known.parents.get(&id).cloned();
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
        known.insert(id, &read, KEPT_BYTES);
        Some(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::ChunkCoord;

    #[test]
    fn what_no_tile_needs_goes_when_there_is_no_room() {
        let mut known = Known::default();
        let id = |x: i32| ChunkId::new(0, ChunkCoord::new(x, 0, 0));
        let needed: Parents = vec![7u16; 100].into();
        known.insert(id(0), &needed, 1000);
        (1..5).for_each(|x| known.insert(id(x), &vec![0u16; 100].into(), 1000));
        assert_eq!((known.parents.len(), known.bytes), (5, 1000), "there is room");
        let newest: Parents = vec![0u16; 100].into();
        known.insert(id(5), &newest, 1000);
        assert_eq!(
            (known.parents.keys().copied().collect::<Vec<_>>(), known.bytes),
            (vec![id(0), id(5)], 400)
        );
    }
}
