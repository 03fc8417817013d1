//! The solver on furnaces, boxes and plates with known light, and against the path tracer.

use super::display::Shading;
use super::*;
use crate::reference::irradiance_at;
use crate::test_scenes::{SceneBuilder, glowing, grey};
use crate::tracer::SceneTracer;
use earthshine_world::{Light, LightRig, Rgb, Sky, Vec3};
use std::f32::consts::PI;

fn solved<'a>(
    tracer: &'a SceneTracer<'a>,
    rig: &'a LightRig,
    options: &ProgressiveOptions,
    shot_share: f64,
) -> Progressive<'a> {
    let mut solver = Progressive::new(tracer, rig, options).expect("a small scene");
    while solver.power().shot_share() < shot_share && solver.shoot().is_some() {}
    solver
}

fn coarse(area_m2: f32) -> ProgressiveOptions {
    ProgressiveOptions { patch_area_max_m2: Some(area_m2), splits_max: 0, ..ProgressiveOptions::default() }
}

fn balance(power: &Power) -> f64 {
    let spent = power.unshot + power.absorbed + power.escaped;
    ((spent - power.given) / power.given).abs().max_element()
}

/// A room of 1 m with a block in it and a lamp at a wall.
fn furnished() -> SceneBuilder {
    let mut builder = SceneBuilder::default();
    let wall = builder.material(grey(0.6));
    builder.room(wall);
    let lamp = builder.material(glowing(0.3, 20.0));
    builder.quad(Vec3::new(0.3, 0.99, 0.3), Vec3::X * 0.4, Vec3::Z * 0.4, lamp);
    builder.quad(Vec3::new(0.3, 0.4, 0.3), Vec3::Z * 0.4, Vec3::X * 0.4, wall);
    builder
}

#[test]
fn a_closed_furnace_converges_to_emission_over_what_is_absorbed() {
    for reflectance in [0.0f32, 0.6] {
        let mut builder = SceneBuilder::default();
        let wall = builder.material(glowing(reflectance, 2.0));
        builder.room(wall);
        let tracer = SceneTracer::new(&builder.scene);
        let rig = LightRig::emission_only();
        let solver = solved(&tracer, &rig, &coarse(0.05), 0.998);
        let expected = 2.0 * PI / (1.0 - reflectance);
        let (mut sum, mut area, mut worst) = (0.0, 0.0, 0.0f32);
        // The outside neither emits nor receives.
        let inside = |leaf: &&elements::Leaf| leaf.normal.dot(Vec3::splat(0.5) - leaf.corners[0]) > 0.0;
        for leaf in solver.elements().leaves.iter().filter(inside) {
            sum += leaf.irradiance.x * leaf.area;
            area += leaf.area;
            worst = worst.max((leaf.irradiance.x / expected - 1.0).abs());
        }
        assert!(
            (sum / area / expected - 1.0).abs() < 0.01,
            "{reflectance}: {} for {expected}; {:?}",
            sum / area,
            solver.power()
        );
        assert!(worst < 0.06, "{reflectance}: {worst}");
        let power = solver.power();
        assert!(balance(power) < 1e-6, "{power:?}");
        assert!(power.escaped.x.abs() < 0.01 * power.absorbed.x, "nothing escapes: {power:?}");
    }
}

#[test]
fn the_strongest_shoots_and_all_power_is_accounted_for() {
    let builder = furnished();
    let tracer = SceneTracer::new(&builder.scene);
    let rig = LightRig::emission_only();
    let mut solver = Progressive::new(&tracer, &rig, &coarse(0.02)).unwrap();
    let given = solver.power().given.x;
    assert!((given / (20.0 * f64::from(PI) * 0.16) - 1.0).abs() < 1e-4, "{given}");
    let mut before = f64::INFINITY;
    for _ in 0..60 {
        let Some(shot) = solver.shoot() else { break };
        let is_lamp = solver.elements().patches[shot.patch as usize].corners[0].y > 0.985;
        assert!(solver.shots() > 8 || is_lamp, "the lamp's 8 patches come first");
        assert!(shot.power > 0.0 && balance(solver.power()) < 1e-5, "{:?}", solver.power());
        let unshot: glam::DVec3 = solver.elements().leaves.iter().map(elements::Leaf::unshot_power).sum();
        assert!((unshot.x / solver.power().unshot.x - 1.0).abs() < 1e-4);
        assert!(solver.power().unshot.x < before, "unshot power only falls");
        before = solver.power().unshot.x;
    }
}

#[test]
fn an_open_floor_sends_its_light_away() {
    let mut builder = SceneBuilder::default();
    let ground = builder.material(grey(0.5));
    builder.plate(0.0, 4.0, true, ground);
    let tracer = SceneTracer::new(&builder.scene);
    let rig = LightRig { sky: Sky::constant(Rgb::ONE), ..LightRig::emission_only() };
    let solver = solved(&tracer, &rig, &coarse(1.0), 1.0);
    // Both sides see a whole hemisphere of sky and nothing else.
    for leaf in &solver.elements().leaves {
        assert!((leaf.irradiance.x - PI).abs() < 1e-3, "{}", leaf.irradiance);
    }
    let power = solver.power();
    assert!((power.escaped.x / (0.5 * f64::from(PI) * 32.0) - 1.0).abs() < 1e-4, "{power:?}");
    assert_eq!((power.absorbed.x, power.unshot.x), (0.0, 0.0));
}

