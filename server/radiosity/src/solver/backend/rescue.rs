//! What becomes of light when a device fails under it: the CPU goes on over the rows, from the light that was read last,
//! while whoever makes matrices and light finds another device.
//!
//! Nothing is lost with the device, as rows and sources are kept here. Makers that have to wait say
//! [`BackendError::DeviceLost`] and are asked again every step; what they make then is filled as if the settings had just
//! been chosen, and taken once it is whole. Want of memory is not waited for: the CPU goes on until others are chosen.

use super::{OnRows, SolverBackend};
use crate::backend::BackendError;
use crate::solver::{CpuRowLight, DrawnRows, Light, Method, SolverSettings, add_scaled, shooting};
use earthshine_world::Rgb;

impl SolverBackend {
    /// Does `what`, once more if a device fails under it, on the CPU then. `what` changes nothing before it may fail.
    pub(super) fn or_on_cpu<T>(
        &mut self,
        mut what: impl FnMut(&mut Self) -> Result<T, BackendError>,
    ) -> Result<T, BackendError> {
        match what(self) {
            Err(error) => {
                self.rescue(error)?;
                what(self)
            }
            done => done,
        }
    }

    /// Goes on over rows on the CPU, by the method of the settings if that works on rows.
    ///
    /// # Errors
    /// `error`, if it is not the device's.
    pub(super) fn rescue(&mut self, error: BackendError) -> Result<(), BackendError> {
        let is_waiting = match error {
            BackendError::DeviceLost { .. } => true,
            BackendError::OutOfMemory { .. } => false,
            other => return Err(other),
        };
        tracing::warn!(%error, "light is computed over rows on the CPU");
        let is_on_rows = self.settings.method != Method::Matrix && !self.settings.is_coloured();
        let method = if is_on_rows { self.settings.method } else { Method::Hybrid };
        let made_for = SolverSettings { method, rows: DrawnRows::FormFactors, ..self.settings };
        let light = CpuRowLight::new(&self.residents, &made_for, &self.light_to_go_on_from());
        self.on_rows = Some(OnRows { made_for, light: Box::new(light) });
        self.matrix = None;
        self.audit = None;
        self.is_matrix_behind = true;
        self.is_displaced = is_waiting;
        self.changed = true;
        Ok(())
    }

    /// What was read last, or for those who have not been seen yet, what the others send.
    pub(super) fn light_to_go_on_from(&self) -> Vec<Light> {
        let (residents, known) = (&self.residents, &self.read_last);
        let seen = |slot: usize| known[slot].unwrap_or_default();
        let light = |slot: usize| {
            if !residents.links.is_taken(slot) {
                return [0.0; 4];
            }
            known[slot].unwrap_or_else(|| {
                let mut arriving = residents.outside[slot];
                for link in residents.links.row(slot) {
                    let (other, none) = (link.slot as usize, [0.0; 4]);
                    let sent = shooting::sent(
                        &residents.links,
                        other,
                        &residents.direct[other],
                        &seen(other),
                        &none,
                    );
                    add_scaled(&mut arriving, link.share, &sent);
                }
                arriving
            })
        };
        (0..residents.links.capacity()).map(light).collect()
    }

    /// Light of `slot` as it was told, for [`Self::light_to_go_on_from`].
    pub(super) fn note_read(&mut self, slot: usize, light: Rgb) {
        self.read_last[slot] = Some(crate::solver::light(light));
    }

    /// Asks for what the CPU stands in for, if it does. What cannot be had for another reason than a device that is awaited
    /// is said, and not asked for again.
    pub(super) fn return_if_possible(&mut self) {
        if !self.is_displaced {
            return;
        }
        let settings = self.settings;
        let returned = if settings.needs_matrix() {
            self.matrix_wanted(&settings)
        } else {
            let audited = if self.is_audited { self.matrix_wanted(&settings) } else { Ok(()) };
            audited.and_then(|()| self.enter(&settings))
        };
        self.is_displaced = matches!(returned, Err(BackendError::DeviceLost { .. }));
        if let Err(error) = returned
            && !self.is_displaced
        {
            tracing::warn!(%error, "light stays on the CPU");
            self.matrix = None;
        }
    }
}
