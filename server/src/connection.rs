//! Accepted connections, plain or TLS: counted, bounded, and cut if they never say anything.
//!
//! HTTP/2's own keepalive starts after its greeting, so a peer that never greets would stay for good:
//! [`Connection`] fails its reads unless the greeting is there in time. Start at [`accept`].

use crate::metrics::Metrics;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio::time::{Sleep, sleep, timeout};
use tokio_rustls::TlsAcceptor;
use tokio_util::sync::CancellationToken;
use tonic::transport::server::{Connected, TcpConnectInfo};

/// HTTP/2's greeting: `PRI * HTTP/2.0`, two empty lines, `SM`, an empty line.
const GREETING_BYTES: usize = 24;
/// Pause after the system refused a connection, for want of file descriptors as a rule.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// Limits of the accept loop.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ConnectionLimits {
    /// Connections at once.
    pub(crate) connections_max: u32,
    /// Time for the greeting, and before it for the TLS handshake.
    pub(crate) greeting: Duration,
}

/// Accepts until `stop`; the connections come out of the stream's other end, those with TLS after their handshake.
pub(crate) fn accept(
    listener: TcpListener,
    tls: Option<TlsAcceptor>,
    limits: ConnectionLimits,
    metrics: Arc<Metrics>,
    stop: CancellationToken,
) -> mpsc::Receiver<io::Result<Connection>> {
    let (accepted, connections) = mpsc::channel(1);
    let places = Arc::new(Semaphore::new(limits.connections_max as usize));
    tokio::spawn(stop.run_until_cancelled_owned(async move {
        // The semaphore is never closed.
        while let Ok(place) = Arc::clone(&places).acquire_owned().await {
            match listener.accept().await {
                Ok((stream, _)) => {
                    if let Err(error) = stream.set_nodelay(true) {
                        tracing::debug!(%error, "TCP_NODELAY was refused");
                    }
                    let Some(tls) = tls.clone() else {
                        let info = stream.connect_info();
                        let connection = Connection::new(stream, info, place, limits.greeting, &metrics);
                        if accepted.send(Ok(connection)).await.is_err() {
                            break;
                        }
                        continue;
                    };
                    // One slow handshake must not hold up those behind it.
                    tokio::spawn(shake_hands(
                        tls,
                        stream,
                        place,
                        limits,
                        Arc::clone(&metrics),
                        accepted.clone(),
                    ));
                }
                Err(error) => {
                    tracing::warn!(%error, "a connection was not accepted");
                    sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }));
    connections
}

async fn shake_hands(
    tls: TlsAcceptor,
    stream: TcpStream,
    place: OwnedSemaphorePermit,
    limits: ConnectionLimits,
    metrics: Arc<Metrics>,
    accepted: mpsc::Sender<io::Result<Connection>>,
) {
    let info = stream.connect_info();
    match timeout(limits.greeting, tls.accept(stream)).await {
        Ok(Ok(stream)) => {
            let connection = Connection::new(stream, info, place, limits.greeting, &metrics);
            // Nobody listens any more when the service stops.
            drop(accepted.send(Ok(connection)).await);
        }
        Ok(Err(error)) => tracing::warn!(peer = ?info.remote_addr(), %error, "no TLS handshake"),
        Err(_elapsed) => {
            metrics.connections_silent.inc();
        }
    }
}

/// TCP, or TLS on it.
trait Transport: AsyncRead + AsyncWrite + Send + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin> Transport for T {}

/// One connection.
pub(crate) struct Connection {
    stream: Box<dyn Transport>,
    info: TcpConnectInfo,
    metrics: Arc<Metrics>,
    /// Until the greeting is there: how much is missing, and until when.
    greeting: Option<(usize, Pin<Box<Sleep>>)>,
    _place: OwnedSemaphorePermit,
}

impl Connection {
    fn new(
        stream: impl Transport + 'static,
        info: TcpConnectInfo,
        place: OwnedSemaphorePermit,
        greeting: Duration,
        metrics: &Arc<Metrics>,
    ) -> Self {
        metrics.connections.inc();
        Self {
            stream: Box::new(stream),
            info,
            metrics: Arc::clone(metrics),
            greeting: Some((GREETING_BYTES, Box::pin(sleep(greeting)))),
            _place: place,
        }
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.metrics.connections.dec();
    }
}

impl Connected for Connection {
    type ConnectInfo = TcpConnectInfo;

    fn connect_info(&self) -> TcpConnectInfo {
        self.info.clone()
    }
}

impl AsyncRead for Connection {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let before = buf.filled().len();
        let polled = Pin::new(&mut this.stream).poll_read(cx, buf);
        let received = buf.filled().len() - before;
        this.metrics.received_bytes.inc_by(received as u64);
        if let Some((missing, deadline)) = &mut this.greeting {
            *missing = missing.saturating_sub(received);
            if *missing == 0 {
                this.greeting = None;
            } else if polled.is_pending() && deadline.as_mut().poll(cx).is_ready() {
                this.metrics.connections_silent.inc();
                return Poll::Ready(Err(io::Error::new(
                    io::ErrorKind::TimedOut,
                    "no HTTP/2 greeting in time",
                )));
            }
        }
        polled
    }
}

impl AsyncWrite for Connection {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &[u8]) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        let polled = Pin::new(&mut this.stream).poll_write(cx, buf);
        if let Poll::Ready(Ok(sent)) = &polled {
            this.metrics.sent_bytes.inc_by(*sent as u64);
        }
        polled
    }

    fn poll_write_vectored(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bufs: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        let polled = Pin::new(&mut this.stream).poll_write_vectored(cx, bufs);
        if let Poll::Ready(Ok(sent)) = &polled {
            this.metrics.sent_bytes.inc_by(*sent as u64);
        }
        polled
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_flush(cx)
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_shutdown(cx)
    }
}
