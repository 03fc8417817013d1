//! The lookup rule: what light a point with a normal reads from the voxels around it.
//!
//! `I(x, n) = sum_a n_a^2 I_a(x)` over the three directions that `n` faces. `I_a` is trilinear over the eight
//! voxels around `x + 0.25 voxel * n`, each weight times how near `x` is to the plane of the value ([`plane`]); voxels
//! without light on that direction are skipped and the rest is divided by the weight that is left. A direction with nothing left gives its `n_a^2` to the others; a
//! volume with nothing at all leaves the point to the next coarser one, and one that ends nearby shares it with that
//! (`level_blend`).
//!
//! The finest volume may hold *detail*: the surfaces of level 0 in detail voxels, without air. It answers as far
//! as its weight of surfaces goes (all of it from 0.25 on, as below), and level 0 for the rest.
//!
//! Light comes from surfaces (patches) and from the air (receivers). Two things are the air's alone, and both fade
//! with its share, so that what moves through the air never meets a step:
//!
//! - It counts `max(0, 1 - w / 0.25)` of its weight, where `w` is the trilinear weight of patches: a point on a surface
//!   reads surfaces.
//! - Air knows the opposite direction too, so `|n_a| (1 - |n_a|) (I_a - I_-a) / 2` is added: with it light that varies
//!   linearly with the normal (a sky's) is read exactly, at slanted normals too. What it takes away
//!   is limited to a quarter of the sum, because a lamp does not darken what turns away from it.

