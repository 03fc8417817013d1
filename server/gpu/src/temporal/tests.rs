//! Tables and frames of draws against the CPU's own, on whatever adapter there is.

use super::*;
use crate::AdapterChoice;
use earthshine_radiosity::solver::sampler::{RowDraw, sky_part};
use earthshine_radiosity::solver::temporal::{Scene, drawn};
use earthshine_radiosity::tables::draw::{Spread, row_key};
use earthshine_radiosity::tables::masses::total_of;
use earthshine_radiosity::tables::{AliasTable, BuildRoom, CdfTable, RowTable};
use earthshine_world::random::{Purpose, hash, unit_f32};
use std::io::Write as _;

/// Slots, around the width of a workgroup; and one row far longer than a section.
const SIZES: [usize; 6] = [0, 1, 63, 64, 65, 300];
const LONG: usize = 9000;

fn device_or_skip() -> Option<GpuDevice> {
    match GpuDevice::open(&AdapterChoice { allow_software: true, ..AdapterChoice::default() }) {
        Ok(device) => Some(device),
        Err(error) => {
            assert!(std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none(), "{error}");
            // Past the test harness, which swallows what passing tests print.
            writeln!(std::io::stderr(), "SKIPPED a test of tables: {error}").expect("standard error");
            None
        }
    }
}

fn random(purpose: u64, at: u64) -> f32 {
    unit_f32(hash(7, Purpose::Simulation, at, purpose))
}

fn light(purpose: u64, count: usize, scale: f32) -> Vec<Rgb> {
    let channel = |at: usize, c: u64| random(purpose + c, at as u64) * scale;
    (0..count).map(|at| Rgb::new(channel(at, 0), channel(at, 1), channel(at, 2))).collect()
}

/// Rows of every kind: free slots, rows without links, closed ones, with and without sky.
fn rows(count: usize) -> Vec<TemporalRow> {
    let row = |slot: usize| {
        let key = slot as u64;
        let share = 0.9 * random(1, key) / (0.5 * count as f32);
        let sees = |other: &usize| !(slot + other).is_multiple_of(3) && *other != slot;
        let of = |other: usize| (other as u32, share * (0.1 + random(2, (slot * count + other) as u64)));
        let links = match slot % 7 {
            3 => None,
            5 => Some(Vec::new()),
            _ => Some((0..count).filter(sees).map(of).collect()),
        };
        let sky_share = if slot.is_multiple_of(2) { 0.0 } else { random(3, key) };
        TemporalRow { links, sky_share, reflectance: light(4, 1, 0.9)[0] }
    };
    (0..count).map(row).collect()
}

/// One row that sees every other slot, some of them many times, more than a section holds.
fn long_rows() -> Vec<TemporalRow> {
    let mut rows = rows(40);
    let links = (0..LONG).map(|at| ((at % 40) as u32, random(9, at as u64) / LONG as f32)).collect();
    rows[8].links = Some(links);
    rows
}

/// The twin of everything.
struct Twin<T> {
    rows: Vec<RowDraw<T>>,
    weights: Vec<f32>,
}

impl<T: RowTable + Clone> Twin<T> {
    fn new(rows: &[TemporalRow]) -> Self {
        let mut twin = Self { rows: Vec::new(), weights: Vec::new() };
        for row in rows {
            let mut draw = RowDraw { table: T::default(), outcomes: Vec::new() };
            if let Some(links) = &row.links {
                let mut weights: Vec<f32> = links.iter().map(|&(_, share)| share).collect();
                let outside = 1.0 - total_of(&weights);
                let sky = sky_part(outside, row.sky_share);
                weights.extend([outside - sky, sky]);
                draw.table.rebuild(&weights, &mut BuildRoom::default()).expect("finite weights");
                draw.outcomes = links.iter().map(|&(other, _)| other).chain([FAR, SKY]).collect();
                twin.weights.extend(weights);
            }
            twin.rows.push(draw);
        }
        twin
    }

    fn live(&self, rows: &[TemporalRow], sources: [&[Rgb]; 3], settings: &SolverSettings) -> Vec<Light> {
        let of = |rgb: Rgb| rgb.extend(0.0).to_array();
        let over = |light: Rgb, share: f32| if share > 0.0 { of(light / share) } else { [0.0; 4] };
        let [own, outside, sky] = sources;
        let (mut far_draws, mut sky_draws) = (Vec::new(), Vec::new());
        let mut at = 0;
        for (slot, row) in self.rows.iter().enumerate() {
            at += row.outcomes.len();
            let shares =
                if row.outcomes.is_empty() { [0.0; 2] } else { [at - 2, at - 1].map(|i| self.weights[i]) };
            let from_sky = if shares[1] > 0.0 { sky[slot] } else { Rgb::ZERO };
            far_draws.push(over((outside[slot] - from_sky).max(Rgb::ZERO), shares[0]));
            sky_draws.push(over(from_sky, shares[1]));
        }
        let spread = if settings.method == Method::Alias { Spread::Independent } else { Spread::Systematic };
        let mut light = vec![[0.0f32; 4]; rows.len()];
        for frame in 0..FRAMES {
            let send =
                |slot: usize| of(own[slot] + rows[slot].reflectance * Rgb::from_slice(&light[slot][..3]));
            let sent: Vec<Light> = (0..rows.len()).map(send).collect();
            let scene = Scene { sent: &sent, far: &far_draws, sky: &sky_draws, outside: &[] };
            for (slot, row) in self.rows.iter().enumerate().filter(|(_, row)| !row.outcomes.is_empty()) {
                let key = row_key(settings.seed, frame, slot as u32);
                let now = drawn(row, scene, slot, key, settings.samples_per_row, spread).irradiance;
                for (old, now) in light[slot].iter_mut().zip(now) {
                    *old = settings.history_weight * *old + (1.0 - settings.history_weight) * now;
                }
            }
        }
        light
    }
}

