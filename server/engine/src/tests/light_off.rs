//! Light off returns to exactly the earlier state: every kind of light, on the local matrix, to the bit; on patches, in the
//! air and in detail.

use super::backend::Faults;
use super::harness::{ALICE, Harness, factory, generous};
use super::world::{RandomWorld, WorldShape};
use crate::{BackendFactory, EngineConfig, Frame, PatchLight};
use earthshine_radiosity::CpuBackend;
use earthshine_world::{Light, LightRig, Rgb, Sky, Vec3};

const PATCHES: u32 = 60;

fn cpu() -> BackendFactory {
    Box::new(|capacity| Ok(Box::new(CpuBackend::new(capacity).unwrap())))
}

fn sun(illuminance: f32) -> Light {
    Light::Directional {
        direction: Vec3::new(0.48, -0.8, 0.36),
        illuminance: Rgb::new(1.0, 0.9, 0.7) * illuminance,
        angular_diameter_rad: 0.0093,
    }
}

fn point() -> Light {
    Light::Point { position: Vec3::splat(2.0), intensity: Rgb::splat(100.0), range_m: Some(30.0) }
}

fn spot() -> Light {
    Light::Spot {
        position: Vec3::new(1.0, 3.0, 1.0),
        direction: Vec3::new(0.0, -0.8, 0.6),
        intensity: Rgb::new(300.0, 200.0, 100.0),
        inner_cone_rad: 0.4,
        outer_cone_rad: 1.2,
        range_m: None,
    }
}

/// Everything on.
fn full() -> LightRig {
    LightRig {
        lights: vec![sun(1e3), point(), spot()],
        sky: Sky::gradient(Rgb::new(1.0, 2.0, 4.0), Rgb::splat(3.0), Rgb::splat(0.5)),
        emission_scale: 1.0,
    }
}

/// One change at a time: its name and what is then on.
fn changes() -> Vec<(&'static str, LightRig)> {
    let without = |index: usize| {
        let mut rig = full();
        rig.lights.remove(index);
        rig
    };
    let mut moved = full();
    moved.lights[1] =
        Light::Point { position: Vec3::new(4.0, 1.0, 3.0), intensity: Rgb::splat(50.0), range_m: None };
    let mut dimmed = full();
    dimmed.lights[0] = sun(0.0);
    vec![
        ("no sun", without(0)),
        ("a sun of no illuminance", dimmed),
        ("no point light", without(1)),
        ("a point light elsewhere", moved),
        ("no spot", without(2)),
        ("no sky", LightRig { sky: Sky::default(), ..full() }),
        ("emitters off", LightRig { emission_scale: 0.0, ..full() }),
        ("emitters up", LightRig { emission_scale: 3.0, ..full() }),
        ("one lamp more", LightRig { lights: [full().lights, vec![point()]].concat(), ..full() }),
        ("all off", LightRig { emission_scale: 0.0, ..LightRig::default() }),
    ]
}

/// A world with light in the air, and one with detail.
fn worlds() -> [RandomWorld; 2] {
    let shape =
        WorldShape { chunks: [5, 2, 4], patches_per_chunk_max: 12, links_per_patch: 8, has_occluders: true };
    [RandomWorld::new(24, shape), super::detail::world(5)]
}

fn harness(world: RandomWorld, config: EngineConfig, backends: BackendFactory) -> Harness {
    let mut harness = Harness::with_backends(world, config, backends).with_camera(Vec3::ZERO);
    harness.light(ALICE, full());
    harness.settle();
    harness
}

/// Everything that a frame tells, patches first.
fn told(frame: &Frame) -> Vec<PatchLight> {
    frame.patches.iter().chain(frame.receivers.iter()).chain(frame.details.iter()).copied().collect()
}

/// All light of a frame as bits: `==` takes minus zero for zero.
fn bits(lights: &[PatchLight]) -> Vec<[u32; 6]> {
    let of = |light: &PatchLight| {
        let [a, b, c] = light.irradiance.to_array();
        let [d, e, f] = light.sky_irradiance.to_array();
        [a, b, c, d, e, f].map(f32::to_bits)
    };
    lights.iter().map(of).collect()
}

/// How many lights are other than before.
fn changed(now: &[PatchLight], before: &[PatchLight]) -> usize {
    now.iter().zip(before).filter(|(a, b)| a.irradiance != b.irradiance).count()
}

#[test]
fn every_light_that_goes_and_comes_back_leaves_no_trace() {
    let all = worlds()
        .into_iter()
        .flat_map(|world| [cpu(), factory(Faults::default())].map(|backends| (world.clone(), backends)));
    for (world, backends) in all {
        let mut harness = harness(world, generous(PATCHES), backends);
        let frame = harness.frame(ALICE);
        let beside = frame.receivers.len() + frame.details.len();
        assert!(frame.patches.len() == PATCHES as usize && beside > 30, "{beside} beside patches");
        let start = told(frame);
        for (name, rig) in changes() {
            harness.light(ALICE, rig);
            harness.settle();
            let between = told(harness.frame(ALICE));
            let (on_patches, others) = between.split_at(PATCHES as usize);
            let of_patches = changed(on_patches, &start[..PATCHES as usize]);
            let of_others = changed(others, &start[PATCHES as usize..]);
            assert!(of_patches > on_patches.len() / 4, "{name}: {of_patches} patches changed");
            assert!(of_others > others.len() / 4, "{name}: {of_others} of {} others changed", others.len());
            harness.light(ALICE, full());
            harness.settle();
            let back = told(harness.frame(ALICE));
            assert!(bits(&back) == bits(&start), "{name}: {} lights differ", changed(&back, &start));
        }
    }
}

/// Goal: the way to a state does not matter. Method: budgets so small that light changes again before the last change
/// has reached every patch, or any of what stands beside them.
#[test]
fn changes_that_overtake_each_other_leave_no_trace() {
    let config =
        EngineConfig { shadow_points_per_tick_max: 8, receiver_rows_per_tick_max: 7, ..generous(PATCHES) };
    for world in worlds() {
        let mut harness = harness(world, config.clone(), cpu());
        let start = told(harness.frame(ALICE));
        for (_, rig) in changes() {
            harness.light(ALICE, rig);
            harness.tick();
            harness.tick();
        }
        assert_ne!(bits(&told(harness.frame(ALICE))), bits(&start));
        harness.light(ALICE, full());
        harness.settle();
        assert_eq!(bits(&told(harness.frame(ALICE))), bits(&start));
    }
}

#[test]
fn everything_off_is_black() {
    for world in worlds() {
        let mut harness = harness(world, generous(PATCHES), cpu());
        harness.light(ALICE, LightRig { emission_scale: 0.0, ..LightRig::default() });
        harness.settle();
        let lights = told(harness.frame(ALICE));
        assert!(lights.len() > PATCHES as usize);
        assert!(
            lights.iter().all(|light| light.irradiance == Rgb::ZERO && light.sky_irradiance == Rgb::ZERO)
        );
    }
}
