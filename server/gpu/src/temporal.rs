//! Temporal radiosity on a device: tables of resident rows and a frame of draws from them, every pass a kernel.
//!
//! The rows are those of a moment: who comes or goes makes new ones. Outcomes, tables and random bits are integers and the
//! CPU's; light is their sum in the CPU's order, up to what a device rounds otherwise. Not here: adaptive draws, shots.

use crate::alias::AliasBuilder;
use crate::device::GpuDevice;
use crate::readback::read_now;
use crate::recorder::{Recorder, folded, uniform_buffer};
use crate::timing::{PassTime, Timing};
use earthshine_radiosity::solver::sampler::{FAR, SKY};
use earthshine_radiosity::solver::{Light, Method, SolverSettings};
use earthshine_radiosity::{BackendError, Slot};
use earthshine_shaders::host::{Pass, Resident, RowSpan};
use earthshine_shaders::kernel::{
    BUILD_CDF, DRAW_ALIAS, DRAW_CDF, Kernel, SEND_LIGHT, SHARE_OUTSIDE, SPLIT_OUTSIDE,
};
use earthshine_shaders::limits::LANES;
use earthshine_world::Rgb;
use wgpu::{Buffer, BufferUsages};

/// The row of one slot.
#[derive(Debug, Clone, Default)]
pub struct TemporalRow {
    /// Form factors by slot; none for a free slot.
    pub links: Option<Vec<(u32, f32)>>,
    /// The sky's share of the row.
    pub sky_share: f32,
    /// Of its patch.
    pub reflectance: Rgb,
}

/// Tables and light of all slots.
#[derive(Debug)]
pub struct GpuTemporal {
    device: GpuDevice,
    slots: u32,
    tables: Tables,
    spans: Buffer,
    outcomes: Buffer,
    totals: Buffer,
    sky_shares: Buffer,
    residents: Buffer,
    own: Buffer,
    outside: Buffer,
    sky: Buffer,
    outside_draws: Buffer,
    sent: Buffer,
    irradiance: Buffer,
    uniforms: Buffer,
    timing: Option<Timing>,
}

/// Tables of either kind.
#[derive(Debug)]
enum Tables {
    Alias(Box<AliasBuilder>),
    Cdf { weights: Buffer, ends: Buffer, guide: Buffer },
}

impl Tables {
    /// What they are made from.
    fn weights(&self) -> &Buffer {
        match self {
            Self::Alias(builder) => builder.weights(),
            Self::Cdf { weights, .. } => weights,
        }
    }
}

/// Where everything of a row lies.
struct Places {
    spans: Vec<RowSpan>,
    outcomes: Vec<u32>,
    weights: Vec<f32>,
    guide_count: u32,
}

impl Places {
    fn of(rows: &[TemporalRow]) -> Self {
        let mut places =
            Self { spans: Vec::new(), outcomes: Vec::new(), weights: Vec::new(), guide_count: 0 };
        for (slot, row) in (0u32..).zip(rows) {
            let first_item = places.weights.len() as u32;
            let mut span =
                RowSpan { first_item, first_bin: first_item, total_at: slot, ..RowSpan::default() };
            if let Some(links) = &row.links {
                places.outcomes.extend(links.iter().map(|&(other, _)| other).chain([FAR, SKY]));
                // What is far and the sky is the device's to say.
                places.weights.extend(links.iter().map(|&(_, share)| share).chain([0.0; 2]));
                span.item_count = places.weights.len() as u32 - first_item;
                span.first_guide = places.guide_count;
                places.guide_count += span.item_count.next_power_of_two().min(GUIDE_MAX);
            }
            places.spans.push(span);
        }
        places
    }
}

/// Most parts of a guide.
const GUIDE_MAX: u32 = 1 << 12;

