//! The reference tracer under environment maps, against light that can be worked out on paper.

use crate::path::EmitterSampling;
use crate::reference::{PointEstimate, ReferenceOptions, estimate, irradiance_at};
use crate::sky::Environment;
use crate::test_scenes::{SceneBuilder, grey};
use crate::tracer::SceneTracer;
use earthshine_scene::{EnvironmentMap, Scene, sky_projection};
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{Direction, LightRig, Rgb, Sky, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;

/// Its sky must not count where a map is around the scene.
fn misleading_rig() -> LightRig {
    LightRig { sky: Sky::constant(Rgb::splat(1e6)), ..LightRig::emission_only() }
}

fn map(radiance: impl Fn(Vec3) -> Rgb) -> Arc<EnvironmentMap> {
    sized_map(256, 128, radiance)
}

fn sized_map(width: u32, height: u32, radiance: impl Fn(Vec3) -> Rgb) -> Arc<EnvironmentMap> {
    let new = |texels| EnvironmentMap::new(width, height, texels, 0.3).expect("a map");
    let even = new(vec![Rgb::ONE; (width * height) as usize]);
    let places = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
    let texel = |(column, row)| radiance(even.direction_in(column, row, (0.5, 0.5)));
    Arc::new(new(places.map(texel).collect()))
}

/// A disc around unit `towards`; its rim is as ragged as its texels.
fn disc(towards: Vec3, radiance: f32) -> Arc<EnvironmentMap> {
    let cosine = DISC_RADIUS_RAD.cos();
    let texel = |direction: Vec3| Rgb::splat(if direction.dot(towards) > cosine { radiance } else { 0.0 });
    sized_map(1024, 512, texel)
}

/// 24 rows of the map, so that the rim around the zenith lies between two of them.
const DISC_RADIUS_RAD: f32 = 24.0 * PI / 512.0;

fn elevated(degrees: f32) -> Vec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    Vec3::new(cos * 0.6, sin, cos * -0.8)
}

fn open(map: Arc<EnvironmentMap>, normal: Vec3, emitter_sampling: EmitterSampling) -> PointEstimate {
    let scene = Scene::default();
    let tracer = SceneTracer::new(&scene).under(Some(map));
    let options = ReferenceOptions { seed: 7, samples_max: 4096, target_error_rel: 0.0, emitter_sampling };
    estimate(&tracer, &misleading_rig(), Vec3::ZERO, normal, &options)
}

#[test]
fn a_constant_map_is_a_constant_sky_and_brings_pi_l() {
    let radiance = Rgb::new(3.0, 4.0, 6.0);
    for normal in [Vec3::Y, Vec3::new(0.48, -0.6, 0.64)] {
        let found = open(map(|_| radiance), normal, EmitterSampling::Balanced);
        let difference = (found.irradiance - radiance * PI).length();
        assert!(difference < 3.5 * found.standard_error.length() + 1e-3, "{found:?}");
    }
    let mut builder = SceneBuilder::default();
    let ground = builder.material(grey(0.5));
    builder.plate(0.0, 1e3, true, ground);
    let tracer = SceneTracer::new(&builder.scene).under(Some(map(|_| radiance)));
    let place = Vec3::new(0.0, 0.5, 0.0);
    let (down, error) = irradiance_at(&tracer, &misleading_rig(), place, Vec3::NEG_Y, 8192, 3);
    assert!((down - radiance * (0.5 * PI)).length() < 3.5 * error.length() + 0.01, "{down} {error}");
}

#[test]
fn a_bright_disc_is_a_sun_of_its_size() {
    // A disc of radiance L and radius a above the horizon brings pi L sin^2(a) times the cosine.
    let facing = PI * 1e4 * DISC_RADIUS_RAD.sin().powi(2);
    for degrees in [90.0f32, 60.0, 30.0, 12.0] {
        let found = open(disc(elevated(degrees), 1e4), Vec3::Y, EmitterSampling::Balanced);
        let expected = facing * degrees.to_radians().sin();
        let (value, error) = (found.irradiance.x, found.standard_error.x);
        assert!((value / expected - 1.0).abs() < 0.015, "{degrees}: {value} for {expected}");
        assert!(error < 0.005 * expected, "{degrees}: {error}");
    }
}

