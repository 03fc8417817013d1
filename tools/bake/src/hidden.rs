//! Where hits find no patch although their voxel has one: dark surfaces right behind glowing ones.
//!
//! The ceiling behind a lamp faces the way the lamp does and lies in the same voxel. The patch there is the
//! lamp; what hits the ceiling behind it must not be taken for light from the lamp. Other hits on surfaces
//! that their patch left out count as hits on the patch: corners must not lose light.

use crate::sample::SurfaceSample;
use crate::voxel_map::VoxelMap;
use earthshine_world::{Vec3, VoxelCoord};
use std::collections::HashSet;

/// One sample of such a piece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PieceSample {
    /// See [`crate::sample::side_of`].
    pub side: u32,
    /// Of the piece.
    pub voxel: VoxelCoord,
    /// m.
    pub position: Vec3,
    /// Whether its patch left it out.
    pub left_out: bool,
}

/// A piece of one side of a triangle: what one voxel cuts from it.
type Piece = (u32, VoxelCoord);

/// The pieces that have left-out samples, with all of their samples.
#[derive(Debug, Default, Clone)]
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
        let mut places = Self::default();
        for (sample, &left_out) in samples.iter().zip(is_left_out) {
            let SurfaceSample { side, voxel, position, .. } = *sample;
            if concerned.contains(&(side, voxel)) {
                places.add(PieceSample { side, voxel, position, left_out });
            }
        }
        places
    }

    /// Adds a sample of a piece.
    pub fn add(&mut self, sample: PieceSample) {
        let PieceSample { side, voxel, position, left_out } = sample;
        self.pieces.entry((side, voxel)).or_default().push((position, left_out));
    }

    /// All samples; pieces in a fixed order.
    #[must_use]
    pub fn samples(&self) -> Vec<PieceSample> {
        let mut pieces: Vec<&Piece> = self.pieces.keys().collect();
        pieces.sort_unstable_by_key(|(side, voxel)| (voxel.to_array(), *side));
        let of_piece = |piece: &&Piece| {
            let (side, voxel) = **piece;
            let samples = self.pieces[*piece].iter();
            samples
                .map(move |&(position, left_out)| PieceSample { side, voxel, position, left_out })
                .collect::<Vec<_>>()
        };
        pieces.iter().flat_map(of_piece).collect()
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
