//! A block of patches enters, as far as the device finds its pivots strong enough.

use super::GpuMatrix;
use super::block::{Combine, EXCHANGE_PLANE};
use super::buffers::Buffers;
use crate::recorder::{Recorder, folded};
use earthshine_radiosity::local_matrix::Arrival;
use earthshine_radiosity::{BackendError, MIN_PIVOT, Slot};
use earthshine_shaders::host::{ExchangeEntry, Pass, Resident};
use earthshine_shaders::kernel::{RETURN_LIGHT, SCATTER_EXCHANGE};
use earthshine_shaders::limits::{BLOCK, LANES, RETURN_BANDS, TILE_EDGE};
use std::collections::BTreeMap;

/// What a block exchanges: with residents, as entries of its columns; among itself, m2.
#[derive(Debug)]
struct Exchange {
    entries: Vec<ExchangeEntry>,
    /// Row-major, [`BLOCK`] wide.
    among: Vec<f32>,
    is_named: Vec<u32>,
}

impl GpuMatrix {
    /// Adds up to 32 patches at once, as if one after the other. The device decides who enters, and its
    /// bits of who was refused say so; until then everybody counts as resident here.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`]: nothing of the block counts.
    pub(crate) fn add_block(&mut self, arrivals: &[Arrival<'_>]) -> Result<(), BackendError> {
        if arrivals.is_empty() {
            return Ok(());
        }
        let exchange = self.exchange_of(arrivals);
        let slots: Vec<u32> = arrivals.iter().map(|arrival| arrival.slot.0).collect();
        let offered: Vec<Resident> = arrivals
            .iter()
            .map(|of| Resident { reflectance: of.reflectance.to_array(), area: of.area })
            .collect();
        let extent_before = self.extent;
        self.extent = slots.iter().fold(self.extent, |extent, slot| extent.max(slot + 1));
        self.upload(&self.buffers.entries, &exchange.entries);
        self.upload(&self.buffers.among, &exchange.among);
        self.upload(&self.buffers.offered, &offered);
        self.name_stripes(&exchange.is_named);
        let entry_count = self.upload_members(&slots);
        let pass = Pass { entry_count, pivot_min: MIN_PIVOT, ..self.pass() };
        let (mut recorder, buffers) = self.recorder();
        recorder.clear(&buffers.exchange);
        let scattered = Pass { entry_count: exchange.entries.len() as u32, ..pass };
        let groups = folded(scattered.entry_count.div_ceil(LANES));
        let bound = [&buffers.entries, &buffers.residents, &buffers.exchange];
        recorder.dispatch(&SCATTER_EXCHANGE, &bound, scattered, groups);
        recorder.open_block(buffers, pass);
        recorder.solve_block(buffers, pass);
        recorder.close_loop(buffers, pass);
        // In `X` the members' rows are what they exchange among themselves.
        recorder.write_members(buffers, EXCHANGE_PLANE, &buffers.exchange, 0, pass);
        if let Err(error) = recorder.submit() {
            self.extent = extent_before;
            return Err(error);
        }
        for (&slot, &resident) in slots.iter().zip(&offered) {
            self.residents[slot as usize] = resident;
        }
        Ok(())
    }

    /// Entries of free slots are passed over, slots that are named twice are added up.
    fn exchange_of(&mut self, arrivals: &[Arrival<'_>]) -> Exchange {
        let place_of: BTreeMap<Slot, usize> =
            (0..).zip(arrivals).map(|(place, of)| (of.slot, place)).collect();
        let stripes = self.rows() / TILE_EDGE as usize;
        let width = BLOCK as usize;
        let (among, is_named) = (vec![0.0; width * width], vec![0; stripes]);
        let mut exchange = Exchange { entries: Vec::new(), among, is_named };
        let mut places = Vec::new();
        for (new, arrival) in arrivals.iter().enumerate() {
            for &(slot, share) in arrival.row {
                let square_metres = arrival.area * share;
                if self.is_taken(slot) {
                    let at = slot.0 * BLOCK + new as u32;
                    let exchanged = &mut self.exchanged[at as usize];
                    if *exchanged == 0.0 && square_metres > 0.0 {
                        places.push(at);
                    }
                    *exchanged += square_metres;
                } else if let Some(&other) = place_of.get(&slot).filter(|&&other| other <= new) {
                    exchange.among[new * width + other] += square_metres;
                    if other != new {
                        exchange.among[other * width + new] += square_metres;
                    }
                }
            }
        }
        for at in places {
            exchange.is_named[(at / BLOCK / TILE_EDGE) as usize] = 1;
            let exchange_m2 = std::mem::take(&mut self.exchanged[at as usize]);
            exchange.entries.push(ExchangeEntry { at, exchange_m2 });
        }
        exchange
    }
}

impl Recorder<'_> {
    /// Computes the block's columns from its exchange, and what comes back to its patches by way of residents.
    pub(super) fn open_block(&mut self, buffers: &Buffers, pass: Pass) {
        self.gather(buffers, false, &buffers.exchange, 0, pass);
        let how = Combine { first_stride: 0, second_weight: 0.0 };
        self.combine(buffers, [&buffers.exchange, &buffers.finals], &buffers.columns, how, pass);
        let bound = [&buffers.exchange, &buffers.columns, &buffers.residents, &buffers.returned];
        self.dispatch(&RETURN_LIGHT, &bound, pass, [RETURN_BANDS, 3, 1]);
    }
}
