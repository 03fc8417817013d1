//! `bench far`: light of a few resident patches, with what is beyond them left out, given to the sky, or fed by
//! coarse levels; against the whole world solved at once.
//!
//! The nearest patches around a camera are resident; the light of the nearer half of them is compared, relative RMSE.

use super::{Report, scratch};
use crate::output::out;
use crate::quality::QualityArguments;
use crate::scene_source::{self, SceneSource};
use crate::view::vector;
use crate::whole_world::{LIMITS, WholeLight, WholeWorld};
use anyhow::Context as _;
use clap::Args;
use earthshine_bake::Levels;
use earthshine_gen::GenOptions;
use earthshine_radiosity::far_light::{ResidentSet, mean_over_children};
use earthshine_radiosity::gather::Sources;
use earthshine_world::lineage::CoarsePlaces;
use earthshine_world::{LightRig, Patch, Rgb, Vec3};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Arguments of `bench far`.
#[derive(Args)]
pub(crate) struct FarArguments {
    /// A generated world or a .glb file.
    #[arg(long)]
    scene: String,
    /// Lights JSON.
    #[arg(long)]
    lights: Option<PathBuf>,
    /// Where the camera is, m: x,y,z. Default: the middle of the scene.
    #[arg(long, allow_hyphen_values = true, value_parser = vector)]
    camera: Option<Vec3>,
    #[command(flatten)]
    quality: QualityArguments,
}

/// Shares of the world that are resident.
const RESIDENT: [f64; 3] = [1.0 / 8.0, 1.0 / 4.0, 1.0 / 2.0];

#[derive(Serialize)]
struct Figures {
    /// Of each level, finest first.
    patches: Vec<usize>,
    camera: [f32; 3],
    cases: Vec<Case>,
}

/// Errors are relative RMSE of irradiance.
#[derive(Serialize)]
struct Case {
    resident_share: f64,
    resident_patches: usize,
    /// Mean over the patches whose light is compared.
    far_share_mean: f64,
    gap_dropped_rel: f64,
    gap_to_sky_rel: f64,
    /// Fed by one level that is wholly resident, lit as the mean of its children; from level 1.
    fed_by_level_rel: Vec<f64>,
    /// Fed as the service does it: every level holds its nearest patches, as many as level 0, and is fed by the next;
    /// coarse patches are lit at their own points with their own shadows.
    fed_by_levels_rel: f64,
    /// The same with coarse patches lit as the mean of their children: what lighting them by themselves costs.
    fed_by_levels_mean_lit_rel: f64,
}

/// Runs the suite.
pub(crate) fn run(arguments: &FarArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let source = scene_source::load_generated(
        &arguments.scene,
        arguments.lights.as_deref(),
        arguments.quality.metals_black(),
        &GenOptions::default(),
    )?;
    let folder = tempfile::tempdir().context("a scratch folder for the world")?;
    let levels = baked(&source, &arguments.quality, folder.path(), json)?;
    let camera = arguments.camera.unwrap_or_else(|| source.scene.bounds().centre());
    let pyramid = Pyramid::lit(levels, &source.lights)?;
    let cases = RESIDENT.into_iter().map(|share| pyramid.case(share, camera)).collect::<Result<_, _>>()?;
    let figures = Figures {
        patches: pyramid.levels.iter().map(|level| level.areas.len()).collect(),
        camera: camera.to_array(),
        cases,
    };
    let seconds = started.elapsed().as_secs_f64();
    if !json {
        print_table(&figures);
        return Ok(());
    }
    Report::new("far", &source.name, "gather", arguments.quality.seed, seconds, figures).print(json)
}

fn baked(
    source: &SceneSource,
    quality: &QualityArguments,
    world: &Path,
    quiet: bool,
) -> anyhow::Result<Vec<WholeWorld>> {
    let summary = scratch::bake(source, quality.parameters_of_patches(source), Levels::Auto, world, quiet)?;
    summary.levels.iter().map(|level| WholeWorld::load_level(world, level.level)).collect()
}

