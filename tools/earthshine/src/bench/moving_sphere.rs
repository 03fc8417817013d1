//! `bench sphere`: light on a sphere that moves through a scene's air, against a path tracer at the same points.
//!
//! The sphere is virtual: it casts no shadow and reflects nothing, on either side. Between two frames its light is
//! read many times more, because a step in it, unlike a steep slope, does not shrink with the distance.

use super::Report;
use super::accuracy::measured::baked;
use crate::exit_code::{Mismatch, WrongUse};
use crate::numbers;
use crate::quality::QualityArguments;
use crate::reference_light;
use crate::scene_source::{self, SceneSource};
use crate::view::vector;
use crate::volume_light;
use crate::writable;
use anyhow::Context as _;
use clap::Args;
use earthshine_gen::WorldKind;
use earthshine_render::ReferenceOptions;
use earthshine_render::compare_points::{LightErrors, compare_points};
use earthshine_render::csv::{self, ReferencePoint};
use earthshine_volume::Volume;
use earthshine_world::{Rgb, Vec3};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `bench sphere`.
#[derive(Args)]
pub(crate) struct SphereArguments {
    /// A generated world or a .glb file.
    #[arg(long)]
    scene: String,
    /// Lights JSON.
    #[arg(long)]
    lights: Option<PathBuf>,
    /// Corners of the sphere's way, m, in order: "x,y,z; x,y,z; ...". The generated Cornell box has a way of its own.
    #[arg(long, value_parser = vector, value_delimiter = ';', allow_hyphen_values = true)]
    way: Vec<Vec3>,
    /// Radius of the sphere, m. Default: an eighth of a voxel's edge or 5 cm, whichever is more.
    #[arg(long, value_parser = numbers::positive)]
    radius: Option<f32>,
    /// Places on the way at which light is compared.
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u32).range(2..=10_000))]
    frames: u32,
    /// Points on the sphere.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    sphere_points: u32,
    /// Noise at which the reference stops, as a share of the light.
    #[arg(long, default_value_t = 0.02, value_parser = numbers::noise)]
    noise: f32,
    /// CSV that an earlier run with the same way wrote: its light is not traced again.
    #[arg(long)]
    reference: Option<PathBuf>,
    /// Writes the reference light as CSV.
    #[arg(long)]
    reference_out: Option<PathBuf>,
    #[command(flatten)]
    quality: QualityArguments,
}

/// Readings between two frames.
const STEPS_PER_FRAME: u32 = 32;
/// Less light than this share of the reference is black.
const BLACK_SHARE: f32 = 0.1;
/// Through the generated Cornell box: in front of the tall block, over the short one, up and over the tall one, under
/// the lamp.
const CORNELL_WAY: [Vec3; 6] = [
    Vec3::new(-0.75, 0.3, 0.75),
    Vec3::new(-0.3, 0.45, 0.55),
    Vec3::new(-0.25, 0.9, 0.5),
    Vec3::new(0.4, 0.95, 0.35),
    Vec3::new(0.55, 1.5, -0.4),
    Vec3::new(-0.2, 1.55, -0.2),
];

#[derive(Serialize)]
struct Figures {
    patches: u64,
    receivers: u64,
    way_m: f32,
    radius_m: f32,
    #[serde(flatten)]
    errors: LightErrors,
    /// Share of points with less than a tenth of the reference light, those without any included.
    black_share: f64,
    /// Largest change of a point's light from one frame to the next, over the larger of the two; and the reference's.
    frame_change_max_rel: f32,
    reference_frame_change_max_rel: f32,
    /// The same, mean over points and frames.
    frame_change_mean_rel: f32,
    reference_frame_change_mean_rel: f32,
    /// Largest change within one step, over the larger light; a step is a frame's way over the steps a frame.
    step_change_max_rel: f32,
    steps_per_frame: u32,
    bake_seconds: Option<f64>,
    reference_seconds: f64,
    world_bytes: u64,
}

