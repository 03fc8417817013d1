//! Every setting of the service: unit, the default's reason, and what is lost in either direction.
//!
//! It is not where settings are read from: [`load`] reads files, [`arguments`] overlays flags and
//! the environment. `config/default.toml` is this struct as a file; a test holds the two equal.
//! Start at [`Config`].

pub mod arguments;
pub mod load;

use earthshine_engine::EngineConfig;
use serde::{Deserialize, Serialize};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;

pub use arguments::ServeArgs;
pub use load::ConfigError;

/// All settings. Flags go before the environment, the environment before the file, the file before defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Folder of the baked world, relative to the working directory.
    pub world: PathBuf,

    /// Where clients connect (gRPC over HTTP/2). Port 0 takes a free one.
    ///
    /// Loopback by default: the service is a sidecar and its wire is not encrypted. Bind a wider
    /// address only with [`tls`](Self::tls) and [`bearer_token`](Self::bearer_token).
    pub listen: SocketAddr,

    /// Where `/metrics`, `/health`, `/ready` and `/solver` answer (HTTP/1.1). Port 0 takes a free one. Whoever reaches it may
    /// change solvers, with [`bearer_token`](Self::bearer_token) if there is one.
    pub admin_listen: SocketAddr,

    /// Who computes.
    pub backend: BackendKind,

    /// Part of the name of the graphics adapter to compute on; empty for the best there is. `earthshine gpu` lists
    /// them. A software adapter is taken only when it is named.
    pub gpu_adapter: String,

    /// Whether an adapter with less room than is configured is refused, instead of taking what fits.
    pub gpu_strict: bool,

    /// Whether kernels use the adapter's subgroups where these are as they need them; the same bits without.
    pub gpu_subgroups: bool,

    /// File that keeps compiled kernels from one start to the next; empty for none. Only who runs the server may be able to
    /// write it, and each adapter needs one of its own. Most drivers keep kernels themselves: `earthshine gpu` measures
    /// what this adds.
    pub gpu_pipeline_cache: PathBuf,

    /// TCP connections at once, health checks included. Further ones wait in the listen backlog.
    /// - Higher: more file descriptors in the hands of peers that never say hello.
    /// - Lower: a burst of health checks can keep a client waiting.
    pub connections_max: u32,

    /// Largest message a client may send, bytes. A rig of a thousand lamps takes about 60 KiB.
    /// - Higher: more memory in the hands of a hostile peer, once a session.
    /// - Lower: large light rigs are refused.
    pub message_bytes_max: u32,

    /// A client's hello must have come by then, s; as must a connection's first bytes.
    /// - Higher: silent peers hold their place longer.
    /// - Lower: clients on slow links are cut off.
    pub hello_timeout_s: f64,

    /// A session that has said nothing for this long is closed, s. Acks count as something said.
    /// - Higher: a hung client keeps its matrix longer.
    /// - Lower: a paused game must reconnect.
    pub idle_timeout_s: f64,

    /// How often a quiet connection is asked for a sign of life (HTTP/2 ping), s.
    /// - Higher: half-open connections are found later.
    /// - Lower: more packets on idle connections.
    pub keepalive_interval_s: f64,

    /// How long that sign of life may take, s. With the interval it bounds the age of a half-open connection.
    /// - Higher: tolerates longer network stalls.
    /// - Lower: frees places sooner, cuts off stalled clients.
    pub keepalive_timeout_s: f64,

    /// Cameras of one session that reach the engine in a second. Of those beyond it the newest waits, the rest is dropped.
    /// - Higher: more events a tick; above the tick rate nothing is gained.
    /// - Lower: light follows the camera later.
    pub camera_rate_max_hz: f64,

    /// Ticks of the engine in a second. 60 matches the frame rate of most clients.
    /// - Higher: fresher light, more processor time.
    /// - Lower: less processor time; light lags by up to a tick.
    pub tick_rate_hz: f64,

    /// Threads that read, verify and decode tiles.
    /// - Higher: faster teleports on fast disks; competes with the engine for cores.
    /// - Lower: light arrives later after a teleport.
    pub loader_threads: u32,

    /// Tiles that the promise counts on to be read, checked and decoded in a second, MB on disk. It limits nothing.
    /// - Higher: more is promised; on slower disks and processors the promise is broken, and that is counted.
    /// - Lower: less is promised.
    pub tile_rate_mb_s: f64,

    /// Decoded tiles that may wait for the engine; loader threads wait while it is full.
    /// - Higher: more memory (a tile is some MiB decoded), smoother bursts.
    /// - Lower: loader threads idle while the engine is busy.
    pub tile_queue: u32,

    /// Largest volume a session may have, voxels on x, y, z. A hello may ask for less.
    /// - Higher: light farther from the camera, larger first delta.
    /// - Lower: less memory in clients; resident light outside the volume is not sent.
    pub volume_dims_max: [u32; 3],

    /// Volumes move in steps of this many voxels, so that a camera that trembles does not move them.
    /// - Higher: rarer whole resends, camera farther off the volume's centre.
    /// - Lower: better centred, more whole resends.
    pub volume_snap_voxels: u32,

    /// Deltas on their way to a client that it has not acknowledged.
    /// - Higher: full rate over links with long round trips.
    /// - Lower: less stale light in flight to a slow client.
    pub deltas_in_flight_max: u32,

    /// Seconds between two statistics messages to a client.
    /// - Higher: fewer small messages.
    /// - Lower: client overlays move more often.
    pub statistics_interval_s: f64,

    /// How long sessions, loader and engine together may take to end after a signal, s. Kubernetes
    /// kills after 30 s by default, systemd after 90.
    /// - Higher: slow clients get their goodbye.
    /// - Lower: faster restarts.
    pub drain_timeout_s: f64,

    /// s between two looks at the world's manifest; 0 for none. A world that was baked again with the same parameters is
    /// taken over under its sessions, which takes a second engine's memory for a moment; any other is refused.
    pub world_poll_s: f64,

    /// Token that clients must send as `authorization: Bearer ...`; empty for none.
    pub bearer_token: Secret,

    /// Certificate and key of the gRPC port; without them it speaks plain HTTP/2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tls: Option<TlsFiles>,

    /// The engine's own budgets, the number of sessions and of tiles on their way among them.
    pub engine: EngineConfig,
}

