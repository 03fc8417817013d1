//! A block of patches leaves: its columns are there.

use super::GpuMatrix;
use super::block::{EXCHANGE_PLANE, columns_stride};
use crate::readback::Later;
use earthshine_radiosity::{BackendError, Slot};
use earthshine_shaders::host::{Pass, Resident};

impl GpuMatrix {
    /// Removes up to 32 patches at once. Those whom the device has refused are among them for nothing.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`]: nothing of the block counts.
    pub(crate) fn remove_block(&mut self, slots: &[Slot]) -> Result<(), BackendError> {
        if slots.is_empty() {
            return Ok(());
        }
        let slots: Vec<u32> = slots.iter().map(|slot| slot.0).collect();
        let entry_count = self.upload_members(&slots);
        let pass = Pass { entry_count, is_leaving: 1, ..self.pass() };
        let (mut recorder, buffers) = self.recorder();
        recorder.clear(&buffers.columns);
        for channel in 0..3 {
            recorder.copy_out(buffers, channel, &buffers.columns, columns_stride(pass), pass);
            recorder.read_members(buffers, channel, channel as u32, pass);
        }
        recorder.solve_block(buffers, pass);
        recorder.close_loop(buffers, pass);
        // All of `finals` is zero now.
        recorder.write_members(buffers, EXCHANGE_PLANE, &buffers.finals, 0, pass);
        recorder.submit()?;
        slots.iter().for_each(|&slot| self.forget(Slot(slot)));
        Ok(())
    }

    /// Nobody holds `slot` any more, as the device knows already: its patch has left, or was refused.
    pub(crate) fn forget(&mut self, slot: Slot) {
        self.residents[slot.0 as usize] = Resident::default();
        self.shrink();
    }

    /// Everybody leaves: what there was is zeroed, and light and probes of it that are on their way are forgotten.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`]: everybody is still there.
    pub(crate) fn clear(&mut self) -> Result<(), BackendError> {
        let (mut recorder, buffers) = self.recorder();
        let planes = buffers.planes.iter().flat_map(|plane| &plane.parts).map(|part| &part.buffer);
        planes.chain([&buffers.residents, &buffers.refused]).for_each(|buffer| recorder.clear(buffer));
        recorder.submit()?;
        self.residents.fill(Resident::default());
        (self.light, self.probed) = (Later::default(), Later::default());
        (self.extent, self.repair_from) = (0, 0);
        Ok(())
    }
}
