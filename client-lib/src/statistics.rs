//! What a session has cost and how fast it answered.

use earthshine_protocol::v1;
use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

/// Cameras whose answer is waited for; older ones are forgotten.
const CAMERAS_WAITING_MAX: usize = 4096;
/// Answers kept until they are taken; older ones are forgotten.
const ANSWERS_MAX: usize = 1 << 16;

/// A camera and when the first light that answers it was ready to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Answer {
    /// As [`crate::Client::set_camera`] numbered it.
    pub camera_sequence: u64,
    /// From `set_camera` to the light.
    pub latency: Duration,
}

/// Counters of a session so far.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Statistics {
    /// Whole states received.
    pub frames: u64,
    /// Messages received.
    pub messages: u64,
    /// Bytes of messages received, without gRPC's framing.
    pub bytes: u64,
    /// Cameras given to [`crate::Client::set_camera`].
    pub cameras: u64,
    /// Latency of the last camera that was answered.
    pub latency: Option<Duration>,
    /// What the server said of itself last.
    pub server: Option<ServerStatistics>,
    /// The last complaint that did not end the session.
    pub warning: Option<String>,
}

/// How the server fares, in its own words; the wire's schema has the meaning of each.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ServerStatistics {
    /// Frames published for the session.
    pub frames_published: u64,
    /// Frames this client was too slow for.
    pub frames_skipped: u64,
    /// Duration of the last tick, ms.
    pub tick_ms: f32,
    /// Patches in the session's local matrix.
    pub resident_patches: u32,
    /// Patches that fit in it.
    pub capacity_patches: u32,
    /// Tiles asked for and not there yet.
    pub tiles_loading: u32,
    /// Tiles that could not be had.
    pub tiles_failed: u64,
    /// Messages of this client that were ignored.
    pub messages_ignored: u64,
    /// Sessions open on the server.
    pub sessions: u32,
    /// Largest relative difference of the local matrix from a fresh solve, last measured.
    pub matrix_drift: f32,
    /// Inside this radius of a camera, at up to the promised speed, every frame has light of level 0, m; 0 for no promise.
    pub promised_radius_m: f32,
    /// m/s.
    pub promised_speed_m_s: f32,
    /// Ticks that broke the promise to its camera.
    pub promise_violations: u64,
    /// Mean share of what the session's patches see that exists but is not in the local matrix, 0..=1.
    pub far_share: f32,
    /// Mean of what coarse levels bring of it, 0..=1: the rest is a gap.
    pub fed_share: f32,
}

impl ServerStatistics {
    fn from_wire(wire: &v1::Statistics) -> Self {
        Self {
            frames_published: wire.frames_published,
            frames_skipped: wire.frames_skipped,
            tick_ms: wire.tick_ms,
            resident_patches: wire.resident_patches,
            capacity_patches: wire.capacity_patches,
            tiles_loading: wire.tiles_loading,
            tiles_failed: wire.tiles_failed,
            messages_ignored: wire.messages_ignored,
            sessions: wire.sessions,
            matrix_drift: wire.matrix_drift,
            promised_radius_m: wire.promised_radius_m,
            promised_speed_m_s: wire.promised_speed_m_s,
            promise_violations: wire.promise_violations,
            far_share: wire.far_share,
            fed_share: wire.fed_share,
        }
    }
}

/// The counters while they count.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) statistics: Statistics,
    waiting: VecDeque<(u64, Instant)>,
    answers: VecDeque<Answer>,
}

impl Counters {
    /// Numbers a camera that is about to be sent.
    pub(crate) fn camera(&mut self, now: Instant) -> u64 {
        self.statistics.cameras += 1;
        push_bounded(&mut self.waiting, (self.statistics.cameras, now), CAMERAS_WAITING_MAX);
        self.statistics.cameras
    }

    pub(crate) fn message(&mut self, bytes: usize) {
        self.statistics.messages += 1;
        self.statistics.bytes += bytes as u64;
    }

    /// A state was published that answers all cameras up to `camera_sequence`.
    pub(crate) fn frame(&mut self, camera_sequence: u64, now: Instant) {
        self.statistics.frames += 1;
        while let Some(&(sequence, sent)) = self.waiting.front()
            && sequence <= camera_sequence
        {
            self.waiting.pop_front();
            let latency = now.saturating_duration_since(sent);
            self.statistics.latency = Some(latency);
            push_bounded(&mut self.answers, Answer { camera_sequence: sequence, latency }, ANSWERS_MAX);
        }
    }

    pub(crate) fn server(&mut self, wire: &v1::Statistics) {
        self.statistics.server = Some(ServerStatistics::from_wire(wire));
    }

    pub(crate) fn take_answers(&mut self) -> Vec<Answer> {
        self.answers.drain(..).collect()
    }
}

fn push_bounded<T>(queue: &mut VecDeque<T>, item: T, max: usize) {
    if queue.len() >= max {
        queue.pop_front();
    }
    queue.push_back(item);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_answers_all_cameras_before_it_and_none_after() {
        let mut counters = Counters::default();
        let start = Instant::now();
        for tick in 0..4 {
            counters.camera(start + Duration::from_millis(tick * 10));
        }
        counters.frame(0, start + Duration::from_millis(31));
        assert_eq!(counters.take_answers(), []);
        counters.frame(3, start + Duration::from_millis(35));
        let answers = counters.take_answers();
        assert_eq!(answers.iter().map(|a| a.camera_sequence).collect::<Vec<_>>(), [1, 2, 3]);
        assert_eq!(answers.iter().map(|a| a.latency.as_millis()).collect::<Vec<_>>(), [35, 25, 15]);
        for _ in 0..2 * CAMERAS_WAITING_MAX {
            counters.camera(start);
        }
        assert_eq!(counters.waiting.len(), CAMERAS_WAITING_MAX);
    }
}
