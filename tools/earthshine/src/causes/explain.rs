//! One point's error, stage by stage.

use super::Cause;
use super::contributions::Contributions;
use super::gather::{PatchGather, PlaceGather};
use super::in_air::is_same;
use super::mean;
use super::reads::{Read, Unlit};
use super::scene_light::{LitPatch, SceneLight};
use crate::whole_world::{WholeLight, WholeWorld};
use anyhow::ensure;
use earthshine_bake::sample::voxel_of;
use earthshine_render::SceneTracer;
use earthshine_render::csv::ReferencePoint;
use earthshine_volume::Volume;
use earthshine_world::{Direction, Grid, LightRig, SamplePoint, Vec3, VoxelCoord};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Patches below this share of a voxel's face are small.
const SMALL_AREA_SHARE: f32 = 0.02;
/// Points whose normal is further than this cosine from the asked one face elsewhere.
const ALIKE_COSINE: f32 = 0.9;
/// Deviations up to this many standard deviations are noise.
const NOISE_DEVIATIONS: f64 = 2.0;
/// Rays of a gather at a patch, at least: rows of few rays are held against better ones.
const PATCH_RAYS_MIN: u32 = 256;
/// Points are lifted this share of a voxel, at most, to ask whether one sees another: low bumps are no walls.
const LIFT_VOXELS: f32 = 0.25;

/// How well to look.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ExplainOptions {
    /// Rays of each of four gathers at a point.
    pub point_rays: u32,
    /// Rays of each of four gathers at a patch, at most; else as many as its row had.
    pub patch_rays_max: u32,
}

impl Default for ExplainOptions {
    fn default() -> Self {
        Self { point_rays: 512, patch_rays_max: 2048 }
    }
}

/// A point with its error and what it is made of. Light is the mean of the channels, lx.
#[derive(Debug, Clone)]
pub(crate) struct Explained {
    /// Place in the list of points.
    pub index: usize,
    pub position: Vec3,
    pub normal: Vec3,
    /// The voxel it lies in.
    pub voxel: VoxelCoord,
    pub reference: f64,
    pub reference_noise: f64,
    pub served: f64,
    pub parts: Contributions,
    pub evidence: Evidence,
}

/// Below so much light, lx, what is read with a weight too small to be told may be all there is.
const SUMMED_LX_MIN: f64 = 1e-2;

/// What the causes rest on.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub(crate) struct Evidence {
    /// Patches read.
    pub reads: usize,
    /// Share of what is read that lies behind a wall.
    pub behind_wall_share: f64,
    /// Mean light there, lx.
    pub behind_wall_light: f64,
    /// Share of what is read that lies in crevices or inside of something.
    pub hidden_share: f64,
    /// Share of what is read that faces elsewhere.
    pub turned_share: f64,
    /// Smallest and largest light of what is read in plain sight, lx.
    pub plain_light_range: [f64; 2],
    /// Weight that directions give to others.
    pub fallback_share: f64,
    /// Weight of patches of tiny area.
    pub small_share: f64,
    /// Light that rays from the point bring, lx.
    pub gathered: f64,
    /// Standard deviation of the rows read, lx.
    pub row_noise: f64,
    /// Share of rays that end on surfaces without patches.
    pub no_patch_share: f64,
    /// Whether light in the air answers; what is read of surfaces is not told then.
    pub in_air: bool,
}

impl Explained {
    /// Served minus reference, lx.
    pub(crate) fn error(&self) -> f64 {
        self.served - self.reference
    }

    /// What explains most of it.
    pub(crate) fn cause(&self) -> Cause {
        self.parts.main_cause(self.error())
    }
}

/// Explains errors of one world under one light.
pub(crate) struct Explainer<'a> {
    pub(super) scene: SceneLight<'a>,
    /// As served.
    served: &'a [Volume],
    /// Of surfaces alone: a lookup in the air is no weighted mean.
    volumes: Vec<Volume>,
    pub(super) options: ExplainOptions,
}

