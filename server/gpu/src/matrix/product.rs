//! The light of a frame: what carries light times what is wanted; and the drift probe, which is two such products.

use super::GpuMatrix;
use super::block::EXCHANGE_PLANE;
use super::buffers::Buffers;
use crate::news::News;
use crate::readback::read_now;
use crate::recorder::{Recorder, folded};
use earthshine_radiosity::BackendError;
use earthshine_shaders::host::{Pass, StripeMarks};
use earthshine_shaders::kernel::{EMIT_EXITANCE, MULTIPLY_TILES, SUM_TILES};
use earthshine_shaders::limits::{LANES, TILE_EDGE};
use wgpu::Buffer;

/// Which slots carry light and whose light is wanted, and the tiles that this needs: compacted on the host, a list of
/// whole tiles, since a single column of a tile would cost as many memory transactions as eight.
#[derive(Debug)]
pub(crate) struct Selection {
    marks: Vec<StripeMarks>,
    tiles: Vec<u32>,
}

impl Selection {
    /// Of `stripes` stripes.
    pub(crate) fn new(stripes: u32, is_lit: impl Fn(u32) -> bool, is_wanted: impl Fn(u32) -> bool) -> Self {
        let mut marks = vec![StripeMarks::default(); stripes as usize];
        for slot in 0..stripes * TILE_EDGE {
            let (stripe, within) = ((slot / TILE_EDGE) as usize, slot % TILE_EDGE);
            let bit = 1u32 << (within % 32);
            if is_lit(slot) {
                marks[stripe].lit[within as usize / 32] |= bit;
            }
            if is_wanted(slot) {
                marks[stripe].wanted[within as usize / 32] |= bit;
            }
        }
        let is_any = |bits: [u32; 2]| bits != [0; 2];
        let mut tiles = Vec::new();
        for (row, of_row) in marks.iter().enumerate() {
            for (column, of_column) in marks[..=row].iter().enumerate() {
                let forth = is_any(of_row.wanted) && is_any(of_column.lit);
                let back = is_any(of_column.wanted) && is_any(of_row.lit);
                if forth || back {
                    tiles.push((row as u32) << 16 | column as u32);
                }
            }
        }
        Self { marks, tiles }
    }
}

impl Recorder<'_> {
    /// `result = plane * sent / area + outside_weight * outside` for three channels; `X` is one plane for all.
    fn multiply(&mut self, buffers: &Buffers, is_exchange: bool, result: &Buffer, pass: Pass) {
        for channel in 0..3 {
            let plane = &buffers.planes[if is_exchange { EXCHANGE_PLANE } else { channel }];
            for part in &plane.parts {
                let (first_stripe, end_stripe) = (part.stripes.start, part.stripes.end);
                let pass = Pass { channel: channel as u32, first_stripe, end_stripe, ..pass };
                let bound = [&part.buffer, &buffers.tiles, &buffers.marks, &buffers.sent, &buffers.tile_sums];
                if pass.entry_count > 0 {
                    self.dispatch(&MULTIPLY_TILES, &bound, pass, folded(pass.entry_count));
                }
            }
        }
        let bound = [&buffers.tile_sums, &buffers.marks, &buffers.residents, &buffers.outside, result];
        self.dispatch(&SUM_TILES, &bound, pass, [pass.stripe_count, 3, 1]);
    }

    fn emit(&mut self, buffers: &Buffers, arriving: &Buffer, pass: Pass) {
        let bound = [&buffers.own, arriving, &buffers.residents, &buffers.sent];
        self.dispatch(&EMIT_EXITANCE, &bound, pass, [pass.rows.div_ceil(LANES), 1, 1]);
    }
}

impl GpuMatrix {
    /// Tells the device direct exitance and irradiance from outside of every slot, a channel after the other.
    pub(crate) fn upload_sources(&self, own: &[f32], outside: &[f32]) {
        self.upload(&self.buffers.own, own);
        self.upload(&self.buffers.outside, outside);
    }

