//! Tiles that have come and wait to be taken: a tick takes as many as its budget of bytes allows.

use earthshine_light::Occluders;
use earthshine_world::lineage::Lineage;
use earthshine_world::{Chunk, ChunkId};
use std::collections::VecDeque;
use std::sync::Arc;

/// A decoded tile, not checked yet.
#[derive(Debug)]
pub(crate) struct Arrival {
    pub(crate) chunk: Arc<Chunk>,
    pub(crate) lineage: Arc<Lineage>,
    pub(crate) occluders: Arc<Occluders>,
}

/// Waiting tiles in the order in which they came, one a chunk: no more than tiles are in flight.
#[derive(Debug, Default)]
pub(crate) struct Intake {
    waiting: VecDeque<Arrival>,
}

impl Intake {
    /// Queues an awaited tile; `false` if its chunk's tile waits already.
    pub(crate) fn put(&mut self, arrival: Arrival) -> bool {
        let is_first = !self.holds(arrival.chunk.id);
        if is_first {
            self.waiting.push_back(arrival);
        }
        is_first
    }

    /// The tile whose turn it is.
    pub(crate) fn take(&mut self) -> Option<Arrival> {
        self.waiting.pop_front()
    }

    /// Nobody awaits the tile of `chunk` any more.
    pub(crate) fn forget(&mut self, chunk: ChunkId) {
        self.waiting.retain(|arrival| arrival.chunk.id != chunk);
    }

    pub(crate) fn holds(&self, chunk: ChunkId) -> bool {
        self.waiting.iter().any(|arrival| arrival.chunk.id == chunk)
    }

    pub(crate) fn ids(&self) -> impl Iterator<Item = ChunkId> {
        self.waiting.iter().map(|arrival| arrival.chunk.id)
    }
}
