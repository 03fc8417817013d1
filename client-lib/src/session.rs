//! Opening a session, and the background task that receives.

use crate::{
    ClientError, Credentials, Light, assembly::Assembly, camera::vector_from_wire, credentials::Bearer,
    outbox::Outbox, statistics::Counters,
};
use earthshine_protocol::{
    DETAIL_LAYERS_MAX, MESSAGE_BYTES_MAX, PROTOCOL_MAX, PROTOCOL_MIN, TEXT_BYTES_MAX, VOLUMES_MAX,
    v1::{
        self, client_message::Message as ToServer, lighting_client::LightingClient,
        server_message::Message as FromServer,
    },
};
use glam::{UVec3, Vec3};
use std::{
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};
use tokio::sync::{mpsc, watch};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{
    Streaming,
    service::interceptor::InterceptedService,
    transport::{Channel, Endpoint},
};

/// How to connect, and what to ask for.
#[derive(Debug, Clone, PartialEq)]
pub struct ClientOptions {
    /// For the server's log: program and version.
    pub name: String,
    /// Which world; `None` for the server's only one.
    pub world: Option<String>,
    /// Token and trust.
    pub credentials: Credentials,
    /// Most voxels along each axis that a volume may have. Each voxel costs 4 bytes in each of two buffers.
    pub dims_max: UVec3,
    /// For the connection, and again for the server's first word.
    pub connect_timeout: Duration,
    /// A peer that does not answer pings for so long is gone.
    pub silence_timeout: Duration,
}

impl Default for ClientOptions {
    /// No token, 128 x 64 x 128 voxels, 5 s to connect, 10 s of silence.
    fn default() -> Self {
        Self {
            name: concat!("earthshine-client ", env!("CARGO_PKG_VERSION")).to_owned(),
            world: None,
            credentials: Credentials::default(),
            dims_max: UVec3::new(128, 64, 128),
            connect_timeout: Duration::from_secs(5),
            silence_timeout: Duration::from_secs(10),
        }
    }
}

/// What the server said in its welcome.
#[derive(Debug, Clone, PartialEq)]
pub struct Session {
    /// For logs on both sides.
    pub id: u64,
    /// Protocol version spoken.
    pub protocol: u32,
    /// Name of the world.
    pub world: String,
    /// Edge of a voxel of level 0, m.
    pub voxel_edge_m: f32,
    /// Box around all geometry, lower corner, m.
    pub bounds_min: Vec3,
    /// Box around all geometry, upper corner, m.
    pub bounds_max: Vec3,
    /// Program and version of the server.
    pub server_version: String,
    /// Cameras beyond this rate may be dropped, 1/s; 0 for no limit.
    pub camera_rate_max_hz: f32,
}

impl Session {
    fn from_wire(welcome: v1::Welcome) -> Result<Self, ClientError> {
        if !(PROTOCOL_MIN..=PROTOCOL_MAX).contains(&welcome.protocol) {
            return Err(ClientError::Version { cause: format!("the server chose {}", welcome.protocol) });
        }
        let edge = welcome.voxel_edge_m;
        if !(edge.is_finite() && edge > 0.0) {
            return Err(ClientError::protocol(format!("welcome: a voxel edge of {edge} m")));
        }
        Ok(Self {
            id: welcome.session,
            protocol: welcome.protocol,
            world: welcome.world,
            voxel_edge_m: edge,
            bounds_min: vector_from_wire(welcome.bounds_min, "welcome: the bounds' lower corner")?,
            bounds_max: vector_from_wire(welcome.bounds_max, "welcome: the bounds' upper corner")?,
            server_version: welcome.server_version,
            camera_rate_max_hz: welcome.camera_rate_max_hz,
        })
    }
}

/// What calls go through.
type Calls = LightingClient<InterceptedService<Channel, Bearer>>;

/// A gRPC client of `uri`, connected.
pub(crate) async fn open(uri: &str, options: &ClientOptions) -> Result<Calls, ClientError> {
    let ClientOptions { credentials, connect_timeout, silence_timeout, .. } = options;
    let (connect_timeout, silence_timeout) = (*connect_timeout, *silence_timeout);
    let bearer = credentials.bearer()?;
    let mut endpoint = Endpoint::from_shared(uri.to_owned())
        .map_err(|error| ClientError::unreachable(uri, &error))?
        .connect_timeout(connect_timeout)
        .http2_keep_alive_interval(silence_timeout / 2)
        .keep_alive_timeout(silence_timeout / 2)
        .keep_alive_while_idle(true)
        .http2_adaptive_window(true);
    if endpoint.uri().scheme_str() == Some("https") {
        endpoint =
            endpoint.tls_config(credentials.tls()).map_err(|error| ClientError::unreachable(uri, &error))?;
    }
    let connecting = tokio::time::timeout(connect_timeout, endpoint.connect()).await;
    let channel = connecting
        .map_err(|_elapsed| ClientError::Timeout { what: "connection", timeout: connect_timeout })?
        .map_err(|error| ClientError::unreachable(uri, &error))?;
    Ok(LightingClient::with_interceptor(channel, bearer).max_decoding_message_size(MESSAGE_BYTES_MAX))
}

/// Both directions of an open session.
pub(crate) struct Streams {
    pub(crate) to_server: mpsc::Sender<v1::ClientMessage>,
    pub(crate) from_server: Streaming<v1::ServerMessage>,
}

