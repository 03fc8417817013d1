//! What adds and removals share: scratch memory, and the pass `H += Z V` over a plane.
//!
//! A block's columns (`U`, `Z`) lie one tile wide, a row of it for each row of `H`. Its rows (`V`) lie
//! packed: for each tile of columns, [`depth`](Workspace::depth) rows of one tile.

use super::{BAND_ROWS, LocalMatrix, TILE};
use crate::buffer::Buffer;
use crate::kernel::{ROW_GROUP, RankUpdate, RowProducts, Scalar, ScatterRows};
use crate::simd::InstructionSet;
use rayon::prelude::*;
use std::collections::TryReserveError;

/// Not in the block.
pub(super) const ABSENT: u8 = u8::MAX;

/// Tiles of columns a task takes.
pub(super) const STRIPE_TILES: usize = 16;

/// Memory of updates and products, allocated once.
#[derive(Debug)]
pub(super) struct Workspace {
    /// Columns of the block, before the loop is closed; one a channel.
    pub(super) columns: [Buffer<f32>; 3],
    /// Rows of the block, before the loop is closed, packed; one a channel.
    pub(super) panels: [Buffer<f32>; 3],
    /// Left factor of the update.
    pub(super) left: Buffer<f32>,
    /// Sources in the block's columns, or rows, times reflectance.
    pub(super) operand: Buffer<f32>,
    /// Place of each slot in the block, [`ABSENT`] for most.
    pub(super) place: Vec<u8>,
    /// Slots that any column, or row, of the block names.
    pub(super) named: Vec<u32>,
    /// Where a slot is in `named`.
    pub(super) index: Vec<u32>,
    /// A vector, for products.
    pub(super) vector: Buffer<f32>,
    /// Sums of products.
    pub(super) products: Vec<f64>,
    /// Runs of tiles that carry light.
    pub(super) lit_runs: Vec<std::ops::Range<usize>>,
    /// Rows of `panels`: the block's size, rounded up to whole groups.
    pub(super) depth: usize,
}

impl Workspace {
    pub(super) fn new(row_count: usize, stride: usize) -> Result<Self, TryReserveError> {
        let column = || Buffer::zeroed(row_count * TILE);
        let panel = || Buffer::zeroed(stride * TILE);
        Ok(Self {
            columns: [column()?, column()?, column()?],
            panels: [panel()?, panel()?, panel()?],
            left: column()?,
            operand: panel()?,
            place: vec![ABSENT; row_count],
            named: Vec::with_capacity(row_count),
            index: vec![0; row_count],
            vector: Buffer::zeroed(stride)?,
            products: vec![0.0; row_count],
            lit_runs: Vec::new(),
            depth: ROW_GROUP,
        })
    }

    /// Lists in `named`, ascending, the slots `name` is called with, and where they are in it.
    pub(super) fn list_named(&mut self, extent: usize, name: impl FnOnce(&mut dyn FnMut(usize))) {
        self.index[..extent].fill(0);
        let index = &mut self.index;
        name(&mut |slot| index[slot] = 1);
        self.named.clear();
        for slot in 0..extent {
            if self.index[slot] != 0 {
                self.index[slot] = self.named.len() as u32;
                self.named.push(slot as u32);
            }
        }
    }
}

/// Where row `place`, column `slot` of a block is in panels of `depth` rows.
pub(super) fn panel_index(depth: usize, place: usize, slot: usize) -> usize {
    (slot / TILE * depth + place) * TILE + slot % TILE
}

impl LocalMatrix {
    /// Rows of `H` that can hold anything, in whole groups.
    pub(super) fn active_rows(&self) -> usize {
        self.extent.next_multiple_of(ROW_GROUP)
    }

    /// Numbers of `panels` in use.
    pub(super) fn panel_len(&self) -> usize {
        self.extent.div_ceil(TILE) * self.workspace.depth * TILE
    }

