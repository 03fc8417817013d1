//! A flight in numbers, and over time.

use super::footprint::LapMemory;
use super::{FlightArguments, Flown};
use earthshine_render::chart::{Axis, Chart, Scale, Series};
use earthshine_render::compare_points::percentile;
use earthshine_server::ViolationCauses;
use serde::Serialize;
use std::path::PathBuf;

/// Points a chart shows at most: more than pixels.
const CHART_POINTS_MAX: usize = 2000;

/// Broken promises by what was waited for first.
#[derive(Serialize)]
pub(super) struct ByCause {
    pub(super) tiles: u64,
    pub(super) slots: u64,
    pub(super) light: u64,
}

impl From<ViolationCauses> for ByCause {
    fn from(ViolationCauses { tiles, slots, light }: ViolationCauses) -> Self {
        Self { tiles, slots, light }
    }
}

#[derive(Serialize)]
pub(super) struct Figures {
    pub(super) transport: &'static str,
    pub(super) cold: bool,
    pub(super) laps: u32,
    pub(super) speed_m_s: f32,
    /// Whole states of light that the client received.
    pub(super) frames: u64,
    pub(super) frames_per_s: f64,
    pub(super) ticks: u64,
    pub(super) promised_ticks: u64,
    pub(super) violations: u64,
    pub(super) violations_by_cause: ByCause,
    /// Ticks with a patch missing inside the promised radius, twice that on level 1, and so on; jumps included.
    pub(super) misses_by_level: Vec<u64>,
    pub(super) misses_by_level_per_10000: Vec<f64>,
    pub(super) promised_speed_m_s: f32,
    pub(super) promised_radius_m: f32,
    /// At the flight's own speed.
    pub(super) promised_radius_at_speed_m: f32,
    /// The same of every level; nothing where the level is held whole.
    pub(super) promised_radius_by_level_at_speed_m: Vec<Option<f32>>,
    pub(super) promised_tick_rate_hz: f32,
    /// Part of its budgets that a tick could spend in the end.
    pub(super) effort: f32,
    pub(super) promised_tile_mb_s: f32,
    pub(super) promised_recovery_s: f32,
    pub(super) probed_frames: u64,
    /// Of those, with no light at all below the camera.
    pub(super) dark_frames: u64,
    pub(super) frame_ms_p50: f64,
    pub(super) frame_ms_p99: f64,
    pub(super) frame_ms_max: f64,
    pub(super) latency_ms_p50: Option<f64>,
    pub(super) latency_ms_p99: Option<f64>,
    pub(super) teleports: u64,
    pub(super) teleports_lit: u64,
    pub(super) teleport_to_light_ms_p50: Option<f64>,
    pub(super) teleport_to_light_ms_p99: Option<f64>,
    /// By this process from storage.
    pub(super) read_mb_s: f64,
    /// Of tiles taken by the engine, as they are on disk.
    pub(super) tile_mb_s: f64,
    /// Bytes from storage a byte of tiles taken: below one where pages were in memory, above where more was read than used.
    pub(super) read_amplification: f64,
    pub(super) dropped_bytes: u64,
    /// Most resident memory of the process in the lap: server, client and mapped tiles.
    pub(super) rss_first_lap_bytes: u64,
    pub(super) rss_last_lap_bytes: u64,
    pub(super) rss_by_lap_bytes: Vec<u64>,
    /// The same without mapped files, whose pages come and go with the system's cache.
    pub(super) anonymous_by_lap_bytes: Vec<u64>,
    /// By lap: who held it when most was resident.
    pub(super) memory: Vec<LapMemory>,
    pub(super) drift_rel: f64,
    pub(super) far_share: f32,
    pub(super) fed_share: f32,
    pub(super) evicted_chunks: u64,
    pub(super) files: Vec<PathBuf>,
}

