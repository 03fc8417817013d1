//! A matrix over its life on a device: the same life gives the same bits, and hundreds of blocks that come and go leave light
//! that a fresh solve has; what is no number gets no further than the host.

use crate::twins::device_or_skip;
use crate::{AdapterChoice, GpuBackend, GpuDevice};
use earthshine_radiosity::bench::Streamed;
use earthshine_radiosity::closed_box::ClosedBox;
use earthshine_radiosity::{Backend, BackendError, Slot, Update};
use earthshine_world::Rgb;
use std::collections::BTreeMap;

const SLOTS: u32 = 128;
const BLOCK: usize = 32;
/// Blocks that leave and enter in a soak.
const SWAPS: usize = 500;
/// Drift that so many swaps may leave: each rounds what it leaves by some 1e-7.
const SOAKED_DRIFT_MAX: f32 = 1e-4;
/// Drift that a repair leaves, and how far light is from a fresh solve then, as a share.
const REPAIRED_MAX: f32 = 1e-5;

fn streamed(seed: u64) -> Streamed {
    Streamed::new(ClosedBox::new(SLOTS as usize + BLOCK, seed), SLOTS as usize, seed)
}

/// Light of everybody from seeded sources.
fn light(backend: &mut GpuBackend, streamed: &Streamed) -> Vec<Rgb> {
    let slots = streamed.taken();
    let own: Vec<Rgb> = slots.iter().map(|&slot| streamed.source(slot)).collect();
    let outside: Vec<Rgb> = own.iter().map(|light| *light * 0.25).collect();
    backend.set_sources(&slots, &own, &outside).expect("taken slots");
    backend.step().expect("a device that works");
    let mut irradiance = vec![Rgb::NAN; slots.len()];
    backend.read_irradiance(&slots, &mut irradiance).expect("taken slots");
    irradiance
}

fn repair(backend: &mut GpuBackend) {
    while !backend.repair(BLOCK as u32).expect("a device that works").is_complete {}
}

/// All that a device says in a life: blocks enter and leave, light, probes, a repair, a fresh solve.
fn life(device: &GpuDevice) -> Vec<u32> {
    let (mut streamed, mut said) = (streamed(3), Vec::new());
    let mut backend = GpuBackend::new(device, SLOTS).expect("a small matrix");
    let mut say = |backend: &mut GpuBackend, streamed: &Streamed| {
        said.extend(light(backend, streamed).iter().flat_map(Rgb::to_array).map(f32::to_bits));
        said.push(backend.drift(9).to_bits());
    };
    for (leaving, entering) in [(0, 100), (40, 20), (7, 33), (32, 32)] {
        backend.apply(&streamed.leave(leaving)).expect("residents");
        backend.apply(&streamed.enter(entering)).expect("free slots");
        say(&mut backend, &streamed);
    }
    repair(&mut backend);
    say(&mut backend, &streamed);
    backend.resolve().expect("a device that works");
    say(&mut backend, &streamed);
    said
}

/// Goal: the same calls give the same bits on the same device, planes whole and split.
#[test]
fn the_same_life_gives_the_same_bits() {
    let Some(whole) = device_or_skip() else { return };
    let choice = AdapterChoice { allow_software: true, ..AdapterChoice::default() };
    let split = GpuDevice::open_splitting(&choice, 2 << 14).expect("there was one");
    for device in [whole, split] {
        let first = life(&device);
        assert!(first.len() > 6 * 3 * 100 && first.iter().any(|&bits| bits != 0));
        assert!(first == life(&device), "another life");
    }
}

