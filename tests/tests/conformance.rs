//! Backends and stores are interchangeable: each passes the suite of its trait; and the suites can fail.

mod flawed;

use earthshine_radiosity::solver::{CpuRowLight, Method, SolverBackend, SolverSettings};
use earthshine_radiosity::{Backend, CpuBackend};
use earthshine_tests::backend_suite::backend_conformance;
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tests::solver_suite::{drawing_conformance, solver_conformance};
use earthshine_tests::store_suite::store_conformance;
use earthshine_tiles::{DirStore, FaultPlan, FaultyStore, Manifest};
use flawed::{Flaw, FlawedBackend};
use std::panic::{AssertUnwindSafe, catch_unwind};

fn cpu(slots: u32) -> CpuBackend {
    CpuBackend::new(slots).expect("a small matrix")
}

#[test]
fn the_cpu_backend_conforms() {
    backend_conformance(|slots| Box::new(cpu(slots)) as Box<dyn Backend>);
}

#[test]
fn a_solver_backend_with_a_matrix_conforms() {
    backend_conformance(|slots| {
        let make = |slots| Ok(Box::new(cpu(slots)) as Box<dyn Backend>);
        let settings = SolverSettings { method: Method::Matrix, ..SolverSettings::default() };
        Box::new(SolverBackend::new(slots, settings, Box::new(make)).expect("a small matrix"))
    });
}

#[test]
fn solvers_on_the_cpu_conform() {
    solver_conformance(&CpuRowLight::factory);
    drawing_conformance(&CpuRowLight::factory);
}

/// Goal: the suite notices. Method: the CPU backend with one small flaw at a time.
#[test]
fn a_flawed_backend_does_not_conform() {
    for flaw in Flaw::ALL {
        let run = || backend_conformance(|slots| Box::new(FlawedBackend::new(cpu(slots), flaw)));
        assert!(catch_unwind(run).is_err(), "{flaw:?} went unnoticed");
    }
}

fn corridor() -> BakedWorld {
    let scene = imported(&earthshine_gen::fixtures::corridor_glb(16.0));
    BakedWorld::new("corridor", &scene, own_lights(&scene), coarse(1.0, 8))
}

fn opened(world: &BakedWorld) -> (DirStore, Manifest) {
    let store = DirStore::open(world.path()).expect("a world");
    let manifest = store.manifest().clone();
    (store, manifest)
}

#[test]
fn a_folder_of_tiles_conforms() {
    let world = corridor();
    let (store, manifest) = opened(&world);
    store_conformance(store, &manifest);
}

#[test]
fn a_store_whose_faults_are_off_conforms_and_one_whose_faults_are_on_does_not() {
    let world = corridor();
    let (store, manifest) = opened(&world);
    store_conformance(FaultyStore::new(store, FaultPlan::none(3)), &manifest);
    let (store, _) = opened(&world);
    let store = FaultyStore::new(store, FaultPlan { flipped_rate: 0.05, ..FaultPlan::none(3) });
    let run = AssertUnwindSafe(|| store_conformance(store, &manifest));
    assert!(catch_unwind(run).is_err(), "a flipped bit went unnoticed");
}
