//! What every [`Backend`] promises: the suite that makes backends interchangeable.
//!
//! It asks through the trait alone and compares with closed forms and fresh `f64` solves, at sizes around the widths
//! of tiles and workgroups. Start at [`backend_conformance`]; what a single backend does beyond the trait is tested
//! beside it.

mod refusals;

use crate::news_suite::news_conformance;
use earthshine_radiosity::bench::{Streamed, read};
use earthshine_radiosity::closed_box::ClosedBox;
use earthshine_radiosity::{ApplyStats, Backend, BackendError, Slot, Update};
use earthshine_world::Rgb;
use std::collections::BTreeMap;

/// Matrix sizes that are always tried.
pub const SIZES: [u32; 4] = [1, 63, 64, 65];
/// Relative RMSE of irradiance against a fresh solve.
const SOLVE_REL: f64 = 1e-5;
/// Rounding that a few hundred updates may leave behind.
const DRIFT_MAX: f32 = 1e-5;

/// Runs the suite against what `make` builds for a number of slots.
///
/// # Panics
/// At the first promise that is broken.
pub fn backend_conformance(make: impl Fn(u32) -> Box<dyn Backend>) {
    backend_conformance_at(&SIZES, make);
}

/// As [`backend_conformance`], at `sizes`: for one that is too slow for every backend.
///
/// # Panics
/// At the first promise that is broken.
pub fn backend_conformance_at(sizes: &[u32], make: impl Fn(u32) -> Box<dyn Backend>) {
    for &size in sizes {
        let fresh = || {
            let backend = make(size);
            assert_eq!(backend.capacity(), size, "as many slots as asked for");
            assert!((0..size).all(|slot| !backend.is_taken(Slot(slot))), "all free at first");
            backend
        };
        an_empty_matrix_steps(&mut *fresh());
        a_patch_that_sees_itself_is_a_geometric_series(&mut *fresh());
        a_furnace_is_uniform(&mut *fresh());
        any_life_is_a_fresh_solve(&mut *fresh());
        add_then_remove_is_the_identity(&mut *fresh());
        nothing_changed_is_the_same_to_the_bit(&mut *fresh());
        a_newcomer_inherits_nothing(&mut *fresh());
        what_is_cleared_is_as_new(&mut *fresh());
        what_is_of_no_interest_waits(&mut *fresh());
        what_is_polled_is_what_is_read(&mut *fresh());
        a_repair_in_steps_ends_and_changes_nothing(&mut *fresh());
        refusals::a_loop_without_loss_is_refused_and_counted(&mut *fresh());
        refusals::who_is_refused_in_a_block_leaves_no_trace(&mut *fresh());
        refusals::errors_leave_no_trace(&mut *fresh());
        news_conformance(fresh);
    }
}

/// Sets all sources, steps and reads.
fn lit(backend: &mut dyn Backend, slots: &[Slot], exitance: &[Rgb], outside: &[Rgb]) -> Vec<Rgb> {
    backend.set_sources(slots, exitance, outside).expect("taken slots and finite light");
    backend.step().expect("a device that works");
    read(backend, slots)
}

fn add(slot: u32, reflectance: f32, row: Vec<(Slot, f32)>, column: Vec<(Slot, f32)>) -> Update {
    Update::Add { slot: Slot(slot), reflectance: Rgb::splat(reflectance), area: 1.0, row, column }
}

/// A closed room of one reflectance that fills the backend, entered in one batch.
fn furnish(backend: &mut dyn Backend, reflectance: f32) -> Vec<Slot> {
    let size = backend.capacity();
    let room = ClosedBox::new(size as usize, 11);
    let factor = |i: u32, j: u32| room.form_factor(i as usize, j as usize);
    let updates: Vec<Update> = (0..size)
        .map(|i| {
            let row = (0..i).map(|j| (Slot(j), factor(i, j))).collect();
            let column = (0..i).map(|j| (Slot(j), factor(j, i))).collect();
            let (slot, reflectance, area) = (Slot(i), Rgb::splat(reflectance), room.area(i as usize));
            Update::Add { slot, reflectance, area, row, column }
        })
        .collect();
    let stats = backend.apply(&updates).expect("free slots");
    assert_eq!(stats, ApplyStats { added: size, ..ApplyStats::default() });
    (0..size).map(Slot).collect()
}

