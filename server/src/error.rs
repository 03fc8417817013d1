//! What can stop the service, and the exit code that says so to scripts and supervisors.
//!
//! | code | meaning | worth a restart |
//! |---|---|---|
//! | 4 | the world is missing, damaged, or baked for the offline solve alone | no, bake or fetch it |
//! | 5 | configuration, certificate files among it | no, mend it |
//! | 6 | an address cannot be bound | after the other process ends |
//! | 10 | the engine, the transport or the system failed | yes |
//! | 11 | the drain took longer than `drain_timeout_s` | no: it was asked to stop |
//!
//! What goes wrong in one session ends that session only and is no [`ServerError`].

use crate::config::ConfigError;
use earthshine_tiles::TileError;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// What can stop the service.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// A setting is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A certificate or its key cannot be used.
    #[error("`{key}`: {file:?}: {cause}")]
    Tls {
        /// Which key of the configuration.
        key: &'static str,
        /// What it says.
        file: PathBuf,
        /// What is wrong with it.
        cause: String,
    },
    /// The device that `backend = "gpu"` asks for cannot be had.
    #[error("`backend`: {0}")]
    Gpu(earthshine_gpu::GpuError),
    /// The device's limits are below the matrix that is configured, and `gpu_strict` is set.
    #[error(
        "`engine.resident_patches_max`: {wanted} patches, but {adapter} allows {most}; ask for fewer, or unset `gpu_strict` to take what fits"
    )]
    GpuSlots {
        /// Its name.
        adapter: String,
        /// Slots that are configured.
        wanted: u32,
        /// Slots that its limits allow.
        most: u32,
    },
    /// The world cannot be opened; the cause names the file.
    #[error(transparent)]
    World(TileError),
    /// The world's patches cannot be served.
    #[error(
        "{world:?} was baked with --builder clustered: several of its patches may share a voxel and a direction, which a served volume has one place for. Bake it with --builder axis to serve it; `render`, `compare` and `bench accuracy` take it as it is"
    )]
    ClusteredWorld {
        /// Its folder.
        world: PathBuf,
    },
    /// The world's index contradicts itself.
    #[error(transparent)]
    Index(earthshine_engine::EngineError),
    /// Somebody else listens there.
    #[error(
        "{address} is in use: stop the other process, or set `{key}` to another port (0 takes a free one)"
    )]
    AddressInUse {
        /// Which key of the configuration.
        key: &'static str,
        /// What it says.
        address: SocketAddr,
    },
    /// The address cannot be bound for another reason.
    #[error("cannot listen on {address} (`{key}`): {cause}")]
    Bind {
        /// Which key of the configuration.
        key: &'static str,
        /// What it says.
        address: SocketAddr,
        /// What the system said.
        cause: std::io::Error,
    },
    /// A thread or a signal handler was refused by the system.
    #[error("the system refused {what}: {cause}")]
    System {
        /// What was asked for.
        what: &'static str,
        /// What the system said.
        cause: std::io::Error,
    },
    /// The engine's thread ended by itself: a broken invariant, or a backend that failed.
    #[error("the engine stopped: {cause}. Restart the service; report this if it comes again")]
    Engine {
        /// What the thread said last.
        cause: String,
    },
    /// The transport failed as a whole.
    #[error("the gRPC transport failed")]
    Transport(#[from] tonic::transport::Error),
    /// The service was asked to stop and did not within its time.
    #[error("{stage} did not end within {limit:?}; raise `drain_timeout_s` if that was needed")]
    DrainTimeout {
        /// What was still running.
        stage: &'static str,
        /// `drain_timeout_s`.
        limit: Duration,
    },
}

impl ServerError {
    /// The process's exit code; see the table at the top of this module.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::World(_) | Self::ClusteredWorld { .. } | Self::Index(_) => 4,
            Self::Config(_) | Self::Tls { .. } | Self::Gpu(_) | Self::GpuSlots { .. } => 5,
            Self::AddressInUse { .. } | Self::Bind { .. } => 6,
            Self::System { .. } | Self::Engine { .. } | Self::Transport(_) => 10,
            Self::DrainTimeout { .. } => 11,
        }
    }
}
