//! [`GpuBackend`]: the trait on a device. It checks what callers send, as `CpuBackend` does and with the same code, keeps
//! what it was told on the host, and says so when the device is gone.

use crate::device::GpuDevice;
use crate::matrix::GpuMatrix;
use crate::news::News;
use crate::timing::PassTime;
use earthshine_radiosity::local_matrix::Arrival;
use earthshine_radiosity::slot_check::{self, Interest};
use earthshine_radiosity::update_check::UpdateCheck;
use earthshine_radiosity::{
    ApplyStats, Backend, BackendError, LocalMatrix, Repaired, Slot, StepStats, Update,
};
use earthshine_world::Rgb;
use earthshine_world::random::{Purpose, hash, unit_f32};
use std::collections::BTreeSet;

/// A local matrix on a device.
///
/// Updates and steps are handed to the device and not waited for. What of a step's light is news goes to the host at once,
/// with a bit for each slot whose patch the device has refused; [`Backend::take_news`] and [`Backend::take_refused`] take what
/// has arrived. [`Backend::read_irradiance`] and [`Backend::drift`] wait.
#[derive(Debug)]
pub struct GpuBackend {
    matrix: GpuMatrix,
    check: UpdateCheck,
    news: News,
    /// Sources, a channel after the other, rows of a vector each; changed since they were uploaded.
    own: Vec<f32>,
    outside: Vec<f32>,
    are_sources_new: bool,
    /// Light as it was read last, as `own`; and whether that is the light of the last step.
    irradiance: Vec<f32>,
    is_read: bool,
    interest: Interest,
    /// Slots whose patch was refused, to be told.
    refused: BTreeSet<Slot>,
    /// The newest step whose refusals were looked at.
    heard: u64,
    /// Whose light was sent for, and whether the step had evaluated their patches.
    polled: (Vec<Slot>, Vec<bool>),
    /// Slots that the last step evaluated.
    current: Vec<bool>,
    lit_columns: u32,
    changed: bool,
}

