//! Rows that keep the columns with the top share of their mass, and give the rest to coarse parents.
//!
//! A pair of patches is kept whole or goes whole: if either side counts it among its top, both keep it, so that what they
//! exchange stays the same both ways.

use crate::whole_world::WholeWorld;
use earthshine_bake::pyramid::parent_numbers;
use earthshine_radiosity::gather::{SparseRows, SparseRowsError};
use earthshine_world::{Chunk, ChunkId, ChunkRows, Column};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;

/// The patches of the next level, numbered as the bake numbers them.
pub(super) struct Parents {
    /// By patch: its parent.
    of: Vec<u32>,
    /// By patch: its chunk and its number there.
    own_places: Vec<(ChunkId, u16)>,
    /// By parent: its chunk and its number there.
    places: Vec<(ChunkId, u16)>,
    /// By parent, with their share of its area.
    children: Vec<Vec<(u32, f32)>>,
}

impl Parents {
    pub(super) fn of(world: &WholeWorld) -> Self {
        Self::of_chunks(world.chunks(), world.manifest.parameters.grid.chunk_edge_voxels)
    }

    fn of_chunks(chunks: &[Chunk], chunk_edge_voxels: u32) -> Self {
        let finer = chunks.iter().map(|chunk| (chunk.id, chunk.patches.clone())).collect();
        let numbers = parent_numbers(&finer, chunk_edge_voxels);
        let mut by_parent: BTreeMap<(ChunkId, u16), Vec<(u32, f32)>> = BTreeMap::new();
        let mut own_places = Vec::new();
        for chunk in chunks {
            for ((own, &number), local) in chunk.patches.iter().zip(&numbers[&chunk.id]).zip(0u16..) {
                let children = by_parent.entry((chunk.id.parent(), number)).or_default();
                children.push((own_places.len() as u32, own.area));
                own_places.push((chunk.id, local));
            }
        }
        let of = vec![0; own_places.len()];
        let mut parents = Self { of, own_places, places: Vec::new(), children: Vec::new() };
        for (place, mut children) in by_parent {
            let area: f32 = children.iter().map(|&(_, area)| area).sum();
            for (child, own) in &mut children {
                parents.of[*child as usize] = parents.places.len() as u32;
                *own /= area;
            }
            parents.places.push(place);
            parents.children.push(children);
        }
        parents
    }
}

/// One row: columns that are patches and columns that are parents, both ascending.
#[derive(Default)]
struct Row {
    kept: Vec<(u32, f32)>,
    coarse: Vec<(u32, f32)>,
}

/// All rows of a world.
pub(super) struct Thinned {
    rows: Vec<Row>,
}

impl Thinned {
    /// Keeps what makes up the share `keep` of each row's mass.
    pub(super) fn new(world: &WholeWorld, parents: &Parents, keep: f32) -> Self {
        let rows = &world.rows;
        let areas: Vec<f32> = world.patches().map(|patch| patch.area).collect();
        let exchanges = |row: usize| {
            let (columns, shares) = rows.row(row);
            let of_entry = |(&column, &share)| (column, share, exchange(rows, &areas, row, column));
            columns.iter().zip(shares).map(of_entry).collect::<Vec<_>>()
        };
        let least: Vec<f32> = (0..areas.len())
            .into_par_iter()
            .map(|row| least_kept(exchanges(row).iter().map(|entry| entry.2), keep))
            .collect();
        let thin = |row: usize| {
            let mut thin = Row::default();
            let mut rest: BTreeMap<u32, f32> = BTreeMap::new();
            for (column, share, exchange) in exchanges(row) {
                if exchange >= least[row] || exchange >= least[column as usize] {
                    thin.kept.push((column, share));
                } else {
                    *rest.entry(parents.of[column as usize]).or_default() += share;
                }
            }
            thin.coarse = rest.into_iter().collect();
            thin
        };
        Self { rows: (0..areas.len()).into_par_iter().map(thin).collect() }
    }

    pub(super) fn column_count(&self) -> usize {
        self.rows.iter().map(|row| row.kept.len() + row.coarse.len()).sum()
    }

    pub(super) fn coarse_column_count(&self) -> usize {
        self.rows.iter().map(|row| row.coarse.len()).sum()
    }

    /// The same with each coarse column spread over its children by area: light of a parent is the mean of theirs.
    pub(super) fn expanded(&self, parents: &Parents) -> Result<SparseRows, SparseRowsError> {
        let (mut starts, mut columns, mut shares) = (vec![0], Vec::new(), Vec::new());
        for row in &self.rows {
            for &(column, share) in &row.kept {
                columns.push(column);
                shares.push(share);
            }
            for &(parent, share) in &row.coarse {
                for &(child, part) in &parents.children[parent as usize] {
                    columns.push(child);
                    shares.push(share * part);
                }
            }
            starts.push(columns.len());
        }
        SparseRows::new(starts, columns, shares)
    }

