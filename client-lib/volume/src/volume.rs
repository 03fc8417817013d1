//! The light of a box of voxels: an index, and a block for each voxel that has light.
//!
//! A volume copies in time proportional to its lit voxels, and a byte for each sixteen of all, so that a client can publish one
//! a frame. It knows nothing of generations or of the wire.

use crate::barrier::{self, Barriers};
use crate::places::Places;
use crate::tilt::{self, Tilt};
use crate::{Layout, LayoutError, plane};
use glam::{IVec3, Vec3};
use std::borrow::Borrow;

/// Light on up to six patches of one voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelLight {
    /// Bit `a` says that direction `a` has light: a patch's or a receiver's.
    pub present: u8,
    /// Bit `a` says that the light of direction `a` is a receiver's: of the voxel's empty air, not of a surface.
    /// No bit is set that is not set in `present`.
    pub air: u8,
    /// Share of the patch's surroundings that its light rests on, 0..=255 for 0..=1.
    pub quality: [u8; 6],
    /// The part of `quality` that coarse levels stand for.
    pub far: [u8; 6],
    /// How old the direct light is that a patch reflects: 0 for up to date, else 1 + log2 of its age in the server's ticks.
    pub staleness: [u8; 6],
    /// All indirect irradiance and the sky, lx. Finite; zero where there is no patch.
    pub irradiance: [Vec3; 6],
    /// The part of it that came straight from the sky, lx.
    pub sky_irradiance: [Vec3; 6],
    /// Where in the voxel the surface lies: see [`plane::encode`].
    pub plane: [u8; 6],
    /// The same with the surface's normal, which goes before: see [`tilt::trust`].
    pub tilt: [Tilt; 6],
    /// Where walls end what the light stands for: see [`barrier::trust`].
    pub barriers: [Barriers; 6],
}

impl VoxelLight {
    /// No patches.
    pub const EMPTY: Self = Self {
        present: 0,
        air: 0,
        quality: [0; 6],
        far: [0; 6],
        staleness: [0; 6],
        irradiance: [Vec3::ZERO; 6],
        sky_irradiance: [Vec3::ZERO; 6],
        plane: [plane::UNKNOWN; 6],
        tilt: [tilt::UNKNOWN; 6],
        barriers: [barrier::NONE; 6],
    };
    /// All six bits of [`Self::present`].
    pub const ALL_PRESENT: u8 = 0b11_1111;

    /// Whether direction `direction` (0..6) has light.
    #[must_use]
    pub fn has(&self, direction: usize) -> bool {
        self.present >> direction & 1 == 1
    }

    /// Whether the light of direction `direction` (0..6) is a receiver's.
    #[must_use]
    pub fn is_air(&self, direction: usize) -> bool {
        self.air >> direction & 1 == 1
    }

    /// Puts a patch on direction `direction`, its plane unknown, no walls beside it, nothing of it far or old. Channels that are not finite become zero.
    ///
    /// # Panics
    /// If `direction` is not 0..6.
    pub fn set(&mut self, direction: usize, irradiance: Vec3, sky_irradiance: Vec3, quality: u8) {
        let finite = |light: Vec3| if light.is_finite() { light } else { Vec3::ZERO };
        self.irradiance[direction] = finite(irradiance);
        self.sky_irradiance[direction] = finite(sky_irradiance);
        self.quality[direction] = quality;
        self.far[direction] = 0;
        self.staleness[direction] = 0;
        self.plane[direction] = plane::UNKNOWN;
        self.tilt[direction] = tilt::UNKNOWN;
        self.barriers[direction] = barrier::NONE;
        self.present |= 1 << direction;
        self.air &= !(1 << direction);
    }

    /// Puts a receiver on direction `direction`, unless a patch is there. Channels that are not finite become zero.
    ///
    /// # Panics
    /// If `direction` is not 0..6.
    pub fn set_air(&mut self, direction: usize, irradiance: Vec3, sky_irradiance: Vec3, quality: u8) {
        if !self.has(direction) || self.is_air(direction) {
            self.set(direction, irradiance, sky_irradiance, quality);
            self.air |= 1 << direction;
        }
    }
}

/// Light of the voxels in a [`Layout`].
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    layout: Layout,
    /// In `lights`.
    places: Places,
    lights: Vec<VoxelLight>,
    /// The voxel that owns each of `lights`; the last one fills a gap.
    owners: Vec<u32>,
}

impl Volume {
    /// A box without light.
    ///
    /// # Errors
    /// If the layout is not valid.
    pub fn new(layout: Layout) -> Result<Self, LayoutError> {
        layout.validate()?;
        let places = Places::new(layout.voxel_count());
        Ok(Self { layout, places, lights: Vec::new(), owners: Vec::new() })
    }

