//! One client, from its hello to its goodbye.
//!
//! What it says is checked and passed to the engine's mailbox, the newest of each kind; what it hears is built at
//! the moment when there is room for it: frames that a slow client missed are never sent. Every wait has an end:
//! hello, idle, drain. Start at [`run`].

use crate::config::{Config, load::seconds};
use crate::convert::reply::{self, Limits, SessionCounts};
use crate::convert::{ErrorCode, Greeting, Refusal, Request};
use crate::engine_thread::{FrameSlot, Mailbox, Opening, SharedReport};
use crate::metrics::Metrics;
use crate::streams::{Streams, VolumeLimits};
use earthshine_engine::SessionId;
use earthshine_protocol::v1::{ClientMessage, ServerMessage};
use earthshine_world::{Camera, LightRig, WorldIndex};
use glam::UVec3;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until, timeout};
use tokio_util::sync::CancellationToken;
use tonic::{Code, Status, Streaming};

/// Messages that may wait for the transport; deltas are built only when there is room.
pub(crate) const OUTBOUND_MAX: usize = 4;
/// How long a goodbye may take to be handed to the transport.
const GOODBYE_TIMEOUT: Duration = Duration::from_secs(1);

/// Towards one client.
pub(crate) type Outbound = mpsc::Sender<Result<ServerMessage, Status>>;

/// What all sessions share.
#[derive(Debug)]
pub(crate) struct Shared {
    /// Checked.
    pub(crate) config: Config,
    /// Name of the world.
    pub(crate) world: String,
    /// What is in it; a world that is taken over brings its own. A session keeps the levels that it began with.
    pub(crate) index: watch::Receiver<Arc<WorldIndex>>,
    /// To the engine's thread.
    pub(crate) openings: mpsc::Sender<Opening>,
    /// From the engine's thread.
    pub(crate) report: Arc<SharedReport>,
    /// Counters.
    pub(crate) metrics: Arc<Metrics>,
    /// Set when the service drains.
    pub(crate) stop: CancellationToken,
}

/// How a session ended.
enum End {
    /// The client said goodbye or hung up.
    Left,
    /// The server ends it, and says why.
    Refused(Refusal),
    /// The connection or its bytes are broken.
    Broken(Status),
}

