//! The service: a tokio shell around the engine.
//!
//! ```text
//! sessions (tokio) ── newest camera, lights ──▶ ┌───────────────┐ ── tiles wanted ──▶ loader threads
//!                                               │ engine thread │ ◀── decoded ──────  (map, verify, decode)
//! sessions ◀── newest frame (watch) ─────────── │ Engine+Backend│
//!    │                                          └───────────────┘
//!    └── delta since what the client holds ──▶ gRPC
//! ```
//!
//! Nothing waits for a slower neighbour but the loader: full queues drop cameras and frames (the newest wins) and
//! delay tiles. There is no light here, no rows and no bytes on disk; those are the packages below. What a client
//! says is checked in `convert`, what it is sent is decided in `publish`.
//!
//! Start at [`Server`]; settings are in [`Config`], ends of the process in [`ServerError`].
//!
//! ```no_run
//! # async fn serve() -> Result<(), earthshine_server::ServerError> {
//! use earthshine_server::{Config, Server, shutdown};
//!
//! let server = Server::bind(Config { world: "town".into(), ..Config::default() }).await?;
//! let address = server.local_addr();
//! server.run(shutdown::signal()?).await
//! # }
//! ```

mod admin;
mod backends;
pub mod config;
mod connection;
mod convert;
mod device_light;
mod device_metrics;
mod device_receivers;
mod device_source;
mod engine_thread;
mod error;
mod flow;
mod lineage;
mod listener;
mod loaded_engine;
mod metrics;
mod observer;
mod on_device;
mod pace;
mod pipeline_file;
mod promise;
mod publish;
mod server;
mod session;
pub mod shutdown;
mod solver_wish;
mod streams;
mod takeover;
mod tile_loader;
mod tls;
mod world_watch;

pub use config::{BackendKind, Config, ConfigError, ServeArgs};
pub use device_source::{CurrentDevice, DeviceCounts};
pub use earthshine_engine::{EngineMemory, EngineStats, Promise, ViolationCauses};
pub use error::ServerError;
pub use observer::{Observer, ServerMemory, TickSample};
pub use server::{Server, run};
