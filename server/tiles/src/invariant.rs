//! The row invariants, as `inspect verify` and the bake's tests check them.
//!
//! | | invariant |
//! |---|---|
//! | R1 | every share is a number between 0 and 1 (within the tolerance) |
//! | R2 | columns ascend within a row, and their segments exist |
//! | R3 | patches + sky + absorbed = 1 within [`ROW_SUM_TOLERANCE`] |
//! | R4 | every column's patch exists in its chunk |
//!
//! Structure that cannot be read at all never gets here: it does not leave the reader.

use crate::structure;
use earthshine_world::{Chunk, ChunkRows, Column, WorldIndex};

/// How far a row's sum may be from one.
pub const ROW_SUM_TOLERANCE: f32 = 1e-3;

/// A row that breaks an invariant.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("row {row}: {kind}")]
pub struct RowFault {
    /// Which row; the number of rows where the fault is not of one row.
    pub row: u32,
    /// How.
    pub kind: RowFaultKind,
}

/// Which invariant is broken, and by what.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RowFaultKind {
    /// The arrays do not fit together; no row was looked at.
    #[error("rows, columns and patches do not fit together")]
    Shape,
    /// R1.
    #[error("the share {0} is not between 0 and 1")]
    Share(f32),
    /// R2.
    #[error("columns do not ascend at segment {}, patch {}", .0.segment, .0.local)]
    Order(Column),
    /// R2.
    #[error("segment {0} is not in the table")]
    Segment(u16),
    /// R3.
    #[error("patches, sky and absorbed add up to {0}")]
    Sum(f32),
    /// R4.
    #[error("there is no patch {} in segment {}", .0.local, .0.segment)]
    Target(Column),
}

/// Breaches of R1, R2 and R3, and of R4 within the chunk itself; at most one of each a row.
#[must_use]
pub fn check_rows(chunk: &Chunk) -> Vec<RowFault> {
    faults_of(chunk, &chunk.rows, chunk.patches.len())
}

/// The same of the rows of the chunk's receivers.
#[must_use]
pub fn check_receivers(chunk: &Chunk) -> Vec<RowFault> {
    faults_of(chunk, &chunk.receivers.rows, chunk.receivers.places.len())
}

fn faults_of(chunk: &Chunk, rows: &ChunkRows, expected: usize) -> Vec<RowFault> {
    let count = rows.row_count() as u32;
    if !structure::starts_fit(rows) || rows.row_count() != expected {
        return vec![RowFault { row: count, kind: RowFaultKind::Shape }];
    }
    if rows.absorbed_shares.len() != rows.row_count() {
        return vec![RowFault { row: count, kind: RowFaultKind::Shape }];
    }
    let own = rows.segments.binary_search(&chunk.id).ok();
    let strays = |column: &Column| {
        Some(usize::from(column.segment)) == own && usize::from(column.local) >= chunk.patches.len()
    };
    let mut faults = Vec::new();
    for row in 0..count {
        let mut add = |kind: Option<RowFaultKind>| faults.extend(kind.map(|kind| RowFault { row, kind }));
        add(share_fault(rows, row as usize));
        add(order_fault(rows, row as usize));
        add(rows.row(row as usize).map(|(column, _)| column).find(strays).map(RowFaultKind::Target));
        let sum = rows.row_sum(row as usize);
        // A sum that is not a number is not within the tolerance either.
        let fits = (sum - 1.0).abs() <= ROW_SUM_TOLERANCE;
        add((!fits).then_some(RowFaultKind::Sum(sum)));
    }
    faults
}

/// Breaches of R4 in all of `index`'s world, at most one a row; `rows` has passed [`check_rows`].
#[must_use]
pub fn check_targets(rows: &ChunkRows, index: &WorldIndex) -> Vec<RowFault> {
    let patch_counts: Vec<u32> = rows
        .segments
        .iter()
        .map(|id| {
            index.chunks.binary_search_by_key(id, |chunk| chunk.id).map_or(0, |i| index.chunks[i].patch_count)
        })
        .collect();
    let strays = |column: &Column| {
        patch_counts.get(usize::from(column.segment)).is_none_or(|&count| u32::from(column.local) >= count)
    };
    (0..rows.row_count())
        .filter_map(|row| {
            let column = rows.row(row).map(|(column, _)| column).find(strays)?;
            Some(RowFault { row: row as u32, kind: RowFaultKind::Target(column) })
        })
        .collect()
}

