//! Alias tables on a device: many rows in one dispatch, long ones in sections with a table of the sections' totals on top.
//!
//! The words are those of `radiosity::tables::AliasTable::bins`, to the bit where the device divides as IEEE 754 says.

use crate::device::GpuDevice;
use crate::readback::read_now;
use crate::recorder::{Recorder, folded, uniform_buffer};
use crate::timing::{PassTime, Timing};
use earthshine_radiosity::BackendError;
use earthshine_radiosity::tables::SECTION_ITEMS_MAX;
use earthshine_shaders::host::{Pass, TableSpan};
use earthshine_shaders::kernel::BUILD_ALIAS;
use wgpu::{Buffer, BufferUsages};

/// Tables of rows whose lengths are known; built as often as their weights change.
#[derive(Debug)]
pub struct AliasBuilder {
    device: GpuDevice,
    /// Bins of each row: where they begin, and one past the last row's.
    row_starts: Vec<usize>,
    sections: Spans,
    tops: Spans,
    weights: Buffer,
    masses: Buffer,
    parts: Buffer,
    bins: Buffer,
    totals: Buffer,
    top_totals: Buffer,
    uniforms: Buffer,
    timing: Option<Timing>,
}

/// Spans of one dispatch.
#[derive(Debug)]
struct Spans {
    count: u32,
    /// Of all of them.
    items: u64,
    buffer: Buffer,
}

impl Spans {
    fn new(device: &GpuDevice, spans: &[TableSpan]) -> Result<Self, BackendError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let buffer = device.buffer("spans", size_of_val(spans) as u64, usage)?;
        device.queue().write_buffer(&buffer, 0, bytemuck::cast_slice(spans));
        let items = spans.iter().map(|span| u64::from(span.item_count)).sum();
        Ok(Self { count: spans.len() as u32, items, buffer })
    }
}

impl AliasBuilder {
    /// For rows of `lengths` items.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub fn new(device: &GpuDevice, lengths: &[usize]) -> Result<Self, BackendError> {
        let (mut sections, mut tops, mut row_starts) = (Vec::new(), Vec::new(), vec![0]);
        let (mut weight, mut bin) = (0, 0);
        for &length in lengths {
            let count = length.div_ceil(SECTION_ITEMS_MAX);
            if count > 1 {
                // Weights of a top table are totals of sections, which lie one after the other.
                let (first_weight, first_bin) = (sections.len() as u32, bin);
                tops.push(TableSpan { first_weight, first_bin, item_count: count as u32 });
                bin += count as u32;
            }
            for section in 0..count {
                let item_count = SECTION_ITEMS_MAX.min(length - section * SECTION_ITEMS_MAX) as u32;
                sections.push(TableSpan { first_weight: weight, first_bin: bin, item_count });
                weight += item_count;
                bin += item_count;
            }
            row_starts.push(bin as usize);
        }
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let buffer = |label: &str, numbers: u64| device.buffer(label, 4 * numbers, usage);
        Ok(Self {
            device: device.clone(),
            weights: buffer("weights", u64::from(weight))?,
            masses: buffer("masses", u64::from(weight))?,
            parts: buffer("parts", 2 * u64::from(weight))?,
            bins: buffer("bins", u64::from(bin))?,
            totals: buffer("totals", sections.len() as u64)?,
            top_totals: buffer("totals of rows", tops.len() as u64)?,
            sections: Spans::new(device, &sections)?,
            tops: Spans::new(device, &tops)?,
            row_starts,
            uniforms: uniform_buffer(device)?,
            timing: None,
        })
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

    /// Tells the device all rows' weights, one row after the other.
    ///
    /// # Errors
    /// [`BackendError::Length`], [`BackendError::NotFinite`] with the place as slot: nothing was uploaded.
    pub fn set_weights(&mut self, weights: &[f32]) -> Result<(), BackendError> {
        let (expected, actual) = (self.weight_count(), weights.len());
        if expected != actual {
            return Err(BackendError::Length { expected, actual });
        }
        if let Some(at) = weights.iter().position(|weight| !weight.is_finite()) {
            return Err(BackendError::NotFinite(earthshine_radiosity::Slot(at as u32)));
        }
        if !weights.is_empty() {
            self.device.queue().write_buffer(&self.weights, 0, bytemuck::cast_slice(weights));
        }
        Ok(())
    }

    fn weight_count(&self) -> usize {
        self.row_starts.last().copied().unwrap_or(0) - self.top_bins()
    }

    /// Bins of top tables: one a section of a row that has more than one.
    fn top_bins(&self) -> usize {
        let long = |bins: &&[usize]| bins[1] - bins[0] > SECTION_ITEMS_MAX;
        // A row of n items in s sections has n + s bins.
        let sections = |bins: &[usize]| (bins[1] - bins[0]).div_ceil(SECTION_ITEMS_MAX + 1);
        self.row_starts.windows(2).filter(long).map(sections).sum()
    }

    /// Builds all tables. Not waited for.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn build(&mut self) -> Result<(), BackendError> {
        let mut recorder = Recorder::new(&self.device, &self.uniforms, self.timing.as_mut());
        let stages =
            [(&self.sections, &self.weights, &self.totals), (&self.tops, &self.totals, &self.top_totals)];
        for (spans, weights, totals) in stages.into_iter().filter(|(spans, ..)| spans.count > 0) {
            let bound = [&spans.buffer, weights, &self.masses, &self.parts, &self.bins, totals];
            let pass = Pass { entry_count: spans.count, ..Pass::default() };
            recorder.over(spans.items).dispatch(&BUILD_ALIAS, &bound, pass, folded(spans.count));
        }
        recorder.submit().map(|_| ())
    }

    /// Waits until the device has done all it was told.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn finish(&self) -> Result<(), BackendError> {
        self.device.wait("finish", self.device.queue().submit([]))
    }

    /// The words of every row's table: top bins first where it has sections.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn read(&self) -> Result<Vec<Vec<u32>>, BackendError> {
        let count = self.row_starts.last().copied().unwrap_or(0);
        if count == 0 {
            return Ok(vec![Vec::new(); self.row_starts.len() - 1]);
        }
        let bytes = read_now(&self.device, "tables", &self.bins, 4 * count as u64, |_| {})?;
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
        Ok(self.row_starts.windows(2).map(|bins| words[bins[0]..bins[1]].to_vec()).collect())
    }
}
