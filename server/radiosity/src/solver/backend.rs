//! [`SolverBackend`]: rows, sources and light of resident patches, advanced by the method of the moment.
//!
//! A matrix is kept only while a method or an audit asks for it. Where it has to be made for patches that are there
//! already, that takes some steps, [`MATRIX_ADDS_A_STEP`] patches each; the method before goes on meanwhile. A device that
//! fails is stood in for by the CPU: `backend/rescue.rs`.

mod arrivals;
mod audit;
#[cfg(test)]
mod late_tests;
mod matrix;
mod rescue;
#[cfg(test)]
mod rescue_tests;

use super::links::LinkRows;
use super::residents::Residents;
use super::row_light::{Frame, RowLight, RowLightFactory};
use super::{CpuRowLight, Light, Method, SolverSettings};
use crate::backend::{ApplyStats, Backend, BackendError, HeldBytes, Repaired, Slot, StepStats, Update};
use crate::slot_check;
use crate::update_check::UpdateCheck;
use earthshine_world::Rgb;

/// Makes the backend that holds the matrix.
pub type MatrixFactory = Box<dyn FnMut(u32) -> Result<Box<dyn Backend>, BackendError> + Send>;

/// Patches that a step brings into a matrix that is being made.
pub const MATRIX_ADDS_A_STEP: usize = 64;

/// Light that is advanced over rows.
struct OnRows {
    /// As they were when it was made; budgets may have changed since.
    made_for: SolverSettings,
    light: Box<dyn RowLight>,
}

impl OnRows {
    /// Budgets of `settings`, for what is in use.
    fn current(&self, settings: &SolverSettings) -> SolverSettings {
        let SolverSettings { method, rows, adaptive, .. } = self.made_for;
        SolverSettings { method, rows, adaptive, ..*settings }
    }
}

/// A backend that solves over sparse rows, or by a matrix of another backend, as its settings say.
pub struct SolverBackend {
    settings: SolverSettings,
    residents: Residents,
    /// Slots, most urgent first.
    order: Vec<u32>,
    /// None: light comes from the matrix.
    on_rows: Option<OnRows>,
    make_light: RowLightFactory,
    make_matrix: MatrixFactory,
    matrix: Option<Box<dyn Backend>>,
    is_audited: bool,
    /// Sources that the matrix has not been told.
    is_matrix_behind: bool,
    /// An audit that is under way.
    audit: Option<audit::Audit>,
    /// Slots whose patch a matrix refused, to be told; they are taken until then.
    refused: Vec<Slot>,
    interest: Option<Vec<Slot>>,
    /// Whether light has come from elsewhere since the matrix last told of its own.
    is_matrix_untold: bool,
    check: UpdateCheck,
    frame: u32,
    changed: bool,
    /// Whether the CPU stands in for a device that is awaited.
    is_displaced: bool,
    /// Light as it was read last; none of slots that nobody has read since their patch came.
    read_last: Vec<Option<Light>>,
}

impl std::fmt::Debug for SolverBackend {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SolverBackend")
            .field("settings", &self.settings)
            .field("resident", &self.residents.links.taken_count())
            .finish_non_exhaustive()
    }
}

impl SolverBackend {
    /// Empty, for `capacity` slots, with light on the CPU. `make_matrix` is called once a matrix is wanted: if that is at
    /// once and it has fewer slots, so has this.
    ///
    /// # Errors
    /// [`BackendError::Settings`], or what `make_matrix` says.
    pub fn new(
        capacity: u32,
        settings: SolverSettings,
        make_matrix: MatrixFactory,
    ) -> Result<Self, BackendError> {
        Self::with_light(capacity, settings, make_matrix, CpuRowLight::factory())
    }

