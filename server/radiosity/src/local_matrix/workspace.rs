//! What adds, removals and repairs share: scratch memory, and the pass `G += W Z'` over a plane.
//!
//! A block's columns lie [`BLOCK`] wide, a row of it for each row of `G`.

use super::LocalMatrix;
use super::product::BANDS;
use crate::buffer::Buffer;
use crate::exchange::{BLOCK, TILE_EDGE, TILE_LEN, for_each_stripe, mirror_diagonal, stripe_at, tile_at};
use crate::kernel::{RankUpdate, Scalar};
use crate::simd::InstructionSet;
use crate::tile_kernel::{NamedColumns, StripeGather, StripeUpdate};
use rayon::prelude::*;
use std::collections::TryReserveError;

/// Not in the block.
pub(super) const ABSENT: u8 = u8::MAX;

/// Numbers of a block's columns in one stripe.
pub(super) const STRIPE_COLUMNS: usize = TILE_EDGE * BLOCK;

/// Memory of updates and products, allocated once.
#[derive(Debug)]
pub(super) struct Workspace {
    /// Columns of the block; one a channel.
    pub(super) columns: [Buffer<f32>; 3],
    /// Columns of the block as they will stand in `G`.
    pub(super) finals: Buffer<f32>,
    /// Other columns: a factor of the update, a residual.
    pub(super) other: Buffer<f32>,
    /// Right factor of the update: for each stripe, a row of its slots for each patch of the block.
    right: Buffer<f32>,
    /// What a product with the block multiplies, a row for each named column.
    pub(super) operand: Buffer<f32>,
    /// Slots that the block's rows name, ascending; where each stripe's begin.
    pub(super) named: Vec<u32>,
    named_starts: Vec<u32>,
    /// Where a slot is in `named`.
    pub(super) index: Vec<u32>,
    /// Place of each slot in the block, [`ABSENT`] for most.
    pub(super) place: Vec<u8>,
    /// Slots of the block with their places, ascending.
    members: Vec<(usize, usize)>,
    /// A vector, for products.
    pub(super) vector: Buffer<f32>,
    /// For each stripe, which of its slots carry light, and which rows are wanted.
    pub(super) lit: Vec<u64>,
    pub(super) wanted: Vec<u64>,
    /// Sums of a product, one vector a band.
    pub(super) partial: Buffer<f64>,
}

impl Workspace {
    pub(super) fn new(stripes: usize) -> Result<Self, TryReserveError> {
        let rows = stripes * TILE_EDGE;
        let columns = || Buffer::zeroed(stripes * STRIPE_COLUMNS);
        Ok(Self {
            columns: [columns()?, columns()?, columns()?],
            finals: columns()?,
            other: columns()?,
            right: columns()?,
            operand: columns()?,
            named: Vec::with_capacity(rows),
            named_starts: Vec::with_capacity(stripes + 1),
            index: vec![0; rows],
            place: vec![ABSENT; rows],
            members: Vec::with_capacity(BLOCK),
            vector: Buffer::zeroed(rows)?,
            lit: vec![0; stripes],
            wanted: vec![0; stripes],
            partial: Buffer::zeroed(BANDS * rows)?,
        })
    }

    /// Memory of the lists as long as the matrix, bytes.
    pub(super) fn bytes(&self) -> usize {
        let wide = self.columns.iter().chain([&self.finals, &self.other, &self.right, &self.operand]);
        wide.map(|columns| size_of_val(&**columns)).sum::<usize>() + size_of_val(&*self.partial)
    }

    /// Lists, ascending, the slots `name` is called with, and where they are in the list.
    pub(super) fn list_named(&mut self, stripes: usize, name: impl FnOnce(&mut dyn FnMut(usize))) {
        self.index[..stripes * TILE_EDGE].fill(0);
        let index = &mut self.index;
        name(&mut |slot| index[slot] = 1);
        self.named.clear();
        self.named_starts.clear();
        for stripe in 0..stripes {
            self.named_starts.push(self.named.len() as u32);
            for slot in stripe * TILE_EDGE..(stripe + 1) * TILE_EDGE {
                if self.index[slot] != 0 {
                    self.index[slot] = self.named.len() as u32;
                    self.named.push(slot as u32);
                }
            }
        }
        self.named_starts.push(self.named.len() as u32);
    }

    /// Notes the slots of the block, in its order.
    pub(super) fn set_members(&mut self, slots: impl Iterator<Item = usize>) {
        self.members.clear();
        self.members.extend(slots.enumerate().map(|(place, slot)| (slot, place)));
        self.members.sort_unstable();
    }
}

/// Of `members`, those in `stripe`: where in it, and their places.
fn in_stripe(members: &[(usize, usize)], stripe: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
    let first = members.partition_point(|&(slot, _)| slot < stripe * TILE_EDGE);
    members[first..]
        .iter()
        .take_while(move |(slot, _)| slot / TILE_EDGE == stripe)
        .map(|&(slot, place)| (slot % TILE_EDGE, place))
}

/// Writes the rows and columns of the block's patches in one tile: zero, or what `finals` says. Makes a diagonal tile
/// symmetric again, which rounding may have left a little off.
fn settle(tile: &mut [f32], at: (usize, usize), members: &[(usize, usize)], finals: Option<&[f32]>) {
    let (stripe, column) = at;
    let rows = tile.as_chunks_mut::<TILE_EDGE>().0;
    let of = |stripe: usize, place: usize| {
        let rows =
            finals.map(|finals| finals[stripe * STRIPE_COLUMNS..][..STRIPE_COLUMNS].as_chunks::<BLOCK>().0);
        move |slot: usize| rows.map_or(0.0, |rows| rows[slot][place])
    };
    for (row, place) in in_stripe(members, stripe) {
        let value = of(column, place);
        rows[row].iter_mut().enumerate().for_each(|(slot, entry)| *entry = value(slot));
    }
    for (entry, place) in in_stripe(members, column) {
        let value = of(stripe, place);
        rows.iter_mut().enumerate().for_each(|(slot, row)| row[entry] = value(slot));
    }
    if stripe == column {
        mirror_diagonal(rows);
    }
}

