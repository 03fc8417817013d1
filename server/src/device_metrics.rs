//! Metrics of a device, if there is one: whether it is there, what its kernels take, what it sends and who waited for it.
//!
//! Read at every scrape. Start at [`registry`].

use crate::device_source::{CurrentDevice, DeviceCounts};
use earthshine_gpu::{NewsTotals, PassTotal};
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric as _};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::ConstCounter;
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::registry::Registry;
use std::collections::BTreeMap;

const PREFIX: &str = "earthshine_gpu";

/// All that there is to say of the device now.
pub(crate) fn registry(current: &CurrentDevice) -> Registry {
    let mut registry = Registry::with_prefix(PREFIX);
    let device = current.get();
    let is_there = device.as_ref().map(|device| !device.is_lost());
    registry.register_collector(Box::new(DeviceCollector { is_there, counts: current.counts() }));
    if let Some(of) = device {
        registry.register_collector(Box::new(PassCollector(of.pass_totals())));
        registry.register_collector(Box::new(NewsCollector(of.news_totals())));
        registry.register_collector(Box::new(WaitsCollector(of.waits())));
        registry.register_collector(Box::new(ReadBackCollector(of.read_back_bytes())));
    }
    registry
}

/// What has become of the device.
#[derive(Debug)]
struct DeviceCollector {
    /// None where the CPU computes; false while a lost device is awaited.
    is_there: Option<bool>,
    counts: DeviceCounts,
}

impl Collector for DeviceCollector {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), std::fmt::Error> {
        let Some(is_there) = self.is_there else { return Ok(()) };
        let help = "1 where there is a device, 0 while the CPU stands in";
        let metric = encoder.encode_descriptor("device_ready", help, None, MetricType::Gauge)?;
        ConstGauge::new(i64::from(is_there)).encode(metric)?;
        let DeviceCounts { reopened, failed, left_to_cpu } = self.counts;
        let counters = [
            ("devices_reopened", "Devices opened after one was lost", reopened),
            ("device_failures", "Attempts to open a lost device again that failed", failed),
            ("lights_left_to_cpu", "Lights over rows left to the CPU, as no kernels draw so", left_to_cpu),
        ];
        for (name, help, value) in counters {
            let metric = encoder.encode_descriptor(name, help, None, MetricType::Counter)?;
            ConstCounter::new(value).encode(metric)?;
        }
        Ok(())
    }
}

/// What kernels take on the device, in the frames that are timed.
#[derive(Debug)]
struct PassCollector(BTreeMap<&'static str, PassTotal>);

impl Collector for PassCollector {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), std::fmt::Error> {
        if self.0.is_empty() {
            return Ok(());
        }
        let help = "Time of a kernel in the frames that were timed, one in 64";
        let mut seconds = encoder.encode_descriptor("pass_seconds", help, None, MetricType::Counter)?;
        for (name, total) in &self.0 {
            ConstCounter::new(total.seconds).encode(seconds.encode_family(&[("pass", *name)])?)?;
        }
        let help = "Passes of a kernel in the frames that were timed";
        let mut passes = encoder.encode_descriptor("passes", help, None, MetricType::Counter)?;
        for (name, total) in &self.0 {
            ConstCounter::new(total.count).encode(passes.encode_family(&[("pass", *name)])?)?;
        }
        let known = || self.0.iter().filter(|(_, total)| total.bytes > 0.0);
        let help = "What a kernel moved at least in the frames that were timed";
        let mut bytes = encoder.encode_descriptor("pass_bytes", help, None, MetricType::Counter)?;
        for (name, total) in known() {
            ConstCounter::new(total.bytes).encode(bytes.encode_family(&[("pass", *name)])?)?;
        }
        let help = "Floating-point operations of a kernel in the frames that were timed";
        let mut flops = encoder.encode_descriptor("pass_operations", help, None, MetricType::Counter)?;
        for (name, total) in known() {
            ConstCounter::new(total.flops).encode(flops.encode_family(&[("pass", *name)])?)?;
        }
        Ok(())
    }
}

