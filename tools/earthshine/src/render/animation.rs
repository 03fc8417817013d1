//! Moving light as people see it: a sun that crosses the sky, lamps that go off and on, a lamp that moves, by several
//! solvers side by side.

use super::Task;
use crate::fly::{load_sun, sun_path};
use crate::lights_wire;
use crate::output::out;
use crate::progress_bars::counted;
use crate::side_by_side::{self, Reel};
use crate::solver_world;
use crate::volume_light;
use crate::whole_world::{DirectLight, WholeLight, WholeWorld};
use clap::{Args, ValueEnum};
use earthshine_fly::SunPath;
use earthshine_radiosity::solver::{Method, SolverBackend, SolverSettings};
use earthshine_radiosity::{Backend, Slot};
use earthshine_render::image_file;
use earthshine_render::picture::{LightSource, PictureOptions, render};
use earthshine_world::{Bounds, Light, LightRig, Rgb, Vec3};
use image::RgbImage;
use std::path::{Path, PathBuf};

/// Options of an animation.
#[derive(Args)]
pub(crate) struct AnimationArguments {
    /// Lets light move in a world and draws it by several solvers.
    #[arg(long, value_enum)]
    animation: Option<Animation>,
    /// Solvers side by side: gather, alias, cdf, progressive, hybrid. Default: hybrid,alias.
    #[arg(long, value_delimiter = ',', value_parser = solver_world::method)]
    solvers: Vec<Method>,
    /// Frames of light. Default: 96.
    #[arg(long)]
    frames: Option<u32>,
    /// Frames of light a picture. Default: 4.
    #[arg(long)]
    picture_every: Option<u32>,
    /// Sun: its way, as for fly (config/day.example.toml).
    #[arg(long)]
    sun_path: Option<PathBuf>,
}

/// What moves.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Animation {
    /// A sun crosses the sky.
    Sun,
    /// All lamps, suns and glowing surfaces go off after a third, and on again after another.
    Switch,
    /// A lamp goes round.
    Lamp,
}

impl AnimationArguments {
    /// What is asked for.
    pub(super) fn wanted(&self) -> Option<Animation> {
        self.animation
    }

    /// Whether any option besides is given.
    pub(super) fn is_given(&self) -> bool {
        !self.solvers.is_empty()
            || self.frames.is_some()
            || self.picture_every.is_some()
            || self.sun_path.is_some()
    }

    /// Whether a sun's way is given to something else that moves.
    pub(super) fn has_useless_sun_path(&self) -> bool {
        self.sun_path.is_some() && self.animation.is_some_and(|moving| moving != Animation::Sun)
    }
}

/// Solvers, if none are named.
const SOLVERS: [Method; 2] = [Method::Hybrid, Method::Alias];
const FRAMES: u32 = 96;
const PICTURE_EVERY: u32 = 4;
/// Places within a pixel.
const SAMPLES: u32 = 4;
/// Steps that light before the first frame may take to settle.
const SETTLE_STEPS: u32 = 2000;
/// What a lamp that moves brings to a surface a quarter of the scene away, lx.
const LAMP_ILLUMINANCE: f32 = 1000.0;

/// A solver with its light.
struct Act {
    method: Method,
    backend: SolverBackend,
}

/// Where everything plays.
struct Stage<'t, 'a> {
    task: &'t Task<'a>,
    world: WholeWorld,
    slots: Vec<Slot>,
    animation: Animation,
    sun: SunPath,
    frames: u32,
}

/// Draws the animation.
pub(super) fn animate(task: &Task<'_>, animation: Animation, folder: &Path) -> anyhow::Result<()> {
    let options = &task.arguments.animation;
    let (frames, every) =
        (options.frames.unwrap_or(FRAMES).max(2), options.picture_every.unwrap_or(PICTURE_EVERY).max(1));
    let sun = options.sun_path.as_deref().map(load_sun).transpose()?.unwrap_or_else(sun_path);
    let world = WholeWorld::load(folder)?;
    let areas: Vec<f32> = world.patches().map(|patch| patch.area).collect();
    let reflectance: Vec<Rgb> = world.patches().map(|patch| patch.reflectance).collect();
    let all: Vec<u32> = (0..areas.len() as u32).collect();
    let stage =
        Stage { task, slots: all.iter().map(|&slot| Slot(slot)).collect(), world, animation, sun, frames };
    let methods = if options.solvers.is_empty() { &SOLVERS[..] } else { &options.solvers };
    let mut acts = Vec::new();
    for &method in methods {
        let (backend, _) = solver_world::backend(&stage.world.rows, &areas, &reflectance, &all)?;
        acts.push(Act { method, backend });
    }
    let pictures = stage.play(&mut acts, every)?;
    stage.write(&acts, pictures)
}

