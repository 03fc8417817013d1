//! [`SolverBackend`]: rows, sources and light of resident patches, advanced by the method of the moment.
//!
//! A matrix is kept only while a method or an audit asks for it. Where it has to be made for patches that are there
//! already, that takes some steps, [`MATRIX_ADDS_A_STEP`] patches each; the method before goes on meanwhile.

mod advance;
mod matrix;
mod residents;

use super::draws::Draws;
use super::links::LinkRows;
use super::sampler::RowSampler;
use super::shooting::Unshot;
use super::temporal::RowNoise;
use super::{DrawnRows, Light, Method, SolverSettings, guard, rgb};
use crate::backend::{ApplyStats, Backend, BackendError, MIN_PIVOT, Repaired, Slot, StepStats, Update};
use crate::slot_check;
use crate::tables::CdfTable;
use crate::update_check::UpdateCheck;
use earthshine_world::Rgb;

/// Makes the backend that holds the matrix.
pub type MatrixFactory = Box<dyn FnMut(u32) -> Result<Box<dyn Backend>, BackendError> + Send>;

/// Patches that a step brings into a matrix that is being made.
pub const MATRIX_ADDS_A_STEP: usize = 64;
/// Squared relative change of a bounce below which gathering has settled.
const GATHER_SETTLED: f64 = 1e-12;

/// What the method of the moment keeps besides light.
enum State {
    /// Light comes from the matrix.
    Matrix,
    /// Bounces of all rows.
    Gather { is_settled: bool },
    /// Draws, from tables of the method's kind over rows of either kind.
    Drawn(Method, DrawnRows, Box<dyn Draws>, Vec<RowNoise>),
    /// Shots.
    Progressive(Unshot),
    /// Shots, draws and what they estimate.
    Hybrid(Unshot, RowSampler<CdfTable>, Vec<Light>),
}

/// A backend that solves over sparse rows, or by a matrix of another backend, as its settings say.
pub struct SolverBackend {
    settings: SolverSettings,
    links: LinkRows,
    direct: Vec<Light>,
    outside: Vec<Light>,
    /// What of `outside` is the sky's, and its share of the row.
    sky: Vec<Light>,
    sky_shares: Vec<f32>,
    /// Slots, most urgent first.
    order: Vec<u32>,
    /// Light without what a hybrid estimates.
    irradiance: Vec<Light>,
    state: State,
    make_matrix: MatrixFactory,
    matrix: Option<Box<dyn Backend>>,
    is_audited: bool,
    /// Sources that the matrix has not been told.
    is_matrix_behind: bool,
    interest: Option<Vec<Slot>>,
    check: UpdateCheck,
    /// Room for what leaves, and for what draws of the outside bring.
    sent: Vec<Light>,
    drawn_far: Vec<Light>,
    drawn_sky: Vec<Light>,
    frame: u32,
    guard_cursor: usize,
    changed: bool,
}

impl std::fmt::Debug for SolverBackend {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SolverBackend")
            .field("settings", &self.settings)
            .field("resident", &self.links.taken_count())
            .finish_non_exhaustive()
    }
}

impl SolverBackend {
    /// Empty, for `capacity` slots. `make_matrix` is called once a matrix is wanted: if that is at once and it has fewer
    /// slots, so has this.
    ///
    /// # Errors
    /// [`BackendError::Settings`], or what `make_matrix` says.
    pub fn new(
        capacity: u32,
        settings: SolverSettings,
        mut make_matrix: MatrixFactory,
    ) -> Result<Self, BackendError> {
        settings.validate().map_err(BackendError::Settings)?;
        let matrix = if settings.needs_matrix() { Some(make_matrix(capacity)?) } else { None };
        let slots = matrix.as_ref().map_or(capacity, |matrix| matrix.capacity()) as usize;
        let dark = vec![[0.0; 4]; slots];
        let mut backend = Self {
            settings,
            links: LinkRows::new(slots),
            direct: dark.clone(),
            outside: dark.clone(),
            sky: dark.clone(),
            sky_shares: vec![0.0; slots],
            order: Vec::new(),
            irradiance: dark.clone(),
            state: State::Gather { is_settled: true },
            make_matrix,
            matrix,
            is_audited: false,
            is_matrix_behind: false,
            interest: None,
            check: UpdateCheck::new(slots),
            sent: dark.clone(),
            drawn_far: dark.clone(),
            drawn_sky: dark,
            frame: 0,
            guard_cursor: 0,
            changed: true,
        };
        backend.choose(settings)?;
        Ok(backend)
    }

