//! Camera pictures in layers: what lamps, glow and sky show directly, and what the surroundings add.
//!
//! The direct layer is always traced. The indirect one comes from the reference tracer or from served
//! volumes, so that two pictures of one camera differ in nothing but the light under test.

use crate::camera::Pinhole;
use crate::path::{EmitterSampling, PathTracer};
use crate::sampling::{PathStream, spread_pairs};
use crate::tracer::{SceneTracer, Vertex, off_surface};
use earthshine_world::random::{Purpose, hash};
use earthshine_world::{LightRig, Rgb, Vec3};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

/// Most samples a pixel.
pub const SAMPLES_MAX: u32 = 1 << 20;

/// Number of the stream that a pixel's sequence of places and first directions starts from; samples take those below.
const STARTS: u64 = u64::MAX;

/// A linear picture, row by row from the upper left.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    width: u32,
    height: u32,
    pixels: Vec<Rgb>,
}

impl Picture {
    /// From its pixels.
    ///
    /// # Panics
    /// If `pixels` are not `width * height`.
    #[must_use]
    pub fn new(width: u32, height: u32, pixels: Vec<Rgb>) -> Self {
        assert_eq!(pixels.len(), width as usize * height as usize, "one value a pixel");
        Self { width, height, pixels }
    }

    /// Pixels across.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Radiance, cd/m2.
    #[must_use]
    pub fn pixels(&self) -> &[Rgb] {
        &self.pixels
    }

    /// Radiance of one pixel, cd/m2.
    ///
    /// # Panics
    /// If it is outside.
    #[must_use]
    pub fn at(&self, x: u32, y: u32) -> Rgb {
        assert!(x < self.width && y < self.height, "({x}, {y}) is outside");
        self.pixels[y as usize * self.width as usize + x as usize]
    }
}

/// What to take a picture of, and how well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureOptions {
    /// From where.
    pub camera: Pinhole,
    /// Places within each pixel, 1 to [`SAMPLES_MAX`]; with [`LightSource::Reference`] also the paths a pixel.
    pub samples: u32,
    /// Of the random numbers.
    pub seed: u64,
}

/// Irradiance at a position for a unit normal, lx; `None` where nothing is known.
pub type IrradianceLookup<'a> = dyn Fn(Vec3, Vec3) -> Option<Rgb> + Sync + 'a;

/// Where indirect light comes from.
#[derive(Clone, Copy)]
pub enum LightSource<'a> {
    /// The path tracer: one path a sample.
    Reference,
    /// A lookup, say into served volumes. Unknown places stay black and are counted.
    Lookup(&'a IrradianceLookup<'a>),
}

impl std::fmt::Debug for LightSource<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Reference => "Reference",
            Self::Lookup(_) => "Lookup",
        })
    }
}

/// One picture, taken apart. `full` is the sum of the other two.
#[derive(Debug, Clone, PartialEq)]
pub struct Layers {
    /// Lamps and sun on surfaces, with shadows; emission and sky that the camera sees itself.
    pub direct: Picture,
    /// `reflectance / pi` times irradiance as served.
    pub indirect: Picture,
    /// Both.
    pub full: Picture,
    /// Share of surface samples whose irradiance the lookup did not know.
    pub uncovered_share: f64,
}

/// `samples` is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0} samples a pixel; it must be 1 to {SAMPLES_MAX}")]
pub struct SamplesError(pub u32);

/// Whether pictures are taken at `samples` paths a pixel: for who has other work to do before.
///
/// # Errors
/// It is out of range.
pub fn check_samples(samples: u32) -> Result<(), SamplesError> {
    if (1..=SAMPLES_MAX).contains(&samples) { Ok(()) } else { Err(SamplesError(samples)) }
}

/// Takes a picture of the tracer's scene on all cores; the same options give the same bits.
///
/// # Errors
/// The number of samples is out of range.
pub fn render(
    tracer: &SceneTracer<'_>,
    rig: &LightRig,
    options: &PictureOptions,
    source: LightSource<'_>,
) -> Result<Layers, SamplesError> {
    render_with_progress(tracer, rig, options, source, &|_| ())
}

