//! Where hits find no patch although their voxel has one: dark surfaces right behind glowing ones.
//!
//! The ceiling behind a lamp faces the way the lamp does and lies in the same voxel. The patch there is the
//! lamp; what hits the ceiling behind it must not be taken for light from the lamp. Other hits on surfaces
//! that their patch left out count as hits on the patch: corners must not lose light.

use crate::sample::SurfaceSample;
use crate::voxel_map::VoxelMap;
use earthshine_world::{Vec3, VoxelCoord};
use std::collections::HashSet;

/// A piece of one side of a triangle: what one voxel cuts from it.
type Piece = (u32, VoxelCoord);

/// The pieces that have left-out samples, with all of their samples. Only looked up, never iterated.
#[derive(Debug, Default)]
pub struct HiddenPlaces {
    pieces: VoxelMap<Piece, Vec<(Vec3, bool)>>,
}

impl HiddenPlaces {
    /// Collects the pieces of the samples that are left out.
    #[must_use]
    pub fn collect(samples: &[SurfaceSample], is_left_out: &[bool]) -> Self {
        let concerned: HashSet<Piece> = samples
            .iter()
            .zip(is_left_out)
            .filter(|(_, left_out)| **left_out)
            .map(|(sample, _)| (sample.side, sample.voxel))
            .collect();
        let mut pieces: VoxelMap<Piece, Vec<(Vec3, bool)>> = VoxelMap::default();
        for (sample, &left_out) in samples.iter().zip(is_left_out) {
            let piece = (sample.side, sample.voxel);
            if concerned.contains(&piece) {
                pieces.entry(piece).or_default().push((sample.position, left_out));
            }
        }
        Self { pieces }
    }

    /// Whether `place` on side `side` of a triangle, in `voxel`, lies nearest to a left-out sample.
    #[must_use]
    pub fn contains(&self, side: u32, voxel: VoxelCoord, place: Vec3) -> bool {
        if self.pieces.is_empty() {
            return false;
        }
        let distance = |sample: &&(Vec3, bool)| sample.0.distance_squared(place);
        self.pieces.get(&(side, voxel)).is_some_and(|samples| {
            let nearest = samples.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            nearest.is_some_and(|(_, left_out)| *left_out)
        })
    }
}
