//! Up to eight chunks become one of the next level.
//!
//! ```text
//! A_P = sum A_i                               areas add
//! rho_P = sum A_i rho_i / A_P                 so do reflectance, emission, centroid, sky and absorbed shares
//! F_PQ = sum_i A_i sum_j F_ij / A_P           i in P, j in Q; P = Q is possible: a corner sees itself
//! ```
//!
//! Row sums and reciprocity are those of the children: sums are kept in f64 until they are stored.

use super::numbering::{Numbering, Place};
use super::occluders;
use crate::rows::patch_key;
use earthshine_tiles::BakeParameters;
use earthshine_world::random::{Purpose, hash, unit_f32};
use earthshine_world::{Chunk, ChunkId, ChunkRows, Column, Patch, Receivers, SamplePoint};
use glam::DVec3;

/// Most sample points of a coarse patch: what a tile can hold.
const POINTS_MAX: u32 = 64;

/// What one coarse chunk is merged from.
pub(super) struct Merge<'a> {
    /// Which coarse chunk.
    pub(super) id: ChunkId,
    /// Its children, ascending by id.
    pub(super) children: &'a [Chunk],
    /// Of its level.
    pub(super) numbering: &'a Numbering,
    /// Of the bake.
    pub(super) parameters: &'a BakeParameters,
}

impl Merge<'_> {
    /// The chunk.
    pub(super) fn chunk(&self) -> Chunk {
        let places = self.numbering.places(self.id);
        let (mut patches, mut points) = (Vec::with_capacity(places.len()), Vec::new());
        for place in places {
            let mut patch = self.patch(place);
            let chosen = self.points(place, f64::from(patch.area));
            patch.point_first = points.len() as u32;
            patch.point_count = chosen.len() as u32;
            points.extend(chosen);
            patches.push(patch);
        }
        let grid = self.parameters.grid.at_level(self.id.level);
        let meshes = self.children.iter().map(|child| &child.occluders);
        Chunk {
            id: self.id,
            patches,
            points,
            rows: self.rows(places),
            // Light in the air comes from level 0 alone, for now.
            receivers: Receivers::default(),
            occluders: occluders::merged(meshes, grid),
        }
    }

    /// The chunk and the index of each child of `place`.
    fn children_of<'s>(&'s self, place: &'s Place) -> impl Iterator<Item = (usize, usize, &'s Patch)> {
        place.children.iter().filter_map(|child| {
            let at = self.children.binary_search_by_key(&child.chunk, |chunk| chunk.id).ok()?;
            let local = usize::from(child.local);
            Some((at, local, &self.children[at].patches[local]))
        })
    }

    fn patch(&self, place: &Place) -> Patch {
        let mut area = 0.0f64;
        let (mut centroid, mut reflectance, mut emission) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        for (_, _, child) in self.children_of(place) {
            let own = f64::from(child.area);
            area += own;
            centroid += child.centroid.as_dvec3() * own;
            reflectance += child.reflectance.as_dvec3() * own;
            emission += child.emission.as_dvec3() * own;
        }
        Patch {
            voxel: place.voxel,
            direction: place.direction,
            area: area as f32,
            centroid: (centroid / area).as_vec3(),
            reflectance: (reflectance / area).as_vec3(),
            emission: (emission / area).as_vec3(),
            point_first: 0,
            point_count: 0,
        }
    }

    /// Some of the children's points, each for an equal share of the area.
    ///
    /// A coarse patch covers more surfaces than a fine one, so each level keeps twice as many points a patch as the
    /// one below, up to [`POINTS_MAX`]; there are about four times fewer patches.
    fn points(&self, place: &Place, area: f64) -> Vec<SamplePoint> {
        let mut cumulated: Vec<(f64, SamplePoint)> = Vec::new();
        let mut sum = 0.0;
        for (at, _, child) in self.children_of(place) {
            let own = self.children[at].points_of(child);
            for point in own {
                sum += f64::from(child.area) / own.len() as f64;
                cumulated.push((sum, *point));
            }
        }
        let wanted = self.parameters.points_per_patch.max(1) << u32::from(self.id.level).min(8);
        let count = (wanted.min(POINTS_MAX) as usize).min(cumulated.len());
        // Another level of the same voxel and direction is another choice.
        let key = hash(
            u64::from(self.id.level),
            Purpose::PointChoice,
            patch_key(place.voxel, place.direction.index()),
            1,
        );
        let shift = f64::from(unit_f32(hash(self.parameters.seed, Purpose::PointChoice, key, 0)));
        (0..count)
            .map(|i| {
                let target = (i as f64 + shift) / count as f64 * area;
                let found = cumulated.partition_point(|&(sum, _)| sum <= target);
                cumulated[found.min(cumulated.len() - 1)].1
            })
            .collect()
    }

    fn rows(&self, places: &[Place]) -> ChunkRows {
        let targets = Targets::of(self.children, self.numbering);
        let mut rows =
            ChunkRows { segments: targets.segments.clone(), row_starts: vec![0], ..ChunkRows::default() };
        let mut exchanges = vec![0.0f64; targets.count()];
        let mut touched: Vec<u32> = Vec::new();
        for place in places {
            let (mut area, mut absorbed, mut sky) = (0.0f64, 0.0f64, [0.0f64; 6]);
            for (at, local, child) in self.children_of(place) {
                let own = f64::from(child.area);
                area += own;
                let chunk = &self.children[at];
                for (column, share) in chunk.rows.row(local) {
                    let target = targets.of_column(at, column);
                    if exchanges[target as usize] == 0.0 {
                        touched.push(target);
                    }
                    exchanges[target as usize] += own * f64::from(share);
                }
                absorbed += own * f64::from(chunk.rows.absorbed_shares[local]);
                for (sum, share) in sky.iter_mut().zip(chunk.rows.sky_shares[local]) {
                    *sum += own * f64::from(share);
                }
            }
            touched.sort_unstable();
            touched.dedup();
            for target in touched.drain(..) {
                let exchange = std::mem::take(&mut exchanges[target as usize]);
                rows.columns.push(targets.column(target));
                rows.shares.push((exchange / area) as f32);
            }
            rows.row_starts.push(rows.columns.len() as u32);
            rows.sky_shares.push(sky.map(|sum| (sum / area) as f32));
            rows.absorbed_shares.push((absorbed / area) as f32);
        }
        rows
    }
}

