//! Where the rays of rows end, counted by a device: what it is told, what it is asked, what comes back.
//!
//! A *run* is rays side by side whose ends are added up by patch, by lobe of the sky, and for sides without patches. What
//! is added are integer parts of a ray, so that the order does not matter. A ray whose first triangle a device cannot judge
//! comes back by its number. [`count_ends`] does all of it on the CPU: the twin of `shaders/wgsl/kernels/count_ends.wgsl`.
//! It knows no rule of its own: to whom a crossing belongs is told it in [`EndPlaces`] by who bakes. What the rays of fans
//! face ([`face_fans`]) needs no places, and is asked before there are any.

use crate::caster::{CasterError, Query};
use crate::fan::{RayFan, Rays};
use crate::{Hit, SceneTracer};
use earthshine_light::TreeLayout;
use earthshine_world::{AxisWeights, Direction, Vec3, VoxelCoord};
use std::collections::HashMap;

/// Parts of a ray that counts whole: sums of a run stay below `u32::MAX`, and shares are as fine as `f32` is near one.
pub const RAY_PARTS: u32 = 1 << 20;
/// Most rays of a run: what its ends take at most is what threads of a workgroup can share.
pub const RUN_RAYS_MAX: u32 = 512;
/// Most rays of one question.
pub const COUNTED_RAYS_MAX: usize = 1 << 20;
/// No patch faces this way in a voxel.
pub const NO_PATCH: u32 = u32::MAX;
/// One more than the largest number that a patch may have.
pub const COUNTED_PATCHES_MAX: u32 = 0xFFFF_0000;

/// A triangle as an end of rays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndTriangle {
    /// Unit, of its front.
    pub normal: Vec3,
    /// What of a ray goes to the patch that faces along each axis, on either side of it; of [`RAY_PARTS`].
    pub parts: [u32; 3],
    /// Whether only the CPU can tell what a ray finds that meets it first: it may have holes.
    pub is_for_host: bool,
    /// Whether that is so in voxels that [ask the host](EndVoxel::asks_host).
    pub is_for_host_in_places: bool,
    /// Whether it has no back.
    pub is_two_sided: bool,
    /// Where its front and its back lie inside of something, so that rays that come to them are absorbed.
    pub buried: [Buried; 2],
}

/// Where a side of a triangle is buried.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Buried {
    /// Nowhere.
    #[default]
    Nowhere,
    /// In some voxels, which [`EndVoxel::buried`] tells.
    InPlaces,
    /// Everywhere.
    Everywhere,
}

/// Patches of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EndVoxel {
    /// Which.
    pub voxel: VoxelCoord,
    /// By direction, below [`COUNTED_PATCHES_MAX`] or [`NO_PATCH`].
    pub patches: [u32; 6],
    /// Whether only the CPU can tell whose hits are on triangles that [say so](EndTriangle::is_for_host_in_places): its patches
    /// left out places on them, or a texture says which of two patches a hit is of.
    pub asks_host: bool,
    /// What of the sides that are buried [in places](Buried::InPlaces) is here.
    pub buried: BuriedHere,
}

/// The sides in a voxel that are buried in places, by the direction that they face most: a bit each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BuriedHere {
    /// Of those that are buried here.
    pub buried: u8,
    /// Of those that are not. A ray that meets what faces a direction of both has to be cast by the CPU.
    pub open: u8,
}

/// To whom crossings belong: the voxel a little before the side that is hit, and there by the side's directions.
#[derive(Debug, Clone, PartialEq)]
pub struct EndPlaces {
    /// m.
    pub voxel_edge_m: f32,
    /// How far before a side its voxel is looked up, m.
    pub off_surface_m: f32,
    /// As in the scene.
    pub triangles: Vec<EndTriangle>,
    /// Those with patches, places left out, or sides that are buried there and not elsewhere; each once.
    pub voxels: Vec<EndVoxel>,
}

/// What the ends of a run's rays are counted for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunSum {
    /// Every ray whole.
    Whole,
    /// Rays that go the way of a direction, each by its cosine with it.
    Facing(Direction),
    /// Every ray whole, but only what ends on sides without patches.
    Absorbed,
}

/// Rays side by side whose ends are added up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// Among those of the question.
    pub first_ray: u32,
    /// At most [`RUN_RAYS_MAX`].
    pub ray_count: u32,
    /// What is added up.
    pub sum: RunSum,
}

/// The ends of a run's rays, in parts of a ray.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RunEnds {
    /// Patches and what ends on them; ascending, none twice.
    pub patches: Vec<(u32, u32)>,
    /// Escapes by direction lobe.
    pub sky: [u32; 6],
    /// On sides without patches.
    pub absorbed: u32,
    /// Rays that the CPU has to cast, by their place in the run, ascending. Of a [`RunSum::Facing`] none are told: another
    /// run over the same rays has them.
    pub unknown: Vec<u32>,
}

