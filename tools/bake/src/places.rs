//! Which patches a place on a surface belongs to: what a ray's hit asks.
//!
//! Axis-aligned patches are found by voxel and normal. Clusters are found by the piece of surface (what one voxel
//! cuts from one side of a triangle), and on it by the nearest sample; a piece without samples goes to the cluster
//! of its voxel that faces its way most.

use crate::patches::PatchSet;
use crate::sample::side_weights;
use crate::voxel_map::VoxelMap;
use earthshine_world::{AxisWeights, Direction, Vec3, VoxelCoord};

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
    /// Whether light is emitted there.
    pub emits: bool,
}

/// Patches and the share of a place that is theirs; [`PatchSet::NONE`] where there is no patch.
pub type Owners = [(u32, f32); 3];

/// From places to patches. Only looked up, never iterated.
#[derive(Debug, Clone)]
pub(crate) enum Places {
    /// Patches by voxel and direction.
    Axis(AxisPlaces),
    /// Clusters.
    Clusters(ClusterPlaces),
}

/// Patch of each (voxel, direction), and that of what emits there where the rest has one of its own.
#[derive(Debug, Clone)]
pub(crate) struct AxisPlaces {
    by_voxel: VoxelMap<VoxelCoord, [u32; 6]>,
    emitters: VoxelMap<VoxelCoord, [u32; 6]>,
    weights: AxisWeights,
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
            Self::Axis(places) => places.of_voxel(voxel),
            Self::Clusters(_) => [PatchSet::NONE; 6],
        }
    }

    /// Whose `place` is.
    pub(crate) fn owners(&self, place: &Place) -> Owners {
        match self {
            Self::Axis(places) => places.owners(place),
            Self::Clusters(places) => {
                [(places.owner(place), 1.0), (PatchSet::NONE, 0.0), (PatchSet::NONE, 0.0)]
            }
        }
    }
}

impl AxisPlaces {
    /// No places yet; `weights` is how normals spread over directions.
    pub(crate) fn new(weights: AxisWeights) -> Self {
        Self { by_voxel: VoxelMap::default(), emitters: VoxelMap::default(), weights }
    }

    /// Says that `patch` faces `direction` in `voxel`: what emits there beside what does not, or what else there is.
    pub(crate) fn add(&mut self, voxel: VoxelCoord, direction: Direction, is_emitter: bool, patch: u32) {
        let places = if is_emitter { &mut self.emitters } else { &mut self.by_voxel };
        places.entry(voxel).or_insert([PatchSet::NONE; 6])[direction.index()] = patch;
    }

    /// The patches of `voxel` by direction, those of what does not emit where there are two.
    pub(crate) fn of_voxel(&self, voxel: VoxelCoord) -> [u32; 6] {
        self.by_voxel.get(&voxel).copied().unwrap_or([PatchSet::NONE; 6])
    }

    /// Those of what emits, where there are two.
    pub(crate) fn emitters(&self, voxel: VoxelCoord) -> [u32; 6] {
        self.emitters.get(&voxel).copied().unwrap_or([PatchSet::NONE; 6])
    }

    fn owners(&self, place: &Place) -> Owners {
        let patches = self.of_voxel(place.voxel);
        let emitters = if place.emits { self.emitters(place.voxel) } else { [PatchSet::NONE; 6] };
        side_weights(self.weights, place.normal).map(|(direction, weight)| {
            let emitter = emitters[direction.index()];
            (if emitter == PatchSet::NONE { patches[direction.index()] } else { emitter }, weight)
        })
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
