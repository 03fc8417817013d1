//! What a flight measured.

use crate::probe::Found;
use hdrhistogram::Histogram;
use serde::Serialize;
use std::time::Duration;

/// A flight in numbers. Latencies run from a camera to the first light that answers it.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct FlyReport {
    /// Of the path, without connecting, s.
    pub duration_s: f64,
    /// Camera steps.
    pub camera_updates: u64,
    /// Whole states of light received.
    pub frames: u64,
    /// Of them a second.
    pub frames_per_s: f64,
    /// Bytes of messages received.
    pub bytes: u64,
    /// Of them a second.
    pub bytes_per_s: f64,
    /// Cameras that were answered.
    pub latencies: u64,
    /// Half of the cameras were answered faster, ms; absent without latencies.
    pub latency_ms_p50: Option<f64>,
    /// 90 % were answered faster, ms.
    pub latency_ms_p90: Option<f64>,
    /// 99 % were answered faster, ms.
    pub latency_ms_p99: Option<f64>,
    /// The slowest, ms.
    pub latency_ms_max: Option<f64>,
    /// From before connecting to the first light with a patch in it, ms; absent if none came.
    pub first_light_ms: Option<f64>,
    /// Camera steps after the first light whose probes were asked.
    pub probed_frames: u64,
    /// Of them those with missing light; [`crate::Probes`] says when.
    pub misses: u64,
    /// Probes asked.
    pub probes: u64,
    /// Of them those without light.
    pub dark_probes: u64,
    /// Mean over the others of how much of what is around them their light rests on, 0..=1.
    pub quality: Option<f64>,
    /// Mean of the part of that which coarse levels stand for.
    pub far_share: Option<f64>,
    /// Mean share of what they read whose direct light was out of date.
    pub stale_share: Option<f64>,
    /// Jumps of the camera, the first place not counted.
    pub teleports: u64,
    /// Of them those that got light at their new place before the next jump or the end.
    pub teleports_lit: u64,
    /// Half of those were lit faster, ms.
    pub teleport_to_light_ms_p50: Option<f64>,
    /// 99 % of those were lit faster, ms.
    pub teleport_to_light_ms_p99: Option<f64>,
    /// The slowest of those, ms.
    pub teleport_to_light_ms_max: Option<f64>,
    /// Camera steps at which the server's light was settled.
    pub settled_frames: u64,
    /// Camera steps at which light of level 0 was missing within the promised radius.
    pub incomplete_frames: u64,
    /// What the server promises: light of level 0 within this radius, m; 0 for no promise.
    pub promised_radius_m: Option<f64>,
    /// Up to this speed, m/s.
    pub promised_speed_m_s: Option<f64>,
    /// The server's last word on how many of its ticks broke the promise to this camera.
    pub promise_violations: Option<u64>,
    /// Mean share of what the resident patches see that is not resident, the server's last word.
    pub server_far_share: Option<f64>,
    /// Mean of what coarse levels bring of it.
    pub server_fed_share: Option<f64>,
    /// Patches in the last light.
    pub last_patches: u64,
    /// The server's last word on its tick, ms.
    pub server_tick_ms: Option<f64>,
    /// Largest relative difference of the server's matrix from a fresh solve, last measured.
    pub server_matrix_drift: Option<f64>,
    /// The last complaint of the server that did not end the session.
    pub warning: Option<String>,
}

/// Durations in microseconds, three digits, up to an hour.
pub(crate) struct Latencies(Histogram<u64>);

impl Latencies {
    const MICROSECONDS_MAX: u64 = 3_600_000_000;

    pub(crate) fn new() -> Self {
        let histogram = Histogram::new_with_bounds(1, Self::MICROSECONDS_MAX, 3);
        Self(histogram.expect("1 to an hour with three digits are bounds that a histogram takes"))
    }

    pub(crate) fn record(&mut self, duration: Duration) {
        self.0.saturating_record(u64::try_from(duration.as_micros()).unwrap_or(u64::MAX));
    }

    pub(crate) fn count(&self) -> u64 {
        self.0.len()
    }

    /// ms; `None` while there are none.
    pub(crate) fn quantile_ms(&self, quantile: f64) -> Option<f64> {
        (!self.0.is_empty()).then(|| self.0.value_at_quantile(quantile) as f64 / 1000.0)
    }
}

impl FlyReport {
    pub(crate) fn probed(&mut self, found: Found) {
        self.probed_frames += 1;
        self.misses += u64::from(found.is_miss);
        self.probes += found.asked;
        self.dark_probes += found.dark;
        let lit = (self.probes - self.dark_probes) as f64;
        let new = (found.asked - found.dark) as f64;
        let add = |mean: &mut Option<f64>, sum: f64| {
            if new > 0.0 {
                let before = mean.unwrap_or(0.0);
                *mean = Some(before + (sum - new * before) / lit);
            }
        };
        add(&mut self.quality, found.quality);
        add(&mut self.far_share, found.far_share);
        add(&mut self.stale_share, found.stale_share);
    }

    pub(crate) fn set_latencies(&mut self, answers: &Latencies, teleports: &Latencies) {
        self.latencies = answers.count();
        self.latency_ms_p50 = answers.quantile_ms(0.5);
        self.latency_ms_p90 = answers.quantile_ms(0.9);
        self.latency_ms_p99 = answers.quantile_ms(0.99);
        self.latency_ms_max = answers.quantile_ms(1.0);
        self.teleports_lit = teleports.count();
        self.teleport_to_light_ms_p50 = teleports.quantile_ms(0.5);
        self.teleport_to_light_ms_p99 = teleports.quantile_ms(0.99);
        self.teleport_to_light_ms_max = teleports.quantile_ms(1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goodness_is_the_mean_over_probes_with_light() {
        let mut report = FlyReport::default();
        report.probed(Found { asked: 2, dark: 2, is_miss: true, ..Found::default() });
        assert_eq!(report.quality, None);
        report.probed(Found { asked: 3, dark: 1, quality: 1.0, far_share: 0.5, ..Found::default() });
        report.probed(Found { asked: 1, quality: 1.0, stale_share: 0.75, ..Found::default() });
        let near = |mean: Option<f64>, expected: f64| (mean.unwrap() - expected).abs() < 1e-12;
        assert!(near(report.quality, 2.0 / 3.0) && near(report.far_share, 0.5 / 3.0), "{report:?}");
        assert!(near(report.stale_share, 0.25), "{report:?}");
    }

    #[test]
    fn percentiles_are_of_milliseconds() {
        let mut latencies = Latencies::new();
        assert_eq!(latencies.quantile_ms(0.5), None);
        for ms in 1..=100 {
            latencies.record(Duration::from_millis(ms));
        }
        latencies.record(Duration::MAX);
        let p50 = latencies.quantile_ms(0.5).unwrap();
        assert!((50.0..=52.0).contains(&p50), "{p50}");
        assert!(latencies.quantile_ms(1.0).unwrap() >= 3_599_000.0);
    }

    #[test]
    fn keys_are_snake_case_with_units_last() {
        let text = serde_json::to_string(&FlyReport::default()).unwrap();
        for key in ["latency_ms_p50", "latency_ms_p99", "bytes_per_s", "frames", "misses", "first_light_ms"] {
            assert!(text.contains(&format!("\"{key}\":")), "{key}");
        }
    }
}
