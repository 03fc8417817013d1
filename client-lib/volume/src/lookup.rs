//! The lookup rule: what light a point with a normal reads from the voxels around it.
//!
//! `I(x, n) = sum_a n_a^2 I_a(x)` over the three directions that `n` faces. `I_a` is trilinear over the eight
//! voxels around `x + 0.25 voxel * n`, each weight times how near `x` is to the plane of the value ([`plane`]); voxels
//! without light on that direction are skipped and the rest is divided by the weight that is left. A direction with nothing left gives its `n_a^2` to the others; a
//! volume with nothing at all leaves the point to the next coarser one, and one that ends nearby shares it with that
//! (`level_blend`).
//!
//! The finest volume may hold *detail*: the surfaces of level 0 in detail voxels, without air. It answers as far
//! as its weight of surfaces goes (all of it from 0.25 on, as below), and level 0 for the rest. Surfaces that share a detail
//! voxel and a direction come in *layers*: volumes in the same place, one after the other, that are read as one. Each value
//! counts by its own plane and normal there ([`tilt`]), so that a point reads its own surface, and by how far beyond the walls
//! that end it the point lies ([`barrier`]), so that it reads its own side of them. How much of a point lies on a surface does not
//! hang on walls: beyond all of them it reads the nearest.
//!
//! Light comes from surfaces (patches) and from the air (receivers). Two things are the air's alone, and both fade
//! with its share, so that what moves through the air never meets a step:
//!
//! - It counts `max(0, 1 - w / 0.25)` of its weight, where `w` is the trilinear weight of patches, each as far as `x` lies
//!   on its plane ([`plane::on_surface`]): a point on a surface reads surfaces, one before it the air.
//! - Air knows the opposite direction too, so `|n_a| (1 - |n_a|) (I_a - I_-a) / 2` is added: with it light that varies
//!   linearly with the normal (a sky's) is read exactly, at slanted normals too. What it takes away
//!   is limited to a quarter of the sum, because a lamp does not darken what turns away from it.

use crate::VoxelLight;
use crate::{Volume, barrier, level_blend, plane, tilt};
use glam::{IVec3, Vec3};
use std::borrow::Borrow;

/// How far a point reads in front of its surface, in voxels: a surface at a voxel's border reads the voxel it faces.
pub const NORMAL_OFFSET_VOXELS: f32 = 0.25;

/// Patches of this weight among the eight voxels leave nothing to receivers. A flat surface always has as much where
/// it is looked up: its layer's weight is least, a quarter, where it lies at the far end of its voxels.
pub const SURFACE_WEIGHT: f32 = 0.25;

/// Light is at least this share of `sum_a n_a^2 I_a`, whatever the opposite directions take away.
pub const AIR_FLOOR: f32 = 0.75;

/// Weights below it are nothing: a quotient of two such numbers is noise.
pub const WEIGHT_MIN: f32 = 1e-6;

/// What a point reads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LookedUp {
    /// All indirect irradiance and the sky, lx. Finite.
    pub irradiance: Vec3,
    /// The part of it that came straight from the sky, lx. Finite.
    pub sky_irradiance: Vec3,
    /// Share of the surroundings that the light rests on, 0..=1.
    pub quality: f32,
    /// The part of `quality` that coarse levels stand for, 0..=1.
    pub far_share: f32,
    /// Share of what is read whose direct light is out of date, 0..=1.
    pub stale_share: f32,
    /// Level of the finest volume that answered: 0 is the finest of all.
    pub level: u8,
}

/// Light at `position` (m) on a surface with `normal` (any length but zero), from the first of `volumes`
/// (finest first, layers side by side) that has any, shared with the next where that one ends. `None` where none has, and for numbers that are not finite.
#[must_use]
pub fn lookup<V: Borrow<Volume>>(volumes: &[V], position: Vec3, normal: Vec3) -> Option<LookedUp> {
    let normal = normal.try_normalize()?;
    if !position.is_finite() {
        return None;
    }
    let mut total = Sum::default();
    let mut answered = None;
    let mut rest = volumes;
    while let Some(volume) = rest.first().map(Borrow::borrow) {
        let layers;
        (layers, rest) = rest.split_at(volume.layer_count(rest));
        let Some((low, fraction)) = corners(volume, position, normal) else { continue };
        let Some((found, surface_share)) = lookup_in(layers, low, fraction, normal) else { continue };
        let kept = rest.first().map(Borrow::borrow).map_or(1.0, |coarser| {
            // Detail knows surfaces alone: it fades where they end, and what stands for the air takes over.
            let fade = if level_blend::is_detail(volume, coarser) { surface_share } else { 1.0 };
            fade * (1.0 - level_blend::share_of_coarser(volume, coarser, low, fraction, normal))
        });
        let weight = (1.0 - total.weight) * kept;
        let good = Goodness { quality: found.quality, far: found.far_share, stale: found.stale_share };
        total.add(weight, found.irradiance, found.sky_irradiance, good);
        answered = answered.or(Some(found.level));
        if kept >= 1.0 {
            break;
        }
    }
    let Sum { irradiance, sky_irradiance, good: Goodness { quality, far, stale }, .. } = total.mean()?;
    let level = answered?;
    Some(LookedUp { irradiance, sky_irradiance, quality, far_share: far, stale_share: stale, level })
}

