//! What lies on the device for the light of rows.

use super::passes::upload;
use crate::device::GpuDevice;
use crate::recorder::uniform_buffer;
use earthshine_radiosity::BackendError;
use earthshine_radiosity::solver::{Light, Method};
use earthshine_shaders::host::{Link, LiveRow, Resident, RowSpan};
use earthshine_shaders::limits::{LANES, SHOT_CLASSES, SHOT_WORDS};
use wgpu::{Buffer, BufferUsages};

const USAGE: BufferUsages = BufferUsages::STORAGE.union(BufferUsages::COPY_DST).union(BufferUsages::COPY_SRC);

/// Bytes that a slot takes in all lists by slot: its row and tables, what it is, eleven lights, its draws of the outside, what is
/// shot.
pub(crate) const SLOT_BYTES: u64 = (size_of::<LiveRow>()
    + size_of::<RowSpan>()
    + size_of::<Resident>()
    + 11 * size_of::<Light>()
    + 4 * (4 + 2 * 8 + 3 + 8)) as u64;
/// Bytes that a link takes: itself, and its outcome, bin and guide in a table.
pub(crate) const LINK_BYTES: u64 = (size_of::<Link>() + 3 * 4) as u64;

/// A buffer that grows.
#[derive(Debug)]
pub(super) struct Growing {
    pub(super) buffer: Buffer,
    label: &'static str,
    item_bytes: u64,
}

impl Growing {
    fn new(
        device: &GpuDevice,
        label: &'static str,
        item_bytes: usize,
        count: usize,
    ) -> Result<Self, BackendError> {
        let item_bytes = item_bytes as u64;
        let buffer = buffer_of(device, label, item_bytes * count as u64)?;
        Ok(Self { buffer, label, item_bytes })
    }

    /// Makes room for `count` items; what is there stays.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`] for more than a binding holds; [`BackendError::DeviceLost`].
    pub(super) fn reserve(&mut self, device: &GpuDevice, count: u64) -> Result<(), BackendError> {
        let bytes = count * self.item_bytes;
        if bytes <= self.buffer.size() {
            return Ok(());
        }
        let most = device.binding_bytes_max().min(bytes.next_power_of_two());
        let grown = buffer_of(device, self.label, bytes.max(most))?;
        let mut encoder = device.wgpu().create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&self.buffer, 0, &grown, 0, self.buffer.size());
        device.queue().submit([encoder.finish()]);
        self.buffer = grown;
        Ok(())
    }

    /// Writes to the beginning before the next submission runs; there has to be room.
    pub(super) fn write<T: bytemuck::NoUninit>(&self, device: &GpuDevice, values: &[T]) {
        upload(device, &self.buffer, values, 0..values.len());
    }

    /// Makes room and writes.
    pub(super) fn fill<T: bytemuck::NoUninit>(
        &mut self,
        device: &GpuDevice,
        values: &[T],
    ) -> Result<(), BackendError> {
        self.reserve(device, values.len() as u64)?;
        self.write(device, values);
        Ok(())
    }
}

/// A zeroed buffer that a kernel can bind.
fn buffer_of(device: &GpuDevice, label: &str, bytes: u64) -> Result<Buffer, BackendError> {
    if bytes > device.binding_bytes_max() {
        return Err(BackendError::OutOfMemory { slots: 0, bytes });
    }
    device.buffer(label, bytes, USAGE)
}