/// What comes to the host of the light that changed.
#[derive(Debug)]
struct NewsCollector(NewsTotals);

impl Collector for NewsCollector {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), std::fmt::Error> {
        let NewsTotals { frames, entries, bytes, late_frames, waits } = self.0;
        for (name, help, value) in [
            ("news_frames", "Steps whose changed light came to the host", frames),
            ("news_entries", "Slots whose changed light came to the host", entries),
            ("news_bytes", "Bytes that were copied to the host for it", bytes),
            ("news_late_frames", "Ticks between a step and its changed light, in all", late_frames),
            ("news_waits", "Steps that waited because too many were on their way", waits),
        ] {
            let metric = encoder.encode_descriptor(name, help, None, MetricType::Counter)?;
            ConstCounter::new(value).encode(metric)?;
        }
        Ok(())
    }
}

/// How often the host stood still for the device.
#[derive(Debug)]
struct WaitsCollector(BTreeMap<&'static str, u64>);

impl Collector for WaitsCollector {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), std::fmt::Error> {
        let help = "Times that somebody waited for the device; a tick does not";
        let mut waits = encoder.encode_descriptor("waits", help, None, MetricType::Counter)?;
        for (what, &count) in &self.0 {
            ConstCounter::new(count).encode(waits.encode_family(&[("what", *what)])?)?;
        }
        Ok(())
    }
}

#[derive(Debug)]
struct ReadBackCollector(BTreeMap<&'static str, u64>);

impl Collector for ReadBackCollector {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), std::fmt::Error> {
        let help = "Bytes copied from the device to the host, by what they are of";
        let mut bytes = encoder.encode_descriptor("read_back_bytes", help, None, MetricType::Counter)?;
        for (what, &count) in &self.0 {
            ConstCounter::new(count).encode(bytes.encode_family(&[("what", *what)])?)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prometheus_client::encoding::text;

    #[test]
    fn the_text_holds_what_a_device_counts() {
        let passes =
            BTreeMap::from([("send_light", PassTotal { count: 3, seconds: 0.5, bytes: 8e3, flops: 2e3 })]);
        let mut registry = Registry::with_prefix(PREFIX);
        registry.register_collector(Box::new(PassCollector(passes)));
        let counts = DeviceCounts { reopened: 2, failed: 1, left_to_cpu: 4 };
        registry.register_collector(Box::new(DeviceCollector { is_there: Some(false), counts }));
        let news = NewsTotals { frames: 4, entries: 70, bytes: 1184, late_frames: 5, waits: 1 };
        registry.register_collector(Box::new(NewsCollector(news)));
        registry.register_collector(Box::new(WaitsCollector(BTreeMap::from([("light", 2)]))));
        let read_back = BTreeMap::from([("far light", 48), ("news", 1184)]);
        registry.register_collector(Box::new(ReadBackCollector(read_back)));
        let mut text = String::new();
        text::encode_registry(&mut text, &registry).unwrap();
        for line in [
            "earthshine_gpu_pass_seconds_total{pass=\"send_light\"} 0.5",
            "earthshine_gpu_passes_total{pass=\"send_light\"} 3",
            "earthshine_gpu_pass_bytes_total{pass=\"send_light\"} 8000.0",
            "earthshine_gpu_pass_operations_total{pass=\"send_light\"} 2000.0",
            "earthshine_gpu_device_ready 0",
            "earthshine_gpu_devices_reopened_total 2",
            "earthshine_gpu_device_failures_total 1",
            "earthshine_gpu_lights_left_to_cpu_total 4",
            "earthshine_gpu_news_frames_total 4",
            "earthshine_gpu_news_entries_total 70",
            "earthshine_gpu_news_bytes_total 1184",
            "earthshine_gpu_news_late_frames_total 5",
            "earthshine_gpu_news_waits_total 1",
            "earthshine_gpu_waits_total{what=\"light\"} 2",
            "earthshine_gpu_read_back_bytes_total{what=\"far light\"} 48",
            "earthshine_gpu_read_back_bytes_total{what=\"news\"} 1184",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} is not in\n{text}");
        }
    }
}
