//! A block of patches leaves: its columns are there, so only what its members exchange goes to the host.

use super::GpuMatrix;
use super::block::{EXCHANGE_PLANE, columns_stride};
use earthshine_radiosity::local_matrix::capacitance::{SmallMatrices, leaving};
use earthshine_radiosity::{BackendError, Slot};
use earthshine_shaders::host::Pass;

impl GpuMatrix {
    /// Removes up to 32 patches at once.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`]: nothing of the block counts.
    pub(crate) fn remove_block(&mut self, slots: &[Slot]) -> Result<(), BackendError> {
        let block = slots.len();
        if block == 0 {
            return Ok(());
        }
        let slots: Vec<u32> = slots.iter().map(|slot| slot.0).collect();
        let entry_count = self.upload_members(&slots, u32::MAX);
        let pass = Pass { entry_count, ..self.pass() };
        let (mut recorder, buffers, readback) = self.recorder();
        recorder.clear(&buffers.columns);
        for channel in 0..3 {
            recorder.copy_out(buffers, channel, &buffers.columns, columns_stride(pass), pass);
            recorder.read_members(buffers, channel, channel as u32, pass);
        }
        readback.record(recorder.encoder(), &[&buffers.returned, &buffers.among]);
        let submission = recorder.submit()?;
        self.block_readback.submitted(submission);
        let [_, exchange] = self.fetch_block(block)?;
        let patch = |place: usize| {
            let slot = Slot(slots[place]);
            (self.reflectance(slot), self.area(slot))
        };
        let factor = leaving(exchange, patch);
        let nothing = SmallMatrices::zero(block);
        self.upload_small([&nothing, &factor, &nothing], block);
        let (mut recorder, buffers, _) = self.recorder();
        recorder.close_loop(buffers, pass);
        // All of `finals` is zero now.
        recorder.write_members(buffers, EXCHANGE_PLANE, &buffers.finals, 0, pass);
        recorder.submit()?;
        slots.iter().for_each(|&slot| self.set_resident(slot, None));
        self.settle_residents();
        Ok(())
    }
}