impl GpuTemporal {
    /// Tables of `rows`, one a slot, of the kind that `method` draws from; dark.
    ///
    /// # Errors
    /// [`BackendError::Share`], [`BackendError::SlotOutside`]: nothing of a row that cannot be gets to the device.
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    ///
    /// # Panics
    /// If `method` is neither [`Method::Alias`] nor [`Method::Cdf`].
    pub fn new(device: &GpuDevice, method: Method, rows: &[TemporalRow]) -> Result<Self, BackendError> {
        assert!(method.is_endless(), "{method} is no temporal method");
        check(rows)?;
        let mut places = Places::of(rows);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let numbers = |label: &str, count: usize| device.buffer(label, 4 * count as u64, usage);
        let lights = |label: &str, count: usize| device.buffer(label, 16 * count as u64, usage);
        let (slots, items) = (rows.len(), places.weights.len());
        let (tables, total_count) = if method == Method::Alias {
            let lengths: Vec<usize> = places.spans.iter().map(|span| span.item_count as usize).collect();
            let builder = AliasBuilder::new(device, &lengths)?;
            let (bins, totals) = builder.places();
            for (span, (&bin, &total)) in places.spans.iter_mut().zip(bins.iter().zip(&totals)) {
                (span.first_bin, span.total_at) = (bin as u32, total);
            }
            let total_count = builder.total_count();
            (Tables::Alias(Box::new(builder)), total_count)
        } else {
            let (weights, ends) = (numbers("weights", items)?, numbers("ends", items)?);
            let guide = numbers("guide", places.guide_count as usize)?;
            (Tables::Cdf { weights, ends, guide }, slots)
        };
        let temporal = Self {
            device: device.clone(),
            slots: slots as u32,
            tables,
            spans: device.buffer("spans", size_of_val(places.spans.as_slice()) as u64, usage)?,
            outcomes: numbers("outcomes", items)?,
            totals: numbers("totals", total_count)?,
            sky_shares: numbers("sky shares", slots)?,
            residents: lights("residents", slots)?,
            own: lights("own light", slots)?,
            outside: lights("outside", slots)?,
            sky: lights("sky", slots)?,
            outside_draws: lights("draws of the outside", 2 * slots)?,
            sent: lights("sent", slots)?,
            irradiance: lights("irradiance", slots)?,
            uniforms: uniform_buffer(device)?,
            timing: None,
        };
        temporal.upload(&temporal.spans, &places.spans);
        temporal.upload(&temporal.outcomes, &places.outcomes);
        temporal.upload(temporal.tables.weights(), &places.weights);
        let sky_shares: Vec<f32> = rows.iter().map(|row| row.sky_share).collect();
        temporal.upload(&temporal.sky_shares, &sky_shares);
        let resident = |row: &TemporalRow| Resident { reflectance: row.reflectance.to_array(), area: 1.0 };
        temporal.upload(&temporal.residents, &rows.iter().map(resident).collect::<Vec<_>>());
        Ok(temporal)
    }