#[test]
fn an_environment_map_takes_the_place_of_the_sky() {
    let mut builder = SceneBuilder::default();
    let ground = builder.material(grey(0.5));
    builder.plate(0.0, 4.0, true, ground);
    let map = earthshine_scene::EnvironmentMap::new(4, 2, vec![Rgb::splat(3.0); 8], 0.0).expect("a map");
    let tracer = SceneTracer::new(&builder.scene).under(Some(std::sync::Arc::new(map)));
    let rig = LightRig::emission_only();
    let solver = solved(&tracer, &rig, &coarse(4.0), 1.0);
    assert!(solver.elements().leaves.iter().all(|leaf| (leaf.irradiance.x - 3.0 * PI).abs() < 1e-3));
}

#[test]
fn opposite_squares_exchange_their_form_factor() {
    let mut builder = SceneBuilder::default();
    let black = builder.material(grey(0.0));
    let lamp = builder.material(glowing(0.0, 1.0 / PI));
    builder.quad(Vec3::ZERO, Vec3::Z, Vec3::X, black);
    builder.quad(Vec3::Y, Vec3::X, Vec3::Z, lamp);
    let tracer = SceneTracer::new(&builder.scene);
    let rig = LightRig::emission_only();
    for visibility in [Visibility::Rays, Visibility::IdBuffer { edge_texels: 192 }] {
        let solver = solved(&tracer, &rig, &ProgressiveOptions { visibility, ..coarse(0.02) }, 1.0);
        let power = solver.power();
        assert!((power.absorbed.x / 0.199_825 - 1.0).abs() < 0.01, "{visibility:?}: {power:?}");
    }
}

/// Mean over a lattice of places on the floor.
fn floor_light(light: &dyn Fn(Vec3) -> f32) -> Vec<f32> {
    (0..36)
        .map(|i| light(Vec3::new(0.06 + 0.176 * (i % 6) as f32, 0.0, 0.06 + 0.176 * (i / 6) as f32)))
        .collect()
}

#[test]
fn a_furnished_room_is_as_the_path_tracer_says() {
    let builder = furnished();
    let tracer = SceneTracer::new(&builder.scene);
    let point = Light::Point { position: Vec3::new(0.2, 0.7, 0.8), intensity: Rgb::ONE, range_m: None };
    let rig = LightRig { lights: vec![point], ..LightRig::emission_only() };
    let expected = floor_light(&|at| irradiance_at(&tracer, &rig, at, Vec3::Y, 1024, 2).0.x);
    let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
    for visibility in [Visibility::Rays, Visibility::IdBuffer { edge_texels: 96 }] {
        let options = ProgressiveOptions { visibility, splits_max: 2, ..coarse(0.04) };
        let solver = solved(&tracer, &rig, &options, 0.98);
        assert!(
            solver.elements().leaves.len() > solver.elements().patches.len(),
            "shadow edges split leaves"
        );
        let shading = Shading::of(&solver, &tracer, Rgb::ZERO);
        let found = floor_light(&|at| shading.at(at, Vec3::Y).expect("the floor").x);
        let bias = mean(&found) / mean(&expected) - 1.0;
        let errors: Vec<f32> =
            found.iter().zip(&expected).map(|(a, b)| (a - b).abs() / mean(&expected)).collect();
        assert!(bias.abs() < 0.03 && mean(&errors) < 0.05, "{visibility:?}: {bias} {}", mean(&errors));
    }
}

#[test]
fn the_ambient_estimate_foresees_the_mean() {
    let builder = furnished();
    let tracer = SceneTracer::new(&builder.scene);
    let rig = LightRig::emission_only();
    let mean = |solver: &Progressive<'_>, ambient: Rgb| {
        let shading = Shading::of(solver, &tracer, ambient);
        let light = floor_light(&|at| shading.at(at, Vec3::Y).expect("the floor").x);
        light.iter().sum::<f32>() / light.len() as f32
    };
    let early = solved(&tracer, &rig, &coarse(0.05), 0.6);
    let late = solved(&tracer, &rig, &coarse(0.05), 0.98);
    let (bare, guessed, right) =
        (mean(&early, Rgb::ZERO), mean(&early, early.ambient_irradiance()), mean(&late, Rgb::ZERO));
    assert!((guessed - right).abs() < 0.5 * (bare - right).abs(), "{bare} {guessed} {right}");
    assert!(late.ambient_irradiance().x < 0.05 * right);
}

#[test]
fn splitting_is_bounded_and_the_same_every_time() {
    let builder = furnished();
    let tracer = SceneTracer::new(&builder.scene);
    let rig = LightRig::emission_only();
    let options = ProgressiveOptions { elements_max: 900, gradient_max: 0.01, splits_max: 6, ..coarse(0.05) };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let solver = solved(&tracer, &rig, &options, 0.7);
            solver.elements().leaves.iter().map(|leaf| leaf.irradiance.to_array()).collect::<Vec<_>>()
        })
    };
    let light = run(1);
    assert!(light.len() > 600 && light.len() <= 900, "{}", light.len());
    assert_eq!(light, run(3));
}

#[test]
fn what_cannot_be_solved_is_named() {
    let builder = furnished();
    let tracer = SceneTracer::new(&builder.scene);
    let rig = LightRig::emission_only();
    let refused = |options: ProgressiveOptions| {
        Progressive::new(&tracer, &rig, &options).expect_err("refused").to_string()
    };
    let few = refused(ProgressiveOptions { elements_max: 10, ..coarse(1.0) });
    assert!(few.contains("16 triangles") && few.contains("limit of 10 elements"), "{few}");
    let fine = refused(coarse(1e-6));
    assert!(fine.contains("20000 elements"), "{fine}");
    assert!(refused(coarse(-1.0)).contains("-1"));
    assert!(refused(ProgressiveOptions { splits_max: 99, ..coarse(1.0) }).contains("0 to 6"));
    let empty = earthshine_scene::Scene::default();
    let nothing = SceneTracer::new(&empty);
    assert_eq!(Progressive::new(&nothing, &rig, &coarse(1.0)).expect_err("refused"), ProgressiveError::Empty);
}