    /// The method in use; while a matrix is being made, the one before.
    #[must_use]
    pub fn method(&self) -> Method {
        match self.state {
            State::Matrix => Method::Matrix,
            State::Gather { .. } => Method::Gather,
            State::Drawn(method, ..) => method,
            State::Progressive(_) => Method::Progressive,
            State::Hybrid(..) => Method::Hybrid,
        }
    }

    /// The rows.
    #[must_use]
    pub fn links(&self) -> &LinkRows {
        &self.links
    }

    fn choose(&mut self, settings: SolverSettings) -> Result<(), BackendError> {
        settings.validate().map_err(BackendError::Settings)?;
        if settings.needs_matrix() {
            self.matrix_wanted(&settings)?;
            self.settings = settings;
            self.enter_if_whole()?;
        } else {
            // Also one that was asked for and not whole yet.
            self.leave_matrix();
            if !self.is_entered(&settings) {
                self.enter(&settings);
            }
        }
        self.settings = settings;
        self.changed = true;
        Ok(())
    }

    /// Whether light is advanced as `settings` say already.
    fn is_entered(&self, settings: &SolverSettings) -> bool {
        let has_rows = match self.state {
            State::Drawn(_, rows, ..) => rows == settings.rows,
            _ => true,
        };
        self.method() == settings.method && has_rows
    }

    /// Whether the matrix has to have every update at once: light comes from it, whole or drawn.
    fn lives_on_matrix(&self) -> bool {
        matches!(self.state, State::Matrix | State::Drawn(_, DrawnRows::Multibounce, ..))
    }

    fn published(&self, slot: usize) -> Rgb {
        let light = rgb(self.irradiance[slot]);
        match &self.state {
            State::Hybrid(_, _, rest) => light + rgb(rest[slot]),
            _ => light,
        }
    }
}

impl Backend for SolverBackend {
    fn capacity(&self) -> u32 {
        self.links.capacity() as u32
    }

    fn apply(&mut self, updates: &[Update]) -> Result<ApplyStats, BackendError> {
        self.check.check(updates, |slot| self.links.area(slot.0 as usize))?;
        if self.lives_on_matrix() {
            let matrix = self.matrix.as_mut().expect("what lives on a matrix has one");
            let stats = matrix.apply(updates)?;
            let is_in =
                |update: &&Update| !matches!(update, Update::Add { slot, .. } if !matrix.is_taken(*slot));
            // Who was refused has no links either.
            let taken: Vec<Update> = updates.iter().filter(is_in).cloned().collect();
            self.apply_to_links(&taken);
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
            self.apply_to_links(std::slice::from_ref(update));
        }
        Ok(stats)
    }

    fn is_taken(&self, slot: Slot) -> bool {
        (slot.0 as usize) < self.links.capacity() && self.links.is_taken(slot.0 as usize)
    }

