//! The matrix beside the rows: made when a method or an audit wants it, a few patches a step, and told of sources.

use super::{MATRIX_ADDS_A_STEP, SolverBackend};
use crate::backend::{Backend, BackendError, Slot, Update};
use crate::local_matrix::LocalMatrix;
use crate::solver::{Light, Method, SolverSettings, rgb};
use earthshine_world::Rgb;

impl SolverBackend {
    pub(super) fn matrix_wanted(&mut self, settings: &SolverSettings) -> Result<(), BackendError> {
        if self.matrix.is_none() {
            let capacity = self.capacity();
            let mut matrix = (self.make_matrix)(capacity)?;
            if matrix.capacity() < capacity {
                let bytes = LocalMatrix::bytes(capacity);
                return Err(BackendError::OutOfMemory { slots: capacity, bytes });
            }
            matrix.set_interest(self.interest.as_deref())?;
            self.matrix = Some(matrix);
            self.is_matrix_behind = true;
        }
        let Some(matrix) = &mut self.matrix else { return Ok(()) };
        // Asked for any slot, taken or not: what counts is whether it shows rows at all.
        if settings.is_coloured() && matrix.read_row(Slot(0), &mut Vec::new()) == Err(BackendError::NoRows) {
            return Err(BackendError::NoRows);
        }
        Ok(())
    }

    pub(super) fn leave_matrix(&mut self) {
        if !self.is_audited {
            self.matrix = None;
        }
    }

    /// Nobody audits any more.
    pub(super) fn end_audits(&mut self) {
        self.audit = None;
        if !self.settings.needs_matrix() {
            self.matrix = None;
        }
    }

    /// Brings patches that the matrix lacks into it. Returns whether it is whole.
    pub(super) fn complete_matrix(&mut self) -> Result<bool, BackendError> {
        let Some(matrix) = &mut self.matrix else { return Ok(false) };
        let links = &self.residents.links;
        // Who was refused would be offered for ever.
        let is_missing = |slot: Slot| !matrix.is_taken(slot) && !self.refused.contains(&slot);
        let missing = (0..links.capacity())
            .filter(|&slot| links.is_taken(slot) && is_missing(Slot(slot as u32)))
            .take(MATRIX_ADDS_A_STEP);
        let mut entering = vec![false; links.capacity()];
        let mut updates = Vec::new();
        for slot in missing {
            entering[slot] = true;
            let is_there = |other: u32| entering[other as usize] || matrix.is_taken(Slot(other));
            let (mut row, mut column) = (Vec::new(), Vec::new());
            for link in links.row(slot).iter().filter(|link| is_there(link.slot)) {
                let other = Slot(link.slot);
                row.push((other, link.share));
                if link.slot as usize != slot {
                    let back = link.share * links.area(slot) / links.area(link.slot as usize);
                    column.push((other, back.min(1.0)));
                }
            }
            let (area, reflectance) = (links.area(slot), links.reflectance(slot));
            updates.push(Update::Add { slot: Slot(slot as u32), reflectance, area, row, column });
        }
        if updates.is_empty() {
            return Ok(true);
        }
        self.is_matrix_behind = true;
        let stats = matrix.apply(&updates)?;
        if stats.weak_pivots > 0 {
            // Light of a loop without loss is of no use to anyone: who is refused leaves the rows, too, once that is told.
            let offered = updates.iter().filter_map(|update| match update {
                Update::Add { slot, .. } => Some(*slot),
                Update::Remove { .. } => None,
            });
            self.refused.extend(offered.filter(|&slot| !matrix.is_taken(slot)));
        }
        Ok(false)
    }

    /// Goes over to what lives on the matrix once that is whole.
    pub(super) fn enter_if_whole(&mut self) -> Result<(), BackendError> {
        let settings = self.settings;
        if settings.needs_matrix() && !self.is_entered(&settings) && self.complete_matrix()? {
            if settings.method == Method::Matrix {
                self.tell_matrix()?;
            }
            self.enter(&settings)?;
        }
        Ok(())
    }

    /// All light of the matrix: what it told before it was left, another method has told otherwise since.
    pub(super) fn tell_all_of_matrix(&mut self, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        let Some(matrix) = &mut self.matrix else { return Ok(()) };
        let mut own_news = Vec::new();
        matrix.take_news(&mut own_news)?;
        let is_lit = |slot: &Slot| matrix.is_taken(*slot) && matrix.is_current(*slot);
        let slots: Vec<Slot> = (0..matrix.capacity()).map(Slot).filter(is_lit).collect();
        let mut light = vec![Rgb::ZERO; slots.len()];
        matrix.read_irradiance(&slots, &mut light)?;
        news.extend(own_news);
        news.extend(slots.into_iter().zip(light));
        self.is_matrix_untold = false;
        Ok(())
    }

    /// Hands the matrix all sources if it may lack some.
    pub(super) fn tell_matrix(&mut self) -> Result<(), BackendError> {
        let Some(matrix) = &mut self.matrix else { return Ok(()) };
        if std::mem::take(&mut self.is_matrix_behind) {
            let slots: Vec<Slot> = (0..self.residents.links.capacity() as u32)
                .map(Slot)
                .filter(|&slot| matrix.is_taken(slot))
                .collect();
            let pick =
                |of: &[Light]| -> Vec<Rgb> { slots.iter().map(|slot| rgb(of[slot.0 as usize])).collect() };
            matrix.set_sources(&slots, &pick(&self.residents.direct), &pick(&self.residents.outside))?;
        }
        Ok(())
    }
}
