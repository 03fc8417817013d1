//! One measurement a value of one parameter: error against patches, bytes and time, as CSV and as charts.

use super::{AccuracyArguments, Figures, against, compared, measured};
use crate::bench::Report;
use crate::output::out;
use crate::quality::QualityArguments;
use crate::scene_source::SceneSource;
use anyhow::Context as _;
use earthshine_bake::BakeError;
use earthshine_render::chart::{self, Axis, Chart, Scale, Series};
use earthshine_render::csv::ReferencePoint;
use earthshine_tiles::BakeParameters;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Most values of a sweep.
const VALUES_MAX: usize = 64;

/// What is varied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Varied {
    /// Edge of a voxel, m.
    Voxel,
    /// Rays a patch.
    Rays,
    /// Points a voxel face.
    Samples,
}

/// As on the command line: `voxel=1,0.7,0.5`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sweep {
    varied: Varied,
    values: Vec<f32>,
}

impl std::str::FromStr for Sweep {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = "it must be voxel=, rays= or samples= with numbers between commas";
        let (name, list) = text.split_once('=').ok_or_else(|| form.to_owned())?;
        let varied = match name {
            "voxel" => Varied::Voxel,
            "rays" => Varied::Rays,
            "samples" => Varied::Samples,
            _ => return Err(form.to_owned()),
        };
        let values =
            list.split(',').map(|number| varied.value(number.trim())).collect::<Result<Vec<_>, _>>()?;
        if values.len() > VALUES_MAX {
            return Err(format!("{} values; at most {VALUES_MAX}", values.len()));
        }
        Ok(Self { varied, values })
    }
}

impl Sweep {
    /// The parameters of each value. Refuses values that cannot be baked: before the first is.
    ///
    /// # Errors
    /// The first that cannot be.
    pub(super) fn check(
        &self,
        quality: &QualityArguments,
        source: &SceneSource,
    ) -> Result<Vec<BakeParameters>, BakeError> {
        self.values.iter().map(|&value| self.varied.applied(quality, value).checked(source)).collect()
    }
}

impl Varied {
    fn value(self, text: &str) -> Result<f32, String> {
        let cause = match (self, text.parse::<f32>()) {
            (_, Err(_)) => "is not a number",
            (_, Ok(value)) if !(value.is_finite() && value > 0.0) => "is not above zero",
            (Self::Rays | Self::Samples, Ok(value)) if value.fract() != 0.0 => "is not a whole number",
            (_, Ok(value)) => return Ok(value),
        };
        Err(format!("`{text}` {cause}"))
    }

    fn label(self) -> &'static str {
        match self {
            Self::Voxel => "voxel edge, m",
            Self::Rays => "rays a patch",
            Self::Samples => "points a voxel face",
        }
    }

    fn applied(self, quality: &QualityArguments, value: f32) -> QualityArguments {
        match self {
            Self::Voxel => quality.clone().with_voxel(value),
            Self::Rays => quality.clone().with_rays(value as u32),
            Self::Samples => quality.clone().with_samples_per_face(value as u32),
        }
    }
}

#[derive(Serialize)]
struct SweepFigures {
    varied: Varied,
    sweep: Vec<Figures>,
    files: [PathBuf; 3],
}

/// Measures worlds of `parameters`, which [`Sweep::check`] made of `sweep`; writes and prints.
pub(super) fn run(
    sweep: &Sweep,
    parameters: &[BakeParameters],
    arguments: &AccuracyArguments,
    source: &SceneSource,
    reference: &[ReferencePoint],
    json: bool,
    started: Instant,
) -> anyhow::Result<()> {
    let mut steps = Vec::with_capacity(parameters.len());
    for &parameters in parameters {
        let measured = measured::baked_for(&arguments.solving, source, parameters, json)?;
        let (_, figures) = compared(&measured, reference, 0.0)?;
        steps.push(figures);
    }
    let [csv, ..] = files(&arguments.sweep_out);
    std::fs::write(&csv, to_csv(&steps)).with_context(|| csv.display().to_string())?;
    let charts = charts(sweep, &steps, &source.name);
    let [svg, png] = chart::write_both(&arguments.sweep_out, &charts)?;
    if json {
        let figures = SweepFigures { varied: sweep.varied, sweep: steps, files: [csv, svg, png] };
        let seconds = started.elapsed().as_secs_f64();
        let (solver, seed) = (arguments.solving.name(), arguments.quality.seed);
        return Report::new("accuracy", &source.name, solver, seed, seconds, figures)
            .on(arguments.solving.backend.name())
            .print(json);
    }
    print(sweep, &steps, source, arguments);
    out!("\n{}, {}, {}", csv.display(), svg.display(), png.display());
    Ok(())
}

