//! The published, immutable result of a tick, for one session.

use crate::SessionId;
use earthshine_world::{Barrier, Direction, Rgb, SurfacePlane, VoxelCoord};
use std::sync::Arc;

/// Light on one patch or receiver, and how good it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchLight {
    /// Which voxel.
    pub voxel: VoxelCoord,
    /// Which side of it.
    pub direction: Direction,
    /// All indirect irradiance and the sky, lx (DESIGN section 2's "what is served").
    pub irradiance: Rgb,
    /// The part of it that came straight from the sky, lx.
    pub sky_irradiance: Rgb,
    /// Where in the voxel the surface lies along the axis of `direction`, in voxel edges from the low side, 0..=1.
    /// Nothing of a receiver.
    pub plane_offset: Option<f32>,
    /// Of detail: which of the layers that share the detail voxel and the direction. Else 0.
    pub layer: u8,
    /// Of detail: the plane that the layer lies in, in its detail voxel.
    pub tilt: Option<SurfacePlane>,
    /// Of detail: where walls end the layer. Else none.
    pub barriers: [Option<Barrier>; Barrier::PER_LAYER_MAX],
    /// Share of the row that is resident or sky or absorbed, 0..=1: what the light rests on.
    pub known_share: f32,
    /// Share of the row whose columns exist but are not resident, 0..=1.
    pub far_share: f32,
    /// Of the far share: what coarse levels bring, 0..=1. The rest of it is a gap that brings no light.
    pub fed_share: f32,
    /// Of a patch: how old its direct light is. 0 where it is up to date; where lights or casters have changed since, one more than
    /// the binary logarithm of its age in ticks, rounded down. 0 of a receiver.
    pub staleness: u8,
}

/// Light of one coarse level.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelLight {
    /// 1 or more.
    pub level: u8,
    /// Every resident patch whose light is known, ascending by voxel (x, y, z), then direction.
    pub patches: Arc<[PatchLight]>,
}

/// How complete a frame is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrameQuality {
    /// Patches of level 0 that hold slots.
    pub resident_patches: u32,
    /// Patches the camera would want with the present capacity.
    pub wanted_patches: u32,
    /// Patches whose direct light is older than the newest change of lights or occluders.
    pub stale_direct: u32,
    /// Patches within the promised radius of the camera that have no light of level 0; 0 where nothing is promised.
    pub missing_near: u32,
    /// Whether everything wanted is resident and nothing is stale, on all levels.
    pub settled: bool,
}

/// One session's light, whole. Lists that are equal to those of the session's frame before are the same allocation: who
/// has seen one need not look again.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Whose.
    pub session: SessionId,
    /// Counts published frames of the session, from 1.
    pub number: u64,
    /// The tick's time, s.
    pub time_s: f64,
    /// Edge of the voxels below, m.
    pub voxel_edge_m: f32,
    /// Every resident patch of level 0 whose light is known, ascending by voxel (x, y, z), then direction.
    pub patches: Arc<[PatchLight]>,
    /// Light in empty air near the camera: receivers, ascending like `patches`. None is where a patch is resident.
    pub receivers: Arc<[PatchLight]>,
    /// Detail of the surfaces nearest to the camera: `voxel` is a detail voxel, ascending like `patches`, then by layer. Only where the patch of
    /// the voxel around it is resident.
    pub details: Arc<[PatchLight]>,
    /// The coarser levels, finer first; what is beyond them has no light.
    pub coarse: Vec<LevelLight>,
    /// How complete it is.
    pub quality: FrameQuality,
}

impl Frame {
    /// Every resident patch of `level`; nothing where there is no such level.
    #[must_use]
    pub fn patches_of(&self, level: u8) -> Option<&Arc<[PatchLight]>> {
        match self.coarse.iter().find(|light| light.level == level) {
            Some(light) => Some(&light.patches),
            None => (level == 0).then_some(&self.patches),
        }
    }
}
