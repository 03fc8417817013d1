//! A block of patches enters: gather on the device, 32 x 32 on the host, update on the device.

use super::GpuMatrix;
use super::block::{Combine, EXCHANGE_PLANE};
use earthshine_radiosity::local_matrix::Arrival;
use earthshine_radiosity::local_matrix::capacitance::{Entering, SmallMatrices, symmetrise};
use earthshine_radiosity::{BackendError, MIN_PIVOT, Slot};
use earthshine_shaders::host::{ExchangeEntry, Pass};
use earthshine_shaders::kernel::{RETURN_LIGHT, SCATTER_EXCHANGE};
use earthshine_shaders::limits::{BLOCK, LANES, RETURN_BANDS, TILE_EDGE};
use std::collections::BTreeMap;

/// What a block exchanges: with residents, as entries of its columns; among itself, m2.
#[derive(Debug)]
struct Exchange {
    entries: Vec<ExchangeEntry>,
    /// Row-major, `block` wide.
    among: Vec<f64>,
    is_named: Vec<u32>,
}

impl GpuMatrix {
    /// Adds up to 32 patches at once, as if one after the other; returns who entered, a bit each, as
    /// [`earthshine_radiosity::LocalMatrix::add_block`] does.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`]: nothing of the block counts.
    pub(crate) fn add_block(&mut self, arrivals: &[Arrival<'_>]) -> Result<u32, BackendError> {
        let block = arrivals.len();
        if block == 0 {
            return Ok(0);
        }
        let exchange = self.exchange_of(arrivals);
        let slots: Vec<u32> = arrivals.iter().map(|arrival| arrival.slot.0).collect();
        self.extent = slots.iter().fold(self.extent, |extent, slot| extent.max(slot + 1));
        self.upload(&self.buffers.entries, &exchange.entries);
        self.name_stripes(&exchange.is_named);
        let pass = Pass { entry_count: exchange.entries.len() as u32, ..self.pass() };
        let (mut recorder, buffers, _) = self.recorder();
        recorder.clear(&buffers.exchange);
        let groups = crate::recorder::folded(pass.entry_count.div_ceil(LANES));
        recorder.dispatch(&SCATTER_EXCHANGE, &[&buffers.entries, &buffers.exchange], pass, groups);
        let _submitted = recorder.submit()?;
        let mut returned = self.open_block(block, false)?[0].clone();
        for channel in 0..3 {
            for (to, &among) in returned.plane_mut(channel).iter_mut().zip(&exchange.among) {
                *to += among;
            }
        }
        let patch = |place: usize| (arrivals[place].reflectance, arrivals[place].area);
        let entering = Entering::solve(&returned, f64::from(MIN_PIVOT), patch);
        self.close_block(&slots, &entering);
        self.write_exchange(&slots, &entering, &exchange.among)?;
        for (place, arrival) in arrivals.iter().enumerate() {
            if entering.kept >> place & 1 == 1 {
                self.set_resident(arrival.slot.0, Some(arrival));
            }
        }
        self.settle_residents();
        Ok(entering.kept)
    }

    /// Entries of free slots are passed over, slots that are named twice are added up.
    fn exchange_of(&self, arrivals: &[Arrival<'_>]) -> Exchange {
        let block = arrivals.len();
        let place_of: BTreeMap<Slot, usize> =
            (0..).zip(arrivals).map(|(place, of)| (of.slot, place)).collect();
        let stripes = self.rows() / TILE_EDGE as usize;
        let mut exchange =
            Exchange { entries: Vec::new(), among: vec![0.0; block * block], is_named: vec![0; stripes] };
        let mut columns: BTreeMap<u32, f32> = BTreeMap::new();
        for (new, arrival) in arrivals.iter().enumerate() {
            for &(slot, share) in arrival.row {
                let square_metres = arrival.area * share;
                if self.is_taken(slot) {
                    *columns.entry(slot.0 * BLOCK + new as u32).or_default() += square_metres;
                } else if let Some(&other) = place_of.get(&slot).filter(|&&other| other <= new) {
                    exchange.among[new * block + other] += f64::from(square_metres);
                    if other != new {
                        exchange.among[other * block + new] += f64::from(square_metres);
                    }
                }
            }
        }
        for (at, exchange_m2) in columns {
            exchange.is_named[(at / BLOCK / TILE_EDGE) as usize] = 1;
            exchange.entries.push(ExchangeEntry { at, exchange_m2 });
        }
        exchange
    }

    /// Computes the block's columns from its exchange; returns what comes back to its patches, by way of residents, and
    /// with `reads_exchange` what the members exchange among themselves directly.
    pub(super) fn open_block(
        &mut self,
        block: usize,
        reads_exchange: bool,
    ) -> Result<[SmallMatrices; 2], BackendError> {
        let pass = Pass { entry_count: block as u32, ..self.pass() };
        let (mut recorder, buffers, readback) = self.recorder();
        recorder.gather(buffers, false, &buffers.exchange, 0, pass);
        let how = Combine { first_stride: 0, second_weight: 0.0 };
        recorder.combine(buffers, [&buffers.exchange, &buffers.finals], &buffers.columns, how, pass);
        let bound = [&buffers.exchange, &buffers.columns, &buffers.residents, &buffers.returned];
        recorder.dispatch(&RETURN_LIGHT, &bound, pass, [RETURN_BANDS, 3, 1]);
        if reads_exchange {
            recorder.read_members(buffers, EXCHANGE_PLANE, 0, pass);
        }
        readback.record(recorder.encoder(), &[&buffers.returned, &buffers.among]);
        let submission = recorder.submit()?;
        self.block_readback.submitted(submission);
        let [mut returned, among] = self.fetch_block(block)?;
        (0..3).for_each(|channel| symmetrise(returned.plane_mut(channel), block));
        Ok([returned, among])
    }

    /// Uploads what a block was solved for.
    pub(super) fn close_block(&self, slots: &[u32], entering: &Entering) {
        self.upload_small([&entering.inverse, &entering.factor, &entering.among], slots.len());
    }

    /// Writes the block into the planes of `G` and `X`.
    fn write_exchange(
        &mut self,
        slots: &[u32],
        entering: &Entering,
        among: &[f64],
    ) -> Result<(), BackendError> {
        let entry_count = self.upload_members(slots, entering.kept);
        if entry_count == 0 {
            return Ok(());
        }
        // In `X` the members' rows are what they exchange among themselves: rows of the block's columns of their own.
        let block = slots.len();
        for (receiver, &slot) in slots.iter().enumerate() {
            let mut row = [0.0f32; BLOCK as usize];
            // Who did not enter exchanges nothing.
            if entering.kept >> receiver & 1 == 1 {
                for (to, &value) in row.iter_mut().zip(&among[receiver * block..(receiver + 1) * block]) {
                    *to = value as f32;
                }
            }
            let at = 4 * u64::from(slot) * u64::from(BLOCK);
            self.device.queue().write_buffer(&self.buffers.exchange, at, bytemuck::cast_slice(&row));
        }
        let pass = Pass { entry_count, ..self.pass() };
        let (mut recorder, buffers, _) = self.recorder();
        recorder.close_loop(buffers, pass);
        recorder.write_members(buffers, EXCHANGE_PLANE, &buffers.exchange, 0, pass);
        recorder.submit().map(|_| ())
    }
}
