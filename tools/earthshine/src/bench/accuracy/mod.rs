//! `bench accuracy`: bake, solve, look up light at points, compare with a path tracer or with other renderers.

mod beyond;
mod furnace;
pub(super) mod measured;
mod points;
mod seeds;
mod solving;
mod sweep;
mod text;

use super::Report;
use crate::causes::{self, ExplainOptions, Explainer};
use crate::numbers;
use crate::progress_bars::counted;
use crate::quality::QualityArguments;
use crate::same_scene;
use crate::scene_source::{self, SceneSource};
use crate::volume_light;
use crate::writable;
use beyond::BeyondPoint;
use clap::Args;
use earthshine_gen::GenOptions;
use earthshine_render::SceneTracer;
use earthshine_render::compare_points::{LightErrors, compare_points};
use earthshine_render::csv::{self, ReferencePoint};
use earthshine_tiles::{BakeParameters, Manifest};
use measured::Measured;
use serde::Serialize;
use solving::SolvingArguments;
use std::path::PathBuf;
use std::time::Instant;
use sweep::Sweep;

/// Arguments of `bench accuracy`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine bench accuracy --scene cornell --report causes.csv
  earthshine bench accuracy --scene sponza.glb --lights sponza.lights.json --reference sponza.mitsuba.csv --voxel 1
  earthshine bench accuracy --scene sponza.glb --world sponza.world --reference sponza.mitsuba.csv --report causes.json
  earthshine bench accuracy --scene office.glb --reference office.mitsuba.csv --worst
  earthshine bench accuracy --scene cornell --seeds 8
  earthshine bench accuracy --scene cornell --solver matrix --backend gpu
  earthshine bench accuracy --scene cornell --sweep voxel=0.28,0.2,0.14,0.1 --sweep-out cornell-voxels
  earthshine bench accuracy --scene two-rooms --write-reference two-rooms.csv")]
pub(crate) struct AccuracyArguments {
    /// furnace, another generated world, or a .glb file.
    #[arg(long)]
    scene: String,
    /// Lights JSON.
    #[arg(long)]
    lights: Option<PathBuf>,
    /// World baked from the scene: measures it instead of baking one.
    #[arg(long, conflicts_with_all = ["sweep", "voxel", "rays", "samples_per_face", "chunk_voxels"])]
    world: Option<PathBuf>,
    /// CSV of points (x,y,z,nx,ny,nz; light in it is ignored) where light is compared. With --reference, which must hold
    /// them all: only these. Default: all of --reference, or random ones.
    #[arg(long)]
    points: Option<PathBuf>,
    /// CSV of reference light; without it our own path tracer makes one.
    #[arg(long)]
    reference: Option<PathBuf>,
    /// Random points, where no file names any.
    #[arg(long, default_value_t = 600, value_parser = point_count)]
    point_count: usize,
    /// Noise at which our own reference stops, as a share of the light.
    /// [default: 0.01]
    #[arg(long, value_parser = numbers::noise)]
    noise: Option<f32>,
    /// Writes the light of our own path tracer at the points as reference CSV.
    #[arg(long, conflicts_with = "reference")]
    write_reference: Option<PathBuf>,
    /// Writes the light at each point beside its reference as CSV.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Ranks points and voxels by error and names the cause of each: .json, or .csv (points; voxels go to `NAME_voxels.csv`).
    #[arg(long, conflicts_with = "sweep")]
    report: Option<PathBuf>,
    /// Lists the points that are off by more than a factor of two, with the cause of each (`beyond_points` in JSON).
    #[arg(long, conflicts_with = "sweep")]
    worst: bool,
    /// Measures once for each value: voxel=1,0.7,0.5 (m), rays=256,1024 (a patch) or samples=4,16 (a voxel face).
    #[arg(long)]
    sweep: Option<Sweep>,
    /// Where a sweep goes: PATH.csv, PATH.svg, PATH.png.
    #[arg(long, default_value = "sweep", requires = "sweep")]
    sweep_out: PathBuf,
    /// Measures with so many seeds, from --seed on: mean and spread of each figure.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=i64::from(seeds::SEEDS_MAX)),
          conflicts_with_all = ["sweep", "report", "worst", "out", "world"])]
    seeds: u32,
    #[command(flatten)]
    solving: SolvingArguments,
    #[command(flatten)]
    quality: QualityArguments,
}