/// The answer to one question.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CountedEnds {
    /// Run by run.
    pub runs: Vec<RunEnds>,
    /// What it took.
    pub traffic: Traffic,
}

/// How many of a fan's rays meet what.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FacedRays {
    /// The back of something that has but one side.
    pub back: u32,
    /// Anything near, be it a back.
    pub near: u32,
    /// A triangle that only the CPU can judge; these are not among the others.
    pub for_host: u32,
    /// How far the farthest of them gets, m.
    pub reach_m: f32,
}

/// The answer to one question about fans.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FacedFans {
    /// Fan by fan.
    pub fans: Vec<FacedRays>,
    /// What it took.
    pub traffic: Traffic,
}

/// The answer to a question about single rays.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FirstTriangles {
    /// What each ray meets first, holes or not.
    pub triangles: Vec<Option<u32>>,
    /// What it took.
    pub traffic: Traffic,
}

/// What goes between host and device for a question.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Traffic {
    /// To the device, bytes.
    pub sent_bytes: u64,
    /// From the device, bytes.
    pub read_bytes: u64,
}

/// A device that trees can be put on.
pub trait RayDevice: Sync {
    /// Puts `layout` on it, and `triangles`, as in the scene.
    ///
    /// # Errors
    /// [`CasterError`]: it has no room, or is gone.
    fn counter(
        &self,
        layout: &TreeLayout,
        triangles: &[EndTriangle],
    ) -> Result<Box<dyn EndCounter>, CasterError>;
}

/// Casts rays against the scene of one tracer and adds up what they meet. Several threads may ask at once.
pub trait EndCounter: Send + Sync + std::fmt::Debug {
    /// What the rays of `fans`, which are at most [`COUNTED_RAYS_MAX`] in all and [`RUN_RAYS_MAX`] each, meet first; nearer
    /// than `near_m` is near.
    ///
    /// # Errors
    /// [`CasterError`]: the device is gone or full.
    fn face(&self, fans: &[RayFan], near_m: f32) -> Result<FacedFans, CasterError>;

    /// What each of `rays` meets first, which are at most [`COUNTED_RAYS_MAX`].
    ///
    /// # Errors
    /// [`CasterError`]: the device is gone or full.
    fn first(&self, rays: &[Query]) -> Result<FirstTriangles, CasterError>;

    /// Puts on it where rays end, before any ends are counted.
    ///
    /// # Errors
    /// [`CasterError`]: the device is gone or full.
    fn settle(&self, places: &EndPlaces) -> Result<(), CasterError>;

    /// The ends of each of `runs` over `rays`, which are at most [`COUNTED_RAYS_MAX`].
    ///
    /// # Errors
    /// [`CasterError`]: the device is gone or full.
    fn count(&self, rays: &Rays, runs: &[Run]) -> Result<CountedEnds, CasterError>;
}

impl EndTriangle {
    /// A triangle with unit `normal` and a back, by the `weights` of its directions along the three axes.
    #[must_use]
    pub fn new(normal: Vec3, weights: [f32; 3], is_for_host: bool) -> Self {
        let whole = |weight: f32| (f64::from(weight) * f64::from(RAY_PARTS)).round() as u32;
        let mut parts = weights.map(whole);
        // The largest takes what rounding left: where weights sum to one, rays count whole.
        let total = whole(weights.iter().sum());
        let largest = (0..3).max_by_key(|&axis| parts[axis]).unwrap_or(0);
        parts[largest] = (parts[largest] + total).saturating_sub(parts.iter().sum());
        let buried = [Buried::Nowhere; 2];
        Self { normal, parts, is_for_host, is_for_host_in_places: false, is_two_sided: false, buried }
    }

    /// Whether a ray that meets its front, or its back, in a voxel with `here` is absorbed; `None` if only the CPU can tell.
    #[must_use]
    pub fn is_buried(&self, front: bool, here: BuriedHere) -> Option<bool> {
        let bit = 1u8 << Self::main_direction(if front { self.normal } else { -self.normal }).index();
        match self.buried[usize::from(!front)] {
            Buried::Nowhere => Some(false),
            Buried::Everywhere => Some(true),
            Buried::InPlaces if here.buried & bit == 0 => Some(false),
            Buried::InPlaces => (here.open & bit == 0).then_some(true),
        }
    }

    /// The direction that a side with `normal` faces most; the first of several axes.
    #[must_use]
    pub fn main_direction(normal: Vec3) -> Direction {
        let longer = |longest: usize, axis: usize| normal[axis].abs() > normal[longest].abs();
        let axis =
            [1, 2].into_iter().fold(0, |longest, axis| if longer(longest, axis) { axis } else { longest });
        Direction::of_component(axis, normal[axis])
    }
}

