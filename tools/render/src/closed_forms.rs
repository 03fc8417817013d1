//! The reference tracer against light that can be worked out on paper.
//!
//! Tolerances are a few standard errors plus the closed form's own approximation, so that a factor of
//! 1.02 somewhere in the estimator fails.

use crate::path::EmitterSampling;
use crate::reference::{ReferenceOptions, estimate, irradiance_at, irradiance_at_points};
use crate::test_scenes::{SceneBuilder, glowing, grey};
use crate::tracer::SceneTracer;
use earthshine_scene::Scene;
use earthshine_world::{Light, LightRig, Rgb, Sky, Vec3};
use std::f32::consts::PI;

fn lit_by(light: Light) -> LightRig {
    LightRig { lights: vec![light], ..LightRig::emission_only() }
}

/// Mean irradiance over a 16 x 16 lattice of points spanned by `side` and `up`.
fn mean_over_square(scene: &Scene, corner: Vec3, side: Vec3, up: Vec3, normal: Vec3) -> f32 {
    let tracer = SceneTracer::new(scene);
    let points: Vec<(Vec3, Vec3)> = (0..256)
        .map(|i| {
            let at = |k: i32| (k as f32 + 0.5) / 16.0;
            (corner + side * at(i % 16) + up * at(i / 16), normal)
        })
        .collect();
    let options = ReferenceOptions { samples_max: 256, target_error_rel: 0.0, ..ReferenceOptions::default() };
    let found = irradiance_at_points(&tracer, &LightRig::emission_only(), &points, &options, &|| ());
    found.iter().map(|point| point.irradiance.x).sum::<f32>() / 256.0
}

#[test]
fn a_furnace_glows_with_its_emission_over_what_it_absorbs() {
    for reflectance in [0.0f32, 0.5, 0.8, 0.98] {
        let mut builder = SceneBuilder::default();
        let wall = builder.material(glowing(reflectance, 2.0));
        builder.room(wall);
        let tracer = SceneTracer::new(&builder.scene);
        let place = Vec3::new(0.3, 0.0, 0.6);
        let rig = LightRig::emission_only();
        let (found, error) = irradiance_at(&tracer, &rig, place, Vec3::Y, 16_384, 3);
        let expected = 2.0 * PI / (1.0 - reflectance);
        let difference = (found.x - expected).abs();
        assert!(
            difference < 3.5 * error.x + 1e-4 * expected,
            "{reflectance}: {found} for {expected}, {error}"
        );
        assert!(error.x < 0.02 * expected, "{reflectance}: {error}");
    }
}

#[test]
fn an_open_plane_receives_pi_times_the_sky() {
    let mut builder = SceneBuilder::default();
    let ground = builder.material(grey(0.5));
    builder.plate(0.0, 1e3, true, ground);
    let tracer = SceneTracer::new(&builder.scene);
    let radiance = Rgb::new(3.0, 4.0, 6.0);
    let rig = LightRig { sky: Sky::constant(radiance), ..LightRig::emission_only() };
    let (up, error) = irradiance_at(&tracer, &rig, Vec3::new(9.3, 0.0, 1.7), Vec3::Y, 512, 3);
    assert!((up - radiance * PI).length() < 1e-3 && error.max_element() < 1e-4, "{up} {error}");
    // From above the ground and facing it, what it reflects: half of that.
    let (down, _) = irradiance_at(&tracer, &rig, Vec3::new(0.0, 0.5, 0.0), Vec3::NEG_Y, 4096, 3);
    assert!((down - radiance * (0.5 * PI)).length() < 0.02, "{down}");
}

