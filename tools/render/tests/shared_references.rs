//! Our tracer against two other renderers, on the shared scenes beside the project.
//!
//! A few seconds' worth of paths: enough to see a wrong factor, a missing bounce, a lamp counted twice,
//! a texture read upside down. `earthshine bench reference` runs the same comparison for as long as one likes.
#![expect(clippy::print_stdout, reason = "a skipped test says why, and figures are wanted beside a failure")]

use earthshine_render::agreement::{Agreement, agreement};
use earthshine_render::reference::{ReferenceOptions, irradiance_at_points};
use earthshine_render::{LightErrors, PointEstimate, ReferencePoint, SceneTracer, compare_points, csv};
use earthshine_scene::{ImportOptions, Scene, light_rig, load, load_lights, scenes_dir};
use earthshine_world::{LightRig, Rgb};
use std::path::PathBuf;

/// The folder of shared scenes, or a printed reason why the test does nothing.
fn folder() -> Option<PathBuf> {
    let folder = scenes_dir();
    if folder.is_none() {
        println!("skipped: no ../shared/scenes and EARTHSHINE_SCENES names no folder");
    }
    folder
}

/// Share of the points, lights averaged over channels, that must lie within two combined standard errors: noise alone
/// leaves 4.6 % out.
const WITHIN_TWO_MIN: f64 = 0.95;

/// The same where paths are so few that their errors are not normal yet, as in Sponza's dark corners.
const WITHIN_TWO_OF_FEW_PATHS: f64 = 0.9;

fn scene_and_light(folder: &std::path::Path, name: &str) -> (Scene, LightRig) {
    let scene = load(&folder.join(format!("{name}.glb")), &ImportOptions::default()).expect("a scene");
    let lights = folder.join(format!("{name}.lights.json"));
    let lights = lights.is_file().then(|| load_lights(&lights).expect("lights"));
    let rig = light_rig(&scene, lights.as_ref());
    (scene, rig)
}

/// Traces `points` of the references once and compares with both renderers.
fn assert_agrees(name: &str, points: usize, samples_max: u64, median_max: f64, within_two_min: f64) {
    let Some(folder) = folder() else { return };
    let (scene, rig) = scene_and_light(&folder, name);
    let references = ["mitsuba", "cycles"].map(|renderer| {
        let mut points_read = csv::read(&folder.join(format!("{name}.{renderer}.csv"))).expect("a reference");
        points_read.truncate(points);
        points_read
    });
    let places: Vec<_> = references[0].iter().map(|point| (point.position, point.normal)).collect();
    let options = ReferenceOptions { samples_max, target_error_rel: 0.0, ..ReferenceOptions::default() };
    let found = irradiance_at_points(&SceneTracer::new(&scene), &rig, &places, &options, &|| ());
    for reference in references {
        let (errors, agreement) = compared(&found, &reference);
        println!("{name}: {errors:?}, {agreement:?}");
        assert_eq!(errors.uncovered, 0);
        assert!(errors.bias.abs() < 0.01, "{name}: {errors:?}");
        assert!(errors.median_rel < median_max, "{name}: {errors:?}");
        assert_eq!(errors.beyond_factor_two, 0.0, "{name}: {errors:?}");
        assert!(agreement.within_two >= within_two_min, "{name}: {agreement:?}");
        assert!(agreement.within_three >= 0.98, "{name}: {agreement:?}");
        assert!(agreement.deviation_rms < 1.15, "{name}: {agreement:?}");
    }
}

fn compared(found: &[PointEstimate], reference: &[ReferencePoint]) -> (LightErrors, Agreement) {
    let measured: Vec<Option<Rgb>> = found.iter().map(|point| Some(point.irradiance)).collect();
    let ours: Vec<ReferencePoint> = found
        .iter()
        .zip(reference)
        .map(|(estimate, theirs)| ReferencePoint {
            irradiance: estimate.irradiance,
            standard_error: estimate.standard_error,
            ..*theirs
        })
        .collect();
    let errors = compare_points(reference, &measured).expect("comparable light");
    (errors, agreement(&ours, reference).expect("light to compare with"))
}

#[test]
fn the_measured_cornell_box_agrees() {
    assert_agrees("cornell", 91, 4096, 0.01, WITHIN_TWO_MIN);
}

#[test]
fn rooms_with_small_emitters_agree() {
    assert_agrees("office", 60, 4096, 0.03, WITHIN_TWO_MIN);
}

#[test]
fn a_sunlit_atrium_agrees() {
    assert_agrees("sponza", 60, 2048, 0.06, WITHIN_TWO_OF_FEW_PATHS);
}

#[test]
fn a_textured_town_agrees() {
    assert_agrees("kaykit_city", 69, 2048, 0.02, WITHIN_TWO_MIN);
}
