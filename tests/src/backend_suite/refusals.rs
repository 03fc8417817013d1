//! What a backend refuses, and that a refusal leaves no trace.

use super::{add, furnish, lit, read};
use earthshine_radiosity::closed_box::ClosedBox;
use earthshine_radiosity::{Backend, BackendError, Slot, Update};
use earthshine_world::Rgb;
use std::time::{Duration, Instant};

/// In which a device says what it knows.
const WITHIN: Duration = Duration::from_secs(60);

/// Applies updates and hears who was refused, at once or later.
fn refused_of(backend: &mut dyn Backend, updates: &[Update]) -> Vec<Slot> {
    let stats = backend.apply(updates).expect("within the contract");
    let newcomers = || {
        updates.iter().filter_map(|update| match update {
            Update::Add { slot, .. } => Some(*slot),
            Update::Remove { .. } => None,
        })
    };
    let mut refused: Vec<Slot> = newcomers().filter(|&slot| !backend.is_taken(slot)).collect();
    assert_eq!(
        stats.weak_pivots as usize,
        refused.len(),
        "who is refused at once is counted, and has no slot"
    );
    assert_eq!((stats.added + stats.weak_pivots) as usize, newcomers().count());
    hear_out(backend, &mut refused);
    assert!(refused.iter().all(|&slot| !backend.is_taken(slot)), "{refused:?}");
    refused.sort_unstable();
    refused
}

/// Steps until there is nothing more to be told; nothing is told of who is refused.
fn hear_out(backend: &mut dyn Backend, refused: &mut Vec<Slot>) {
    let (start, mut news) = (Instant::now(), Vec::new());
    loop {
        backend.step().expect("a device that works");
        backend.take_news(&mut news).expect("a device that works");
        backend.take_refused(refused).expect("a device that works");
        if backend.is_settled() {
            break;
        }
        assert!(start.elapsed() < WITHIN, "light does not come to rest");
        std::thread::yield_now();
    }
    assert!(news.iter().all(|(slot, _)| !refused.contains(slot)), "light of {refused:?}: {news:?}");
}

/// A mirror that sees only itself would amplify without end: it gets no slot, and the slot stays usable.
pub(super) fn a_loop_without_loss_is_refused_and_counted(backend: &mut dyn Backend) {
    let mirror = |slot: u32| add(slot, 0.98, vec![(Slot(slot), 1.0)], vec![]);
    assert_eq!(refused_of(backend, &[mirror(0)]), [Slot(0)]);
    assert_eq!(refused_of(backend, &[add(0, 0.5, vec![], vec![])]), []);
    assert!(backend.is_taken(Slot(0)));
    // Whoever named a refused patch of the same batch sees nothing there, nor does the next one in that slot.
    if backend.capacity() > 2 {
        let names_it = add(2, 0.5, vec![(Slot(1), 0.5)], vec![(Slot(1), 0.5)]);
        assert_eq!(refused_of(backend, &[mirror(1), names_it]), [Slot(1)]);
        assert_eq!(refused_of(backend, &[add(1, 0.5, vec![], vec![])]), []);
        let slots = [Slot(0), Slot(1), Slot(2)];
        let arriving = [Rgb::ONE; 3];
        assert_eq!(lit(backend, &slots, &arriving, &arriving), arriving, "nobody sees anybody");
    }
    // Who takes the place of one that was refused, told or not, is not hit by that.
    let remove = Update::Remove { slot: Slot(0) };
    let plain = || add(0, 0.5, vec![], vec![]);
    backend.apply(&[remove.clone(), mirror(0), remove.clone(), plain()]).expect("within the contract");
    let mut refused = Vec::new();
    hear_out(backend, &mut refused);
    assert_eq!(refused, []);
    backend.apply(&[remove.clone(), mirror(0)]).expect("within the contract");
    backend.step().expect("a device that works");
    let takes_over = if backend.is_taken(Slot(0)) { vec![remove.clone(), plain()] } else { vec![plain()] };
    assert_eq!(refused_of(backend, &takes_over), []);
    // Nor by a step that came after the refusal was told, and before somebody else came.
    if backend.capacity() > 2 {
        assert_eq!(refused_of(backend, &[remove, mirror(0)]), [Slot(0)]);
        backend.apply(&[Update::Remove { slot: Slot(1) }]).expect("a resident");
        backend.step().expect("a device that works");
        backend.apply(&[plain()]).expect("a free slot");
        // Hears of that step.
        read(backend, &[Slot(0)]);
        hear_out(backend, &mut refused);
        assert_eq!(refused, []);
    }
    assert_eq!(lit(backend, &[Slot(0)], &[Rgb::ONE], &[Rgb::ONE]), [Rgb::ONE]);
}