/// Runs the suite.
pub(crate) fn run(arguments: &SphereArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    writable::ensure_files(&arguments.reference_out)?;
    let metals_black = arguments.quality.metals_black();
    let source = scene_source::load(&arguments.scene, arguments.lights.as_deref(), metals_black)?;
    let way = Way::of(arguments, &source)?;
    let parameters = arguments.quality.checked_of_patches(&source)?;
    let voxel_edge_m = parameters.grid.voxel_edge_m;
    let radius_m = arguments.radius.unwrap_or_else(|| (voxel_edge_m / 8.0).max(0.05));
    let sphere = Sphere { radius_m, points: arguments.sphere_points };

    let places: Vec<(Vec3, Vec3)> = (0..arguments.frames)
        .flat_map(|frame| sphere.places(way.at(frame as f32 / (arguments.frames - 1) as f32)))
        .collect();
    // A file of other points is refused before the bake.
    let referencing = Instant::now();
    let reference = reference(arguments, &source, &places, json)?;
    let reference_seconds = referencing.elapsed().as_secs_f64();
    let measured = baked(&source, parameters, json)?;
    let volumes = &measured.volumes;
    let lights: Vec<Option<Rgb>> =
        reference.iter().map(|point| volume_light::at(volumes, point.position, point.normal)).collect();
    let of_reference: Vec<f32> = reference.iter().map(|point| mean(point.irradiance)).collect();
    let of_volume: Vec<f32> = lights.iter().map(|light| light.map_or(0.0, mean)).collect();
    let black = of_volume.iter().zip(&of_reference).filter(|(light, right)| **light < BLACK_SHARE * **right);
    let (frame_max, frame_mean) = changes(&of_volume, arguments.sphere_points);
    let (reference_max, reference_mean) = changes(&of_reference, arguments.sphere_points);
    let chunks = &measured.world.manifest.chunks;
    let figures = Figures {
        patches: measured.patches,
        receivers: chunks.iter().map(|chunk| u64::from(chunk.receiver_count)).sum(),
        way_m: way.length_m,
        radius_m,
        errors: compare_points(&reference, &lights)?,
        black_share: black.count() as f64 / reference.len() as f64,
        frame_change_max_rel: frame_max,
        reference_frame_change_max_rel: reference_max,
        frame_change_mean_rel: frame_mean,
        reference_frame_change_mean_rel: reference_mean,
        step_change_max_rel: largest_step(volumes, &way, sphere, arguments.frames),
        steps_per_frame: STEPS_PER_FRAME,
        bake_seconds: measured.bake_seconds,
        reference_seconds,
        world_bytes: measured.world_bytes,
    };
    let seconds = started.elapsed().as_secs_f64();
    Report::new("sphere", &source.name, "gather", arguments.quality.seed, seconds, figures).print(json)
}

/// A line through corners, walked at an even pace.
struct Way {
    corners: Vec<Vec3>,
    length_m: f32,
}

impl Way {
    fn of(arguments: &SphereArguments, source: &SceneSource) -> Result<Self, WrongUse> {
        let corners = match source.kind {
            Some(WorldKind::Cornell) if arguments.way.is_empty() => CORNELL_WAY.to_vec(),
            _ => arguments.way.clone(),
        };
        let length_m = corners.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        if length_m <= 0.0 {
            return Err(WrongUse(
                "where the sphere goes has to be said, by two places or more: --way \"x,y,z; x,y,z\"",
            ));
        }
        Ok(Self { corners, length_m })
    }

    /// The place after the share `along` (0..=1) of the way.
    fn at(&self, along: f32) -> Vec3 {
        let mut left = along * self.length_m;
        for pair in self.corners.windows(2) {
            let length = pair[0].distance(pair[1]);
            if left <= length && length > 0.0 {
                return pair[0].lerp(pair[1], left / length);
            }
            left -= length;
        }
        self.corners[self.corners.len() - 1]
    }
}

#[derive(Clone, Copy)]
struct Sphere {
    radius_m: f32,
    points: u32,
}

