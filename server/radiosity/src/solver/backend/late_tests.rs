//! A matrix that tells later whom it refused and what its light is, as a device does: rows follow, and nobody is told twice.

use super::{MatrixFactory, SolverBackend};
use crate::backend::{ApplyStats, Backend, BackendError, Slot, StepStats, Update};
use crate::cpu::CpuBackend;
use crate::solver::{Method, SolverSettings};
use earthshine_world::Rgb;
use std::collections::BTreeSet;

/// What the CPU does; whom it refuses looks taken until that is told, and light is there at the second look.
struct LateMatrix {
    inner: CpuBackend,
    refused: BTreeSet<Slot>,
    is_asked: bool,
}

impl Backend for LateMatrix {
    fn capacity(&self) -> u32 {
        self.inner.capacity()
    }

    fn apply(&mut self, updates: &[Update]) -> Result<ApplyStats, BackendError> {
        let mut stats = ApplyStats::default();
        for update in updates {
            let (Update::Add { slot, .. } | Update::Remove { slot }) = update;
            if matches!(update, Update::Remove { .. }) && self.refused.remove(slot) {
                stats.removed += 1;
                continue;
            }
            let is_there = |(other, _): &&(Slot, f32)| !self.refused.contains(other);
            let update = match update {
                Update::Add { slot, reflectance, area, row, column } => Update::Add {
                    slot: *slot,
                    reflectance: *reflectance,
                    area: *area,
                    row: row.iter().filter(is_there).copied().collect(),
                    column: column.iter().filter(is_there).copied().collect(),
                },
                Update::Remove { .. } => update.clone(),
            };
            let one = self.inner.apply(&[update])?;
            if one.weak_pivots > 0 {
                self.refused.insert(*slot);
            }
            stats.added += one.added + one.weak_pivots;
            stats.removed += one.removed;
        }
        Ok(stats)
    }

    fn is_taken(&self, slot: Slot) -> bool {
        self.inner.is_taken(slot) || self.refused.contains(&slot)
    }

    fn take_refused(&mut self, refused: &mut Vec<Slot>) -> Result<(), BackendError> {
        refused.extend(std::mem::take(&mut self.refused));
        Ok(())
    }

    fn set_sources(&mut self, slots: &[Slot], direct: &[Rgb], outside: &[Rgb]) -> Result<(), BackendError> {
        for ((slot, direct), outside) in slots.iter().zip(direct).zip(outside) {
            if !self.refused.contains(slot) {
                self.inner.set_sources(&[*slot], &[*direct], &[*outside])?;
            }
        }
        Ok(())
    }

    fn step(&mut self) -> Result<StepStats, BackendError> {
        self.inner.step()
    }

    fn read_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        for (slot, out) in slots.iter().zip(out) {
            *out = Rgb::ZERO;
            if !self.refused.contains(slot) {
                self.inner.read_irradiance(&[*slot], std::slice::from_mut(out))?;
            }
        }
        Ok(())
    }

    fn poll_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<bool, BackendError> {
        self.is_asked = !self.is_asked;
        if self.is_asked {
            return Ok(false);
        }
        self.read_irradiance(slots, out).map(|()| true)
    }

    fn take_news(&mut self, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        self.inner.take_news(news)
    }

    fn drift(&mut self, seed: u64) -> f32 {
        self.inner.drift(seed)
    }

    fn resolve(&mut self) -> Result<(), BackendError> {
        self.inner.resolve()
    }
}

fn backend(method: Method, is_late: bool) -> SolverBackend {
    let settings = SolverSettings { method, ..SolverSettings::default() };
    let make: MatrixFactory = Box::new(move |slots| {
        let inner = CpuBackend::new(slots).expect("a small matrix");
        let late = |inner| LateMatrix { inner, refused: BTreeSet::new(), is_asked: false };
        Ok(if is_late { Box::new(late(inner)) as Box<dyn Backend> } else { Box::new(inner) })
    });
    SolverBackend::new(8, settings, make).expect("sound settings")
}

/// A patch that sees `others`, and they it, by half of their rows or all of them.
fn add(slot: u32, reflectance: f32, others: &[(u32, f32)]) -> Update {
    let row: Vec<(Slot, f32)> = others.iter().map(|&(other, share)| (Slot(other), share)).collect();
    let column = row.iter().filter(|(other, _)| other.0 != slot).copied().collect();
    Update::Add { slot: Slot(slot), reflectance: Rgb::splat(reflectance), area: 1.0, row, column }
}

fn refused(backend: &mut SolverBackend) -> Vec<Slot> {
    let mut refused = Vec::new();
    backend.take_refused(&mut refused).expect("the CPU works");
    refused
}

/// Goal: who is refused late leaves rows and slots when that is told, once. Method: light by the matrix; a mirror, and a patch
/// that names it.
#[test]
fn whom_a_matrix_refuses_late_leaves_the_rows_too() {
    let mut backend = backend(Method::Matrix, true);
    let updates = [add(0, 0.5, &[]), add(1, 0.98, &[(1, 1.0)]), add(2, 0.5, &[(0, 0.25), (1, 0.25)])];
    let stats = backend.apply(&updates).expect("free slots");
    assert_eq!((stats.added, stats.weak_pivots), (3, 0));
    assert_eq!(backend.links().row(2).len(), 2);
    backend.step().expect("the CPU works");
    assert!(backend.is_taken(Slot(1)));
    assert_eq!(refused(&mut backend), [Slot(1)]);
    assert!(!backend.is_taken(Slot(1)) && backend.is_taken(Slot(2)));
    assert_eq!(backend.links().row(2).len(), 1);
    assert_eq!(refused(&mut backend), []);
    // Its slot is another's now, and one that left before it was told is not told.
    backend.apply(&[add(1, 0.5, &[(0, 0.5)]), add(3, 0.98, &[(3, 1.0)])]).expect("free slots");
    backend.apply(&[Update::Remove { slot: Slot(3) }]).expect("it looks taken");
    backend.step().expect("the CPU works");
    assert_eq!(refused(&mut backend), []);
    assert!(backend.is_taken(Slot(1)));
}

/// Goal: whoever a matrix beside the rows refuses is told, and keeps its slot until then; an audit waits for late light and is
/// of who is left. Method: two patches that see nothing but each other: rows take both, a matrix one.
#[test]
fn whom_an_audit_refuses_is_told() {
    for is_late in [false, true] {
        let mut backend = backend(Method::Gather, is_late);
        assert_eq!(backend.set_audited(true), Ok(true));
        backend.apply(&[add(0, 0.98, &[]), add(1, 0.98, &[(0, 1.0)])]).expect("free slots");
        assert_eq!(backend.audit(), Ok(None), "the matrix is being made");
        let slots = [Slot(0), Slot(1)];
        backend.set_sources(&slots, &[Rgb::ONE; 2], &[Rgb::ONE; 2]).expect("both are still there");
        assert_eq!(refused(&mut backend), [Slot(1)], "late: {is_late}");
        assert!(!backend.is_taken(Slot(1)) && backend.links().row(0).is_empty());
        assert_eq!(refused(&mut backend), []);
        for _ in 0..50 {
            backend.step().expect("the CPU works");
        }
        let mut audit = backend.audit().expect("the CPU works");
        assert_eq!((audit.is_none(), backend.is_audit_coming()), (is_late, is_late));
        audit = audit.or(backend.audit().expect("the CPU works"));
        assert!(audit.is_some_and(|error| error < 1e-5), "{audit:?}");
        assert!(!backend.is_audit_coming());
    }
}
