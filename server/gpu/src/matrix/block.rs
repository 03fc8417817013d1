//! Passes that adds, removals and repairs share.

use super::GpuMatrix;
use super::buffers::Buffers;
use crate::plane::Plane;
use crate::recorder::Recorder;
use earthshine_shaders::host::{Member, Pass};
use earthshine_shaders::kernel::{
    COMBINE_COLUMNS, COPY_COLUMNS, GATHER_COLUMNS, RANK_UPDATE, READ_MEMBERS, SOLVE_BLOCK, TIMES_SMALL,
    WRITE_COLUMNS,
};
use earthshine_shaders::limits::{BLOCK, LANES, SECTIONS, TILE_EDGE};
use wgpu::Buffer;

/// `X` among the planes.
pub(super) const EXCHANGE_PLANE: usize = 3;

/// The weights of [`COMBINE_COLUMNS`] and how its first operand lies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Combine {
    /// 0 if all channels share the first operand.
    pub(super) first_stride: u32,
    pub(super) second_weight: f32,
}

/// Workgroups over the rows of every stripe that can hold anything.
fn row_groups(pass: Pass) -> u32 {
    (pass.stripe_count * TILE_EDGE).div_ceil(LANES)
}

/// Workgroups over the numbers of a channel of a block's columns.
fn column_groups(pass: Pass) -> u32 {
    pass.stripe_count * TILE_EDGE * BLOCK / LANES
}

/// Numbers from one channel of a block's columns to the next.
pub(super) fn columns_stride(pass: Pass) -> u32 {
    pass.rows * BLOCK
}

/// `pass` for each part of a plane that is of any stripe in use.
fn for_parts(plane: &Plane, pass: Pass, mut run: impl FnMut(&Buffer, Pass)) {
    for (part, of) in (0..).zip(&plane.parts) {
        let end_stripe = of.stripes.end.min(pass.stripe_count);
        if of.stripes.start < end_stripe || part == 0 {
            let part_count = plane.parts.len() as u32;
            run(&of.buffer, Pass { first_stripe: of.stripes.start, end_stripe, part, part_count, ..pass });
        }
    }
}

impl Recorder<'_> {
    /// `sums = planes * (scale * right)`; one plane a channel, or `X` for all.
    pub(super) fn gather(
        &mut self,
        buffers: &Buffers,
        is_exchange: bool,
        right: &Buffer,
        stride: u32,
        pass: Pass,
    ) {
        // Parts without stripes in use write no sums, which must be zero then.
        if buffers.planes[0].parts.len() > 1 {
            self.clear(&buffers.sums);
        }
        for channel in 0..3 {
            let plane = &buffers.planes[if is_exchange { EXCHANGE_PLANE } else { channel }];
            let pass = Pass { channel: channel as u32, channel_stride: stride, ..pass };
            for_parts(plane, pass, |part, pass| {
                let bound = [part, right, &buffers.residents, &buffers.is_named, &buffers.sums];
                self.dispatch(&GATHER_COLUMNS, &bound, pass, [pass.stripe_count, SECTIONS, 1]);
            });
        }
    }

    /// `result = first + second_weight * second + sums`.
    pub(super) fn combine(
        &mut self,
        buffers: &Buffers,
        operands: [&Buffer; 2],
        result: &Buffer,
        how: Combine,
        pass: Pass,
    ) {
        let part_count = buffers.planes[0].parts.len() as u32;
        let Combine { first_stride: channel_stride, second_weight } = how;
        let pass = Pass { part_count, channel_stride, first_weight: 1.0, second_weight, ..pass };
        let bound = [operands[0], operands[1], &buffers.sums, result];
        self.dispatch(&COMBINE_COLUMNS, &bound, pass, [column_groups(pass), 3, 1]);
    }

    /// Columns of the members out of a plane; `channel` says where in `to`, with `stride` 0 at its beginning.
    pub(super) fn copy_out(&mut self, buffers: &Buffers, plane: usize, to: &Buffer, stride: u32, pass: Pass) {
        let pass = Pass { channel: plane as u32, channel_stride: stride, ..pass };
        for_parts(&buffers.planes[plane], pass, |part, pass| {
            let bound = [part, &buffers.residents, &buffers.members, to];
            self.dispatch(&COPY_COLUMNS, &bound, pass, [row_groups(pass), pass.entry_count, 1]);
        });
    }

    /// What the members exchange among themselves by plane `plane`, as channel `channel` of `among`.
    pub(super) fn read_members(&mut self, buffers: &Buffers, plane: usize, channel: u32, pass: Pass) {
        let pass = Pass { channel, ..pass };
        for_parts(&buffers.planes[plane], pass, |part, pass| {
            let bound = [part, &buffers.members, &buffers.among];
            self.dispatch(&READ_MEMBERS, &bound, pass, [BLOCK * BLOCK / LANES, 1, 1]);
        });
    }

    /// Rows and columns of the members into a plane.
    pub(super) fn write_members(
        &mut self,
        buffers: &Buffers,
        plane: usize,
        finals: &Buffer,
        stride: u32,
        pass: Pass,
    ) {
        if pass.entry_count == 0 {
            return;
        }
        let pass = Pass { channel: plane as u32, channel_stride: stride, ..pass };
        for_parts(&buffers.planes[plane], pass, |part, pass| {
            let bound = [part, finals, &buffers.members];
            self.dispatch(&WRITE_COLUMNS, &bound, pass, [row_groups(pass), pass.entry_count, 1]);
        });
    }

    /// Decides who of the block enters, and solves for what [`Self::close_loop`] needs; from here on the device has who
    /// entered as residents, and who left not.
    pub(super) fn solve_block(&mut self, buffers: &Buffers, pass: Pass) {
        let bound = [
            &buffers.returned,
            &buffers.among,
            &buffers.offered,
            &buffers.residents,
            &buffers.members,
            &buffers.exchange,
            &buffers.small,
            &buffers.refused,
        ];
        self.dispatch(&SOLVE_BLOCK, &bound, pass, [1, 1, 1]);
    }

    /// `G += columns * (columns * K)'` for three channels, then the members' rows and columns are set to
    /// `columns * N` and what `small` says they exchange among themselves.
    pub(super) fn close_loop(&mut self, buffers: &Buffers, pass: Pass) {
        let bound = [&buffers.columns, &buffers.small, &buffers.members, &buffers.finals, &buffers.update];
        self.dispatch(&TIMES_SMALL, &bound, pass, [column_groups(pass), 3, 1]);
        for channel in 0..3 {
            let pass = Pass { channel: channel as u32, ..pass };
            for_parts(&buffers.planes[channel], pass, |part, pass| {
                let bound = [part, &buffers.columns, &buffers.update];
                let rows = pass.end_stripe.saturating_sub(pass.first_stripe);
                self.dispatch(&RANK_UPDATE, &bound, pass, [pass.stripe_count, rows, 1]);
            });
            self.write_members(buffers, channel, &buffers.finals, columns_stride(pass), pass);
        }
    }
}

impl GpuMatrix {
    /// Tells the device who the block is.
    pub(super) fn upload_members(&self, slots: &[u32]) -> u32 {
        let members: Vec<Member> = (0..).zip(slots).map(|(place, &slot)| Member { slot, place }).collect();
        self.upload(&self.buffers.members, &members);
        members.len() as u32
    }
}
