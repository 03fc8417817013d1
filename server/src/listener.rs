//! The gRPC side: who may open a session, and the services beside it (health, reflection).
//!
//! Refusals before a session exists are told in the session's own words, as an `Error` message and the end of the
//! stream, so that a client has one place to look. Start at [`Listener::serve`].

use crate::config::load::seconds;
use crate::connection::{Connection, ConnectionLimits, accept};
use crate::convert::{ErrorCode, Refusal, check_world, reply};
use crate::session::{self, OUTBOUND_MAX, Shared};
use earthshine_engine::SessionId;
use earthshine_protocol::FILE_DESCRIPTOR_SET;
use earthshine_protocol::v1::lighting_server::{Lighting, LightingServer};
use earthshine_protocol::v1::{ClientMessage, ServerMessage, WorldInfo, WorldRequest};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::net::TcpListener;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio_rustls::TlsAcceptor;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tonic::metadata::MetadataMap;
use tonic::{Request, Response, Status, Streaming};
use tonic_health::server::HealthReporter;

/// Streams of one connection: a session, and a few questions beside it.
const STREAMS_PER_CONNECTION_MAX: u32 = 16;
/// Request headers, bytes: a token and what gRPC itself needs.
const HEADER_BYTES_MAX: u32 = 16 << 10;

/// What answers gRPC calls.
#[derive(Debug, Clone)]
pub(crate) struct Listener {
    shared: Arc<Shared>,
    places: Arc<Semaphore>,
    sessions_opened: Arc<AtomicU64>,
    tasks: TaskTracker,
}

impl Listener {
    /// Sessions run as tasks of `tasks`.
    pub(crate) fn new(shared: Arc<Shared>, tasks: TaskTracker) -> Self {
        let places = Arc::new(Semaphore::new(shared.config.engine.sessions_max as usize));
        Self { shared, places, sessions_opened: Arc::default(), tasks }
    }

    /// Serves until `stop`, then until the connections are closed.
    pub(crate) async fn serve(
        self,
        listener: TcpListener,
        tls: Option<TlsAcceptor>,
        health: HealthReporter,
        stop: CancellationToken,
    ) -> Result<(), tonic::transport::Error> {
        let config = &self.shared.config;
        let limits = ConnectionLimits {
            connections_max: config.connections_max,
            greeting: seconds(config.hello_timeout_s),
        };
        let connections = accept(listener, tls, limits, Arc::clone(&self.shared.metrics), stop.clone());
        let connections: ReceiverStream<std::io::Result<Connection>> = ReceiverStream::new(connections);
        let health_service = tonic_health::pb::health_server::HealthServer::new(
            tonic_health::server::HealthService::from_health_reporter(health.clone()),
        );
        let reflection = tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(FILE_DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
            .build_v1()
            .expect("the descriptor sets are compiled in");
        health.set_serving::<LightingServer<Self>>().await;
        let builder = tonic::transport::Server::builder()
            .accept_http1(false)
            .http2_keepalive_interval(Some(seconds(config.keepalive_interval_s)))
            .http2_keepalive_timeout(Some(seconds(config.keepalive_timeout_s)))
            .http2_max_header_list_size(HEADER_BYTES_MAX)
            .max_concurrent_streams(STREAMS_PER_CONNECTION_MAX);
        let message_bytes_max = config.message_bytes_max as usize;
        let lighting = LightingServer::new(self).max_decoding_message_size(message_bytes_max);
        let mut builder = builder;
        builder
            .add_service(lighting)
            .add_service(health_service)
            .add_service(reflection)
            .serve_with_incoming_shutdown(connections, stop.cancelled_owned())
            .await
    }

    fn admit(&self, metadata: &MetadataMap) -> Result<OwnedSemaphorePermit, Refusal> {
        let config = &self.shared.config;
        if self.shared.stop.is_cancelled() {
            return Err(Refusal::new(ErrorCode::Draining, "the server shuts down"));
        }
        if !is_authorised(metadata, &config.bearer_token.0) {
            let cause = "the token is missing or wrong: send `authorization: Bearer TOKEN`";
            return Err(Refusal::new(ErrorCode::Unauthorised, cause));
        }
        Arc::clone(&self.places).try_acquire_owned().map_err(|_full| {
            let cause =
                format!("all {} sessions are taken (`engine.sessions_max`)", config.engine.sessions_max);
            Refusal::new(ErrorCode::Busy, cause)
        })
    }
}

/// Whether `metadata` holds `token`; always if there is none.
fn is_authorised(metadata: &MetadataMap, token: &str) -> bool {
    is_bearer(metadata.get("authorization").map_or(&[][..], |value| value.as_bytes()), token)
}

/// Whether `given`, the value of an `authorization` header, holds `token`; always if there is none.
pub(crate) fn is_bearer(given: &[u8], token: &str) -> bool {
    let given = given.strip_prefix(b"Bearer ").unwrap_or_default();
    // The time does not tell how many bytes were right.
    let differing = given.iter().zip(token.as_bytes()).fold(0, |all, (a, b)| all | (a ^ b));
    token.is_empty() || (given.len() == token.len() && differing == 0)
}

#[tonic::async_trait]
impl Lighting for Listener {
    type SessionStream = ReceiverStream<Result<ServerMessage, Status>>;

    async fn session(
        &self,
        request: Request<Streaming<ClientMessage>>,
    ) -> Result<Response<Self::SessionStream>, Status> {
        let (outbound, replies) = mpsc::channel(OUTBOUND_MAX);
        match self.admit(request.metadata()) {
            Err(refusal) => {
                tracing::warn!(peer = ?request.remote_addr(), cause = refusal.cause, "refused");
                self.shared.metrics.sessions_failed.inc();
                // The queue is new: there is room.
                drop(outbound.try_send(Ok(reply::error(&refusal, true))));
            }
            Ok(place) => {
                let number = self.sessions_opened.fetch_add(1, Ordering::Relaxed) + 1;
                let shared = Arc::clone(&self.shared);
                self.tasks.spawn(async move {
                    shared.metrics.sessions.inc();
                    let metrics = Arc::clone(&shared.metrics);
                    session::run(shared, SessionId(number), request.into_inner(), outbound).await;
                    metrics.sessions.dec();
                    // After everything of the session is gone, so that the engine never sees one too many.
                    drop(place);
                });
            }
        }
        Ok(Response::new(ReceiverStream::new(replies)))
    }

    async fn world(&self, request: Request<WorldRequest>) -> Result<Response<WorldInfo>, Status> {
        if !is_authorised(request.metadata(), &self.shared.config.bearer_token.0) {
            return Err(Status::unauthenticated("the token is missing or wrong"));
        }
        check_world(request.get_ref().world.as_deref(), &self.shared.world)
            .map_err(|refusal| Status::not_found(refusal.cause))?;
        Ok(Response::new(reply::world_info(&self.shared.world, &self.shared.index.borrow())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_right_token_opens() {
        let with = |value: &'static str| {
            let mut metadata = MetadataMap::new();
            metadata.insert("authorization", value.parse().unwrap());
            metadata
        };
        assert!(is_authorised(&MetadataMap::new(), ""));
        assert!(is_authorised(&with("Bearer sesame"), "sesame"));
        for wrong in ["Bearer sesam", "Bearer sesamee", "Bearer sesamo", "sesame", "Bearer "] {
            assert!(!is_authorised(&with(wrong), "sesame"), "{wrong}");
        }
        assert!(!is_authorised(&MetadataMap::new(), "sesame"));
    }
}
