//! The GPU backend passes the suite of its trait on whatever adapter there is; without one these tests say why they are
//! skipped.

use earthshine_bake::Levels;
use earthshine_client::{Camera, ClientOptions, Light, Lights, Vec3};
use earthshine_gen::fixtures;
use earthshine_gpu::alias::AliasBuilder;
use earthshine_gpu::{GpuBackend, GpuDevice, GpuRowLight};
use earthshine_radiosity::Backend;
use earthshine_radiosity::bench::Streamed;
use earthshine_radiosity::closed_box::ClosedBox;
use earthshine_radiosity::solver::{Method, SolverBackend, SolverSettings};
use earthshine_radiosity::tables::edge_rows::edge_rows;
use earthshine_radiosity::tables::{AliasTable, BuildRoom, RowTable};
use earthshine_radiosity::{BackendError, CpuBackend, Slot, Update};
use earthshine_server::BackendKind;
use earthshine_tests::adapter::{device_or_skip, device_splitting};
use earthshine_tests::agreement::{assert_is, served_patches};
use earthshine_tests::backend_suite::{backend_conformance, backend_conformance_at};
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tests::served::ServedWorld;
use earthshine_tests::solved::{Solution, SolvedWorld, place_of};
use earthshine_tests::solver_suite::{drawing_conformance, solver_conformance};
use earthshine_tests::viewer::{connect, settled_at, within};
use earthshine_tiles::BakeParameters;
use earthshine_world::{LightRig, Rgb, Sky};
use std::time::{Duration, Instant};

fn conforms(device: &GpuDevice) {
    backend_conformance(|slots| {
        Box::new(GpuBackend::new(device, slots).expect("a small matrix")) as Box<dyn Backend>
    });
}

#[test]
fn the_gpu_backend_conforms() {
    if let Some(device) = device_or_skip() {
        conforms(&device);
    }
}

/// Goal: several blocks, stripes and sections at once.
#[test]
fn the_gpu_backend_conforms_at_a_larger_size() {
    if let Some(device) = device_or_skip() {
        backend_conformance_at(&[300], |slots| Box::new(GpuBackend::new(&device, slots).expect("small")));
    }
}

/// Goal: planes above a binding are split, and nobody notices. Method: parts of two tiles at most, so that 65 slots
/// take two parts.
#[test]
fn the_gpu_backend_conforms_with_split_planes() {
    if let Some(device) = device_splitting(2 << 14) {
        conforms(&device);
    }
}

/// Goal: light over rows keeps what every solver promises. Method: the suite that the CPU passes.
#[test]
fn solvers_on_a_device_conform() {
    let Some(device) = device_or_skip() else { return };
    solver_conformance(&|| GpuRowLight::factory(&device));
    drawing_conformance(&|| GpuRowLight::factory(&device));
}

/// Goal: nothing of a lost device is ever taken for light. Method: it is destroyed after a step; every call says so.
#[test]
fn a_lost_device_is_an_error_of_every_call() {
    let Some(device) = device_or_skip() else { return };
    let mut backend = GpuBackend::new(&device, 8).expect("a small matrix");
    let add = |slot: u32| Update::Add {
        slot: Slot(slot),
        reflectance: Rgb::splat(0.5),
        area: 1.0,
        row: vec![(Slot(slot), 0.5)],
        column: vec![],
    };
    backend.apply(&[add(0)]).expect("a free slot");
    backend.set_sources(&[Slot(0)], &[Rgb::ONE], &[Rgb::ONE]).expect("taken");
    backend.step().expect("a device that works");
    let waits = device.waits();
    backend.read_irradiance(&[Slot(0)], &mut [Rgb::ZERO]).expect("taken");
    assert!(device.waits() != waits, "whoever reads at once waits, and that is counted");
    backend.set_sources(&[Slot(0)], &[Rgb::ZERO], &[Rgb::ONE]).expect("taken");
    backend.step().expect("a device that works");
    device.destroy();
    assert!(device.is_lost());
    let is_lost = |result: Result<(), BackendError>| matches!(result, Err(BackendError::DeviceLost { .. }));
    assert!(is_lost(backend.read_irradiance(&[Slot(0)], &mut [Rgb::ZERO])));
    assert!(is_lost(backend.apply(&[add(1)]).map(drop)));
    assert!(!backend.is_taken(Slot(1)), "an update of a lost device is none");
    assert!(is_lost(backend.step().map(drop)) && is_lost(backend.resolve()));
    assert!(is_lost(backend.repair(8).map(drop)));
    assert!(backend.drift(1).is_infinite());
    assert!(is_lost(backend.poll_drift(1).map(drop)));
    assert!(is_lost(backend.poll_irradiance(&[Slot(0)], &mut [Rgb::ZERO]).map(drop)));
    assert!(is_lost(backend.clear()) && backend.is_taken(Slot(0)));
    assert!(is_lost(GpuBackend::new(&device, 8).map(drop)));
}