/// All buffers.
#[derive(Debug)]
pub(super) struct Buffers {
    pub(super) slots: u32,
    /// Rows: their links, where they are, what they leave for the outside.
    pub(super) links: Growing,
    pub(super) rows: Buffer,
    pub(super) outside_shares: Buffer,
    /// Tables: bins of alias tables or ends of cumulative ones.
    pub(super) spans: Buffer,
    pub(super) outcomes: Growing,
    pub(super) bins: Growing,
    pub(super) guide: Growing,
    pub(super) totals: Buffer,
    /// Room to build tables.
    pub(super) builds: Growing,
    pub(super) weights: Growing,
    pub(super) masses: Growing,
    pub(super) parts: Growing,
    pub(super) sections: Growing,
    pub(super) section_totals: Growing,
    pub(super) tops: Growing,
    pub(super) top_totals: Growing,
    /// Who comes and goes.
    pub(super) edits: Growing,
    pub(super) leaving: Buffer,
    pub(super) newcomers: Growing,
    pub(super) some_slots: Growing,
    pub(super) all_slots: Buffer,
    /// By slot.
    pub(super) residents: Buffer,
    pub(super) new_own: Buffer,
    pub(super) new_outside: Buffer,
    pub(super) own: Buffer,
    pub(super) outside: Buffer,
    pub(super) sky: Buffer,
    pub(super) sky_shares: Buffer,
    pub(super) irradiance: Buffer,
    pub(super) unshot: Buffer,
    pub(super) arriving: Buffer,
    pub(super) rest: Buffer,
    pub(super) sent: Buffer,
    pub(super) gathered: Buffer,
    pub(super) outside_draws: Buffer,
    pub(super) dark: Buffer,
    pub(super) published: Buffer,
    /// Shots.
    pub(super) shot_words: Buffer,
    pub(super) classes: Buffer,
    pub(super) group_counts: Buffer,
    pub(super) shooters: Buffer,
    pub(super) shot: Buffer,
    pub(super) arrived: Buffer,
    pub(super) light_sums: Buffer,
    pub(super) uniforms: Buffer,
}

impl Buffers {
    /// For `slots` slots whose rows take `link_count` places at first. What `method` has no use for is small.
    pub(super) fn new(
        device: &GpuDevice,
        slots: usize,
        link_count: usize,
        method: Method,
    ) -> Result<Self, BackendError> {
        let numbers = |label: &str, count: usize| buffer_of(device, label, 4 * count as u64);
        let lights = |label: &str| buffer_of(device, label, (size_of::<Light>() * slots) as u64);
        let small = |label: &'static str, bytes: usize| Growing::new(device, label, bytes, 0);
        let is_shot = matches!(method, Method::Progressive | Method::Hybrid);
        let of_shots = if is_shot { slots } else { 0 };
        let groups = slots.div_ceil(LANES as usize);
        let all_slots = numbers("all slots", slots)?;
        upload(device, &all_slots, &(0..slots as u32).collect::<Vec<_>>(), 0..slots);
        Ok(Self {
            slots: slots as u32,
            links: Growing::new(device, "links", size_of::<Link>(), link_count)?,
            rows: buffer_of(device, "rows", (size_of::<LiveRow>() * slots) as u64)?,
            outside_shares: numbers("outside shares", slots)?,
            spans: buffer_of(device, "spans", (size_of::<RowSpan>() * slots) as u64)?,
            outcomes: small("outcomes", 4)?,
            bins: small("bins", 4)?,
            guide: small("guide", 4)?,
            totals: numbers("totals", slots)?,
            builds: small("builds", size_of::<RowSpan>())?,
            weights: small("weights", 4)?,
            masses: small("masses", 4)?,
            parts: small("parts", 8)?,
            sections: small("sections", 12)?,
            section_totals: small("totals of sections", 4)?,
            tops: small("tops", 12)?,
            top_totals: small("totals of tops", 4)?,
            edits: small("edits", 24)?,
            leaving: numbers("leaving", slots.div_ceil(32))?,
            newcomers: small("newcomers", size_of::<Link>())?,
            some_slots: small("some slots", 4)?,
            all_slots,
            residents: buffer_of(device, "residents", (size_of::<Resident>() * slots) as u64)?,
            new_own: lights("new own light")?,
            new_outside: lights("new outside")?,
            own: lights("own light")?,
            outside: lights("outside")?,
            sky: lights("sky")?,
            sky_shares: numbers("sky shares", slots)?,
            irradiance: lights("irradiance")?,
            unshot: lights("unshot")?,
            arriving: lights("arriving")?,
            rest: lights("rest")?,
            sent: lights("sent")?,
            gathered: lights("gathered")?,
            outside_draws: numbers("draws of the outside", 8 * slots)?,
            dark: numbers("dark", 8 * slots)?,
            published: numbers("published", 3 * slots)?,
            shot_words: numbers("words of shots", SHOT_WORDS as usize)?,
            classes: numbers("classes", SHOT_CLASSES as usize)?,
            group_counts: numbers("counts of workgroups", groups)?,
            shooters: numbers("shooters", of_shots)?,
            shot: numbers("shot", 4 * of_shots)?,
            arrived: numbers("arrived", 3 * of_shots)?,
            light_sums: numbers("sums of light", 8 * groups)?,
            uniforms: uniform_buffer(device)?,
        })
    }
}
