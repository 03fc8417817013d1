//! Who comes and who goes: told to the rows, to the light over them and to the matrix that light may come from.

use super::SolverBackend;
use crate::backend::{ApplyStats, BackendError, MIN_PIVOT, Slot, Update};
use crate::solver::CpuRowLight;

impl SolverBackend {
    /// Tells rows, and the light over them, who comes and goes.
    pub(super) fn apply_to_rows(&mut self, updates: &[Update]) -> Result<(), BackendError> {
        self.changed |= !updates.is_empty();
        for update in updates {
            match update {
                Update::Add { slot, reflectance, area, row, column: _ } => {
                    let at = slot.0 as usize;
                    let entries = row.iter().map(|&(other, share)| (other.0 as usize, share));
                    self.residents.links.add(at, *area, *reflectance, entries);
                    let Some(on_rows) = &mut self.on_rows else { continue };
                    if let Err(error) = on_rows.light.come(&self.residents, at) {
                        // Who stands in knows of everybody who is there.
                        self.rescue(error)?;
                    }
                }
                Update::Remove { slot } if self.residents.links.is_taken(slot.0 as usize) => {
                    let at = slot.0 as usize;
                    self.or_on_cpu(|own| match &mut own.on_rows {
                        Some(on_rows) => on_rows.light.leave(&own.residents, at),
                        None => Ok(()),
                    })?;
                    self.residents.remove(at);
                    self.read_last[at] = None;
                    // Whoever has left need not be told of.
                    self.refused.retain(|refused| refused != slot);
                }
                Update::Remove { .. } => {}
            }
        }
        Ok(())
    }

    /// Tells whom a matrix has refused; they leave the rows, too.
    pub(super) fn tell_refused(&mut self, refused: &mut Vec<Slot>) -> Result<(), BackendError> {
        if let Some(on_rows) = &mut self.on_rows {
            on_rows.light.collect()?;
        }
        if let Some(matrix) = &mut self.matrix {
            matrix.take_refused(&mut self.refused)?;
        }
        for slot in std::mem::take(&mut self.refused) {
            if self.residents.links.is_taken(slot.0 as usize) {
                self.apply_to_rows(&[Update::Remove { slot }])?;
                refused.push(slot);
            }
        }
        Ok(())
    }

    /// Applies updates that have been checked.
    pub(super) fn apply_checked(&mut self, updates: &[Update]) -> Result<ApplyStats, BackendError> {
        if self.lives_on_matrix() {
            let matrix = self.matrix.as_mut().expect("what lives on a matrix has one");
            let stats = matrix.apply(updates)?;
            let is_in =
                |update: &&Update| !matches!(update, Update::Add { slot, .. } if !matrix.is_taken(*slot));
            // Who was refused at once has no links either.
            let taken: Vec<Update> = updates.iter().filter(is_in).cloned().collect();
            self.apply_to_rows(&taken)?;
            return Ok(stats);
        }
        if let Some(matrix) = &mut self.matrix {
            let leaving =
                |update: &&Update| matches!(update, Update::Remove { slot } if matrix.is_taken(*slot));
            let leaving: Vec<Update> = updates.iter().filter(leaving).cloned().collect();
            matrix.apply(&leaving)?;
        }
        let mut stats = ApplyStats::default();
        for update in updates {
            match update {
                Update::Add { slot, reflectance, row, .. } => {
                    let own: f32 =
                        row.iter().filter(|(other, _)| other == slot).map(|(_, share)| share).sum();
                    if 1.0 - reflectance.max_element() * own < MIN_PIVOT {
                        stats.weak_pivots += 1;
                        continue;
                    }
                    stats.added += 1;
                }
                Update::Remove { .. } => stats.removed += 1,
            }
            self.apply_to_rows(std::slice::from_ref(update))?;
        }
        Ok(stats)
    }

    /// Forgets everybody.
    pub(super) fn clear_all(&mut self) -> Result<(), BackendError> {
        self.matrix.as_mut().map_or(Ok(()), |matrix| matrix.clear())?;
        self.residents.clear();
        self.read_last.fill(None);
        self.refused.clear();
        self.audit = None;
        self.changed = true;
        let Some(on_rows) = &mut self.on_rows else { return Ok(()) };
        let settings = on_rows.current(&self.settings);
        let dark = vec![[0.0; 4]; self.residents.links.capacity()];
        if self.is_displaced {
            on_rows.light = Box::new(CpuRowLight::new(&self.residents, &settings, &dark));
        } else {
            on_rows.light = (self.make_light)(&mut self.residents, &settings, &dark)?;
        }
        Ok(())
    }
}
