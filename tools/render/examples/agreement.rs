//! How our reference tracer agrees with two other renderers on the shared scenes, and how fast it is.
//!
//! `cargo run --release -p earthshine-render --example agreement -- cornell 0.01 65536 200`:
//! scene, target relative error, most paths a point, most points.
#![expect(clippy::print_stdout, reason = "an example's results belong to its reader")]

use earthshine_render::reference::{ReferenceOptions, irradiance_at_points};
use earthshine_render::{SceneTracer, compare_points, csv};
use earthshine_scene::{ImportOptions, light_rig, load, load_lights, scenes_dir};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let name = arguments.first().map_or("cornell", String::as_str);
    let target_error_rel = arguments.get(1).map_or(Ok(0.01), |text| text.parse())?;
    let samples_max = arguments.get(2).map_or(Ok(1 << 16), |text| text.parse())?;
    let points_max = arguments.get(3).map_or(Ok(usize::MAX), |text| text.parse())?;
    let folder = scenes_dir().ok_or("no folder of shared scenes; name it in EARTHSHINE_SCENES")?;

    let scene = load(&folder.join(format!("{name}.glb")), &ImportOptions::default())?;
    let lights = load_lights(&folder.join(format!("{name}.lights.json"))).ok();
    let rig = light_rig(&scene, lights.as_ref());
    let start = Instant::now();
    let tracer = SceneTracer::new(&scene);
    let triangles = scene.triangles.len();
    println!("{name}: {triangles} triangles, tree in {:.2} s", start.elapsed().as_secs_f64());

    let mut reference = csv::read(&folder.join(format!("{name}.mitsuba.csv")))?;
    reference.truncate(points_max);
    let places: Vec<_> = reference.iter().map(|point| (point.position, point.normal)).collect();
    let options = ReferenceOptions { seed: 1, samples_max, target_error_rel, ..ReferenceOptions::default() };
    let start = Instant::now();
    let found = irradiance_at_points(&tracer, &rig, &places, &options, &|| ());
    let seconds = start.elapsed().as_secs_f64();
    let rays: u64 = found.iter().map(|point| point.rays).sum();
    let samples: u64 = found.iter().map(|point| point.samples).sum();
    println!("{} points, {samples} paths, {rays} rays in {seconds:.2} s", found.len());
    println!(
        "{:.2} million rays a second on {} threads",
        rays as f64 / seconds / 1e6,
        rayon::current_num_threads()
    );

    let measured: Vec<_> = found.iter().map(|point| Some(point.irradiance)).collect();
    println!("against mitsuba: {:?}", compare_points(&reference, &measured)?);
    let mut other = csv::read(&folder.join(format!("{name}.cycles.csv")))?;
    other.truncate(points_max);
    println!("against cycles:  {:?}", compare_points(&other, &measured)?);
    let theirs: Vec<_> = other.iter().map(|point| Some(point.irradiance)).collect();
    println!("cycles against mitsuba: {:?}", compare_points(&reference, &theirs)?);
    let mut deviations: Vec<f32> = found
        .iter()
        .zip(&reference)
        .map(|(ours, theirs)| {
            let spread = ours.standard_error.element_sum().hypot(theirs.standard_error.element_sum());
            (ours.irradiance - theirs.irradiance).element_sum() / spread
        })
        .collect();
    deviations.sort_by(f32::total_cmp);
    let at = |share: f32| deviations[((deviations.len() - 1) as f32 * share) as usize];
    println!(
        "deviation in standard errors: {:.2} {:.2} {:.2} {:.2} {:.2} (5, 25, 50, 75, 95 %)",
        at(0.05),
        at(0.25),
        at(0.5),
        at(0.75),
        at(0.95)
    );
    Ok(())
}