fn print_table(figures: &Figures) {
    out!("patches of each level: {:?}; camera at {:?} m", figures.patches, figures.camera);
    out!(
        "error of the light of the nearer half of the resident patches, relative RMSE, against the whole world"
    );
    let levels: String =
        (1..figures.patches.len()).map(|level| format!("{:>10}", format!("level {level}"))).collect();
    out!("resident  far share   dropped    to sky{levels}    levels  mean-lit");
    for case in &figures.cases {
        let cell = |error: f64| format!("{:9.2}%", error * 100.0);
        let levels: String = case.fed_by_level_rel.iter().copied().map(cell).collect();
        out!(
            "{:>8} {}{}{}{levels}{}{}",
            case.resident_patches,
            cell(case.far_share_mean),
            cell(case.gap_dropped_rel),
            cell(case.gap_to_sky_rel),
            cell(case.fed_by_levels_rel),
            cell(case.fed_by_levels_mean_lit_rel)
        );
    }
}

/// A level with its light as if it were all resident.
struct LitLevel {
    world: WholeWorld,
    areas: Vec<f32>,
    reflectance: Vec<Rgb>,
    /// Lit at its own points.
    light: WholeLight,
    /// Direct exitance if lit as the mean of its children; of level 0 its own.
    mean_direct: Vec<Rgb>,
    /// Exitance of that light; of level 0 its own.
    exitance: Vec<Rgb>,
    /// Index on the next level; empty on the top.
    parents: Vec<u32>,
}

struct Pyramid {
    levels: Vec<LitLevel>,
    rig: LightRig,
}

impl Pyramid {
    fn lit(worlds: Vec<WholeWorld>, rig: &LightRig) -> anyhow::Result<Self> {
        let mut levels: Vec<LitLevel> = Vec::with_capacity(worlds.len());
        let mut mean_direct: Vec<Rgb> = Vec::new();
        for world in worlds {
            let areas: Vec<f32> = world.patches().map(|patch| patch.area).collect();
            let reflectance: Vec<Rgb> = world.patches().map(|patch| patch.reflectance).collect();
            let light = world.solve(rig);
            let exitance = match levels.last_mut() {
                None => {
                    mean_direct.clone_from(&light.direct_exitance);
                    world.exitance(&light)
                }
                Some(finer) => {
                    finer.parents = parents(&finer.world, &world)?;
                    mean_direct = mean_over_children(&mean_direct, &finer.areas, &finer.parents, areas.len());
                    world.exitance(&world.solve_exitance(mean_direct.clone(), rig))
                }
            };
            let (mean_direct, parents) = (mean_direct.clone(), Vec::new());
            levels.push(LitLevel { world, areas, reflectance, light, mean_direct, exitance, parents });
        }
        Ok(Self { levels, rig: rig.clone() })
    }

    fn case(&self, resident_share: f64, camera: Vec3) -> anyhow::Result<Case> {
        let finest = &self.levels[0];
        let count = ((finest.areas.len() as f64 * resident_share) as usize).max(2);
        let set = finest.nearest(camera, count)?;
        let sky = set.pick(&finest.light.sky_irradiance);
        let error = |far: &[Rgb]| {
            let outside: Vec<Rgb> = sky.iter().zip(far).map(|(sky, far)| *sky + *far).collect();
            finest.error(&set, &finest.residents_light(&set, &finest.mean_direct, &outside))
        };
        let far_shares = set.far_shares(&finest.world.rows);
        let to_sky: Vec<Rgb> =
            far_shares.iter().map(|&share| self.rig.sky.irradiance(&[share / 6.0; 6])).collect();
        let fed_by_level_rel = (1..self.levels.len())
            .map(|level| error(&set.far_irradiance(&finest.world.rows, &self.down_to_finest(level))))
            .collect();
        let fed_by_levels = |mean_lit| -> anyhow::Result<f64> {
            let above = self.exitance_above(1, camera, count, mean_lit)?;
            let fed: Vec<Rgb> = finest.parents.iter().map(|&parent| above[parent as usize]).collect();
            Ok(if fed.is_empty() { f64::NAN } else { error(&set.far_irradiance(&finest.world.rows, &fed)) })
        };
        let measured = measured(count);
        Ok(Case {
            resident_share,
            resident_patches: count,
            far_share_mean: far_shares[..measured].iter().map(|&share| f64::from(share)).sum::<f64>()
                / measured as f64,
            gap_dropped_rel: error(&vec![Rgb::ZERO; count]),
            gap_to_sky_rel: error(&to_sky),
            fed_by_level_rel,
            fed_by_levels_rel: fed_by_levels(false)?,
            fed_by_levels_mean_lit_rel: fed_by_levels(true)?,
        })
    }