/// The lowest of the eight voxels around what `position` reads in `volume`, and its place between them.
fn corners(volume: &Volume, position: Vec3, normal: Vec3) -> Option<(IVec3, Vec3)> {
    let layout = volume.layout();
    // In voxels from the centre of the lowest one.
    let local =
        position / layout.voxel_edge_m + NORMAL_OFFSET_VOXELS * normal - 0.5 - layout.origin.as_vec3();
    let is_near = local.cmpge(Vec3::splat(-1.0)).all() && local.cmple(layout.dims.as_vec3()).all();
    let low = local.floor();
    is_near.then(|| (layout.origin + low.as_ivec3(), local - low))
}

/// How good light is, as [`LookedUp`] says it.
#[derive(Clone, Copy, Default)]
struct Goodness {
    quality: f32,
    far: f32,
    stale: f32,
}

impl Goodness {
    /// Of the light of one direction of a voxel.
    fn of(light: &VoxelLight, direction: usize) -> Self {
        let share = |code: u8| f32::from(code) / 255.0;
        let stale = if light.staleness[direction] > 0 { 1.0 } else { 0.0 };
        Self { quality: share(light.quality[direction]), far: share(light.far[direction]), stale }
    }

    fn scaled(self, factor: f32) -> Self {
        Self { quality: factor * self.quality, far: factor * self.far, stale: factor * self.stale }
    }

    fn add(&mut self, other: Self) {
        self.quality += other.quality;
        self.far += other.far;
        self.stale += other.stale;
    }
}

#[derive(Clone, Copy, Default)]
struct Sum {
    irradiance: Vec3,
    sky_irradiance: Vec3,
    good: Goodness,
    weight: f32,
}

impl Sum {
    fn add(&mut self, weight: f32, irradiance: Vec3, sky_irradiance: Vec3, good: Goodness) {
        self.irradiance += weight * irradiance;
        self.sky_irradiance += weight * sky_irradiance;
        self.good.add(good.scaled(weight));
        self.weight += weight;
    }

    /// Adds all of `other`, its weight too, times `factor`.
    fn add_sum(&mut self, factor: f32, other: &Self) {
        self.irradiance += factor * other.irradiance;
        self.sky_irradiance += factor * other.sky_irradiance;
        self.good.add(other.good.scaled(factor));
        self.weight += factor * other.weight;
    }

    /// Divided by its weight; `None` where there is next to none.
    fn mean(&self) -> Option<Self> {
        (self.weight > WEIGHT_MIN).then(|| Self {
            irradiance: self.irradiance / self.weight,
            sky_irradiance: self.sky_irradiance / self.weight,
            good: self.good.scaled(1.0 / self.weight),
            weight: 1.0,
        })
    }
}

/// Light of `layers` alone, at the point at `fraction` (0..1) between the centres of voxel `low` and its upper
/// neighbours; and how much of it is surfaces', 1 on a flat one.
fn lookup_in<V: Borrow<Volume>>(
    layers: &[V],
    low: IVec3,
    fraction: Vec3,
    normal: Vec3,
) -> Option<(LookedUp, f32)> {
    let around = Around::of(layers, low, fraction, normal);
    let (mut total, mut slope) = (Sum::default(), Sum::default());
    let mut surface_weight = 0.0;
    for axis in 0..3 {
        let facing = axis * 2 + usize::from(normal[axis] < 0.0);
        let along = normal[axis].abs();
        if let Some((mean, half_difference)) = around.read(facing) {
            total.add_sum(along * along, &mean);
            slope.add_sum(along * (1.0 - along), &half_difference);
            surface_weight += along * along * around.surface_weights[facing];
        }
    }
    let weight = total.weight;
    let Sum { irradiance, sky_irradiance, good, .. } = total.mean()?;
    let sloped = |light: Vec3, slope: Vec3| (light + slope / weight).max(AIR_FLOOR * light);
    let found = LookedUp {
        irradiance: sloped(irradiance, slope.irradiance),
        sky_irradiance: sloped(sky_irradiance, slope.sky_irradiance),
        quality: good.quality,
        far_share: good.far,
        stale_share: good.stale,
        level: layers.first()?.borrow().layout().level,
    };
    Some((found, (surface_weight / SURFACE_WEIGHT).min(1.0)))
}

