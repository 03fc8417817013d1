//! Counters and gauges in the `OpenMetrics` text format.
//!
//! What the shell counts itself, the engine's [`EngineStats`], read from its last snapshot at every scrape, and what there is
//! to say of a device ([`device_metrics`]). Names end in a unit; `_total` marks counters. Start at [`Metrics::encode`].

use crate::device_metrics;
use crate::device_source::CurrentDevice;
use crate::engine_thread::{EngineReport, SharedReport};
use earthshine_engine::{Counters, EngineStats, SessionStats};
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric as _, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::{ConstCounter, Counter};
use prometheus_client::metrics::gauge::{ConstGauge, Gauge};
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::Registry;

/// Everything that is counted. Cheap to touch from any thread.
#[derive(Debug)]
pub(crate) struct Metrics {
    registry: Registry,
    /// TCP connections now.
    pub(crate) connections: Gauge,
    /// Connections that were cut because they never said anything sensible.
    pub(crate) connections_silent: Counter,
    /// Bytes from clients, transport included.
    pub(crate) received_bytes: Counter,
    /// Bytes to clients, transport included.
    pub(crate) sent_bytes: Counter,
    /// Sessions now.
    pub(crate) sessions: Gauge,
    /// Sessions that were welcomed.
    pub(crate) sessions_opened: Counter,
    /// Sessions that were refused or cut with an error.
    pub(crate) sessions_failed: Counter,
    /// Messages of clients that were ignored or refused.
    pub(crate) messages_ignored: Counter,
    /// Cameras that a newer one overtook before the engine saw them.
    pub(crate) cameras_superseded: Counter,
    /// Deltas sent.
    pub(crate) deltas: Counter,
    /// Voxels in them.
    pub(crate) delta_voxels: Counter,
    /// Memory of what clients were told, bytes.
    pub(crate) told_bytes: Gauge,
    /// Frames that clients were too slow for.
    pub(crate) frames_skipped: Counter,
    /// Tiles handed to the engine.
    pub(crate) tiles_loaded: Counter,
    /// Tiles that could not be had.
    pub(crate) tiles_failed: Counter,
    /// Tiles read in vain.
    pub(crate) tiles_cancelled: Counter,
    /// Time to read, verify and decode a tile.
    pub(crate) tile_seconds: Histogram,
    /// Time of a tick.
    pub(crate) tick_seconds: Histogram,
    /// Ticks that took longer than a period: the next one began late.
    pub(crate) ticks_late: Counter,
    /// New states of the world that were taken over.
    pub(crate) worlds_taken: Counter,
    /// New manifests that were not.
    pub(crate) worlds_refused: Counter,
    device: CurrentDevice,
}

impl Metrics {
    /// All zero; nobody computes on a device.
    #[cfg(test)]
    pub(crate) fn new() -> Self {
        Self::of(CurrentDevice::default())
    }

    /// All zero; what `device` says is asked for when somebody looks.
    pub(crate) fn of(device: CurrentDevice) -> Self {
        let mut metrics = Self {
            registry: Registry::with_prefix("earthshine"),
            connections: Gauge::default(),
            connections_silent: Counter::default(),
            received_bytes: Counter::default(),
            sent_bytes: Counter::default(),
            sessions: Gauge::default(),
            sessions_opened: Counter::default(),
            sessions_failed: Counter::default(),
            messages_ignored: Counter::default(),
            cameras_superseded: Counter::default(),
            deltas: Counter::default(),
            delta_voxels: Counter::default(),
            told_bytes: Gauge::default(),
            frames_skipped: Counter::default(),
            tiles_loaded: Counter::default(),
            tiles_failed: Counter::default(),
            tiles_cancelled: Counter::default(),
            // 0.1 ms to 3.3 s.
            tile_seconds: Histogram::new(exponential_buckets(1e-4, 2.0, 16)),
            tick_seconds: Histogram::new(exponential_buckets(1e-4, 2.0, 16)),
            ticks_late: Counter::default(),
            worlds_taken: Counter::default(),
            worlds_refused: Counter::default(),
            device,
        };
        metrics.register();
        metrics
    }