/// Who computes the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum BackendKind {
    /// Native code on all cores.
    Cpu,
    /// A graphics adapter; refused at start where there is none.
    Gpu,
    /// A graphics adapter where there is one, else the CPU, which is said once.
    Auto,
}

/// PEM files for TLS.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TlsFiles {
    /// Certificate chain, the server's own first.
    pub cert: PathBuf,
    /// Private key.
    pub key: PathBuf,
}

/// A string that never shows in logs.
#[derive(Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Secret(pub String);

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if self.0.is_empty() { "none" } else { "(hidden)" })
    }
}

impl Default for Config {
    fn default() -> Self {
        let loopback = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        Self {
            world: PathBuf::from("world"),
            listen: loopback(7461),
            admin_listen: loopback(7462),
            backend: BackendKind::Cpu,
            gpu_adapter: String::new(),
            gpu_strict: false,
            gpu_subgroups: true,
            gpu_pipeline_cache: PathBuf::new(),
            connections_max: 64,
            message_bytes_max: earthshine_protocol::CLIENT_MESSAGE_BYTES_MAX as u32,
            hello_timeout_s: 5.0,
            idle_timeout_s: 60.0,
            keepalive_interval_s: 10.0,
            keepalive_timeout_s: 5.0,
            camera_rate_max_hz: 120.0,
            tick_rate_hz: 60.0,
            loader_threads: 2,
            tile_rate_mb_s: 20.0,
            tile_queue: 8,
            volume_dims_max: [128, 64, 128],
            volume_snap_voxels: 8,
            deltas_in_flight_max: 2,
            statistics_interval_s: 1.0,
            drain_timeout_s: 5.0,
            world_poll_s: 2.0,
            bearer_token: Secret::default(),
            tls: None,
            engine: EngineConfig::default(),
        }
    }
}
