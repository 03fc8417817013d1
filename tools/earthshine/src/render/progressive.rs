//! `--method progressive`: light spreads shot by shot; frames, a plot of the power shot, the error that is left.

use super::{Task, described_linear};
use crate::output::out;
use crate::progress_bars::counted;
use crate::view::{Comparison, write_layers};
use anyhow::Context as _;
use clap::{Args, ValueEnum};
use earthshine_render::chart::{self, Axis, Chart, Scale, Series};
use earthshine_render::image_file;
use earthshine_render::metrics::linear_errors;
use earthshine_render::picture::{Layers, LightSource, PictureOptions, render};
use earthshine_render::progressive::display::Shading;
use earthshine_render::progressive::{Power, Progressive, ProgressiveOptions, Visibility};
use earthshine_world::Rgb;
use std::fmt::Write as _;
use std::time::Instant;

/// Texels along an id buffer's edge unless told.
const ID_TEXELS: u32 = 256;
/// Shots end here unless told.
const SHOTS_MAX: u64 = 1_000_000;
/// Places within a pixel of a frame.
const FRAME_SAMPLES: u32 = 4;
/// Most dots of the curve.
const DOTS_MAX: usize = 60;
/// Steps of the progress bar: hundredths of a percent.
const BAR_STEPS: f64 = 1e4;

/// Options of the method.
#[derive(Args)]
#[command(next_help_heading = "With --method progressive")]
pub(super) struct ProgressiveArguments {
    /// How a shooter finds what it sees; rays if not given.
    #[arg(long, value_enum)]
    visibility: Option<VisibilityKind>,
    /// Texels along the id buffer's edge; 256 if not given.
    #[arg(long)]
    id_texels: Option<u32>,
    /// Largest patch, m2. Default: a thousandth of all sides of all triangles.
    #[arg(long)]
    patch_area: Option<f32>,
    /// Most elements, patches and what they split into; 20000 if not given.
    #[arg(long)]
    elements: Option<usize>,
    /// How often a patch may split where light changes across it; 2 if not given, 0 for never.
    #[arg(long)]
    splits: Option<u32>,
    /// Splits where a shot's light changes by more than this share of its mean; 0.5 if not given.
    #[arg(long)]
    gradient: Option<f32>,
    /// Percent of the power to shoot; 99 if not given.
    #[arg(long)]
    until: Option<f64>,
    /// Most shots.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    shots: Option<u64>,
    /// Frames show the light that is still to be shot as an even ambient.
    #[arg(long)]
    ambient: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum VisibilityKind {
    /// A ray for each pair of places.
    Rays,
    /// A hemispherical picture of ids.
    IdBuffer,
}

impl ProgressiveArguments {
    /// Whether any was given.
    pub(super) fn is_given(&self) -> bool {
        self.visibility.is_some()
            || self.id_texels.is_some()
            || self.patch_area.is_some()
            || self.elements.is_some()
            || self.splits.is_some()
            || self.gradient.is_some()
            || self.until.is_some()
            || self.shots.is_some()
            || self.ambient
    }

    /// Whether the id buffer has a size but no use.
    pub(super) fn has_useless_texels(&self) -> bool {
        self.id_texels.is_some() && self.visibility != Some(VisibilityKind::IdBuffer)
    }

    fn options(&self, seed: u64) -> ProgressiveOptions {
        let defaults = ProgressiveOptions::default();
        let edge_texels = self.id_texels.unwrap_or(ID_TEXELS);
        ProgressiveOptions {
            patch_area_max_m2: self.patch_area,
            elements_max: self.elements.unwrap_or(defaults.elements_max),
            splits_max: self.splits.unwrap_or(defaults.splits_max),
            gradient_max: self.gradient.unwrap_or(defaults.gradient_max),
            visibility: match self.visibility {
                Some(VisibilityKind::IdBuffer) => Visibility::IdBuffer { edge_texels },
                Some(VisibilityKind::Rays) | None => Visibility::Rays,
            },
            seed,
        }
    }

