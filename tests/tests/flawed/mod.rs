//! The CPU backend with one flaw at a time: what the conformance suite must notice.

use earthshine_radiosity::{ApplyStats, Backend, BackendError, CpuBackend, Slot, StepStats, Update};
use earthshine_world::Rgb;

/// What is wrong with a backend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Flaw {
    /// A ten-thousandth of all light is lost.
    LosesLight,
    /// What comes from outside lights a patch and does not bounce on.
    OutsideDoesNotBounce,
    /// A batch is applied up to its first fault.
    AppliesHalfABatch,
    /// Every step says that it has computed.
    AlwaysRecomputes,
    /// Light is read in the order of slots, not in the order asked.
    SortsWhatIsRead,
    /// A patch that leaves stays in the matrix of the others.
    ForgetsRemovals,
    /// A patch is added without what the others see of it.
    DropsColumns,
    /// A refused patch counts as added.
    HidesWeakPivots,
    /// What is told of the last slot does not arrive.
    LosesNews,
}

impl Flaw {
    pub(crate) const ALL: [Self; 9] = [
        Self::LosesLight,
        Self::OutsideDoesNotBounce,
        Self::AppliesHalfABatch,
        Self::AlwaysRecomputes,
        Self::SortsWhatIsRead,
        Self::ForgetsRemovals,
        Self::DropsColumns,
        Self::HidesWeakPivots,
        Self::LosesNews,
    ];
}

/// A sound backend behind a flaw.
pub(crate) struct FlawedBackend {
    sound: CpuBackend,
    flaw: Flaw,
    /// Of each slot, for light that is added behind the matrix's back.
    outside: Vec<Rgb>,
}

impl FlawedBackend {
    pub(crate) fn new(sound: CpuBackend, flaw: Flaw) -> Self {
        let outside = vec![Rgb::ZERO; sound.capacity() as usize];
        Self { sound, flaw, outside }
    }

    fn spoilt(&self, update: &Update) -> Option<Update> {
        match (self.flaw, update) {
            (Flaw::ForgetsRemovals, Update::Remove { .. }) => None,
            (Flaw::DropsColumns, Update::Add { slot, reflectance, area, row, .. }) => {
                let (slot, reflectance, area, row) = (*slot, *reflectance, *area, row.clone());
                Some(Update::Add { slot, reflectance, area, row, column: Vec::new() })
            }
            _ => Some(update.clone()),
        }
    }
}

impl Backend for FlawedBackend {
    fn capacity(&self) -> u32 {
        self.sound.capacity()
    }

    fn apply(&mut self, updates: &[Update]) -> Result<ApplyStats, BackendError> {
        if self.flaw == Flaw::AppliesHalfABatch {
            let mut all = ApplyStats::default();
            for update in updates {
                let stats = self.sound.apply(std::slice::from_ref(update))?;
                all.added += stats.added;
                all.removed += stats.removed;
                all.weak_pivots += stats.weak_pivots;
            }
            return Ok(all);
        }
        let spoilt: Vec<Update> = updates.iter().filter_map(|update| self.spoilt(update)).collect();
        let mut stats = self.sound.apply(&spoilt)?;
        if self.flaw == Flaw::HidesWeakPivots {
            stats.added += std::mem::take(&mut stats.weak_pivots);
        }
        Ok(stats)
    }

    fn is_taken(&self, slot: Slot) -> bool {
        self.sound.is_taken(slot)
    }

    fn set_sources(
        &mut self,
        slots: &[Slot],
        direct_exitance: &[Rgb],
        outside_irradiance: &[Rgb],
    ) -> Result<(), BackendError> {
        if self.flaw != Flaw::OutsideDoesNotBounce {
            return self.sound.set_sources(slots, direct_exitance, outside_irradiance);
        }
        self.sound.set_sources(slots, direct_exitance, outside_irradiance)?;
        for (slot, &outside) in slots.iter().zip(outside_irradiance) {
            self.outside[slot.0 as usize] = outside;
        }
        self.sound.set_sources(slots, direct_exitance, &vec![Rgb::ZERO; slots.len()])
    }

    fn step(&mut self) -> Result<StepStats, BackendError> {
        let stats = self.sound.step()?;
        Ok(StepStats { recomputed: stats.recomputed || self.flaw == Flaw::AlwaysRecomputes, ..stats })
    }

    fn read_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        let mut order = slots.to_vec();
        if self.flaw == Flaw::SortsWhatIsRead {
            order.sort();
        }
        self.sound.read_irradiance(&order, out)?;
        for (slot, light) in slots.iter().zip(out) {
            *light += self.outside[slot.0 as usize];
            *light *= if self.flaw == Flaw::LosesLight { 0.9999 } else { 1.0 };
        }
        Ok(())
    }

    fn take_news(&mut self, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        self.sound.take_news(news)?;
        let last = Slot(self.capacity() - 1);
        news.retain(|(slot, _)| self.flaw != Flaw::LosesNews || *slot != last);
        news.iter_mut().for_each(|(slot, light)| *light += self.outside[slot.0 as usize]);
        Ok(())
    }

    fn drift(&mut self, seed: u64) -> f32 {
        self.sound.drift(seed)
    }

    fn resolve(&mut self) -> Result<(), BackendError> {
        self.sound.resolve()
    }
}
