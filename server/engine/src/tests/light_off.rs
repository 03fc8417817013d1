//! Light off returns to exactly the earlier state: every kind of light, on the local matrix, to the bit.

use super::backend::Faults;
use super::harness::{ALICE, Harness, factory, generous};
use super::world::{RandomWorld, WorldShape};
use crate::{BackendFactory, EngineConfig, PatchLight};
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

fn harness(config: EngineConfig, backends: BackendFactory) -> Harness {
    let shape =
        WorldShape { chunks: [5, 2, 4], patches_per_chunk_max: 12, links_per_patch: 8, has_occluders: true };
    let world = RandomWorld::new(24, shape);
    let mut harness = Harness::with_backends(world, config, backends).with_camera(Vec3::ZERO);
    harness.light(ALICE, full());
    harness.settle();
    harness
}

/// All numbers of a frame as bits: `==` takes minus zero for zero.
fn bits(patches: &[PatchLight]) -> Vec<[u32; 6]> {
    let of = |light: &PatchLight| {
        let [a, b, c] = light.irradiance.to_array();
        let [d, e, f] = light.sky_irradiance.to_array();
        [a, b, c, d, e, f].map(f32::to_bits)
    };
    patches.iter().map(of).collect()
}

/// How many patches have other light than before.
fn changed(now: &[PatchLight], before: &[PatchLight]) -> usize {
    now.iter().zip(before).filter(|(a, b)| a.irradiance != b.irradiance).count()
}

#[test]
fn every_light_that_goes_and_comes_back_leaves_no_trace() {
    for backends in [cpu(), factory(Faults::default())] {
        let mut harness = harness(generous(PATCHES), backends);
        let start = harness.frame(ALICE).patches.clone();
        assert_eq!(start.len(), PATCHES as usize);
        for (name, rig) in changes() {
            harness.light(ALICE, rig);
            harness.settle();
            let between = changed(&harness.frame(ALICE).patches, &start);
            assert!(between > start.len() / 4, "{name}: {between} of {} patches changed", start.len());
            harness.light(ALICE, full());
            harness.settle();
            let back = &harness.frame(ALICE).patches;
            assert!(bits(back) == bits(&start), "{name}: {} patches differ", changed(back, &start));
        }
    }
}

/// Goal: the way to a state does not matter. Method: budgets so small that light changes again before the last change
/// has reached every patch.
#[test]
fn changes_that_overtake_each_other_leave_no_trace() {
    let config = EngineConfig { shadow_points_per_tick_max: 8, ..generous(PATCHES) };
    let mut harness = harness(config, cpu());
    let start = harness.frame(ALICE).patches.clone();
    for (_, rig) in changes() {
        harness.light(ALICE, rig);
        harness.tick();
        harness.tick();
    }
    assert_ne!(bits(&harness.frame(ALICE).patches), bits(&start));
    harness.light(ALICE, full());
    harness.settle();
    assert_eq!(bits(&harness.frame(ALICE).patches), bits(&start));
}

#[test]
fn everything_off_is_black() {
    let mut harness = harness(generous(PATCHES), cpu());
    harness.light(ALICE, LightRig { emission_scale: 0.0, ..LightRig::default() });
    harness.settle();
    let patches = &harness.frame(ALICE).patches;
    assert!(patches.iter().all(|light| light.irradiance == Rgb::ZERO && light.sky_irradiance == Rgb::ZERO));
}
