//! The whole method on scenes with known light.

use super::*;
use crate::picture::{LightSource, PictureOptions, render};
use crate::reference::irradiance_at;
use crate::test_scenes::{SceneBuilder, glowing, grey};
use earthshine_world::{Light, Sky, Vec3};
use screen_light::ScreenLight;

fn options(position: Vec3, target: Vec3) -> ScreenSpaceOptions {
    let camera = Pinhole::new(position, target, 70.0, 48, 36).expect("a camera");
    ScreenSpaceOptions { camera, far_samples: 8, near_samples: 16, radius_m: 0.25, seed: 5 }
}

fn mean(values: &[Rgb]) -> f32 {
    values.iter().map(|value| value.x).sum::<f32>() / values.len() as f32
}

#[test]
fn a_furnace_is_not_changed_by_refinement_of_served_light() {
    let mut builder = SceneBuilder::default();
    let wall = builder.material(glowing(0.5, 3.0));
    builder.room(wall);
    let tracer = SceneTracer::new(&builder.scene);
    let rig = LightRig::emission_only();
    // Everything sends 6 cd/m2, so everything receives 6 pi.
    let light = Rgb::splat(6.0 * std::f32::consts::PI);
    let lookup = |_: Vec3, _: Vec3| Some(light);
    let view = options(Vec3::splat(0.5), Vec3::ZERO);
    let view = ScreenSpaceOptions { far_samples: 64, ..view };
    let done = std::sync::atomic::AtomicU64::new(0);
    let finished = |texels| {
        done.fetch_add(texels, std::sync::atomic::Ordering::Relaxed);
    };
    let found = served(&tracer, &rig, &view, &lookup, &finished).unwrap();
    assert_eq!(done.into_inner(), served::work_texels(&view.camera));
    assert!(found.occlusion.iter().any(|&share| share > 0.3), "a corner is in view");
    assert!((mean(&found.refined) / light.x - 1.0).abs() < 0.005, "{}", mean(&found.refined));
    let worst = found.refined.iter().map(|pixel| (pixel.x / light.x - 1.0).abs()).fold(0.0, f32::max);
    assert!(worst < 0.25, "{worst}");
}

/// Goal: lamps light the ends of rays, whatever is served there. Method: a plate over a lamp over a floor, served as dark; what
/// comes back from the floor is `2/5 rho I / h^2` (`closed_forms`).
#[test]
fn lamps_light_the_ends_of_rays() {
    let mut builder = SceneBuilder::default();
    let floor = builder.material(grey(0.5));
    builder.plate(0.0, 200.0, true, floor);
    builder.plate(2.01, 1.0, false, floor);
    let tracer = SceneTracer::new(&builder.scene);
    let lamp = Light::Point { position: Vec3::Y * 2.0, intensity: Rgb::splat(10.0), range_m: None };
    let rig = LightRig { lights: vec![lamp], ..LightRig::emission_only() };
    let camera = Pinhole::new(Vec3::Y, Vec3::new(0.01, 2.0, 0.0), 10.0, 32, 24).expect("a camera");
    let view = ScreenSpaceOptions { camera, far_samples: 64, ..options(Vec3::Y, Vec3::ZERO) };
    let found = served(&tracer, &rig, &view, &|_: Vec3, _: Vec3| Some(Rgb::ZERO), &|_| ()).unwrap();
    assert!((mean(&found.refined) / 0.5 - 1.0).abs() < 0.03, "{}", mean(&found.refined));
    assert_eq!(mean(&found.plain), 0.0);
    let unknown = served(&tracer, &rig, &view, &|_: Vec3, _: Vec3| None, &|_| ()).unwrap();
    assert_eq!(mean(&unknown.refined), 0.0, "where nothing is known nothing is made up");
}

/// A floor and a curb of 0.25 m under a sky, served by means over voxels of 0.5 m.
#[test]
fn contact_shade_below_a_voxel_comes_back() {
    let mut builder = SceneBuilder::default();
    let wall = builder.material(grey(0.5));
    builder.quad(Vec3::new(0.0, 0.0, -50.0), Vec3::Z * 100.0, Vec3::X * 100.0, wall);
    builder.quad(Vec3::new(0.0, 0.0, -50.0), Vec3::Y * 0.25, Vec3::Z * 100.0, wall);
    let tracer = SceneTracer::new(&builder.scene);
    let rig = LightRig { sky: Sky::constant(Rgb::ONE), ..LightRig::emission_only() };
    let reference = |x: f32| irradiance_at(&tracer, &rig, Vec3::new(x, 0.0, 0.0), Vec3::Y, 4096, 2).0.x;
    let voxel_mean =
        |first: f32| (0..10).map(|i| reference(first + (i as f32 + 0.5) * 0.05)).sum::<f32>() / 10.0;
    let (inner, outer) = (voxel_mean(0.0), voxel_mean(0.5));
    let lookup = |position: Vec3, _: Vec3| Some(Rgb::splat(if position.x < 0.5 { inner } else { outer }));
    let view = options(Vec3::new(0.5, 1.0, 0.0), Vec3::new(0.4, 0.0, 0.0));
    let view = ScreenSpaceOptions { far_samples: 64, ..view };
    let found = served(&tracer, &rig, &view, &lookup, &|_| ()).unwrap();
    let lights = found.plain.iter().zip(&found.refined).zip(found.buffer.texels());
    let (mut before, mut after, mut count) = (0.0, 0.0, 0);
    for ((plain, refined), texel) in lights.step_by(97) {
        let Some(place) = texel.map(|texel| texel.vertex).filter(|place| place.normal.y > 0.9) else {
            continue;
        };
        let right = reference(place.position.x);
        before += (plain.x - right).abs();
        after += (refined.x - right).abs();
        count += 1;
    }
    assert!(count > 40 && after < 0.4 * before, "{after} after, {before} before, {count} places");
}