    fn clear(&mut self) -> Result<(), BackendError> {
        self.matrix.as_mut().map_or(Ok(()), |matrix| matrix.clear())?;
        self.clear_links();
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
        if matches!(self.state, State::Matrix) {
            let matrix = self.matrix.as_mut().expect("the matrix method has a matrix");
            matrix.set_sources(slots, direct_exitance, outside_irradiance)?;
        } else {
            self.is_matrix_behind = true;
        }
        for ((slot, &direct), &outside) in slots.iter().zip(direct_exitance).zip(outside_irradiance) {
            let slot = slot.0 as usize;
            let (direct, outside) = (super::light(direct), super::light(outside));
            let gap = |new: &Light, old: &Light| std::array::from_fn(|c| new[c] - old[c]);
            let (more, in_more): (Light, Light) =
                (gap(&direct, &self.direct[slot]), gap(&outside, &self.outside[slot]));
            if more == [0.0; 4] && in_more == [0.0; 4] {
                continue;
            }
            self.changed = true;
            (self.direct[slot], self.outside[slot]) = (direct, outside);
            if let State::Progressive(unshot) | State::Hybrid(unshot, ..) = &mut self.state {
                super::add_scaled(&mut self.irradiance[slot], 1.0, &in_more);
                unshot.change(super::light(self.links.reflectance(slot)), slot, more, in_more);
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
            if std::mem::replace(&mut self.sky_shares[slot], share) != share {
                match &mut self.state {
                    State::Drawn(_, _, draws, _) => draws.outdate(slot),
                    State::Hybrid(_, sampler, _) => sampler.outdate(slot),
                    _ => {}
                }
            }
            self.changed |= std::mem::replace(&mut self.sky[slot], light) != light;
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
        match (&self.state, &self.matrix) {
            (State::Matrix, Some(matrix)) => matrix.is_current(slot),
            _ => self.is_taken(slot),
        }
    }

    fn step(&mut self) -> Result<StepStats, BackendError> {
        if self.is_audited {
            self.complete_matrix()?;
        }
        self.enter_if_whole()?;
        if let (State::Matrix, Some(matrix)) = (&self.state, &mut self.matrix) {
            self.changed = false;
            return matrix.step();
        }
        let lit_columns =
            self.direct.iter().zip(&self.outside).filter(|&(a, b)| *a != [0.0; 4] || *b != [0.0; 4]).count();
        let recomputed = std::mem::take(&mut self.changed) || !self.is_settled();
        if recomputed {
            if let State::Gather { is_settled } = &mut self.state {
                *is_settled = false;
            }
            self.advance()?;
            self.frame = self.frame.wrapping_add(1);
            guard::check(&self.links, &self.irradiance, &mut self.guard_cursor)?;
        }
        Ok(StepStats { lit_columns: lit_columns as u32, recomputed })
    }

    fn is_settled(&self) -> bool {
        !self.changed
            && self.is_entered(&self.settings)
            && match &self.state {
                State::Matrix => self.matrix.as_ref().is_none_or(|matrix| matrix.is_settled()),
                State::Gather { is_settled } => *is_settled,
                State::Drawn(..) => false,
                State::Progressive(unshot) | State::Hybrid(unshot, ..) => unshot.is_settled,
            }
    }

    fn set_solver(&mut self, settings: &SolverSettings) -> Result<bool, BackendError> {
        if *settings != self.settings {
            if let (State::Matrix, Some(matrix)) = (&self.state, &mut self.matrix) {
                let slots: Vec<Slot> = (0..self.links.capacity() as u32)
                    .map(Slot)
                    .filter(|&slot| matrix.is_taken(slot))
                    .collect();
                let mut light = vec![Rgb::ZERO; slots.len()];
                matrix.read_irradiance(&slots, &mut light)?;
                for (slot, light) in slots.iter().zip(light) {
                    self.irradiance[slot.0 as usize] = super::light(light);
                }
            }
            self.choose(*settings)?;
        }
        Ok(true)
    }

    fn set_audited(&mut self, is_audited: bool) -> Result<bool, BackendError> {
        self.is_audited = is_audited;
        if is_audited {
            let settings = self.settings;
            self.matrix_wanted(&settings)?;
        } else if !self.settings.needs_matrix() {
            self.matrix = None;
        }
        Ok(true)
    }

    fn audit(&mut self) -> Result<Option<f32>, BackendError> {
        if !self.is_audited || matches!(self.state, State::Matrix) || !self.complete_matrix()? {
            return Ok(None);
        }
        self.tell_matrix()?;
        let Some(matrix) = &mut self.matrix else { return Ok(None) };
        matrix.step()?;
        let slots: Vec<Slot> = (0..self.links.capacity() as u32)
            .map(Slot)
            .filter(|&slot| matrix.is_taken(slot) && matrix.is_current(slot))
            .collect();
        let mut exact = vec![Rgb::ZERO; slots.len()];
        matrix.read_irradiance(&slots, &mut exact)?;
        let (mut gap, mut norm) = (0.0f64, 0.0f64);
        for (slot, exact) in slots.iter().zip(&exact) {
            gap += f64::from((self.published(slot.0 as usize) - *exact).length_squared());
            norm += f64::from(exact.length_squared());
        }
        Ok(Some(if gap == 0.0 { 0.0 } else { (gap / norm).sqrt() as f32 }))
    }

    fn read_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        if let (State::Matrix, Some(matrix)) = (&self.state, &mut self.matrix) {
            return matrix.read_irradiance(slots, out);
        }
        slot_check::one_each(slots, out.len())?;
        slot_check::all_taken(slots, self.capacity(), |slot| self.is_taken(slot))?;
        for (slot, out) in slots.iter().zip(out) {
            *out = self.published(slot.0 as usize);
        }
        Ok(())
    }

    fn drift(&mut self, seed: u64) -> f32 {
        self.matrix.as_mut().map_or(0.0, |matrix| matrix.drift(seed))
    }

    fn repair(&mut self, columns_max: u32) -> Result<Repaired, BackendError> {
        match &mut self.matrix {
            Some(matrix) => matrix.repair(columns_max),
            None => Ok(Repaired { columns: 0, is_complete: true }),
        }
    }

    fn resolve(&mut self) -> Result<(), BackendError> {
        self.matrix.as_mut().map_or(Ok(()), |matrix| matrix.resolve())
    }
}