    fn until_share(&self) -> anyhow::Result<f64> {
        let percent = self.until.unwrap_or(99.0);
        let message = "--until is a percentage: above 0 and at most 100";
        anyhow::ensure!(percent > 0.0 && percent <= 100.0, crate::exit_code::WrongUse(message));
        Ok(percent / 100.0)
    }
}

/// A line of the log.
struct Step {
    shots: u64,
    seconds: f64,
    power: Power,
    elements: usize,
}

/// Solves, draws, compares.
pub(super) fn refine(task: &Task<'_>) -> anyhow::Result<()> {
    let arguments = task.arguments;
    let given = &arguments.progressive;
    let until = given.until_share()?;
    let options = given.options(arguments.seed);
    let started = Instant::now();
    let mut solver = Progressive::new(task.tracer, &task.source.lights, &options)?;
    std::fs::create_dir_all(&arguments.out).with_context(|| arguments.out.display().to_string())?;
    let reference = task.reference()?;
    let exposure = arguments.exposure.unwrap_or_else(|| image_file::key_exposure(&reference.full));
    let bar = counted("shooting", "x 0.01 %", (until * BAR_STEPS) as u64, arguments.json);
    let mut steps = Vec::new();
    let (mut frames, mut drawing) = (0, 0.0);
    let shots_max = given.shots.unwrap_or(SHOTS_MAX);
    let setting_up = started.elapsed().as_secs_f64();
    let started = Instant::now();
    loop {
        let is_done = solver.power().shot_share() >= until || solver.shots() >= shots_max;
        let shot = if is_done { None } else { solver.shoot() };
        let seconds = started.elapsed().as_secs_f64() - drawing;
        let (shots, elements) = (solver.shots(), solver.elements().leaves.len());
        steps.push(Step { shots, seconds, power: *solver.power(), elements });
        bar.set_position((solver.power().shot_share() * BAR_STEPS).max(0.0) as u64);
        if shot.is_none() || shots.is_power_of_two() {
            frames += 1;
            let before = Instant::now();
            write_frame(task, &solver, frames, exposure)?;
            drawing += before.elapsed().as_secs_f64();
        }
        if shot.is_none() {
            break;
        }
    }
    bar.finish();
    write_steps(task, &steps)?;
    let service = lit(task, &solver, Rgb::ZERO, |source| task.lookup_layers("picture", source))?;
    let comparison = Comparison { service, reference, exposure };
    report(task, &comparison, &steps, frames, setting_up)
}

/// Draws by the light that was shot so far and `ambient`.
fn lit(
    task: &Task<'_>,
    solver: &Progressive<'_>,
    ambient: Rgb,
    draw: impl Fn(LightSource<'_>) -> anyhow::Result<Layers>,
) -> anyhow::Result<Layers> {
    let shading = Shading::of(solver, task.tracer, ambient);
    draw(LightSource::Lookup(&|position, normal| shading.at(position, normal)))
}

fn write_frame(task: &Task<'_>, solver: &Progressive<'_>, number: u32, exposure: f32) -> anyhow::Result<()> {
    let ambient = if task.arguments.progressive.ambient { solver.ambient_irradiance() } else { Rgb::ZERO };
    let options = PictureOptions { samples: FRAME_SAMPLES, ..task.options };
    let frame =
        lit(task, solver, ambient, |source| Ok(render(task.tracer, &task.source.lights, &options, source)?))?;
    let path = task.arguments.out.join(format!("frame_{number:04}.png"));
    image_file::write_png(&path, &image_file::exposed(&frame.full, exposure))?;
    Ok(())
}

/// `progress.csv`, and its curve as `progress.svg` and `progress.png`.
fn write_steps(task: &Task<'_>, steps: &[Step]) -> anyhow::Result<()> {
    let folder = &task.arguments.out;
    let mut text =
        "shots,seconds,shot_percent,given_lm,unshot_lm,absorbed_lm,escaped_lm,elements\n".to_owned();
    for Step { shots, seconds, power, elements } in steps {
        let [given, unshot, absorbed, escaped] =
            [power.given, power.unshot, power.absorbed, power.escaped].map(|power| power.element_sum());
        let percent = power.shot_share() * 100.0;
        writeln!(text, "{shots},{seconds},{percent},{given},{unshot},{absorbed},{escaped},{elements}")?;
    }
    let path = folder.join("progress.csv");
    std::fs::write(&path, text).with_context(|| path.display().to_string())?;
    let dot_every = steps.len().div_ceil(DOTS_MAX).max(1);
    let dots = steps.iter().step_by(dot_every).chain(steps.last());
    let points = dots.map(|step| (step.seconds, step.power.shot_share() * 100.0)).collect();
    let axis = |label: &str| Axis { label: label.to_owned(), scale: Scale::Linear };
    let shot = Chart {
        title: format!("Power shot: {}", task.source.name),
        x: axis("seconds"),
        y: axis("% of the given power"),
        series: vec![Series { name: "power shot".to_owned(), points }],
    };
    chart::write_both(&folder.join("progress"), &[shot])?;
    Ok(())
}

fn report(
    task: &Task<'_>,
    comparison: &Comparison,
    steps: &[Step],
    frames: u32,
    setting_up: f64,
) -> anyhow::Result<()> {
    let (arguments, exposure) = (task.arguments, comparison.exposure);
    write_layers(&arguments.out, "progressive_", &comparison.service, exposure, arguments.exr)?;
    write_layers(&arguments.out, "reference_", &comparison.reference, exposure, arguments.exr)?;
    comparison.write_sheet(&arguments.out.join("sheet.png"))?;
    let errors = comparison.indirect_errors()?;
    let linear = linear_errors(&comparison.service.indirect, &comparison.reference.indirect)?;
    let last = steps.last().context("the log has a last line")?;
    let power = &last.power;
    let [given, unshot, absorbed, escaped] =
        [power.given, power.unshot, power.absorbed, power.escaped].map(|power| power.element_sum());
    if arguments.json {
        let figures = serde_json::json!({
            "method": "progressive", "exposure": exposure, "shots": last.shots, "seconds": last.seconds,
            "set_up_seconds": setting_up, "elements": last.elements, "frames": frames,
            "shot_share": power.shot_share(),
            "power_lm": { "given": given, "unshot": unshot, "absorbed": absorbed, "escaped": escaped },
            "form_factor_excess_max": power.excess_share_max,
            "indirect": { "picture": errors, "linear": linear },
        });
        out!("{figures}");
        return Ok(());
    }
    out!(
        "{}: frame_0001.png to frame_{frames:04}.png, progress.{{csv,svg,png}}, progressive_*, reference_*, sheet.png",
        arguments.out.display()
    );
    let percent = power.shot_share() * 100.0;
    out!(
        "{} shots, {:.2} s: {percent:.2} % of the power shot; {} elements",
        last.shots,
        last.seconds,
        last.elements
    );
    out!(
        "of {given:.4} lm {unshot:.4} unshot, {absorbed:.4} absorbed, {escaped:.4} escaped (channels added)"
    );
    out!("indirect light, sRGB at exposure {exposure:e}: {}", crate::compare::described(&errors));
    out!("light at the picture's pixels: {}", described_linear(&linear));
    Ok(())
}
