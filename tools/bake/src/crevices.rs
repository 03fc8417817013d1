//! Crevices: how bright places are, beside their patch, that it leaves out.
//!
//! A patch is what others see of its voxel: points that see hardly anything but what is nearer than a quarter of the voxel are
//! hidden, and it leaves them out ([`crate::exposure`]). A part of detail that lies in the crevice itself sees little else,
//! and the light of the open street is not theirs. So for parts beside them a hit on such a place counts for its patch by
//! the place's openness, the share of its rays that get out, and what is near it is taken to reflect a half of what it
//! gets: `o / (1 - (1 - o) / 2)`. The rest is absorbed. What emits does so in crevices too. No row hangs on paint.
//! Start at [`Crevices::of`].

use crate::detail::detail_voxel_of;
use crate::exposure::Exposure;
use crate::sample::{SurfaceSample, side_weights};
use crate::voxel_map::VoxelMap;
use earthshine_tiles::BakeParameters;
use earthshine_world::{AxisWeights, Direction, Vec3, VoxelCoord};
use glam::IVec3;
use std::collections::{BTreeMap, BTreeSet};

/// What surfaces in crevices reflect.
const REFLECTANCE: f32 = 0.5;

/// Of one chunk: the places that patches leave out.
#[derive(Debug, Default)]
pub(crate) struct Crevices {
    /// By side and detail voxel: what a hit there counts, mean over its points.
    counts: VoxelMap<(u32, VoxelCoord), f32>,
    /// Detail voxels with such places, and all around them.
    beside: BTreeSet<[i32; 3]>,
    /// `counts` in an order, for a hash.
    words: Vec<f32>,
}

impl Crevices {
    /// Those among `samples`, all of a chunk's.
    pub(crate) fn of(samples: &[&SurfaceSample], parameters: &BakeParameters) -> Self {
        let faced = |sample: &SurfaceSample| facing(parameters.weights, sample.normal);
        let is_open = |sample: &SurfaceSample| matches!(sample.exposure, Exposure::Open(_));
        let open: BTreeSet<([i32; 3], Direction)> = samples
            .iter()
            .filter(|sample| is_open(sample))
            .map(|sample| (sample.voxel.to_array(), faced(sample)))
            .collect();
        // Where nothing is open a patch stands for what is hidden.
        let count = |sample: &SurfaceSample| match sample.exposure {
            Exposure::Hidden(openness) if open.contains(&(sample.voxel.to_array(), faced(sample))) => {
                Some(counted(openness))
            }
            Exposure::Hidden(_) | Exposure::Open(_) => Some(1.0),
            Exposure::Buried => None,
        };
        let mut means: BTreeMap<(u32, [i32; 3]), (f32, f32)> = BTreeMap::new();
        for sample in samples {
            if let Some(count) = count(sample) {
                let at = detail_voxel_of(sample.voxel, sample.position, sample.normal, parameters);
                let mean = means.entry((sample.side, at.to_array())).or_default();
                *mean = (mean.0 + count * sample.area, mean.1 + sample.area);
            }
        }
        let mut found = Self::default();
        for ((side, at), (sum, area)) in means {
            let count = sum / area;
            if area > 0.0 && count < 1.0 {
                let at = VoxelCoord::from_array(at);
                found.counts.insert((side, at), count);
                found.words.push(count);
                found.beside.extend((0..27).map(|n| (at + around(n)).to_array()));
            }
        }
        found
    }

    /// What their places count, for a hash.
    pub(crate) fn words(&self) -> &[f32] {
        &self.words
    }

    /// Whether detail voxel `at` has such places or lies beside one that does.
    pub(crate) fn are_beside(&self, at: VoxelCoord) -> bool {
        self.beside.contains(&at.to_array())
    }

    /// How much a hit on `side` in detail voxel `at` counts: 1 in the open.
    pub(crate) fn count(&self, side: u32, at: VoxelCoord) -> f32 {
        self.counts.get(&(side, at)).copied().unwrap_or(1.0)
    }
}

/// Light of a place with `openness`, beside that in the open.
fn counted(openness: f32) -> f32 {
    openness / (1.0 - (1.0 - openness) * REFLECTANCE)
}

/// The direction that `normal` faces most.
fn facing(weights: AxisWeights, normal: Vec3) -> Direction {
    let most = side_weights(weights, normal).into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
    most.map_or(Direction::PosX, |(direction, _)| direction)
}

/// Steps to the 26 neighbours of a voxel, and none.
fn around(number: i32) -> IVec3 {
    IVec3::new(number % 3, number / 3 % 3, number / 9) - 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::point;
    use earthshine_world::Grid;

    /// Of a floor in a voxel of four metres: two points in detail voxels of their own, with these exposures.
    fn crevices(exposures: [Exposure; 2]) -> Crevices {
        let parameters = BakeParameters {
            grid: Grid { voxel_edge_m: 4.0, chunk_edge_voxels: 1 },
            detail: 4,
            ..BakeParameters::default()
        };
        let sample = |x: f32, exposure: Exposure| SurfaceSample {
            side: 4,
            exposure,
            ..point(Vec3::new(x, 0.0, 1.5), Vec3::Y, VoxelCoord::ZERO)
        };
        let samples = [sample(0.5, exposures[0]), sample(3.5, exposures[1])];
        Crevices::of(&samples.each_ref(), &parameters)
    }

    #[test]
    fn places_that_a_patch_leaves_out_count_by_their_openness() {
        let found = crevices([Exposure::Hidden(0.25), Exposure::Open(1.0)]);
        let under = VoxelCoord::new(0, 0, 1);
        let count = found.count(4, under);
        assert_eq!(count, counted(0.25));
        assert_eq!(found.words(), [count]);
        assert_eq!(found.count(4, VoxelCoord::new(3, 0, 1)), 1.0, "in the open");
        assert_eq!(found.count(5, under), 1.0, "the other side");
        assert!(found.are_beside(under) && found.are_beside(VoxelCoord::new(1, 1, 0)));
        assert!(!found.are_beside(VoxelCoord::new(2, 0, 1)));
    }

    #[test]
    fn a_patch_of_hidden_places_stands_for_them() {
        let found = crevices([Exposure::Hidden(0.25); 2]);
        assert!(found.words().is_empty() && !found.are_beside(VoxelCoord::new(0, 0, 1)));
    }

    #[test]
    fn what_is_near_reflects_a_half() {
        assert_eq!((counted(0.0), counted(1.0)), (0.0, 1.0));
        // In the open half it gets 0.5 from afar and half of its own light, reflected by what is near: x = 0.5 + 0.25 x.
        assert!((counted(0.5) - 0.5 / 0.75).abs() < 1e-6);
    }
}