    /// As [`Self::new`], with light on rows as `make_light` makes it, for every method but the matrix. Where either says
    /// that a device is lost, now or later, the CPU stands in, and it is asked again in every step.
    ///
    /// # Errors
    /// [`BackendError::Settings`], or what else `make_matrix` and `make_light` say.
    pub fn with_light(
        capacity: u32,
        settings: SolverSettings,
        mut make_matrix: MatrixFactory,
        make_light: RowLightFactory,
    ) -> Result<Self, BackendError> {
        settings.validate().map_err(BackendError::Settings)?;
        let matrix = match settings.needs_matrix().then(|| make_matrix(capacity)) {
            Some(Ok(matrix)) => Some(matrix),
            // Asked again below.
            None | Some(Err(BackendError::DeviceLost { .. })) => None,
            Some(Err(error)) => return Err(error),
        };
        let slots = matrix.as_ref().map_or(capacity, |matrix| matrix.capacity()) as usize;
        let mut backend = Self {
            settings,
            residents: Residents::new(slots),
            order: Vec::new(),
            on_rows: None,
            make_light,
            make_matrix,
            matrix,
            is_audited: false,
            is_matrix_behind: false,
            audit: None,
            refused: Vec::new(),
            interest: None,
            is_matrix_untold: false,
            check: UpdateCheck::new(slots),
            frame: 0,
            changed: true,
            is_displaced: false,
            read_last: vec![None; slots],
        };
        backend.choose_or_wait(settings)?;
        Ok(backend)
    }

    /// The method in use; while a matrix is being made, the one before.
    #[must_use]
    pub fn method(&self) -> Method {
        self.on_rows.as_ref().map_or(Method::Matrix, |on_rows| on_rows.made_for.method)
    }

    /// The rows.
    #[must_use]
    pub fn links(&self) -> &LinkRows {
        &self.residents.links
    }

    fn choose(&mut self, settings: SolverSettings) -> Result<(), BackendError> {
        settings.validate().map_err(BackendError::Settings)?;
        if settings.needs_matrix() {
            self.matrix_wanted(&settings)?;
            self.settings = settings;
            self.enter_if_whole()?;
        } else {
            if !self.is_entered(&settings) {
                self.enter(&settings)?;
            }
            // Also one that was asked for and not whole yet.
            self.leave_matrix();
        }
        self.settings = settings;
        self.changed = true;
        Ok(())
    }

    /// Chooses, by the CPU for now where a device is awaited.
    fn choose_or_wait(&mut self, settings: SolverSettings) -> Result<(), BackendError> {
        match self.choose(settings) {
            Err(error @ BackendError::DeviceLost { .. }) => {
                self.settings = settings;
                self.rescue(error)
            }
            chosen => chosen,
        }
    }

    /// Whether light is advanced as `settings` say already.
    fn is_entered(&self, settings: &SolverSettings) -> bool {
        match &self.on_rows {
            Some(OnRows { made_for, .. }) => {
                let draws_alike = (made_for.rows, made_for.adaptive) == (settings.rows, settings.adaptive);
                made_for.method == settings.method && (!settings.method.is_endless() || draws_alike)
            }
            None => settings.method == Method::Matrix,
        }
    }

    /// Advances light by another method from now on, from where it is.
    fn enter(&mut self, settings: &SolverSettings) -> Result<(), BackendError> {
        self.audit = None;
        if settings.method == Method::Matrix {
            if self.on_rows.take().is_some() {
                let is_told = self.matrix.as_mut().is_some_and(|matrix| matrix.tell_afresh());
                self.is_matrix_untold |= !is_told;
            }
            return Ok(());
        }
        let light = self.light()?;
        let light = (self.make_light)(&mut self.residents, settings, &light)?;
        self.on_rows = Some(OnRows { made_for: *settings, light });
        Ok(())
    }