    /// Where it is.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// How many of `volumes`, from the first on, are layers of this one: as fine, of the same level.
    pub(crate) fn layer_count<V: Borrow<Self>>(&self, volumes: &[V]) -> usize {
        let size = |volume: &Self| (volume.layout.level, volume.layout.voxel_edge_m);
        volumes.iter().take_while(|other| size((*other).borrow()) == size(self)).count()
    }

    /// Voxels that have light.
    #[must_use]
    pub fn lit_voxels(&self) -> usize {
        self.lights.len()
    }

    /// Patches and receivers that have light.
    #[must_use]
    pub fn patch_count(&self) -> usize {
        self.lights.iter().map(|light| light.present.count_ones() as usize).sum()
    }

    /// Light of the voxel with linear `index`; `None` where there is none, and outside.
    #[must_use]
    pub fn get(&self, index: u32) -> Option<&VoxelLight> {
        self.lights.get(self.places.get(index)? as usize)
    }

    /// Light of `voxel`, in voxels of the volume's level.
    #[must_use]
    pub fn at(&self, voxel: IVec3) -> Option<&VoxelLight> {
        self.get(self.layout.index_of(voxel)?)
    }

    /// Replaces the light of the voxel with linear `index`; a light without patches removes it.
    /// Says whether `index` is inside.
    pub fn set(&mut self, index: u32, light: &VoxelLight) -> bool {
        if !self.places.has(index) {
            return false;
        }
        match (self.places.get(index), light.present & VoxelLight::ALL_PRESENT) {
            (None, 0) => {}
            (None, _) => {
                // At most `Layout::VOXELS_MAX` lights.
                self.places.set(index, self.lights.len() as u32);
                self.lights.push(*light);
                self.owners.push(index);
            }
            (Some(place), 0) => {
                self.places.remove(index);
                self.remove(place);
            }
            (Some(place), _) => self.lights[place as usize] = *light,
        }
        true
    }

    /// Puts one patch into `voxel`, beside those already there. Says whether `voxel` is inside.
    ///
    /// # Panics
    /// If `direction` is not 0..6.
    pub fn set_patch(
        &mut self,
        voxel: IVec3,
        direction: usize,
        irradiance: Vec3,
        sky_irradiance: Vec3,
        quality: u8,
    ) -> bool {
        self.change(voxel, |light| light.set(direction, irradiance, sky_irradiance, quality))
    }

    /// Says where in `voxel` the surface of the patch on `direction` lies: see [`plane::encode`]. Says whether `voxel` is
    /// inside.
    ///
    /// # Panics
    /// If `direction` is not 0..6.
    pub fn set_plane(&mut self, voxel: IVec3, direction: usize, code: u8) -> bool {
        self.change(voxel, |light| light.plane[direction] = code)
    }

    /// Says in which plane the surface of the patch on `direction` lies: see [`tilt::trust`]. Says whether `voxel` is inside.
    ///
    /// # Panics
    /// If `direction` is not 0..6.
    pub fn set_tilt(&mut self, voxel: IVec3, direction: usize, tilt: Tilt) -> bool {
        self.change(voxel, |light| light.tilt[direction] = tilt)
    }

    /// Says where walls end what the light of `voxel` on `direction` stands for: see [`barrier::trust`]. Says whether `voxel` is
    /// inside.
    ///
    /// # Panics
    /// If `direction` is not 0..6.
    pub fn set_barriers(&mut self, voxel: IVec3, direction: usize, barriers: Barriers) -> bool {
        self.change(voxel, |light| light.barriers[direction] = barriers)
    }

    /// Puts one receiver into `voxel`, unless a patch is on `direction`. Says whether `voxel` is inside.
    ///
    /// # Panics
    /// If `direction` is not 0..6.
    pub fn set_receiver(
        &mut self,
        voxel: IVec3,
        direction: usize,
        irradiance: Vec3,
        sky_irradiance: Vec3,
        quality: u8,
    ) -> bool {
        self.change(voxel, |light| light.set_air(direction, irradiance, sky_irradiance, quality))
    }

    /// The same light without that of the air: what surfaces alone would answer.
    #[must_use]
    pub fn without_air(&self) -> Self {
        let mut surfaces = self.clone();
        for index in 0..self.layout.voxel_count() {
            if let Some(light) = self.get(index).filter(|light| light.air != 0) {
                let mut kept = VoxelLight::EMPTY;
                for direction in (0..6).filter(|&direction| light.has(direction) && !light.is_air(direction))
                {
                    let (all, sky) = (light.irradiance[direction], light.sky_irradiance[direction]);
                    kept.set(direction, all, sky, light.quality[direction]);
                    kept.plane[direction] = light.plane[direction];
                    kept.tilt[direction] = light.tilt[direction];
                    kept.barriers[direction] = light.barriers[direction];
                    kept.far[direction] = light.far[direction];
                    kept.staleness[direction] = light.staleness[direction];
                }
                surfaces.set(index, &kept);
            }
        }
        surfaces
    }