const FRAMES: u32 = 4;

/// Builds and draws on the device and on the CPU.
fn compare<T: RowTable + Clone>(
    device: &GpuDevice,
    method: Method,
    rows: &[TemporalRow],
    words_of: impl Fn(&Twin<T>) -> Vec<u32>,
) {
    let count = rows.len();
    let mut temporal = GpuTemporal::new(device, method, rows).expect("small rows");
    temporal.rebuild().expect("a device that works");
    let twin = Twin::<T>::new(rows);
    let (words, weights) = temporal.read_tables().expect("a device that works");
    // Buffers are rounded up.
    assert!(weights[..twin.weights.len()] == twin.weights, "{method} {count}: what is outside");
    let expected = words_of(&twin);
    assert!(words.len() >= expected.len());
    let bins = words.iter().zip(&expected).position(|(found, expected)| found != expected);
    assert_eq!(bins, None, "{method} {count}: words of tables");

    let (own, outside) = (light(20, count, 5.0), light(30, count, 1.0));
    let sky: Vec<Rgb> = outside.iter().map(|light| *light * 0.4).collect();
    temporal.set_light(&own, &outside, &sky).expect("sound light");
    let settings =
        SolverSettings { method, samples_per_row: 13, history_weight: 0.75, ..SolverSettings::default() };
    for frame in 0..FRAMES {
        temporal.step(&settings, frame).expect("a device that works");
    }
    let found = temporal.read().expect("a device that works");
    let expected = twin.live(rows, [&own, &outside, &sky], &settings);
    for (slot, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let expected = Rgb::from_slice(&expected[..3]);
        let gap = (*found - expected).abs().max_element();
        assert!(gap <= 2e-6 * expected.max_element(), "{method} {count}, {slot}: {found}, {expected}");
    }
}

fn alias_words(twin: &Twin<AliasTable>) -> Vec<u32> {
    twin.rows.iter().flat_map(|row| row.table.bins().iter().map(|bin| bin.0)).collect()
}

#[test]
fn alias_tables_and_draws_are_the_cpus() {
    let Some(device) = device_or_skip() else { return };
    for rows in SIZES.map(rows).into_iter().chain([long_rows()]) {
        compare::<AliasTable>(&device, Method::Alias, &rows, alias_words);
    }
}

#[test]
fn cumulative_tables_and_draws_are_the_cpus() {
    let Some(device) = device_or_skip() else { return };
    for rows in SIZES.map(rows).into_iter().chain([long_rows()]) {
        // Ends first, in a buffer of 32 bytes at least and rounded up to 16, then guides.
        compare::<CdfTable>(&device, Method::Cdf, &rows, |twin| {
            let of = |words: fn(&CdfTable) -> &[u32]| -> Vec<u32> {
                twin.rows.iter().flat_map(|row| words(&row.table).iter().copied()).collect()
            };
            let mut words = of(CdfTable::ends);
            words.resize(words.len().max(8).next_multiple_of(4), 0);
            words.extend(of(|table| table.guide().0));
            words
        });
    }
}

#[test]
fn rows_and_light_that_cannot_be_are_refused_on_the_host() {
    let Some(device) = device_or_skip() else { return };
    let row = |links, sky_share| TemporalRow { links: Some(links), sky_share, reflectance: Rgb::ZERO };
    for share in [f32::NAN, -0.1, 1.5] {
        let links = GpuTemporal::new(&device, Method::Cdf, &[row(vec![(0, share)], 0.0)]);
        assert!(matches!(links, Err(BackendError::Share(Slot(0), _))), "{share}");
        let sky = GpuTemporal::new(&device, Method::Cdf, &[row(vec![(0, 0.5)], share)]);
        assert!(matches!(sky, Err(BackendError::Share(Slot(0), _))), "{share}");
    }
    let beyond = GpuTemporal::new(&device, Method::Alias, &[row(vec![(3, 0.5)], 0.0)]);
    assert!(matches!(beyond, Err(BackendError::SlotOutside(Slot(3), 1))));
    let mut temporal = GpuTemporal::new(&device, Method::Alias, &[row(vec![(0, 0.5)], 0.0)]).expect("a row");
    let bright = [Rgb::splat(f32::INFINITY)];
    assert!(temporal.set_light(&bright, &[Rgb::ZERO], &[Rgb::ZERO]).is_err());
    assert!(temporal.set_light(&[Rgb::ZERO], &bright, &[Rgb::ZERO]).is_err());
    let none = SolverSettings { samples_per_row: 0, ..SolverSettings::default() };
    assert!(matches!(temporal.step(&none, 0), Err(BackendError::Settings(_))));
}
