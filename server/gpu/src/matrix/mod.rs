//! The local matrix on a device: planes, the blocks that enter and leave, products.
//!
//! The formulas are those of `radiosity::local_matrix`. All of it runs in kernels, one submission a block, and nobody waits:
//! who enters, the device decides by the pivots it meets. So who is where is known there; the host keeps what it asked for,
//! and is told later who was refused, by bits that come with light. Until then a refused patch is a slot of the host's that has
//! no resident on the device: kernels pass it over as they pass over free slots, whatever its row and column hold.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | who is where |
//! | `buffers.rs` | what lies on the device |
//! | `block.rs` | passes that adds, removals and repairs share; the 32 x 32 systems |
//! | `add.rs`, `remove.rs` | a block enters, a block leaves |
//! | `repair.rs` | Newton-Schulz, a block of columns at a time; the fresh solve |
//! | `product.rs` | the light of a frame, the drift probe |

mod add;
mod block;
mod buffers;
mod product;
mod remove;
mod repair;

use crate::device::GpuDevice;
use crate::readback::Later;
use crate::recorder::Recorder;
use crate::timing::{PassTime, Sampling, Timing};
use buffers::Buffers;
use earthshine_radiosity::{BackendError, Slot};
use earthshine_shaders::host::{Pass, Resident};
use earthshine_shaders::limits::{BLOCK, TILE_EDGE};
use earthshine_world::Rgb;

pub(crate) use buffers::sizes;

/// `G`, `X` and room to change them.
#[derive(Debug)]
pub(crate) struct GpuMatrix {
    device: GpuDevice,
    capacity: u32,
    buffers: Buffers,
    /// Reflectance and area of each slot, of those whom the device has refused too until it is told.
    residents: Vec<Resident>,
    /// What a block exchanges with residents, m2, a column for each patch; zero between blocks.
    exchanged: Vec<f32>,
    /// One past the highest taken slot.
    extent: u32,
    /// Stripes that hold what the next gather multiplies.
    named: u32,
    /// Next slot whose column is to be refined.
    repair_from: u32,
    /// Of a drift probe: what arrives by `H`, and by `F`; on its way to the host.
    probed: Later,
    /// Light of a step, whole, on its way to the host.
    light: Later,
    timing: Option<Timing>,
    sampling: Sampling,
}

impl GpuMatrix {
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn new(device: &GpuDevice, capacity: u32) -> Result<Self, BackendError> {
        let buffers = Buffers::new(device, capacity)?;
        let rows = buffers.rows as usize;
        Ok(Self {
            device: device.clone(),
            capacity,
            buffers,
            residents: vec![Resident::default(); rows],
            exchanged: vec![0.0; rows * BLOCK as usize],
            extent: 0,
            named: 0,
            repair_from: 0,
            probed: Later::default(),
            light: Later::default(),
            timing: None,
            sampling: Sampling::default(),
        })
    }

    pub(crate) fn device(&self) -> &GpuDevice {
        &self.device
    }

    pub(crate) fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Rows of a vector: the capacity in whole stripes.
    pub(crate) fn rows(&self) -> usize {
        self.residents.len()
    }

    pub(crate) fn is_taken(&self, slot: Slot) -> bool {
        self.area(slot) > 0.0
    }

    /// m2; 0 for a free slot or one beyond the capacity.
    pub(crate) fn area(&self, slot: Slot) -> f32 {
        self.residents.get(slot.0 as usize).map_or(0.0, |resident| resident.area)
    }

    pub(crate) fn reflectance(&self, slot: Slot) -> Rgb {
        Rgb::from_array(self.residents[slot.0 as usize].reflectance)
    }

    /// Stripes that can hold anything.
    fn stripes(&self) -> u32 {
        self.extent.div_ceil(TILE_EDGE)
    }

    fn taken_slots(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.extent).filter(|&slot| self.residents[slot as usize].area > 0.0)
    }

    /// What every pass is told.
    fn pass(&self) -> Pass {
        Pass { rows: self.buffers.rows, stripe_count: self.stripes(), part_count: 1, ..Pass::default() }
    }

    fn recorder(&mut self) -> (Recorder<'_>, &Buffers) {
        let mut recorder = Recorder::new(&self.device, &self.buffers.uniforms, self.timing.as_mut());
        recorder.over(u64::from(self.named));
        (recorder, &self.buffers)
    }

    /// Says which stripes hold what the next gather multiplies.
    fn name_stripes(&mut self, is_named: &[u32]) {
        self.named = is_named.iter().sum();
        self.upload(&self.buffers.is_named, is_named);
    }

    /// Brings `extent` down to the highest taken slot.
    fn shrink(&mut self) {
        while self.extent > 0 && self.residents[self.extent as usize - 1].area == 0.0 {
            self.extent -= 1;
        }
    }

    /// Writes to the beginning of a buffer before the next submission runs.
    fn upload<T: bytemuck::NoUninit>(&self, buffer: &wgpu::Buffer, values: &[T]) {
        if !values.is_empty() {
            self.device.queue().write_buffer(buffer, 0, bytemuck::cast_slice(values));
        }
    }

    /// Starts timing every pass; false where the device cannot.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn time_passes(&mut self) -> Result<bool, BackendError> {
        if self.timing.is_none() {
            self.timing = Timing::new(&self.device)?;
        }
        Ok(self.timing.is_some())
    }

    /// The passes since the last call. Waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn take_times(&mut self) -> Result<Vec<PassTime>, BackendError> {
        self.timing.as_mut().map_or(Ok(Vec::new()), |timing| timing.take(&self.device))
    }

    /// A frame begins, which may be timed for whoever watches the device.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn begin_frame(&mut self) -> Result<(), BackendError> {
        self.sampling.begin(&self.device, &mut self.timing)
    }

    /// The frame is on the device.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn end_frame(&mut self) -> Result<(), BackendError> {
        self.sampling.end(&self.device, &mut self.timing)
    }

    /// Wait for everything that was submitted.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn finish(&self) -> Result<(), BackendError> {
        self.device.wait("finish", self.device.queue().submit([]))
    }
}