/// What the eight voxels around a point hold, by direction.
#[derive(Default)]
struct Around {
    /// Each patch that the point faces by its trilinear weight times how much its plane and barriers make the point trust it.
    surfaces: [Sum; 6],
    /// Trilinear weight of voxels with patches, as far as the point lies on one.
    surface_weights: [f32; 6],
    airs: [Sum; 6],
}

impl Around {
    /// Around the point at `fraction` (0..1) between the centres of voxel `low` and its upper neighbours, which a
    /// surface with `normal` reads.
    fn of<V: Borrow<Volume>>(layers: &[V], low: IVec3, fraction: Vec3, normal: Vec3) -> Self {
        let mut around = Self::default();
        // Of the surface itself, in voxels from the middle of voxel `low`.
        let surface = fraction - NORMAL_OFFSET_VOXELS * normal;
        for corner in 0..8 {
            let step = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let along = |axis: usize| if step[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] };
            let weight = along(0) * along(1) * along(2);
            // Of the layer that the point lies in.
            let mut on_surfaces = [0f32; 6];
            for light in layers.iter().filter_map(|volume| volume.borrow().at(low + step)) {
                around.add(light, weight, surface - step.as_vec3(), normal, &mut on_surfaces);
            }
            for (sum, on_surface) in around.surface_weights.iter_mut().zip(on_surfaces) {
                *sum += weight * on_surface;
            }
        }
        around
    }

    /// Adds `light`, of trilinear `weight`, for a point on a surface with `normal`, `from_middle` voxels from the middle of
    /// the light's voxel; and raises `on_surfaces` to how much of the point lies on its surfaces.
    fn add(
        &mut self,
        light: &VoxelLight,
        weight: f32,
        from_middle: Vec3,
        normal: Vec3,
        on_surfaces: &mut [f32; 6],
    ) {
        for direction in (0..6).filter(|&direction| light.has(direction)) {
            let (all, sky) = (light.irradiance[direction], light.sky_irradiance[direction]);
            let good = Goodness::of(light, direction);
            if light.is_air(direction) {
                self.airs[direction].add(weight, all, sky, good);
            } else if is_faced(normal, direction) {
                let (trust, on_surface) = nearness(light, direction, from_middle, normal);
                self.surfaces[direction].add(weight * trust, all, sky, good);
                on_surfaces[direction] = on_surfaces[direction].max(on_surface);
            }
        }
    }

    /// Light on direction `facing`, and half of what it exceeds that on the opposite one by, as far as both are the
    /// air's.
    fn read(&self, facing: usize) -> Option<(Sum, Sum)> {
        let (surface, air) = (self.surfaces[facing], self.airs[facing]);
        let surface_weight = self.surface_weights[facing];
        let room = (1.0 - surface_weight / SURFACE_WEIGHT).max(0.0);
        let mut both = Sum::default();
        if surface.weight > 0.0 {
            both.add_sum(surface_weight / surface.weight, &surface);
        }
        both.add_sum(room, &air);
        let mean = both.mean()?;
        let mut slope = Sum::default();
        if let (Some(front), Some(back)) = (air.mean(), self.airs[facing ^ 1].mean()) {
            let share = room * air.weight / both.weight * self.airs[facing ^ 1].weight;
            slope.add_sum(0.5 * share, &front);
            slope.add_sum(-0.5 * share, &back);
        }
        Some((mean, slope))
    }
}

/// Whether a surface with `normal` reads surfaces' light of `direction`.
fn is_faced(normal: Vec3, direction: usize) -> bool {
    (normal[direction / 2] < 0.0) == (direction % 2 == 1)
}

/// How much the surface that `light` has in `direction` counts for a point on a surface with `normal`, `from_middle` voxels
/// from the middle of the light's voxel; and how much of the point lies on it.
fn nearness(light: &VoxelLight, direction: usize, from_middle: Vec3, normal: Vec3) -> (f32, f32) {
    let (tilt, axis) = (light.tilt[direction], direction / 2);
    let same_side = barrier::trust(light.barriers[direction], axis, from_middle);
    if let Some(distance) = tilt::distance(tilt, from_middle) {
        (same_side * tilt::trust(tilt, distance, normal), plane::on_surface(distance))
    } else {
        let distance = plane::distance(light.plane[direction], from_middle[axis] + 0.5);
        let least = (distance.abs() - plane::slant(normal, axis)).max(0.0);
        (same_side * plane::nearness(distance), plane::on_surface(least))
    }
}

#[cfg(test)]
#[path = "lookup/barrier_tests.rs"]
mod barrier_tests;
#[cfg(test)]
#[path = "lookup/tests.rs"]
mod tests;
