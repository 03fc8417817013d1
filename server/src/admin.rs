//! The operators' port: `/metrics` for Prometheus, `/health` (restart me if not), `/ready` (send clients), and `/solver`,
//! which says how light is solved and changes it (as `earthshine solver` does):
//!
//! ```sh
//! curl http://127.0.0.1:7462/solver
//! curl -X PUT --data 'by_level = ["hybrid"]' http://127.0.0.1:7462/solver
//! ```
//!
//! Plain HTTP/1.1; bound to loopback unless configured otherwise. Whoever changes something shows the token that clients
//! show, if there is one (`-H "authorization: Bearer TOKEN"`); reading is free.

use crate::config::{Config, Secret};
use crate::engine_thread::SharedReport;
use crate::listener::is_bearer;
use crate::metrics::Metrics;
use crate::solver_wish::{SolverWish, WISH_BYTES_MAX};
use axum::Router;
use axum::extract::{DefaultBodyLimit, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

/// A tick that takes longer counts as an engine that hangs.
const ENGINE_STALL: Duration = Duration::from_secs(30);
/// As Prometheus asks for it.
const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// What the port reads.
#[derive(Debug, Clone)]
pub(crate) struct Admin {
    /// Counters.
    pub(crate) metrics: Arc<Metrics>,
    /// The engine's last tick.
    pub(crate) report: Arc<SharedReport>,
    /// Set while the service drains.
    pub(crate) draining: Arc<AtomicBool>,
    /// How light is solved.
    pub(crate) solver: Arc<SolverWish>,
    /// What whoever changes something has to show; empty for nothing.
    pub(crate) token: Secret,
}

impl Admin {
    pub(crate) fn new(
        config: &Config,
        metrics: &Arc<Metrics>,
        report: &Arc<SharedReport>,
        draining: &Arc<AtomicBool>,
        solver: Arc<SolverWish>,
    ) -> Self {
        Self {
            metrics: Arc::clone(metrics),
            report: Arc::clone(report),
            draining: Arc::clone(draining),
            solver,
            token: config.bearer_token.clone(),
        }
    }
}

/// Serves until `stop`.
pub(crate) async fn serve(
    listener: TcpListener,
    admin: Admin,
    stop: CancellationToken,
) -> std::io::Result<()> {
    let router = Router::new()
        .route("/metrics", get(metrics))
        .route("/health", get(health))
        .route("/ready", get(ready))
        .route("/solver", get(solver).put(change_solver))
        .layer(DefaultBodyLimit::max(WISH_BYTES_MAX))
        .with_state(admin);
    axum::serve(listener, router).with_graceful_shutdown(stop.cancelled_owned()).await
}

async fn metrics(State(admin): State<Admin>) -> Response {
    match admin.metrics.encode(&admin.report) {
        Ok(text) => ([(header::CONTENT_TYPE, OPEN_METRICS)], text).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}

async fn health(State(admin): State<Admin>) -> (StatusCode, &'static str) {
    match admin.report.read().ticked {
        Some(at) if at.elapsed() > ENGINE_STALL => (StatusCode::SERVICE_UNAVAILABLE, "the engine hangs\n"),
        _ => (StatusCode::OK, "alive\n"),
    }
}

async fn ready(State(admin): State<Admin>) -> (StatusCode, &'static str) {
    if admin.draining.load(Ordering::Acquire) {
        return (StatusCode::SERVICE_UNAVAILABLE, "draining\n");
    }
    match admin.report.read().ticked {
        Some(_) => (StatusCode::OK, "ready\n"),
        None => (StatusCode::SERVICE_UNAVAILABLE, "starting\n"),
    }
}

async fn solver(State(admin): State<Admin>) -> String {
    admin.solver.text()
}

/// Answers with all settings, which hold from the next tick on. A level whose backend cannot do it says so in the log and
/// goes on as before.
async fn change_solver(
    State(admin): State<Admin>,
    headers: HeaderMap,
    wish: String,
) -> Result<String, (StatusCode, String)> {
    let given = headers.get(header::AUTHORIZATION).map_or(&[][..], |value| value.as_bytes());
    if !is_bearer(given, &admin.token.0) {
        let cause = "the token is missing or wrong: send `authorization: Bearer TOKEN`\n";
        return Err((StatusCode::UNAUTHORIZED, cause.to_owned()));
    }
    let changed = admin.solver.change(&wish).map_err(|cause| (StatusCode::BAD_REQUEST, cause + "\n"))?;
    tracing::info!(wish, "light is solved otherwise");
    Ok(changed)
}
