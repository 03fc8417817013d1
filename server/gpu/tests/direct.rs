//! Direct light on a device against the CPU's: patches of a generated town under suns, lamps and cones, while chunks come
//! and go.

use earthshine_gen::{GenOptions, WorldKind};
use earthshine_gpu::direct::{GpuDirect, RAYS_MIN};
use earthshine_gpu::{AdapterChoice, GpuDevice};
use earthshine_light::{
    DirectLight, LightUnderWay, LitPatch, OccluderSet, Occluders, PatchPoints, direct_irradiance_on,
    told_apart,
};
use earthshine_scene::{ImportOptions, Scene, load_bytes};
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{Asked, ChunkCoord, ChunkId, Light, OccluderMesh, Rgb, SamplePoint, Vec3};
use std::io::Write as _;
use std::sync::Arc;

const EPSILON_M: f32 = 1e-3;

fn device_or_skip() -> Option<GpuDevice> {
    match GpuDevice::open(&AdapterChoice { allow_software: true, ..AdapterChoice::default() }) {
        Ok(device) => Some(device),
        Err(error) => {
            assert!(std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none(), "{error}");
            writeln!(std::io::stderr(), "SKIPPED a test of direct light: {error}").expect("standard error");
            None
        }
    }
}

fn town() -> Scene {
    let options = GenOptions { town_size_m: 60.0, ..GenOptions::default() };
    let glb = earthshine_gen::generate(WorldKind::Town, &options, &|_, _| {}).expect("a town");
    load_bytes(&glb.bytes, "town", &ImportOptions::default()).expect("an importable town")
}

fn id(x: i32) -> ChunkId {
    ChunkId::new(0, ChunkCoord::new(x, 0, 0))
}

/// The scene's triangles in `count` chunks, one in five half transparent.
fn chunks(scene: &Scene, count: usize) -> Vec<Arc<Occluders>> {
    let part = |part: usize| {
        let own: Vec<[Vec3; 3]> = scene.triangles.iter().copied().skip(part).step_by(count).collect();
        let opacity = |at: usize| if at.is_multiple_of(5) { 128 } else { 255 };
        let mesh = OccluderMesh {
            vertices: own.concat(),
            triangles: (0..own.len() as u32).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]).collect(),
            surfaces: (0..own.len()).map(|at| [0, 0, 0, opacity(at)]).collect(),
        };
        Arc::new(Occluders::build(&mesh))
    };
    (0..count).map(part).collect()
}

/// Four points on each of `count` random triangles; every ninth patch has none.
fn patches(scene: &Scene, count: usize) -> Vec<Vec<SamplePoint>> {
    let patch = |patch: usize| {
        let triangle = hash(3, Purpose::SamplePoint, patch as u64, 0) as usize % scene.triangles.len();
        let [a, b, c] = scene.triangles[triangle];
        let normal = scene.normal(triangle);
        let point = |point: u64| {
            let (u, v) = unit_pair(hash(4, Purpose::SamplePoint, patch as u64, point));
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            SamplePoint { position: a + (b - a) * u + (c - a) * v, normal }
        };
        if patch % 9 == 8 { Vec::new() } else { (0..4).map(point).collect() }
    };
    (0..count).map(patch).collect()
}

fn lights(sun_diameter: f32) -> Vec<Light> {
    let position = Vec3::new(5.0, 6.0, -3.0);
    vec![
        Light::Directional {
            direction: Vec3::new(0.36, -0.8, 0.48),
            illuminance: Rgb::new(1e5, 9e4, 8e4),
            angular_diameter_rad: sun_diameter,
        },
        Light::Point { position, intensity: Rgb::splat(4e5), range_m: Some(40.0) },
        Light::Point { position: -position.with_y(-9.0), intensity: Rgb::splat(2e5), range_m: None },
        Light::Spot {
            position: position.with_y(20.0),
            direction: Vec3::NEG_Y,
            intensity: Rgb::new(1e6, 0.0, 2e6),
            inner_cone_rad: 0.3,
            outer_cone_rad: 0.9,
            range_m: None,
        },
    ]
}

