//! The service as a whole: opened and bound first, then run until it is told to stop.
//!
//! Start at [`Server::bind`]; [`run`] does both for those who need no addresses.

use crate::ServerError;
use crate::admin::{self, Admin};
use crate::backends::Backends;
use crate::config::Config;
use crate::config::load::seconds;
use crate::device_source::CurrentDevice;
use crate::engine_thread::{EngineHandle, EngineThread, SharedReport};
use crate::listener::Listener;
use crate::loaded_engine::LoadedEngine;
use crate::metrics::Metrics;
use crate::observer::{Observer, TickLog};
use crate::promise;
use crate::session::Shared;
use crate::shutdown::Deadline;
use crate::solver_wish::SolverWish;
use crate::tile_loader::TileLoader;
use crate::tls;
use crate::world_watch::WorldWatch;
use earthshine_engine::{Engine, Promise};
use earthshine_tiles::{DirStore, Manifest, PatchBuilder, TileStore};
use earthshine_world::WorldIndex;
use std::io::ErrorKind;
use std::net::SocketAddr;
use std::path::Path;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tokio_rustls::TlsAcceptor;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;

/// Connections that stay open after their sessions ended get this long to close by themselves.
const TRANSPORT_GRACE: Duration = Duration::from_millis(500);

/// A world that is open and two addresses that are bound; nothing runs yet.
pub struct Server {
    config: Config,
    world: String,
    index: WorldIndex,
    manifest: Manifest,
    store: Arc<dyn TileStore>,
    engine: Engine,
    backends: Backends,
    report: Arc<SharedReport>,
    ticks: Arc<TickLog>,
    listener: TcpListener,
    tls: Option<TlsAcceptor>,
    admin: TcpListener,
    local_addr: SocketAddr,
    admin_addr: SocketAddr,
}

impl std::fmt::Debug for Server {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Server")
            .field("world", &self.world)
            .field("local_addr", &self.local_addr)
            .field("admin_addr", &self.admin_addr)
            .finish_non_exhaustive()
    }
}

/// Binds and serves until `shutdown` resolves, then drains.
///
/// # Errors
/// [`ServerError`]; its [`exit_code`](ServerError::exit_code) is for the process.
pub async fn run(config: Config, shutdown: impl Future<Output = ()>) -> Result<(), ServerError> {
    Server::bind(config).await?.run(shutdown).await
}

impl Server {
    /// Checks the configuration, opens the world and binds both addresses.
    ///
    /// # Errors
    /// [`ServerError::Config`], [`ServerError::Tls`], [`ServerError::World`], [`ServerError::ClusteredWorld`], [`ServerError::Index`],
    /// [`ServerError::AddressInUse`], [`ServerError::Bind`].
    pub async fn bind(config: Config) -> Result<Self, ServerError> {
        config.validate()?;
        let tls = config.tls.as_ref().map(tls::acceptor).transpose()?;
        let store = DirStore::open(&config.world).map_err(ServerError::World)?;
        if store.manifest().parameters.method.builder == PatchBuilder::Clustered {
            return Err(ServerError::ClusteredWorld { world: config.world });
        }
        let index = store.manifest().index();
        let backends = Backends::open(&config)?;
        let solving = backends.solving(&config.engine.solver);
        let engine =
            Engine::new(index.clone(), config.engine.clone(), solving).map_err(ServerError::Index)?;
        let engine = promise::promising(backends.lighting(engine), &config, &index, &store);
        let (listener, local_addr) = bind("listen", config.listen).await?;
        let (admin, admin_addr) = bind("admin_listen", config.admin_listen).await?;
        let world = world_name(&config.world);
        Ok(Self {
            config,
            world,
            index,
            manifest: store.manifest().clone(),
            store: Arc::new(store),
            engine,
            backends,
            report: Arc::default(),
            ticks: Arc::default(),
            listener,
            tls,
            admin,
            local_addr,
            admin_addr,
        })
    }

    /// The device that computes, now and after it was opened again.
    #[must_use]
    pub fn device(&self) -> CurrentDevice {
        self.backends.device()
    }

    /// Where clients connect.
    #[must_use]
    pub fn local_addr(&self) -> SocketAddr {
        self.local_addr
    }

    /// Where `/metrics`, `/health`, `/ready` and `/solver` answer.
    #[must_use]
    pub fn admin_addr(&self) -> SocketAddr {
        self.admin_addr
    }

    /// Name of the world, as clients see it: the name of its folder.
    #[must_use]
    pub fn world_name(&self) -> &str {
        &self.world
    }

    /// Sees every tick from now on.
    #[must_use]
    pub fn observer(&self) -> Observer {
        Observer::new(Arc::clone(self.engine.promise()), Arc::clone(&self.report), Arc::clone(&self.ticks))
    }

    /// What it promises: light of level 0 inside a radius, up to a speed.
    #[must_use]
    pub fn promise(&self) -> &Promise {
        self.engine.promise()
    }

    /// What is in the world as it was found at the start.
    #[must_use]
    pub fn world_index(&self) -> &WorldIndex {
        &self.index
    }

    /// Serves until `shutdown` resolves, then drains: sessions, loader, engine.
    ///
    /// # Errors
    /// [`ServerError::System`], [`ServerError::Engine`], [`ServerError::Transport`], [`ServerError::DrainTimeout`].
    pub async fn run(self, shutdown: impl Future<Output = ()>) -> Result<(), ServerError> {
        tracing::info!(
            world = self.world,
            tls = self.tls.is_some(),
            address = %self.local_addr,
            admin = %self.admin_addr,
            chunks = self.index.chunks.len(),
            "serving"
        );
        let mut running = self.start()?;
        let mut shutdown = pin!(shutdown);
        let outcome = tokio::select! {
            () = &mut shutdown => Ok(()),
            ended = &mut running.engine.ended => Err(engine_failure(ended.ok().flatten())),
            ended = &mut running.transport => match ended {
                Ok(Err(error)) => Err(error.into()),
                _ => Err(ServerError::Engine { cause: "the listener ended".to_owned() }),
            },
        };
        let drained = running.drain().await;
        // The first cause is the one to report.
        outcome.and(drained)
    }

