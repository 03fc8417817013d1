//! Ends of rays counted on a device against the CPU twin, `trace::ends::count_ends`: rays from all over a scene, runs of any
//! length and kind, voxels of which some have patches on some sides only, triangles that are left to the host everywhere or
//! in some voxels, sides that are buried everywhere or in some.
//!
//! Sums are of integers and the rays are the same, so runs are equal but where a device, which rounds by itself, sees a
//! crossing on the other side of a voxel's face, or another of two triangles within rounding. Those are counted.

use crate::asked::{device_or_skip, device_within, generated, queries, run_words, say, sides, words};
use earthshine_gen::WorldKind;
use earthshine_gpu::GpuDevice;
use earthshine_gpu::ends::{
    AskedRays, BURIED_OPEN, EndMap, EndPart, EndRun, GpuEnds, KEY_ABSORBED, KEY_SKY, KEY_UNKNOWN, MapVoxel,
    RAY_PARTS, SUM_WHOLE,
};
use earthshine_scene::{ImportOptions, Scene, load, scenes_dir};
use earthshine_trace::ends::{
    Buried, BuriedHere, EndPlaces, EndTriangle, EndVoxel, NO_PATCH, Run, RunEnds, RunSum, count_ends,
};
use earthshine_trace::{Query, SceneTracer};
use earthshine_world::random::{Purpose, hash, unit_f32};
use earthshine_world::{AxisWeights, Direction, Vec3};
use std::collections::BTreeMap;

/// Of all rays, those that may be counted elsewhere by rounding.
const ELSEWHERE_MAX: f64 = 2e-3;
/// Rounding of one weighed part.
const ROUNDING: u32 = 1;

/// Places where three in four voxels that rays meet have patches on four in five sides; one triangle in ten is the host's,
/// one side in five is buried, another one in some voxels.
fn places(scene: &Scene, tracer: &SceneTracer<'_>, rays: &[Query], voxel_edge_m: f32) -> EndPlaces {
    let chance = |kind: u64, at: u64| unit_f32(hash(3, Purpose::Simulation, kind, at));
    let off_surface_m = 1e-3 * voxel_edge_m;
    let mut voxels = BTreeMap::new();
    for ray in rays {
        let Some(hit) = tracer.closest(ray.origin, ray.direction, 0.0, ray.distance_max) else { continue };
        let before = ray.origin + ray.direction * hit.distance + tracer.normal(&hit) * off_surface_m;
        let voxel = (before / voxel_edge_m).floor().as_ivec3();
        let number = voxels.len() as u32 * 6;
        let patch = |side: u64| {
            let is_there = chance(u64::from(number) + side, 1) < 0.8;
            if is_there { number + side as u32 } else { NO_PATCH }
        };
        voxels.entry(voxel.to_array()).or_insert_with(|| EndVoxel {
            voxel,
            patches: [0, 1, 2, 3, 4, 5].map(patch),
            asks_host: chance(u64::from(number), 4) < 0.3,
            // One in four where both are, which the host has to tell apart.
            buried: BuriedHere {
                buried: (chance(u64::from(number), 6) * 64.0) as u8,
                open: (chance(u64::from(number), 7) * 64.0) as u8,
            },
        });
    }
    let triangle = |index: usize| {
        let normal = scene.normal(index);
        let weights = AxisWeights::Squared.of(normal).map(|(_, weight)| weight);
        let is_for_host_in_places = chance(index as u64, 5) < 0.3;
        let buried = [8, 9].map(|of| match chance(index as u64, of) {
            0.0..0.2 => Buried::Everywhere,
            0.2..0.4 => Buried::InPlaces,
            _ => Buried::Nowhere,
        });
        let is_for_host = chance(index as u64, 2) < 0.1;
        EndTriangle { is_for_host_in_places, buried, ..EndTriangle::new(normal, weights, is_for_host) }
    };
    EndPlaces {
        voxel_edge_m,
        off_surface_m,
        triangles: (0..scene.triangles.len()).map(triangle).collect(),
        voxels: voxels.into_values().filter(|voxel| chance(u64::from(voxel.patches[0]), 3) < 0.75).collect(),
    }
}

