//! When gathered light is said to be settled.

use super::{empty, settings};
use crate::backend::{Backend, Slot, Update};
use crate::bench::read;
use crate::cpu::CpuBackend;
use crate::solver::Method;
use crate::solver::shooting::SETTLE_FRAMES;
use earthshine_world::Rgb;

/// Goal: what has settled is right in dark corners of bright rooms too. Method: patches in a row, each of which sees its two
/// neighbours, and a lamp on the first; light of each against the matrix', by its own brightness.
#[test]
fn a_gather_settles_no_sooner_than_its_darkest_patches() {
    let mut gather = empty(14, settings(Method::Gather));
    let mut matrix = CpuBackend::new(14).expect("a small matrix");
    let slots: Vec<Slot> = (0..14).map(Slot).collect();
    for &slot in &slots {
        let before: Vec<(Slot, f32)> =
            slot.0.checked_sub(1).map(|before| (Slot(before), 0.45)).into_iter().collect();
        let (row, column) = (before.clone(), before);
        let update = [Update::Add { slot, reflectance: Rgb::splat(0.8), area: 1.0, row, column }];
        gather.apply(&update).expect("a free slot");
        matrix.apply(&update).expect("a free slot");
    }
    let mut exitances = [Rgb::ZERO; 14];
    exitances[0] = Rgb::splat(1e5);
    for backend in [&mut gather as &mut dyn Backend, &mut matrix] {
        backend.set_sources(&slots, &exitances, &[Rgb::ZERO; 14]).expect("taken slots");
        backend.step().expect("the CPU steps");
    }
    let steps = (0..SETTLE_FRAMES).find(|_| {
        gather.step().expect("the CPU steps");
        gather.is_settled()
    });
    assert!(steps.is_some(), "not settled");
    let (found, exact) = (read(&mut gather, &slots), read(&mut matrix, &slots));
    assert!(exact[13].x < 1e-4 * exact[1].x, "{} is not dark", exact[13].x);
    for (found, exact) in found.iter().zip(&exact) {
        assert!((found.x / exact.x - 1.0).abs() < 1e-4, "{} for {}", found.x, exact.x);
    }
}