/// Goal: no half of a block is ever told. Method: the device is lost when news of one block, some of whom it
/// refuses, is on its way, and a second block is handed over; nothing is told of anybody after that.
#[test]
fn of_a_block_that_a_device_was_lost_in_nothing_is_told() {
    let Some(device) = device_or_skip() else { return };
    let mut backend = GpuBackend::new(&device, 64).expect("a small matrix");
    let own = |slot: u32| if slot % 5 == 4 { (0.98, 1.0) } else { (0.5, 0.5) };
    let add = |slot: u32| {
        let (reflectance, share) = own(slot);
        let reflectance = Rgb::splat(reflectance);
        Update::Add {
            slot: Slot(slot),
            reflectance,
            area: 1.0,
            row: vec![(Slot(slot), share)],
            column: vec![],
        }
    };
    let updates: Vec<Update> = (0..40).map(add).collect();
    backend.apply(&updates).expect("free slots");
    backend.step().expect("a device that works");
    let more: Vec<Update> = (40..64).map(add).collect();
    backend.apply(&more).expect("free slots");
    device.destroy();
    let (mut news, mut refused) = (Vec::new(), Vec::new());
    assert!(matches!(backend.take_news(&mut news), Err(BackendError::DeviceLost { .. })));
    assert!(matches!(backend.take_refused(&mut refused), Err(BackendError::DeviceLost { .. })));
    assert!(news.is_empty() && refused.is_empty());
}