/// Goal: who is refused in the middle of a block, or names somebody who was, is as if that one had not come. Method: a closed
/// room that fills the backend but for every fifth slot; there mirrors come that everybody sees. The light is that of the room
/// without them, also after more patches were swapped that name them before anybody is told.
pub(super) fn who_is_refused_in_a_block_leaves_no_trace(backend: &mut dyn Backend) {
    let size = backend.capacity();
    let room = ClosedBox::new(size as usize, 11);
    let is_mirror = |slot: u32| slot % 5 == 4;
    let enter = |i: u32, is_there: &dyn Fn(u32) -> bool| {
        let (area, factor) =
            (room.area(i as usize), |a: u32, b: u32| room.form_factor(a as usize, b as usize));
        // What a mirror sees of itself leaves little for others.
        let share = |a: u32, b: u32| factor(a, b) * if is_mirror(a) || is_mirror(b) { 1e-3 } else { 1.0 };
        let others = || (0..size).filter(|&j| j != i && is_there(j));
        let own = is_mirror(i).then_some((Slot(i), 0.99));
        let row = others().map(|j| (Slot(j), share(i, j))).chain(own).collect();
        let column = others().map(|j| (Slot(j), share(j, i))).collect();
        let reflectance = Rgb::splat(if is_mirror(i) { 0.98 } else { 0.6 });
        Update::Add { slot: Slot(i), reflectance, area, row, column }
    };
    let everybody: Vec<Update> = (0..size).map(|i| enter(i, &|j| j < i)).collect();
    let mirrors: Vec<Slot> = (0..size).filter(|&slot| is_mirror(slot)).map(Slot).collect();
    let slots: Vec<Slot> = (0..size).filter(|&slot| !is_mirror(slot)).map(Slot).collect();
    let sources: Vec<Rgb> = slots.iter().map(|slot| Rgb::new(1.0 + slot.0 as f32, 2.0, 0.5)).collect();
    // The same patches, and nobody who is refused.
    let alone: Vec<Update> =
        slots.iter().map(|slot| enter(slot.0, &|j| j < slot.0 && !is_mirror(j))).collect();
    assert_eq!(refused_of(backend, &alone), []);
    let expected = lit(backend, &slots, &sources, &sources);
    backend.clear().expect("a device that works");

    backend.apply(&everybody).expect("within the contract");
    let again = slots[0].0;
    let there: Vec<bool> = (0..size).map(|slot| backend.is_taken(Slot(slot))).collect();
    let come_again = [Update::Remove { slot: Slot(again) }, enter(again, &|j| there[j as usize])];
    backend.apply(&come_again).expect("within the contract");
    let found = lit(backend, &slots, &sources, &sources);
    for (slot, (found, expected)) in slots.iter().zip(found.iter().zip(&expected)) {
        let gap = (*found - *expected).abs().max_element();
        assert!(gap <= 1e-5 * expected.max_element(), "{slot:?}: {found} for {expected}");
    }
    let mut refused: Vec<Slot> = mirrors.iter().copied().filter(|&slot| !backend.is_taken(slot)).collect();
    hear_out(backend, &mut refused);
    refused.sort_unstable();
    assert_eq!(refused, mirrors);
    assert!((0..size).all(|slot| backend.is_taken(Slot(slot)) != is_mirror(slot)));
    assert!(backend.drift(1) < 1e-5, "{}", backend.drift(1));
}

/// Good updates followed by each kind of bad one: light and slots stay the same to the bit.
pub(super) fn errors_leave_no_trace(backend: &mut dyn Backend) {
    let size = backend.capacity();
    let mut slots = furnish(backend, 0.5);
    if size > 8 {
        let slot = slots.remove(5);
        backend.apply(&[Update::Remove { slot }]).expect("a resident");
    }
    let sources: Vec<Rgb> = slots.iter().map(|slot| Rgb::new(1.0, slot.0 as f32, 0.5)).collect();
    let before = lit(backend, &slots, &sources, &sources);
    for (batch, expected) in bad_batches(size) {
        assert_eq!(backend.apply(&batch), Err(expected.clone()));
        assert_untouched(backend, &slots, &before, &expected);
    }
    let no_light = [add(0, f32::NAN, vec![], vec![])];
    let batch = [&[Update::Remove { slot: Slot(0) }][..], &no_light].concat();
    assert!(backend.apply(&batch).is_err(), "a reflectance that is no number");
    bad_sources(backend, &slots, &before);
    assert!(read(backend, &slots) == before);
}