#[test]
fn a_furnace_is_not_changed_by_refinement_of_gathered_light() {
    let mut builder = SceneBuilder::default();
    let wall = builder.material(glowing(0.5, 3.0));
    builder.room(wall);
    let tracer = SceneTracer::new(&builder.scene);
    let view = options(Vec3::splat(0.5), Vec3::ZERO);
    let view = ScreenSpaceOptions { far_samples: 16, near_samples: 32, ..view };
    let found = gathered(&tracer, &LightRig::emission_only(), &view, &|_| ()).unwrap();
    let expected = 6.0 * std::f32::consts::PI;
    for light in [&found.raw, &found.plain, &found.refined] {
        assert!((mean(light) / expected - 1.0).abs() < 0.005, "{} for {expected}", mean(light));
    }
    let worst = found.refined.iter().map(|pixel| (pixel.x / expected - 1.0).abs()).fold(0.0, f32::max);
    assert!(worst < 0.25, "{worst}");
}

#[test]
fn an_open_plane_under_a_constant_sky_is_exact() {
    let mut builder = SceneBuilder::default();
    let ground = builder.material(grey(0.5));
    builder.plate(0.0, 100.0, true, ground);
    let tracer = SceneTracer::new(&builder.scene);
    let rig = LightRig { sky: Sky::constant(Rgb::ONE), ..LightRig::emission_only() };
    let map = earthshine_scene::EnvironmentMap::new(4, 2, vec![Rgb::splat(3.0); 8], 0.0).expect("a map");
    // An environment map takes the place of the sky.
    let mapped = SceneTracer::new(&builder.scene).under(Some(std::sync::Arc::new(map)));
    let view = options(Vec3::Y, Vec3::new(1.0, 0.0, 0.0));
    for (tracer, radiance) in [(&tracer, 1.0), (&mapped, 3.0)] {
        let found = gathered(tracer, &rig, &view, &|_| ()).unwrap();
        for (pixel, texel) in found.refined.iter().zip(found.buffer.texels()) {
            let expected = if texel.is_some() { radiance * std::f32::consts::PI } else { 0.0 };
            assert!((pixel.x - expected).abs() < 1e-3, "{pixel}");
        }
    }
}

#[test]
fn a_room_by_few_filtered_rays_is_close_to_the_reference() {
    let mut builder = SceneBuilder::default();
    let wall = builder.material(grey(0.6));
    builder.room(wall);
    let lamp = Light::Point { position: Vec3::new(0.6, 0.8, 0.3), intensity: Rgb::splat(9.0), range_m: None };
    builder.quad(Vec3::new(0.2, 0.0, 0.2), Vec3::Y * 0.3, Vec3::X * 0.3, wall);
    let rig = LightRig { lights: vec![lamp], ..LightRig::emission_only() };
    let tracer = SceneTracer::new(&builder.scene);
    let view = options(Vec3::splat(0.9), Vec3::new(0.2, 0.1, 0.2));
    let found = gathered(&tracer, &rig, &view, &|_| ()).unwrap();
    let picture = PictureOptions { camera: view.camera, samples: 256, seed: 1 };
    let reference = render(&tracer, &rig, &picture, LightSource::Reference).unwrap().indirect;
    let error = |irradiance: &[Rgb]| {
        let light = ScreenLight { buffer: &found.buffer, irradiance };
        let lookup = |position, normal| light.at(position, normal);
        let samples = PictureOptions { samples: 4, ..picture };
        let layers = render(&tracer, &rig, &samples, LightSource::Lookup(&lookup)).unwrap();
        assert!(layers.uncovered_share < 0.01, "{}", layers.uncovered_share);
        let squares: f32 = layers
            .indirect
            .pixels()
            .iter()
            .zip(reference.pixels())
            .map(|(found, right)| (found.x - right.x).powi(2))
            .sum();
        squares.sqrt() / reference.pixels().iter().map(|pixel| pixel.x.powi(2)).sum::<f32>().sqrt()
    };
    let (raw, plain, refined) = (error(&found.raw), error(&found.plain), error(&found.refined));
    assert!(refined < plain && plain < raw && refined < 0.08, "{raw} {plain} {refined}");
    assert!((mean(&found.refined) / mean(&found.raw) - 1.0).abs() < 0.03);
}

#[test]
fn impossible_options_are_named() {
    let scene = earthshine_scene::Scene::default();
    let tracer = SceneTracer::new(&scene);
    let view = options(Vec3::ZERO, Vec3::X);
    let run = |view: ScreenSpaceOptions| gathered(&tracer, &LightRig::emission_only(), &view, &|_| ()).err();
    assert_eq!(run(ScreenSpaceOptions { far_samples: 0, ..view }), Some(ScreenSpaceError::Rays(0)));
    assert_eq!(run(ScreenSpaceOptions { radius_m: 0.0, ..view }), Some(ScreenSpaceError::Radius(0.0)));
    assert_eq!(run(view), None);
}