/// Runs of all lengths and kinds over `rays`, some over the same rays.
fn runs(rays: u32) -> Vec<Run> {
    let facing = Direction::ALL.into_iter().map(RunSum::Facing);
    let sums: Vec<RunSum> = facing.chain([RunSum::Whole, RunSum::Absorbed]).collect();
    let (mut runs, mut first) = (Vec::new(), 0);
    for sum in sums.iter().cycle() {
        for count in [0, 1, 63, 64, 65, 256, 257, 512] {
            if first + count > rays {
                return runs;
            }
            let run = Run { first_ray: first, ray_count: count, sum: *sum };
            runs.extend([run, Run { sum: RunSum::Whole, ..run }]);
            first += count;
        }
    }
    runs
}

/// A run's parts by key; the twin's as a device lists them.
fn listed(parts: &[EndPart]) -> BTreeMap<u32, u32> {
    let listed: BTreeMap<u32, u32> = parts.iter().map(|part| (part.key, part.parts)).collect();
    assert_eq!(listed.len(), parts.len(), "a key is listed once");
    listed
}

fn twin_listed(ends: &RunEnds) -> BTreeMap<u32, u32> {
    let sky = (KEY_SKY..).zip(ends.sky).filter(|(_, parts)| *parts > 0);
    let unknown = ends.unknown.iter().map(|place| (KEY_UNKNOWN + place, 1));
    let absorbed = (ends.absorbed > 0).then_some((KEY_ABSORBED, ends.absorbed));
    ends.patches.iter().copied().chain(sky).chain(absorbed).chain(unknown).collect()
}

/// Holds a device against the twin.
fn compare(device: &GpuDevice, name: &str, scene: &Scene, voxel_edge_m: f32) {
    let tracer = SceneTracer::new(scene);
    let rays = queries(scene, 20_000);
    let places = places(scene, &tracer, &rays, voxel_edge_m);
    let voxel = |&EndVoxel { voxel, patches, asks_host, buried }: &EndVoxel| MapVoxel {
        voxel: voxel.to_array(),
        patches,
        asks_host,
        buried: u32::from(buried.buried) | u32::from(buried.open) << BURIED_OPEN,
    };
    let voxels: Vec<MapVoxel> = places.voxels.iter().map(voxel).collect();
    let sides = sides(&places.triangles);
    let map = EndMap { sides: &sides, voxels: &voxels, voxel_edge_m, off_surface_m: places.off_surface_m };
    let mut ends = GpuEnds::new(device, &tracer.layout(), &sides, 1 << 15).expect("trees that fit");
    ends.settle(&map).expect("a map that fits");
    let mut beside = ends.beside().expect("as much room again");
    let runs = runs(rays.len() as u32);
    let asked: Vec<EndRun> = runs.iter().map(run_words).collect();
    let words = words(&rays);
    let found = ends.count(AskedRays::Made(&words), &asked).expect("a device that works");
    let again = beside.count(AskedRays::Made(&words), &asked).expect("a device that works");
    let expected = count_ends(&tracer, &places, &rays, &runs);
    let (mut same, mut elsewhere, mut keys) = (0, 0u64, [0usize; 4]);
    for (at, (found, expected)) in found.runs.iter().zip(&expected).enumerate() {
        let (found, expected) = (listed(found), twin_listed(expected));
        assert_eq!(found, listed(&again.runs[at]), "{name}: the same again");
        let count = runs[at].ray_count;
        let room = |key: &u32| if *key >= KEY_UNKNOWN && *key < KEY_SKY { 0 } else { ROUNDING * count };
        let all: std::collections::BTreeSet<u32> = found.keys().chain(expected.keys()).copied().collect();
        let off = |key: &u32| {
            let parts = |of: &BTreeMap<u32, u32>| of.get(key).copied().unwrap_or(0);
            u64::from(parts(&found).abs_diff(parts(&expected)).saturating_sub(room(key)))
        };
        let off: u64 = all.iter().map(off).sum();
        same += usize::from(off == 0);
        elsewhere += off;
        for key in expected.keys() {
            let kind = [KEY_UNKNOWN, KEY_SKY, KEY_ABSORBED].iter().filter(|first| key >= first).count();
            keys[kind] += 1;
        }
    }
    let count = runs.len();
    let read = found.read_bytes as f64 / rays.len() as f64;
    println!(
        "{name}: {same} of {count} runs are the same; {read:.1} bytes read a ray; {keys:?} patches, returned, lobes, absorbed"
    );
    assert!(keys[..2].iter().chain(&keys[3..]).all(|&kind| kind > 0), "{name}: {keys:?}");
    // A ray elsewhere leaves one key and comes to another.
    let all = runs.iter().map(|run| f64::from(run.ray_count)).sum::<f64>() * f64::from(2 * RAY_PARTS);
    assert!(elsewhere as f64 <= ELSEWHERE_MAX * all, "{name}: {elsewhere} parts of {all} are elsewhere");
}

