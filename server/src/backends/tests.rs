//! Who computes: refusals, limits, and what happens when a device is lost.

use super::*;
use crate::device_source::DeviceCounts;
use earthshine_radiosity::bench::Streamed;
use earthshine_radiosity::closed_box::ClosedBox;
use earthshine_radiosity::solver::DrawnRows;
use earthshine_world::Rgb;
use std::io::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

fn config(backend: BackendKind, gpu_adapter: &str) -> Config {
    Config { backend, gpu_adapter: gpu_adapter.to_owned(), ..Config::default() }
}

fn any() -> AdapterChoice {
    AdapterChoice { allow_software: true, ..AdapterChoice::default() }
}

/// A device, or none with the reason printed; none is a failure where CI says so.
fn device_or_skip(opened: Result<GpuDevice, earthshine_gpu::GpuError>) -> Option<GpuDevice> {
    opened
        .inspect_err(|error| {
            assert!(std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none(), "{error}");
            // Past the test harness, which swallows what passing tests print.
            let said = writeln!(std::io::stderr(), "SKIPPED a test of devices: {error}");
            said.expect("standard error");
        })
        .ok()
}

/// A lit room whose light is computed by a backend.
struct Room<'a> {
    backend: &'a mut dyn Backend,
    streamed: Streamed,
}

impl<'a> Room<'a> {
    fn new(backend: &'a mut dyn Backend, patches: usize) -> Self {
        let mut streamed = Streamed::new(ClosedBox::new(patches + 9, 5), patches, 5);
        let entering = streamed.enter(patches);
        backend.apply(&entering).expect("free slots");
        let mut room = Self { backend, streamed };
        room.shine();
        room
    }

    fn shine(&mut self) {
        let slots = self.streamed.taken();
        let own: Vec<Rgb> = slots.iter().map(|&slot| self.streamed.source(slot)).collect();
        self.backend.set_sources(&slots, &own, &vec![Rgb::ONE; slots.len()]).expect("taken slots");
    }

    fn swap(&mut self) {
        let mut updates = self.streamed.leave(3);
        updates.extend(self.streamed.enter(3));
        self.backend.apply(&updates).expect("sound updates");
        self.shine();
    }

    fn light(&mut self) -> Vec<Rgb> {
        let slots = self.streamed.taken();
        let mut light = vec![Rgb::ZERO; slots.len()];
        self.backend.read_irradiance(&slots, &mut light).expect("taken slots");
        light
    }

    /// A frame; the darkest patch's light.
    fn step(&mut self) -> f32 {
        self.backend.step().expect("light goes on");
        self.light().iter().map(|light| light.max_element()).fold(f32::INFINITY, f32::min)
    }
}

/// A device's driver that may take its time.
const SLOW: Duration = Duration::from_secs(2);
/// Longest frame meanwhile: far above a frame of a small room, far below what the driver takes.
const FRAME_MAX: Duration = Duration::from_millis(400);

/// Goal: a lost device is opened again while frames go on, no longer than others and never black; then it is used again.
/// Method: an opener that takes two seconds, swaps meanwhile, and a second loss, which only who is on the device notices.
#[test]
fn light_goes_on_while_a_lost_device_is_opened_again() {
    for method in [Method::Matrix, Method::Hybrid] {
        let is_slow = Arc::new(AtomicBool::new(false));
        let slow = Arc::clone(&is_slow);
        let open = move || {
            std::thread::sleep(if slow.load(Ordering::Relaxed) { SLOW } else { Duration::ZERO });
            GpuDevice::open(&any())
        };
        if device_or_skip(open()).is_none() {
            return;
        }
        let backends = Backends::open_by(&config(BackendKind::Gpu, ""), Arc::new(open)).expect("a device");
        let solver = SolverConfig { by_level: vec![method], ..SolverConfig::default() };
        let mut backend = (backends.solving(&solver))(100).expect("a small backend");
        backend.set_solver(&solver.settings(0, 100, 1)).expect("sound settings");
        let mut room = Room::new(&mut *backend, 100);
        (0..50).for_each(|_| assert!(room.step() > 0.0));
        let before = room.light();
        is_slow.store(true, Ordering::Relaxed);
        for losses in 1..=2 {
            let lost = backends.device().get().expect("there is one");
            lost.destroy();
            let (began, mut frames, mut longest) = (Instant::now(), 0, Duration::ZERO);
            while backends.device().counts().reopened < losses {
                assert!(began.elapsed() < 20 * SLOW, "{method}: it never comes back");
                let frame = Instant::now();
                if frames % 8 == 7 {
                    room.swap();
                }
                assert!(room.step() > 0.0, "{method}, frame {frames}: black");
                longest = longest.max(frame.elapsed());
                frames += 1;
                std::thread::sleep(Duration::from_millis(10));
            }
            assert!(began.elapsed() >= SLOW && frames > 20, "{method}: {frames} frames");
            assert!(longest < FRAME_MAX, "{method}: a frame of {longest:?}");
            // The matrix is made a few patches a frame.
            (0..50).for_each(|_| assert!(room.step() > 0.0, "{method}: black on the way back"));
        }
        let counts = DeviceCounts { reopened: 2, ..DeviceCounts::default() };
        assert_eq!(backends.device().counts(), counts, "{method}: both losses were noticed");
        let sum = |light: &[Rgb]| light.iter().map(|light| f64::from(light.element_sum())).sum::<f64>();
        let change = sum(&room.light()) / sum(&before);
        assert!((0.8..1.25).contains(&change), "{method}: {change} of the light before");
    }
}