/// Which volume, voxel and direction.
type ReadKey = (usize, [i32; 3], usize);

impl<'a> Explainer<'a> {
    /// `served` are the light that was served, made of `light`.
    pub(crate) fn new(
        world: &'a WholeWorld,
        light: &'a WholeLight,
        served: &'a [Volume],
        tracer: &'a SceneTracer<'a>,
        rig: &'a LightRig,
        options: ExplainOptions,
    ) -> Self {
        let volumes = served.iter().map(Volume::without_air).collect();
        Self { scene: SceneLight::new(world, light, tracer, rig), served, volumes, options }
    }

    /// Explains every point that has light. `finished` is called once a point, from any thread.
    ///
    /// # Errors
    /// The lookup is not the weighted mean of nearby patches that this diagnosis takes it for.
    pub(crate) fn explain(
        &self,
        points: &[ReferencePoint],
        finished: &(dyn Fn() + Sync),
    ) -> anyhow::Result<Vec<Explained>> {
        let unlit = Unlit::new(&self.volumes);
        let reads: Vec<Option<Vec<Read>>> = points
            .par_iter()
            .map_init(|| unlit.clone(), |unlit, point| unlit.reads(point.position, point.normal))
            .collect();
        let mut asked: Vec<ReadKey> = reads.iter().flatten().flatten().map(Read::key).collect();
        asked.sort_unstable();
        asked.dedup();
        let gathers: BTreeMap<ReadKey, PatchGather> =
            asked.into_par_iter().map(|key| (key, self.gather(key))).collect();
        let explained: Vec<Option<Explained>> = points
            .par_iter()
            .zip(&reads)
            .enumerate()
            .with_max_len(1)
            .map(|(index, (point, reads))| {
                let served = crate::volume_light::at(self.served, point.position, point.normal).map(mean);
                let found = served
                    .map(|served| self.point(index, point, served, reads.as_deref(), &gathers))
                    .transpose();
                finished();
                found
            })
            .collect::<anyhow::Result<_>>()?;
        Ok(explained.into_iter().flatten().collect())
    }

    fn gather(&self, (volume, voxel, direction): ReadKey) -> PatchGather {
        let parameters = &self.scene.parameters;
        let voxel = VoxelCoord::from(voxel);
        let edge = self.volumes[volume].layout().voxel_edge_m;
        let grid = Grid { voxel_edge_m: edge, ..parameters.grid };
        let is_detail = edge < parameters.grid.voxel_edge_m;
        let row_rays = if is_detail { parameters.detail_rays } else { parameters.rays_per_patch };
        let rays =
            row_rays.clamp(PATCH_RAYS_MIN.min(self.options.patch_rays_max), self.options.patch_rays_max);
        let centre = grid.voxel_centre(voxel);
        let gathered = |points: &[SamplePoint]| self.scene.gather_patch(points, rays, row_rays);
        let Some(lit) = self.patch(volume, voxel, direction) else {
            // Light without a patch is a receiver's: it stands at the centre of its voxel.
            let normal = Direction::ALL[direction].vector();
            return gathered(&[SamplePoint { position: centre, normal }]);
        };
        // Of the patch's points those in the detail voxel, or the nearest.
        let is_inside = |point: &&SamplePoint| voxel_of(point.position, point.normal, edge) == voxel;
        let inside: Vec<SamplePoint> = lit.points.iter().filter(is_inside).copied().collect();
        let distance = |point: &SamplePoint| point.position.distance_squared(centre);
        let nearest = || lit.points.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        match (is_detail, inside.is_empty()) {
            (false, _) => gathered(lit.points),
            (true, false) => gathered(&inside),
            (true, true) => gathered(nearest().map_or(&[], std::slice::from_ref)),
        }
    }