/// Goal: a matrix stays of use however long patches stream through it. Method: some hundred swaps of a block; drift is below
/// its bound, a repair brings it to rounding, and light is that of a fresh solve in `f64`.
#[test]
fn a_soak_drifts_little_and_a_repair_makes_it_exact() {
    let Some(device) = device_or_skip() else { return };
    let mut streamed = streamed(5);
    let mut backend = GpuBackend::new(&device, SLOTS).expect("a small matrix");
    let mut reflectance = BTreeMap::new();
    let mut enter = |backend: &mut GpuBackend, updates: Vec<Update>| {
        for update in &updates {
            if let Update::Add { slot, reflectance: of, .. } = update {
                reflectance.insert(*slot, *of);
            }
        }
        assert_eq!(backend.apply(&updates).expect("free slots").added as usize, updates.len());
    };
    enter(&mut backend, streamed.enter(SLOTS as usize));
    for swap in 0..SWAPS {
        backend.apply(&streamed.leave(BLOCK)).expect("residents");
        enter(&mut backend, streamed.enter(BLOCK));
        // The device is not to be handed all of it at once.
        if swap % 16 == 0 {
            light(&mut backend, &streamed);
        }
    }
    let soaked = backend.drift(1);
    assert!(soaked < SOAKED_DRIFT_MAX, "{soaked:e} after {SWAPS} swaps");
    repair(&mut backend);
    let repaired = backend.drift(1);
    assert!(repaired < REPAIRED_MAX.min(soaked), "{repaired:e} of {soaked:e}");
    let found = light(&mut backend, &streamed);
    let (mut gap, mut norm) = (0.0f64, 0.0f64);
    for channel in 0..3 {
        let slots = streamed.taken();
        let own = |slot: &Slot| f64::from(streamed.source(*slot)[channel]);
        let sent: Vec<f64> = slots
            .iter()
            .map(|slot| own(slot) * (1.0 + 0.25 * f64::from(reflectance[slot][channel])))
            .collect();
        let received = streamed.solved(channel).expect("a small room").multiply(&sent);
        for ((found, slot), received) in found.iter().zip(&slots).zip(received) {
            let expected = received + 0.25 * own(slot);
            gap += (f64::from(found[channel]) - expected).powi(2);
            norm += expected.powi(2);
        }
    }
    let error = (gap / norm).sqrt();
    assert!(error < f64::from(REPAIRED_MAX), "{error:e}");
}

/// Goal: what is no number is refused by name before anything is uploaded, and changes nothing.
#[test]
fn numbers_that_are_none_are_refused_by_name() {
    let Some(device) = device_or_skip() else { return };
    let mut backend = GpuBackend::new(&device, 8).expect("a small matrix");
    let add = |slot: u32, reflectance: f32, share: f32| Update::Add {
        slot: Slot(slot),
        reflectance: Rgb::new(0.5, reflectance, 0.5),
        area: 1.0,
        row: vec![(Slot(slot), share)],
        column: vec![],
    };
    backend.apply(&[add(0, 0.5, 0.5)]).expect("a free slot");
    let lit = |backend: &mut GpuBackend| {
        backend.set_sources(&[Slot(0)], &[Rgb::ONE], &[Rgb::ZERO]).expect("taken");
        backend.step().expect("a device that works");
        let mut light = [Rgb::NAN];
        backend.read_irradiance(&[Slot(0)], &mut light).expect("taken");
        light
    };
    let before = lit(&mut backend);
    let share = backend.apply(&[add(1, 0.5, f32::NAN)]);
    assert!(matches!(share, Err(BackendError::Share(Slot(1), of)) if of.is_nan()), "{share:?}");
    for reflectance in [f32::NAN, f32::INFINITY] {
        let refused = backend.apply(&[add(2, 0.5, 0.5), add(1, reflectance, 0.5)]);
        assert_eq!(refused, Err(BackendError::NotFinite(Slot(1))));
    }
    for light in [f32::NAN, f32::INFINITY] {
        let refused = backend.set_sources(&[Slot(0)], &[Rgb::splat(light)], &[Rgb::ZERO]);
        assert_eq!(refused, Err(BackendError::NotFinite(Slot(0))));
    }
    assert!(!backend.is_taken(Slot(1)) && !backend.is_taken(Slot(2)));
    assert_eq!(lit(&mut backend), before);
}