    /// `H += left * panels` of one channel, the first `block` columns of `left`. `finish` then gets each row
    /// of `H`, its slot, and its row of `columns`, while they are in the cache.
    pub(super) fn rank_update(
        &mut self,
        channel: usize,
        block: usize,
        finish: impl Fn(usize, &mut [f32], &[f32]) + Sync,
    ) {
        let rows = self.active_rows();
        let (stride, set) = (self.stride, self.instructions);
        let panels = &self.workspace.panels[channel][..self.panel_len()];
        let panel_stride = self.workspace.depth * TILE;
        self.planes[channel][..rows * stride]
            .par_chunks_mut(BAND_ROWS * stride)
            .zip(self.workspace.left[..rows * TILE].par_chunks(BAND_ROWS * TILE))
            .zip(self.workspace.columns[channel][..rows * TILE].par_chunks(BAND_ROWS * TILE))
            .enumerate()
            .for_each(|(band, ((out, coefficients), columns))| {
                let kernel = RankUpdate {
                    out: &mut *out,
                    stride,
                    first_column: 0,
                    coefficients,
                    coefficient_stride: TILE,
                    depth: block,
                    panels,
                    panel_stride,
                };
                f32::dispatch(set, kernel);
                for (row, (out, columns)) in
                    out.chunks_exact_mut(stride).zip(columns.chunks_exact(TILE)).enumerate()
                {
                    finish(band * BAND_ROWS + row, out, columns);
                }
            });
    }

    /// `left = columns * small` of one channel, `small` a `block` x `block` matrix.
    pub(super) fn multiply_columns(&mut self, channel: usize, small: &[f64], block: usize) {
        let rows = self.active_rows();
        let mut panel = [0.0f32; TILE * TILE];
        for (panel, row) in panel.chunks_exact_mut(TILE).zip(small.chunks_exact(block)) {
            for (to, &from) in panel.iter_mut().zip(row) {
                *to = from as f32;
            }
        }
        let set = self.instructions;
        self.workspace.left[..rows * TILE]
            .par_chunks_mut(BAND_ROWS * TILE)
            .zip(self.workspace.columns[channel][..rows * TILE].par_chunks(BAND_ROWS * TILE))
            .for_each(|(out, coefficients)| {
                out.fill(0.0);
                let kernel = RankUpdate {
                    out,
                    stride: TILE,
                    first_column: 0,
                    coefficients,
                    coefficient_stride: TILE,
                    depth: block,
                    panels: &panel,
                    panel_stride: TILE * TILE,
                };
                f32::dispatch(set, kernel);
            });
    }

    /// `panels = operand * H[named, :]` of one channel.
    pub(super) fn scatter_rows(&mut self, channel: usize) {
        let len = self.panel_len();
        let (stride, set, depth) = (self.stride, self.instructions, self.workspace.depth);
        let Workspace { panels, operand, named, .. } = &mut self.workspace;
        let panels = &mut panels[channel][..len];
        panels.fill(0.0);
        if named.is_empty() {
            return;
        }
        let matrix = &*self.planes[channel];
        let coefficients = &operand[..depth * named.len()];
        panels.par_chunks_mut(STRIPE_TILES * depth * TILE).enumerate().for_each(|(stripe, out)| {
            let kernel = ScatterRows {
                matrix,
                stride,
                first_column: stripe * STRIPE_TILES * TILE,
                rows: named,
                coefficients,
                depth,
                out,
            };
            f32::dispatch(set, kernel);
        });
    }
}

/// `out = matrix * x` for a band of rows after another, one number a row.
pub(super) fn row_products(
    set: InstructionSet,
    matrix: &[f32],
    stride: usize,
    vector: &[f32],
    runs: &[std::ops::Range<usize>],
    out: &mut [f64],
) {
    matrix.par_chunks(BAND_ROWS * stride).zip(out.par_chunks_mut(BAND_ROWS)).for_each(|(matrix, out)| {
        f32::dispatch(set, RowProducts { matrix, stride, vector, runs, out });
    });
}

/// Fills `runs` with the tiles of `x[..extent]` that are not all zero.
pub(super) fn find_lit(x: &[f32], extent: usize, runs: &mut Vec<std::ops::Range<usize>>) {
    runs.clear();
    for tile in 0..extent.div_ceil(TILE) {
        if x[tile * TILE..(tile + 1) * TILE].iter().any(|&value| value != 0.0) {
            match runs.last_mut() {
                Some(run) if run.end == tile => run.end += 1,
                _ => runs.push(tile..tile + 1),
            }
        }
    }
}