impl Stage<'_, '_> {
    /// Lights after `share` (0..=1) of the way.
    fn rig(&self, share: f32) -> LightRig {
        let base = &self.task.source.lights;
        match self.animation {
            Animation::Sun => {
                lights_wire::from_client(&self.sun.lights(&lights_wire::to_client(base), share))
            }
            Animation::Switch if (1.0 / 3.0..2.0 / 3.0).contains(&share) => {
                LightRig { lights: Vec::new(), emission_scale: 0.0, sky: base.sky }
            }
            Animation::Switch => base.clone(),
            Animation::Lamp => {
                LightRig { lights: vec![lamp(&self.world.manifest.bounds, share)], ..base.clone() }
            }
        }
    }

    fn shine(&self, backend: &mut SolverBackend, rig: &LightRig, direct: &DirectLight) -> anyhow::Result<()> {
        Ok(backend.set_sources(&self.slots, &direct.exitance, &self.world.sky_irradiance(rig))?)
    }

    /// Pictures of every act, in turn, at one exposure.
    fn play(&self, acts: &mut [Act], every: u32) -> anyhow::Result<Vec<Vec<RgbImage>>> {
        let first = self.rig(0.0);
        let direct = self.world.direct_light(&first);
        for act in &mut *acts {
            self.shine(&mut act.backend, &first, &direct)?;
            for _ in 0..SETTLE_STEPS {
                act.backend.step()?;
                if act.backend.is_settled() {
                    break;
                }
            }
            let settings = SolverSettings {
                method: act.method,
                rebuild_items_per_step: u32::MAX,
                seed: self.task.arguments.seed as u32,
                ..SolverSettings::default()
            };
            act.backend.set_solver(&settings)?;
        }
        let bar = counted("frames", "frames", self.frames.into(), self.task.arguments.json);
        let mut exposure = self.task.arguments.exposure;
        let mut pictures = vec![Vec::new(); acts.len()];
        for frame in 0..self.frames {
            let rig = self.rig(frame as f32 / (self.frames - 1) as f32);
            let direct = self.world.direct_light(&rig);
            for (act, pictures) in acts.iter_mut().zip(&mut pictures) {
                self.shine(&mut act.backend, &rig, &direct)?;
                act.backend.step()?;
                if frame.is_multiple_of(every) {
                    pictures.push(self.picture(act, &rig, &direct, &mut exposure)?);
                }
            }
            bar.inc(1);
        }
        bar.finish();
        Ok(pictures)
    }

    fn picture(
        &self,
        act: &mut Act,
        rig: &LightRig,
        direct: &DirectLight,
        exposure: &mut Option<f32>,
    ) -> anyhow::Result<RgbImage> {
        let mut irradiance = vec![Rgb::ZERO; self.slots.len()];
        act.backend.read_irradiance(&self.slots, &mut irradiance)?;
        irradiance.iter_mut().for_each(|light| *light = light.max(Rgb::ZERO));
        let light = WholeLight {
            irradiance,
            sky_irradiance: self.world.sky_irradiance(rig),
            direct_exitance: direct.exitance.clone(),
            near: direct.on_points.clone(),
            sky: rig.sky,
        };
        let volumes = self.world.volumes(&light)?;
        let lookup = |position, normal| volume_light::at(&volumes, position, normal);
        let samples = self.task.arguments.samples.min(SAMPLES);
        let options = PictureOptions { samples, ..self.task.options };
        let layers = render(self.task.tracer, rig, &options, LightSource::Lookup(&lookup))?;
        let exposure = *exposure.get_or_insert_with(|| image_file::key_exposure(&layers.full));
        Ok(image_file::exposed(&layers.full, exposure))
    }

    /// Writes the pictures side by side.
    fn write(&self, acts: &[Act], pictures: Vec<Vec<RgbImage>>) -> anyhow::Result<()> {
        let count = pictures.iter().map(Vec::len).min().unwrap_or(0);
        let named = acts.iter().zip(pictures);
        let reels: Vec<Reel<'_>> =
            named.map(|(act, pictures)| Reel { name: act.method.name(), pictures }).collect();
        let [gif, strip] = side_by_side::write(&self.task.arguments.out, &reels)?;
        if self.task.arguments.json {
            let solvers: Vec<&str> = acts.iter().map(|act| act.method.name()).collect();
            out!(
                "{}",
                serde_json::json!({ "solvers": solvers, "frames": self.frames, "pictures": count, "files": [gif, strip] })
            );
        } else {
            out!("{}, {}: {} frames of light, {count} pictures", gif.display(), strip.display(), self.frames);
        }
        Ok(())
    }
}

/// A lamp on its way round the middle of `bounds`.
fn lamp(bounds: &Bounds, share: f32) -> Light {
    let size = bounds.max - bounds.min;
    let radius = (size.x.min(size.z) * 0.25).max(1e-3);
    let (sin, cos) = (std::f32::consts::TAU * share).sin_cos();
    let position = bounds.centre() + Vec3::new(cos * radius, size.y * 0.1, sin * radius);
    Light::Point { position, intensity: Rgb::splat(LAMP_ILLUMINANCE * radius * radius), range_m: None }
}
