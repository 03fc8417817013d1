//! A backend that keeps the sparse rows it was told and iterates the balance in f64: slow, and plainly right.

use earthshine_radiosity::{ApplyStats, Backend, BackendError, Slot, StepStats, Update};
use earthshine_world::Rgb;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Faults to play.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Faults {
    /// Refuses about one patch in so many for a weak pivot, by its reflectance; 0 for none.
    pub(crate) weak_one_in: u64,
    /// Whether a row that names a refused patch's slot is an error, instead of being left out.
    pub(crate) is_strict: bool,
    /// Every so many steps one fails; 0 for none.
    pub(crate) fail_step_every: u64,
    /// What every probe says.
    pub(crate) drift: f32,
    /// Fewer slots than asked for.
    pub(crate) capacity_max: Option<u32>,
    /// How many ticks later than its step light is told.
    pub(crate) late_ticks: u64,
    /// Whether weak pivots are found out by the step, and told with its light; drift is told so late, too.
    pub(crate) decides_late: bool,
}

#[derive(Debug, Clone)]
struct Row {
    /// Of the patch: no two are alike.
    number: u64,
    reflectance: Rgb,
    shares: BTreeMap<u32, f32>,
    exitance: Rgb,
    outside: Rgb,
    light: Rgb,
    /// For a weak pivot: nobody has been told yet.
    is_refused: bool,
}

/// A slot, the number of the patch in it, its light.
type PatchLight = (Slot, u64, Rgb);

#[derive(Debug)]
pub(crate) struct GatherBackend {
    slots: Vec<Option<Row>>,
    faults: Faults,
    /// Steps of all backends of one factory.
    steps: Arc<AtomicU64>,
    changed: bool,
    /// Patches so far, and how often news was asked for.
    patches: u64,
    asked: u64,
    /// When it arrives, and what: light, and who is refused.
    on_its_way: VecDeque<(u64, Vec<PatchLight>)>,
    refusals: VecDeque<(u64, Vec<(Slot, u64)>)>,
    /// How often somebody has looked for a probe that is not told yet.
    looks: u64,
}

impl GatherBackend {
    pub(crate) fn new(capacity: u32, faults: Faults, steps: Arc<AtomicU64>) -> Self {
        let capacity = capacity.min(faults.capacity_max.unwrap_or(u32::MAX));
        Self {
            slots: vec![None; capacity as usize],
            faults,
            steps,
            changed: false,
            patches: 0,
            asked: 0,
            on_its_way: VecDeque::new(),
            refusals: VecDeque::new(),
            looks: 0,
        }
    }

    fn check(&self, slot: Slot, should_be_taken: bool) -> Result<(), BackendError> {
        match self.slots.get(slot.0 as usize) {
            None => Err(BackendError::SlotOutside(slot, self.slots.len() as u32)),
            Some(None) if should_be_taken => Err(BackendError::SlotFree(slot)),
            Some(Some(_)) if !should_be_taken => Err(BackendError::SlotTaken(slot)),
            Some(_) => Ok(()),
        }
    }

    fn is_weak(&self, reflectance: Rgb) -> bool {
        let one_in = self.faults.weak_one_in;
        one_in > 0 && u64::from(reflectance.x.to_bits() >> 3).is_multiple_of(one_in)
    }

    fn apply_one(&mut self, update: &Update, stats: &mut ApplyStats) -> Result<(), BackendError> {
        match update {
            Update::Remove { slot } => {
                self.check(*slot, true)?;
                self.slots[slot.0 as usize] = None;
                for row in self.slots.iter_mut().flatten() {
                    row.shares.remove(&slot.0);
                }
                stats.removed += 1;
            }
            Update::Add { slot, reflectance, area: _, row, column } => {
                self.check(*slot, false)?;
                for &(other, share) in row.iter().chain(column) {
                    if other != *slot && self.faults.is_strict {
                        self.check(other, true)?;
                    }
                    if !(0.0..=1.0).contains(&share) {
                        return Err(BackendError::Share(other, share));
                    }
                }
                let is_refused = self.is_weak(*reflectance);
                if is_refused && !self.faults.decides_late {
                    stats.weak_pivots += 1;
                    return Ok(());
                }
                let known = |other: &Slot| {
                    let other_row = &self.slots[other.0 as usize];
                    !is_refused && (other == slot || other_row.as_ref().is_some_and(|row| !row.is_refused))
                };
                let shares =
                    row.iter().filter(|(other, _)| known(other)).map(|&(other, share)| (other.0, share));
                let shares = shares.collect();
                for &(other, share) in column {
                    if let Some(other) = self.slots[other.0 as usize].as_mut().filter(|_| !is_refused) {
                        assert!(other.shares.insert(slot.0, share).is_none(), "a column entry is told once");
                    }
                }
                let (exitance, outside, light) = (Rgb::ZERO, Rgb::ZERO, Rgb::ZERO);
                self.patches += 1;
                let number = self.patches;
                self.slots[slot.0 as usize] = Some(Row {
                    number,
                    reflectance: *reflectance,
                    shares,
                    exitance,
                    outside,
                    light,
                    is_refused,
                });
                stats.added += 1;
            }
        }
        Ok(())
    }