impl Sphere {
    /// Evenly spread points (a Fibonacci lattice) with their normals.
    fn places(self, centre: Vec3) -> impl Iterator<Item = (Vec3, Vec3)> {
        const GOLDEN_ANGLE: f32 = 2.399_963_2;
        (0..self.points).map(move |index| {
            let y = 1.0 - (2 * index + 1) as f32 / self.points as f32;
            let (sin, cos) = (index as f32 * GOLDEN_ANGLE).sin_cos();
            let radius = (1.0 - y * y).max(0.0).sqrt();
            let normal = Vec3::new(radius * cos, y, radius * sin).normalize_or(Vec3::Y);
            (centre + self.radius_m * normal, normal)
        })
    }
}

fn reference(
    arguments: &SphereArguments,
    source: &SceneSource,
    places: &[(Vec3, Vec3)],
    quiet: bool,
) -> anyhow::Result<Vec<ReferencePoint>> {
    if let Some(path) = &arguments.reference {
        let points = csv::read(path)?;
        let is_same = points.len() == places.len()
            && points.iter().zip(places).all(|(point, place)| point.position.distance(place.0) < 1e-3);
        if !is_same {
            let path = path.display();
            let cause = format!("{path} is of another way, or of other points: leave --reference out");
            return Err(Mismatch(cause).into());
        }
        return Ok(points);
    }
    let options = ReferenceOptions {
        seed: arguments.quality.seed,
        target_error_rel: arguments.noise,
        ..ReferenceOptions::default()
    };
    let points = reference_light::traced(&source.tracer(), &source.lights, places, &options, quiet);
    if let Some(path) = &arguments.reference_out {
        csv::write(path, &points).with_context(|| path.display().to_string())?;
    }
    Ok(points)
}

fn mean(light: Rgb) -> f32 {
    light.element_sum() / 3.0
}

/// Largest and mean change of each point from frame to frame, over the larger of the two.
fn changes(light: &[f32], points: u32) -> (f32, f32) {
    let pairs = light.iter().zip(&light[points as usize..]);
    let changes: Vec<f32> = pairs.map(|(before, after)| change(*before, *after)).collect();
    (changes.iter().copied().fold(0.0, f32::max), changes.iter().sum::<f32>() / changes.len() as f32)
}

fn change(before: f32, after: f32) -> f32 {
    (after - before).abs() / before.max(after).max(f32::MIN_POSITIVE)
}

/// Largest change of any point's light in one step of the way.
fn largest_step(volumes: &[Volume], way: &Way, sphere: Sphere, frames: u32) -> f32 {
    let steps = (frames - 1) * STEPS_PER_FRAME;
    let light = |step: u32| -> Vec<f32> {
        let places = sphere.places(way.at(step as f32 / steps as f32));
        places
            .map(|(position, normal)| volume_light::at(volumes, position, normal).map_or(0.0, mean))
            .collect()
    };
    let mut before = light(0);
    let mut largest = 0.0f32;
    for step in 1..=steps {
        let after = light(step);
        largest = before.iter().zip(&after).map(|(b, a)| change(*b, *a)).fold(largest, f32::max);
        before = after;
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_is_walked_at_an_even_pace() {
        let way = Way { corners: vec![Vec3::ZERO, Vec3::X * 3.0, Vec3::new(3.0, 1.0, 0.0)], length_m: 4.0 };
        assert_eq!(way.at(0.0), Vec3::ZERO);
        assert!(way.at(0.5).distance(Vec3::X * 2.0) < 1e-6);
        assert!(way.at(0.875).distance(Vec3::new(3.0, 0.5, 0.0)) < 1e-6);
        assert_eq!(way.at(1.0), Vec3::new(3.0, 1.0, 0.0));
    }

    #[test]
    fn a_sphere_s_normals_cancel_and_changes_are_relative() {
        let places: Vec<_> = Sphere { radius_m: 2.0, points: 64 }.places(Vec3::ONE).collect();
        let sum: Vec3 = places.iter().map(|place| place.1).sum();
        assert!(sum.length() < 1.0, "{sum}");
        assert!(places.iter().all(|place| (place.0.distance(Vec3::ONE) - 2.0).abs() < 1e-5));
        let (largest, mean) = changes(&[1.0, 4.0, 2.0, 4.0], 2);
        assert_eq!((largest, mean), (0.5, 0.25));
    }
}
