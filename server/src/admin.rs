//! The operators' port: `/metrics` for Prometheus, `/health` (restart me if not) and `/ready` (send clients).
//!
//! Plain HTTP/1.1, no secrets; bound to loopback unless configured otherwise.

use crate::engine_thread::SharedReport;
use crate::metrics::Metrics;
use axum::Router;
use axum::extract::State;
use axum::http::{StatusCode, header};
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
