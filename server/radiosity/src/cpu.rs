//! [`CpuBackend`]: the backend that runs anywhere, and the oracle for the others.
//!
//! It checks what callers send, cuts updates into blocks for [`LocalMatrix`], and keeps the light. All
//! arithmetic on `H` is there, not here.

use crate::backend::{ApplyStats, Backend, BackendError, Slot, StepStats, Update};
use crate::local_matrix::{Arrival, CapacityError, LocalMatrix};
use earthshine_world::Rgb;

/// A local matrix in main memory, advanced by rayon's threads. Bit-identical at any number of them.
#[derive(Debug)]
pub struct CpuBackend {
    matrix: LocalMatrix,
    direct_exitance: Vec<Rgb>,
    outside_irradiance: Vec<Rgb>,
    irradiance: Vec<Rgb>,
    /// `E + rho g` of one channel.
    sent: Vec<f32>,
    /// `H` times that.
    received: Vec<f32>,
    /// Slots as a batch will leave them, while it is checked.
    planned: Vec<bool>,
    lit_columns: u32,
    changed: bool,
}

impl CpuBackend {
    /// An empty backend of `capacity` slots: `12 capacity^2` bytes, zeroed here.
    ///
    /// # Errors
    /// [`CapacityError`] for no slots, more than [`LocalMatrix::CAPACITY_MAX`], or more than memory holds.
    pub fn new(capacity: u32) -> Result<Self, CapacityError> {
        let matrix = LocalMatrix::new(capacity)?;
        let slots = matrix.capacity();
        Ok(Self {
            direct_exitance: vec![Rgb::ZERO; slots],
            outside_irradiance: vec![Rgb::ZERO; slots],
            irradiance: vec![Rgb::ZERO; slots],
            sent: vec![0.0; matrix.vector_len()],
            received: vec![0.0; slots],
            planned: vec![false; slots],
            lit_columns: 0,
            changed: true,
            matrix,
        })
    }

    /// The matrix, to look at.
    #[must_use]
    pub fn matrix(&self) -> &LocalMatrix {
        &self.matrix
    }

    /// The matrix, to multiply with: for benches.
    pub(crate) fn matrix_mut(&mut self) -> &mut LocalMatrix {
        &mut self.matrix
    }

    fn within(&self, slot: Slot) -> Result<usize, BackendError> {
        let at = slot.0 as usize;
        if at < self.planned.len() { Ok(at) } else { Err(BackendError::SlotOutside(slot, self.capacity())) }
    }

    fn taken(&self, slot: Slot) -> Result<usize, BackendError> {
        let at = self.within(slot)?;
        if self.matrix.is_taken(slot) { Ok(at) } else { Err(BackendError::SlotFree(slot)) }
    }

    /// Whether a batch can be applied, refusals aside: nothing is changed unless all of it can.
    fn check(&mut self, updates: &[Update]) -> Result<(), BackendError> {
        for (slot, planned) in self.planned.iter_mut().enumerate() {
            *planned = self.matrix.is_taken(Slot(slot as u32));
        }
        for update in updates {
            match update {
                Update::Add { slot, reflectance, row, column } => {
                    let at = self.within(*slot)?;
                    if self.planned[at] {
                        return Err(BackendError::SlotTaken(*slot));
                    }
                    if !(reflectance.is_finite()
                        && reflectance.min_element() >= 0.0
                        && reflectance.max_element() <= 1.0)
                    {
                        return Err(BackendError::NotFinite(*slot));
                    }
                    self.check_shares(column)?;
                    self.planned[at] = true;
                    self.check_shares(row)?;
                }
                Update::Remove { slot } => {
                    let at = self.within(*slot)?;
                    if !std::mem::take(&mut self.planned[at]) {
                        return Err(BackendError::SlotFree(*slot));
                    }
                }
            }
        }
        Ok(())
    }

    fn check_shares(&self, entries: &[(Slot, f32)]) -> Result<(), BackendError> {
        for &(slot, share) in entries {
            if !self.planned[self.within(slot)?] {
                return Err(BackendError::SlotFree(slot));
            }
            if !(0.0..=1.0).contains(&share) {
                return Err(BackendError::Share(slot, share));
            }
        }
        Ok(())
    }

