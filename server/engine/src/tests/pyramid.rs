//! Coarse levels of worlds made in memory: merged by area, as the bake does it, in f64.

use super::world::{GRID, RandomWorld};
use earthshine_light::Occluders;
use earthshine_world::lineage::{Lineage, parents_among};
use earthshine_world::{
    Chunk, ChunkId, ChunkRows, ChunkSummary, Column, Direction, Grid, OccluderMesh, Patch, PatchId,
    Receivers, Rgb, SamplePoint, Vec3,
};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

type Place = (ChunkId, [i32; 3], Direction);

impl RandomWorld {
    /// The same world with `levels` levels in all.
    pub(crate) fn with_levels(mut self, levels: u8) -> Self {
        for level in 1..levels {
            let finer: Vec<Arc<Chunk>> =
                self.chunks.values().filter(|chunk| chunk.id.level == level - 1).cloned().collect();
            for chunk in merged(&finer) {
                self.index.chunks.push(ChunkSummary {
                    id: chunk.id,
                    patch_count: chunk.patches.len() as u32,
                    nonzero_count: chunk.rows.columns.len() as u64,
                    tile_bytes: 100,
                });
                self.occluders.insert(chunk.id, Arc::new(Occluders::build(&OccluderMesh::default())));
                self.chunks.insert(chunk.id, Arc::new(chunk));
            }
        }
        self
    }

    /// What a loader would say of the ancestors of what `chunk` sees.
    pub(crate) fn lineage_of(&self, chunk: &Chunk) -> Arc<Lineage> {
        let mut lineage = Lineage::default();
        for &segment in chunk.rows.segments.iter().chain(&chunk.receivers.rows.segments) {
            let mut id = segment;
            while let (Some(fine), Some(coarse)) = (self.chunks.get(&id), self.chunks.get(&id.parent())) {
                lineage.insert(id, parents_among(&fine.patches, &coarse.patches).expect("parents"));
                id = id.parent();
            }
        }
        Arc::new(lineage)
    }

    /// Patches of `level`.
    pub(crate) fn patches_of_level(&self, level: u8) -> usize {
        self.chunks.values().filter(|chunk| chunk.id.level == level).map(|chunk| chunk.patches.len()).sum()
    }
}

fn merged(finer: &[Arc<Chunk>]) -> Vec<Chunk> {
    let place = |id: ChunkId, patch: &Patch| -> Place {
        (id.parent(), Grid::parent_voxel(patch.voxel).to_array(), patch.direction)
    };
    let mut families: BTreeMap<Place, Vec<(&Chunk, usize)>> = BTreeMap::new();
    let mut parents: BTreeMap<PatchId, Place> = BTreeMap::new();
    for chunk in finer {
        for (local, patch) in chunk.patches.iter().enumerate() {
            families.entry(place(chunk.id, patch)).or_default().push((chunk, local));
            parents.insert(PatchId { chunk: chunk.id, local: local as u16 }, place(chunk.id, patch));
        }
    }
    let mut numbers: BTreeMap<Place, u16> = BTreeMap::new();
    let mut counts: BTreeMap<ChunkId, u16> = finer.iter().map(|chunk| (chunk.id.parent(), 0)).collect();
    for place in families.keys() {
        let count = counts.get_mut(&place.0).unwrap();
        numbers.insert(*place, *count);
        *count += 1;
    }
    counts
        .keys()
        .map(|&id| {
            let own: Vec<_> = families.iter().filter(|(place, _)| place.0 == id).collect();
            let seen: BTreeSet<ChunkId> = own
                .iter()
                .flat_map(|(_, family)| family.iter())
                .flat_map(|(chunk, local)| chunk.rows.row(*local).map(|(c, _)| chunk.rows.patch_id(c)))
                .map(|target| target.chunk.parent())
                .collect();
            let segments = seen.into_iter().collect();
            let mut chunk = Chunk {
                id,
                patches: Vec::new(),
                points: Vec::new(),
                rows: ChunkRows { segments, row_starts: vec![0], ..ChunkRows::default() },
                receivers: Receivers::default(),
                occluders: OccluderMesh::default(),
            };
            for (place, family) in own {
                let exchanges = |target: PatchId| (parents[&target].0, numbers[&parents[&target]]);
                push_patch(&mut chunk, place, family, exchanges);
            }
            chunk
        })
        .collect()
}

fn push_patch(
    chunk: &mut Chunk,
    place: &Place,
    family: &[(&Chunk, usize)],
    parent_of: impl Fn(PatchId) -> (ChunkId, u16),
) {
    let area: f64 = family.iter().map(|(fine, local)| f64::from(fine.patches[*local].area)).sum();
    let mut row: BTreeMap<(ChunkId, u16), f64> = BTreeMap::new();
    let (mut sky, mut absorbed) = ([0.0f64; 6], 0.0f64);
    let (mut reflectance, mut emission, mut centroid) = (Rgb::ZERO, Rgb::ZERO, Vec3::ZERO);
    let point_first = chunk.points.len() as u32;
    for (fine, local) in family {
        let patch = &fine.patches[*local];
        let weight = f64::from(patch.area) / area;
        for (column, share) in fine.rows.row(*local) {
            *row.entry(parent_of(fine.rows.patch_id(column))).or_default() += weight * f64::from(share);
        }
        for (sum, share) in sky.iter_mut().zip(fine.rows.sky_shares[*local]) {
            *sum += weight * f64::from(share);
        }
        absorbed += weight * f64::from(fine.rows.absorbed_shares[*local]);
        reflectance += patch.reflectance * weight as f32;
        emission += patch.emission * weight as f32;
        centroid += patch.centroid * weight as f32;
        chunk.points.extend(fine.points_of(patch).iter().take(2).copied().collect::<Vec<SamplePoint>>());
    }
    for ((target, local), share) in row {
        let segment = chunk.rows.segments.binary_search(&target).unwrap() as u16;
        chunk.rows.columns.push(Column { segment, local });
        chunk.rows.shares.push(share as f32);
    }
    chunk.rows.row_starts.push(chunk.rows.columns.len() as u32);
    chunk.rows.sky_shares.push(sky.map(|share| share as f32));
    chunk.rows.absorbed_shares.push(absorbed as f32);
    chunk.patches.push(Patch {
        voxel: place.1.into(),
        direction: place.2,
        area: area as f32,
        centroid,
        reflectance,
        emission,
        point_first,
        point_count: chunk.points.len() as u32 - point_first,
    });
}

#[test]
fn merged_levels_keep_area_and_row_sums() {
    let world = RandomWorld::new(3, super::world::WorldShape::default()).with_levels(4);
    let area = |level: u8| -> f32 {
        let chunks = world.chunks.values().filter(|chunk| chunk.id.level == level);
        chunks.flat_map(|chunk| &chunk.patches).map(|patch| patch.area).sum()
    };
    for (id, chunk) in &world.chunks {
        let grid = GRID.at_level(id.level);
        assert!(chunk.patches.iter().all(|patch| grid.chunk_of(patch.voxel) == id.coord));
        assert!((0..chunk.patches.len()).all(|row| (chunk.rows.row_sum(row) - 1.0).abs() < 1e-4));
    }
    assert!((1..4).all(|level| (area(level) / area(0) - 1.0).abs() < 1e-4));
    assert!(world.patches_of_level(3) < world.patches_of_level(0));
}