impl GpuBackend {
    /// An empty backend of `capacity` slots; see [`crate::memory::device_bytes`].
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`] for more than the device holds or a matrix may have, or for no slots;
    /// [`BackendError::DeviceLost`].
    pub fn new(device: &GpuDevice, capacity: u32) -> Result<Self, BackendError> {
        let bytes = crate::memory::device_bytes_within(capacity, device.part_bytes_max());
        let too_large = BackendError::OutOfMemory { slots: capacity, bytes };
        let most = crate::memory::slots_max(device.binding_bytes_max()).min(LocalMatrix::CAPACITY_MAX);
        if capacity == 0 || capacity > most {
            return Err(too_large);
        }
        let named = |error| match error {
            BackendError::OutOfMemory { .. } => too_large.clone(),
            other => other,
        };
        let matrix = GpuMatrix::new(device, capacity).map_err(named)?;
        let (slots, rows) = (capacity as usize, matrix.rows());
        Ok(Self {
            check: UpdateCheck::new(slots),
            news: News::new(device, slots, 4 * slots.div_ceil(32) as u64)?,
            own: vec![0.0; 3 * rows],
            outside: vec![0.0; 3 * rows],
            are_sources_new: false,
            irradiance: vec![0.0; 3 * rows],
            is_read: true,
            interest: Interest::default(),
            refused: BTreeSet::new(),
            heard: 0,
            polled: (Vec::new(), Vec::new()),
            current: vec![false; slots],
            lit_columns: 0,
            changed: true,
            matrix,
        })
    }

    /// Starts timing every pass; false where the device cannot.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub fn time_passes(&mut self) -> Result<bool, BackendError> {
        self.matrix.time_passes()
    }

    /// The passes since the last call, in order. Waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn take_times(&mut self) -> Result<Vec<PassTime>, BackendError> {
        self.matrix.take_times()
    }

    /// Waits until the device has done all it was told.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn finish(&self) -> Result<(), BackendError> {
        self.matrix.finish()
    }

    fn rgb(values: &[f32], slot: usize) -> Rgb {
        let rows = values.len() / 3;
        Rgb::new(values[slot], values[rows + slot], values[2 * rows + slot])
    }

    /// Sets three channels; returns whether they were different.
    fn put(values: &mut [f32], slot: usize, rgb: Rgb) -> bool {
        let rows = values.len() / 3;
        let before = Self::rgb(values, slot);
        (0..3).for_each(|channel| values[channel * rows + slot] = rgb[channel]);
        before != rgb
    }

    /// Applies updates of one kind, at most a block of them.
    fn apply_block(&mut self, updates: &[Update], stats: &mut ApplyStats) -> Result<(), BackendError> {
        let (mut arrivals, mut leaving) = (Vec::new(), Vec::new());
        for update in updates {
            match update {
                Update::Add { slot, reflectance, area, row, column: _ } => {
                    arrivals.push(Arrival { slot: *slot, reflectance: *reflectance, area: *area, row });
                }
                // Also one that the device has refused, and has not told.
                Update::Remove { slot } => leaving.push(*slot),
            }
        }
        self.matrix.add_block(&arrivals)?;
        // Who was refused in a slot is refused for the device until somebody comes there: that is not meant for who comes now.
        arrivals.iter().for_each(|arrival| self.news.forget(arrival.slot.0 as usize));
        self.matrix.remove_block(&leaving)?;
        for slot in &leaving {
            self.refused.remove(slot);
            self.forget(*slot);
        }
        stats.added += arrivals.len() as u32;
        stats.removed += leaving.len() as u32;
        self.changed |= !updates.is_empty();
        Ok(())
    }

    /// The patch in `slot` has left, or never came.
    fn forget(&mut self, slot: Slot) {
        let at = slot.0 as usize;
        Self::put(&mut self.own, at, Rgb::ZERO);
        Self::put(&mut self.outside, at, Rgb::ZERO);
        self.are_sources_new = true;
        self.current[at] = false;
        self.news.forget(at);
    }

    /// Notes whom the device has refused, as far as was told with the light that has arrived: none of theirs is told.
    fn note_refused(&mut self) {
        let Some((step, words)) = self.news.words().filter(|(step, _)| *step != self.heard) else { return };
        let is_set = |slot: &u32| words[*slot as usize / 32] >> (slot % 32) & 1 == 1;
        // Of another patch than the one that is there now, nothing is said.
        let is_meant =
            |slot: &u32| self.matrix.is_taken(Slot(*slot)) && self.news.is_of_patch_at(*slot as usize, step);
        let found: Vec<u32> = (0..self.capacity()).filter(is_set).filter(is_meant).collect();
        self.heard = step;
        for slot in found {
            self.news.forget(slot as usize);
            self.refused.insert(Slot(slot));
        }
    }

    /// Has the device probe the matrix with a random exitance.
    fn begin_probe(&mut self, seed: u64) -> Result<(), BackendError> {
        let rows = self.own.len() / 3;
        let mut x = vec![0.0f32; 3 * rows];
        for (at, x) in x.iter_mut().enumerate() {
            let (channel, slot) = (at / rows, at % rows);
            if self.matrix.is_taken(Slot(slot as u32)) {
                *x = unit_f32(hash(seed, Purpose::Simulation, slot as u64, channel as u64));
            }
        }
        self.are_sources_new = true;
        self.matrix.probe(&x)
    }

    /// Whether anything leaves a slot when its own light and what arrives from outside are all there is.
    fn is_lit(&self, slot: usize) -> bool {
        let reflected = self.matrix.reflectance(Slot(slot as u32)) * Self::rgb(&self.outside, slot);
        Self::rgb(&self.own, slot) + reflected != Rgb::ZERO
    }
}

impl Backend for GpuBackend {
    fn capacity(&self) -> u32 {
        self.matrix.capacity()
    }

    fn apply(&mut self, updates: &[Update]) -> Result<ApplyStats, BackendError> {
        self.matrix.device().check()?;
        let matrix = &self.matrix;
        self.check.check(updates, |slot| matrix.area(slot))?;
        let mut stats = ApplyStats::default();
        for block in slot_check::blocks_of(updates) {
            self.apply_block(block, &mut stats)?;
        }
        Ok(stats)
    }

    fn is_taken(&self, slot: Slot) -> bool {
        self.matrix.is_taken(slot)
    }

    fn take_refused(&mut self, refused: &mut Vec<Slot>) -> Result<(), BackendError> {
        // What arrives now makes room for the next step; who is refused by it is told with its light, when that is taken.
        self.news.collect(self.matrix.device())?;
        for slot in std::mem::take(&mut self.refused) {
            self.matrix.forget(slot);
            self.forget(slot);
            refused.push(slot);
        }
        Ok(())
    }

    fn is_behind(&self) -> bool {
        self.news.is_full()
    }

    fn clear(&mut self) -> Result<(), BackendError> {
        let taken: Vec<Slot> = (0..self.capacity()).map(Slot).filter(|&slot| self.is_taken(slot)).collect();
        self.matrix.clear()?;
        self.refused.clear();
        taken.into_iter().for_each(|slot| self.forget(slot));
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
        slot_check::all_taken(slots, self.capacity(), |slot| self.is_taken(slot))?;
        let mut differ = false;
        for ((slot, &direct), &outside) in slots.iter().zip(direct_exitance).zip(outside_irradiance) {
            let at = slot.0 as usize;
            differ |= Self::put(&mut self.own, at, direct);
            differ |= Self::put(&mut self.outside, at, outside);
        }
        self.are_sources_new |= differ;
        self.changed |= differ;
        Ok(())
    }

    fn set_interest(&mut self, slots: Option<&[Slot]>) -> Result<(), BackendError> {
        self.interest.set(slots, self.capacity())
    }

    fn is_current(&self, slot: Slot) -> bool {
        self.matrix.is_taken(slot) && self.current[slot.0 as usize]
    }

    /// Handed to the device and not waited for.
    fn step(&mut self) -> Result<StepStats, BackendError> {
        self.matrix.device().check()?;
        let slots = self.current.len();
        let is_wanted = |slot: usize| self.interest.is_wanted(slot);
        let is_missing =
            |slot: usize| is_wanted(slot) && !self.current[slot] && self.is_taken(Slot(slot as u32));
        let recomputed = self.changed || (0..slots).any(is_missing);
        if !recomputed {
            return Ok(StepStats { lit_columns: self.lit_columns, recomputed });
        }
        self.news.make_room(self.matrix.device())?;
        self.matrix.end_frame()?;
        self.matrix.begin_frame()?;
        let lit: Vec<bool> = (0..slots).map(|slot| self.is_lit(slot)).collect();
        let wanted: Vec<bool> = (0..slots).map(is_wanted).collect();
        let is = |marks: &[bool], slot: u32| marks.get(slot as usize).copied().unwrap_or(false);
        let selection = self
            .matrix
            .select(|slot| is(&lit, slot), |slot| is(&wanted, slot) && self.matrix.is_taken(Slot(slot)));
        if std::mem::take(&mut self.are_sources_new) {
            self.matrix.upload_sources(&self.own, &self.outside);
        }
        for slot in (0..slots).filter(|&slot| is(&wanted, slot as u32)) {
            let slot_of = Slot(slot as u32);
            if self.matrix.is_taken(slot_of) && !self.refused.contains(&slot_of) {
                self.news.know(slot);
            }
        }
        self.matrix.step(&selection, &mut self.news)?;
        self.is_read = false;
        self.current = wanted;
        self.changed = false;
        self.lit_columns = lit.iter().filter(|&&lit| lit).count() as u32;
        Ok(StepStats { lit_columns: self.lit_columns, recomputed })
    }

    fn read_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        slot_check::one_each(slots, out.len())?;
        slot_check::all_taken(slots, self.capacity(), |slot| self.is_taken(slot))?;
        self.matrix.device().check()?;
        if !self.is_read {
            self.irradiance = self.matrix.irradiance()?;
            self.is_read = true;
            self.news.wait(self.matrix.device())?;
            self.note_refused();
            self.matrix.end_frame()?;
        }
        for (slot, out) in slots.iter().zip(out) {
            let at = slot.0 as usize;
            *out = if self.news.is_known(at) { Self::rgb(&self.irradiance, at) } else { Rgb::ZERO };
        }
        Ok(())
    }

    fn reads_at_once(&self) -> bool {
        self.is_read
    }

    fn tell_afresh(&mut self) -> bool {
        self.news.tell_afresh();
        self.changed = true;
        true
    }

    fn poll_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<bool, BackendError> {
        slot_check::one_each(slots, out.len())?;
        // Light that somebody sent for and did not wait for is nobody else's.
        if !self.matrix.is_light_coming() || self.polled.0 != slots {
            slot_check::all_taken(slots, self.capacity(), |slot| self.is_taken(slot))?;
            let are_known = slots.iter().map(|slot| self.news.is_known(slot.0 as usize)).collect();
            self.polled = (slots.to_vec(), are_known);
            self.matrix.send_for_light()?;
        }
        let Some(light) = self.matrix.light()? else { return Ok(false) };
        for ((slot, out), &is_known) in slots.iter().zip(out).zip(&self.polled.1) {
            *out = if is_known { Self::rgb(&light, slot.0 as usize) } else { Rgb::ZERO };
        }
        Ok(true)
    }

    fn take_news(&mut self, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        self.news.collect(self.matrix.device())?;
        self.note_refused();
        self.news.take_arrived(news);
        Ok(())
    }

    fn is_settled(&self) -> bool {
        let is_heard = self.news.words().is_none_or(|(step, _)| step == self.heard);
        self.news.is_told() && is_heard && self.refused.is_empty()
    }

    /// Infinite if the device is lost.
    fn drift(&mut self, seed: u64) -> f32 {
        let probed = self.begin_probe(seed).and_then(|()| self.matrix.probed(true));
        probed.ok().flatten().map_or(f32::INFINITY, |probed| drift_of(&probed))
    }

    fn poll_drift(&mut self, seed: u64) -> Result<Option<f32>, BackendError> {
        if !self.matrix.is_probing() {
            self.begin_probe(seed)?;
        }
        Ok(self.matrix.probed(false)?.map(|probed| drift_of(&probed)))
    }

    fn repair(&mut self, columns_max: u32) -> Result<Repaired, BackendError> {
        self.matrix.device().check()?;
        let repaired = self.matrix.repair(columns_max)?;
        self.changed |= repaired.columns > 0;
        Ok(repaired)
    }

    fn resolve(&mut self) -> Result<(), BackendError> {
        self.matrix.device().check()?;
        self.matrix.resolve()?;
        self.changed = true;
        Ok(())
    }
}

/// Of what arrives by `H` of a probe, and by `F` of what that makes leave.
fn drift_of([arriving, gathered]: &[Vec<f32>; 2]) -> f32 {
    let square = |value: f64| value * value;
    let pairs = || gathered.iter().zip(arriving).map(|(&by_f, &by_h)| (f64::from(by_f), f64::from(by_h)));
    let gap: f64 = pairs().map(|(by_f, by_h)| square(by_f - by_h)).sum();
    let norm: f64 = pairs().map(|(_, by_h)| square(by_h)).sum();
    match (gap / norm).sqrt() {
        _ if gap == 0.0 => 0.0,
        drift if drift.is_finite() => drift as f32,
        _ => f32::INFINITY,
    }
}
