//! [`CpuBackend`]: the backend that runs anywhere, and the oracle for the others.
//!
//! It checks what callers send, cuts updates into blocks for [`LocalMatrix`], and keeps the light. All
//! arithmetic on `H` is there, not here.

use crate::backend::{ApplyStats, Backend, BackendError, HeldBytes, Repaired, Slot, StepStats, Update};
use crate::dense::DenseError;
use crate::local_matrix::{Arrival, CapacityError, LocalMatrix};
use crate::slot_check::{self, Interest};
use crate::told::Told;
use crate::update_check::UpdateCheck;
use earthshine_world::Rgb;

/// A local matrix in main memory, advanced by rayon's threads. Bit-identical at any number of them.
#[derive(Debug)]
pub struct CpuBackend {
    matrix: LocalMatrix,
    direct_exitance: Vec<Rgb>,
    outside_irradiance: Vec<Rgb>,
    irradiance: Vec<Rgb>,
    told: Told,
    /// `E + rho g` of one channel.
    sent: Vec<f32>,
    /// `H` times that.
    received: Vec<f32>,
    check: UpdateCheck,
    interest: Interest,
    /// Slots that the last step evaluated.
    current: Vec<bool>,
    lit: Vec<bool>,
    lit_columns: u32,
    changed: bool,
}

impl CpuBackend {
    /// An empty backend of `capacity` slots: `6 capacity^2` bytes and a little, zeroed here.
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
            told: Told::new(slots),
            sent: vec![0.0; slots],
            received: vec![0.0; slots],
            check: UpdateCheck::new(slots),
            interest: Interest::default(),
            current: vec![false; slots],
            lit: vec![false; slots],
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

    /// The matrix, to spoil: for tests.
    #[cfg(test)]
    pub(crate) fn matrix_mut(&mut self) -> &mut LocalMatrix {
        &mut self.matrix
    }