    /// Removes all light.
    pub fn clear(&mut self) {
        self.places.clear();
        self.owners.clear();
        self.lights.clear();
    }

    /// Moves or resizes the box; voxels in both places keep their light. Another level or voxel edge is another
    /// volume: nothing is kept.
    ///
    /// # Errors
    /// If the layout is not valid; the volume is as before.
    pub fn move_to(&mut self, layout: Layout) -> Result<(), LayoutError> {
        if layout == self.layout {
            return Ok(());
        }
        let mut moved = Self::new(layout)?;
        if layout.level == self.layout.level && layout.voxel_edge_m == self.layout.voxel_edge_m {
            for (voxel, light) in self.iter() {
                if let Some(index) = layout.index_of(voxel) {
                    moved.set(index, light);
                }
            }
        }
        *self = moved;
        Ok(())
    }

    /// All voxels with light, in no particular order that lasts.
    pub fn iter(&self) -> impl Iterator<Item = (IVec3, &VoxelLight)> {
        self.owners.iter().map(|&index| self.layout.voxel_of(index)).zip(&self.lights)
    }

    /// Says whether `voxel` is inside.
    fn change(&mut self, voxel: IVec3, change: impl FnOnce(&mut VoxelLight)) -> bool {
        let Some(index) = self.layout.index_of(voxel) else { return false };
        let mut light = self.get(index).copied().unwrap_or(VoxelLight::EMPTY);
        change(&mut light);
        self.set(index, &light)
    }

    fn remove(&mut self, place: u32) {
        self.lights.swap_remove(place as usize);
        self.owners.swap_remove(place as usize);
        if let Some(&owner) = self.owners.get(place as usize) {
            self.places.set(owner, place);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::UVec3;

    fn layout() -> Layout {
        Layout { level: 0, origin: IVec3::new(-2, 0, 1), dims: UVec3::splat(6), voxel_edge_m: 1.0 }
    }

    fn light(value: f32) -> VoxelLight {
        let mut light = VoxelLight::EMPTY;
        light.set(2, Vec3::splat(value), Vec3::ZERO, 255);
        light
    }

    /// Goal: blocks never get mixed up. Method: sets and removals in a scrambled order beside a plain map.
    #[test]
    fn a_volume_is_a_map_of_voxels() {
        let mut volume = Volume::new(layout()).unwrap();
        let mut model = std::collections::BTreeMap::new();
        for step in 0..5_000u32 {
            let index = step.wrapping_mul(2_654_435_761) >> 8 & 255;
            let inside = index < 216;
            if step % 3 == 0 {
                assert_eq!(volume.set(index, &VoxelLight::EMPTY), inside);
                model.remove(&index);
            } else {
                assert_eq!(volume.set(index, &light(step as f32)), inside);
                if inside {
                    model.insert(index, light(step as f32));
                }
            }
            assert_eq!(volume.lit_voxels(), model.len());
        }
        for index in 0..216 {
            assert_eq!(volume.get(index), model.get(&index));
        }
        volume.clear();
        assert_eq!(volume, Volume::new(layout()).unwrap());
    }

    #[test]
    fn a_move_keeps_the_overlap_only() {
        let mut volume = Volume::new(layout()).unwrap();
        for index in 0..216 {
            volume.set(index, &light(index as f32 + 1.0));
        }
        let before = volume.clone();
        let place = Layout { origin: IVec3::new(0, -1, 1), dims: UVec3::new(6, 4, 3), ..layout() };
        volume.move_to(place).unwrap();
        for index in 0..place.voxel_count() {
            let voxel = place.voxel_of(index);
            assert_eq!(volume.at(voxel), before.at(voxel), "{voxel}");
        }
        assert_eq!(volume.lit_voxels(), 4 * 3 * 3);
        assert!(volume.move_to(Layout { voxel_edge_m: -1.0, ..place }).is_err());
        assert_eq!(*volume.layout(), place, "as before");
        volume.move_to(Layout { level: 1, voxel_edge_m: 2.0, ..place }).unwrap();
        assert_eq!(volume.lit_voxels(), 0);
    }

    #[test]
    fn patches_of_a_voxel_add_up_and_bad_numbers_stay_out() {
        let mut volume = Volume::new(layout()).unwrap();
        assert!(volume.set_patch(IVec3::new(-2, 0, 1), 0, Vec3::ONE, Vec3::ZERO, 10));
        assert!(volume.set_patch(IVec3::new(-2, 0, 1), 3, Vec3::NAN, Vec3::ONE, 20));
        assert!(!volume.set_patch(IVec3::new(9, 0, 1), 3, Vec3::ONE, Vec3::ONE, 20));
        let light = volume.at(IVec3::new(-2, 0, 1)).unwrap();
        assert_eq!((light.present, light.irradiance[3]), (0b1001, Vec3::ZERO));
        assert_eq!((volume.patch_count(), volume.lit_voxels()), (2, 1));
    }
}