    /// Times every pass from now on; false where the device cannot.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub fn time_passes(&mut self) -> Result<bool, BackendError> {
        self.timing = Timing::new(&self.device)?;
        Ok(self.timing.is_some())
    }

    /// The passes since the last call. Waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn take_times(&mut self) -> Result<Vec<PassTime>, BackendError> {
        self.timing.as_mut().map_or(Ok(Vec::new()), |timing| timing.take(&self.device))
    }

    /// Builds all tables: what of each row is far and the sky's, then bins or ends. Not waited for.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn rebuild(&mut self) -> Result<(), BackendError> {
        let pass = Pass { entry_count: self.slots, ..Pass::default() };
        let mut recorder = Recorder::new(&self.device, &self.uniforms, self.timing.as_mut());
        let bound = [&self.spans, &self.sky_shares, self.tables.weights()];
        recorder.dispatch(&SPLIT_OUTSIDE, &bound, pass, folded(self.slots));
        if let Tables::Cdf { weights, ends, guide } = &self.tables {
            let bound = [&self.spans, weights, ends, guide, &self.totals];
            recorder.dispatch(&BUILD_CDF, &bound, pass, folded(self.slots));
        }
        recorder.submit()?;
        if let Tables::Alias(builder) = &mut self.tables {
            builder.build()?;
            builder.copy_totals(&self.totals)?;
        }
        Ok(())
    }

    /// Own light, irradiance from outside, and what of it is the sky's, of every slot.
    ///
    /// # Errors
    /// [`BackendError::Length`], [`BackendError::NotFinite`]: nothing was uploaded. [`BackendError::DeviceLost`].
    pub fn set_light(&mut self, own: &[Rgb], outside: &[Rgb], sky: &[Rgb]) -> Result<(), BackendError> {
        let slots: Vec<Slot> = (0..self.slots).map(Slot).collect();
        earthshine_radiosity::slot_check::are_sources(&slots, own, outside)?;
        earthshine_radiosity::slot_check::are_sources(&slots, own, sky)?;
        for (buffer, values) in [(&self.own, own), (&self.outside, outside), (&self.sky, sky)] {
            let lights: Vec<Light> = values.iter().map(|value| value.extend(0.0).to_array()).collect();
            self.upload(buffer, &lights);
        }
        let pass = Pass { entry_count: self.slots, ..Pass::default() };
        let mut recorder = Recorder::new(&self.device, &self.uniforms, self.timing.as_mut());
        let bound = [&self.spans, self.tables.weights(), &self.outside, &self.sky, &self.outside_draws];
        recorder.dispatch(&SHARE_OUTSIDE, &bound, pass, folded(self.slots.div_ceil(LANES)));
        recorder.submit().map(|_| ())
    }

    /// A frame: what leaves each patch, then draws of every row, blended with the past. Not waited for.
    ///
    /// # Errors
    /// [`BackendError::Settings`], [`BackendError::DeviceLost`].
    pub fn step(&mut self, settings: &SolverSettings, frame: u32) -> Result<(), BackendError> {
        settings.validate().map_err(BackendError::Settings)?;
        let pass = Pass {
            entry_count: self.slots,
            seed: settings.seed,
            frame,
            samples_per_row: settings.samples_per_row,
            first_weight: settings.history_weight,
            ..Pass::default()
        };
        let grid = folded(self.slots.div_ceil(LANES));
        let mut recorder = Recorder::new(&self.device, &self.uniforms, self.timing.as_mut());
        let bound = [&self.residents, &self.own, &self.irradiance, &self.sent];
        recorder.dispatch(&SEND_LIGHT, &bound, pass, grid);
        let row =
            [&self.spans, &self.outcomes, &self.totals, &self.sent, &self.outside_draws, &self.irradiance];
        let (kernel, tables): (&Kernel, Vec<&Buffer>) = match &self.tables {
            Tables::Alias(builder) => (&DRAW_ALIAS, vec![builder.bins()]),
            Tables::Cdf { ends, guide, .. } => (&DRAW_CDF, vec![ends, guide]),
        };
        recorder.dispatch(kernel, &[&row[..], &tables].concat(), pass, grid);
        recorder.submit().map(|_| ())
    }

    /// The light of every slot, lx. Waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn read(&self) -> Result<Vec<Rgb>, BackendError> {
        if self.slots == 0 {
            return Ok(Vec::new());
        }
        let bytes = read_now(&self.device, &self.irradiance, 16 * u64::from(self.slots), |_| {})?;
        let lights: Vec<Light> = bytemuck::pod_collect_to_vec(&bytes);
        Ok(lights.into_iter().map(|light| Rgb::new(light[0], light[1], light[2])).collect())
    }

    /// The words of every table, one row after the other: bins, or ends and then guides; and what of each row is outside.
    /// For tests and comparison. Waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn read_tables(&self) -> Result<(Vec<u32>, Vec<f32>), BackendError> {
        let words = |buffer: &Buffer| read_now(&self.device, buffer, buffer.size(), |_| {});
        let mut table = match &self.tables {
            Tables::Alias(builder) => words(builder.bins())?,
            Tables::Cdf { ends, .. } => words(ends)?,
        };
        if let Tables::Cdf { guide, .. } = &self.tables {
            table.extend(words(guide)?);
        }
        let weights = words(self.tables.weights())?;
        Ok((bytemuck::pod_collect_to_vec(&table), bytemuck::pod_collect_to_vec(&weights)))
    }

    /// Waits until the device has done all it was told.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn finish(&self) -> Result<(), BackendError> {
        self.device.wait(self.device.queue().submit([]))
    }

    fn upload<T: bytemuck::NoUninit>(&self, buffer: &Buffer, values: &[T]) {
        if !values.is_empty() {
            self.device.queue().write_buffer(buffer, 0, bytemuck::cast_slice(values));
        }
    }
}

/// Shares are shares, and slots are there.
fn check(rows: &[TemporalRow]) -> Result<(), BackendError> {
    for (slot, row) in (0u32..).map(Slot).zip(rows) {
        let links = row.links.iter().flatten();
        if let Some(&(other, _)) = links.clone().find(|(other, _)| *other as usize >= rows.len()) {
            return Err(BackendError::SlotOutside(Slot(other), rows.len() as u32));
        }
        let mut shares = links.map(|&(_, share)| share).chain([row.sky_share]);
        if let Some(share) = shares.find(|share| !(0.0..=1.0).contains(share)) {
            return Err(BackendError::Share(slot, share));
        }
        if !(row.reflectance.is_finite() && row.reflectance.min_element() >= 0.0) {
            return Err(BackendError::NotFinite(slot));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