impl From<Refusal> for End {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

/// Serves one client until it leaves, is refused or the service stops.
pub(crate) async fn run(
    shared: Arc<Shared>,
    session: SessionId,
    mut inbound: Streaming<ClientMessage>,
    outbound: Outbound,
) {
    let end = match greet(&shared, &mut inbound).await {
        Ok(greeting) => converse(&shared, session, greeting, &mut inbound, &outbound).await,
        Err(end) => end,
    };
    let session = session.0;
    let refusal = match end {
        End::Left => {
            tracing::info!(session, "left");
            return;
        }
        End::Refused(refusal) => refusal,
        // Bytes that are no message, or too many; what the transport says names the limit.
        End::Broken(status)
            if matches!(status.code(), Code::OutOfRange | Code::Internal | Code::InvalidArgument) =>
        {
            shared.metrics.messages_ignored.inc();
            Refusal::new(ErrorCode::Invalid, format!("a message could not be read: {}", status.message()))
        }
        End::Broken(status) => {
            tracing::info!(session, cause = status.message(), "connection lost");
            return;
        }
    };
    if refusal.code == ErrorCode::Draining {
        tracing::info!(session, "drained");
    } else {
        tracing::warn!(session, cause = refusal.cause, "refused");
        shared.metrics.sessions_failed.inc();
    }
    let goodbye = outbound.send(Ok(reply::error(&refusal, true)));
    if timeout(GOODBYE_TIMEOUT, goodbye).await.is_err() {
        tracing::debug!(session, "too slow for a goodbye");
    }
}

fn draining() -> Refusal {
    Refusal::new(ErrorCode::Draining, "the server shuts down: connect again in a moment")
}

/// Waits for the hello.
async fn greet(shared: &Shared, inbound: &mut Streaming<ClientMessage>) -> Result<Greeting, End> {
    let limit = shared.config.hello_timeout_s;
    let first = tokio::select! {
        () = shared.stop.cancelled() => return Err(draining().into()),
        first = timeout(seconds(limit), inbound.message()) => first,
    };
    let Ok(message) = first else {
        let cause = format!("no hello within {limit} s (`hello_timeout_s`)");
        return Err(Refusal::new(ErrorCode::Silent, cause).into());
    };
    let Some(message) = message.map_err(End::Broken)? else { return Err(End::Left) };
    match Request::decode(message, &shared.world, shared.config.engine.lights_max)? {
        Request::Hello(greeting) => Ok(greeting),
        _ => Err(Refusal::new(ErrorCode::HelloExpected, "the first message must be Hello").into()),
    }
}

/// Opens the session in the engine, and goes on until it ends.
async fn converse(
    shared: &Shared,
    session: SessionId,
    greeting: Greeting,
    inbound: &mut Streaming<ClientMessage>,
    outbound: &Outbound,
) -> End {
    let config = &shared.config;
    let Greeting { protocol, client_name, volumes_wanted, detail_layers } = greeting;
    let (publish, frames) = watch::channel(None);
    let mailbox = Arc::new(Mailbox::default());
    let opening = Opening { session, mailbox: Arc::clone(&mailbox), frames: publish };
    if shared.openings.send(opening).await.is_err() {
        return engine_gone().into();
    }
    tracing::info!(session = session.0, client_name, protocol, "opened");
    shared.metrics.sessions_opened.inc();
    let limits = Limits {
        camera_rate_max_hz: config.camera_rate_max_hz,
        lights_max: config.engine.lights_max,
        message_bytes_max: config.message_bytes_max,
    };
    let index = shared.index.borrow().clone();
    let welcome = reply::welcome(protocol, session.0, &shared.world, &index, limits);
    if outbound.send(Ok(welcome)).await.is_err() {
        return End::Left;
    }
    let limits = VolumeLimits {
        dims_max: UVec3::from_array(config.volume_dims_max),
        snap_voxels: config.volume_snap_voxels,
        in_flight_max: config.deltas_in_flight_max,
    };
    let conversation = Conversation {
        shared,
        session,
        mailbox,
        frames,
        streams: Streams::new(&volumes_wanted, detail_layers, &index, limits),
        frame_number: 0,
        camera_waiting: None,
        camera_at: Instant::now(),
        counts: SessionCounts {
            tiles_failed_before: shared.report.read().stats.counters.tile_failures,
            ..SessionCounts::default()
        },
        has_remarked: false,
        told_bytes: 0,
    };
    conversation.run(inbound, outbound).await
}

fn engine_gone() -> Refusal {
    Refusal::new(ErrorCode::Internal, "the engine stopped: the server is about to end")
}

struct Conversation<'a> {
    shared: &'a Shared,
    session: SessionId,
    mailbox: Arc<Mailbox>,
    frames: watch::Receiver<FrameSlot>,
    streams: Streams,
    /// Of the last frame sent.
    frame_number: u64,
    /// Came too early after the one before.
    camera_waiting: Option<(u64, Camera)>,
    camera_at: Instant,
    counts: SessionCounts,
    /// Whether the client was told that its lights are unlikely.
    has_remarked: bool,
    /// What its streams hold, as far as it is counted in the metrics, bytes.
    told_bytes: i64,
}

impl Drop for Conversation<'_> {
    fn drop(&mut self) {
        self.shared.metrics.told_bytes.dec_by(self.told_bytes);
    }
}

