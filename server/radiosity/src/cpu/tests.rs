//! The CPU backend against its contract.

use super::*;
use crate::bench::Streamed;
use crate::closed_box::ClosedBox;

fn furnace(patches: usize, reflectance: f32) -> (CpuBackend, Vec<Slot>) {
    let room = ClosedBox::new(patches, 11);
    let mut backend = CpuBackend::new(patches as u32).expect("small");
    for i in 0..patches {
        let row = (0..i).map(|j| (Slot(j as u32), room.form_factor(i, j))).collect();
        let column = (0..i).map(|j| (Slot(j as u32), room.form_factor(j, i))).collect();
        let (slot, reflectance) = (Slot(i as u32), Rgb::splat(reflectance));
        let update = Update::Add { slot, reflectance, area: room.area(i), row, column };
        assert_eq!(backend.apply(&[update]).expect("a new patch").added, 1);
    }
    (backend, (0..patches as u32).map(Slot).collect())
}

fn light_up(backend: &mut CpuBackend, slots: &[Slot], direct: Rgb, outside: Rgb) -> Vec<Rgb> {
    backend.set_sources(slots, &vec![direct; slots.len()], &vec![outside; slots.len()]).expect("taken");
    backend.step().expect("no device to lose");
    let mut irradiance = vec![Rgb::ZERO; slots.len()];
    backend.read_irradiance(slots, &mut irradiance).expect("taken");
    irradiance
}

/// Goal: energy is kept through the whole path. Method: white furnace, `B = E / (1 - rho)`.
#[test]
fn a_white_furnace_is_uniform() {
    for reflectance in [0.5, 0.8] {
        let (mut backend, slots) = furnace(96, reflectance);
        for irradiance in light_up(&mut backend, &slots, Rgb::ONE, Rgb::ZERO) {
            let exitance = Rgb::ONE + reflectance * irradiance;
            assert!((exitance * (1.0 - reflectance) - 1.0).abs().max_element() < 5e-3, "{exitance}");
        }
    }
}

/// Goal: light from outside bounces inside. Method: in a closed room, `I = g + F rho I` is `g / (1 - rho)` when uniform.
#[test]
fn outside_light_bounces_inside() {
    let (mut backend, slots) = furnace(96, 0.5);
    for irradiance in light_up(&mut backend, &slots, Rgb::ZERO, Rgb::new(1.0, 2.0, 0.0)) {
        assert!((irradiance - Rgb::new(2.0, 4.0, 0.0)).abs().max_element() < 2e-2, "{irradiance}");
    }
}

#[test]
fn a_step_recomputes_only_what_changed() {
    let (mut backend, slots) = furnace(40, 0.5);
    let first = light_up(&mut backend, &slots, Rgb::ONE, Rgb::ZERO);
    assert_eq!(backend.step(), Ok(StepStats { lit_columns: 40, recomputed: false }));
    assert_eq!(light_up(&mut backend, &slots, Rgb::ONE, Rgb::ZERO), first, "the same sources are no change");
    assert_eq!(backend.step().map(|stats| stats.recomputed), Ok(false));
    backend.set_sources(&slots[3..], &[Rgb::ZERO; 37], &[Rgb::ZERO; 37]).expect("taken");
    assert_eq!(backend.step(), Ok(StepStats { lit_columns: 3, recomputed: true }));
    backend.apply(&[Update::Remove { slot: slots[1] }]).expect("taken");
    assert_eq!(backend.step(), Ok(StepStats { lit_columns: 2, recomputed: true }));
    backend.apply(&[]).expect("nothing to do");
    assert_eq!(backend.step(), Ok(StepStats { lit_columns: 2, recomputed: false }));
}