/// As [`render`]; `finished` hears of every row of pixels from any thread: how many pixels it had.
///
/// # Errors
/// As [`render`].
pub fn render_with_progress(
    tracer: &SceneTracer<'_>,
    rig: &LightRig,
    options: &PictureOptions,
    source: LightSource<'_>,
    finished: &(dyn Fn(u64) + Sync),
) -> Result<Layers, SamplesError> {
    check_samples(options.samples)?;
    let paths = PathTracer { tracer, rig, emitter_sampling: EmitterSampling::Balanced };
    let (width, height) = (options.camera.width(), options.camera.height());
    let row = |y: u32| -> Vec<Pixel> {
        let row = (0..width).map(|x| paths.pixel(options, source, y * width + x)).collect();
        finished(width.into());
        row
    };
    let pixels: Vec<Pixel> = (0..height).into_par_iter().with_max_len(1).flat_map_iter(row).collect();
    let layer = |value: fn(&Pixel) -> Rgb| Picture::new(width, height, pixels.iter().map(value).collect());
    let surfaces: u64 = pixels.iter().map(|pixel| u64::from(pixel.surfaces)).sum();
    let uncovered: u64 = pixels.iter().map(|pixel| u64::from(pixel.uncovered)).sum();
    Ok(Layers {
        direct: layer(|pixel| pixel.direct),
        indirect: layer(|pixel| pixel.indirect),
        full: layer(|pixel| pixel.direct + pixel.indirect),
        uncovered_share: uncovered as f64 / surfaces.max(1) as f64,
    })
}

/// One pixel, its samples summed up.
#[derive(Debug, Clone, Copy, Default)]
struct Pixel {
    direct: Rgb,
    indirect: Rgb,
    surfaces: u32,
    uncovered: u32,
}

