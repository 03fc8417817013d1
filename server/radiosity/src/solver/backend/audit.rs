//! How far light over rows is from the matrix's: both are read as they are when the audit begins, and compared once both are
//! here. On the CPU that is at once; a device copies its light while later steps run.

use super::SolverBackend;
use crate::backend::{BackendError, Slot};
use earthshine_world::Rgb;

/// Light of the same slots and moment, on its way from both.
pub(super) struct Audit {
    slots: Vec<Slot>,
    /// By the matrix; and whether it is here.
    exact: Vec<Rgb>,
    has_exact: bool,
    /// As it is told; and whether it is here.
    found: Vec<Rgb>,
    has_found: bool,
}

impl SolverBackend {
    /// How far light is from the matrix's, as a share; none while that is not whole, or light of either is on its way.
    pub(super) fn audit_once(&mut self) -> Result<Option<f32>, BackendError> {
        let begun = match self.audit.take() {
            None => self.begin_audit()?,
            begun => begun,
        };
        let (Some(mut audit), Some(on_rows), Some(matrix)) = (begun, &mut self.on_rows, &mut self.matrix)
        else {
            return Ok(None);
        };
        let Audit { slots, exact, has_exact, found, has_found } = &mut audit;
        *has_exact = *has_exact || measured(matrix.poll_irradiance(slots, exact))?;
        *has_found = *has_found || measured(on_rows.light.poll(&self.residents, slots, found))?;
        if !(*has_exact && *has_found) {
            self.audit = Some(audit);
            return Ok(None);
        }
        // What a step of the matrix tells, nobody wants but for who was refused. A device tells that before the light as a rule; one
        // that has much to tell may be later, and its audit counts whom it has refused.
        matrix.take_news(&mut Vec::new())?;
        matrix.take_refused(&mut self.refused)?;
        let (mut gap, mut norm) = (0.0f64, 0.0f64);
        let lights = audit.slots.iter().zip(audit.found.iter().zip(&audit.exact));
        for (_, (found, exact)) in lights.filter(|(slot, _)| matrix.is_taken(**slot)) {
            gap += f64::from((*found - *exact).length_squared());
            norm += f64::from(exact.length_squared());
        }
        Ok(Some(if gap == 0.0 { 0.0 } else { (gap / norm).sqrt() as f32 }))
    }

    /// Steps a matrix that is whole, by the sources of this moment.
    fn begin_audit(&mut self) -> Result<Option<Audit>, BackendError> {
        if !self.is_audited || self.on_rows.is_none() || !self.complete_matrix()? {
            return Ok(None);
        }
        self.tell_matrix()?;
        let Some(matrix) = self.matrix.as_mut().filter(|matrix| !matrix.is_behind()) else { return Ok(None) };
        matrix.step()?;
        let is_meant = |slot: &Slot| matrix.is_taken(*slot) && matrix.is_current(*slot);
        let slots: Vec<Slot> =
            (0..self.residents.links.capacity() as u32).map(Slot).filter(is_meant).collect();
        let dark = vec![Rgb::ZERO; slots.len()];
        Ok(Some(Audit { slots, exact: dark.clone(), has_exact: false, found: dark, has_found: false }))
    }
}

/// Whether a measurement was told. For want of memory it is not, and what was to be measured goes on all the same.
fn measured(told: Result<bool, BackendError>) -> Result<bool, BackendError> {
    match told {
        Err(BackendError::OutOfMemory { .. }) => Ok(false),
        told => told,
    }
}