#[test]
fn squares_exchange_their_form_factors() {
    let mut builder = SceneBuilder::default();
    let black = builder.material(grey(0.0));
    let lamp = builder.material(glowing(0.0, 1.0 / PI));
    builder.quad(Vec3::ZERO, Vec3::Z, Vec3::X, black);
    builder.quad(Vec3::Y, Vec3::X, Vec3::Z, lamp);
    let parallel = mean_over_square(&builder.scene, Vec3::ZERO, Vec3::Z, Vec3::X, Vec3::Y);
    assert!((parallel / 0.199_825 - 1.0).abs() < 0.006, "{parallel}");

    let mut builder = SceneBuilder::default();
    let lamp = builder.material(glowing(0.0, 1.0 / PI));
    builder.quad(Vec3::ZERO, Vec3::Y, Vec3::Z, lamp);
    let perpendicular = mean_over_square(&builder.scene, Vec3::ZERO, Vec3::Z, Vec3::X, Vec3::Y);
    assert!((perpendicular / 0.200_044 - 1.0).abs() < 0.01, "{perpendicular}");
}

#[test]
fn emission_leaves_the_front_only() {
    let mut builder = SceneBuilder::default();
    let lamp = builder.material(glowing(0.0, 1.0));
    builder.plate(1.0, 1.0, true, lamp);
    let tracer = SceneTracer::new(&builder.scene);
    let rig = LightRig::emission_only();
    assert_eq!(irradiance_at(&tracer, &rig, Vec3::ZERO, Vec3::Y, 256, 1).0, Rgb::ZERO);
    let (above, _) = irradiance_at(&tracer, &rig, Vec3::Y * 2.0, Vec3::NEG_Y, 4096, 1);
    assert!(above.x > 0.5, "{above}");
}

#[test]
fn a_lamp_over_a_floor_comes_back_as_two_fifths() {
    // integral over the floor of (rho / pi) I h / s^3 * (h / s)^2 / s^2 with s^2 = r^2 + h^2
    // = 2/5 rho I / h^2. The lamp itself is a delta light: it is not in the irradiance.
    let mut builder = SceneBuilder::default();
    let floor = builder.material(grey(0.5));
    builder.plate(0.0, 200.0, true, floor);
    let tracer = SceneTracer::new(&builder.scene);
    let lamp = Vec3::new(0.0, 2.0, 0.0);
    let rig = lit_by(Light::Point { position: lamp, intensity: Rgb::splat(10.0), range_m: None });
    let (found, error) = irradiance_at(&tracer, &rig, lamp, Vec3::NEG_Y, 16_384, 5);
    assert!((found.x - 0.5).abs() < 3.5 * error.x + 1e-3 && error.x < 0.01, "{found} {error}");
    let (up, _) = irradiance_at(&tracer, &rig, Vec3::X, Vec3::Y, 256, 5);
    assert_eq!(up, Rgb::ZERO, "the floor sees the lamp, which does not count, and nothing else");
}

#[test]
fn more_lamps_than_are_asked_bring_the_same_light() {
    let mut builder = SceneBuilder::default();
    let floor = builder.material(grey(0.5));
    builder.plate(0.0, 200.0, true, floor);
    let tracer = SceneTracer::new(&builder.scene);
    let lamp = Vec3::new(0.0, 2.0, 0.0);
    let part = |share: f32| Light::Point { position: lamp, intensity: Rgb::splat(share), range_m: None };
    let lights = [1.0, 0.5, 2.5, 3.0, 0.0, 2.0, 1.0].map(part).to_vec();
    let rig = LightRig { lights, ..LightRig::emission_only() };
    let (found, error) = irradiance_at(&tracer, &rig, lamp, Vec3::NEG_Y, 16_384, 5);
    assert!((found.x - 0.5).abs() < 3.5 * error.x + 1e-3, "{found} {error}");
}

