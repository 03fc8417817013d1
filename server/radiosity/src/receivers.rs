//! Rows gathered elsewhere than one by one in the engine: what a device is asked, what it answers, and the same in plain
//! loops. They are those of receivers, or those of patches for the light that comes to them from afar.
//!
//! Rows never change while their chunk is in memory; what changes is who holds which slot. So a column leads
//! to a *source* by way of a table: one entry for each patch of each chunk that rows lead to, the number of its slot or of
//! the coarse parent that stands for it. Whoever answers may keep rows from one question to the next, by the chunk's
//! address, and compare tables.
//!
//! It decides nothing: which rows, when, and what becomes of the sums is the engine's.

use earthshine_world::{Asked, Chunk, ChunkRows, Rgb, Sky, Vec4};
use std::sync::Arc;

/// Of a column that no source stands for: it is far, and a gap.
pub const NO_SOURCE: u32 = u32::MAX;

/// Where the patches of one chunk are in a list of columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ColumnSpan {
    /// The first of them.
    pub first: u32,
    /// How many; a patch beyond has no source.
    pub count: u32,
}

/// Whose rows are gathered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum RowsOf {
    /// Of receivers.
    Receivers,
    /// Of patches, as receivers.
    Patches,
}

impl RowsOf {
    /// Those rows of `chunk`.
    #[must_use]
    pub fn of(self, chunk: &Chunk) -> &ChunkRows {
        match self {
            Self::Receivers => &chunk.receivers.rows,
            Self::Patches => &chunk.rows,
        }
    }
}

/// One receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReceiverRow {
    /// Its chunk, of [`ReceiverGather::chunks`].
    pub chunk: u32,
    /// Its row in the chunk.
    pub row: u32,
}

/// What is to be gathered, and from what.
#[derive(Debug, Clone, Copy)]
pub struct ReceiverGather<'a> {
    /// Of the same throughout: who is asked for one is not asked for the other.
    pub rows_of: RowsOf,
    /// Chunks whose rows may be asked for, now or soon; rows of others can be forgotten.
    pub chunks: &'a [&'a Arc<Chunk>],
    /// Of each chunk: where its segments begin in `spans`.
    pub first_spans: &'a [u32],
    /// Of each segment of each chunk's rows.
    pub spans: &'a [ColumnSpan],
    /// By patch of a span: a place in `sources`, or [`NO_SOURCE`].
    pub columns: &'a [u32],
    /// What leaves slots and then coarse parents, lm/m2; with it, of a parent, one if that is known, else all zero.
    pub sources: &'a [Vec4],
    /// How many of `sources` are slots.
    pub slot_count: u32,
    /// What the sky's shares see.
    pub sky: &'a Sky,
    /// Whose light is asked for.
    pub rows: &'a [ReceiverRow],
}

/// What one row gathers. Rows of patches are asked for far light: of their sums all is zero but
/// [`Self::far_irradiance`] and [`Self::fed_share`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ReceiverSums {
    /// Irradiance from resident patches, lx.
    pub irradiance: Rgb,
    /// Share of the row that they are.
    pub resident_share: f32,
    /// Irradiance from coarse parents, lx.
    pub far_irradiance: Rgb,
    /// Share of the row that is not resident.
    pub far_share: f32,
    /// Irradiance from the sky, lx.
    pub sky_irradiance: Rgb,
    /// Part of the far share that known parents stand for.
    pub fed_share: f32,
}

/// Gathers light of receivers where their rows lie, without being waited for.
pub trait ReceiverLight: Send + std::fmt::Debug {
    /// Most rows of one gather; none where the CPU has to do it.
    fn rows_max(&self) -> usize;

