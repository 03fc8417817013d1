//! Finds that the world was baked again while it is served, and makes what will serve it.
//!
//! A task looks at the manifest every `world_poll_s`. Another state of the same world (the same parameters, so the
//! same grid) becomes an engine and a loader of its own, which [`crate::takeover`] brings in beside the running ones.
//! Anything else is refused with its reason, said and counted, and the world goes on being served as it was.

use crate::backends::Backends;
use crate::config::Config;
use crate::config::load::seconds;
use crate::loaded_engine::LoadedEngine;
use crate::metrics::Metrics;
use crate::promise::promising;
use crate::tile_loader::TileLoader;
use earthshine_engine::{Engine, EngineError};
use earthshine_tiles::{DirStore, Manifest, TileError, TileStore};
use earthshine_world::WorldIndex;
use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;
use tokio::sync::mpsc::Sender;
use tokio::sync::mpsc::error::TrySendError;
use tokio_util::sync::CancellationToken;

/// A new state of the world, ready to be taken over.
pub(crate) struct NextWorld {
    /// For this state, with nothing loaded, and its loader.
    pub(crate) loaded: LoadedEngine,
    /// What is in it.
    pub(crate) index: Arc<WorldIndex>,
}

/// Why a manifest is not taken.
#[derive(Debug, thiserror::Error)]
enum Refusal {
    #[error(transparent)]
    World(#[from] TileError),
    #[error(
        "it was baked with other parameters: its clients would need new volumes; restart the server to serve it"
    )]
    OtherParameters,
    #[error(transparent)]
    Index(#[from] EngineError),
    #[error("no loader thread: {0}")]
    System(#[from] std::io::Error),
}

/// Watches the folder of a world that is being served.
pub(crate) struct WorldWatch {
    pub(crate) config: Config,
    /// What is served, or about to be.
    pub(crate) known: Manifest,
    /// Those of the running engine.
    pub(crate) backends: Backends,
    /// To the engine's thread; has room for one.
    pub(crate) next: Sender<NextWorld>,
    pub(crate) metrics: Arc<Metrics>,
}

impl WorldWatch {
    /// Looks until `stop`.
    pub(crate) async fn run(mut self, stop: CancellationToken) {
        if self.config.world_poll_s <= 0.0 {
            return;
        }
        let path = self.config.world.join(Manifest::FILE_NAME);
        let mut ticker = tokio::time::interval(seconds(self.config.world_poll_s));
        ticker.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        // The manifest may have changed since it was read: the first look is a full one.
        let mut seen = None;
        loop {
            tokio::select! {
                () = stop.cancelled() => return,
                _ = ticker.tick() => {}
            }
            let now = stamp(&path).await;
            if now.is_none() || now == seen {
                continue;
            }
            let (watch, is_done) = match tokio::task::spawn_blocking(move || self.look()).await {
                Ok(looked) => looked,
                Err(error) => return tracing::error!(%error, "the world is no longer watched"),
            };
            self = watch;
            // A takeover is under way: this state is looked at again when there is room.
            seen = if is_done { now } else { None };
        }
    }

    /// Whether this state of the manifest needs no other look.
    fn look(mut self) -> (Self, bool) {
        // Nothing is made that there is no room for.
        let next = self.next.clone();
        let room = match next.try_reserve() {
            Ok(room) => room,
            Err(error) => return (self, matches!(error, TrySendError::Closed(()))),
        };
        match self.prepare() {
            Ok(None) => {}
            Ok(Some((manifest, next))) => {
                room.send(next);
                self.known = manifest;
            }
            Err(refusal) => {
                self.metrics.worlds_refused.inc();
                tracing::warn!(%refusal, world = %self.config.world.display(), "the world changed and is not taken");
            }
        }
        (self, true)
    }

    fn prepare(&self) -> Result<Option<(Manifest, NextWorld)>, Refusal> {
        let store = DirStore::open(&self.config.world)?;
        let manifest = store.manifest().clone();
        if manifest == self.known {
            return Ok(None);
        }
        if manifest.world_hash != self.known.world_hash || manifest.parameters != self.known.parameters {
            return Err(Refusal::OtherParameters);
        }
        let config = &self.config;
        let index = Arc::new(manifest.index());
        let backends = self.backends.solving(&config.engine.solver);
        let engine = Engine::new((*index).clone(), config.engine.clone(), backends)?;
        let engine = promising(self.backends.lighting(engine), config, &index, &store);
        let (answers, tiles) = std::sync::mpsc::sync_channel(config.tile_queue as usize);
        let store: Arc<dyn TileStore> = Arc::new(store);
        let requests_max = config.engine.tiles_in_flight_max;
        // Its threads end when its requests are stopped.
        let loader = TileLoader::start(&store, config.loader_threads, requests_max, &answers, &self.metrics)?;
        Ok(Some((manifest, NextWorld { loaded: LoadedEngine::new(engine, tiles, loader.requests), index })))
    }
}

/// Changes whenever the manifest is replaced.
async fn stamp(path: &Path) -> Option<(SystemTime, u64)> {
    let file = tokio::fs::metadata(path).await.ok()?;
    Some((file.modified().ok()?, file.len()))
}