/// Goal: no tick waits for the device: patches come and go, are refused or not, light of all kinds is told, drift is probed and
/// methods are audited, and the host never stands still for it. Method: a camera flies up and down a corridor of which half
/// fits; what is counted as waits does not grow from the first settled light on. Opening a device and shutting down may wait.
#[tokio::test]
async fn a_flight_waits_for_nothing_on_the_device() {
    let Some(probe) = device_or_skip() else { return };
    let scene = imported(&fixtures::corridor_glb(16.0));
    let lights = LightRig { sky: Sky::constant(Rgb::splat(1e4)), ..own_lights(&scene) };
    let world = BakedWorld::with_levels("corridor", &scene, lights, coarse(1.0, 4), Levels::Exactly(2));
    for method in [Method::Matrix, Method::Hybrid] {
        let served = ServedWorld::start(world.path(), world.patch_count() / 2, |config| {
            config.backend = BackendKind::Gpu;
            config.gpu_adapter = probe.name().to_owned();
            config.engine.solver.by_level = vec![method];
            config.engine.solver.audit_every_ticks = 5;
            config.engine.drift_probe_every_swaps = 20;
        })
        .await;
        let mut client = connect(&served.uri).await;
        let at = |x: f32| Vec3::new(x, 1.6, 1.5);
        settled_at(&mut client, at(2.0)).await;
        let device = served.device.get().expect("a device computes");
        let before = (device.waits(), served.metric("earthshine_gpu_waits_total").await);
        let swaps_before = served.metric("earthshine_engine_patches_added_total").await;
        for step in 0..240u16 {
            let x = 8.0 - 6.0 * (f32::from(step) / 40.0).cos();
            let camera = Camera { position: at(x), forward: Vec3::X, velocity: Vec3::ZERO };
            client.set_camera(camera).expect("the session is open");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        settled_at(&mut client, at(14.0)).await;
        let after = (device.waits(), served.metric("earthshine_gpu_waits_total").await);
        assert_eq!(after, before, "{method}");
        let swaps = served.metric("earthshine_engine_patches_added_total").await - swaps_before;
        assert!(swaps > 100.0, "{method}: {swaps} patches came");
        let told = match method {
            Method::Matrix => "earthshine_engine_drift_probes_total",
            _ => "earthshine_engine_audits_total",
        };
        assert!(served.metric(told).await > 2.0, "{method}");
        client.close().await;
        served.stop().await.expect("a clean end");
    }
}

/// Goal: another method begins without a wait for the device, from light as it was told, and all light is told in the end. Method: the
/// matrix and light over rows on a device in turn, under a lamp that changes with them; what was told is held against the CPU's matrix,
/// to a code's step and what shooting leaves.
#[test]
fn methods_change_without_waiting_for_the_device() {
    let Some(device) = device_or_skip() else { return };
    for is_audited in [false, true] {
        change_methods(&device, is_audited);
    }
}

/// With audits a matrix is kept while light is advanced over rows, and what it had to tell then is old when it takes over again.
fn change_methods(device: &GpuDevice, is_audited: bool) {
    let count = 150;
    let mut streamed = Streamed::new(ClosedBox::new(count * 6 / 5, 5), count, 5);
    let maker = device.clone();
    let make_matrix = move |slots| Ok(Box::new(GpuBackend::new(&maker, slots)?) as Box<dyn Backend>);
    let of = |method| SolverSettings { method, ..SolverSettings::default() };
    let (slots_max, factory) = (count as u32, GpuRowLight::factory(device));
    let mut backend =
        SolverBackend::with_light(slots_max, of(Method::Matrix), Box::new(make_matrix), factory)
            .expect("small");
    backend.set_audited(is_audited).expect("a matrix of the device");
    let mut oracle = CpuBackend::new(slots_max).expect("a small matrix");
    let updates = streamed.enter(count);
    backend.apply(&updates).expect("free slots");
    oracle.apply(&updates).expect("free slots");
    let slots = streamed.taken();
    let (mut told, mut news) = (vec![Rgb::ZERO; count], Vec::new());
    let methods =
        [Method::Matrix, Method::Hybrid, Method::Matrix, Method::Gather, Method::Hybrid, Method::Matrix];
    let (mut lamp, mut before) = (100.0, vec![Rgb::ZERO; count]);
    for method in methods {
        let waits = device.waits();
        let own_at = |lamp: f32| -> Vec<Rgb> {
            slots.iter().map(|slot| Rgb::splat(lamp * f32::from(slot.0 % 16 == 3))).collect()
        };
        if backend.method() == Method::Matrix {
            // A step that nobody asks about, and is nobody's news once the matrix is back.
            let dim = own_at(lamp / 2.0);
            backend.set_sources(&slots, &dim, &dim).expect("taken slots");
            backend.step().expect("a device that works");
        }
        backend.set_solver(&of(method)).expect("a method of the device");
        lamp += 10.0;
        let own = own_at(lamp);
        backend.set_sources(&slots, &own, &own).expect("taken slots");
        oracle.set_sources(&slots, &own, &own).expect("taken slots");
        oracle.step().expect("the CPU steps");
        let mut expected = vec![Rgb::ZERO; count];
        oracle.read_irradiance(&slots, &mut expected).expect("taken slots");
        let began = Instant::now();
        loop {
            backend.take_refused(&mut Vec::new()).expect("a device that works");
            if !backend.is_behind() {
                backend.step().expect("a device that works");
            }
            backend.take_news(&mut news).expect("a device that works");
            for (slot, light) in news.drain(..) {
                let least = 0.99 * before[slot.0 as usize];
                let is_old = method == Method::Matrix && light.cmplt(least).any();
                assert!(!is_old, "{method}, {slot:?}: {light} after {least}");
                told[slot.0 as usize] = light;
            }
            if backend.is_settled() && backend.method() == method {
                break;
            }
            assert!(began.elapsed() < Duration::from_secs(60), "{method} is not settled");
            std::thread::sleep(Duration::from_millis(1));
        }
        for (slot, expected) in slots.iter().zip(expected) {
            let gap = (told[slot.0 as usize] - expected).abs().max_element();
            assert!(gap <= expected.max_element() / 200.0, "{method}, {slot:?}: {gap} of {expected}");
        }
        before.clone_from(&told);
        assert_eq!(device.waits(), waits, "{method}");
    }
}

/// Goal: what a device sends back is what has changed, and once light is at rest nothing has. Method: a camera flies up and down a
/// corridor with detail of which half fits, under a lamp that moves, and comes to rest; bytes are counted meanwhile and afterwards.
#[tokio::test]
async fn light_at_rest_crosses_no_bus() {
    let Some(probe) = device_or_skip() else { return };
    let scene = imported(&fixtures::corridor_glb(16.0));
    let lights = LightRig { sky: Sky::constant(Rgb::splat(1e4)), ..own_lights(&scene) };
    let parameters = BakeParameters { detail: 2, detail_rays: 64, ..coarse(1.0, 4) };
    let world = BakedWorld::with_levels("corridor", &scene, lights, parameters, Levels::Exactly(2));
    for method in [Method::Matrix, Method::Hybrid] {
        let served = ServedWorld::start(world.path(), world.patch_count() / 2, |config| {
            config.backend = BackendKind::Gpu;
            config.gpu_adapter = probe.name().to_owned();
            config.engine.solver.by_level = vec![method];
        })
        .await;
        let mut client = connect(&served.uri).await;
        let at = |x: f32| Vec3::new(x, 1.6, 1.5);
        settled_at(&mut client, at(2.0)).await;
        for step in 0..120u16 {
            let x = 8.0 - 6.0 * (f32::from(step) / 40.0).cos();
            let camera = Camera { position: at(x), forward: Vec3::X, velocity: Vec3::ZERO };
            client.set_camera(camera).expect("the session is open");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        settled_at(&mut client, at(14.0)).await;
        let device = served.device.get().expect("a device computes");
        let in_flight = device.read_back_bytes();
        for what in ["news", "far light", "receivers"] {
            assert!(in_flight.get(what).is_some_and(|&bytes| bytes > 0), "{method}, {what}: {in_flight:?}");
        }
        let ticks = served.metric("earthshine_engine_ticks_total").await;
        while served.metric("earthshine_engine_ticks_total").await < ticks + 60.0 {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        assert_eq!(device.read_back_bytes(), in_flight, "{method}: at rest nothing crosses");
        let counted: u64 = in_flight.values().sum();
        assert_eq!(served.metric("earthshine_gpu_read_back_bytes_total").await, counted as f64);
        client.close().await;
        served.stop().await.expect("a clean end");
    }
}

/// Goal: the service computes on a device, loses it, goes on with light of every patch, opens it again, and ends with the
/// same light. Method: a corridor served on any adapter, held against a solve of the whole; the device is destroyed under
/// it.
#[tokio::test]
async fn a_service_outlives_its_device() {
    outlives(Method::Matrix).await;
}

/// The same, with light over rows on the device.
#[tokio::test]
async fn a_service_that_shoots_outlives_its_device() {
    outlives(Method::Hybrid).await;
}

async fn outlives(method: Method) {
    let Some(probe) = device_or_skip() else { return };
    let scene = imported(&fixtures::corridor_glb(8.0));
    let lights = LightRig { sky: Sky::constant(Rgb::splat(1e4)), ..own_lights(&scene) };
    let world = BakedWorld::new("corridor", &scene, lights, coarse(1.0, 16));
    let solved = SolvedWorld::load(world.path());
    let whole = solved.solve(&solved.lights);
    let served = ServedWorld::start(world.path(), world.patch_count(), |config| {
        config.backend = BackendKind::Gpu;
        config.gpu_adapter = probe.name().to_owned();
        config.engine.retry_after_s = 0.05;
        config.engine.solver.by_level = vec![method];
    })
    .await;
    let own: Lights =
        earthshine_client::world(&served.uri, &ClientOptions::default()).await.expect("a description").lights;
    let mut client = connect(&served.uri).await;
    let centre = Vec3::new(4.0, 1.6, 1.5);
    let check = |light: &Light| match method {
        Method::Matrix => assert_is(&solved, &whole, light),
        _ => assert_is_about(&solved, &whole, light),
    };
    let before = settled_at(&mut client, centre).await;
    check(&before);
    let first = served.device.get().expect("a device computes");
    first.destroy();
    // Lights that change make the engine ask, and find out.
    let reopened = async {
        let mut brighter = 1.0f32;
        while served.device.get().is_none_or(|device| device.is_lost()) {
            // Two scales in turn: each is a change of every patch that emits.
            brighter = 3.0 - brighter;
            let other = Lights { emission_scale: brighter, ..own.clone() };
            client.set_lights(&other).expect("the session is open");
            tokio::time::sleep(Duration::from_millis(20)).await;
            assert_eq!(client.light().patch_count(), before.patch_count(), "light of every patch goes on");
        }
    };
    within("a device that was opened again", reopened).await;
    client.set_lights(&own).expect("the session is open");
    let after = settled_at(&mut client, centre).await;
    check(&after);
    client.close().await;
    served.stop().await.expect("a clean end");
}

/// Asserts that all light together is the solution's, within what shooting leaves and the wire rounds: a patch far darker
/// than the others may be off by more than its own tolerance.
fn assert_is_about(world: &SolvedWorld, solution: &Solution, light: &Light) {
    let served = served_patches(light);
    let (mut gap, mut norm) = (0.0f64, 0.0f64);
    for (index, patch) in world.told() {
        let solved = solution.irradiance[index];
        gap += f64::from((served[&place_of(patch)].irradiance - solved).length_squared());
        norm += f64::from(solved.length_squared());
    }
    let error = (gap / norm).sqrt();
    assert!(error < 3e-3, "{error}");
}

/// Goal: clients see no difference between a device and the CPU but for rounding. Method: a corridor with a sky, served by
/// both; of every patch the published light is the same to a code's step.
#[tokio::test]
async fn a_device_publishes_the_light_of_the_cpu() {
    let Some(probe) = device_or_skip() else { return };
    let scene = imported(&fixtures::corridor_glb(8.0));
    let lights = LightRig { sky: Sky::constant(Rgb::splat(1e4)), ..own_lights(&scene) };
    let world = BakedWorld::new("corridor", &scene, lights, coarse(1.0, 16));
    let solved = SolvedWorld::load(world.path());
    let whole = solved.solve(&solved.lights);
    for method in [Method::Matrix, Method::Gather] {
        let mut published = Vec::new();
        for backend in [BackendKind::Cpu, BackendKind::Gpu] {
            let served = ServedWorld::start(world.path(), world.patch_count(), |config| {
                config.backend = backend;
                config.gpu_adapter = probe.name().to_owned();
                config.engine.solver.by_level = vec![method];
            })
            .await;
            let mut client = connect(&served.uri).await;
            let light = settled_at(&mut client, Vec3::new(4.0, 1.6, 1.5)).await;
            assert_is_about(&solved, &whole, &light);
            published.push(served_patches(&light));
            client.close().await;
            served.stop().await.expect("a clean end");
        }
        let [cpu, device] = &published[..] else { panic!("two backends") };
        assert!(cpu.keys().eq(device.keys()) && cpu.len() > 100, "{} patches", cpu.len());
        for (place, cpu) in cpu {
            let of_device = device[place];
            // Nine bits of mantissa, the first of them set.
            let step = cpu.irradiance.max_element().max(of_device.irradiance.max_element()) / 256.0;
            let gap = (cpu.irradiance - of_device.irradiance).abs().max_element();
            assert!(gap <= step, "{method}, {place:?}: {cpu:?}, {of_device:?}");
            assert_eq!((cpu.sky_irradiance, cpu.quality), (of_device.sky_irradiance, of_device.quality));
        }
    }
}

/// Goal: a device's alias tables are the CPU's. Method: the edge rows, the one with sections among them, and lengths
/// around a workgroup's; every word is compared.
#[test]
fn alias_tables_of_a_device_are_those_of_the_cpu() {
    let Some(device) = device_or_skip() else { return };
    let mut rows: Vec<Vec<f32>> = edge_rows().into_iter().map(|row| row.weights).collect();
    for length in [63usize, 64, 65, 255, 256, 257, 4096, 4097] {
        rows.push((0..length).map(|item| 1.0 / (1.0 + ((item * 7919) % length) as f32)).collect());
    }
    let lengths: Vec<usize> = rows.iter().map(Vec::len).collect();
    let mut builder = AliasBuilder::new(&device, &lengths).expect("small tables");
    builder.set_weights(&rows.concat()).expect("finite weights");
    builder.build().expect("a device that works");
    let words = builder.read().expect("a device that works");
    let (mut table, mut room) = (AliasTable::default(), BuildRoom::default());
    for (row, words) in rows.iter().zip(&words) {
        table.rebuild(row, &mut room).expect("finite weights");
        let expected: Vec<u32> = table.bins().iter().map(|bin| bin.0).collect();
        let first = expected.iter().zip(words).position(|(a, b)| a != b);
        assert!(*words == expected, "{} items: word {first:?} differs", row.len());
    }
    // The same again, to the bit; and nothing of a broken row is uploaded.
    builder.build().expect("a device that works");
    assert_eq!(builder.read().expect("a device that works"), words);
    let mut broken = rows.concat();
    broken[3] = f32::NAN;
    assert!(matches!(builder.set_weights(&broken), Err(BackendError::NotFinite(Slot(3)))));
    assert!(matches!(builder.set_weights(&broken[1..]), Err(BackendError::Length { .. })));
}