/// Goal: whatever the error, nothing has happened. Method: good updates followed by each kind of bad one;
/// light and matrix stay the same to the bit.
/// Goal: after everybody left at once, nothing is left of them. Method: filled again, light has the bits of a fresh backend's.
#[test]
fn who_comes_after_a_clearing_finds_nothing_of_before() {
    let (mut backend, slots) = furnace(70, 0.8);
    let first = light_up(&mut backend, &slots, Rgb::ONE, Rgb::ZERO);
    backend.clear().expect("no device to lose");
    assert!(slots.iter().all(|&slot| !backend.is_taken(slot)));
    assert_eq!(backend.step(), Ok(StepStats { lit_columns: 0, recomputed: true }));
    let room = ClosedBox::new(70, 11);
    for i in 0..70 {
        let row = (0..i).map(|j| (Slot(j as u32), room.form_factor(i, j))).collect();
        let column = (0..i).map(|j| (Slot(j as u32), room.form_factor(j, i))).collect();
        let (slot, reflectance) = (Slot(i as u32), Rgb::splat(0.8));
        let update = Update::Add { slot, reflectance, area: room.area(i), row, column };
        assert_eq!(backend.apply(&[update]).expect("a free slot").added, 1);
    }
    assert_eq!(light_up(&mut backend, &slots, Rgb::ONE, Rgb::ZERO), first);
}

#[test]
fn an_error_leaves_no_trace() {
    let (mut backend, slots) = furnace(24, 0.5);
    backend.apply(&[Update::Remove { slot: Slot(5) }]).expect("taken");
    let slots: Vec<Slot> = slots.into_iter().filter(|slot| slot.0 != 5).collect();
    let before = light_up(&mut backend, &slots, Rgb::ONE, Rgb::splat(0.5));
    let add = |slot: u32, row: Vec<(Slot, f32)>, column: Vec<(Slot, f32)>| Update::Add {
        slot: Slot(slot),
        reflectance: Rgb::splat(0.5),
        area: 0.1,
        row,
        column,
    };
    let good = [Update::Remove { slot: Slot(7) }, add(5, vec![(Slot(5), 0.1)], vec![])];
    let bad = [
        (add(8, vec![], vec![]), BackendError::SlotTaken(Slot(8))),
        (add(24, vec![], vec![]), BackendError::SlotOutside(Slot(24), 24)),
        (Update::Remove { slot: Slot(7) }, BackendError::SlotFree(Slot(7))),
        (Update::Remove { slot: Slot(99) }, BackendError::SlotOutside(Slot(99), 24)),
        (add(7, vec![(Slot(1), 1.5)], vec![]), BackendError::Share(Slot(1), 1.5)),
        (add(7, vec![], vec![(Slot(1), -0.5)]), BackendError::Share(Slot(1), -0.5)),
        (add(7, vec![(Slot(40), 0.5)], vec![]), BackendError::SlotOutside(Slot(40), 24)),
        (add(7, vec![], vec![(Slot(7), 0.5)]), BackendError::SlotFree(Slot(7))),
    ];
    for (last, expected) in bad {
        let batch = [good[0].clone(), good[1].clone(), last];
        assert_eq!(backend.apply(&batch), Err(expected));
        assert_eq!(backend.step().map(|stats| stats.recomputed), Ok(false));
    }
    let unreal = Update::Add {
        slot: Slot(5),
        reflectance: Rgb::splat(f32::NAN),
        area: 0.1,
        row: vec![],
        column: vec![],
    };
    assert_eq!(backend.apply(&[unreal]), Err(BackendError::NotFinite(Slot(5))));
    let two = [Slot(0), Slot(5)];
    assert_eq!(
        backend.set_sources(&two, &[Rgb::ONE; 2], &[Rgb::ONE; 2]),
        Err(BackendError::SlotFree(Slot(5)))
    );
    let dark = [Rgb::ONE, Rgb::splat(-1.0)];
    let error = backend.set_sources(&slots[..2], &dark, &dark);
    assert_eq!(error, Err(BackendError::NotFinite(slots[1])));
    let length = Err(BackendError::Length { expected: 2, actual: 1 });
    assert_eq!(backend.set_sources(&slots[..2], &dark, &dark[..1]), length);
    assert_eq!(backend.read_irradiance(&slots[..2], &mut [Rgb::ZERO]), length);
    assert_eq!(backend.read_irradiance(&[Slot(5)], &mut [Rgb::ZERO]), Err(BackendError::SlotFree(Slot(5))));
    assert_eq!(light_up(&mut backend, &slots, Rgb::ONE, Rgb::splat(0.5)), before);
}