    /// All light as it would be published now, by slot; as it was told last where that would have to be waited for.
    fn light(&mut self) -> Result<Vec<Light>, BackendError> {
        let reads_at_once = match (&self.on_rows, &self.matrix) {
            (Some(on_rows), _) => on_rows.light.reads_at_once(),
            (None, Some(matrix)) => matrix.reads_at_once(),
            (None, None) => true,
        };
        if !reads_at_once {
            return Ok(self.light_to_go_on_from());
        }
        let slots: Vec<Slot> = match (&self.on_rows, &self.matrix) {
            (None, None) => Vec::new(),
            (None, Some(matrix)) => self.slots(|slot| matrix.is_taken(slot)),
            (Some(_), _) => self.slots(|slot| self.is_taken(slot)),
        };
        let mut irradiance = vec![Rgb::ZERO; slots.len()];
        match (&mut self.on_rows, &mut self.matrix) {
            (Some(on_rows), _) => on_rows.light.read(&self.residents, &slots, &mut irradiance)?,
            (None, Some(matrix)) => matrix.read_irradiance(&slots, &mut irradiance)?,
            (None, None) => {}
        }
        let mut light = vec![[0.0; 4]; self.residents.links.capacity()];
        for (slot, irradiance) in slots.iter().zip(irradiance) {
            light[slot.0 as usize] = super::light(irradiance);
        }
        Ok(light)
    }

    fn slots(&self, is_meant: impl Fn(Slot) -> bool) -> Vec<Slot> {
        (0..self.capacity()).map(Slot).filter(|&slot| is_meant(slot)).collect()
    }

    /// Whether the matrix has to have every update at once: light comes from it, whole or drawn.
    fn lives_on_matrix(&self) -> bool {
        self.on_rows.as_ref().is_none_or(|on_rows| on_rows.made_for.is_coloured())
    }

    /// Advances the light by a frame.
    fn step_once(&mut self) -> Result<StepStats, BackendError> {
        self.return_if_possible();
        if self.is_audited {
            self.complete_matrix()?;
        }
        self.enter_if_whole()?;
        if let (None, Some(matrix)) = (&self.on_rows, &mut self.matrix) {
            self.changed = false;
            return matrix.step();
        }
        let Residents { direct, outside, .. } = &self.residents;
        let is_lit = |&(own, outside): &(&Light, &Light)| *own != [0.0; 4] || *outside != [0.0; 4];
        let lit_columns = direct.iter().zip(outside).filter(is_lit).count() as u32;
        let recomputed = std::mem::take(&mut self.changed) || !self.is_at_rest();
        if let Some(on_rows) = self.on_rows.as_mut().filter(|_| recomputed) {
            let number = self.frame;
            self.frame = number.wrapping_add(1);
            let matrix = self.matrix.as_deref_mut().map(|matrix| matrix as &mut dyn Backend);
            // Until a matrix is whole, the method before goes on.
            let settings = on_rows.current(&self.settings);
            let frame = Frame { settings: &settings, number, order: &self.order, matrix };
            on_rows.light.advance(&mut self.residents, frame)?;
        }
        Ok(StepStats { lit_columns, recomputed })
    }

    /// Whether light over rows stays as it is, by the method that is meant.
    fn is_at_rest(&self) -> bool {
        !self.is_displaced
            && self.is_entered(&self.settings)
            && self.on_rows.as_ref().is_none_or(|on_rows| on_rows.light.is_settled())
    }

    fn news(&mut self, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        match (&mut self.on_rows, &mut self.matrix) {
            (Some(on_rows), _) => on_rows.light.take_news(&self.residents, news),
            (None, Some(matrix)) if !self.is_matrix_untold => matrix.take_news(news),
            (None, Some(_)) => self.tell_all_of_matrix(news),
            (None, None) => Ok(()),
        }
    }

    fn read(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        match (&mut self.on_rows, &mut self.matrix) {
            (Some(on_rows), _) => on_rows.light.read(&self.residents, slots, out),
            (None, Some(matrix)) => matrix.read_irradiance(slots, out),
            (None, None) => Ok(()),
        }
    }
}

impl Backend for SolverBackend {
    fn capacity(&self) -> u32 {
        self.residents.links.capacity() as u32
    }

