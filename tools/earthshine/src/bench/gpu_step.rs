//! `bench gpu`: a frame of temporal radiosity on a device, and the tables it draws from; passes of the other methods.
//!
//! Rows are seeded and as long as asked for; what they are is of no matter to the time, but for how far apart they look.

use clap::Args;
use earthshine_gpu::{GpuDevice, GpuRowLight, PassTime};
use earthshine_radiosity::solver::row_light::{Frame, RowLight as _};
use earthshine_radiosity::solver::{Light, Method, Residents, SolverSettings};
use earthshine_world::Rgb;
use earthshine_world::random::{Purpose, hash, unit_f32};
use std::ops::Range;
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
    let mut residents = residents(arguments, seed);
    let mut passes = Vec::new();
    let [cdf, alias] = [Method::Cdf, Method::Alias]
        .map(|method| drawn(device, arguments, method, &mut residents, rounds, &mut passes));
    let ((step_ms, cdf_build_ms), (alias_step_ms, _)) = (cdf?, alias?);
    // For what their passes take: a bounce, and a frame of shots at light that has just been turned on.
    for method in [Method::Gather, Method::Hybrid] {
        drawn(device, arguments, method, &mut residents, 1, &mut passes)?;
    }
    Ok(StepFigures { step_ms, alias_step_ms, cdf_build_ms, passes })
}

/// Patches of one size, each linked to as many seeded others before it as make up half of its row.
fn residents(arguments: &StepArguments, seed: u64) -> Residents {
    let number = |row: u32, link: u32, what: u64| {
        hash(seed, Purpose::Simulation, u64::from(row) << 32 | u64::from(link), what)
    };
    let slots = arguments.patches as usize;
    let mut residents = Residents::new(slots);
    for row in 0..arguments.patches {
        let of_link = |link: u32| {
            let column = (number(row, link, 1) % u64::from(row.max(1))) as usize;
            (column, 0.9 * unit_f32(number(row, link, 2)) / arguments.links as f32)
        };
        let links = (0..arguments.links.div_ceil(2)).filter(|_| row > 0).map(of_link);
        residents.links.add(row as usize, 1.0, Rgb::splat(0.5), links);
    }
    for light in [&mut residents.direct, &mut residents.outside, &mut residents.sky] {
        light.fill([1.0, 1.0, 1.0, 0.0]);
    }
    residents.sky_shares.fill(0.1);
    residents
}

/// A frame and a build of one kind of table, ms.
fn drawn(
    device: &GpuDevice,
    arguments: &StepArguments,
    method: Method,
    residents: &mut Residents,
    rounds: u32,
    passes: &mut Vec<PassTime>,
) -> anyhow::Result<(f64, f64)> {
    let slots = arguments.patches as usize;
    let settings = SolverSettings {
        method,
        samples_per_row: arguments.k,
        rebuild_items_per_step: u32::MAX,
        ..SolverSettings::default()
    };
    let dark: Vec<Light> = vec![[0.0; 4]; slots];
    let mut light = GpuRowLight::new(device, residents, &settings, &dark)?;
    let is_timed = light.time_passes()?;
    let mut number = 0;
    // The quickest round: passes that build tables, and the others; without timestamps the clock, for both.
    let mut quickest = |light: &mut GpuRowLight, outdates: bool| {
        let (mut best_build, mut best_step) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..rounds.max(1) {
            if outdates {
                (0..slots).for_each(|slot| light.outdate(slot));
            }
            light.finish()?;
            passes.extend(light.take_times()?);
            let start = Instant::now();
            let frame = Frame { settings: &settings, number, order: &[], matrix: None };
            light.advance(residents, frame)?;
            light.finish()?;
            let wall_ms = start.elapsed().as_secs_f64() * 1e3;
            number += 1;
            let times = light.take_times()?;
            let builds = |name: &str| name == "fill_tables" || name.starts_with("build_");
            let sum = |is_build: bool| -> f64 {
                times.iter().filter(|pass| builds(pass.name) == is_build).map(|pass| pass.ms).sum()
            };
            best_build = best_build.min(if is_timed { sum(true) } else { wall_ms });
            best_step = best_step.min(if is_timed { sum(false) } else { wall_ms });
            passes.extend(times);
        }
        anyhow::Ok((best_build, best_step))
    };
    let (build_ms, _) = quickest(&mut light, true)?;
    let (_, step_ms) = quickest(&mut light, false)?;
    swap(&mut light, residents, 0..SWAPPED.min(slots))?;
    let frame = Frame { settings: &settings, number: u32::MAX, order: &[], matrix: None };
    light.advance(residents, frame)?;
    passes.extend(light.take_times()?);
    Ok((step_ms, build_ms))
}

/// Patches that leave and come again, for what that takes.
const SWAPPED: usize = 32;

fn swap(light: &mut GpuRowLight, residents: &mut Residents, slots: Range<usize>) -> anyhow::Result<()> {
    let rows: Vec<Vec<(usize, f32)>> = slots
        .clone()
        .map(|slot| residents.links.row(slot).iter().map(|link| (link.slot as usize, link.share)).collect())
        .collect();
    for slot in slots.clone() {
        light.leave(residents, slot)?;
        residents.remove(slot);
    }
    for (slot, row) in slots.clone().zip(rows) {
        // Who comes later brings the links between the two.
        let there = row.into_iter().filter(|&(other, _)| !slots.contains(&other) || other < slot);
        residents.links.add(slot, 1.0, Rgb::splat(0.5), there);
        light.come(residents, slot)?;
        light.change(residents, slot, &[0.0; 4], &[0.0; 4]);
    }
    Ok(())
}
