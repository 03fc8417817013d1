//! `render --view error` and `--view cause`: how wrong the served light is at what a camera sees, and why.
//!
//! Every pixel asks at one place: served irradiance against path-traced irradiance, no reflectance, no direct light.

use crate::causes::{Cause, ExplainOptions, Explainer};
use crate::output::out;
use crate::progress_bars::counted;
use crate::reference_light;
use crate::scene_source::SceneSource;
use crate::volume_light;
use crate::whole_world::{WholeLight, WholeWorld};
use anyhow::Context as _;
use clap::ValueEnum;
use earthshine_render::camera::Pinhole;
use earthshine_render::compare_points::{DARK_SHARE, LightErrors, compare_points};
use earthshine_render::csv::ReferencePoint;
use earthshine_render::difference::false_colour;
use earthshine_render::{ReferenceOptions, SceneTracer, image_file, legend};
use earthshine_volume::Volume;
use earthshine_world::{Rgb, Vec3};
use image::RgbImage;
use std::path::Path;

/// What a picture of a world shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum View {
    /// Light as a camera sees it.
    #[default]
    Light,
    /// Relative error of the served irradiance.
    Error,
    /// What causes it.
    Cause,
}

/// Full colour at this relative error, either way.
const FULL_SCALE_REL: f32 = 0.5;
/// Differences within so many standard errors of the reference are noise.
const NOISE_DEVIATIONS: f32 = 2.0;
const NO_SURFACE: [u8; 3] = [70; 3];
const NO_LIGHT: [u8; 3] = [255, 0, 255];
/// Rays of the causes: pixels are many, and their neighbours ask the same patches.
const OPTIONS: ExplainOptions = ExplainOptions { point_rays: 64, patch_rays_max: 256 };

/// Position and unit normal.
type Place = (Vec3, Vec3);

/// Everything that is looked at.
pub(crate) struct ErrorView<'a> {
    pub(crate) tracer: &'a SceneTracer<'a>,
    pub(crate) source: &'a SceneSource,
    pub(crate) world: &'a WholeWorld,
    pub(crate) light: &'a WholeLight,
    pub(crate) volumes: &'a [Volume],
    pub(crate) camera: Pinhole,
    /// Paths a pixel.
    pub(crate) samples: u32,
    pub(crate) seed: u64,
    pub(crate) quiet: bool,
}

/// A picture with its legend, and the errors in it.
pub(crate) struct Drawn {
    pub(crate) image: RgbImage,
    pub(crate) errors: LightErrors,
}

