//! The lookup rule: what light a point with a normal reads from the voxels around it.
//!
//! `I(x, n) = sum_a n_a^2 I_a(x)` over the three directions that `n` faces. `I_a` is trilinear over the eight
//! voxels around `x + 0.25 voxel * n`; voxels without a patch on that direction are skipped and the rest is
//! divided by the weight that is left. A direction with nothing left gives its `n_a^2` to the others; a
//! volume with nothing at all leaves the point to the next coarser one.

use crate::Volume;
use glam::{IVec3, Vec3};
use std::borrow::Borrow;

/// How far a point reads in front of its surface, in voxels: a surface at a voxel's border reads the voxel it faces.
pub const NORMAL_OFFSET_VOXELS: f32 = 0.25;

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
    /// Level of the volume that answered: 0 is the finest.
    pub level: u8,
}

/// Light at `position` (m) on a surface with `normal` (any length but zero), from the first of `volumes`
/// (finest first) that has any. `None` where none has, and for numbers that are not finite.
#[must_use]
pub fn lookup<V: Borrow<Volume>>(volumes: &[V], position: Vec3, normal: Vec3) -> Option<LookedUp> {
    let normal = normal.try_normalize()?;
    if !position.is_finite() {
        return None;
    }
    volumes.iter().find_map(|volume| lookup_in(volume.borrow(), position, normal))
}

#[derive(Clone, Copy, Default)]
struct Sum {
    irradiance: Vec3,
    sky_irradiance: Vec3,
    quality: f32,
    weight: f32,
}

impl Sum {
    fn add(&mut self, weight: f32, irradiance: Vec3, sky_irradiance: Vec3, quality: f32) {
        self.irradiance += weight * irradiance;
        self.sky_irradiance += weight * sky_irradiance;
        self.quality += weight * quality;
        self.weight += weight;
    }

    /// Divided by its weight; `None` where there is next to none.
    fn mean(&self) -> Option<Self> {
        (self.weight > WEIGHT_MIN).then(|| Self {
            irradiance: self.irradiance / self.weight,
            sky_irradiance: self.sky_irradiance / self.weight,
            quality: self.quality / self.weight,
            weight: 1.0,
        })
    }
}

fn lookup_in(volume: &Volume, position: Vec3, normal: Vec3) -> Option<LookedUp> {
    let layout = volume.layout();
    // In voxels from the centre of the lowest one.
    let local =
        position / layout.voxel_edge_m + NORMAL_OFFSET_VOXELS * normal - 0.5 - layout.origin.as_vec3();
    let is_near = local.cmpge(Vec3::splat(-1.0)).all() && local.cmple(layout.dims.as_vec3()).all();
    if !is_near {
        return None;
    }
    let low = local.floor();
    let fraction = local - low;
    let low = layout.origin + low.as_ivec3();

    let directions = [0, 1, 2].map(|axis| axis * 2 + usize::from(normal[axis] < 0.0));
    let mut sums = [Sum::default(); 3];
    for corner in 0..8 {
        let step = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
        let Some(light) = volume.at(low + step) else { continue };
        let along = |axis: usize| if step[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] };
        let weight = along(0) * along(1) * along(2);
        for (sum, &direction) in sums.iter_mut().zip(&directions) {
            if light.has(direction) {
                let quality = f32::from(light.quality[direction]) / 255.0;
                sum.add(weight, light.irradiance[direction], light.sky_irradiance[direction], quality);
            }
        }
    }

    let mut total = Sum::default();
    for (axis, sum) in sums.iter().enumerate() {
        if let Some(mean) = sum.mean() {
            total.add(normal[axis] * normal[axis], mean.irradiance, mean.sky_irradiance, mean.quality);
        }
    }
    let Sum { irradiance, sky_irradiance, quality, .. } = total.mean()?;
    Some(LookedUp { irradiance, sky_irradiance, quality, level: layout.level })
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

    /// All six patches in every voxel, as `field` says at the voxel's centre.
    fn filled(field: impl Fn(Vec3, usize) -> Vec3) -> Volume {
        let mut volume = Volume::new(layout()).unwrap();
        for index in 0..layout().voxel_count() {
            let voxel = layout().voxel_of(index);
            let centre = (voxel.as_vec3() + 0.5) * EDGE_M;
            for direction in 0..6 {
                let light = field(centre, direction);
                assert!(volume.set_patch(voxel, direction, light, light * 0.25, 255));
            }
        }
        volume
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