/// Goal: a patch that would close a loop without loss is refused, and all that follows makes sense. Method:
/// a patch that sees only itself; later updates of the batch name it and remove it.
#[test]
fn a_weak_pivot_is_refused_and_counted() {
    let mut backend = CpuBackend::new(8).expect("small");
    let mirror = Rgb::new(0.5, 0.98, 0.5);
    let add = |slot: u32, row: Vec<(Slot, f32)>, column| Update::Add {
        slot: Slot(slot),
        reflectance: mirror,
        area: 2.0,
        row,
        column,
    };
    let batch = [
        add(0, vec![(Slot(0), 1.0)], vec![]),
        add(1, vec![(Slot(0), 0.5), (Slot(1), 0.25)], vec![(Slot(0), 0.5)]),
        Update::Remove { slot: Slot(0) },
        add(2, vec![(Slot(1), 0.5)], vec![(Slot(1), 0.5)]),
    ];
    let stats = backend.apply(&batch).expect("within the contract");
    assert_eq!(stats, ApplyStats { added: 2, removed: 0, weak_pivots: 1 });
    assert!(!backend.is_taken(Slot(0)) && backend.is_taken(Slot(1)) && backend.is_taken(Slot(2)));
    assert!(backend.drift(1) < 1e-6);
    let alone = backend.apply(&[add(0, vec![(Slot(0), 1.0)], vec![])]).expect("within the contract");
    assert_eq!(alone, ApplyStats { added: 0, removed: 0, weak_pivots: 1 });
}

/// Goal: the same light to the bit at any number of threads. Method: one seeded life on pools of 1 and 2.
#[test]
fn threads_do_not_change_a_bit() {
    let live = || {
        let mut streamed = Streamed::new(ClosedBox::new(300, 2), 210, 2);
        let mut backend = CpuBackend::new(210).expect("small");
        for (leave, enter) in [(0, 210), (40, 33), (1, 1), (2, 2), (60, 67)] {
            backend.apply(&streamed.leave(leave)).expect("resident");
            backend.apply(&streamed.enter(enter)).expect("free");
        }
        let slots = streamed.taken();
        let sources: Vec<Rgb> = slots.iter().map(|&slot| streamed.source(slot)).collect();
        backend.set_sources(&slots, &sources, &sources).expect("taken");
        backend.step().expect("no device to lose");
        let mut irradiance = vec![Rgb::ZERO; slots.len()];
        backend.read_irradiance(&slots, &mut irradiance).expect("taken");
        (irradiance, backend.drift(3))
    };
    let on =
        |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool").install(live);
    let (one, two) = (on(1), on(2));
    assert!(one.0[0].max_element() > 0.1, "{:?}", one.0[0]);
    assert!(one == two);
}

#[test]
fn capacities_that_cannot_be_are_errors() {
    assert_eq!(CpuBackend::new(0).err(), Some(CapacityError::Zero));
    assert_eq!(CpuBackend::new(u32::MAX).err(), Some(CapacityError::TooLarge(u32::MAX)));
    assert_eq!(CpuBackend::new(1).expect("one slot").capacity(), 1);
}

/// Goal: the probe sees rounding's worst and the fresh solve undoes it. Method: one entry of `H` made a half larger.
#[test]
fn the_probe_finds_a_fault_and_resolve_repairs_it() {
    let mut streamed = Streamed::new(ClosedBox::new(160, 6), 130, 6);
    let mut backend = CpuBackend::new(130).expect("small");
    backend.apply(&streamed.enter(130)).expect("free");
    backend.apply(&streamed.leave(17)).expect("resident");
    assert!(backend.drift(1) < 1e-6, "{}", backend.drift(1));
    let brightest = (0..130)
        .max_by_key(|&slot| (backend.matrix().entry(1, streamed.taken()[0], Slot(slot)) * 1e6) as u32);
    let row = streamed.taken()[0].0 as usize;
    backend.matrix_mut().corrupt(1, row, brightest.expect("130 slots") as usize, 1.5);
    assert!(backend.drift(1) > 1e-5, "{}", backend.drift(1));
    backend.resolve().expect("no device to lose");
    assert!(backend.drift(1) < 1e-6, "{}", backend.drift(1));
    let error = streamed.error_of(backend.matrix()).expect("small");
    assert!(error.frobenius_rel < 1e-6, "{error:?}");
    backend.matrix_mut().corrupt(2, row, row, f32::NAN);
    assert_eq!(backend.drift(1), f32::INFINITY);
}