/// Goal: a device that cannot be opened again leaves light to the CPU, for new backends too. Method: an opener that works
/// once.
#[test]
fn light_stays_on_the_cpu_where_no_device_comes_back() {
    let is_over = AtomicBool::new(false);
    let open = move || match is_over.swap(true, Ordering::Relaxed) {
        true => Err(earthshine_gpu::GpuError::NoAdapter),
        false => GpuDevice::open(&any()),
    };
    let Ok(backends) = Backends::open_by(&config(BackendKind::Gpu, ""), Arc::new(open)) else {
        device_or_skip(GpuDevice::open(&any()));
        return;
    };
    let solver = SolverConfig { by_level: vec![Method::Matrix], ..SolverConfig::default() };
    let mut factory = backends.solving(&solver);
    let mut backend = factory(100).expect("a small backend");
    let mut room = Room::new(&mut *backend, 100);
    room.step();
    backends.device().get().expect("there is one").destroy();
    let began = Instant::now();
    while backends.device().counts().failed == 0 {
        assert!(room.step() > 0.0 && began.elapsed() < 20 * SLOW);
    }
    for _ in 0..5 {
        room.swap();
        assert!(room.step() > 0.0);
    }
    let mut other = factory(100).expect("the CPU's");
    assert!(Room::new(&mut *other, 100).step() > 0.0);
    assert_eq!(backends.device().counts(), DeviceCounts { failed: 1, ..DeviceCounts::default() });
}

/// Goal: what no kernel draws is the CPU's light and counted, or refused with a cure; light goes on in both cases. Method:
/// adaptive draws, and draws from rows of the matrix.
#[test]
fn draws_that_no_kernel_makes_are_left_to_the_cpu_or_refused() {
    if device_or_skip(GpuDevice::open(&any())).is_none() {
        return;
    }
    let open: Arc<Open> = Arc::new(|| GpuDevice::open(&any()));
    let backends = Backends::open_by(&config(BackendKind::Gpu, ""), open).expect("a device");
    let drawn = SolverConfig { by_level: vec![Method::Cdf], ..SolverConfig::default() };
    let mut backend = (backends.solving(&drawn))(40).expect("a small backend");
    let mut room = Room::new(&mut *backend, 40);
    let adaptive = SolverConfig { adaptive: true, ..drawn.clone() };
    assert_eq!(room.backend.set_solver(&drawn.settings(0, 40, 1)), Ok(true));
    assert_eq!(backends.device().counts().left_to_cpu, 0);
    assert_eq!(room.backend.set_solver(&adaptive.settings(0, 40, 1)), Ok(true));
    assert_eq!(backends.device().counts().left_to_cpu, 1, "the CPU's, and counted");
    assert!(room.step() > 0.0);
    let coloured = SolverConfig { drawn_rows: DrawnRows::Multibounce, ..drawn };
    let refused = room.backend.set_solver(&coloured.settings(0, 40, 1));
    let Err(cause) = refused else { panic!("a device shows no rows of its matrix") };
    assert!(cause.to_string().contains("compute on the CPU"), "{cause}");
    assert!(room.step() > 0.0, "as before");
}