use crate::VoxelLight;
use crate::{Volume, level_blend, plane};
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
/// (finest first) that has any, shared with the next where that one ends. `None` where none has, and for numbers that are not finite.
#[must_use]
pub fn lookup<V: Borrow<Volume>>(volumes: &[V], position: Vec3, normal: Vec3) -> Option<LookedUp> {
    let normal = normal.try_normalize()?;
    if !position.is_finite() {
        return None;
    }
    let mut total = Sum::default();
    let mut answered = None;
    for (at, volume) in volumes.iter().enumerate() {
        let volume = volume.borrow();
        let Some((low, fraction)) = corners(volume, position, normal) else { continue };
        let Some((found, surface_share)) = lookup_in(volume, low, fraction, normal) else { continue };
        let kept = volumes.get(at + 1).map(Borrow::borrow).map_or(1.0, |coarser| {
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

/// Light of `volume` alone, at the point at `fraction` (0..1) between the centres of voxel `low` and its upper
/// neighbours; and how much of it is surfaces', 1 on a flat one.
fn lookup_in(volume: &Volume, low: IVec3, fraction: Vec3, normal: Vec3) -> Option<(LookedUp, f32)> {
    let around = Around::of(volume, low, fraction, normal);
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
        level: volume.layout().level,
    };
    Some((found, (surface_weight / SURFACE_WEIGHT).min(1.0)))
}

/// What the eight voxels around a point hold, by direction.
#[derive(Default)]
struct Around {
    /// Each patch by its trilinear weight times its nearness.
    surfaces: [Sum; 6],
    /// Trilinear weight of patches.
    surface_weights: [f32; 6],
    airs: [Sum; 6],
}

impl Around {
    /// Around the point at `fraction` (0..1) between the centres of voxel `low` and its upper neighbours, which a
    /// surface with `normal` reads.
    fn of(volume: &Volume, low: IVec3, fraction: Vec3, normal: Vec3) -> Self {
        let mut around = Self::default();
        // Of the surface itself, in voxels from the low corner of voxel `low`.
        let surface = fraction + 0.5 - NORMAL_OFFSET_VOXELS * normal;
        for corner in 0..8 {
            let step = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let Some(light) = volume.at(low + step) else { continue };
            let along = |axis: usize| if step[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] };
            let weight = along(0) * along(1) * along(2);
            for direction in (0..6).filter(|&direction| light.has(direction)) {
                let (all, sky) = (light.irradiance[direction], light.sky_irradiance[direction]);
                let good = Goodness::of(light, direction);
                if light.is_air(direction) {
                    around.airs[direction].add(weight, all, sky, good);
                } else {
                    let height = surface[direction / 2] - step[direction / 2] as f32;
                    let near = plane::nearness(light.plane[direction], height);
                    around.surfaces[direction].add(weight * near, all, sky, good);
                    around.surface_weights[direction] += weight;
                }
            }
        }
        around
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Layout;
    use glam::UVec3;

    const EDGE_M: f32 = 0.5;

    fn layout() -> Layout {
        Layout { level: 0, origin: IVec3::new(-3, -2, 1), dims: UVec3::new(7, 6, 5), voxel_edge_m: EDGE_M }
    }

    type Put = fn(&mut Volume, IVec3, usize, Vec3, Vec3, u8) -> bool;

    /// All six directions in every voxel, put by `put`, as `field` says at the voxel's centre.
    fn filled_by(put: Put, field: impl Fn(Vec3, usize) -> Vec3) -> Volume {
        let mut volume = Volume::new(layout()).unwrap();
        for index in 0..layout().voxel_count() {
            let voxel = layout().voxel_of(index);
            let centre = (voxel.as_vec3() + 0.5) * EDGE_M;
            for direction in 0..6 {
                let light = field(centre, direction);
                assert!(put(&mut volume, voxel, direction, light, light * 0.25, 255));
            }
        }
        volume
    }

    /// Patches everywhere.
    fn filled(field: impl Fn(Vec3, usize) -> Vec3) -> Volume {
        filled_by(Volume::set_patch, field)
    }

    /// Air everywhere.
    fn aired(field: impl Fn(Vec3, usize) -> Vec3) -> Volume {
        filled_by(Volume::set_receiver, field)
    }

    fn normals() -> [Vec3; 5] {
        [Vec3::X, Vec3::NEG_Z, Vec3::ONE, Vec3::new(0.3, -0.9, 0.2), Vec3::new(-5.0, 2.0, 0.1)]
    }

    fn inside() -> Vec3 {
        Vec3::new(0.23, 0.31, 1.47)
    }

    #[test]
    fn a_constant_field_is_read_exactly() {
        let volume = filled(|_, _| Vec3::new(1.0, 2.0, 3.0));
        for normal in normals() {
            let read = lookup(&[&volume], inside(), normal).unwrap();
            assert!((read.irradiance - Vec3::new(1.0, 2.0, 3.0)).length() < 1e-5);
            assert!((read.sky_irradiance * 4.0 - read.irradiance).length() < 1e-5);
            assert!((read.quality - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn a_linear_field_is_read_exactly_in_front_of_the_surface() {
        let at = |x: Vec3| Vec3::new(x.x, 2.0 * x.y - x.z, x.x + x.y + x.z) + 10.0;
        let volume = filled(|centre, _| at(centre));
        for normal in normals() {
            let read = lookup(&[&volume], inside(), normal).unwrap();
            let offset = NORMAL_OFFSET_VOXELS * EDGE_M * normal.normalize_or_zero();
            assert!((read.irradiance - at(inside() + offset)).length() < 1e-4);
        }
    }

    #[test]
    fn directions_are_weighted_by_the_squares_of_the_normal() {
        let volume = filled(|_, direction| Vec3::splat(10f32.powi(direction as i32)));
        let normal = Vec3::new(0.6, 0.0, -0.8);
        let read = lookup(&[&volume], inside(), normal).unwrap();
        let expected = 0.36 * 1.0 + 0.64 * 1e5;
        assert!((read.irradiance.x - expected).abs() < 1.0, "{}", read.irradiance.x);
    }

    #[test]
    fn voxels_without_a_patch_are_skipped() {
        // Up-facing patches only in one layer of voxels, as on a floor; bright x, dark elsewhere.
        let mut volume = Volume::new(layout()).unwrap();
        let floor = |x: i32, z: i32| IVec3::new(x, 0, z);
        for (x, z) in [(0, 2), (1, 2), (0, 3)] {
            volume.set_patch(floor(x, z), 2, Vec3::splat(x as f32 + 1.0), Vec3::ZERO, 128);
        }
        // Between the centres of (0, 2), (1, 2), (0, 3) and the absent (1, 3).
        let position = Vec3::new(1.0, 0.1, 3.0) * EDGE_M;
        let read = lookup(&[&volume], position, Vec3::Y).unwrap();
        assert!((read.irradiance.x - 4.0 / 3.0).abs() < 1e-5, "{}", read.irradiance.x);
        // A wall has no light here, and what a slanted normal misses the floor makes up for.
        assert_eq!(lookup(&[&volume], position, Vec3::X), None);
        let slanted = lookup(&[&volume], position - 0.05, Vec3::new(1.0, 1.0, 0.0)).unwrap();
        assert!((1.0..=2.0).contains(&slanted.irradiance.x));
    }

    /// Goal: at slanted normals air reads what an ambient cube cannot. Method: irradiance under a half-bright sky,
    /// `1 + n_y`, is linear in the normal.
    #[test]
    fn air_under_a_sky_is_read_exactly_at_any_normal() {
        let at = |normal: Vec3| 10.0 + 6.0 * normal.y;
        let axis = |direction: usize| {
            let sign = if direction.is_multiple_of(2) { 1.0 } else { -1.0 };
            Vec3::AXES[direction / 2] * sign
        };
        let air = aired(|_, direction| Vec3::splat(at(axis(direction))));
        let cube = filled(|_, direction| Vec3::splat(at(axis(direction))));
        for normal in normals().map(|normal| normal.normalize_or(Vec3::X)) {
            let read = lookup(&[&air], inside(), normal).unwrap();
            assert!((read.irradiance.x - at(normal)).abs() < 1e-4, "{normal}: {}", read.irradiance.x);
            assert!((read.sky_irradiance.x * 4.0 - at(normal)).abs() < 1e-4);
        }
        let slanted = Vec3::new(1.0, 1.0, 0.0).normalize_or(Vec3::X);
        let patches = lookup(&[&cube], inside(), slanted).unwrap();
        assert!(patches.irradiance.x < at(slanted) - 1.0, "patches keep to the squares");
    }

    #[test]
    fn a_lamp_does_not_darken_what_turns_away_from_it() {
        let air = aired(|_, direction| Vec3::splat(if direction == 2 { 10.0 } else { 1.0 }));
        for y in [0.0, -0.3, -0.5, -0.8, -1.0] {
            let normal = Vec3::new((1.0f32 - y * y).sqrt(), y, 0.0);
            let read = lookup(&[&air], inside(), normal).unwrap();
            assert!((0.75..=1.0 + 1e-5).contains(&read.irradiance.x), "{y}: {}", read.irradiance.x);
        }
    }

    /// A floor of patches, as bright as 1, under air as bright as 3, in all directions up and sideways.
    fn floor_under_air() -> Volume {
        let mut volume = aired(|_, _| Vec3::splat(3.0));
        for index in 0..layout().voxel_count() {
            let voxel = layout().voxel_of(index);
            if voxel.y == 0 {
                volume.set_patch(voxel, 2, Vec3::ONE, Vec3::ZERO, 255);
            }
        }
        volume
    }

    #[test]
    fn points_on_surfaces_read_surfaces_alone() {
        let volume = floor_under_air();
        // Wherever in its voxels the floor lies.
        for height in [0.0, 0.2, 0.5, 0.75, 0.999] {
            let position = Vec3::new(0.23, height * EDGE_M, 1.47);
            let read = lookup(&[&volume], position, Vec3::Y).unwrap();
            assert!((read.irradiance.x - 1.0).abs() < 1e-5, "{height}: {}", read.irradiance.x);
        }
        let above = lookup(&[&volume], Vec3::new(0.23, 2.0 * EDGE_M, 1.47), Vec3::Y).unwrap();
        assert!((above.irradiance.x - 3.0).abs() < 1e-5);
    }

    /// Goal: nothing that moves meets a step. Method: steps through the air and into the
    /// floor, past a lone patch, and steps a quarter as long.
    #[test]
    fn light_has_no_steps_between_air_and_surfaces() {
        let mut volume = floor_under_air();
        volume.set_patch(IVec3::new(0, 1, 2), 2, Vec3::splat(9.0), Vec3::ZERO, 255);
        for normal in [Vec3::Y, Vec3::new(0.6, 0.8, 0.0), Vec3::new(-0.5, 0.1, 0.7)] {
            let largest = |steps: u32| {
                let read = |step: u32| {
                    let along = step as f32 / steps as f32;
                    let position = Vec3::new(-1.0, 1.2, 0.9).lerp(Vec3::new(1.2, -0.1, 1.9), along);
                    lookup(&[&volume], position, normal).unwrap().irradiance.x
                };
                (0..steps).map(|step| (read(step + 1) - read(step)).abs()).fold(0.0, f32::max)
            };
            // A slope, however steep, shrinks with the step; a step does not.
            let (coarse, fine) = (largest(4000), largest(16_000));
            assert!(fine < 0.3 * coarse, "{normal}: {coarse}, then {fine}");
        }
    }

    /// Goal: a point reads the floor it stands on. Method: two floors in one column of voxels, one a step below the
    /// other, both within what the upper one reads.
    #[test]
    fn points_read_the_surface_whose_plane_they_lie_in() {
        let mut volume = Volume::new(layout()).unwrap();
        for (x, z) in [(0, 2), (1, 2), (0, 3), (1, 3)] {
            for (y, light) in [(0, 1.0), (1, 5.0)] {
                volume.set_patch(IVec3::new(x, y, z), 2, Vec3::splat(light), Vec3::ZERO, 255);
            }
        }
        let read = |volume: &Volume, height: f32| {
            let position = Vec3::new(1.0, height, 3.0) * EDGE_M;
            lookup(&[volume], position, Vec3::Y).unwrap().irradiance.x
        };
        // Half-way between the layers in height, the upper floor just above.
        assert!((read(&volume, 0.75) - 3.0).abs() < 1e-5, "without planes it is a mean");
        for (x, z) in [(0, 2), (1, 2), (0, 3), (1, 3)] {
            for (y, offset) in [(0, 0.75), (1, 0.3)] {
                assert!(volume.set_plane(IVec3::new(x, y, z), 2, plane::encode(offset)));
            }
        }
        assert!((read(&volume, 0.75) - 1.0).abs() < 0.15, "{}", read(&volume, 0.75));
        assert!((read(&volume, 1.3) - 5.0).abs() < 0.15, "{}", read(&volume, 1.3));
        assert_eq!(volume.without_air(), volume, "planes stay with their surfaces");
    }

    #[test]
    fn a_patch_keeps_its_place_against_a_receiver() {
        let mut volume = Volume::new(layout()).unwrap();
        let voxel = IVec3::new(0, 0, 2);
        volume.set_receiver(voxel, 2, Vec3::splat(5.0), Vec3::ZERO, 255);
        volume.set_patch(voxel, 2, Vec3::ONE, Vec3::ZERO, 255);
        volume.set_receiver(voxel, 2, Vec3::splat(7.0), Vec3::ZERO, 255);
        let light = volume.at(voxel).unwrap();
        assert_eq!((light.irradiance[2], light.air), (Vec3::ONE, 0));
    }

    #[test]
    fn coarser_volumes_answer_where_finer_ones_cannot() {
        let fine = Volume::new(layout()).unwrap();
        let place = Layout { level: 1, voxel_edge_m: 2.0 * EDGE_M, ..layout() };
        let mut coarse = Volume::new(place).unwrap();
        coarse.set_patch(IVec3::new(0, 0, 1), 2, Vec3::splat(7.0), Vec3::ZERO, 255);
        let read = lookup(&[&fine, &coarse], inside(), Vec3::Y).unwrap();
        assert_eq!((read.level, read.irradiance.x), (1, 7.0));
        assert_eq!(lookup::<Volume>(&[], inside(), Vec3::Y), None);
    }

    #[test]
    fn no_number_makes_it_panic_or_answer_with_nan() {
        let volume = filled(|_, _| Vec3::splat(f32::MAX / 64.0));
        let odd =
            [0.0, -0.0, 1e-45, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e9, 0.5, 1.75, -1.5];
        for x in odd {
            for y in odd {
                for z in odd {
                    for v in [Vec3::new(x, y, z), Vec3::new(z, x, 1.5)] {
                        for (position, normal) in [(v, Vec3::Y), (inside(), v), (v, v)] {
                            if let Some(read) = lookup(&[&volume], position, normal) {
                                assert!(read.irradiance.is_finite(), "{position} {normal}");
                            }
                        }
                    }
                }
            }
        }
    }
}