    fn apply(&mut self, updates: &[Update]) -> Result<ApplyStats, BackendError> {
        self.check.check(updates, |slot| self.residents.links.area(slot.0 as usize))?;
        self.or_on_cpu(|own| own.apply_checked(updates))
    }

    fn is_taken(&self, slot: Slot) -> bool {
        slot.0 < self.capacity() && self.residents.links.is_taken(slot.0 as usize)
    }

    fn take_refused(&mut self, refused: &mut Vec<Slot>) -> Result<(), BackendError> {
        self.or_on_cpu(|own| own.tell_refused(refused))
    }

    fn is_behind(&self) -> bool {
        // A matrix that is wanted may be whole, and stepped, in the very next step.
        let has_matrix_step = self.on_rows.is_none() || self.audit.is_some() || self.settings.needs_matrix();
        self.on_rows.as_ref().is_some_and(|on_rows| on_rows.light.is_behind())
            || self.matrix.as_ref().is_some_and(|matrix| has_matrix_step && matrix.is_behind())
    }

    fn held_bytes(&self) -> HeldBytes {
        let of_matrix = self.matrix.as_ref().map_or(HeldBytes::default(), |matrix| matrix.held_bytes());
        HeldBytes { rows: of_matrix.rows + self.residents.links.bytes() as u64, ..of_matrix }
    }

    fn clear(&mut self) -> Result<(), BackendError> {
        self.or_on_cpu(Self::clear_all)
    }

    fn set_sources(
        &mut self,
        slots: &[Slot],
        direct_exitance: &[Rgb],
        outside_irradiance: &[Rgb],
    ) -> Result<(), BackendError> {
        slot_check::are_sources(slots, direct_exitance, outside_irradiance)?;
        slot_check::all_taken(slots, self.capacity(), |slot| self.is_taken(slot))?;
        if self.on_rows.is_none() {
            let matrix = self.matrix.as_mut().expect("the matrix method has a matrix");
            matrix.set_sources(slots, direct_exitance, outside_irradiance)?;
        } else {
            self.is_matrix_behind = true;
        }
        for ((slot, &direct), &outside) in slots.iter().zip(direct_exitance).zip(outside_irradiance) {
            let slot = slot.0 as usize;
            let (direct, outside) = (super::light(direct), super::light(outside));
            let gap = |new: &Light, old: &Light| std::array::from_fn(|c| new[c] - old[c]);
            let (direct_before, outside_before) =
                (&mut self.residents.direct[slot], &mut self.residents.outside[slot]);
            let (more, in_more): (Light, Light) =
                (gap(&direct, direct_before), gap(&outside, outside_before));
            if more == [0.0; 4] && in_more == [0.0; 4] {
                continue;
            }
            self.changed = true;
            (*direct_before, *outside_before) = (direct, outside);
            if let Some(on_rows) = &mut self.on_rows {
                on_rows.light.change(&self.residents, slot, &more, &in_more);
            }
        }
        Ok(())
    }

    fn set_sky(
        &mut self,
        slots: &[Slot],
        sky_shares: &[f32],
        sky_irradiance: &[Rgb],
    ) -> Result<(), BackendError> {
        slot_check::is_sky(slots, sky_shares, sky_irradiance)?;
        slot_check::all_taken(slots, self.capacity(), |slot| self.is_taken(slot))?;
        for ((slot, &share), &light) in slots.iter().zip(sky_shares).zip(sky_irradiance) {
            let (slot, light) = (slot.0 as usize, super::light(light));
            let is_new = std::mem::replace(&mut self.residents.sky_shares[slot], share) != share;
            if let Some(on_rows) = self.on_rows.as_mut().filter(|_| is_new) {
                on_rows.light.outdate(slot);
            }
            self.changed |= std::mem::replace(&mut self.residents.sky[slot], light) != light;
        }
        Ok(())
    }

    fn set_order(&mut self, slots: &[Slot]) -> Result<(), BackendError> {
        slots.iter().try_for_each(|&slot| slot_check::within(slot, self.capacity()).map(|_| ()))?;
        self.order.clear();
        self.order.extend(slots.iter().map(|slot| slot.0));
        Ok(())
    }