/// Goal: no adapter is a refusal with a cure if one was asked for, and the CPU if not. Method: an adapter that
/// nobody has.
#[test]
fn without_an_adapter_gpu_is_refused_and_auto_computes_on_the_cpu() {
    let name = "an adapter that nobody has";
    let Err(error) = Backends::open(&config(BackendKind::Gpu, name)) else { panic!("there is none") };
    assert!(matches!(error, ServerError::Gpu(_)) && error.exit_code() == 5, "{error}");
    for kind in [BackendKind::Auto, BackendKind::Cpu] {
        let backends = Backends::open(&config(kind, name)).expect("the CPU is there");
        assert_eq!(backends.matrices()(8).expect("a small matrix").capacity(), 8);
        assert!(backends.device().get().is_none());
    }
}

/// Goal: who wants no subgroups gets kernels without.
#[test]
fn subgroups_are_used_unless_they_are_not_wanted() {
    let Some(device) = device_or_skip(GpuDevice::open(&any())) else { return };
    for gpu_subgroups in [true, false] {
        let config = Config { gpu_subgroups, ..config(BackendKind::Gpu, device.name()) };
        let opened =
            Backends::open(&config).expect("it was open before").device().get().expect("there is one");
        let expected = device.subgroup_lanes().filter(|_| gpu_subgroups);
        assert_eq!(opened.subgroup_lanes(), expected, "gpu_subgroups = {gpu_subgroups}");
    }
}

/// Goal: a device whose limits are below the configured size gives as many slots as it may, and says so, or is refused
/// where fewer are not wanted. Method: any adapter, bound to small buffers.
#[test]
fn limits_below_the_size_are_fewer_slots_or_a_refusal() {
    let open = || GpuDevice::open_within(&any(), 1 << 20);
    let Some(device) = device_or_skip(open()) else { return };
    let most = memory::slots_max(device.binding_bytes_max());
    assert!((1..4096).contains(&most), "{most}");
    assert_eq!(on_device(&device, 4096, false).expect("fewer").capacity(), most);
    assert!(matches!(on_device(&device, 4096, true), Err(BackendError::OutOfMemory { slots: 4096, .. })));
    let mut config = config(BackendKind::Gpu, "");
    config.engine.resident_patches_max = 4096;
    let backends = Backends::open_by(&config, Arc::new(open)).expect("fewer are said");
    // A matrix of as many slots as there may be, and light over as many rows.
    let mut backend = (backends.solving(&config.engine.solver))(4096).expect("a smaller matrix");
    assert_eq!(backend.capacity(), most);
    let mut room = Room::new(&mut *backend, 40);
    assert!(room.step() > 0.0);
    config.gpu_strict = true;
    let Err(error) = Backends::open_by(&config, Arc::new(open)) else { panic!("strictly, 4096 do not fit") };
    assert!(
        matches!(&error, ServerError::GpuSlots { wanted: 4096, most: found, .. } if *found == most),
        "{error}"
    );
    assert!(error.exit_code() == 5 && error.to_string().contains("gpu_strict"), "{error}");
    config.engine.resident_patches_max = most;
    assert!(Backends::open_by(&config, Arc::new(open)).is_ok(), "as many as there are");
}

/// Goal: a device without room gives fewer slots, or an error if fewer are not wanted; other errors are not retried.
#[test]
fn want_of_memory_halves_unless_strict() {
    let small = |capacity| {
        if capacity > 10 {
            Err(BackendError::OutOfMemory { slots: capacity, bytes: 1 })
        } else {
            on_cpu(capacity)
        }
    };
    assert_eq!(halving(64, 64, false, small).expect("8 fit").capacity(), 8);
    assert!(matches!(halving(64, 64, true, small), Err(BackendError::OutOfMemory { .. })));
    let none = |capacity| Err(BackendError::OutOfMemory { slots: capacity, bytes: 1 });
    assert!(matches!(halving(64, 64, false, none), Err(BackendError::SlotOutside(Slot(64), 0))));
    let lost = |_| Err(BackendError::DeviceLost { cause: "gone".to_owned() });
    assert!(matches!(halving(64, 64, false, lost), Err(BackendError::DeviceLost { .. })));
}