    /// The patch that voxel `voxel` of volume `volume` is of: its own, or the one that it is a part of.
    fn patch(&self, volume: usize, voxel: VoxelCoord, direction: usize) -> Option<&LitPatch<'a>> {
        let details = self.scene.voxel_edge_m() / self.volumes[volume].layout().voxel_edge_m;
        let whole = voxel.div_euclid(VoxelCoord::splat(details.round().max(1.0) as i32));
        self.scene.patch(whole, direction)
    }

    fn point(
        &self,
        index: usize,
        point: &ReferencePoint,
        served: f64,
        reads: Option<&[Read]>,
        gathers: &BTreeMap<ReadKey, PatchGather>,
    ) -> anyhow::Result<Explained> {
        let of_surfaces = crate::volume_light::at(&self.volumes, point.position, point.normal).map(mean);
        let Some(reads) = reads.filter(|_| of_surfaces.is_some_and(|light| is_same(light, served))) else {
            return Ok(self.in_air(index, point, served));
        };
        let solved = |read: &Read| {
            let light =
                self.volumes[read.volume].at(read.voxel).map(|light| light.irradiance[read.direction]);
            mean(light.unwrap_or(Vec3::ZERO))
        };
        let summed: f64 = reads.iter().map(|read| f64::from(read.weight) * solved(read)).sum();
        ensure!(
            (summed - served).abs() <= 1e-3 * served.abs().max(SUMMED_LX_MIN),
            "point {index}: the lookup answers {served} lx where its patches give {summed} lx; the causes of errors \
             are only known for a lookup that is a weighted mean of patches within two voxels"
        );
        let seen = self.scene.gather_place(point.position, point.normal, self.options.point_rays);
        let mut sum = PointSum::new(self, point, seen.light);
        for read in reads {
            let fallback = fallback_share(reads, read.direction, point.normal);
            if let Some(gather) = gathers.get(&read.key()) {
                let patch = self.patch(read.volume, read.voxel, read.direction);
                sum.add(read, patch, solved(read), gather, fallback);
            }
        }
        let reference = mean(point.irradiance);
        let reference_noise = mean(point.standard_error);
        let (parts, evidence) = sum.finish(&seen, reference, reference_noise);
        let voxel = voxel_of(point.position, point.normal, self.scene.voxel_edge_m());
        let (position, normal) = (point.position, point.normal);
        Ok(Explained { index, position, normal, voxel, reference, reference_noise, served, parts, evidence })
    }
}

/// Which share of the weight of `direction` others left to it: by the rule it has `n_a^2`.
fn fallback_share(reads: &[Read], direction: usize, normal: Vec3) -> f64 {
    let weight: f32 = reads.iter().filter(|read| read.direction == direction).map(|read| read.weight).sum();
    let axis = normal[direction / 2];
    let faces = usize::from(axis < 0.0) == direction % 2;
    let due = if faces { axis * axis } else { 0.0 };
    // Rounding is no fallback.
    let excess = f64::from((weight - due) / weight.max(f32::MIN_POSITIVE));
    if excess > 1e-3 { excess } else { 0.0 }
}

/// Parts of one point's error as its reads are gone through.
pub(super) struct PointSum<'e> {
    scene: &'e SceneLight<'e>,
    normal: Vec3,
    /// Just off the surface, and lifted.
    eyes: [Vec3; 2],
    gathered: f64,
    pub(super) parts: Contributions,
    evidence: Evidence,
    row_error: f64,
    row_variance: f64,
    behind_light: f64,
}

impl<'e> PointSum<'e> {
    pub(super) fn new(explainer: &'e Explainer<'e>, point: &ReferencePoint, gathered: f64) -> Self {
        let scene = &explainer.scene;
        Self {
            scene,
            normal: point.normal,
            eyes: eyes(scene, point.position, point.normal),
            gathered,
            parts: Contributions::default(),
            evidence: Evidence { gathered, plain_light_range: [f64::INFINITY, 0.0], ..Evidence::default() },
            row_error: 0.0,
            row_variance: 0.0,
            behind_light: 0.0,
        }
    }

