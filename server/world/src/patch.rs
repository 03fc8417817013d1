//! Patches: the smallest pieces with one direction and one exitance.

use crate::{ChunkId, Direction, Rgb, VoxelCoord};
use glam::Vec3;

/// Who a patch is, wherever it is resident: its chunk and its place there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PatchId {
    /// The chunk that owns it.
    pub chunk: ChunkId,
    /// Index into that chunk's patches.
    pub local: u16,
}

/// An axis-aligned virtual patch: what faces `direction` inside `voxel`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// The voxel it lies in.
    pub voxel: VoxelCoord,
    /// Where it faces.
    pub direction: Direction,
    /// `sum w_a s_p` over its points, m2. Positive.
    pub area: f32,
    /// Weighted mean of its points, m.
    pub centroid: Vec3,
    /// Diffuse reflectance, 0..=0.98 a channel, area-weighted.
    pub reflectance: Rgb,
    /// Emitted exitance `pi * L_emitted`, lm/m2, area-weighted.
    pub emission: Rgb,
    /// First of its sample points in the chunk's list.
    pub point_first: u32,
    /// How many sample points it has; at least one.
    pub point_count: u32,
}

impl Patch {
    /// Whether it is of what emits: in one voxel and direction that is a patch of its own.
    #[must_use]
    pub fn emits(&self) -> bool {
        self.emission != Rgb::ZERO
    }

    /// Where in its voxel its surface lies along the axis of its direction, in voxel edges from the low side, 0..=1.
    #[must_use]
    pub fn plane_offset(&self, voxel_edge_m: f32) -> f32 {
        let axis = self.direction.axis();
        (self.centroid[axis] / voxel_edge_m - self.voxel[axis] as f32).clamp(0.0, 1.0)
    }

    /// Most reflectance a patch may have: above it closed rooms take hundreds of bounces to settle.
    pub const REFLECTANCE_MAX: f32 = 0.98;
}

/// A point on a real surface that stands for a share of its patch, for direct light.
///
/// Points are stored once a patch; each stands for an equal share of the patch's area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SamplePoint {
    /// On the surface, m.
    pub position: Vec3,
    /// Of the surface's side, unit; not the patch's direction.
    pub normal: Vec3,
}
