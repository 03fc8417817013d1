//! Direct light computed, receivers and far light gathered on a device, in an engine that streams a world from disk: what it
//! tells is what an engine on the CPU tells. Without an adapter the test says why it is skipped.

use earthshine_bake::Levels;
use earthshine_engine::{Engine, PatchLight};
use earthshine_gen::fixtures;
use earthshine_gpu::GpuDevice;
use earthshine_gpu::direct::GpuDirect;
use earthshine_gpu::receivers::GpuReceivers;
use earthshine_light::{DirectLight, LightUnderWay, OccluderSet, PatchPoints};
use earthshine_radiosity::receivers::{ReceiverGather, ReceiverLight, ReceiverSums};
use earthshine_tests::adapter::device_or_skip;
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tests::on_disk::OnDisk;
use earthshine_tiles::BakeParameters;
use earthshine_world::{Asked, Light, LightRig, Rgb, Sky, Vec3};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A device whose answers are counted.
#[derive(Debug)]
struct Counted {
    receivers: GpuReceivers,
    answers: Arc<AtomicU64>,
}

impl ReceiverLight for Counted {
    fn rows_max(&self) -> usize {
        self.receivers.rows_max()
    }

    fn begin(&mut self, gather: &ReceiverGather<'_>) -> bool {
        self.receivers.begin(gather)
    }

    fn take(&mut self) -> Asked<Vec<ReceiverSums>> {
        let gathering = self.receivers.take();
        let is_answer = matches!(&gathering, Asked::Done(sums) if !sums.is_empty());
        self.answers.fetch_add(u64::from(is_answer), Ordering::Relaxed);
        gathering
    }
}

/// A device that lights however few patches.
#[derive(Debug)]
struct Eager(GpuDirect);

impl DirectLight for Eager {
    fn rays_min(&self) -> usize {
        if self.0.rays_min() == usize::MAX { usize::MAX } else { 0 }
    }

    fn begin(
        &mut self,
        occluders: &OccluderSet,
        lights: &[Light],
        patches: &[PatchPoints<'_>],
        wants_points: bool,
    ) -> Option<Box<dyn LightUnderWay>> {
        self.0.begin(occluders, lights, patches, wants_points)
    }
}

/// An engine that is lit and gathered on `device`; `answers` counts its gathers.
fn on(device: &GpuDevice, answers: &Arc<AtomicU64>) -> impl FnOnce(Engine) -> Engine {
    let (device, answers) = (device.clone(), Arc::clone(answers));
    move |engine: Engine| {
        let engine = engine.lit_by(|| Box::new(Eager(GpuDirect::new(&device).expect("room"))));
        let make = move || {
            let receivers = GpuReceivers::new(&device).expect("a small buffer");
            Box::new(Counted { receivers, answers: Arc::clone(&answers) }) as _
        };
        engine.gathered_by(Box::new(make))
    }
}

fn assert_lights(found: &[PatchLight], expected: &[PatchLight], what: &str) {
    let place = |light: &PatchLight| (light.voxel.to_array(), light.direction);
    assert!(found.iter().map(place).eq(expected.iter().map(place)), "{what}: the same are told");
    assert!(found.len() > 20, "{what}: {}", found.len());
    let brightest = expected.iter().map(|light| light.irradiance.max_element()).fold(0.0, f32::max);
    for (found, expected) in found.iter().zip(expected) {
        let light = |of: &PatchLight| [of.irradiance, of.sky_irradiance];
        for (found, expected) in light(found).into_iter().zip(light(expected)) {
            let gap = (found - expected).abs().max_element();
            assert!(gap <= 1e-5 * brightest, "{what}: {found} for {expected}, of {brightest}");
        }
        let shares = |of: &PatchLight| [of.known_share, of.far_share, of.fed_share];
        for (found, expected) in shares(found).into_iter().zip(shares(expected)) {
            assert!((found - expected).abs() <= 1e-5, "{what}: {found} for {expected}");
        }
    }
}

/// Goal: a device tells the light of the air and of detail that the CPU tells, wherever the camera is, and nobody notices
/// when it is gone. Method: a corridor with detail, three levels and a third of its patches resident; a lamp near a wall; places
/// one after the other, before the last of which the device is destroyed.
#[test]
fn an_engine_that_gathers_on_a_device_tells_what_the_cpu_tells() {
    let Some(device) = device_or_skip() else { return };
    let scene = imported(&fixtures::corridor_glb(16.0));
    let parameters = BakeParameters { detail: 2, detail_rays: 64, ..coarse(1.0, 8) };
    let world =
        BakedWorld::with_levels("corridor", &scene, own_lights(&scene), parameters, Levels::Exactly(3));
    let lamp = |x: f32| {
        let light =
            Light::Point { position: Vec3::new(x, 1.6, 0.4), intensity: Rgb::splat(200.0), range_m: None };
        let sky = Sky { lobes: [1.0, 2.0, 4.0, 8.0, 16.0, 32.0].map(Rgb::splat) };
        LightRig { lights: vec![light], sky, ..own_lights(&scene) }
    };
    let answers = Arc::new(AtomicU64::default());
    let mut on_cpu = OnDisk::new(&world, |engine| engine);
    let mut on_device = OnDisk::new(&world, on(&device, &answers));
    for x in [2.0, 8.0, 14.0, 2.0, 5.0] {
        let answers_before = answers.load(Ordering::Relaxed);
        if x == 5.0 {
            device.destroy();
        }
        let position = Vec3::new(x, 1.6, 1.5);
        let expected = on_cpu.settled_at(position, &lamp(x));
        let found = on_device.settled_at(position, &lamp(x));
        let answered = answers.load(Ordering::Relaxed) - answers_before;
        assert_eq!(answered > 0, !device.is_lost(), "{answered} answers");
        assert!(expected.receivers.iter().any(|light| light.fed_share > 0.01), "far light takes part");
        assert_lights(&found.receivers, &expected.receivers, "air");
        assert_lights(&found.details, &expected.details, "detail");
        assert_lights(&found.patches, &expected.patches, "patches");
        // Light at rest crosses no bus, and what changes for a moment only as far as it changes.
        let read_back = device.read_back_bytes();
        (0..20).for_each(|_| assert!(on_device.tick()));
        assert_eq!(device.read_back_bytes(), read_back, "nothing changes");
    }
    let read_back = device.read_back_bytes();
    for what in ["direct light", "far light", "receivers"] {
        assert!(read_back.get(what).is_some_and(|&bytes| bytes > 0), "{what}: {read_back:?}");
    }
}
