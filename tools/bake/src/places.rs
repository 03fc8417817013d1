//! Which patches a place on a surface belongs to: what a ray's hit asks.
//!
//! Axis-aligned patches are found by voxel and normal. Clusters are found by the piece of surface (what one voxel
//! cuts from one side of a triangle), and on it by the nearest sample; a piece without samples goes to the cluster
//! of its voxel that faces its way most.

use crate::patches::PatchSet;
use crate::sample::side_weights;
use crate::voxel_map::VoxelMap;
use earthshine_world::{AxisWeights, Vec3, VoxelCoord};

/// A place on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// See [`crate::sample::side_of`].
    pub side: u32,
    /// See [`crate::sample::voxel_of`].
    pub voxel: VoxelCoord,
    /// m.
    pub position: Vec3,
    /// Unit normal of the side.
    pub normal: Vec3,
}

/// Patches and the share of a place that is theirs; [`PatchSet::NONE`] where there is no patch.
pub type Owners = [(u32, f32); 3];

/// From places to patches. Only looked up, never iterated.
#[derive(Debug, Clone)]
pub(crate) enum Places {
    /// Patch of each (voxel, direction).
    Axis { by_voxel: VoxelMap<VoxelCoord, [u32; 6]>, weights: AxisWeights },
    /// Clusters.
    Clusters(ClusterPlaces),
}

/// Clusters by piece and by voxel.
#[derive(Debug, Default, Clone)]
pub(crate) struct ClusterPlaces {
    pieces: VoxelMap<(u32, VoxelCoord), Vec<(Vec3, u32)>>,
    voxels: VoxelMap<VoxelCoord, Vec<(Vec3, u32)>>,
}

impl Places {
    /// Patches of `voxel` by direction; none where patches are clusters.
    pub(crate) fn of_voxel(&self, voxel: VoxelCoord) -> [u32; 6] {
        match self {
            Self::Axis { by_voxel, .. } => by_voxel.get(&voxel).copied().unwrap_or([PatchSet::NONE; 6]),
            Self::Clusters(_) => [PatchSet::NONE; 6],
        }
    }

    /// Whose `place` is.
    pub(crate) fn owners(&self, place: &Place) -> Owners {
        match self {
            Self::Axis { weights, .. } => {
                let patches = self.of_voxel(place.voxel);
                side_weights(*weights, place.normal)
                    .map(|(direction, weight)| (patches[direction.index()], weight))
            }
            Self::Clusters(places) => {
                [(places.owner(place), 1.0), (PatchSet::NONE, 0.0), (PatchSet::NONE, 0.0)]
            }
        }
    }
}

impl ClusterPlaces {
    /// Says that the sample at `place` belongs to `patch`, which faces `patch_normal`.
    pub(crate) fn add(&mut self, place: &Place, patch: u32, patch_normal: Vec3) {
        self.pieces.entry((place.side, place.voxel)).or_default().push((place.position, patch));
        let known = self.voxels.entry(place.voxel).or_default();
        if known.last().is_none_or(|&(_, last)| last != patch) {
            known.push((patch_normal, patch));
        }
    }

    fn owner(&self, place: &Place) -> u32 {
        if let Some(samples) = self.pieces.get(&(place.side, place.voxel)) {
            let distance = |sample: &&(Vec3, u32)| sample.0.distance_squared(place.position);
            let nearest = samples.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            return nearest.map_or(PatchSet::NONE, |&(_, patch)| patch);
        }
        let facing = |&&(normal, _): &&(Vec3, u32)| normal.dot(place.normal);
        self.voxels.get(&place.voxel).map_or(PatchSet::NONE, |clusters| {
            let ahead = clusters.iter().filter(|cluster| facing(cluster) > 0.0);
            ahead.max_by(|a, b| facing(a).total_cmp(&facing(b))).map_or(PatchSet::NONE, |&(_, patch)| patch)
        })
    }
}