impl AccuracyArguments {
    fn noise(&self) -> f32 {
        self.noise.unwrap_or(0.01)
    }

    /// What is, or will be, baked: worlds of this scene, of parameters that can be.
    fn baking(&self, source: &SceneSource) -> anyhow::Result<Baking<'_>> {
        if let Some(folder) = &self.world {
            let manifest = Manifest::load(folder)?;
            same_scene::ensure_same(source, self.quality.metals_black(), folder, &manifest)?;
            return Ok(Baking::One(manifest.parameters));
        }
        // A sweep has no use for what it departs from, and counting patches for that takes as long as for a value.
        Ok(match &self.sweep {
            Some(sweep) => Baking::Sweep(sweep, sweep.check(&self.quality, source)?),
            None => Baking::One(self.quality.checked(source)?),
        })
    }

    /// Files that will be written.
    fn results(&self) -> Vec<PathBuf> {
        let mut all: Vec<PathBuf> =
            [&self.write_reference, &self.out, &self.report].into_iter().flatten().cloned().collect();
        if self.sweep.is_some() {
            all.extend(sweep::files(&self.sweep_out));
        }
        all
    }
}

/// The parameters of a world, or of one for each value of a sweep.
enum Baking<'a> {
    One(BakeParameters),
    Sweep(&'a Sweep, Vec<BakeParameters>),
}

/// Most random points.
const POINTS_MAX: usize = 1_000_000;

/// How many points, as on the command line; without any, who has no file of points has nothing to compare.
pub(super) fn point_count(text: &str) -> Result<usize, String> {
    match text.trim().parse::<usize>() {
        Ok(0) => Err("--point-count 0 leaves nothing to compare: ask for 1 or more".to_owned()),
        Ok(count) if count <= POINTS_MAX => Ok(count),
        Ok(_) => Err(format!("at most {POINTS_MAX} points are measured")),
        Err(error) => Err(error.to_string()),
    }
}

#[derive(Serialize)]
pub(super) struct Figures {
    patches: u64,
    #[serde(flatten)]
    errors: LightErrors,
    /// Mean light of the reference, lx.
    mean_reference: f64,
    voxel_edge_m: f32,
    rays_per_patch: u32,
    samples_per_voxel_face: u32,
    points_per_patch: u32,
    detail: u32,
    /// Absent where a world was given.
    bake_seconds: Option<f64>,
    solve_seconds: f64,
    reference_seconds: f64,
    world_bytes: u64,
    absorbed_share_mean: f64,
    /// With `--worst`.
    #[serde(skip_serializing_if = "Option::is_none")]
    beyond_points: Option<Vec<BeyondPoint>>,
}