    fn add(
        &mut self,
        read: &Read,
        patch: Option<&LitPatch<'_>>,
        solved: f64,
        gather: &PatchGather,
        fallback: f64,
    ) {
        let weight = f64::from(read.weight);
        let edge = self.scene.voxel_edge_m();
        let is_small = patch.is_some_and(|lit| lit.patch.area < SMALL_AREA_SHARE * edge * edge);
        self.evidence.reads += 1;
        self.evidence.fallback_share += weight * fallback;
        let row_error = weight * (solved - gather.light);
        if is_small {
            self.evidence.small_share += weight;
            self.parts.add(Cause::SmallPatch, row_error);
        } else {
            self.row_error += row_error;
            self.row_variance += (weight * gather.row_noise).powi(2);
        }
        let weight_a_point = weight / gather.points.len().max(1) as f64;
        for point in &gather.points {
            let difference = weight_a_point * (point.light - self.gathered);
            self.parts.add(Cause::LookupFallback, difference * fallback);
            let cause = if is_small { Cause::SmallPatch } else { self.why(&point.point, point.is_hidden) };
            self.parts.add(cause, difference * (1.0 - fallback));
            let evidence = &mut self.evidence;
            match cause {
                Cause::ThinWall => {
                    evidence.behind_wall_share += weight_a_point;
                    self.behind_light += weight_a_point * point.light;
                }
                Cause::HiddenPoints => evidence.hidden_share += weight_a_point,
                Cause::MixedNormals => evidence.turned_share += weight_a_point,
                _ => {
                    let [low, high] = evidence.plain_light_range;
                    evidence.plain_light_range = [low.min(point.light), high.max(point.light)];
                }
            }
        }
    }

    /// Why light at `other` may differ.
    fn why(&self, other: &SamplePoint, is_hidden: bool) -> Cause {
        let others = eyes(self.scene, other.position, other.normal);
        let sees = |from: Vec3| others.iter().any(|&to| self.scene.sees(from, to));
        if is_hidden {
            Cause::HiddenPoints
        } else if !self.eyes.iter().any(|&eye| sees(eye)) {
            Cause::ThinWall
        } else if other.normal.dot(self.normal) < ALIKE_COSINE {
            Cause::MixedNormals
        } else {
            Cause::VoxelDetail
        }
    }

    pub(super) fn finish(
        mut self,
        seen: &PlaceGather,
        reference: f64,
        reference_noise: f64,
    ) -> (Contributions, Evidence) {
        let row_noise = self.row_variance.sqrt();
        let parts = &mut self.parts;
        parts.add_within(Cause::TooFewRays, Cause::RowBalance, self.row_error, NOISE_DEVIATIONS * row_noise);
        parts.add(Cause::EmitterEdge, seen.emission_excess);
        parts.add(Cause::LampEdge, seen.lamp_excess);
        parts.add(Cause::ReflectanceMix, seen.reflectance_excess);
        parts.add(Cause::NoPatchSeen, -seen.unseen);
        let excess = seen.emission_excess + seen.lamp_excess + seen.reflectance_excess - seen.unseen;
        let rest = seen.light - excess - reference;
        let noise = NOISE_DEVIATIONS * seen.noise.hypot(reference_noise);
        parts.add_within(Cause::Noise, Cause::FarLight, rest, noise);
        self.evidence.row_noise = row_noise;
        self.evidence.no_patch_share = seen.unseen_share;
        self.evidence.behind_wall_light =
            self.behind_light / self.evidence.behind_wall_share.max(f64::MIN_POSITIVE);
        if self.evidence.plain_light_range[0] > self.evidence.plain_light_range[1] {
            self.evidence.plain_light_range = [0.0; 2];
        }
        (self.parts, self.evidence)
    }
}

/// Two places from which a surface point looks: low, and lifted as far as there is room.
fn eyes(scene: &SceneLight<'_>, position: Vec3, normal: Vec3) -> [Vec3; 2] {
    let lift = LIFT_VOXELS * scene.voxel_edge_m();
    let low = position + normal * scene.headroom(position, normal, 0.04 * lift);
    [low, position + normal * scene.headroom(position, normal, lift)]
}