    fn register(&mut self) {
        let counters = [
            (
                "connections_silent",
                "Connections cut before they said anything sensible",
                &self.connections_silent,
            ),
            ("received_bytes", "Bytes from clients", &self.received_bytes),
            ("sent_bytes", "Bytes to clients", &self.sent_bytes),
            ("sessions_opened", "Sessions welcomed", &self.sessions_opened),
            ("sessions_failed", "Sessions refused or cut with an error", &self.sessions_failed),
            ("messages_ignored", "Client messages ignored or refused", &self.messages_ignored),
            ("cameras_superseded", "Cameras overtaken before the engine saw them", &self.cameras_superseded),
            ("deltas", "Deltas sent", &self.deltas),
            ("delta_voxels", "Voxels in the deltas sent", &self.delta_voxels),
            ("frames_skipped", "Frames that clients were too slow for", &self.frames_skipped),
            ("tiles_loaded", "Tiles handed to the engine", &self.tiles_loaded),
            ("tiles_failed", "Tiles that could not be had", &self.tiles_failed),
            ("tiles_cancelled", "Tiles read in vain", &self.tiles_cancelled),
            ("ticks_late", "Ticks that took longer than a period", &self.ticks_late),
            ("worlds_taken", "New states of the world taken over", &self.worlds_taken),
            ("worlds_refused", "New manifests that were refused", &self.worlds_refused),
        ];
        for (name, help, counter) in counters {
            self.registry.register(name, help, counter.clone());
        }
        self.registry.register("connections", "TCP connections now", self.connections.clone());
        self.registry.register("sessions", "Sessions now", self.sessions.clone());
        self.registry.register("told_bytes", "Memory of what clients were told", self.told_bytes.clone());
        self.registry.register("tile_seconds", "Time to read and decode a tile", self.tile_seconds.clone());
        self.registry.register("tick_seconds", "Time of a tick", self.tick_seconds.clone());
    }

    /// Everything as `OpenMetrics` text, the engine's last report included.
    ///
    /// # Errors
    /// None that a `String` can have; the encoder's signature asks for it.
    pub(crate) fn encode(&self, report: &SharedReport) -> Result<String, std::fmt::Error> {
        let mut engine = Registry::with_prefix("earthshine_engine");
        engine.register_collector(Box::new(EngineCollector(report.read())));
        let mut body = String::new();
        text::encode_registry(&mut body, &self.registry)?;
        text::encode_registry(&mut body, &engine)?;
        let device = device_metrics::registry(&self.device);
        text::encode_registry(&mut body, &device)?;
        text::encode_eof(&mut body)?;
        Ok(body)
    }
}

#[derive(Debug)]
struct EngineCollector(EngineReport);

impl Collector for EngineCollector {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), std::fmt::Error> {
        for (name, help, value) in counters(&self.0.stats.counters) {
            let metric = encoder.encode_descriptor(name, help, None, MetricType::Counter)?;
            ConstCounter::new(value).encode(metric)?;
        }
        let mut misses = encoder.encode_descriptor(
            "level_misses",
            "Ticks times sessions with a patch of the level missing near the camera",
            None,
            MetricType::Counter,
        )?;
        for (level, &count) in
            self.0.stats.counters.misses_by_level.iter().enumerate().filter(|(_, count)| **count > 0)
        {
            let labels = [("level", level.to_string())];
            ConstCounter::new(count).encode(misses.encode_family(&labels)?)?;
        }
        let mut broken = encoder.encode_descriptor(
            "promise_violation_causes",
            "Broken promises by what was waited for: the first of a tile, a slot, light",
            None,
            MetricType::Counter,
        )?;
        let causes = self.0.stats.counters.violation_causes;
        for (cause, count) in [("tile", causes.tiles), ("slot", causes.slots), ("light", causes.light)] {
            ConstCounter::new(count).encode(broken.encode_family(&[("cause", cause)])?)?;
        }
        for (name, help, value) in gauges(&self.0) {
            let metric = encoder.encode_descriptor(name, help, None, MetricType::Gauge)?;
            ConstGauge::new(value).encode(metric)?;
        }
        Ok(())
    }
}