    /// Applies updates of one kind, at most a block of them.
    fn apply_block(&mut self, updates: &[Update], stats: &mut ApplyStats) {
        let mut arrivals = [const { Arrival::NOBODY }; LocalMatrix::BLOCK_MAX];
        let mut leaving = [Slot(0); LocalMatrix::BLOCK_MAX];
        let (mut arrival_count, mut leaving_count) = (0, 0);
        for update in updates {
            match update {
                Update::Add { slot, reflectance, row, column } => {
                    arrivals[arrival_count] = Arrival { slot: *slot, reflectance: *reflectance, row, column };
                    arrival_count += 1;
                }
                // A patch that was refused earlier in the batch has left already.
                Update::Remove { slot } if self.matrix.is_taken(*slot) => {
                    leaving[leaving_count] = *slot;
                    leaving_count += 1;
                }
                Update::Remove { .. } => {}
            }
        }
        let kept = self.matrix.add_block(&arrivals[..arrival_count]);
        self.matrix.remove_block(&leaving[..leaving_count]);
        for slot in &leaving[..leaving_count] {
            let at = slot.0 as usize;
            self.direct_exitance[at] = Rgb::ZERO;
            self.outside_irradiance[at] = Rgb::ZERO;
            self.irradiance[at] = Rgb::ZERO;
        }
        stats.added += kept.count_ones();
        stats.weak_pivots += arrival_count as u32 - kept.count_ones();
        stats.removed += leaving_count as u32;
        self.changed |= kept != 0 || leaving_count > 0;
    }
}

impl Backend for CpuBackend {
    fn capacity(&self) -> u32 {
        self.planned.len() as u32
    }

    fn apply(&mut self, updates: &[Update]) -> Result<ApplyStats, BackendError> {
        self.check(updates)?;
        let mut stats = ApplyStats::default();
        let same_kind = |a: &Update, b: &Update| std::mem::discriminant(a) == std::mem::discriminant(b);
        for run in updates.chunk_by(same_kind) {
            for block in run.chunks(LocalMatrix::BLOCK_MAX) {
                self.apply_block(block, &mut stats);
            }
        }
        Ok(stats)
    }

    fn is_taken(&self, slot: Slot) -> bool {
        self.matrix.is_taken(slot)
    }

    fn set_sources(
        &mut self,
        slots: &[Slot],
        direct_exitance: &[Rgb],
        outside_irradiance: &[Rgb],
    ) -> Result<(), BackendError> {
        for values in [direct_exitance, outside_irradiance] {
            if values.len() != slots.len() {
                return Err(BackendError::Length { expected: slots.len(), actual: values.len() });
            }
        }
        for values in [direct_exitance, outside_irradiance] {
            for (&slot, value) in slots.iter().zip(values) {
                self.taken(slot)?;
                if !(value.is_finite() && value.min_element() >= 0.0) {
                    return Err(BackendError::NotFinite(slot));
                }
            }
        }
        for ((slot, &direct), &outside) in slots.iter().zip(direct_exitance).zip(outside_irradiance) {
            let at = slot.0 as usize;
            self.changed |= self.direct_exitance[at] != direct || self.outside_irradiance[at] != outside;
            self.direct_exitance[at] = direct;
            self.outside_irradiance[at] = outside;
        }
        Ok(())
    }

    fn step(&mut self) -> Result<StepStats, BackendError> {
        let recomputed = std::mem::take(&mut self.changed);
        if recomputed {
            let mut lit = std::mem::take(&mut self.planned);
            lit.fill(false);
            for channel in 0..3 {
                for (slot, lit) in lit.iter_mut().enumerate() {
                    let reflectance = self.matrix.reflectance(Slot(slot as u32))[channel];
                    let outside = self.outside_irradiance[slot][channel];
                    let sent = self.direct_exitance[slot][channel] + reflectance * outside;
                    self.sent[slot] = sent;
                    *lit |= sent != 0.0;
                }
                self.matrix.multiply(channel, &self.sent, &mut self.received);
                for (slot, irradiance) in self.irradiance.iter_mut().enumerate() {
                    irradiance[channel] = self.received[slot] + self.outside_irradiance[slot][channel];
                }
            }
            self.lit_columns = lit.iter().filter(|&&lit| lit).count() as u32;
            self.planned = lit;
        }
        Ok(StepStats { lit_columns: self.lit_columns, recomputed })
    }

    fn read_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        if out.len() != slots.len() {
            return Err(BackendError::Length { expected: slots.len(), actual: out.len() });
        }
        for &slot in slots {
            self.taken(slot)?;
        }
        for (slot, out) in slots.iter().zip(out) {
            *out = self.irradiance[slot.0 as usize];
        }
        Ok(())
    }

    fn drift(&mut self, seed: u64) -> f32 {
        self.matrix.drift(seed)
    }

    /// A system too large for memory or made singular by rounding leaves `H` as it was; [`Backend::drift`] tells.
    fn resolve(&mut self) -> Result<(), BackendError> {
        if self.matrix.resolve().is_ok() {
            self.changed = true;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