impl PathTracer<'_> {
    fn pixel(&self, options: &PictureOptions, source: LightSource<'_>, index: u32) -> Pixel {
        let camera = &options.camera;
        let seed = hash(options.seed, Purpose::ReferencePath, u64::from(index), 1);
        let corner = ((index % camera.width()) as f32, (index / camera.width()) as f32);
        let mut pixel = Pixel::default();
        let mut start = PathStream::new(seed, STARTS);
        let (first, place) = (start.pair(), start.pair());
        for sample in 0..options.samples {
            let mut stream = PathStream::new(seed, u64::from(sample));
            // The two that decide most: where in the pixel, and which way from there.
            let [first, (dx, dy)] = spread_pairs(sample, [first.0, first.1, place.0, place.1]);
            let direction = camera.direction(corner.0 + dx, corner.1 + dy);
            let Some(hit) = self.tracer.closest(camera.position(), direction, 0.0, f32::INFINITY) else {
                pixel.direct += self.sky_radiance(direction);
                continue;
            };
            let vertex = self.tracer.vertex(&hit);
            let reflected = vertex.reflectance * FRAC_1_PI;
            let lamps = self.lamp_irradiance(&vertex, &mut stream, &mut 0);
            pixel.direct += vertex.emitted_radiance * self.rig.emission_scale + reflected * lamps;
            pixel.surfaces += 1;
            match self.surroundings(&vertex, source, first, &mut stream) {
                Some(irradiance) => pixel.indirect += reflected * irradiance,
                None => pixel.uncovered += 1,
            }
        }
        let share = 1.0 / options.samples as f32;
        Pixel { direct: pixel.direct * share, indirect: pixel.indirect * share, ..pixel }
    }

    fn surroundings(
        &self,
        vertex: &Vertex,
        source: LightSource<'_>,
        first: (f32, f32),
        stream: &mut PathStream,
    ) -> Option<Rgb> {
        match source {
            LightSource::Reference => {
                Some(self.sample(vertex.position, vertex.normal, first, stream).irradiance)
            }
            LightSource::Lookup(lookup) => lookup(off_surface(vertex.position, vertex.normal), vertex.normal),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::{SceneBuilder, glowing, grey};
    use earthshine_world::{Light, Sky};

    fn options(position: Vec3, target: Vec3, samples: u32) -> PictureOptions {
        PictureOptions { camera: Pinhole::new(position, target, 60.0, 8, 6).unwrap(), samples, seed: 4 }
    }

    fn mean(picture: &Picture) -> f32 {
        picture.pixels().iter().map(|pixel| pixel.x).sum::<f32>() / picture.pixels().len() as f32
    }

    #[test]
    fn a_furnace_is_one_even_radiance() {
        let mut builder = SceneBuilder::default();
        let wall = builder.material(glowing(0.5, 3.0));
        builder.room(wall);
        let tracer = SceneTracer::new(&builder.scene);
        let view = options(Vec3::splat(0.5), Vec3::ZERO, 256);
        let layers = render(&tracer, &LightRig::emission_only(), &view, LightSource::Reference).unwrap();
        assert!(layers.direct.pixels().iter().all(|pixel| (pixel.x - 3.0).abs() < 1e-5));
        assert!((mean(&layers.full) - 6.0).abs() < 0.05, "{}", mean(&layers.full));
        let again = render(&tracer, &LightRig::emission_only(), &view, LightSource::Reference).unwrap();
        assert_eq!(layers, again);
    }

    #[test]
    fn the_ground_under_sun_and_sky_adds_up() {
        let mut builder = SceneBuilder::default();
        let ground = builder.material(grey(0.5));
        builder.plate(0.0, 1e3, true, ground);
        let tracer = SceneTracer::new(&builder.scene);
        let sun = Light::Directional {
            direction: Vec3::new(0.0, -0.8, 0.6),
            illuminance: Rgb::splat(100.0),
            angular_diameter_rad: 0.0,
        };
        let sky = Sky::constant(Rgb::splat(7.0));
        let rig = LightRig { lights: vec![sun], sky, emission_scale: 1.0 };
        let down = options(Vec3::new(0.0, 5.0, 0.0), Vec3::new(0.1, 0.0, 0.0), 16);
        let layers = render(&tracer, &rig, &down, LightSource::Reference).unwrap();
        assert!((mean(&layers.direct) - 0.5 * 80.0 * FRAC_1_PI).abs() < 1e-3);
        assert!((mean(&layers.indirect) - 3.5).abs() < 1e-3);
        assert!((mean(&layers.full) - mean(&layers.direct) - mean(&layers.indirect)).abs() < 1e-4);
        let up = options(Vec3::new(0.0, 5.0, 0.0), Vec3::new(0.1, 10.0, 0.0), 4);
        let layers = render(&tracer, &rig, &up, LightSource::Reference).unwrap();
        assert!((mean(&layers.direct) - 7.0).abs() < 1e-5 && mean(&layers.indirect) == 0.0);
    }

    #[test]
    fn a_lookup_lights_what_it_knows_and_the_rest_is_counted() {
        let mut builder = SceneBuilder::default();
        let ground = builder.material(grey(0.5));
        builder.plate(0.0, 1e3, true, ground);
        let tracer = SceneTracer::new(&builder.scene);
        let known = |position: Vec3, normal: Vec3| {
            assert!(normal == Vec3::Y && position.y > 0.0);
            (position.x > 0.0).then_some(Rgb::splat(10.0))
        };
        let view = options(Vec3::new(0.0, 5.0, 0.0), Vec3::new(0.0, 0.0, -0.001), 64);
        let rig = LightRig::emission_only();
        let layers = render(&tracer, &rig, &view, LightSource::Lookup(&known)).unwrap();
        assert!((layers.uncovered_share - 0.5).abs() < 0.02, "{}", layers.uncovered_share);
        assert!((mean(&layers.full) - 0.5 * 5.0 * FRAC_1_PI).abs() < 0.05);
    }

    #[test]
    fn no_samples_is_an_error() {
        let scene = earthshine_scene::Scene::default();
        let view = options(Vec3::ZERO, Vec3::X, 0);
        let result = render(&SceneTracer::new(&scene), &LightRig::default(), &view, LightSource::Reference);
        assert_eq!(result, Err(SamplesError(0)));
    }
}