/// Every coarse patch that the children's columns can lead to, in one numbering: by chunk, then patch.
struct Targets<'a> {
    /// Ascending.
    segments: Vec<ChunkId>,
    /// Number of the first patch of each of `segments`, and the number of all at the end.
    firsts: Vec<u32>,
    /// By child and segment of the child: first number and the parents' places in their chunk.
    of_child: Vec<Vec<(u32, &'a [u16])>>,
}

impl<'a> Targets<'a> {
    fn of(children: &[Chunk], numbering: &'a Numbering) -> Self {
        let mut segments: Vec<ChunkId> =
            children.iter().flat_map(|child| &child.rows.segments).map(|id| id.parent()).collect();
        segments.sort_unstable();
        segments.dedup();
        let mut firsts = vec![0u32];
        for &id in &segments {
            firsts.push(firsts[firsts.len() - 1] + numbering.places(id).len() as u32);
        }
        let of_child = children
            .iter()
            .map(|child| {
                let first = |id: &ChunkId| segments.partition_point(|segment| *segment < id.parent());
                child.rows.segments.iter().map(|id| (firsts[first(id)], numbering.parents(*id))).collect()
            })
            .collect();
        Self { segments, firsts, of_child }
    }

    fn count(&self) -> usize {
        self.firsts[self.firsts.len() - 1] as usize
    }

    fn of_column(&self, child: usize, column: Column) -> u32 {
        let (first, parents) = self.of_child[child][usize::from(column.segment)];
        first + u32::from(parents[usize::from(column.local)])
    }

    fn column(&self, target: u32) -> Column {
        let segment = self.firsts.partition_point(|&first| first <= target) - 1;
        Column { segment: segment as u16, local: (target - self.firsts[segment]) as u16 }
    }
}
