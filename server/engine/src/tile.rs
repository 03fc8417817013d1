//! A decoded chunk as the engine holds it: checked for what the engine relies on, and weighed.
//!
//! The tile reader has verified the bytes; this check is about structure, so that no index can be out of range
//! and no number can poison a matrix.

use crate::error::TileFault;
use earthshine_light::Occluders;
use earthshine_radiosity::invariant::row_sums_to_one;
use earthshine_world::lineage::Lineage;
use earthshine_world::{
    Chunk, ChunkRows, ChunkSummary, Direction, Grid, Patch, ReceiverPlace, Receivers, SamplePoint,
};
use std::mem::size_of;
use std::sync::Arc;

/// A chunk in memory.
#[derive(Debug, Clone)]
pub(crate) struct Tile {
    pub(crate) chunk: Arc<Chunk>,
    /// Ancestors of the patches that its rows lead to.
    pub(crate) lineage: Arc<Lineage>,
    /// Chunk, ancestors and shadow casters, bytes. Ancestors that other tiles know too count once each.
    pub(crate) bytes: u64,
    pub(crate) occluders: Arc<Occluders>,
}

impl Tile {
    /// Checks and weighs.
    pub(crate) fn new(
        chunk: Arc<Chunk>,
        lineage: Arc<Lineage>,
        occluders: Arc<Occluders>,
        grid: &Grid,
    ) -> Result<Self, TileFault> {
        check_patches(&chunk, grid)?;
        check_rows(&chunk.rows, chunk.patches.len())?;
        check_receivers(&chunk, grid)?;
        let bytes = (chunk_bytes(&chunk) + lineage.bytes() + occluders.bytes()) as u64;
        Ok(Self { chunk, lineage, bytes, occluders })
    }
}

/// What a chunk will weigh, guessed from the index, bytes.
pub(crate) fn estimated_bytes(summary: &ChunkSummary) -> u64 {
    const POINTS_PER_PATCH: usize = 16;
    const ROW_BYTES: usize = size_of::<[f32; 8]>();
    const NONZERO_BYTES: u64 = 8;
    let patch_bytes = size_of::<Patch>() + POINTS_PER_PATCH * size_of::<SamplePoint>() + ROW_BYTES;
    u64::from(summary.patch_count)
        .saturating_mul(patch_bytes as u64)
        .saturating_add(summary.nonzero_count.saturating_mul(NONZERO_BYTES))
        .saturating_add(summary.tile_bytes)
}

fn chunk_bytes(chunk: &Chunk) -> usize {
    size_of::<Chunk>()
        + size_of_val(chunk.patches.as_slice())
        + size_of_val(chunk.points.as_slice())
        + rows_bytes(&chunk.rows)
        + size_of_val(chunk.receivers.places.as_slice())
        + rows_bytes(&chunk.receivers.rows)
        + size_of_val(chunk.occluders.vertices.as_slice())
        + size_of_val(chunk.occluders.triangles.as_slice())
        + size_of_val(chunk.occluders.surfaces.as_slice())
}

fn rows_bytes(rows: &ChunkRows) -> usize {
    size_of_val(rows.segments.as_slice())
        + size_of_val(rows.row_starts.as_slice())
        + size_of_val(rows.columns.as_slice())
        + size_of_val(rows.shares.as_slice())
        + size_of_val(rows.sky_shares.as_slice())
        + size_of_val(rows.absorbed_shares.as_slice())
}

