//! `bench gpu`: a frame of temporal radiosity on a device, and the tables it draws from.
//!
//! Rows are seeded and as long as asked for; what they are is of no matter to the time, but for how far apart they look.

use clap::Args;
use earthshine_gpu::temporal::{GpuTemporal, TemporalRow};
use earthshine_gpu::{GpuDevice, PassTime};
use earthshine_radiosity::solver::{Method, SolverSettings};
use earthshine_world::Rgb;
use earthshine_world::random::{Purpose, hash, unit_f32};
use std::time::Instant;

/// What is drawn.
#[derive(Args)]
pub(super) struct StepArguments {
    /// Patches whose light is drawn.
    #[arg(long, default_value_t = 10_422, value_parser = clap::value_parser!(u32).range(1..))]
    patches: u32,
    /// Form factors of each of their rows.
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    links: u32,
    /// Draws a row and frame.
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=4096))]
    k: u32,
}

/// The quickest of some rounds, ms: by the device's own clock where it has one, else with the wait for it.
pub(super) struct StepFigures {
    /// What leaves patches, and draws from cumulative tables.
    pub(super) step_ms: f64,
    /// The same from alias tables.
    pub(super) alias_step_ms: f64,
    /// All cumulative tables, from form factors on.
    pub(super) cdf_build_ms: f64,
    /// All passes of all rounds.
    pub(super) passes: Vec<PassTime>,
}

/// Measures both kinds of tables.
pub(super) fn measure(
    device: &GpuDevice,
    arguments: &StepArguments,
    rounds: u32,
    seed: u64,
) -> anyhow::Result<StepFigures> {
    let rows = rows(arguments, seed);
    let mut passes = Vec::new();
    let [cdf, alias] = [Method::Cdf, Method::Alias]
        .map(|method| drawn(device, arguments, method, &rows, rounds, &mut passes));
    let ((step_ms, cdf_build_ms), (alias_step_ms, _)) = (cdf?, alias?);
    Ok(StepFigures { step_ms, alias_step_ms, cdf_build_ms, passes })
}

fn rows(arguments: &StepArguments, seed: u64) -> Vec<TemporalRow> {
    let number = |row: u32, link: u32, what: u64| {
        hash(seed, Purpose::Simulation, u64::from(row) << 32 | u64::from(link), what)
    };
    let of_row = |row: u32| {
        let of_link = |link: u32| {
            let column = (number(row, link, 1) % u64::from(arguments.patches)) as u32;
            (column, 0.9 * unit_f32(number(row, link, 2)) / arguments.links as f32)
        };
        let links = Some((0..arguments.links).map(of_link).collect());
        TemporalRow { links, sky_share: 0.1, reflectance: Rgb::splat(0.5) }
    };
    (0..arguments.patches).map(of_row).collect()
}

/// A frame and a build of one kind of table, ms.
fn drawn(
    device: &GpuDevice,
    arguments: &StepArguments,
    method: Method,
    rows: &[TemporalRow],
    rounds: u32,
    passes: &mut Vec<PassTime>,
) -> anyhow::Result<(f64, f64)> {
    let mut temporal = GpuTemporal::new(device, method, rows)?;
    let is_timed = temporal.time_passes()?;
    temporal.rebuild()?;
    let light = vec![Rgb::ONE; rows.len()];
    temporal.set_light(&light, &light, &light)?;
    let settings = SolverSettings { method, samples_per_row: arguments.k, ..SolverSettings::default() };
    let mut quickest = |run: &mut dyn FnMut(&mut GpuTemporal) -> anyhow::Result<()>| {
        let mut best = f64::INFINITY;
        for _ in 0..rounds.max(1) {
            temporal.finish()?;
            passes.extend(temporal.take_times()?);
            let start = Instant::now();
            run(&mut temporal)?;
            temporal.finish()?;
            let wall_ms = start.elapsed().as_secs_f64() * 1e3;
            let times = temporal.take_times()?;
            let ms = if is_timed { times.iter().map(|pass| pass.ms).sum() } else { wall_ms };
            best = best.min(ms);
            passes.extend(times);
        }
        anyhow::Ok(best)
    };
    let mut frame = 0;
    let step_ms = quickest(&mut |temporal| {
        frame += 1;
        Ok(temporal.step(&settings, frame)?)
    })?;
    let build_ms = quickest(&mut |temporal| Ok(temporal.rebuild()?))?;
    Ok((step_ms, build_ms))
}