fn an_empty_matrix_steps(backend: &mut dyn Backend) {
    assert_eq!(backend.apply(&[]), Ok(ApplyStats::default()));
    assert_eq!(backend.step().expect("a device that works").lit_columns, 0);
    backend.resolve().expect("a device that works");
    assert_eq!(backend.drift(1), 0.0);
    assert!(lit(backend, &[], &[], &[]).is_empty());
}

/// A patch with `F = 1/2` of itself: `I = (E / 2 + g) / (1 - rho / 2)`.
fn a_patch_that_sees_itself_is_a_geometric_series(backend: &mut dyn Backend) {
    let last = backend.capacity() - 1;
    let update = add(last, 0.8, vec![(Slot(last), 0.5)], vec![]);
    backend.apply(&[update]).expect("a free slot");
    let (own, outside) = (Rgb::new(1.0, 2.0, 0.0), Rgb::new(3.0, 0.0, 0.5));
    let irradiance = lit(backend, &[Slot(last)], &[own], &[outside])[0];
    let expected = (own / 2.0 + outside) / 0.6;
    assert!((irradiance - expected).abs().max_element() < 1e-5, "{irradiance} for {expected}");
}

/// Goal: energy is kept, of light from inside and from outside. Method: `B = E / (1 - rho)`, `I = g / (1 - rho)`.
fn a_furnace_is_uniform(backend: &mut dyn Backend) {
    if backend.capacity() == 1 {
        // One flat patch is no room.
        return;
    }
    let slots = furnish(backend, 0.8);
    let (ones, zeros) = (vec![Rgb::ONE; slots.len()], vec![Rgb::ZERO; slots.len()]);
    for irradiance in lit(backend, &slots, &ones, &zeros) {
        let exitance = (Rgb::ONE + 0.8 * irradiance) * 0.2;
        assert!((exitance - 1.0).abs().max_element() < 5e-3, "{exitance}");
    }
    for irradiance in lit(backend, &slots, &zeros, &ones) {
        assert!((irradiance * 0.2 - 1.0).abs().max_element() < 5e-3, "{irradiance}");
    }
}

/// Goal: any seeded life ends in the matrix of its residents. Method: a fresh `f64` solve after every phase, and
/// again after the backend's own.
fn any_life_is_a_fresh_solve(backend: &mut dyn Backend) {
    let size = backend.capacity() as usize;
    let mut streamed = Streamed::new(ClosedBox::new(size + size / 2 + 1, 7), size, 7);
    let mut reflectance = BTreeMap::new();
    let phases =
        [(0, size / 2 + 1), (size / 4, size), (size / 2, size / 2), (1, 1), (size, size), (size / 3, 0)];
    for (leave, enter) in phases {
        let leaving = streamed.leave(leave);
        let entering = streamed.enter(enter);
        for update in &entering {
            if let Update::Add { slot, reflectance: of, .. } = update {
                reflectance.insert(*slot, *of);
            }
        }
        let removed = backend.apply(&leaving).expect("residents leave").removed;
        let added = backend.apply(&entering).expect("free slots").added;
        assert_eq!((removed as usize, added as usize), (leaving.len(), entering.len()));
        let taken = streamed.taken();
        assert!((0..size as u32).map(Slot).all(|slot| backend.is_taken(slot) == taken.contains(&slot)));
        assert_solved(backend, &streamed, &reflectance);
        assert!(backend.drift(3) < DRIFT_MAX, "{}", backend.drift(3));
        backend.resolve().expect("a device that works");
        assert_solved(backend, &streamed, &reflectance);
    }
}