fn bad_batches(size: u32) -> Vec<(Vec<Update>, BackendError)> {
    let remove = |slot: u32| Update::Remove { slot: Slot(slot) };
    let plain = |slot: u32| add(slot, 0.5, vec![], vec![]);
    // Each follows updates that would be fine by themselves.
    let after = |last: Update| vec![remove(0), plain(0), last];
    let outside = |slot: u32| BackendError::SlotOutside(Slot(slot), size);
    let mut batches = vec![
        (after(plain(0)), BackendError::SlotTaken(Slot(0))),
        (after(plain(size)), outside(size)),
        (after(remove(u32::MAX)), outside(u32::MAX)),
        (vec![remove(0), remove(0)], BackendError::SlotFree(Slot(0))),
        (vec![remove(0), add(0, 0.5, vec![(Slot(0), 1.5)], vec![])], BackendError::Share(Slot(0), 1.5)),
        (vec![remove(0), add(0, 0.5, vec![(Slot(size + 7), 0.5)], vec![])], outside(size + 7)),
    ];
    if size > 8 {
        let entry = |share| vec![(Slot(1), share)];
        batches.extend([
            (after(remove(5)), BackendError::SlotFree(Slot(5))),
            (after(add(5, 0.5, vec![], entry(-0.5))), BackendError::Share(Slot(1), -0.5)),
            (vec![remove(1), add(5, 0.5, entry(0.5), vec![])], BackendError::SlotFree(Slot(1))),
            (vec![add(5, 0.5, vec![], vec![(Slot(5), 0.5)])], BackendError::SlotFree(Slot(5))),
            (after(one_sided()), NOT_RECIPROCAL),
            (after(too_much()), BackendError::RowSum { slot: Slot(5), sum: 1.5 }),
            (after(without_area(-1.0)), BackendError::Area(Slot(5), -1.0)),
        ]);
    }
    batches
}

/// Sees a patch that does not see it.
fn one_sided() -> Update {
    add(5, 0.5, vec![(Slot(0), 0.5)], vec![])
}

/// Sees more than all there is.
fn too_much() -> Update {
    add(5, 0.5, vec![(Slot(0), 0.75), (Slot(5), 0.75)], vec![(Slot(0), 0.75)])
}

/// What [`one_sided`] is refused with; areas are 1 m2 here.
const NOT_RECIPROCAL: BackendError =
    BackendError::NotReciprocal { slot: Slot(5), other: Slot(0), forth: 0.5, back: 0.0 };

fn without_area(area: f32) -> Update {
    Update::Add { slot: Slot(5), reflectance: Rgb::splat(0.5), area, row: vec![], column: vec![] }
}

fn bad_sources(backend: &mut dyn Backend, slots: &[Slot], before: &[Rgb]) {
    let free = Slot(if backend.capacity() > 8 { 5 } else { backend.capacity() });
    let mut with_free = slots.to_vec();
    with_free.push(free);
    let bright = vec![Rgb::splat(9.0); with_free.len()];
    let mut odd = vec![Rgb::splat(9.0); slots.len()];
    let last = slots.len() - 1;
    let length = Err(BackendError::Length { expected: slots.len(), actual: slots.len() + 1 });
    let cases = [
        backend.set_sources(&with_free, &bright, &bright).is_err(),
        backend.set_sources(slots, &bright, &bright) == length,
        backend.set_sources(slots, &bright[..=last], &bright) == length,
    ];
    assert_eq!(cases, [true; 3]);
    for value in [f32::NAN, f32::INFINITY, -1.0] {
        odd[last].y = value;
        let refused = Err(BackendError::NotFinite(slots[last]));
        assert_eq!(backend.set_sources(slots, &odd, &bright[..=last]), refused);
        assert_eq!(backend.set_sources(slots, &bright[..=last], &odd), refused);
    }
    let mut out = vec![Rgb::ZERO; slots.len() + 1];
    assert_eq!(backend.read_irradiance(slots, &mut out), length);
    assert!(backend.read_irradiance(&with_free, &mut out).is_err());
    assert_untouched(backend, slots, before, &"bad sources");
}

fn assert_untouched(backend: &mut dyn Backend, slots: &[Slot], before: &[Rgb], what: &dyn std::fmt::Debug) {
    let size = backend.capacity();
    assert!((0..size).map(Slot).all(|slot| backend.is_taken(slot) == slots.contains(&slot)), "{what:?}");
    assert!(!backend.step().expect("a device that works").recomputed, "{what:?}");
    assert!(read(backend, slots) == before, "{what:?}");
}