impl ErrorView<'_> {
    /// Draws `view` into `folder` and says what it shows.
    ///
    /// # Errors
    /// As [`Self::draw`]; the picture cannot be written.
    pub(crate) fn write(&self, view: View, folder: &Path, json: bool) -> anyhow::Result<()> {
        let drawn = self.draw(view)?;
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        let path = folder.join(if view == View::Cause { "cause.png" } else { "error.png" });
        image_file::write_png(&path, &drawn.image)?;
        let errors = &drawn.errors;
        if json {
            out!("{}", serde_json::to_string(errors)?);
            return Ok(());
        }
        out!("{}: {} pixels compared, {} without light", path.display(), errors.points, errors.uncovered);
        out!(
            "served irradiance: median {:.2} %, RMSE {:.2} %, bias {:+.2} %; the reference's noise {:.2} %",
            errors.median_rel * 100.0,
            errors.rel_rmse * 100.0,
            errors.bias * 100.0,
            errors.reference_noise_rel * 100.0
        );
        Ok(())
    }

    /// Draws the errors, or their causes.
    ///
    /// # Errors
    /// Nothing in view has light, or the reference is black.
    pub(crate) fn draw(&self, view: View) -> anyhow::Result<Drawn> {
        let places = self.places();
        let asked: Vec<_> = places.iter().flatten().copied().collect();
        let options = ReferenceOptions {
            seed: self.seed,
            samples_max: u64::from(self.samples),
            target_error_rel: 0.0,
            ..ReferenceOptions::default()
        };
        let reference =
            reference_light::traced(self.tracer, &self.source.lights, &asked, &options, self.quiet);
        let served: Vec<_> = asked
            .iter()
            .map(|&(position, normal)| volume_light::at(self.volumes, position, normal))
            .collect();
        let errors = compare_points(&reference, &served)?;
        let image = if view == View::Cause {
            self.causes(&places, &reference)?
        } else {
            self.errors(&places, &reference, &served, &errors)
        };
        Ok(Drawn { image, errors })
    }

    /// What the middle of each pixel sees.
    fn places(&self) -> Vec<Option<Place>> {
        let (width, height) = (self.camera.width(), self.camera.height());
        (0..width * height)
            .map(|index| {
                let direction =
                    self.camera.direction((index % width) as f32 + 0.5, (index / width) as f32 + 0.5);
                let hit = self.tracer.closest(self.camera.position(), direction, 0.0, f32::INFINITY)?;
                let vertex = self.tracer.vertex(&hit);
                Some((vertex.position, vertex.normal))
            })
            .collect()
    }

    fn errors(
        &self,
        places: &[Option<Place>],
        reference: &[ReferencePoint],
        served: &[Option<Rgb>],
        errors: &LightErrors,
    ) -> RgbImage {
        let mean = |light: Rgb| light.element_sum() / 3.0;
        let mean_reference =
            reference.iter().map(|point| mean(point.irradiance)).sum::<f32>() / reference.len() as f32;
        let floor = DARK_SHARE as f32 * mean_reference;
        let colours = reference.iter().zip(served).map(|(point, served)| {
            let right = mean(point.irradiance);
            served.map_or(NO_LIGHT, |light| {
                let difference = mean(light) - right;
                let noise = NOISE_DEVIATIONS * mean(point.standard_error);
                let beyond = (difference * difference - noise * noise).max(0.0).sqrt();
                false_colour((beyond * difference.signum()) / right.max(floor) / FULL_SCALE_REL)
            })
        });
        let percent = |share: f64| format!("{:.1} %", share * 100.0);
        let [low, high] = ["-", "+"].map(|sign| format!("{sign}{} %", FULL_SCALE_REL * 100.0));
        let lines = [
            "SERVED AGAINST PATH-TRACED IRRADIANCE: BLUE TOO DARK, RED TOO BRIGHT".to_owned(),
            "RELATIVE TO THE LATTER, OR TO 1 % OF ITS MEAN WHERE THAT IS MORE".to_owned(),
            format!(
                "BLACK UP TO {NOISE_DEVIATIONS} STANDARD ERRORS OF THE REFERENCE, MEDIAN {}",
                percent(errors.reference_noise_rel)
            ),
            format!("MEDIAN ERROR {}, NOISE INCLUDED", percent(errors.median_rel)),
            "GREY: NO SURFACE. PINK: NO LIGHT SERVED".to_owned(),
        ];
        legend::with_scale(&self.painted(places, colours), false_colour, [&low, "0", &high], &lines)
    }

    fn causes(&self, places: &[Option<Place>], reference: &[ReferencePoint]) -> anyhow::Result<RgbImage> {
        let explainer =
            Explainer::new(self.world, self.light, self.volumes, self.tracer, &self.source.lights, OPTIONS);
        let bar = counted("causes", "pixels", reference.len() as u64, self.quiet);
        let explained = explainer.explain(reference, &|| bar.inc(1))?;
        bar.finish_and_clear();
        let mut colours = vec![NO_LIGHT; reference.len()];
        let mut counts = [0usize; Cause::COUNT];
        let mean = explained.iter().map(|point| point.reference).sum::<f64>() / explained.len().max(1) as f64;
        for point in &explained {
            let cause = point.cause();
            counts[cause as usize] += 1;
            let relative = point.error().abs() / point.reference.max(DARK_SHARE * mean);
            // Paler where the error is small.
            let strength = (relative as f32 / FULL_SCALE_REL).clamp(0.1, 1.0).sqrt();
            colours[point.index] = colour_of(cause).map(|channel| (f32::from(channel) * strength) as u8);
        }
        let mut order = Cause::ALL;
        order.sort_by_key(|&cause| std::cmp::Reverse(counts[cause as usize]));
        let mut keys: Vec<([u8; 3], String)> = order
            .into_iter()
            .filter(|&cause| counts[cause as usize] > 0)
            .map(|cause| {
                let share = 100.0 * counts[cause as usize] as f64 / explained.len().max(1) as f64;
                (colour_of(cause), format!("{share:.0} % {}: {}", cause.name(), cause.meaning()))
            })
            .collect();
        keys.push((NO_LIGHT, "no light served".to_owned()));
        keys.push((NO_SURFACE, "no surface".to_owned()));
        keys.push(([0; 3], format!("dark: small error; full colour from {} % on", FULL_SCALE_REL * 100.0)));
        Ok(legend::with_keys(&self.painted(places, colours.into_iter()), &keys))
    }

    /// One colour a place, in order; grey where there is none.
    fn painted(&self, places: &[Option<Place>], mut colours: impl Iterator<Item = [u8; 3]>) -> RgbImage {
        let mut image =
            RgbImage::from_pixel(self.camera.width(), self.camera.height(), image::Rgb(NO_SURFACE));
        for (pixel, place) in image.pixels_mut().zip(places) {
            if place.is_some() {
                pixel.0 = colours.next().unwrap_or(NO_SURFACE);
            }
        }
        image
    }
}

/// Of a cause: lookup warm, rows green, exitance blue, the rest pale.
fn colour_of(cause: Cause) -> [u8; 3] {
    match cause {
        Cause::ThinWall => [255, 40, 40],
        Cause::HiddenPoints => [255, 0, 140],
        Cause::MixedNormals => [255, 150, 0],
        Cause::VoxelDetail => [255, 235, 0],
        Cause::LookupFallback => [150, 75, 0],
        Cause::SmallPatch => [255, 170, 150],
        Cause::Air => [255, 200, 220],
        Cause::TooFewRays => [0, 220, 60],
        Cause::RowBalance => [0, 120, 60],
        Cause::EmitterEdge => [60, 60, 255],
        Cause::LampEdge => [0, 170, 255],
        Cause::ReflectanceMix => [150, 110, 255],
        Cause::NoPatchSeen => [0, 255, 230],
        Cause::FarLight => [180, 180, 180],
        Cause::Noise => [60, 60, 90],
    }
}