/// Name, help and value of what only grows.
fn counters(counted: &Counters) -> Vec<(&'static str, &'static str, u64)> {
    vec![
        ("ticks", "Ticks", counted.ticks),
        (
            "events_ignored",
            "Events that made no difference because they could not be",
            counted.ignored.total(),
        ),
        ("tiles_requested", "Tiles asked for", counted.tiles_requested),
        ("tiles_cancelled", "Requests taken back", counted.tiles_cancelled),
        ("tiles_decoded", "Tiles taken", counted.tiles_decoded),
        ("tile_bytes", "Bytes on disk of all tiles taken", counted.tile_bytes),
        ("tile_failures", "Tiles that could not be had", counted.tile_failures),
        ("chunks_given_up", "Chunks quarantined since the start", counted.quarantined),
        ("decoded_bytes", "Memory of all tiles taken", counted.bytes_decoded),
        ("patches_added", "Patches that entered a local matrix", counted.adds),
        ("patches_removed", "Patches that left one, one by one", counted.removes),
        ("patches_cleared", "Patches that left one all together, after a jump", counted.cleared),
        ("weak_pivots", "Patches refused for a weak pivot", counted.weak_pivots),
        ("refused_adds", "Patches refused for another reason", counted.refused_adds),
        ("backend_failures", "Backends that failed", counted.backend_failures),
        ("slots_lit", "Slots whose direct light was computed", counted.slots_lit),
        ("shadow_rays", "Most shadow rays that may have been traced", counted.rays),
        ("limited_sources", "Sources limited to what f32 light can carry", counted.limited_sources),
        ("drift_probes", "Measurements of drift", counted.drift_probes),
        ("resolves", "Repairs and fresh solves because of drift", counted.resolves),
        ("frames", "Frames published", counted.frames),
        ("audits", "Audits of a solver by the matrix", counted.audits),
        ("solvers_refused", "Solvers that a backend refused: it goes on by another", counted.solvers_refused),
        ("chunks_evicted", "Unwanted chunks that went because room was needed", counted.evicted),
        ("promised_ticks", "Ticks times sessions held against the promise", counted.promised_ticks),
        ("promise_violations", "Of those, with light of level 0 missing near a camera", counted.violations),
    ]
}