    /// `B = E + rho I`, `I = F B + outside`, until nothing moves.
    fn solve(&mut self) {
        let mut light: Vec<[f64; 3]> = vec![[0.0; 3]; self.slots.len()];
        for _ in 0..400 {
            let mut most = 0.0f64;
            for slot in 0..self.slots.len() {
                let Some(row) = &self.slots[slot] else { continue };
                let mut sum = row.outside.to_array().map(f64::from);
                for (&other, &share) in &row.shares {
                    let sender = self.slots[other as usize].as_ref().expect("rows name taken slots");
                    for channel in 0..3 {
                        let reflected =
                            f64::from(sender.reflectance[channel]) * light[other as usize][channel];
                        sum[channel] += f64::from(share) * (f64::from(sender.exitance[channel]) + reflected);
                    }
                }
                for channel in 0..3 {
                    let change = (sum[channel] - light[slot][channel]).abs();
                    most = most.max(change / sum[channel].abs().max(1e-30));
                }
                light[slot] = sum;
            }
            if most < 1e-9 {
                break;
            }
        }
        for (row, light) in self.slots.iter_mut().zip(light) {
            if let Some(row) = row {
                row.light = Rgb::from_array(light.map(|x| x as f32));
            }
        }
    }
}

impl Backend for GatherBackend {
    fn capacity(&self) -> u32 {
        self.slots.len() as u32
    }

    fn apply(&mut self, updates: &[Update]) -> Result<ApplyStats, BackendError> {
        let before = self.slots.clone();
        let mut stats = ApplyStats::default();
        for update in updates {
            if let Err(error) = self.apply_one(update, &mut stats) {
                self.slots = before;
                return Err(error);
            }
        }
        self.changed = true;
        Ok(stats)
    }

    fn is_taken(&self, slot: Slot) -> bool {
        self.slots.get(slot.0 as usize).is_some_and(Option::is_some)
    }

    fn set_sources(&mut self, slots: &[Slot], exitance: &[Rgb], outside: &[Rgb]) -> Result<(), BackendError> {
        for (index, &slot) in slots.iter().enumerate() {
            self.check(slot, true)?;
            let (exitance, outside) = (exitance[index], outside[index]);
            if !(exitance.is_finite() && outside.is_finite()) {
                return Err(BackendError::NotFinite(slot));
            }
            let row = self.slots[slot.0 as usize].as_mut().unwrap();
            (row.exitance, row.outside) = (exitance, outside);
        }
        self.changed = true;
        Ok(())
    }

    fn step(&mut self) -> Result<StepStats, BackendError> {
        let steps = self.steps.fetch_add(1, Ordering::Relaxed) + 1;
        if self.faults.fail_step_every > 0 && steps.is_multiple_of(self.faults.fail_step_every) {
            return Err(BackendError::SlotFree(Slot(0)));
        }
        let recomputed = std::mem::take(&mut self.changed);
        if recomputed {
            self.solve();
            let lit = |(slot, row): (u32, &Option<Row>)| {
                let row = row.as_ref().filter(|row| !row.is_refused)?;
                Some((Slot(slot), row.number, row.light))
            };
            let refused = |(slot, row): (u32, &Option<Row>)| {
                Some((Slot(slot), row.as_ref().filter(|row| row.is_refused)?.number))
            };
            let refused: Vec<_> = (0..).zip(&self.slots).filter_map(refused).collect();
            if !refused.is_empty() {
                self.refusals.push_back((self.asked + self.faults.late_ticks, refused));
            }
            let light = (0..).zip(&self.slots).filter_map(lit).collect();
            self.on_its_way.push_back((self.asked + self.faults.late_ticks, light));
        }
        Ok(StepStats { lit_columns: 0, recomputed })
    }

    fn read_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        for (&slot, out) in slots.iter().zip(out) {
            self.check(slot, true)?;
            *out = self.slots[slot.0 as usize].as_ref().unwrap().light;
        }
        Ok(())
    }

    fn take_news(&mut self, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        while self.on_its_way.front().is_some_and(|&(due, _)| due <= self.asked) {
            let (_, light) = self.on_its_way.pop_front().unwrap();
            let is_there = |slot: Slot, number: u64| {
                self.slots[slot.0 as usize].as_ref().is_some_and(|row| row.number == number)
            };
            let still = light.into_iter().filter(|&(slot, number, _)| is_there(slot, number));
            news.extend(still.map(|(slot, _, light)| (slot, light)));
        }
        self.asked += 1;
        Ok(())
    }

    fn take_refused(&mut self, refused: &mut Vec<Slot>) -> Result<(), BackendError> {
        while self.refusals.front().is_some_and(|&(due, _)| due <= self.asked) {
            for (slot, number) in self.refusals.pop_front().unwrap().1 {
                if self.slots[slot.0 as usize].take_if(|row| row.number == number).is_some() {
                    refused.push(slot);
                }
            }
        }
        Ok(())
    }

    fn poll_drift(&mut self, seed: u64) -> Result<Option<f32>, BackendError> {
        if self.faults.decides_late && self.looks <= self.faults.late_ticks {
            self.looks += 1;
            return Ok(None);
        }
        self.looks = 0;
        Ok(Some(self.drift(seed)))
    }

    fn is_settled(&self) -> bool {
        self.on_its_way.is_empty() && self.refusals.is_empty()
    }

    fn drift(&mut self, _seed: u64) -> f32 {
        self.faults.drift
    }

    fn resolve(&mut self) -> Result<(), BackendError> {
        Ok(())
    }
}