#[test]
fn a_disc_across_the_horizon_brings_the_part_above() {
    for degrees in [4.0f32, 0.0, -4.0, -20.0] {
        let map = disc(elevated(degrees), 1e4);
        let expected = map.open_irradiance()[Direction::PosY.index()].x as f32;
        let found = open(map, Vec3::Y, EmitterSampling::Balanced);
        let allowed = 3.5 * found.standard_error.x + 1e-3 * expected;
        assert!((found.irradiance.x - expected).abs() <= allowed, "{degrees}: {found:?} for {expected}");
        assert_eq!(expected > 0.0, degrees > -20.0);
    }
}

#[test]
fn looking_at_the_sky_changes_the_noise_and_not_the_light() {
    let map = map(|d| Rgb::splat(if d.dot(elevated(40.0)) > 0.98 { 300.0 } else { 1.0 + d.y }));
    let looked = open(Arc::clone(&map), Vec3::Y, EmitterSampling::Balanced);
    let met = open(map, Vec3::Y, EmitterSampling::Hits);
    let spread = looked.standard_error.x.hypot(met.standard_error.x);
    assert!((looked.irradiance.x - met.irradiance.x).abs() < 3.5 * spread, "{looked:?} {met:?}");
    assert!(looked.standard_error.x * 2.0 < met.standard_error.x, "{looked:?} {met:?}");
}

#[test]
fn walls_hide_the_sky_from_looks_too() {
    let mut builder = SceneBuilder::default();
    let roof = builder.material(grey(0.0));
    builder.plate(1.0, 1e4, false, roof);
    let tracer = SceneTracer::new(&builder.scene).under(Some(disc(Vec3::Y, 1e6)));
    let (found, _) = irradiance_at(&tracer, &misleading_rig(), Vec3::ZERO, Vec3::Y, 1024, 3);
    assert_eq!(found, Rgb::ZERO);
}

#[test]
fn the_projection_and_the_map_light_an_open_plane_alike() {
    // What the tracer sees of the map, and what the service holds of it.
    let map = map(|d| Rgb::new(1.0 + 0.6 * d.y, 2.0, 1.5 + 0.9 * d.x));
    let sky = sky_projection::project(&map).sky;
    for direction in Direction::ALL {
        let found = open(Arc::clone(&map), direction.vector(), EmitterSampling::Balanced);
        let projected = sky.open_irradiance(direction);
        let difference = (found.irradiance - projected).abs();
        let allowed = found.standard_error * 3.5 + projected * 1e-3;
        assert!(difference.cmple(allowed).all(), "{direction:?}: {found:?} for {projected}");
    }
}

#[test]
fn directions_come_as_often_as_their_density_says() {
    let map = map(|d| Rgb::splat(0.1 + d.y.max(0.0).powi(4)));
    let sky = Environment::new(Arc::clone(&map));
    // Importance sampling with its own density: the mean of 1 / density is the whole sphere, that of
    // cos / density over a half space pi.
    let (mut sphere, mut half) = (0.0f64, 0.0f64);
    const LOOKS: u64 = 40_000;
    for index in 0..LOOKS {
        let pair = |which| unit_pair(hash(5, Purpose::ReferencePath, index, which));
        let look = sky.look(pair(0), pair(1)).expect("light");
        assert_eq!(look.density, sky.density(look.direction));
        sphere += 1.0 / f64::from(look.density);
        half += f64::from(look.direction.dot(Vec3::X).max(0.0) / look.density);
    }
    let (sphere, half) = (sphere / LOOKS as f64, half / LOOKS as f64);
    assert!((sphere / (4.0 * f64::from(PI)) - 1.0).abs() < 0.02, "{sphere}");
    assert!((half / f64::from(PI) - 1.0).abs() < 0.03, "{half}");
}

#[test]
fn a_black_map_is_dark() {
    let map = map(|_| Rgb::ZERO);
    assert_eq!(Environment::new(Arc::clone(&map)).look((0.5, 0.5), (0.5, 0.5)), None);
    assert_eq!(open(map, Vec3::Y, EmitterSampling::Balanced).irradiance, Rgb::ZERO);
}