fn assert_solved(backend: &mut dyn Backend, streamed: &Streamed, reflectance: &BTreeMap<Slot, Rgb>) {
    let slots = streamed.taken();
    let exitance: Vec<Rgb> = slots.iter().map(|&slot| streamed.source(slot)).collect();
    // Another pattern than the exitance, so that one cannot stand for the other.
    let outside: Vec<Rgb> = exitance.iter().rev().map(|light| *light * 0.3).collect();
    let irradiance = lit(backend, &slots, &exitance, &outside);
    let (mut gap, mut norm) = (0.0, 0.0);
    for channel in 0..3 {
        let sent: Vec<f64> = slots
            .iter()
            .zip(exitance.iter().zip(&outside))
            .map(|(slot, (own, outside))| {
                f64::from(own[channel]) + f64::from(reflectance[slot][channel]) * f64::from(outside[channel])
            })
            .collect();
        let received = streamed.solved(channel).expect("a small room").multiply(&sent);
        for ((found, received), outside) in irradiance.iter().zip(received).zip(&outside) {
            let expected = received + f64::from(outside[channel]);
            gap += (f64::from(found[channel]) - expected).powi(2);
            norm += expected.powi(2);
        }
    }
    assert!(gap.sqrt() <= SOLVE_REL * norm.sqrt(), "relative RMSE {:e}", (gap / norm).sqrt());
}

fn add_then_remove_is_the_identity(backend: &mut dyn Backend) {
    let size = backend.capacity() as usize;
    let mut streamed = Streamed::new(ClosedBox::new(size + 8, 5), size, 5);
    backend.apply(&streamed.enter(size.div_ceil(2))).expect("free slots");
    let hosts = streamed.taken();
    let sources: Vec<Rgb> = hosts.iter().map(|&slot| streamed.source(slot)).collect();
    let before = lit(backend, &hosts, &sources, &sources);
    let guests = streamed.enter(size / 2);
    backend.apply(&guests).expect("free slots");
    let goodbye: Vec<Update> = guests
        .iter()
        .rev()
        .map(|guest| match guest {
            Update::Add { slot, .. } | Update::Remove { slot } => Update::Remove { slot: *slot },
        })
        .collect();
    assert_eq!(backend.apply(&goodbye).expect("residents leave").removed as usize, goodbye.len());
    backend.step().expect("a device that works");
    for (after, before) in read(backend, &hosts).iter().zip(&before) {
        assert!(
            (*after - *before).abs().max_element() <= 1e-5 * before.max_element(),
            "{after} was {before}"
        );
    }
}

fn nothing_changed_is_the_same_to_the_bit(backend: &mut dyn Backend) {
    let slots = furnish(backend, 0.5);
    let sources: Vec<Rgb> = slots.iter().map(|slot| Rgb::new(slot.0 as f32, 1.0, 0.5)).collect();
    let first = lit(backend, &slots, &sources, &sources);
    for _ in 0..3 {
        assert!(!backend.step().expect("a device that works").recomputed);
        assert_eq!(read(backend, &slots), first);
    }
    assert_eq!(lit(backend, &slots, &sources, &sources), first, "the same sources are no change");
    assert_eq!(backend.apply(&[]), Ok(ApplyStats::default()));
    backend.drift(1);
    assert_eq!(lit(backend, &slots, &sources, &sources), first, "nor does a probe change any");
    backend.set_sources(&slots, &sources, &sources).expect("sources of residents");
    assert!(!backend.step().expect("a device that works").recomputed);
    // In the order asked.
    let reversed: Vec<Slot> = slots.iter().rev().copied().collect();
    assert!(read(backend, &reversed).iter().rev().eq(&first));
    let changed = lit(backend, &slots[..1], &[Rgb::splat(1e3)], &[Rgb::splat(1e3)]);
    assert_ne!(changed[0], first[0], "another source is a change");
}

fn what_is_cleared_is_as_new(backend: &mut dyn Backend) {
    let slots = furnish(backend, 0.5);
    let sources: Vec<Rgb> = slots.iter().map(|slot| Rgb::new(slot.0 as f32, 1.0, 0.5)).collect();
    let first = lit(backend, &slots, &sources, &sources);
    backend.clear().expect("a device that works");
    assert!(slots.iter().all(|&slot| !backend.is_taken(slot)));
    backend.step().expect("a device that works");
    furnish(backend, 0.5);
    let again = lit(backend, &slots, &sources, &sources);
    for (again, first) in again.iter().zip(&first) {
        assert!((*again - *first).abs().max_element() <= 1e-5 * first.max_element(), "{again} was {first}");
    }
}