fn check_patches(chunk: &Chunk, grid: &Grid) -> Result<(), TileFault> {
    if chunk.patches.len() > Chunk::PATCHES_MAX {
        return Err(TileFault::Lengths);
    }
    let mut places = Vec::with_capacity(chunk.patches.len());
    for (index, patch) in chunk.patches.iter().enumerate() {
        let points = u64::from(patch.point_first) + u64::from(patch.point_count) <= chunk.points.len() as u64;
        let light =
            [patch.reflectance, patch.emission].iter().all(|rgb| rgb.is_finite() && rgb.min_element() >= 0.0);
        let shape = patch.area.is_finite() && patch.area > 0.0 && patch.centroid.is_finite();
        if !(points && light && shape && grid.chunk_of(patch.voxel) == chunk.id.coord) {
            return Err(TileFault::Patch(index));
        }
        places.push((patch.voxel.to_array(), patch.direction, index));
    }
    places.sort_unstable();
    let is_fault = |pair: &[([i32; 3], Direction, usize)]| {
        let [(voxel, direction, _), (next, facing, second)] = [pair[0], pair[1]];
        // Of two patches in one place only what emits beside what does not may be the second, right behind it.
        (voxel, direction) == (next, facing) && chunk.is_told(second)
    };
    if places.windows(2).any(is_fault) { Err(TileFault::Duplicate) } else { Ok(()) }
}

/// Receivers ascend, lie in the chunk, and are where a patch is just if they are of its surfaces.
fn check_receivers(chunk: &Chunk, grid: &Grid) -> Result<(), TileFault> {
    let places = &chunk.receivers.places;
    if places.len() > Receivers::COUNT_MAX || !places.is_sorted_by(|a, b| a.order() < b.order()) {
        return Err(TileFault::Receivers);
    }
    let mut patches: Vec<_> =
        chunk.patches.iter().map(|patch| (patch.voxel.to_array(), patch.direction)).collect();
    patches.sort_unstable();
    let strays = |place: &ReceiverPlace| {
        let has_patch = patches.binary_search(&(place.voxel.to_array(), place.direction)).is_ok();
        grid.chunk_of(place.voxel) != chunk.id.coord || has_patch != place.detail.is_some()
    };
    if places.iter().any(strays) {
        return Err(TileFault::Receivers);
    }
    check_rows(&chunk.receivers.rows, places.len()).or(Err(TileFault::Receivers))
}