#[test]
fn sunlight_comes_back_from_the_ground_but_not_from_the_shade() {
    let mut builder = SceneBuilder::default();
    let ground = builder.material(grey(0.25));
    builder.plate(0.0, 1e3, true, ground);
    let sun = Light::Directional {
        direction: Vec3::new(0.0, -0.8, 0.6),
        illuminance: Rgb::splat(1e5),
        angular_diameter_rad: 0.0093,
    };
    let place = Vec3::new(0.0, 0.3, 0.0);
    let tracer = SceneTracer::new(&builder.scene);
    let (found, _) = irradiance_at(&tracer, &lit_by(sun), place, Vec3::NEG_Y, 4096, 5);
    assert!((found.x / 2e4 - 1.0).abs() < 0.005, "{found}");

    let roof = builder.material(grey(0.0));
    builder.plate(0.5, 1e3, true, roof);
    let tracer = SceneTracer::new(&builder.scene);
    assert_eq!(irradiance_at(&tracer, &lit_by(sun), place, Vec3::NEG_Y, 256, 5).0, Rgb::ZERO);
}

#[test]
fn looking_at_small_emitters_changes_the_noise_and_not_the_light() {
    let mut builder = SceneBuilder::default();
    let wall = builder.material(grey(0.5));
    builder.room(wall);
    let lamp = builder.material(glowing(0.3, 100.0));
    builder.scene.triangles.iter_mut().flatten().for_each(|corner| *corner *= 3.0);
    builder.quad(Vec3::new(1.4, 2.9, 1.4), Vec3::X * 0.2, Vec3::Z * 0.2, lamp);
    let tracer = SceneTracer::new(&builder.scene);
    let found = |emitter_sampling: EmitterSampling, samples_max: u64| {
        let options = ReferenceOptions { seed: 9, samples_max, target_error_rel: 0.0, emitter_sampling };
        estimate(&tracer, &LightRig::emission_only(), Vec3::new(0.7, 0.0, 2.0), Vec3::Y, &options)
    };
    let looked = found(EmitterSampling::Balanced, 16_384);
    let hit = found(EmitterSampling::Hits, 65_536);
    let spread = looked.standard_error.x.hypot(hit.standard_error.x);
    assert!((looked.irradiance.x - hit.irradiance.x).abs() < 3.5 * spread, "{looked:?} {hit:?}");
    assert!(looked.standard_error.x * 2.0 < hit.standard_error.x, "with a quarter of the paths");
}

#[test]
fn the_same_seed_gives_the_same_bits_on_any_number_of_threads() {
    let mut builder = SceneBuilder::default();
    let wall = builder.material(glowing(0.5, 1.0));
    builder.room(wall);
    let tracer = SceneTracer::new(&builder.scene);
    let points: Vec<_> = (1..20).map(|i| (Vec3::new(i as f32 / 20.0, 0.0, 0.5), Vec3::Y)).collect();
    let run = |threads: usize, seed: u64| {
        let options = ReferenceOptions { seed, samples_max: 1024, ..ReferenceOptions::default() };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let rig = LightRig::emission_only();
        pool.install(|| irradiance_at_points(&tracer, &rig, &points, &options, &|| ()))
    };
    assert_eq!(run(1, 7), run(3, 7));
    assert_ne!(run(1, 7), run(1, 8));
}

#[test]
fn sampling_stops_when_it_is_good_enough_and_not_before() {
    let mut builder = SceneBuilder::default();
    let wall = builder.material(grey(0.5));
    builder.room(wall);
    let tracer = SceneTracer::new(&builder.scene);
    let lamp = Light::Point { position: Vec3::splat(0.4), intensity: Rgb::ONE, range_m: None };
    let found = |target_error_rel: f32| {
        let options = ReferenceOptions { target_error_rel, samples_max: 1 << 15, ..Default::default() };
        estimate(&tracer, &lit_by(lamp), Vec3::new(0.5, 0.0, 0.5), Vec3::Y, &options)
    };
    let (coarse, fine) = (found(0.05), found(0.01));
    assert!(coarse.samples < fine.samples && fine.samples < 1 << 15, "{coarse:?} {fine:?}");
    assert!(fine.standard_error.x <= 0.0101 * fine.irradiance.x);
    let spread = coarse.standard_error.x.hypot(fine.standard_error.x);
    assert!((coarse.irradiance.x - fine.irradiance.x).abs() < 4.0 * spread, "{coarse:?} {fine:?}");
}
