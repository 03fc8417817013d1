//! `bench gpu`: how light comes back to the host: what changed, when it comes, beside all of it, waited for.
//!
//! Frames at a steady rate, as the engine asks for them. In each another patch shines half as bright again as the others: most
//! of a closed room changes by less than the published code can say.

use clap::Args;
use earthshine_gpu::{GpuBackend, GpuDevice};
use earthshine_radiosity::{Backend, Slot};
use earthshine_world::Rgb;
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Frames whose light comes back.
#[derive(Args)]
pub(super) struct NewsArguments {
    /// Frames of each way.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) news_frames: u32,
    /// Frames a second.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..))]
    news_rate_hz: u32,
}

impl NewsArguments {
    pub(super) fn period(&self) -> Duration {
        Duration::from_secs(1) / self.news_rate_hz
    }
}

/// Means over those frames.
#[derive(Serialize)]
pub(super) struct NewsFigures {
    /// Slots that a frame tells of.
    news_entries: f64,
    /// Bytes of a frame that are copied to the host for it.
    news_bytes: f64,
    /// Bytes of a frame where nothing changed.
    news_settled_bytes: f64,
    /// Bytes of a frame where all light is copied.
    whole_bytes: f64,
    /// How many frames later than its own a frame's light comes.
    news_late_frames: f64,
    /// Frames that waited because too many were on their way.
    news_waits: u64,
    /// How often the host stood still for the device in those frames, by what for.
    frame_waits: BTreeMap<&'static str, u64>,
    /// What the host spends on a step and on taking what has come.
    news_host_ms: f64,
    /// What it spends on a step and on all light of that step, waited for.
    whole_host_ms: f64,
}

/// Of `slots`, which are lit already.
pub(super) fn measure(
    device: &GpuDevice,
    backend: &mut GpuBackend,
    slots: &[Slot],
    arguments: &NewsArguments,
) -> anyhow::Result<NewsFigures> {
    let light = vec![Rgb::ONE; slots.len()];
    backend.set_sources(slots, &light, &light)?;
    backend.step()?;
    let mut all = vec![Rgb::ZERO; slots.len()];
    backend.read_irradiance(slots, &mut all)?;
    let (mut news, mut refused) = (Vec::new(), Vec::new());
    backend.take_news(&mut news)?;
    let (before, waits_before) = (device.news_totals(), device.waits());
    let frames = arguments.news_frames as usize;
    let news_host_ms = host_ms(arguments, 0..frames, slots, backend, |backend| {
        news.clear();
        backend.take_refused(&mut refused)?;
        backend.take_news(&mut news)
    })?;
    let mut frame_waits = device.waits();
    frame_waits.iter_mut().for_each(|(what, count)| *count -= waits_before.get(what).unwrap_or(&0));
    frame_waits.retain(|_, count| *count > 0);
    backend.read_irradiance(slots, &mut all)?;
    let after = device.news_totals();
    let news_settled_bytes = settled_bytes(device, backend, arguments.news_frames)?;
    let whole_host_ms = host_ms(arguments, frames..2 * frames, slots, backend, |backend| {
        backend.read_irradiance(slots, &mut all)
    })?;
    let frames = (after.frames - before.frames).max(1) as f64;
    Ok(NewsFigures {
        news_entries: (after.entries - before.entries) as f64 / frames,
        news_bytes: (after.bytes - before.bytes) as f64 / frames,
        news_settled_bytes,
        whole_bytes: (3 * size_of::<f32>() * backend.capacity().next_multiple_of(64) as usize) as f64,
        news_late_frames: (after.late_frames - before.late_frames) as f64 / frames,
        news_waits: after.waits - before.waits,
        frame_waits,
        news_host_ms,
        whole_host_ms,
    })
}

/// Mean bytes of `frames` steps whose light is that of the step before.
fn settled_bytes(device: &GpuDevice, backend: &mut GpuBackend, frames: u32) -> anyhow::Result<f64> {
    let news = |device: &GpuDevice| device.read_back_bytes().get("news").copied().unwrap_or_default();
    let before = news(device);
    for _ in 0..frames {
        backend.step()?;
        backend.take_news(&mut Vec::new())?;
    }
    Ok((news(device) - before) as f64 / f64::from(frames))
}

/// Mean time of a step and of `take`, ms.
fn host_ms(
    arguments: &NewsArguments,
    frames: std::ops::Range<usize>,
    slots: &[Slot],
    backend: &mut GpuBackend,
    mut take: impl FnMut(&mut GpuBackend) -> Result<(), earthshine_radiosity::BackendError>,
) -> anyhow::Result<f64> {
    let period = arguments.period();
    let mut spent = Duration::ZERO;
    for frame in frames {
        let lamps = [slots[frame % slots.len()], slots[(frame + 1) % slots.len()]];
        backend.set_sources(&lamps, &[Rgb::ONE, Rgb::splat(1.5)], &[Rgb::ONE; 2])?;
        let start = Instant::now();
        backend.step()?;
        take(backend)?;
        let taken = start.elapsed();
        spent += taken;
        std::thread::sleep(period.saturating_sub(taken));
    }
    Ok(spent.as_secs_f64() * 1e3 / f64::from(arguments.news_frames))
}
