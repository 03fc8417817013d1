//! Backends and stores are interchangeable: each passes the suite of its trait.

use earthshine_radiosity::{Backend, CpuBackend};
use earthshine_tests::backend_suite::backend_conformance;
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tests::store_suite::store_conformance;
use earthshine_tiles::{DirStore, FaultPlan, FaultyStore};

#[test]
fn the_cpu_backend_conforms() {
    backend_conformance(|slots| {
        Box::new(CpuBackend::new(slots).expect("a small matrix")) as Box<dyn Backend>
    });
}

fn corridor() -> BakedWorld {
    let scene = imported(&earthshine_gen::fixtures::corridor_glb(16.0));
    BakedWorld::new("corridor", &scene, own_lights(&scene), coarse(1.0, 8))
}

#[test]
fn a_folder_of_tiles_conforms() {
    let world = corridor();
    let store = DirStore::open(world.path()).expect("a world");
    let manifest = store.manifest().clone();
    store_conformance(store, &manifest);
}

#[test]
fn a_store_whose_faults_are_off_conforms() {
    let world = corridor();
    let store = DirStore::open(world.path()).expect("a world");
    let manifest = store.manifest().clone();
    store_conformance(FaultyStore::new(store, FaultPlan::none(3)), &manifest);
}