    /// Applies updates of one kind, at most a block of them.
    fn apply_block(&mut self, updates: &[Update], stats: &mut ApplyStats) {
        let mut arrivals = [const { Arrival::NOBODY }; LocalMatrix::BLOCK_MAX];
        let mut leaving = [Slot(0); LocalMatrix::BLOCK_MAX];
        let (mut arrival_count, mut leaving_count) = (0, 0);
        for update in updates {
            match update {
                Update::Add { slot, reflectance, area, row, column: _ } => {
                    let (slot, reflectance, area) = (*slot, *reflectance, *area);
                    arrivals[arrival_count] = Arrival { slot, reflectance, area, row };
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
            self.told.forget(at);
            self.current[at] = false;
        }
        stats.added += kept.count_ones();
        stats.weak_pivots += arrival_count as u32 - kept.count_ones();
        stats.removed += leaving_count as u32;
        self.changed |= kept != 0 || leaving_count > 0;
    }
}

impl Backend for CpuBackend {
    fn capacity(&self) -> u32 {
        self.matrix.capacity() as u32
    }

    fn apply(&mut self, updates: &[Update]) -> Result<ApplyStats, BackendError> {
        let matrix = &self.matrix;
        self.check.check(updates, |slot| matrix.area(slot))?;
        let mut stats = ApplyStats::default();
        for block in slot_check::blocks_of(updates) {
            self.apply_block(block, &mut stats);
        }
        Ok(stats)
    }

    fn is_taken(&self, slot: Slot) -> bool {
        self.matrix.is_taken(slot)
    }

    fn held_bytes(&self) -> HeldBytes {
        self.matrix.held_bytes()
    }

    fn clear(&mut self) -> Result<(), BackendError> {
        self.matrix.clear();
        for light in [&mut self.direct_exitance, &mut self.outside_irradiance, &mut self.irradiance] {
            light.fill(Rgb::ZERO);
        }
        self.told.forget_all();
        self.current.fill(false);
        self.changed = true;
        Ok(())
    }

    fn set_sources(
        &mut self,
        slots: &[Slot],
        direct_exitance: &[Rgb],
        outside_irradiance: &[Rgb],
    ) -> Result<(), BackendError> {
        slot_check::are_sources(slots, direct_exitance, outside_irradiance)?;
        slot_check::all_taken(slots, self.capacity(), |slot| self.matrix.is_taken(slot))?;
        for ((slot, &direct), &outside) in slots.iter().zip(direct_exitance).zip(outside_irradiance) {
            let at = slot.0 as usize;
            self.changed |= self.direct_exitance[at] != direct || self.outside_irradiance[at] != outside;
            self.direct_exitance[at] = direct;
            self.outside_irradiance[at] = outside;
        }
        Ok(())
    }

    fn set_interest(&mut self, slots: Option<&[Slot]>) -> Result<(), BackendError> {
        self.interest.set(slots, self.capacity())
    }

    fn is_current(&self, slot: Slot) -> bool {
        self.matrix.is_taken(slot) && self.current[slot.0 as usize]
    }

    fn step(&mut self) -> Result<StepStats, BackendError> {
        let is_wanted = |slot: usize| self.interest.is_wanted(slot);
        let is_missing = |slot: Slot| is_wanted(slot.0 as usize) && !self.current[slot.0 as usize];
        let recomputed = self.changed || self.matrix.taken_slots().any(is_missing);
        if recomputed {
            self.changed = false;
            self.lit.fill(false);
            for channel in 0..3 {
                for (slot, lit) in self.lit.iter_mut().enumerate() {
                    let reflectance = self.matrix.reflectance(Slot(slot as u32))[channel];
                    let outside = self.outside_irradiance[slot][channel];
                    let sent = self.direct_exitance[slot][channel] + reflectance * outside;
                    self.sent[slot] = sent;
                    *lit |= sent != 0.0;
                }
                self.matrix.multiply_rows(channel, &self.sent, self.interest.marks(), &mut self.received);
                for (slot, irradiance) in self.irradiance.iter_mut().enumerate() {
                    if is_wanted(slot) {
                        irradiance[channel] = self.received[slot] + self.outside_irradiance[slot][channel];
                    }
                }
            }
            self.current.iter_mut().enumerate().for_each(|(slot, current)| *current = is_wanted(slot));
            self.lit_columns = self.lit.iter().filter(|&&lit| lit).count() as u32;
        }
        Ok(StepStats { lit_columns: self.lit_columns, recomputed })
    }

    fn read_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        slot_check::one_each(slots, out.len())?;
        slot_check::all_taken(slots, self.capacity(), |slot| self.matrix.is_taken(slot))?;
        for (slot, out) in slots.iter().zip(out) {
            *out = self.irradiance[slot.0 as usize];
        }
        Ok(())
    }

    fn take_news(&mut self, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        let Self { matrix, irradiance, current, told, .. } = self;
        // What the last step left out is as it was.
        let evaluated = matrix.taken_slots().filter(|slot| current[slot.0 as usize]);
        told.tell(evaluated.map(|slot| (slot, irradiance[slot.0 as usize])), news);
        Ok(())
    }

    fn read_row(&mut self, slot: Slot, row: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        slot_check::all_taken(&[slot], self.capacity(), |slot| self.matrix.is_taken(slot))?;
        let matrix = &self.matrix;
        let entry = |other| Rgb::from_array([0, 1, 2].map(|channel| matrix.entry(channel, slot, other)));
        row.clear();
        row.extend(matrix.taken_slots().map(|other| (other, entry(other))));
        Ok(())
    }

    fn drift(&mut self, seed: u64) -> f32 {
        self.matrix.drift(seed)
    }

    fn repair(&mut self, columns_max: u32) -> Result<Repaired, BackendError> {
        let repaired = self.matrix.repair(columns_max);
        self.changed |= repaired.columns > 0;
        Ok(repaired)
    }

    /// A system made singular by rounding leaves `H` as it was; [`Backend::drift`] tells.
    fn resolve(&mut self) -> Result<(), BackendError> {
        match self.matrix.resolve() {
            Ok(()) => self.changed = true,
            Err(DenseError::Singular(_)) => {}
            Err(DenseError::Memory { rows, columns }) => {
                let bytes = 8 * rows as u64 * columns as u64;
                return Err(BackendError::OutOfMemory { slots: self.capacity(), bytes });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