/// Name, help and value of what goes up and down.
fn gauges(report: &EngineReport) -> Vec<(&'static str, &'static str, f64)> {
    let (stats, memory) = (&report.stats, &report.memory.engine);
    let sum = |of: fn(&SessionStats) -> u32| {
        stats.sessions.iter().map(|session| u64::from(of(session))).sum::<u64>() as f64
    };
    let most = |of: fn(&SessionStats) -> f32| {
        stats.sessions.iter().map(|session| f64::from(of(session))).fold(0.0, f64::max)
    };
    vec![
        ("chunks_requested", "Chunks asked for", f64::from(stats.chunks.requested)),
        ("chunks_decoded", "Chunks in memory without slots", f64::from(stats.chunks.decoded)),
        ("chunks_resident", "Chunks with slots", f64::from(stats.chunks.resident)),
        ("chunks_leaving", "Chunks on their way out", f64::from(stats.chunks.leaving)),
        ("chunks_quarantined", "Chunks given up", f64::from(stats.chunks.quarantined)),
        ("held_bytes", "Memory of the tiles held", stats.decoded_bytes as f64),
        ("spare_tile_bytes", "Of that, of tiles that no camera wants", memory.spare_tile_bytes as f64),
        ("matrix_bytes", "Memory of local matrices, none on a device", memory.matrix_bytes as f64),
        ("row_bytes", "Memory of form factors between residents, none on a device", memory.row_bytes as f64),
        (
            "resident_bytes",
            "Memory of resident patches and how their rows split",
            memory.resident_bytes as f64,
        ),
        ("receiver_bytes", "Memory of receivers and their light", memory.receiver_bytes as f64),
        ("frame_bytes", "Memory of the newest frames", memory.frame_bytes as f64),
        ("parent_bytes", "Memory of ancestors kept for tiles to come", report.memory.parent_bytes as f64),
        (
            "resident_patches",
            "Patches that hold slots, all sessions",
            sum(|session| session.resident_patches),
        ),
        ("wanted_patches", "Patches that cameras want, all sessions", sum(|session| session.wanted_patches)),
        ("stale_patches", "Patches with old direct light, all sessions", sum(|session| session.stale_direct)),
        ("matrix_drift_ratio", "Worst rounding of any local matrix", f64::from(stats.drift())),
        (
            "solver_audit_error_ratio",
            "Worst relative RMSE of any view's light against the matrix, at its last audit",
            f64::from(stats.audit_error()),
        ),
        ("effort_ratio", "Part of its budgets that a tick may spend", f64::from(stats.effort)),
        ("promised_radius_meters", "Radius of the promise; 0 for none", f64::from(stats.promised_radius_m)),
        (
            "promised_speed_meters_per_second",
            "Up to which speed it holds",
            f64::from(stats.promised_speed_m_s),
        ),
        (
            "promised_ticks_per_second",
            "Rate of ticks that the promise counts on, as measured",
            f64::from(stats.promised_tick_rate_hz),
        ),
        (
            "missing_near_patches",
            "Patches within the promised radius without light of level 0, all sessions",
            sum(|session| session.missing_near),
        ),
        ("far_share_ratio", "Largest mean far share of any session", most(|session| session.far_share)),
        ("gap_share_ratio", "Largest mean far share that no coarse level brings", most(gap_share)),
        ("fed_share_ratio", "Smallest fed part of the far share of any session", least_fed(stats)),
        ("chunks_spare", "Chunks in memory that nobody wants", f64::from(stats.spare_chunks)),
        ("tile_requests", "Tiles asked for and not answered", report.tiles_pending as f64),
    ]
}

fn gap_share(session: &SessionStats) -> f32 {
    (session.far_share - session.fed_share).max(0.0)
}

/// 1 where nothing is far.
fn least_fed(stats: &EngineStats) -> f64 {
    let far = stats.sessions.iter().filter(|session| session.far_share > 0.0);
    far.map(|session| f64::from(session.fed_share / session.far_share)).fold(1.0, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_holds_what_the_shell_and_the_engine_count() {
        let metrics = Metrics::new();
        metrics.deltas.inc_by(3);
        metrics.tick_seconds.observe(0.002);
        let report = SharedReport::default();
        let mut stats = EngineReport::default();
        stats.stats.counters.adds = 17;
        stats.stats.counters.violations = 5;
        stats.stats.counters.violation_causes.slots = 2;
        stats.stats.counters.misses_by_level[1] = 4;
        stats.stats.promised_radius_m = 12.5;
        stats.stats.sessions = [(0.5, 0.25), (0.25, 0.25), (0.0, 0.0)]
            .map(|(far_share, fed_share)| SessionStats { far_share, fed_share, ..SessionStats::default() })
            .to_vec();
        report.write(stats);
        let text = metrics.encode(&report).unwrap();
        for line in [
            "earthshine_deltas_total 3",
            "earthshine_engine_patches_added_total 17",
            "earthshine_engine_matrix_drift_ratio 0.0",
            "earthshine_engine_promise_violations_total 5",
            "earthshine_engine_promise_violation_causes_total{cause=\"slot\"} 2",
            "earthshine_engine_level_misses_total{level=\"1\"} 4",
            "earthshine_engine_promised_radius_meters 12.5",
            "earthshine_engine_fed_share_ratio 0.5",
            "earthshine_engine_gap_share_ratio 0.25",
            "earthshine_tick_seconds_count 1",
            "# EOF",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} is not in\n{text}");
        }
    }
}