fn asked(points: &[Vec<SamplePoint>]) -> Vec<PatchPoints<'_>> {
    (0..).zip(points).map(|(seed, points)| PatchPoints { points, epsilon_m: EPSILON_M, seed }).collect()
}

/// With light on points; and means are the same without, to the bit.
fn lit(
    direct: &mut GpuDirect,
    set: &OccluderSet,
    lights: &[Light],
    patches: &[PatchPoints<'_>],
) -> Vec<LitPatch> {
    let mut light = |wants_points| {
        let light = direct.light(set, lights, patches, wants_points).expect("a device that works");
        light.wait().expect("a device that works")
    };
    let [means, lit] = [light(false), light(true)];
    assert!(means.iter().all(|(_, on_points)| on_points.is_empty()), "nobody wants points");
    assert!(means.iter().map(|of| of.0).eq(lit.iter().map(|of| of.0)), "the same bits");
    lit
}

/// Looks until it has come.
fn looked_for(mut light: Box<dyn LightUnderWay>) -> Asked<Vec<LitPatch>> {
    loop {
        match light.look() {
            Asked::UnderWay => std::thread::yield_now(),
            found => {
                assert_eq!(light.look(), Asked::Lost, "light is given once");
                return found;
            }
        }
    }
}

/// The share of patches whose light is another by more than rounding, and by how much all of it is, as a share.
fn compare(
    direct: &mut GpuDirect,
    set: &OccluderSet,
    lights: &[Light],
    points: &[Vec<SamplePoint>],
) -> (f64, f64) {
    let patches = asked(points);
    let found = lit(direct, set, lights, &patches);
    assert_eq!(found.len(), points.len());
    let (mut elsewhere, mut untold, mut off, mut all) = (0u32, 0u32, 0.0, 0.0);
    for (patch, (found, own)) in patches.iter().zip(found) {
        let (expected, on_points) =
            direct_irradiance_on(set, lights, patch.points, patch.epsilon_m, patch.seed);
        // Points that are told are all of the patch's, differ, and have the mean that is told.
        assert_eq!(told_apart(&own), own);
        assert!(own.is_empty() || own.len() == patch.points.len());
        let mean = own.iter().sum::<Rgb>() / own.len().max(1) as f32;
        assert!(own.is_empty() || (mean - found).abs().max_element() <= 1e-6 * mean.max_element());
        // A shadow's edge that is elsewhere by rounding may make points differ, or alike.
        untold += u32::from(own.is_empty() != on_points.is_empty());
        let gap = (expected - found).abs().max_element();
        elsewhere += u32::from(gap > 2e-4 * expected.max_element().max(1.0));
        off += f64::from(gap);
        all += f64::from(expected.max_element());
    }
    assert!(f64::from(untold) <= 0.05 * patches.len() as f64 + 1.0, "{untold} of {}", patches.len());
    (f64::from(elsewhere) / patches.len().max(1) as f64, off / f64::max(all, 1e-9))
}

#[test]
fn patches_are_lit_as_on_the_cpu_while_chunks_come_and_go() {
    let Some(device) = device_or_skip() else { return };
    let scene = town();
    let (chunks, points) = (chunks(&scene, 12), patches(&scene, 600));
    let mut direct = GpuDirect::new(&device).expect("room");
    let mut set = OccluderSet::new();
    let (elsewhere, _) = compare(&mut direct, &set, &lights(0.0), &points);
    assert_eq!(elsewhere, 0.0, "nothing casts shadows");
    for step in 0..30 {
        // Two come, one goes: more come in all than there is room for at first.
        set.insert(id(step % 12), Arc::clone(&chunks[step as usize % 12]));
        set.insert(id((step + 5) % 12), Arc::clone(&chunks[(step as usize + 5) % 12]));
        set.remove(id((step * 7) % 12));
        let (elsewhere, off) = compare(&mut direct, &set, &lights(0.0), &points);
        assert!(
            elsewhere < 5e-3 && off < 2e-3,
            "step {step}: {elsewhere} of the patches, {off} of the light"
        );
    }
    // Sines are rougher on devices, so places on the disc are as well: as many rays pass, not the same.
    let (_, off) = compare(&mut direct, &set, &lights(0.02), &points);
    assert!(off < 5e-3, "{off} of the light of a sun with a disc");
}

#[test]
fn any_number_of_patches_is_lit() {
    let Some(device) = device_or_skip() else { return };
    let scene = town();
    let mut set = OccluderSet::new();
    for (x, chunk) in (0..).zip(chunks(&scene, 3)) {
        set.insert(id(x), chunk);
    }
    let mut direct = GpuDirect::new(&device).expect("room");
    for count in [0, 1, 63, 64, 65, 200] {
        let (elsewhere, off) = compare(&mut direct, &set, &lights(0.0), &patches(&scene, count));
        assert!(elsewhere * count as f64 <= 1.0 && off < 2e-2, "{count} patches: {elsewhere}, {off}");
        let dark = lit(&mut direct, &set, &[], &asked(&patches(&scene, count)));
        assert!(dark.len() == count && dark.iter().all(|light| *light == LitPatch::default()));
    }
}

/// Goal: questions that are under way together are answered each by its own light, of the casters that were there when it was
/// asked. Method: four questions under other lights while a chunk comes or goes between any two.
#[test]
fn light_under_way_is_of_the_casters_it_was_asked_for() {
    let Some(device) = device_or_skip() else { return };
    let (scene, points) = (town(), patches(&town(), 150));
    let chunks = chunks(&scene, 4);
    let mut direct = GpuDirect::new(&device).expect("room");
    let mut set = OccluderSet::new();
    let (mut under_way, mut expected) = (Vec::new(), Vec::new());
    for step in 0..4 {
        set.insert(id(step), Arc::clone(&chunks[step as usize]));
        set.remove(id(step - 2));
        let lights = &lights(0.0)[step as usize..];
        let alone = lit(&mut GpuDirect::new(&device).expect("room"), &set, lights, &asked(&points));
        under_way.push(direct.begin(&set, lights, &asked(&points), true).expect("a device that works"));
        expected.push(alone);
    }
    for (light, expected) in under_way.into_iter().zip(expected) {
        assert_eq!(looked_for(light), Asked::Done(expected), "the same bits");
    }
}

#[test]
fn a_lost_device_is_left_alone() {
    let Some(device) = device_or_skip() else { return };
    let (scene, set) = (town(), OccluderSet::new());
    let points = patches(&scene, 8);
    let mut direct = GpuDirect::new(&device).expect("room");
    assert_eq!(direct.rays_min(), RAYS_MIN);
    let mut begin = || direct.begin(&set, &lights(0.0), &asked(&points), false);
    let found = looked_for(begin().expect("a device that works"));
    assert!(matches!(found, Asked::Done(light) if !light.is_empty()));
    let mut under_way = begin().expect("a device that works");
    device.destroy();
    assert_eq!(under_way.look(), Asked::Lost, "on its way");
    assert!(begin().is_none(), "lost");
    assert_eq!(direct.rays_min(), usize::MAX);
}

/// Goal: whoever watches the device sees what direct light takes. Method: light is asked for as the engine does, nobody times
/// anything; the first frame is a sample, whose times come with a later one.
#[test]
fn passes_are_sampled_for_whoever_watches() {
    let Some(device) = device_or_skip() else { return };
    let scene = town();
    let (points, lights) = (patches(&scene, 40), lights(0.0));
    let mut set = OccluderSet::new();
    set.insert(id(0), chunks(&scene, 1).remove(0));
    let mut direct = GpuDirect::new(&device).expect("a device that works");
    if !direct.time_passes().expect("a device that works") {
        writeln!(std::io::stderr(), "SKIPPED a test of sampled passes: the adapter has no timestamps")
            .expect("standard error");
        return;
    }
    let mut direct = GpuDirect::new(&device).expect("a device that works");
    let names = ["light_points", "sum_lamps", "sum_points"];
    for _ in 0..60 {
        lit(&mut direct, &set, &lights, &asked(&points));
        if !device.pass_totals().is_empty() {
            break;
        }
    }
    let totals = device.pass_totals();
    assert!(totals.keys().copied().eq(names), "{totals:?}");
    assert!(names.iter().all(|name| totals[name].count == 1 && totals[name].seconds > 0.0), "{totals:?}");
}