    /// Takes a gather of at most [`Self::rows_max`] rows; what was under way is forgotten. False where the CPU has to do it:
    /// no room for the rows, or no device any more.
    ///
    /// The sums are those of [`gather_receivers`], to rounding.
    fn begin(&mut self, gather: &ReceiverGather<'_>) -> bool;

    /// How the last gather stands: its sums, one a row, in the order asked, are given once. Never waits.
    fn take(&mut self) -> Asked<Vec<ReceiverSums>>;
}

/// All of it at once, in `f64`: what a [`ReceiverLight`] is held against.
///
/// # Panics
/// If a row, a span or a source is named that is not there.
#[must_use]
pub fn gather_receivers(gather: &ReceiverGather<'_>) -> Vec<ReceiverSums> {
    gather.rows.iter().map(|&row| sums_of(gather, row)).collect()
}

fn sums_of(gather: &ReceiverGather<'_>, ReceiverRow { chunk, row }: ReceiverRow) -> ReceiverSums {
    let (rows, row) = (gather.rows_of.of(gather.chunks[chunk as usize]), row as usize);
    let first_span = gather.first_spans[chunk as usize] as usize;
    // Light and share from slots, light and fed share from parents, share of what is far.
    let (mut near, mut far, mut far_share) = ([0.0f64; 4], [0.0f64; 4], 0.0f64);
    for (column, share) in rows.row(row) {
        let span = gather.spans[first_span + usize::from(column.segment)];
        let local = u32::from(column.local);
        let source =
            if local < span.count { gather.columns[(span.first + local) as usize] } else { NO_SOURCE };
        let share = f64::from(share);
        let light = |source: u32| gather.sources[source as usize];
        if source < gather.slot_count {
            add(&mut near, share, light(source).truncate().extend(1.0));
            continue;
        }
        far_share += share;
        if source != NO_SOURCE {
            add(&mut far, share, light(source));
        }
    }
    let rgb = |sums: [f64; 4]| Rgb::new(sums[0] as f32, sums[1] as f32, sums[2] as f32);
    let fed = ReceiverSums { far_irradiance: rgb(far), fed_share: far[3] as f32, ..ReceiverSums::default() };
    match gather.rows_of {
        RowsOf::Patches => fed,
        RowsOf::Receivers => ReceiverSums {
            irradiance: rgb(near),
            resident_share: near[3] as f32,
            sky_irradiance: gather.sky.irradiance(&rows.sky_shares[row]),
            far_share: far_share as f32,
            ..fed
        },
    }
}

fn add(sums: &mut [f64; 4], share: f64, light: Vec4) {
    for (sum, light) in sums.iter_mut().zip(light.to_array()) {
        *sum += share * f64::from(light);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::{
        ChunkCoord, ChunkId, ChunkRows, Column, Direction, OccluderMesh, ReceiverPlace, Receivers, VoxelCoord,
    };

    fn id(x: i32) -> ChunkId {
        ChunkId { level: 0, coord: ChunkCoord::new(x, 0, 0) }
    }

    /// Two receivers that see three patches of one chunk and one of another, and the sky.
    fn chunk() -> Arc<Chunk> {
        let column = |segment, local| Column { segment, local };
        let place = |x| ReceiverPlace::in_air(VoxelCoord::new(x, 0, 0), Direction::PosX);
        let rows = ChunkRows {
            segments: vec![id(0), id(1)],
            row_starts: vec![0, 3, 4],
            columns: vec![column(0, 0), column(0, 2), column(1, 5), column(0, 1)],
            shares: vec![0.25, 0.125, 0.0625, 0.5],
            sky_shares: vec![[0.5, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 6]],
            absorbed_shares: vec![0.0625, 0.5],
        };
        Arc::new(Chunk {
            id: id(0),
            patches: Vec::new(),
            points: Vec::new(),
            rows: ChunkRows::default(),
            receivers: Receivers { places: vec![place(0), place(1)], rows },
            occluders: OccluderMesh::default(),
        })
    }

    #[test]
    fn slots_parents_and_gaps_are_told_apart() {
        let chunk = chunk();
        let span = |first, count| ColumnSpan { first, count };
        let gather = ReceiverGather {
            rows_of: RowsOf::Receivers,
            chunks: &[&chunk],
            first_spans: &[1],
            // The other chunk's sixth patch lies beyond what is listed of it.
            spans: &[span(9, 9), span(1, 3), span(4, 5)],
            columns: &[7, 1, 2, 0, 0, 0, 0, 0, 0],
            sources: &[Vec4::splat(3.0), Vec4::new(8.0, 4.0, 0.0, 5.0), Vec4::new(2.0, 0.0, 2.0, 1.0)],
            slot_count: 2,
            sky: &Sky::constant(Rgb::splat(2.0)),
            rows: &[ReceiverRow { chunk: 0, row: 1 }, ReceiverRow { chunk: 0, row: 0 }],
        };
        let sums = gather_receivers(&gather);
        let fed = ReceiverSums {
            far_irradiance: Rgb::new(1.0, 0.0, 1.0),
            far_share: 0.5,
            fed_share: 0.5,
            ..ReceiverSums::default()
        };
        assert_eq!(sums[0], fed);
        let mixed = ReceiverSums {
            irradiance: Rgb::new(2.375, 1.375, 0.375),
            resident_share: 0.375,
            far_share: 0.0625,
            sky_irradiance: Rgb::splat(std::f32::consts::PI),
            ..ReceiverSums::default()
        };
        assert_eq!(sums[1], mixed);
    }
}