    fn set_interest(&mut self, slots: Option<&[Slot]>) -> Result<(), BackendError> {
        let named = slots.unwrap_or_default();
        named.iter().try_for_each(|&slot| slot_check::within(slot, self.capacity()).map(|_| ()))?;
        self.interest = slots.map(<[Slot]>::to_vec);
        self.matrix.as_mut().map_or(Ok(()), |matrix| matrix.set_interest(slots))
    }

    fn is_current(&self, slot: Slot) -> bool {
        match (&self.on_rows, &self.matrix) {
            (None, Some(matrix)) => matrix.is_current(slot),
            _ => self.is_taken(slot),
        }
    }

    fn step(&mut self) -> Result<StepStats, BackendError> {
        self.or_on_cpu(Self::step_once)
    }

    fn is_settled(&self) -> bool {
        !self.changed
            && self.is_at_rest()
            && match &self.on_rows {
                None => self.matrix.as_ref().is_none_or(|matrix| matrix.is_settled()),
                Some(on_rows) => !on_rows.light.is_news_coming(),
            }
    }

    fn set_solver(&mut self, settings: &SolverSettings) -> Result<bool, BackendError> {
        if *settings != self.settings {
            self.choose_or_wait(*settings)?;
        }
        Ok(true)
    }

    fn set_audited(&mut self, is_audited: bool) -> Result<bool, BackendError> {
        self.is_audited = is_audited;
        if is_audited {
            let settings = self.settings;
            // One that is displaced asks anyway.
            let wanted = if self.is_displaced { Ok(()) } else { self.matrix_wanted(&settings) };
            match wanted {
                Err(error @ BackendError::DeviceLost { .. }) => self.rescue(error)?,
                other => other?,
            }
        } else {
            self.end_audits();
        }
        Ok(true)
    }

    fn audit(&mut self) -> Result<Option<f32>, BackendError> {
        self.or_on_cpu(Self::audit_once)
    }

    fn is_audit_coming(&self) -> bool {
        self.audit.is_some()
    }

    fn read_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        slot_check::one_each(slots, out.len())?;
        slot_check::all_taken(slots, self.capacity(), |slot| self.is_taken(slot))?;
        self.or_on_cpu(|own| own.read(slots, out))?;
        slots.iter().zip(&*out).for_each(|(slot, &light)| self.note_read(slot.0 as usize, light));
        Ok(())
    }

    fn take_news(&mut self, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        let told_before = news.len();
        self.or_on_cpu(|own| own.news(news))?;
        news[told_before..].iter().for_each(|&(slot, light)| self.note_read(slot.0 as usize, light));
        Ok(())
    }

    fn drift(&mut self, seed: u64) -> f32 {
        self.matrix.as_mut().map_or(0.0, |matrix| matrix.drift(seed))
    }

    fn poll_drift(&mut self, seed: u64) -> Result<Option<f32>, BackendError> {
        self.or_on_cpu(|own| {
            match own.matrix.as_mut().map_or(Ok(Some(0.0)), |matrix| matrix.poll_drift(seed)) {
                // The matrix is no worse for not being measured; the next tick asks again.
                Err(BackendError::OutOfMemory { .. }) => Ok(None),
                told => told,
            }
        })
    }

    fn repair(&mut self, columns_max: u32) -> Result<Repaired, BackendError> {
        self.or_on_cpu(|own| match &mut own.matrix {
            Some(matrix) => matrix.repair(columns_max),
            None => Ok(Repaired { columns: 0, is_complete: true }),
        })
    }

    fn resolve(&mut self) -> Result<(), BackendError> {
        match self.matrix.as_mut().map_or(Ok(()), |matrix| matrix.resolve()) {
            Err(error @ BackendError::DeviceLost { .. }) => self.rescue(error),
            // The matrix is what it was for want of memory.
            other => other,
        }
    }
}