fn check_rows(rows: &ChunkRows, patch_count: usize) -> Result<(), TileFault> {
    let entries = rows.columns.len();
    let lengths = [rows.row_starts.len(), rows.sky_shares.len() + 1, rows.absorbed_shares.len() + 1];
    if lengths != [patch_count + 1; 3] || rows.shares.len() != entries {
        return Err(TileFault::Lengths);
    }
    let starts = &rows.row_starts;
    let ordered = starts[0] == 0 && starts.windows(2).all(|pair| pair[0] <= pair[1]);
    if !ordered || starts[patch_count] as usize != entries {
        return Err(TileFault::Lengths);
    }
    let is_share = |share: &f32| (0.0..=1.0).contains(share);
    let shares =
        rows.shares.iter().chain(rows.sky_shares.as_flattened()).chain(&rows.absorbed_shares).all(is_share);
    let known = rows.columns.iter().all(|column| usize::from(column.segment) < rows.segments.len());
    let ascending = starts
        .windows(2)
        .all(|pair| rows.columns[pair[0] as usize..pair[1] as usize].is_sorted_by(|a, b| a < b));
    let segments = rows.segments.is_sorted_by(|a, b| a < b);
    if !(shares && known && ascending && segments) {
        return Err(TileFault::Rows);
    }
    let is_off = |&row: &usize| row_sums_to_one(row, f64::from(rows.row_sum(row))).is_err();
    match (0..patch_count).find(is_off) {
        Some(row) => Err(TileFault::RowSum { row, sum: rows.row_sum(row) }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::world::{RandomWorld, WorldShape};
    use earthshine_world::{OccluderMesh, Rgb};

    fn check(spoil: impl FnOnce(&mut Chunk)) -> Result<(), TileFault> {
        let world = RandomWorld::new(1, WorldShape::default());
        let fullest = world.chunks.values().max_by_key(|chunk| chunk.patches.len()).unwrap();
        let mut chunk = Chunk::clone(fullest);
        spoil(&mut chunk);
        let no_casters = Occluders::build(&OccluderMesh::default());
        Tile::new(Arc::new(chunk), Arc::default(), Arc::new(no_casters), &world.index.grid).map(|_| ())
    }

    #[test]
    fn what_emits_may_stand_beside_what_does_not() {
        let world = RandomWorld::new(1, WorldShape::default());
        let fullest = world.chunks.values().max_by_key(|chunk| chunk.patches.len()).unwrap();
        let check = |emissions: [Rgb; 3]| {
            let mut chunk = Chunk::clone(fullest);
            let place = chunk.patches[0];
            for (patch, emission) in chunk.patches.iter_mut().zip(emissions) {
                *patch = Patch { emission, ..place };
            }
            chunk.patches.truncate(if emissions[2] == Rgb::MAX { 2 } else { 3 });
            check_patches(&chunk, &world.index.grid)
        };
        assert_eq!(check([Rgb::ZERO, Rgb::ONE, Rgb::MAX]), Ok(()));
        for refused in [
            [Rgb::ZERO, Rgb::ZERO, Rgb::MAX],
            [Rgb::ONE, Rgb::ZERO, Rgb::MAX],
            [Rgb::ONE, Rgb::ONE, Rgb::MAX],
            [Rgb::ZERO, Rgb::ONE, Rgb::ONE],
        ] {
            assert_eq!(check(refused), Err(TileFault::Duplicate), "{refused:?}");
        }
    }

    #[test]
    fn each_broken_table_is_refused() {
        assert_eq!(check(|_| ()), Ok(()));
        type Spoil = fn(&mut Chunk);
        let cases: [(TileFault, Spoil); 18] = [
            (TileFault::Lengths, |c| c.rows.absorbed_shares.truncate(1)),
            (TileFault::Lengths, |c| c.rows.shares.truncate(1)),
            (TileFault::Lengths, |c| c.rows.row_starts[1] = u32::MAX),
            (TileFault::Lengths, |c| *c.rows.row_starts.last_mut().unwrap() -= 1),
            (TileFault::Patch(0), |c| c.patches[0].area = 0.0),
            (TileFault::Patch(0), |c| c.patches[0].voxel.x += 1000),
            (TileFault::Patch(0), |c| c.patches[0].point_count = u32::MAX),
            (TileFault::Patch(1), |c| c.patches[1].centroid.x = f32::NAN),
            (TileFault::Patch(1), |c| c.patches[1].reflectance.x = f32::INFINITY),
            (TileFault::Duplicate, |c| c.patches[1] = c.patches[0]),
            (TileFault::Rows, |c| c.rows.columns[0].segment = 999),
            (TileFault::Rows, |c| c.rows.shares[0] = f32::NAN),
            (TileFault::Rows, |c| c.rows.sky_shares[0][3] = -0.1),
            (TileFault::Rows, |c| c.rows.segments.reverse()),
            (TileFault::Receivers, |c| c.receivers.places.reverse()),
            (TileFault::Receivers, |c| c.receivers.places[0].voxel.x -= 1000),
            (TileFault::Receivers, |c| c.receivers.rows.shares[0] = -1.0),
            (TileFault::Receivers, |c| {
                let Patch { voxel, direction, .. } = c.patches[0];
                c.receivers.places[0] = ReceiverPlace::in_air(voxel, direction);
                c.receivers.places.sort_by_key(ReceiverPlace::order);
            }),
        ];
        let off = check(|c| c.rows.absorbed_shares[0] += 0.01).unwrap_err();
        assert!(matches!(off, TileFault::RowSum { row: 0, sum } if sum > 1.005), "{off:?}");
        for (number, (fault, spoil)) in cases.into_iter().enumerate() {
            assert_eq!(check(spoil), Err(fault), "case {number}");
        }
    }
}