/// Runs the suite.
pub(crate) fn run(arguments: &AccuracyArguments, json: bool) -> anyhow::Result<()> {
    arguments.solving.check()?;
    writable::ensure_files(&arguments.results())?;
    if arguments.scene == "furnace" {
        return furnace::run(arguments, json);
    }
    if let Some(path) = &arguments.report {
        causes::check_path(path)?;
    }
    let started = Instant::now();
    let metals_black = arguments.quality.metals_black();
    let source = scene_source::load_generated(
        &arguments.scene,
        arguments.lights.as_deref(),
        metals_black,
        &GenOptions::default(),
    )?;
    scene_source::warn_if_dark(&source);
    // What makes all other work vain is found out first.
    let baking = arguments.baking(&source)?;
    let referencing = Instant::now();
    let reference = points::reference(arguments, &source, json)?;
    let reference_seconds = referencing.elapsed().as_secs_f64();
    if let Some(path) = &arguments.write_reference {
        csv::write(path, &reference)?;
    }
    let parameters = match baking {
        Baking::One(parameters) => parameters,
        Baking::Sweep(sweep, steps) => {
            return sweep::run(sweep, &steps, arguments, &source, &reference, json, started);
        }
    };
    if arguments.seeds > 1 {
        return seeds::run(arguments.seeds, arguments, &source, &reference, json, started);
    }
    let measured = match &arguments.world {
        Some(folder) => measured::loaded(&arguments.solving, &source, folder)?,
        None => measured::baked_for(&arguments.solving, &source, parameters, json)?,
    };
    let (light, mut figures) = compared(&measured, &reference, reference_seconds)?;
    if let Some(path) = &arguments.out {
        volume_light::write_csv(path, &reference, &light)?;
    }
    let explained = match &arguments.report {
        Some(_) => explained(&measured, &source, &reference, json)?,
        None => Vec::new(),
    };
    let ranking = causes::rank(&explained);
    if let Some(path) = &arguments.report {
        let uncovered: Vec<usize> = (0..light.len()).filter(|&index| light[index].is_none()).collect();
        causes::write(path, &ranking, &uncovered)?;
    }
    if arguments.worst {
        figures.beyond_points = Some(beyond::list(&measured, &source, &reference, &light, json)?);
    }
    let seconds = started.elapsed().as_secs_f64();
    let (solving, seed) = (&arguments.solving, arguments.quality.seed);
    let report = Report::new("accuracy", &source.name, solving.name(), seed, seconds, figures)
        .on(solving.backend.name());
    if json {
        return report.print(json);
    }
    text::print(&report, &against(arguments));
    if let Some(points) = &report.figures.beyond_points {
        beyond::print(points);
    }
    if arguments.report.is_some() {
        causes::print_table(&ranking);
    }
    Ok(())
}

/// What the light was compared with, in words.
fn against(arguments: &AccuracyArguments) -> String {
    arguments.reference.as_ref().map_or_else(
        || format!("our path tracer, to {} % noise a point", arguments.noise() * 100.0),
        |path| path.display().to_string(),
    )
}

/// Light of a measured world at the reference's points, and how far off it is.
fn compared(
    measured: &Measured,
    reference: &[ReferencePoint],
    reference_seconds: f64,
) -> anyhow::Result<(Vec<Option<earthshine_world::Rgb>>, Figures)> {
    let light: Vec<_> = reference
        .iter()
        .map(|point| volume_light::at(&measured.volumes, point.position, point.normal))
        .collect();
    let errors = compare_points(reference, &light)?;
    let covered = || reference.iter().zip(&light).filter(|(_, light)| light.is_some());
    let sum: f64 = covered().map(|(point, _)| point.irradiance.as_dvec3().element_sum() / 3.0).sum();
    let parameters = measured.world.manifest.parameters;
    let figures = Figures {
        patches: measured.patches,
        errors,
        mean_reference: sum / covered().count().max(1) as f64,
        voxel_edge_m: parameters.grid.voxel_edge_m,
        rays_per_patch: parameters.rays_per_patch,
        samples_per_voxel_face: parameters.samples_per_voxel_face,
        points_per_patch: parameters.points_per_patch,
        detail: parameters.detail,
        bake_seconds: measured.bake_seconds,
        solve_seconds: measured.solve_seconds,
        reference_seconds,
        world_bytes: measured.world_bytes,
        absorbed_share_mean: measured.absorbed_share_mean,
        beyond_points: None,
    };
    Ok((light, figures))
}

/// Every covered point's error with its causes.
fn explained(
    measured: &Measured,
    source: &SceneSource,
    reference: &[ReferencePoint],
    quiet: bool,
) -> anyhow::Result<Vec<causes::Explained>> {
    let tracer = SceneTracer::new(&source.scene);
    let options = ExplainOptions::default();
    let Measured { world, light, volumes, .. } = measured;
    let explainer = Explainer::new(world, light, volumes, &tracer, &source.lights, options);
    let bar = counted("causes", "points", reference.len() as u64, quiet);
    let explained = explainer.explain(reference, &|| bar.inc(1))?;
    bar.finish_and_clear();
    Ok(explained)
}