impl Figures {
    pub(super) fn of(arguments: &FlightArguments, flown: &Flown, files: Vec<PathBuf>) -> Self {
        let (report, promise) = (&flown.report, flown.observer.promise());
        let stats = flown.observer.stats();
        let counters = &stats.counters;
        let speed_m_s = if arguments.teleports { 0.0 } else { arguments.speed };
        let levels = counters.misses_by_level.iter().rposition(|&count| count > 0).map_or(1, |last| last + 1);
        let misses_by_level = counters.misses_by_level[..levels].to_vec();
        let ticks = counters.ticks;
        let mut times: Vec<f64> = flown.ticks.iter().map(|tick| tick.tick_s * 1e3).collect();
        times.sort_by(f64::total_cmp);
        let quantile = |share| if times.is_empty() { 0.0 } else { percentile(&times, share) };
        let (read, tiles) = (flown.footprint.read_bytes() as f64, counters.tile_bytes as f64);
        let session = flown.footprint_session(&stats);
        let rss_by_lap_bytes = flown.footprint.by_lap(|lap| lap.resident_bytes);
        Self {
            transport: "gRPC over loopback, server and client in one process",
            cold: arguments.cold,
            laps: arguments.laps,
            speed_m_s,
            frames: report.frames,
            frames_per_s: report.frames_per_s,
            ticks,
            promised_ticks: counters.promised_ticks,
            violations: counters.violations,
            violations_by_cause: counters.violation_causes.into(),
            misses_by_level_per_10000: misses_by_level
                .iter()
                .map(|&count| count as f64 * 1e4 / ticks.max(1) as f64)
                .collect(),
            misses_by_level,
            promised_speed_m_s: promise.speed_m_s,
            promised_radius_m: promise.radius_m,
            promised_radius_at_speed_m: promise.radius_at(speed_m_s),
            promised_radius_by_level_at_speed_m: (0..promise.level_count())
                .map(|level| Some(promise.radius_of(level, speed_m_s)).filter(|radius| radius.is_finite()))
                .collect(),
            promised_tick_rate_hz: promise.means.tick_rate_hz,
            effort: stats.effort,
            promised_tile_mb_s: promise.tile_bytes_per_s / 1e6,
            promised_recovery_s: promise.recovery_s,
            probed_frames: report.probed_frames,
            dark_frames: report.misses,
            frame_ms_p50: quantile(0.5),
            frame_ms_p99: quantile(0.99),
            frame_ms_max: quantile(1.0),
            latency_ms_p50: report.latency_ms_p50,
            latency_ms_p99: report.latency_ms_p99,
            teleports: report.teleports,
            teleports_lit: report.teleports_lit,
            teleport_to_light_ms_p50: report.teleport_to_light_ms_p50,
            teleport_to_light_ms_p99: report.teleport_to_light_ms_p99,
            read_mb_s: read / flown.seconds / 1e6,
            tile_mb_s: tiles / flown.seconds / 1e6,
            read_amplification: read / tiles.max(1.0),
            dropped_bytes: flown.footprint.dropped_bytes,
            rss_first_lap_bytes: rss_by_lap_bytes.first().copied().unwrap_or(0),
            rss_last_lap_bytes: rss_by_lap_bytes.last().copied().unwrap_or(0),
            rss_by_lap_bytes,
            anonymous_by_lap_bytes: flown.footprint.by_lap(|lap| lap.anonymous_bytes),
            memory: flown.footprint.laps.clone(),
            drift_rel: report.server_matrix_drift.unwrap_or(0.0),
            far_share: session.0,
            fed_share: session.1,
            evicted_chunks: counters.evicted,
            files,
        }
    }
}

impl Flown {
    /// Far share and what is fed of it, as the client heard last: the session is gone when the flight is over.
    fn footprint_session(&self, stats: &earthshine_server::EngineStats) -> (f32, f32) {
        let open = stats.sessions.first().map(|session| (session.far_share, session.fed_share));
        let heard = self.report.server_far_share.zip(self.report.server_fed_share);
        open.or(heard.map(|(far, fed)| (far as f32, fed as f32))).unwrap_or_default()
    }
}

/// Frame time, and what was missing, over time.
pub(super) fn charts(flown: &Flown) -> [Chart; 2] {
    let start_s = flown.ticks.first().map_or(0.0, |tick| tick.time_s);
    let step = flown.ticks.len().div_ceil(CHART_POINTS_MAX).max(1);
    // The worst of each step: a single long tick must show.
    let over_time = |of: &dyn Fn(&earthshine_server::TickSample) -> f64| {
        let worst = |ticks: &[earthshine_server::TickSample]| {
            (ticks[0].time_s - start_s, ticks.iter().map(of).fold(0.0, f64::max))
        };
        flown.ticks.chunks(step).map(worst).collect::<Vec<_>>()
    };
    let chart = |title: &str, label: &str, points| Chart {
        title: title.to_owned(),
        x: Axis { label: "flight, s".to_owned(), scale: Scale::Linear },
        y: Axis { label: label.to_owned(), scale: Scale::Linear },
        series: vec![Series { name: label.to_owned(), points }],
    };
    [
        chart("Tick", "ms", over_time(&|tick| tick.tick_s * 1e3)),
        chart(
            "Missing within the promised radius",
            "patches of level 0",
            over_time(&|tick| f64::from(tick.missing_near)),
        ),
    ]
}