/// `out = columns * small`, `small` a `block` x `block` matrix.
pub(super) fn times_small(
    set: InstructionSet,
    columns: &[f32],
    small: &[f64],
    block: usize,
    out: &mut [f32],
) {
    let mut panel = [0.0f32; BLOCK * BLOCK];
    for (panel, row) in panel.chunks_exact_mut(BLOCK).zip(small.chunks_exact(block)) {
        for (to, &from) in panel.iter_mut().zip(row) {
            *to = from as f32;
        }
    }
    out.par_chunks_mut(STRIPE_COLUMNS).zip(columns.par_chunks(STRIPE_COLUMNS)).for_each(
        |(out, coefficients)| {
            out.fill(0.0);
            let kernel = RankUpdate {
                out,
                stride: BLOCK,
                first_column: 0,
                coefficients,
                coefficient_stride: BLOCK,
                depth: block,
                panels: &panel,
                panel_stride: BLOCK * BLOCK,
            };
            f32::dispatch(set, kernel);
        },
    );
}

impl LocalMatrix {
    /// `G += columns * (columns * small)'` of one channel, `small` symmetric. Then the rows and columns of the
    /// block's members are set to what `finals` holds, or to zero: while each tile is in the nearest cache.
    pub(super) fn rank_update(&mut self, channel: usize, block: usize, small: &[f64], has_finals: bool) {
        let (stripes, set) = (self.stripes(), self.instructions);
        let len = stripes * STRIPE_COLUMNS;
        let Workspace { columns, other, right, finals, members, .. } = &mut self.workspace;
        let (columns, finals) = (&columns[channel][..len], has_finals.then_some(&finals[..len]));
        times_small(set, columns, small, block, &mut other[..len]);
        let right = &mut right[..stripes * block * TILE_EDGE];
        right.par_chunks_mut(block * TILE_EDGE).zip(other[..len].par_chunks(STRIPE_COLUMNS)).for_each(
            |(right, other)| {
                for (k, right) in right.chunks_exact_mut(TILE_EDGE).enumerate() {
                    for (to, from) in right.iter_mut().zip(other.chunks_exact(BLOCK)) {
                        *to = from[k];
                    }
                }
            },
        );
        let (right, members) = (&*right, &members[..]);
        for_each_stripe(&mut self.planes[channel], 0..stripes, &|stripe, tiles| {
            let finish = |column, tile: &mut [f32]| settle(tile, (stripe, column), members, finals);
            let left = &columns[stripe * STRIPE_COLUMNS..][..STRIPE_COLUMNS];
            f32::dispatch(set, StripeUpdate { tiles, left, right, depth: block, finish });
        });
    }

    /// Sets the rows and columns of the block's members, and changes nothing else.
    pub(super) fn settle_members(&mut self, channel: usize, has_finals: bool) {
        let stripes = self.stripes();
        let Workspace { finals, members, .. } = &self.workspace;
        let finals = has_finals.then_some(&finals[..stripes * STRIPE_COLUMNS]);
        for_each_stripe(&mut self.planes[channel], 0..stripes, &|stripe, tiles| {
            let is_row = in_stripe(members, stripe).next().is_some();
            for (column, tile) in tiles.chunks_exact_mut(TILE_LEN).enumerate() {
                if is_row || in_stripe(members, column).next().is_some() {
                    settle(tile, (stripe, column), members, finals);
                }
            }
        });
    }

    /// `out = G[:, named] operand` of one channel; `out` is `other` or, with `is_block`, `columns`.
    pub(super) fn gather_named(&mut self, channel: usize, is_block: bool) {
        let (stripes, set) = (self.stripes(), self.instructions);
        let Workspace { columns, other, operand, named, named_starts, .. } = &mut self.workspace;
        let plane = &self.planes[channel][..stripe_at(stripes)];
        let named = NamedColumns { slots: named, starts: named_starts, operand };
        let out = if is_block { &mut columns[channel] } else { other };
        out[..stripes * STRIPE_COLUMNS].par_chunks_mut(STRIPE_COLUMNS).enumerate().for_each(
            |(stripe, out)| {
                f32::dispatch(set, StripeGather { plane, stripe, named, out });
            },
        );
    }

    /// The columns of `slots` in `G` into `columns` of one channel.
    pub(super) fn copy_out(&mut self, channel: usize, slots: &[usize]) {
        let stripes = self.stripes();
        let plane = &self.planes[channel][..stripe_at(stripes)];
        self.workspace.columns[channel][..stripes * STRIPE_COLUMNS]
            .par_chunks_mut(STRIPE_COLUMNS)
            .enumerate()
            .for_each(|(stripe, columns)| {
                for (place, &slot) in slots.iter().enumerate() {
                    let (home, within) = (slot / TILE_EDGE, slot % TILE_EDGE);
                    let tile = &plane[tile_at(stripe.max(home), stripe.min(home))..][..TILE_LEN];
                    for (row, columns) in columns.chunks_exact_mut(BLOCK).enumerate() {
                        let at =
                            if stripe >= home { row * TILE_EDGE + within } else { within * TILE_EDGE + row };
                        columns[place] = tile[at];
                    }
                }
            });
    }
}