/// Says hello and waits for the welcome.
pub(crate) async fn greet(uri: &str, options: &ClientOptions) -> Result<(Session, Streams), ClientError> {
    let hello = hello(options)?;
    let client = open(uri, options).await?;
    let timeout = options.connect_timeout;
    tokio::time::timeout(timeout, exchange(client, hello))
        .await
        .map_err(|_elapsed| ClientError::Timeout { what: "welcome", timeout })?
}

async fn exchange(mut client: Calls, hello: v1::Hello) -> Result<(Session, Streams), ClientError> {
    let (to_server, outgoing) = mpsc::channel(4);
    let first = v1::ClientMessage { message: Some(ToServer::Hello(hello)) };
    to_server.send(first).await.map_err(|error| ClientError::lost(error.to_string()))?;
    let answer = client.session(ReceiverStream::new(outgoing)).await;
    let mut from_server = answer.map_err(|status| ClientError::from_status(&status))?.into_inner();
    let first = from_server.message().await.map_err(|status| ClientError::from_status(&status))?;
    match first.and_then(|first| first.message) {
        Some(FromServer::Welcome(welcome)) => {
            Ok((Session::from_wire(welcome)?, Streams { to_server, from_server }))
        }
        Some(FromServer::Error(error)) => Err(ClientError::from_wire(&error)),
        Some(other) => Err(ClientError::protocol(format!("{} before the welcome", name_of(&other)))),
        None => Err(ClientError::lost("the server hung up before its welcome")),
    }
}

fn hello(options: &ClientOptions) -> Result<v1::Hello, ClientError> {
    let world_length = options.world.as_ref().map_or(0, String::len);
    if options.name.len().max(world_length) > TEXT_BYTES_MAX {
        let cause = format!("a client or world name longer than {TEXT_BYTES_MAX} bytes");
        return Err(ClientError::Invalid { cause });
    }
    let UVec3 { x, y, z } = options.dims_max;
    Ok(v1::Hello {
        protocol_min: PROTOCOL_MIN,
        protocol_max: PROTOCOL_MAX,
        client_name: options.name.clone(),
        world: options.world.clone(),
        // Every level that there may be: the server sends those of its world.
        volumes: (0..VOLUMES_MAX as u32)
            .map(|level| v1::VolumeWanted { level, dims_max: Some(v1::Dims { x, y, z }) })
            .collect(),
        detail: true,
        detail_layers: DETAIL_LAYERS_MAX,
    })
}

fn name_of(message: &FromServer) -> &'static str {
    match message {
        FromServer::Welcome(_) => "a welcome",
        FromServer::Volume(_) => "a volume",
        FromServer::Delta(_) => "a delta",
        FromServer::Statistics(_) => "statistics",
        FromServer::Error(_) => "an error",
    }
}

/// What the caller's thread and the background tasks share.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    pub(crate) outbox: Outbox,
    counters: Mutex<Counters>,
    ended: Mutex<Option<ClientError>>,
}

impl Shared {
    pub(crate) fn counters(&self) -> MutexGuard<'_, Counters> {
        self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Why the session is over; `None` while it is not.
    pub(crate) fn ended(&self) -> Option<ClientError> {
        self.ended.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The first reason stays.
    pub(crate) fn end(&self, reason: ClientError) {
        self.ended.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(reason);
        self.outbox.close();
    }

    /// Receives until the stream ends, then leaves the reason behind. `front` goes with it: who waits is woken.
    pub(crate) async fn receive(
        &self,
        mut assembly: Assembly,
        mut from_server: Streaming<v1::ServerMessage>,
        front: watch::Sender<std::sync::Arc<Light>>,
    ) {
        let reason = loop {
            let received = match from_server.message().await {
                Ok(Some(message)) => self.handle(message, &mut assembly, &front),
                Ok(None) => Err(ClientError::lost("the server ended the stream")),
                Err(status) => Err(ClientError::from_status(&status)),
            };
            if let Err(reason) = received {
                break reason;
            }
        };
        tracing::debug!(%reason, "session ended");
        self.end(reason);
    }

    fn handle(
        &self,
        message: v1::ServerMessage,
        assembly: &mut Assembly,
        front: &watch::Sender<std::sync::Arc<Light>>,
    ) -> Result<(), ClientError> {
        self.counters().message(prost_len(&message));
        // A kind of message that came after this client was built.
        let Some(message) = message.message else { return Ok(()) };
        match message {
            FromServer::Volume(volume) => assembly.place(&volume),
            FromServer::Delta(delta) => {
                let (volume, sequence, complete) = (delta.volume, delta.camera_sequence, delta.complete);
                let is_whole = assembly.apply(delta)?;
                if complete {
                    self.outbox.acknowledge(volume, assembly.generation(volume));
                }
                if is_whole {
                    // Counted first: whoever is woken by the light finds its latency.
                    if assembly.is_finest(volume) {
                        self.counters().frame(sequence, Instant::now());
                    }
                    assembly.publish(front);
                }
                Ok(())
            }
            FromServer::Statistics(statistics) => {
                self.counters().server(&statistics);
                Ok(())
            }
            FromServer::Error(error) if error.fatal => Err(ClientError::from_wire(&error)),
            FromServer::Error(error) => {
                tracing::warn!(cause = %error.cause, code = ?error.code(), "the server complains");
                self.counters().statistics.warning = Some(error.cause);
                Ok(())
            }
            FromServer::Welcome(_) => Err(ClientError::protocol("a second welcome")),
        }
    }
}

fn prost_len(message: &v1::ServerMessage) -> usize {
    prost::Message::encoded_len(message)
}