    /// What [`Self::step`] needs: the tiles for what is lit and wanted.
    pub(crate) fn select(&self, is_lit: impl Fn(u32) -> bool, is_wanted: impl Fn(u32) -> bool) -> Selection {
        Selection::new(self.stripes(), is_lit, is_wanted)
    }

    /// Light of one frame from the sources uploaded last, and the way of what is news to the host.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn step(&mut self, selection: &Selection, news: &mut News) -> Result<(), BackendError> {
        let pass = self.select_tiles(selection);
        let pass = Pass { outside_weight: 1.0, ..pass };
        let (mut recorder, buffers) = self.recorder();
        if pass.stripe_count > 0 {
            recorder.emit(buffers, &buffers.outside, pass);
            recorder.multiply(buffers, false, &buffers.irradiance, pass);
        }
        news.record(&mut recorder, &buffers.irradiance, pass.rows, Some(&buffers.refused));
        let submission = recorder.submit()?;
        news.submitted(&self.device, submission);
        Ok(())
    }

    /// Light of the last frame, a channel after the other. Waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn irradiance(&self) -> Result<Vec<f32>, BackendError> {
        let light = &self.buffers.irradiance;
        Ok(bytemuck::pod_collect_to_vec(&read_now(&self.device, "light", light, light.size(), |_| {})?))
    }

    /// Whether light that was sent for is on its way.
    pub(crate) fn is_light_coming(&self) -> bool {
        self.light.is_coming()
    }

    /// Sends for the light of the last frame, a channel after the other.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
    pub(crate) fn send_for_light(&mut self) -> Result<(), BackendError> {
        self.light.send_for(&self.device, "light asked for", &[&self.buffers.irradiance])
    }

    /// The light that was sent for, once; nothing as long as it is on its way.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn light(&mut self) -> Result<Option<Vec<f32>>, BackendError> {
        let bytes = self.light.take(&self.device, None)?;
        Ok(bytes.map(|bytes| bytemuck::pod_collect_to_vec(&bytes)))
    }

    fn select_tiles(&self, selection: &Selection) -> Pass {
        self.upload(&self.buffers.marks, &selection.marks);
        self.upload(&self.buffers.tiles, &selection.tiles);
        Pass { entry_count: selection.tiles.len() as u32, ..self.pass() }
    }

    /// Whether a probe is under way.
    pub(crate) fn is_probing(&self) -> bool {
        self.probed.is_coming()
    }

    /// Asks for `h = H x` and `F (x + R h)` for `x`, a channel after the other; overwrites the device's own exitance.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
    pub(crate) fn probe(&mut self, x: &[f32]) -> Result<(), BackendError> {
        self.upload(&self.buffers.own, x);
        let residents = &self.residents;
        let is_taken = |slot: u32| residents[slot as usize].area > 0.0;
        let selection = Selection::new(self.stripes(), is_taken, is_taken);
        let pass = self.select_tiles(&selection);
        let (mut recorder, buffers) = self.recorder();
        // Nothing arrives from outside, and at first nothing at all.
        recorder.clear(&buffers.probed);
        recorder.clear(&buffers.gathered);
        if pass.stripe_count > 0 {
            recorder.emit(buffers, &buffers.gathered, pass);
            recorder.multiply(buffers, false, &buffers.probed, pass);
            recorder.emit(buffers, &buffers.probed, pass);
            recorder.multiply(buffers, true, &buffers.gathered, pass);
        }
        recorder.submit()?;
        self.probed.send_for(&self.device, "drift probe", &[&self.buffers.probed, &self.buffers.gathered])
    }

    /// What the probe found, once: what arrives by `H`, and by `F`; nothing as long as it is on its way, unless `is_waiting`.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn probed(&mut self, is_waiting: bool) -> Result<Option<[Vec<f32>; 2]>, BackendError> {
        let bytes = self.probed.take(&self.device, is_waiting.then_some("drift"))?;
        Ok(bytes.map(|bytes| {
            let (arriving, gathered) = bytes.split_at(bytes.len() / 2);
            [arriving, gathered].map(bytemuck::pod_collect_to_vec)
        }))
    }
}
