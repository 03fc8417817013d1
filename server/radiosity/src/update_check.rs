//! What every backend checks before it applies a batch of updates: slots, shares, sums of rows, areas, reciprocity.

use crate::backend::{BackendError, RECIPROCITY_TOLERANCE, Slot, Update};
use crate::invariant::ROW_SUM_TOLERANCE;
use crate::slot_check::within;

/// Room to check batches for a number of slots; allocated once.
#[derive(Debug)]
pub struct UpdateCheck {
    /// Areas as a batch will leave them, 0 for free slots, while it is checked.
    planned: Vec<f32>,
    /// What a patch that is checked exchanges with each slot, m2: there, and back. Zero between checks.
    exchange: Vec<[f64; 2]>,
}

impl UpdateCheck {
    /// For `slots` slots.
    #[must_use]
    pub fn new(slots: usize) -> Self {
        Self { planned: vec![0.0; slots], exchange: vec![[0.0; 2]; slots] }
    }

    /// Whether a batch can be applied, refusals for weak pivots aside. `area` is that of who holds a slot now, m2; 0 for
    /// free slots.
    ///
    /// # Errors
    /// As [`Backend::apply`](crate::Backend::apply), the first.
    pub fn check(&mut self, updates: &[Update], area: impl Fn(Slot) -> f32) -> Result<(), BackendError> {
        for (slot, planned) in self.planned.iter_mut().enumerate() {
            *planned = area(Slot(slot as u32));
        }
        let slots = self.planned.len() as u32;
        for update in updates {
            match update {
                Update::Add { slot, reflectance, area, row, column } => {
                    let at = within(*slot, slots)?;
                    if self.planned[at] != 0.0 {
                        return Err(BackendError::SlotTaken(*slot));
                    }
                    if !(reflectance.is_finite()
                        && reflectance.min_element() >= 0.0
                        && reflectance.max_element() <= 1.0)
                    {
                        return Err(BackendError::NotFinite(*slot));
                    }
                    if !(area.is_finite() && *area > 0.0) {
                        return Err(BackendError::Area(*slot, *area));
                    }
                    self.check_shares(column)?;
                    self.planned[at] = *area;
                    self.check_shares(row)?;
                    let sum: f64 = row.iter().map(|&(_, share)| f64::from(share)).sum();
                    if sum > 1.0 + ROW_SUM_TOLERANCE {
                        return Err(BackendError::RowSum { slot: *slot, sum });
                    }
                    self.check_exchange(*slot, row, column)?;
                }
                Update::Remove { slot } => {
                    let at = within(*slot, slots)?;
                    if std::mem::take(&mut self.planned[at]) == 0.0 {
                        return Err(BackendError::SlotFree(*slot));
                    }
                }
            }
        }
        Ok(())
    }

    fn check_shares(&self, entries: &[(Slot, f32)]) -> Result<(), BackendError> {
        for &(slot, share) in entries {
            if self.planned[within(slot, self.planned.len() as u32)?] == 0.0 {
                return Err(BackendError::SlotFree(slot));
            }
            if !(0.0..=1.0).contains(&share) {
                return Err(BackendError::Share(slot, share));
            }
        }
        Ok(())
    }

    /// What goes out by the row comes back by the column. Slots may be named twice, in any order.
    fn check_exchange(
        &mut self,
        slot: Slot,
        row: &[(Slot, f32)],
        column: &[(Slot, f32)],
    ) -> Result<(), BackendError> {
        let area = f64::from(self.planned[slot.0 as usize]);
        for &(other, share) in row.iter().filter(|(other, _)| *other != slot) {
            self.exchange[other.0 as usize][0] += area * f64::from(share);
        }
        for &(other, share) in column {
            let area = f64::from(self.planned[other.0 as usize]);
            self.exchange[other.0 as usize][1] += area * f64::from(share);
        }
        let mut result = Ok(());
        for &(other, _) in row.iter().chain(column) {
            let [forth, back] = std::mem::take(&mut self.exchange[other.0 as usize]);
            if result.is_ok() && (forth - back).abs() > RECIPROCITY_TOLERANCE * forth.max(back) {
                result = Err(BackendError::NotReciprocal { slot, other, forth, back });
            }
        }
        result
    }
}