/// Goal: a column that contradicts its row is refused, one that differs by rounding is not. Method: the same patch
/// with its column off by more and by less than the tolerance; areas four decades apart, and a slot named twice.
#[test]
fn what_two_patches_exchange_is_the_same_both_ways() {
    let mut backend = CpuBackend::new(4).expect("small");
    let add = |slot: u32, area: f32, row: &[(u32, f32)], column: &[(u32, f32)]| Update::Add {
        slot: Slot(slot),
        reflectance: Rgb::splat(0.5),
        area,
        row: row.iter().map(|&(slot, share)| (Slot(slot), share)).collect(),
        column: column.iter().map(|&(slot, share)| (Slot(slot), share)).collect(),
    };
    backend.apply(&[add(0, 1.0, &[], &[])]).expect("free");
    let small = |column: f32| add(1, 1e-4, &[(0, 0.25), (0, 0.25)], &[(0, column)]);
    for column in [0.6e-4, 0.4e-4, 0.0] {
        let error = backend.apply(&[small(column)]).expect_err("one-sided");
        assert!(
            matches!(error, BackendError::NotReciprocal { slot: Slot(1), other: Slot(0), .. }),
            "{error}"
        );
    }
    let blind = add(1, 1e-4, &[], &[(0, 0.5e-4)]);
    assert!(matches!(backend.apply(&[blind]), Err(BackendError::NotReciprocal { .. })));
    for area in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let error = backend.apply(&[add(1, area, &[], &[])]).expect_err("no area");
        assert!(matches!(error, BackendError::Area(Slot(1), _)), "{error}");
    }
    assert!(!backend.is_taken(Slot(1)));
    // A tenant of the same batch counts with its own area, not with that of whom it replaces.
    let replaced = [Update::Remove { slot: Slot(0) }, add(0, 2.0, &[], &[]), small(0.25e-4 * 1.0005)];
    backend.apply(&replaced).expect("reciprocal within the tolerance");
    let entry = |backend: &CpuBackend, i: u32, j: u32| backend.matrix().entry(1, Slot(i), Slot(j));
    let (forth, back) = (1e-4 * entry(&backend, 1, 0), 2.0 * entry(&backend, 0, 1));
    assert!((forth - back).abs() < 1e-6 * forth && forth > 0.0, "{forth} {back}");
    assert!(backend.drift(1) < 1e-6);
}

/// Goal: interest saves work and never changes light. Method: a few rows of interest against a twin that evaluates
/// all; what is left out keeps its light and says so, and is made up for when it becomes of interest.
#[test]
fn rows_of_no_interest_wait() {
    let (mut backend, slots) = furnace(150, 0.5);
    let (mut twin, _) = furnace(150, 0.5);
    let first = light_up(&mut backend, &slots, Rgb::ONE, Rgb::ZERO);
    let interest = [Slot(3), Slot(70), Slot(149)];
    backend.set_interest(Some(&interest)).expect("within the capacity");
    assert_eq!(backend.step().map(|stats| stats.recomputed), Ok(false), "nothing wanted is missing");
    assert!(backend.is_current(Slot(4)));
    let second = light_up(&mut backend, &slots, Rgb::new(2.0, 0.0, 1.0), Rgb::splat(0.25));
    let all = light_up(&mut twin, &slots, Rgb::new(2.0, 0.0, 1.0), Rgb::splat(0.25));
    for (&slot, (first, (second, all))) in slots.iter().zip(first.iter().zip(second.iter().zip(&all))) {
        let is_wanted = interest.contains(&slot);
        assert_eq!(backend.is_current(slot), is_wanted, "{slot:?}");
        assert!(second == if is_wanted { all } else { first }, "{slot:?}: {second} of {first}, {all}");
    }
    assert!(backend.set_interest(Some(&[Slot(150)])).is_err());
    backend.set_interest(None).expect("all");
    assert_eq!(backend.step().map(|stats| stats.recomputed), Ok(true), "what was left out is wanted now");
    let mut third = vec![Rgb::ZERO; slots.len()];
    backend.read_irradiance(&slots, &mut third).expect("taken");
    assert!(third == all && slots.iter().all(|&slot| backend.is_current(slot)));
    backend.apply(&[Update::Remove { slot: Slot(9) }]).expect("taken");
    assert!(!backend.is_current(Slot(9)));
}
