//! An engine with the loader that it asks for tiles: how one tick is served, for the running engine and for one on its way in.
//!
//! Who the sessions are, and where frames go, is the caller's business.

use crate::tile_loader::TileRequests;
use earthshine_engine::{Command, Engine, Event, Frame, TickStats};
use earthshine_world::ChunkId;
use std::sync::Arc;
use std::sync::mpsc::Receiver;

/// Tiles taken in one tick; more wait in their queue.
const TILES_PER_TICK_MAX: usize = 64;

/// An engine, its questions and the answers.
pub(crate) struct LoadedEngine {
    /// The state machine.
    pub(crate) engine: Engine,
    /// Where its loader answers: decoded and failed tiles.
    tiles: Receiver<Event>,
    /// Where tiles are asked for.
    pub(crate) requests: Arc<TileRequests>,
    /// Requests that the loader had no room for, to be answered as failed.
    turned_away: Vec<ChunkId>,
    commands: Vec<Command>,
}

impl LoadedEngine {
    /// Nothing asked yet.
    pub(crate) fn new(engine: Engine, tiles: Receiver<Event>, requests: Arc<TileRequests>) -> Self {
        Self { engine, tiles, requests, turned_away: Vec::new(), commands: Vec::new() }
    }

    /// One tick with `events` and what the loader has answered; each frame goes to `publish`.
    pub(crate) fn tick(
        &mut self,
        time_s: f64,
        mut events: Vec<Event>,
        mut publish: impl FnMut(Arc<Frame>),
    ) -> TickStats {
        let turned_away = self.turned_away.drain(..);
        events.extend(
            turned_away
                .map(|chunk| Event::TileFailed { chunk, cause: "the loader's queue is full".to_owned() }),
        );
        // The queue's length bounds the work: what arrives meanwhile waits for the next tick.
        events.extend(self.tiles.try_iter().take(TILES_PER_TICK_MAX));
        let (engine, commands) = (&mut self.engine, &mut self.commands);
        // On one of the workers: a backend's many small parallel steps then start without a change of threads.
        let stats = rayon::scope(|_| engine.tick(time_s, events, commands));
        for command in self.commands.drain(..) {
            match command {
                Command::LoadTile { chunk } => {
                    if !self.requests.request(chunk) {
                        self.turned_away.push(chunk);
                    }
                }
                Command::CancelTile { chunk } => {
                    self.turned_away.retain(|&waiting| waiting != chunk);
                    self.requests.cancel(chunk);
                }
                Command::PublishFrame { frame } => publish(frame),
            }
        }
        stats
    }
}