/// Goal: interest never changes light. Method: what is of interest is what the step before would have given, to the
/// bit; what is not says whether it is current; all of it is once all is wanted.
fn what_is_of_no_interest_waits(backend: &mut dyn Backend) {
    let slots = furnish(backend, 0.5);
    let (dim, bright) = (vec![Rgb::ONE; slots.len()], vec![Rgb::splat(8.0); slots.len()]);
    let after = lit(backend, &slots, &bright, &dim);
    let before = lit(backend, &slots, &dim, &dim);
    let last = slots[slots.len() - 1];
    backend.set_interest(Some(&[last])).expect("a slot within the capacity");
    let partly = lit(backend, &slots, &bright, &dim);
    assert!(backend.is_current(last));
    for (at, &slot) in slots.iter().enumerate() {
        let expected = if backend.is_current(slot) { after[at] } else { before[at] };
        assert_eq!(partly[at], expected, "{slot:?}");
    }
    let outside = Slot(backend.capacity());
    assert_eq!(
        backend.set_interest(Some(&[outside])),
        Err(BackendError::SlotOutside(outside, backend.capacity()))
    );
    backend.set_interest(None).expect("all");
    backend.step().expect("a device that works");
    assert!(slots.iter().all(|&slot| backend.is_current(slot)) && read(backend, &slots) == after);
}

/// Goal: who does not wait hears the same, of the moment when it asked first. Method: light and drift are asked for, then
/// sources change and a patch leaves before the answer is taken.
fn what_is_polled_is_what_is_read(backend: &mut dyn Backend) {
    let slots = furnish(backend, 0.7);
    let sources: Vec<Rgb> = slots.iter().map(|slot| Rgb::new(1.0 + slot.0 as f32, 2.0, 0.0)).collect();
    let expected = lit(backend, &slots, &sources, &sources);
    let drift = backend.drift(5);
    let mut light = vec![Rgb::NAN; slots.len()];
    let mut has_light = backend.poll_irradiance(&slots, &mut light).expect("taken slots");
    let mut found = backend.poll_drift(5).expect("a device that works");
    backend.set_sources(&slots, &vec![Rgb::ZERO; slots.len()], &sources).expect("taken slots");
    backend.step().expect("a device that works");
    backend.apply(&[Update::Remove { slot: slots[0] }]).expect("a resident");
    let start = std::time::Instant::now();
    while !has_light || found.is_none() {
        assert!(start.elapsed() < std::time::Duration::from_secs(60), "no answer comes");
        std::thread::yield_now();
        has_light = has_light || backend.poll_irradiance(&slots, &mut light).expect("it was asked for");
        if found.is_none() {
            found = backend.poll_drift(5).expect("a device that works");
        }
    }
    assert_eq!((light, found), (expected, Some(drift)));
}

/// Goal: a repair can run beside everything else. Method: a sound matrix, a few columns a call; the light stays.
fn a_repair_in_steps_ends_and_changes_nothing(backend: &mut dyn Backend) {
    let slots = furnish(backend, 0.8);
    let sources: Vec<Rgb> = slots.iter().map(|slot| Rgb::new(1.0 + slot.0 as f32, 2.0, 0.0)).collect();
    let before = lit(backend, &slots, &sources, &sources);
    let mut calls = 0;
    while !backend.repair(1).expect("a device that works").is_complete {
        calls += 1;
        assert!(calls <= slots.len(), "a round ends");
    }
    assert!(backend.drift(2) < DRIFT_MAX, "{}", backend.drift(2));
    backend.step().expect("a device that works");
    for (after, before) in read(backend, &slots).iter().zip(&before) {
        assert!(
            (*after - *before).abs().max_element() <= 1e-5 * before.max_element(),
            "{after} for {before}"
        );
    }
}

/// Goal: a slot forgets its patch. Method: a bright patch leaves, a dark one takes its slot.
fn a_newcomer_inherits_nothing(backend: &mut dyn Backend) {
    let alone = || add(0, 0.5, vec![(Slot(0), 0.5)], vec![]);
    backend.apply(&[alone()]).expect("a free slot");
    assert!(lit(backend, &[Slot(0)], &[Rgb::ONE], &[Rgb::ONE])[0].min_element() > 1.0);
    backend.apply(&[Update::Remove { slot: Slot(0) }, alone()]).expect("there and back");
    backend.step().expect("a device that works");
    assert_eq!(read(backend, &[Slot(0)]), [Rgb::ZERO]);
}