impl Conversation<'_> {
    async fn run(mut self, inbound: &mut Streaming<ClientMessage>, outbound: &Outbound) -> End {
        let config = &self.shared.config;
        let idle = seconds(config.idle_timeout_s);
        let mut idle_at = Instant::now() + idle;
        let mut statistics = interval(seconds(config.statistics_interval_s));
        statistics.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let may_send = self.streams.may_send();
            tokio::select! {
                () = self.shared.stop.cancelled() => return draining().into(),
                () = outbound.closed() => return End::Left,
                message = inbound.message() => {
                    idle_at = Instant::now() + idle;
                    match message {
                        Err(status) => return End::Broken(status),
                        Ok(None) => return End::Left,
                        Ok(Some(message)) => if let Some(end) = self.hear(message, outbound) {
                            return end;
                        },
                    }
                }
                changed = self.frames.changed(), if !self.streams.are_all_news() => match changed {
                    Err(_) => return engine_gone().into(),
                    Ok(()) => self.streams.mark_news(),
                },
                // A move and a delta.
                room = outbound.reserve_many(2), if may_send => match room {
                    Err(_) => return End::Left,
                    Ok(mut room) => self.send_light(|message| {
                        if let Some(place) = room.next() {
                            place.send(Ok(message));
                        }
                    }),
                },
                () = sleep_until(self.camera_at), if self.camera_waiting.is_some() => self.pass_camera(),
                _ = statistics.tick() => self.send_statistics(outbound),
                () = sleep_until(idle_at) => {
                    let cause = format!("nothing heard for {} s (`idle_timeout_s`)", config.idle_timeout_s);
                    return Refusal::new(ErrorCode::Silent, cause).into();
                }
            }
        }
    }

    /// Acts on one message; says how the session ends, if it does.
    fn hear(&mut self, message: ClientMessage, outbound: &Outbound) -> Option<End> {
        let config = &self.shared.config;
        match Request::decode(message, &self.shared.world, config.engine.lights_max) {
            Ok(Request::Bye) => return Some(End::Left),
            Ok(Request::Hello(_)) => {
                return Some(Refusal::new(ErrorCode::HelloExpected, "a second Hello").into());
            }
            Ok(Request::Camera { sequence, camera }) => {
                if self.camera_waiting.replace((sequence, camera)).is_some() {
                    self.shared.metrics.cameras_superseded.inc();
                }
                if Instant::now() >= self.camera_at {
                    self.pass_camera();
                }
            }
            Ok(Request::Lights(lights)) => {
                self.remark_on(&lights, outbound);
                self.mailbox.put_lights(lights);
            }
            Ok(Request::Ack { volume, generation }) => self.take_ack(volume, generation),
            Ok(Request::Ignored) => self.ignore(),
            Err(refusal) if matches!(refusal.code, ErrorCode::Invalid) => {
                self.ignore();
                // A client that cannot take its errors does without.
                drop(outbound.try_send(Ok(reply::error(&refusal, false))));
            }
            Err(refusal) => return Some(refusal.into()),
        }
        None
    }

    /// Says once a session that lights are brighter than anything likely: a client may send them many times a second. One that
    /// has no room for it is told with its next lights.
    fn remark_on(&mut self, lights: &LightRig, outbound: &Outbound) {
        if self.has_remarked {
            return;
        }
        let Some(remark) = lights.remark() else { return };
        let cause = format!("{remark}: is less meant? It is served as it is, and not remarked on again");
        let said = outbound.try_send(Ok(reply::error(&Refusal::new(ErrorCode::Unlikely, cause), false)));
        if said.is_ok() {
            self.has_remarked = true;
            tracing::warn!(session = self.session.0, remark, "lights are probably not meant");
        }
    }

    fn ignore(&mut self) {
        self.counts.messages_ignored += 1;
        self.shared.metrics.messages_ignored.inc();
    }

    fn pass_camera(&mut self) {
        if let Some((sequence, camera)) = self.camera_waiting.take() {
            if self.mailbox.put_camera(sequence, camera) {
                self.shared.metrics.cameras_superseded.inc();
            }
            self.camera_at = Instant::now() + seconds(1.0 / self.shared.config.camera_rate_max_hz);
        }
    }

    fn take_ack(&mut self, volume: u32, generation: u64) {
        if !self.streams.acknowledge(volume, generation) {
            self.ignore();
        }
    }

    fn send_light(&mut self, mut send: impl FnMut(ServerMessage)) {
        let Some(published) = self.frames.borrow_and_update().clone() else { return };
        let metrics = &self.shared.metrics;
        let skipped = published.frame.number.saturating_sub(self.frame_number + 1);
        self.counts.frames_skipped += skipped;
        metrics.frames_skipped.inc_by(skipped);
        self.frame_number = published.frame.number;
        let Some((moved, changes)) = self.streams.next(&published) else { return };
        if let Some(store) = moved {
            send(reply::volume(store));
        }
        if let Some(changes) = changes {
            metrics.deltas.inc();
            metrics.delta_voxels.inc_by(changes.voxels.len() as u64);
            send(reply::delta(&changes));
        }
    }

    fn send_statistics(&mut self, outbound: &Outbound) {
        let told_bytes = i64::try_from(self.streams.bytes()).unwrap_or(i64::MAX);
        self.shared.metrics.told_bytes.inc_by(told_bytes - self.told_bytes);
        self.told_bytes = told_bytes;
        let report = self.shared.report.read();
        let own = report.stats.sessions.iter().find(|own| own.session == self.session);
        let capacity = self.shared.config.engine.resident_patches_max;
        // The next one comes soon.
        drop(outbound.try_send(Ok(reply::statistics(&report, own, capacity, self.counts))));
    }
}