/// What a sweep to `stem` writes.
pub(super) fn files(stem: &Path) -> [PathBuf; 3] {
    [".csv", ".svg", ".png"].map(|ending| {
        let mut name = stem.as_os_str().to_owned();
        name.push(ending);
        PathBuf::from(name)
    })
}

fn print(sweep: &Sweep, steps: &[Figures], source: &SceneSource, arguments: &AccuracyArguments) {
    out!("{} against {}; errors are relative to the reference", source.name, against(arguments));
    if let Some(first) = steps.first() {
        let errors = first.errors;
        let noise = errors.reference_noise_rel * 100.0;
        out!("{} points; the reference's own noise is {noise:.2} %\n", errors.points + errors.uncovered);
    }
    out!(
        "{:>20} {:>9} {:>11} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}",
        sweep.varied.label(),
        "patches",
        "bytes",
        "bake, s",
        "median",
        "p90",
        "RMSE",
        "bias",
        "no light"
    );
    let percent = |share: f64| format!("{:.2} %", share * 100.0);
    for (step, value) in steps.iter().zip(&sweep.values) {
        out!(
            "{value:>20} {:>9} {:>11} {:>9.2} {:>9} {:>9} {:>9} {:>9} {:>9}",
            step.patches,
            step.world_bytes,
            step.bake_seconds.unwrap_or(0.0),
            percent(step.errors.median_rel),
            percent(step.errors.p90_rel),
            percent(step.errors.rel_rmse),
            percent(step.errors.bias),
            step.errors.uncovered
        );
    }
}

fn to_csv(steps: &[Figures]) -> String {
    let mut text = "voxel_edge_m,rays_per_patch,samples_per_voxel_face,patches,world_bytes,bake_seconds,solve_seconds,\
                    points,uncovered,median_rel,p90_rel,p99_rel,rel_rmse,bias,reference_noise_rel,beyond_factor_two\n"
        .to_owned();
    for step in steps {
        let e = &step.errors;
        text += &format!(
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n",
            step.voxel_edge_m,
            step.rays_per_patch,
            step.samples_per_voxel_face,
            step.patches,
            step.world_bytes,
            step.bake_seconds.unwrap_or(0.0),
            step.solve_seconds,
            e.points,
            e.uncovered,
            e.median_rel,
            e.p90_rel,
            e.p99_rel,
            e.rel_rmse,
            e.bias,
            e.reference_noise_rel,
            e.beyond_factor_two
        );
    }
    text
}

/// Error against what is varied, patches, bytes and seconds; what does not change gets no chart.
fn charts(sweep: &Sweep, steps: &[Figures], scene: &str) -> Vec<Chart> {
    type Ordinate = (&'static str, fn(&Figures) -> f64);
    type Abscissa<'s> = (&'static str, Box<dyn Fn(usize) -> f64 + 's>);
    let axes: [Abscissa<'_>; 4] = [
        (sweep.varied.label(), Box::new(|index| f64::from(sweep.values[index]))),
        ("patches", Box::new(|index| steps[index].patches as f64)),
        ("bytes of the world", Box::new(|index| steps[index].world_bytes as f64)),
        ("bake, seconds", Box::new(|index| steps[index].bake_seconds.unwrap_or(0.0))),
    ];
    let errors: [Ordinate; 4] = [
        ("median", |step| step.errors.median_rel),
        ("p90", |step| step.errors.p90_rel),
        ("RMSE", |step| step.errors.rel_rmse),
        ("reference noise", |step| step.errors.reference_noise_rel),
    ];
    axes.iter()
        .filter(|(_, x)| (1..steps.len()).any(|index| x(index) != x(0)) || steps.len() == 1)
        .map(|(label, x)| Chart {
            title: format!("{scene}: error of light"),
            x: Axis { label: (*label).to_owned(), scale: Scale::Logarithmic },
            y: Axis { label: "error, % of reference".to_owned(), scale: Scale::Logarithmic },
            series: errors
                .iter()
                .map(|(name, error)| Series {
                    name: (*name).to_owned(),
                    points: steps.iter().enumerate().map(|(i, step)| (x(i), error(step) * 100.0)).collect(),
                })
                .collect(),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sweeps_are_read_and_nonsense_is_named() {
        let sweep: Sweep = "voxel=1, 0.7,0.5".parse().unwrap();
        assert_eq!(sweep, Sweep { varied: Varied::Voxel, values: vec![1.0, 0.7, 0.5] });
        let fault = |text: &str| text.parse::<Sweep>().unwrap_err();
        assert!(fault("voxel").contains("voxel=, rays= or samples="));
        assert!(fault("edges=1").contains("voxel=, rays= or samples="));
        assert_eq!(fault("rays=64,many"), "`many` is not a number");
        assert_eq!(fault("rays=64,1.5"), "`1.5` is not a whole number");
        assert_eq!(fault("voxel=1,0"), "`0` is not above zero");
        assert_eq!(fault("voxel="), "`` is not a number");
    }
}