    fn start(self) -> Result<Running, ServerError> {
        let config = self.config;
        let metrics = Arc::new(Metrics::of(self.backends.device()));
        let report = self.report;
        let (openings, opened) = mpsc::channel(config.engine.sessions_max as usize);
        let (answers, tiles) = std::sync::mpsc::sync_channel(config.tile_queue as usize);
        // The engine never has more requests open than it is configured for.
        let requests_max = config.engine.tiles_in_flight_max;
        let loader = TileLoader::start(&self.store, config.loader_threads, requests_max, &answers, &metrics)
            .map_err(|cause| ServerError::System { what: "a loader thread", cause })?;
        let (next, worlds) = mpsc::channel(1);
        let (served, index) = watch::channel(Arc::new(self.index));
        let watch = WorldWatch {
            config: config.clone(),
            known: self.manifest,
            backends: self.backends,
            next,
            metrics: Arc::clone(&metrics),
        };
        let solver = Arc::new(SolverWish::new(config.engine.solver.clone()));
        let thread = EngineThread {
            running: LoadedEngine::new(self.engine, tiles, Arc::clone(&loader.requests)),
            period: seconds(1.0 / config.tick_rate_hz),
            openings: opened,
            worlds,
            served,
            report: Arc::clone(&report),
            ticks: self.ticks,
            metrics: Arc::clone(&metrics),
            solver: Arc::clone(&solver),
        };
        let engine = thread.start().map_err(|cause| {
            loader.requests.stop();
            ServerError::System { what: "the engine's thread", cause }
        })?;

        let draining = Arc::new(AtomicBool::new(false));
        let [sessions_stop, transport_stop, admin_stop] = std::array::from_fn(|_| CancellationToken::new());
        drop(tokio::spawn(watch.run(sessions_stop.clone())));
        let admin = Admin::new(&config, &metrics, &report, &draining, solver);
        let admin = tokio::spawn(admin::serve(self.admin, admin, admin_stop.clone()));
        let limit = seconds(config.drain_timeout_s);
        let shared = Shared {
            config,
            world: self.world,
            index,
            openings,
            report,
            metrics,
            stop: sessions_stop.clone(),
        };
        let sessions = TaskTracker::new();
        let health = HealthReporter::new();
        let listener = Listener::new(Arc::new(shared), sessions.clone());
        let transport =
            tokio::spawn(listener.serve(self.listener, self.tls, health.clone(), transport_stop.clone()));
        Ok(Running {
            engine,
            loader,
            sessions,
            transport,
            admin,
            health,
            draining,
            sessions_stop,
            transport_stop,
            admin_stop,
            limit,
        })
    }
}

/// Everything that has to end.
struct Running {
    engine: EngineHandle,
    loader: TileLoader,
    sessions: TaskTracker,
    transport: JoinHandle<Result<(), tonic::transport::Error>>,
    admin: JoinHandle<std::io::Result<()>>,
    health: HealthReporter,
    draining: Arc<AtomicBool>,
    sessions_stop: CancellationToken,
    transport_stop: CancellationToken,
    admin_stop: CancellationToken,
    limit: Duration,
}

impl Running {
    async fn drain(self) -> Result<(), ServerError> {
        let deadline = Deadline::after(self.limit);
        self.draining.store(true, Ordering::Release);
        self.health.set_service_status("", ServingStatus::NotServing).await;
        self.transport_stop.cancel();
        self.sessions_stop.cancel();
        self.sessions.close();
        let sessions = deadline.wait("a session", self.sessions.wait()).await;
        // Goodbyes are on their way; whoever does not hang up is hung up on when the process ends.
        if !self.transport.is_finished() {
            drop(tokio::time::timeout(TRANSPORT_GRACE, self.transport).await);
        }

        self.loader.requests.stop();
        let mut loader = Ok(());
        for thread in self.loader.threads {
            // A thread may wait for room in the engine's queue: the engine runs until all have ended.
            loader = loader.and(deadline.join("a loader thread", thread).await.map(|_ended| ()));
        }
        self.engine.stop();
        let engine = deadline.join("the engine", self.engine.thread).await.map(|_ended| ());
        self.admin_stop.cancel();
        drop(tokio::time::timeout(TRANSPORT_GRACE, self.admin).await);
        let outcome = sessions.and(loader).and(engine);
        tracing::info!(in_time = outcome.is_ok(), "drained");
        outcome
    }
}

fn engine_failure(cause: Option<String>) -> ServerError {
    ServerError::Engine { cause: cause.unwrap_or_else(|| "its thread ended without a word".to_owned()) }
}

async fn bind(key: &'static str, address: SocketAddr) -> Result<(TcpListener, SocketAddr), ServerError> {
    let failed = |cause: std::io::Error| match cause.kind() {
        ErrorKind::AddrInUse => ServerError::AddressInUse { key, address },
        _ => ServerError::Bind { key, address, cause },
    };
    let listener = TcpListener::bind(address).await.map_err(failed)?;
    let bound = listener.local_addr().map_err(failed)?;
    Ok((listener, bound))
}

/// The folder's own name, whatever way it was given.
fn world_name(folder: &Path) -> String {
    let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    whole.file_name().map_or_else(|| "world".to_owned(), |name| name.to_string_lossy().into_owned())
}
