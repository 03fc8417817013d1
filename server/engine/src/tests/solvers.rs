//! Solvers as the engine uses them: every one ends at the matrix' light, may change while frames go on, and is audited.

use super::backend::Faults;
use super::harness::{ALICE, Harness, factory, generous, lamp};
use super::world::{RandomWorld, WorldShape};
use crate::{BackendFactory, EngineConfig, Event, PatchLight, SolverConfig};
use earthshine_radiosity::solver::{DrawnRows, Method, SolverBackend, SolverSettings};
use earthshine_radiosity::{Backend, CpuBackend};
use earthshine_world::{LightRig, Rgb, Vec3};

const PATCHES: u32 = 60;

fn solving() -> BackendFactory {
    Box::new(|capacity| {
        let make = |capacity| Ok(Box::new(CpuBackend::new(capacity).unwrap()) as Box<dyn Backend>);
        let settings = SolverSettings { method: Method::Gather, ..SolverSettings::default() };
        Ok(Box::new(SolverBackend::new(capacity, settings, Box::new(make))?))
    })
}

fn solved_by(solver: Method) -> SolverConfig {
    SolverConfig { by_level: vec![solver], ..SolverConfig::default() }
}

fn harness(solver: SolverConfig) -> Harness {
    let world = RandomWorld::new(5, WorldShape::default());
    let config = EngineConfig { solver, ..generous(PATCHES) };
    Harness::with_backends(world, config, solving()).with_camera(Vec3::splat(2.0))
}

fn rig(intensity: f32) -> LightRig {
    let mut rig = lamp(Vec3::splat(2.0));
    rig.emission_scale = intensity;
    rig
}

fn light(harness: &Harness) -> Vec<PatchLight> {
    harness.frame(ALICE).patches.to_vec()
}

fn rel_rmse(light: &[PatchLight], exact: &[PatchLight]) -> f64 {
    assert_eq!(light.len(), exact.len());
    let square = |rgb: Rgb| f64::from(rgb.length_squared());
    let gap: f64 = light.iter().zip(exact).map(|(a, b)| square(a.irradiance - b.irradiance)).sum();
    (gap / exact.iter().map(|b| square(b.irradiance)).sum::<f64>()).sqrt()
}

#[test]
fn every_solver_ends_at_the_matrix() {
    let ends = |solver| {
        let mut harness = harness(SolverConfig { history_weight: 0.99, ..solved_by(solver) });
        harness.light(ALICE, rig(1.0));
        harness.settle();
        // Draws go on; give them some histories.
        for _ in 0..if solver.is_endless() { 1000 } else { 0 } {
            harness.tick();
        }
        light(&harness)
    };
    let exact = ends(Method::Matrix);
    assert!(!exact.is_empty() && exact.iter().any(|light| light.irradiance.max_element() > 0.0));
    for (solver, most) in [
        (Method::Gather, 1e-4),
        (Method::Progressive, 1e-3),
        (Method::Hybrid, 1e-3),
        (Method::Alias, 0.1),
        (Method::Cdf, 0.1),
    ] {
        let error = rel_rmse(&ends(solver), &exact);
        assert!(error < most, "{solver:?}: {error}");
    }
}

/// Goal: solvers change while a session looks on. Method: settled light, then every solver; the light of every frame on
/// the way stays where it is, and the matrix, made in steps, ends exact.
#[test]
fn solvers_change_while_frames_go_on() {
    let mut harness = harness(solved_by(Method::Hybrid));
    harness.light(ALICE, rig(1.0));
    harness.settle();
    let first = light(&harness);
    let all = [Method::Gather, Method::Matrix, Method::Progressive, Method::Hybrid];
    for solver in all {
        harness.events.push(Event::Solver { solver: solved_by(solver) });
        for _ in 0..20 {
            harness.tick();
            let moved = rel_rmse(&light(&harness), &first);
            assert!(moved < 1e-3, "to {solver:?}: {moved}");
        }
        harness.settle();
    }
    let before = harness.engine.stats().counters.ignored.solvers;
    harness
        .events
        .push(Event::Solver { solver: SolverConfig { samples_per_row: 0, ..SolverConfig::default() } });
    harness.tick();
    assert_eq!(harness.engine.stats().counters.ignored.solvers, before + 1);
    assert_eq!(harness.engine.config().solver, solved_by(Method::Hybrid));
}

#[test]
fn an_audit_says_how_far_a_solver_is_from_the_matrix() {
    let audited = SolverConfig { audit_every_ticks: 5, ..solved_by(Method::Hybrid) };
    let mut harness = harness(audited);
    harness.light(ALICE, rig(1.0));
    harness.settle();
    harness.light(ALICE, rig(3.0));
    for _ in 0..20 {
        harness.tick();
    }
    harness.settle();
    for _ in 0..5 {
        harness.tick();
    }
    let stats = harness.engine.stats();
    assert!(stats.counters.audits >= 3, "{stats:?}");
    assert!(stats.audit_error() < 1e-3, "{}", stats.audit_error());
}

/// A backend without a choice goes on as before, whatever is asked for.
#[test]
fn a_backend_without_a_choice_is_left_alone() {
    let world = RandomWorld::new(5, WorldShape::default());
    let config = EngineConfig { solver: solved_by(Method::Cdf), ..generous(PATCHES) };
    let mut harness =
        Harness::with_backends(world, config, factory(Faults::default())).with_camera(Vec3::splat(2.0));
    harness.light(ALICE, rig(1.0));
    harness.settle();
    assert!(!light(&harness).is_empty());
}

/// Goal: a solver that a backend has no way for is counted and said, and light goes on by the one before. Method: draws from
/// rows of a matrix that shows none.
#[test]
fn a_solver_that_is_refused_is_counted() {
    let world = RandomWorld::new(5, WorldShape::default());
    let config = EngineConfig { solver: solved_by(Method::Gather), ..generous(PATCHES) };
    let mut hidden = factory(Faults::default());
    let backends = Box::new(move |capacity| {
        let matrix = hidden(capacity)?;
        let mut one = Some(matrix);
        let make = Box::new(move |_| Ok(one.take().expect("asked for once")));
        let settings = SolverSettings { method: Method::Gather, ..SolverSettings::default() };
        Ok(Box::new(SolverBackend::new(capacity, settings, make)?) as Box<dyn Backend>)
    });
    let mut harness = Harness::with_backends(world, config, backends).with_camera(Vec3::splat(2.0));
    harness.light(ALICE, rig(1.0));
    harness.settle();
    let (before, counters) = (light(&harness), harness.engine.stats().counters);
    assert_eq!(counters.solvers_refused, 0);
    let coloured = SolverConfig { drawn_rows: DrawnRows::Multibounce, ..solved_by(Method::Cdf) };
    harness.events.push(Event::Solver { solver: coloured });
    harness.tick();
    assert_eq!(harness.engine.stats().counters.solvers_refused, 1);
    harness.light(ALICE, rig(2.0));
    harness.settle();
    assert!(rel_rmse(&light(&harness), &before) > 0.01, "light follows its sources");
}