fn share_fault(rows: &ChunkRows, row: usize) -> Option<RowFaultKind> {
    let tail = rows.sky_shares[row].into_iter().chain([rows.absorbed_shares[row]]);
    let mut shares = rows.row(row).map(|(_, share)| share).chain(tail);
    shares.find(|share| !(0.0..=1.0 + ROW_SUM_TOLERANCE).contains(share)).map(RowFaultKind::Share)
}

fn order_fault(rows: &ChunkRows, row: usize) -> Option<RowFaultKind> {
    let mut previous = None;
    rows.row(row).find_map(|(column, _)| {
        if previous.replace(column) >= Some(column) {
            Some(RowFaultKind::Order(column))
        } else if usize::from(column.segment) >= rows.segments.len() {
            Some(RowFaultKind::Segment(column.segment))
        } else {
            None
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::{
        Bounds, ChunkCoord, ChunkId, ChunkSummary, Direction, Grid, LightRig, OccluderMesh, Patch,
        SamplePoint, Vec3,
    };

    /// Two patches that see each other (0.75), the sky (0.125) and something black (0.125).
    fn sound() -> Chunk {
        let id = ChunkId::new(0, ChunkCoord::ZERO);
        let patch = Patch {
            voxel: ChunkCoord::ZERO,
            direction: Direction::PosY,
            area: 1.0,
            centroid: Vec3::ZERO,
            reflectance: Vec3::splat(0.5),
            emission: Vec3::ZERO,
            point_first: 0,
            point_count: 1,
        };
        Chunk {
            id,
            patches: vec![patch; 2],
            points: vec![SamplePoint { position: Vec3::ZERO, normal: Vec3::Y }],
            receivers: earthshine_world::Receivers::default(),
            rows: ChunkRows {
                segments: vec![id],
                row_starts: vec![0, 2, 3],
                columns: vec![
                    Column { segment: 0, local: 0 },
                    Column { segment: 0, local: 1 },
                    Column { segment: 0, local: 0 },
                ],
                shares: vec![0.25, 0.5, 0.75],
                sky_shares: vec![[0.0, 0.0, 0.125, 0.0, 0.0, 0.0]; 2],
                absorbed_shares: vec![0.125; 2],
            },
            occluders: OccluderMesh::default(),
        }
    }

    fn faults_after(change: impl FnOnce(&mut ChunkRows)) -> Vec<RowFault> {
        let mut chunk = sound();
        change(&mut chunk.rows);
        check_rows(&chunk)
    }

    #[test]
    fn each_breach_is_found_in_its_row() {
        assert_eq!(check_rows(&sound()), []);
        let column = Column { segment: 0, local: 9 };
        let cases = [
            (faults_after(|rows| rows.shares[2] = -0.75), 1, RowFaultKind::Share(-0.75)),
            (faults_after(|rows| rows.sky_shares[0][1] = 2.0), 0, RowFaultKind::Share(2.0)),
            (
                faults_after(|rows| rows.columns[1].local = 0),
                0,
                RowFaultKind::Order(Column { local: 0, ..column }),
            ),
            (faults_after(|rows| rows.columns[2].segment = 1), 1, RowFaultKind::Segment(1)),
            (faults_after(|rows| rows.columns[1] = column), 0, RowFaultKind::Target(column)),
            (faults_after(|rows| rows.absorbed_shares[1] = 0.25), 1, RowFaultKind::Sum(1.125)),
            (faults_after(|rows| rows.row_starts[1] = 7), 2, RowFaultKind::Shape),
            (faults_after(|rows| rows.absorbed_shares.truncate(1)), 2, RowFaultKind::Shape),
        ];
        for (faults, row, kind) in cases {
            assert!(faults.contains(&RowFault { row, kind }), "{kind:?} not in {faults:?}");
        }
        assert!(
            faults_after(|rows| rows.shares[0] = f32::NAN)
                .iter()
                .any(|f| matches!(f.kind, RowFaultKind::Sum(_)))
        );
    }

    #[test]
    fn targets_are_held_against_the_world() {
        let chunk = sound();
        let mut index = WorldIndex {
            detail: 1,
            grid: Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 16 },
            bounds: Bounds::EMPTY,
            chunks: vec![ChunkSummary { id: chunk.id, patch_count: 2, nonzero_count: 3, tile_bytes: 0 }],
            lights: LightRig::emission_only(),
        };
        assert_eq!(check_targets(&chunk.rows, &index), []);
        index.chunks[0].patch_count = 1;
        let kind = RowFaultKind::Target(Column { segment: 0, local: 1 });
        assert_eq!(check_targets(&chunk.rows, &index), [RowFault { row: 0, kind }]);
        index.chunks.clear();
        assert_eq!(check_targets(&chunk.rows, &index).len(), 2);
    }
}