/// What a device that follows the trees of `tracer` finds first along `rays`.
#[must_use]
pub fn first_triangles(tracer: &SceneTracer<'_>, rays: &[Query]) -> Vec<Option<u32>> {
    rays.iter().map(|ray| tracer.first(ray).map(|hit| hit.triangle as u32)).collect()
}

/// What a device that follows the trees of `tracer` says of `fans`: the twin of `shaders/wgsl/kernels/face_fans.wgsl`.
#[must_use]
pub fn face_fans(
    tracer: &SceneTracer<'_>,
    triangles: &[EndTriangle],
    fans: &[RayFan],
    near_m: f32,
) -> Vec<FacedRays> {
    let one = |fan: &RayFan| {
        let mut faced = FacedRays::default();
        for ray in 0..fan.ray_count {
            let hit = tracer.first(&fan.query(ray));
            faced.reach_m = faced.reach_m.max(hit.map_or(f32::INFINITY, |hit| hit.distance));
            let Some(hit) = hit else { continue };
            let triangle = &triangles[hit.triangle];
            if triangle.is_for_host {
                faced.for_host += 1;
            } else {
                faced.back += u32::from(!hit.front && !triangle.is_two_sided);
                faced.near += u32::from(hit.distance < near_m);
            }
        }
        faced
    };
    fans.iter().map(one).collect()
}

/// What a device that follows the trees of `tracer` answers: each run's ends, one ray after the other.
#[must_use]
pub fn count_ends(
    tracer: &SceneTracer<'_>,
    places: &EndPlaces,
    rays: &[Query],
    runs: &[Run],
) -> Vec<RunEnds> {
    let voxels: HashMap<VoxelCoord, &EndVoxel> =
        places.voxels.iter().map(|voxel| (voxel.voxel, voxel)).collect();
    let one = |run: &Run| {
        let mut ends = RunEnds::default();
        for place in 0..run.ray_count {
            let ray = &rays[(run.first_ray + place) as usize];
            let weight = match run.sum {
                RunSum::Whole | RunSum::Absorbed => 1.0,
                RunSum::Facing(direction) => ray.direction.dot(direction.vector()).max(0.0),
            };
            let weighed = |parts: u32| (parts as f32 * weight + 0.5) as u32;
            match tracer.first(ray) {
                None if run.sum == RunSum::Absorbed => {}
                None => {
                    for (lobe, share) in AxisWeights::Squared.of(ray.direction) {
                        ends.sky[lobe.index()] += (RAY_PARTS as f32 * share * weight + 0.5) as u32;
                    }
                }
                Some(hit) => {
                    let is_known = ends.add(places, &voxels, ray, &hit, (run.sum, &weighed));
                    if !is_known && !matches!(run.sum, RunSum::Facing(_)) {
                        ends.unknown.push(place);
                    }
                }
            }
        }
        ends.patches.sort_unstable();
        ends.patches.dedup_by(|later, kept| {
            let is_same = later.0 == kept.0;
            kept.1 += if is_same { later.1 } else { 0 };
            is_same
        });
        ends
    };
    runs.iter().map(one).collect()
}

impl RunEnds {
    /// Whether a device can tell who takes the ray.
    fn add(
        &mut self,
        places: &EndPlaces,
        voxels: &HashMap<VoxelCoord, &EndVoxel>,
        ray: &Query,
        hit: &Hit,
        (sum, weighed): (RunSum, &dyn Fn(u32) -> u32),
    ) -> bool {
        let triangle = &places.triangles[hit.triangle];
        let normal = if hit.front { triangle.normal } else { -triangle.normal };
        let position = ray.origin + ray.direction * hit.distance;
        let voxel = ((position + normal * places.off_surface_m) / places.voxel_edge_m).floor().as_ivec3();
        let found = voxels.get(&voxel);
        let asks_host = triangle.is_for_host_in_places && found.is_some_and(|voxel| voxel.asks_host);
        let here = found.map_or(BuriedHere::default(), |voxel| voxel.buried);
        let is_buried = triangle.is_buried(hit.front, here);
        if triangle.is_for_host || asks_host && is_buried != Some(true) {
            return false;
        }
        match is_buried {
            None => return false,
            Some(true) => {
                self.absorbed += weighed(RAY_PARTS);
                return true;
            }
            Some(false) => {}
        }
        for axis in 0..3 {
            let patches = found.map_or(&[NO_PATCH; 6], |voxel| &voxel.patches);
            let patch = patches[Direction::of_component(axis, normal[axis]).index()];
            match (patch, weighed(triangle.parts[axis])) {
                (_, 0) => {}
                (NO_PATCH, parts) => self.absorbed += parts,
                (_, _) if sum == RunSum::Absorbed => {}
                (patch, parts) => self.patches.push((patch, parts)),
            }
        }
        true
    }
}
