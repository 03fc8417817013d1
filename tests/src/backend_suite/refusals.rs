//! What a backend refuses, and that a refusal leaves no trace.

use super::{add, furnish, lit, read};
use earthshine_radiosity::{ApplyStats, Backend, BackendError, Slot, Update};
use earthshine_world::Rgb;

/// A mirror that sees only itself would amplify without end: it gets no slot, and the slot stays usable.
pub(super) fn a_loop_without_loss_is_refused_and_counted(backend: &mut dyn Backend) {
    let mirror = add(0, 0.98, vec![(Slot(0), 1.0)], vec![]);
    let stats = backend.apply(&[mirror]).expect("within the contract");
    assert_eq!(stats, ApplyStats { weak_pivots: 1, ..ApplyStats::default() });
    assert!(!backend.is_taken(Slot(0)));
    let stats = backend.apply(&[add(0, 0.5, vec![], vec![])]).expect("a free slot");
    assert_eq!(stats, ApplyStats { added: 1, ..ApplyStats::default() });
    assert!(backend.is_taken(Slot(0)));
    // Whoever named a refused patch of the same batch sees nothing there, nor does the next one in that slot.
    if backend.capacity() > 2 {
        let mirror = add(1, 0.98, vec![(Slot(1), 1.0)], vec![]);
        let names_it = add(2, 0.5, vec![(Slot(1), 0.5)], vec![(Slot(1), 0.5)]);
        let stats = backend.apply(&[mirror, names_it]).expect("within the contract");
        assert_eq!(stats, ApplyStats { added: 1, weak_pivots: 1, removed: 0 });
        backend.apply(&[add(1, 0.5, vec![], vec![])]).expect("a free slot");
        let slots = [Slot(0), Slot(1), Slot(2)];
        let arriving = [Rgb::ONE; 3];
        assert_eq!(lit(backend, &slots, &arriving, &arriving), arriving, "nobody sees anybody");
    }
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