    /// Exitance of each finest patch's ancestor on `level`.
    fn down_to_finest(&self, level: usize) -> Vec<Rgb> {
        let mut exitance = self.levels[level].exitance.clone();
        for finer in self.levels[..level].iter().rev() {
            exitance = finer.parents.iter().map(|&parent| exitance[parent as usize]).collect();
        }
        exitance
    }

    /// Exitance of every patch of `level` as a session of `capacity` slots a level knows it: its own where it is
    /// resident, else that of its nearest resident ancestor.
    fn exitance_above(
        &self,
        level: usize,
        camera: Vec3,
        capacity: usize,
        mean_lit: bool,
    ) -> anyhow::Result<Vec<Rgb>> {
        let Some(own) = self.levels.get(level) else { return Ok(Vec::new()) };
        let is_top = level + 1 == self.levels.len();
        let count = if is_top { own.areas.len() } else { capacity.min(own.areas.len()) };
        let set = own.nearest(camera, count)?;
        let mut exitance = if is_top {
            vec![Rgb::ZERO; count]
        } else {
            let above = self.exitance_above(level + 1, camera, capacity, mean_lit)?;
            own.parents.iter().map(|&parent| above[parent as usize]).collect()
        };
        let far = set.far_irradiance(&own.world.rows, &exitance);
        let sky = set.pick(&own.light.sky_irradiance);
        let outside: Vec<Rgb> = sky.iter().zip(&far).map(|(sky, far)| *sky + *far).collect();
        let direct = if mean_lit { &own.mean_direct } else { &own.light.direct_exitance };
        let irradiance = own.residents_light(&set, direct, &outside);
        for (&patch, light) in set.patches().iter().zip(irradiance) {
            let patch = patch as usize;
            exitance[patch] = direct[patch] + own.reflectance[patch] * light;
        }
        Ok(exitance)
    }
}

impl LitLevel {
    /// The `count` patches nearest to `camera`, nearest first.
    fn nearest(&self, camera: Vec3, count: usize) -> anyhow::Result<ResidentSet> {
        let mut order: Vec<(f32, u32)> = self
            .world
            .patches()
            .zip(0u32..)
            .map(|(patch, index)| (patch.centroid.distance_squared(camera), index))
            .collect();
        order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let nearest = order.into_iter().take(count).map(|(_, index)| index).collect();
        Ok(ResidentSet::new(&self.world.rows, nearest)?)
    }

    /// Light of the residents of `set`, lit by `direct` (of the whole level), with `outside` coming in.
    fn residents_light(&self, set: &ResidentSet, direct: &[Rgb], outside: &[Rgb]) -> Vec<Rgb> {
        let direct_exitance = set.pick(direct);
        let reflectance = set.pick(&self.reflectance);
        let sources = Sources {
            direct_exitance: &direct_exitance,
            reflectance: &reflectance,
            outside_irradiance: outside,
        };
        set.solve(sources, LIMITS).0
    }

    /// Relative RMSE of `light` against the whole level's, over the nearer half.
    fn error(&self, set: &ResidentSet, light: &[Rgb]) -> f64 {
        let truth = set.pick(&self.light.irradiance);
        let (mut gap, mut norm) = (0.0f64, 0.0f64);
        for (light, truth) in light.iter().zip(&truth).take(measured(truth.len())) {
            gap += f64::from((*light - *truth).length_squared());
            norm += f64::from(truth.length_squared());
        }
        (gap / norm.max(f64::MIN_POSITIVE)).sqrt()
    }
}

/// How many of `resident` patches are compared: the nearer half.
fn measured(resident: usize) -> usize {
    resident.div_ceil(2)
}

/// Index on `coarser` of the parent of every patch of `finer`.
fn parents(finer: &WholeWorld, coarser: &WholeWorld) -> anyhow::Result<Vec<u32>> {
    let places = CoarsePlaces::new(coarser.patches());
    let parent = |patch: &Patch| {
        places.parent(patch).with_context(|| format!("a patch at {} has no parent", patch.centroid))
    };
    finer.patches().map(parent).collect()
}
