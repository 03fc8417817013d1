//! The way back from drift: Newton-Schulz a block of columns at a time, and the fresh solve.
//!
//! Both need the exchange `X` alone, which lies on the device. The formulas are those of
//! `radiosity::local_matrix::repair`. A fresh solve enters all residents into an empty `G`, block by block: O(M^3)
//! on the device, and as exact as a matrix that nobody ever left.

use super::GpuMatrix;
use super::block::{Combine, EXCHANGE_PLANE, columns_stride};
use earthshine_radiosity::{BackendError, Repaired};
use earthshine_shaders::host::{Pass, Resident};
use earthshine_shaders::limits::BLOCK;

/// Pivots of a fresh solve, whose patches were all accepted before: any that can be divided by.
const SOLVE_PIVOT_MIN: f32 = 1e-6;

impl GpuMatrix {
    /// Refines the columns of the next `columns_max` patches, at least one block of them; goes on where the last call
    /// left off.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn repair(&mut self, columns_max: u32) -> Result<Repaired, BackendError> {
        let mut columns = 0;
        loop {
            let slots: Vec<u32> =
                self.taken_slots().filter(|&slot| slot >= self.repair_from).take(BLOCK as usize).collect();
            self.refine(&slots)?;
            columns += slots.len() as u32;
            let last = slots.last().map_or(self.extent, |last| last + 1);
            let is_complete = !self.taken_slots().any(|slot| slot >= last);
            self.repair_from = if is_complete { 0 } else { last };
            if is_complete || columns.saturating_add(BLOCK) > columns_max {
                return Ok(Repaired { columns, is_complete });
            }
        }
    }

    fn refine(&mut self, slots: &[u32]) -> Result<(), BackendError> {
        if slots.is_empty() {
            return Ok(());
        }
        let entry_count = self.upload_members(slots);
        self.name_stripes(&vec![1; self.stripes() as usize]);
        let pass = Pass { entry_count, ..self.pass() };
        let stride = columns_stride(pass);
        let (mut recorder, buffers) = self.recorder();
        recorder.clear(&buffers.columns);
        recorder.clear(&buffers.exchange);
        recorder.copy_out(buffers, EXCHANGE_PLANE, &buffers.exchange, 0, pass);
        (0..3).for_each(|channel| recorder.copy_out(buffers, channel, &buffers.columns, stride, pass));
        // r = X e + X R A^-1 g - g
        recorder.gather(buffers, true, &buffers.columns, stride, pass);
        let residual = Combine { first_stride: 0, second_weight: -1.0 };
        recorder.combine(buffers, [&buffers.exchange, &buffers.columns], &buffers.update, residual, pass);
        // g + r + G R A^-1 r
        recorder.gather(buffers, false, &buffers.update, stride, pass);
        let refined = Combine { first_stride: stride, second_weight: 1.0 };
        recorder.combine(buffers, [&buffers.columns, &buffers.update], &buffers.finals, refined, pass);
        (0..3).for_each(|channel| recorder.write_members(buffers, channel, &buffers.finals, stride, pass));
        recorder.submit().map(|_| ())
    }

    /// Solves `G` afresh from `X`.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn resolve(&mut self) -> Result<(), BackendError> {
        let slots: Vec<u32> = self.taken_slots().collect();
        let (mut recorder, buffers) = self.recorder();
        for plane in &buffers.planes[..EXCHANGE_PLANE] {
            plane.parts.iter().for_each(|part| recorder.clear(&part.buffer));
        }
        // Nobody is there at first, and those who are not are passed over.
        recorder.copy(&buffers.residents, 0, &buffers.residents_before, 0, buffers.residents.size());
        recorder.clear(&buffers.residents);
        recorder.submit()?;
        self.name_stripes(&vec![1; self.stripes() as usize]);
        for block in slots.chunks(BLOCK as usize) {
            self.enter_again(block)?;
        }
        self.repair_from = 0;
        Ok(())
    }

    /// Enters residents whose rows and columns of `G` are empty; whom the device has refused, it refuses again.
    fn enter_again(&mut self, slots: &[u32]) -> Result<(), BackendError> {
        let entry_count = self.upload_members(slots);
        let pass = Pass { entry_count, pivot_min: SOLVE_PIVOT_MIN, ..self.pass() };
        let (mut recorder, buffers) = self.recorder();
        let bytes = size_of::<Resident>() as u64;
        for (place, &slot) in (0..).zip(slots) {
            let from = bytes * u64::from(slot);
            recorder.copy(&buffers.residents_before, from, &buffers.offered, bytes * place, bytes);
        }
        recorder.clear(&buffers.exchange);
        recorder.copy_out(buffers, EXCHANGE_PLANE, &buffers.exchange, 0, pass);
        recorder.open_block(buffers, pass);
        recorder.read_members(buffers, EXCHANGE_PLANE, 0, pass);
        recorder.solve_block(buffers, pass);
        recorder.close_loop(buffers, pass);
        recorder.submit().map(|_| ())
    }
}