#[test]
fn generated_worlds_are_counted_as_on_the_cpu() {
    let Some(device) = device_or_skip() else { return };
    for (kind, voxel_edge_m) in [(WorldKind::Cornell, 0.25), (WorldKind::Town, 2.0)] {
        let scene = generated(kind, 1, 60.0);
        compare(&device, &format!("{kind:?}"), &scene, voxel_edge_m);
    }
}

#[test]
fn shared_scenes_are_counted_as_on_the_cpu() {
    let Some(device) = device_or_skip() else { return };
    let Some(folder) = scenes_dir() else {
        say("SKIPPED a test of counted ends: no shared scenes beside the project");
        return;
    };
    for name in ["sponza", "terrain"] {
        let scene =
            load(&folder.join(format!("{name}.glb")), &ImportOptions::default()).expect("a good file");
        compare(&device, name, &scene, 1.0);
    }
}

#[test]
fn a_device_without_room_for_a_run_is_refused() {
    let Some(small) = device_within(1 << 13) else { return };
    let refused = GpuEnds::new(&small, &Default::default(), &[], 64).expect_err("8 KiB").to_string();
    assert!(refused.contains("8192") && refused.contains("CPU"), "{refused}");
}

/// Goal: what is not there is counted right: no runs, no rays, no triangles, no voxels.
#[test]
fn nothing_is_counted_in_nothing() {
    let Some(device) = device_or_skip() else { return };
    let map = EndMap { sides: &[], voxels: &[], voxel_edge_m: 1.0, off_surface_m: 1e-3 };
    let mut ends = GpuEnds::new(&device, &Default::default(), &[], 64).expect("no trees");
    ends.settle(&map).expect("nothing fits");
    let nothing = [AskedRays::Made(&[]), AskedRays::Fans(&[])];
    for rays in nothing {
        assert!(ends.count(rays, &[]).expect("a device that works").runs.is_empty());
        let run = EndRun { first_ray: 0, ray_count: 0, sum: SUM_WHOLE };
        assert_eq!(ends.count(rays, &[run]).expect("a device that works").runs, [Vec::new()]);
    }
    let rays = words(&[Query { origin: Vec3::ZERO, direction: Vec3::NEG_Y, distance_max: f32::INFINITY }]);
    let run = EndRun { first_ray: 0, ray_count: 1, sum: SUM_WHOLE };
    let sky = EndPart { key: KEY_SKY + 3, parts: RAY_PARTS };
    assert_eq!(ends.count(AskedRays::Made(&rays), &[run]).expect("a device that works").runs, [vec![sky]]);
}