    /// `chunk`, whose patches are `own`, with these rows.
    pub(super) fn chunk(&self, chunk: &Chunk, own: Range<usize>, parents: &Parents) -> Chunk {
        let rows = &self.rows[own];
        let mut entries: Vec<Vec<((ChunkId, u16), f32)>> = Vec::with_capacity(rows.len());
        for row in rows {
            let kept = row.kept.iter().map(|&(patch, share)| (parents.own_places[patch as usize], share));
            let coarse = row.coarse.iter().map(|&(parent, share)| (parents.places[parent as usize], share));
            entries.push(kept.chain(coarse).collect());
        }
        let mut segments: Vec<ChunkId> = entries.iter().flatten().map(|((chunk, _), _)| *chunk).collect();
        segments.sort_unstable();
        segments.dedup();
        let mut thin = ChunkRows { row_starts: vec![0], ..chunk.rows.clone() };
        thin.columns.clear();
        thin.shares.clear();
        for mut row in entries {
            row.sort_unstable_by_key(|&(place, _)| place);
            for ((chunk, local), share) in row {
                let segment = segments.binary_search(&chunk).expect("every chunk was collected") as u16;
                thin.columns.push(Column { segment, local });
                thin.shares.push(share);
            }
            thin.row_starts.push(thin.columns.len() as u32);
        }
        Chunk { rows: ChunkRows { segments, ..thin }, ..chunk.clone() }
    }
}

/// What `row` and `column` exchange, m2: the same number from both ends.
fn exchange(rows: &SparseRows, areas: &[f32], row: usize, column: u32) -> f32 {
    let (low, high) = (row.min(column as usize), row.max(column as usize) as u32);
    let (columns, shares) = rows.row(low);
    columns.binary_search(&high).map_or(0.0, |at| shares[at] * areas[low])
}

/// The smallest of the largest `exchanges` that together make up the share `keep` of all.
fn least_kept(exchanges: impl Iterator<Item = f32>, keep: f32) -> f32 {
    let mut exchanges: Vec<f32> = exchanges.collect();
    exchanges.sort_unstable_by(|a, b| b.total_cmp(a));
    let wanted = exchanges.iter().map(|&exchange| f64::from(exchange)).sum::<f64>() * f64::from(keep);
    let mut sum = 0.0;
    if keep <= 0.0 {
        return f32::INFINITY;
    }
    for &exchange in &exchanges {
        sum += f64::from(exchange);
        if keep < 1.0 && sum >= wanted {
            return exchange;
        }
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::{ChunkCoord, Direction, OccluderMesh, Patch, Receivers, Rgb, Vec3, VoxelCoord};

    /// Goal: parents are the bake's. Method: a patch that emits beside one that does not, in one voxel and direction: two parents,
    /// but in chunks too large for numbers of both.
    #[test]
    fn parents_are_those_that_a_bake_makes() {
        let patch = |area: f32, emission: Rgb| Patch {
            voxel: VoxelCoord::new(3, 0, 1),
            direction: Direction::PosY,
            area,
            centroid: Vec3::ZERO,
            reflectance: Rgb::ZERO,
            emission,
            point_first: 0,
            point_count: 0,
        };
        let chunk = Chunk {
            id: ChunkId::new(0, ChunkCoord::ZERO),
            patches: vec![patch(3.0, Rgb::ZERO), patch(1.0, Rgb::ONE)],
            points: Vec::new(),
            rows: ChunkRows::default(),
            receivers: Receivers::default(),
            occluders: OccluderMesh::default(),
        };
        let chunks = [chunk];
        let apart = Parents::of_chunks(&chunks, 16);
        assert_eq!((&apart.of[..], apart.places.len()), (&[0, 1][..], 2));
        let mixed = Parents::of_chunks(&chunks, 20);
        assert_eq!((&mixed.of[..], &mixed.children[..]), (&[0, 0][..], &[vec![(0, 0.75), (1, 0.25)]][..]));
    }

    #[test]
    fn the_top_share_is_kept_and_no_more() {
        let least = |keep| least_kept([0.1, 0.5, 0.3, 0.1].into_iter(), keep);
        assert_eq!(least(0.45), 0.5);
        assert_eq!(least(0.55), 0.3);
        assert_eq!(least(1.0), 0.0);
        assert_eq!(least(0.0), f32::INFINITY);
        assert_eq!(least_kept(std::iter::empty(), 0.9), 0.0);
    }
}
