//! Where light is compared, and what it should be there.

use super::AccuracyArguments;
use crate::exit_code::Mismatch;
use crate::reference_light;
use crate::scene_source::SceneSource;
use crate::volume_light;
use anyhow::{Context as _, ensure};
use earthshine_render::ReferenceOptions;
use earthshine_render::csv::{self, ReferencePoint};
use earthshine_world::Vec3;
use std::collections::HashMap;
use std::path::Path;

/// Points of two files are the same up to this, m, and their normals up to this cosine.
const SAME_PLACE_M: f32 = 1e-3;
const SAME_NORMAL_COSINE: f32 = 0.999;

/// Reference light at the points that were asked for.
pub(super) fn reference(
    arguments: &AccuracyArguments,
    source: &SceneSource,
    quiet: bool,
) -> anyhow::Result<Vec<ReferencePoint>> {
    if let Some(path) = &arguments.reference {
        let reference = csv::read(path)?;
        ensure_some(path, reference.len())?;
        return match &arguments.points {
            Some(of) => chosen(&read_places(of)?, &reference)
                .with_context(|| format!("{} in {}", of.display(), path.display())),
            None => Ok(reference),
        };
    }
    let places = places(arguments, source)?;
    let tracer = source.tracer();
    let options = ReferenceOptions {
        seed: arguments.quality.seed,
        target_error_rel: arguments.noise(),
        ..ReferenceOptions::default()
    };
    Ok(reference_light::traced(&tracer, &source.lights, &places, &options, quiet))
}

/// Those of `--points`, or random ones.
pub(super) fn places(
    arguments: &AccuracyArguments,
    source: &SceneSource,
) -> anyhow::Result<Vec<(Vec3, Vec3)>> {
    if let Some(path) = &arguments.points {
        return read_places(path);
    }
    let places = volume_light::random_places(&source.tracer(), arguments.point_count, arguments.quality.seed);
    ensure!(!places.is_empty(), "no point of {} sees out: name points with --points", source.name);
    Ok(places)
}

fn read_places(path: &Path) -> anyhow::Result<Vec<(Vec3, Vec3)>> {
    let places = csv::read_places(path)?;
    ensure_some(path, places.len())?;
    Ok(places)
}

fn ensure_some(path: &Path, count: usize) -> Result<(), csv::CsvError> {
    if count == 0 { Err(csv::CsvError::NoPoints { path: path.into() }) } else { Ok(()) }
}

/// The reference points at `places`, in that order.
fn chosen(places: &[(Vec3, Vec3)], reference: &[ReferencePoint]) -> Result<Vec<ReferencePoint>, Mismatch> {
    let cell = |position: Vec3| (position / SAME_PLACE_M).floor().as_ivec3();
    let mut by_cell: HashMap<glam::IVec3, Vec<usize>> = HashMap::new();
    for (index, point) in reference.iter().enumerate() {
        by_cell.entry(cell(point.position)).or_default().push(index);
    }
    let find = |position: Vec3, normal: Vec3| {
        let near = (0..27).flat_map(|n| {
            let step = glam::IVec3::new(n % 3, n / 3 % 3, n / 9) - 1;
            by_cell.get(&(cell(position) + step)).into_iter().flatten()
        });
        near.map(|&index| &reference[index]).find(|point| {
            point.position.distance(position) <= SAME_PLACE_M
                && point.normal.dot(normal) >= SAME_NORMAL_COSINE
        })
    };
    let mut found = Vec::with_capacity(places.len());
    for (index, &(position, normal)) in places.iter().enumerate() {
        match find(position, normal) {
            Some(point) => found.push(*point),
            None => {
                let point = index + 1;
                return Err(Mismatch(format!(
                    "point {point} at {position} facing {normal} has no light in the reference: trace it, or leave \
                     --points out"
                )));
            }
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::Rgb;

    #[test]
    fn points_are_found_by_place_and_normal_and_missed_by_number() {
        let point = |x: f32, normal: Vec3, light: f32| ReferencePoint {
            position: Vec3::new(x, 0.0, 0.0),
            normal,
            irradiance: Rgb::splat(light),
            standard_error: Rgb::ZERO,
        };
        let reference = [point(0.0, Vec3::Y, 1.0), point(0.0, Vec3::NEG_Y, 2.0), point(5.0, Vec3::Y, 3.0)];
        let places = [(Vec3::X * 5.000_4, Vec3::Y), (Vec3::X * -0.000_4, Vec3::NEG_Y)];
        let lights: Vec<f32> =
            chosen(&places, &reference).unwrap().iter().map(|point| point.irradiance.x).collect();
        assert_eq!(lights, [3.0, 2.0]);
        let error = chosen(&[(Vec3::ZERO, Vec3::Y), (Vec3::Z, Vec3::Y)], &reference).unwrap_err();
        assert!(error.to_string().starts_with("point 2 at [0, 0, 1]"), "{error}");
    }
}
