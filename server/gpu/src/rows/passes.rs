//! Passes that several methods run.

use super::buffers::Buffers;
use crate::device::GpuDevice;
use crate::recorder::{Recorder, folded};
use earthshine_radiosity::solver::Method;
use earthshine_shaders::host::Pass;
use earthshine_shaders::kernel::{
    DRAW_ALIAS, DRAW_CDF, GATHER_ROWS, MEASURE_LIGHT, SEND_LIGHT, SUM_LIGHT, TAKE_GATHERED,
};
use earthshine_shaders::limits::LANES;
use std::ops::Range;
use wgpu::Buffer;

/// Rows that a workgroup of `gather_rows` sums.
const ROWS_A_GROUP: u32 = 4;

/// Workgroups of a thread an entry.
pub(super) fn groups(pass: Pass) -> [u32; 3] {
    folded(pass.entry_count.div_ceil(LANES))
}

/// Writes `range` of `values` to its place before the next submission runs.
pub(super) fn upload<T: bytemuck::NoUninit>(
    device: &GpuDevice,
    buffer: &Buffer,
    values: &[T],
    range: Range<usize>,
) {
    if !range.is_empty() {
        let at = (range.start * size_of::<T>()) as u64;
        device.queue().write_buffer(buffer, at, bytemuck::cast_slice(&values[range]));
    }
}

impl Recorder<'_> {
    pub(super) fn send_light(&mut self, buffers: &Buffers, pass: Pass) {
        // All slots, whatever the entries of other passes are.
        let pass = Pass { entry_count: buffers.slots, ..pass };
        let bound = [&buffers.residents, &buffers.own, &buffers.irradiance, &buffers.unshot, &buffers.sent];
        self.dispatch(&SEND_LIGHT, &bound, pass, groups(pass));
    }

    /// For as many of `slots` as the pass has entries.
    pub(super) fn gather_rows(&mut self, buffers: &Buffers, slots: &Buffer, outside: &Buffer, pass: Pass) {
        let bound = [slots, &buffers.rows, &buffers.links.buffer, &buffers.sent, outside, &buffers.gathered];
        self.dispatch(&GATHER_ROWS, &bound, pass, folded(pass.entry_count.div_ceil(ROWS_A_GROUP)));
    }

    pub(super) fn take_gathered(&mut self, buffers: &Buffers, slots: &Buffer, tolerance: f32, pass: Pass) {
        let pass = Pass { first_weight: tolerance, ..pass };
        let bound = [slots, &buffers.residents, &buffers.gathered, &buffers.irradiance, &buffers.unshot];
        self.dispatch(&TAKE_GATHERED, &bound, pass, groups(pass));
    }

    /// Sums over all slots.
    pub(super) fn measure_light(&mut self, buffers: &Buffers, pass: Pass) {
        let pass = Pass { entry_count: buffers.slots, ..pass };
        let bound = [
            &buffers.residents,
            &buffers.own,
            &buffers.irradiance,
            &buffers.unshot,
            &buffers.gathered,
            &buffers.light_sums,
        ];
        self.dispatch(&MEASURE_LIGHT, &bound, pass, groups(pass));
        let pass = Pass { entry_count: buffers.slots.div_ceil(LANES), ..pass };
        self.dispatch(&SUM_LIGHT, &[&buffers.light_sums, &buffers.shot_words], pass, [1, 1, 1]);
    }

    /// Draws of every row, blended with what `light` was; `outside` is what draws of the outside bring.
    pub(super) fn draw(
        &mut self,
        buffers: &Buffers,
        method: Method,
        [outside, light]: [&Buffer; 2],
        pass: Pass,
    ) {
        let row = [&buffers.spans, &buffers.outcomes.buffer, &buffers.totals, &buffers.sent, outside, light];
        if method == Method::Alias {
            self.dispatch(&DRAW_ALIAS, &[&row[..], &[&buffers.bins.buffer]].concat(), pass, groups(pass));
        } else {
            let tables = [&buffers.bins.buffer, &buffers.guide.buffer];
            self.dispatch(&DRAW_CDF, &[&row[..], &tables].concat(), pass, groups(pass));
        }
    }
}
