//! [`CpuRowLight`]: the light of sparse rows in main memory, advanced by rayon's threads; the oracle for the others.

use super::coloured::ColouredSampler;
use super::draws::{Draws, TableSources};
use super::links::LinkRows;
use super::residents::Residents;
use super::row_light::{Frame, RowLight, RowLightFactory};
use super::sampler::{RowSampler, sky_part};
use super::shooting::Unshot;
use super::temporal::{RowNoise, Scene};
use super::{
    DrawnRows, Light, Method, SolverSettings, add_scaled, guard, remainder, rgb, shooting, step_gather,
    temporal,
};
use crate::backend::{Backend, BackendError, Slot};
use crate::tables::{AliasTable, CdfTable};
use crate::told::Told;
use earthshine_world::Rgb;
use rayon::prelude::*;

/// Slots that a task prepares at least.
const SLOTS_A_TASK: usize = 4096;
/// Mean square of what a bounce changes of each patch's light, as a share of it, below which gathering has settled.
pub const GATHER_SETTLED: f64 = 1e-12;

/// What a method keeps besides light.
enum State {
    /// Bounces of all rows.
    Gather { is_settled: bool },
    /// Draws, from tables of the method's kind over rows of either kind.
    Drawn(Box<dyn Draws>, Vec<RowNoise>),
    /// Shots.
    Progressive(Unshot),
    /// Shots, draws and what they estimate.
    Hybrid(Unshot, RowSampler<CdfTable>, Vec<Light>),
}

/// Light by slot, without what a hybrid estimates; and what its method keeps.
pub struct CpuRowLight {
    state: State,
    irradiance: Vec<Light>,
    told: Told,
    /// Whether rows of the matrix are drawn from.
    is_coloured: bool,
    /// Room for what leaves, and for what draws of the outside bring.
    sent: Vec<Light>,
    drawn_far: Vec<Light>,
    drawn_sky: Vec<Light>,
    guard_cursor: usize,
}

impl std::fmt::Debug for CpuRowLight {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CpuRowLight").field("slots", &self.irradiance.len()).finish_non_exhaustive()
    }
}

impl CpuRowLight {
    /// Begins a method that works on rows, from `light`.
    ///
    /// # Panics
    /// For [`Method::Matrix`], which does not.
    #[must_use]
    pub fn new(residents: &Residents, settings: &SolverSettings, light: &[Light]) -> Self {
        let links = &residents.links;
        let slots = links.capacity();
        let mut irradiance = light.to_vec();
        let mut begin = || shooting::begin(links, &residents.direct, &residents.outside, &mut irradiance);
        let state = match settings.method {
            Method::Matrix => panic!("a matrix works on no rows"),
            Method::Gather => State::Gather { is_settled: false },
            Method::Alias | Method::Cdf => {
                let draws: Box<dyn Draws> = match (settings.method, settings.rows) {
                    (Method::Alias, DrawnRows::FormFactors) => Box::new(RowSampler::<AliasTable>::new(links)),
                    (Method::Alias, DrawnRows::Multibounce) => {
                        Box::new(ColouredSampler::<AliasTable>::new(links))
                    }
                    (_, DrawnRows::FormFactors) => Box::new(RowSampler::<CdfTable>::new(links)),
                    (_, DrawnRows::Multibounce) => Box::new(ColouredSampler::<CdfTable>::new(links)),
                };
                State::Drawn(draws, vec![RowNoise::default(); slots])
            }
            Method::Progressive => State::Progressive(begin()),
            Method::Hybrid => State::Hybrid(begin(), RowSampler::new(links), vec![[0.0; 4]; slots]),
        };
        let dark = vec![[0.0; 4]; slots];
        Self {
            state,
            irradiance,
            told: Told::new(slots),
            is_coloured: settings.is_coloured(),
            sent: dark.clone(),
            drawn_far: dark.clone(),
            drawn_sky: dark,
            guard_cursor: 0,
        }
    }

    /// Makes such light.
    #[must_use]
    pub fn factory() -> RowLightFactory {
        Box::new(|residents, settings, light| Ok(Box::new(Self::new(residents, settings, light))))
    }

    /// What leaves each patch if `light` arrives.
    fn prepare_sent(links: &LinkRows, direct: &[Light], light: &[Light], sent: &mut [Light]) {
        sent.par_iter_mut().with_min_len(SLOTS_A_TASK).enumerate().for_each(|(slot, sent)| {
            *sent = shooting::sent(links, slot, &direct[slot], &light[slot], &[0.0; 4]);
        });
    }

    /// What a draw of what is far, and one of the sky, bring to each row.
    fn prepare_outside(&mut self, residents: &mut Residents) {
        // A row that sees residents only has nothing from outside but rounding.
        let over = |light: Light, share: f32| if share > 0.0 { light.map(|c| c / share) } else { [0.0; 4] };
        let outside_shares = residents.links.outside_shares();
        let (outside, sky, sky_shares) = (&residents.outside, &residents.sky, &residents.sky_shares);
        let drawn = self.drawn_far.par_iter_mut().zip(&mut self.drawn_sky).with_min_len(SLOTS_A_TASK);
        drawn.enumerate().for_each(|(slot, (drawn_far, drawn_sky))| {
            let (outside, outside_share) = (outside[slot], outside_shares[slot]);
            let sky_share = sky_part(outside_share, sky_shares[slot]);
            // A sky without a share is far: the table has no item for it.
            let sky = if sky_share > 0.0 { sky[slot] } else { [0.0; 4] };
            let far = std::array::from_fn(|c| (outside[c] - sky[c]).max(0.0));
            (*drawn_far, *drawn_sky) = (over(far, outside_share - sky_share), over(sky, sky_share));
        });
    }

    fn advance_gathered(&mut self, residents: &Residents) {
        Self::prepare_sent(&residents.links, &residents.direct, &self.irradiance, &mut self.sent);
        let mut next = vec![[0.0; 4]; residents.links.capacity()];
        step_gather::bounce(&residents.links, &self.sent, &residents.outside, &mut next);
        let is_settled =
            step_gather::change(&self.irradiance, &next, residents.links.taken_count()) < GATHER_SETTLED;
        self.irradiance = next;
        self.state = State::Gather { is_settled };
    }

    fn advance_drawn(&mut self, residents: &mut Residents, frame: Frame<'_>) -> Result<(), BackendError> {
        if self.is_coloured {
            // Every bounce is in the rows: what leaves first is what comes in from outside, reflected.
            Self::prepare_sent(&residents.links, &residents.direct, &residents.outside, &mut self.sent);
        } else {
            Self::prepare_sent(&residents.links, &residents.direct, &self.irradiance, &mut self.sent);
            self.prepare_outside(residents);
        }
        let State::Drawn(draws, noise) = &mut self.state else { return Ok(()) };
        let links = &residents.links;
        let Frame { settings, number, order, matrix } = frame;
        // Borrowed for no longer than this.
        let matrix = matrix.map(|matrix| matrix as &mut dyn Backend);
        let from = TableSources { links, sky_shares: &residents.sky_shares, order, matrix };
        draws.rebuild(from, settings.rebuild_items_per_step)?;
        let scene = Scene {
            sent: &self.sent,
            far: &self.drawn_far,
            sky: &self.drawn_sky,
            outside: &residents.outside,
        };
        let (draws, spread) = (&**draws, settings.spread());
        let draw = |slot, key, samples| draws.drawn(links, scene, slot, key, samples, spread);
        temporal::step(links, settings, number, noise, &mut self.irradiance, draw);
        Ok(())
    }

    fn published(&self, slot: usize) -> Rgb {
        let light = rgb(self.irradiance[slot]);
        match &self.state {
            State::Hybrid(_, _, rest) => light + rgb(rest[slot]),
            _ => light,
        }
    }
}

impl RowLight for CpuRowLight {
    /// Light on it is what the others send.
    fn come(&mut self, residents: &Residents, slot: usize) -> Result<(), BackendError> {
        let links = &residents.links;
        let unshot = match &self.state {
            State::Progressive(unshot) | State::Hybrid(unshot, ..) => Some(&unshot.exitance),
            _ => None,
        };
        let mut arriving = [0.0; 4];
        for link in links.row(slot) {
            let other = link.slot as usize;
            let kept = unshot.map_or([0.0; 4], |unshot| unshot[other]);
            let sent = shooting::sent(links, other, &residents.direct[other], &self.irradiance[other], &kept);
            add_scaled(&mut arriving, link.share, &sent);
        }
        self.irradiance[slot] = arriving;
        let reflectance = super::light(links.reflectance(slot));
        match &mut self.state {
            State::Gather { .. } => {}
            State::Drawn(draws, noise) => {
                draws.come(links, slot);
                noise[slot] = RowNoise::default();
            }
            State::Progressive(unshot) => unshot.change(reflectance, slot, [0.0; 4], arriving),
            State::Hybrid(unshot, sampler, rest) => {
                sampler.come(links, slot);
                unshot.change(reflectance, slot, [0.0; 4], arriving);
                rest[slot] = [0.0; 4];
            }
        }
        Ok(())
    }

    fn leave(&mut self, residents: &Residents, slot: usize) -> Result<(), BackendError> {
        let links = &residents.links;
        if let State::Progressive(unshot) | State::Hybrid(unshot, ..) = &mut self.state {
            let (direct, light) = (&residents.direct[slot], &self.irradiance[slot]);
            let sent = shooting::sent(links, slot, direct, light, &unshot.exitance[slot]);
            unshot.leave(links, slot, &sent);
        }
        match &mut self.state {
            State::Drawn(draws, _) => draws.go(links, slot),
            State::Hybrid(_, sampler, rest) => {
                sampler.go(links, slot);
                rest[slot] = [0.0; 4];
            }
            State::Gather { .. } | State::Progressive(_) => {}
        }
        self.irradiance[slot] = [0.0; 4];
        self.told.forget(slot);
        Ok(())
    }

    fn change(&mut self, residents: &Residents, slot: usize, own: &Light, outside: &Light) {
        if let State::Progressive(unshot) | State::Hybrid(unshot, ..) = &mut self.state {
            add_scaled(&mut self.irradiance[slot], 1.0, outside);
            unshot.change(super::light(residents.links.reflectance(slot)), slot, *own, *outside);
        }
    }

    fn outdate(&mut self, slot: usize) {
        match &mut self.state {
            State::Drawn(draws, _) => draws.outdate(slot),
            State::Hybrid(_, sampler, _) => sampler.outdate(slot),
            State::Gather { .. } | State::Progressive(_) => {}
        }
    }

    fn advance(&mut self, residents: &mut Residents, frame: Frame<'_>) -> Result<(), BackendError> {
        let settings = *frame.settings;
        let Residents { links, direct, outside, sky_shares, .. } = &*residents;
        let shots = u64::from(settings.shot_links_per_patch) * links.taken_count() as u64;
        match &mut self.state {
            State::Gather { .. } => self.advance_gathered(residents),
            State::Drawn(..) => self.advance_drawn(residents, frame)?,
            State::Progressive(unshot) => {
                unshot.step(links, direct, outside, shots, &mut self.irradiance);
            }
            State::Hybrid(unshot, sampler, rest) => {
                let budget = settings.rebuild_items_per_step;
                let rebuilt = sampler.rebuild(links, sky_shares, frame.order, budget);
                rebuilt.map_err(BackendError::Table)?;
                let shot = unshot.step(links, direct, outside, shots, &mut self.irradiance);
                if shot.unshot_share > remainder::UNSHOT_MIN && !unshot.is_settled {
                    remainder::step(links, sampler, &unshot.exitance, &settings, frame.number, rest);
                } else if shot.unshot_share <= remainder::UNSHOT_MIN {
                    rest.fill([0.0; 4]);
                }
            }
        }
        guard::check(&residents.links, &self.irradiance, &mut self.guard_cursor)
    }

    fn is_settled(&self) -> bool {
        match &self.state {
            State::Gather { is_settled } => *is_settled,
            State::Drawn(..) => false,
            State::Progressive(unshot) | State::Hybrid(unshot, ..) => unshot.is_settled,
        }
    }

    fn read(&mut self, _: &Residents, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        for (slot, out) in slots.iter().zip(out) {
            *out = self.published(slot.0 as usize);
        }
        Ok(())
    }

    fn take_news(&mut self, residents: &Residents, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        let mut told = std::mem::take(&mut self.told);
        let taken = (0..self.irradiance.len()).filter(|&slot| residents.links.is_taken(slot));
        told.tell(taken.map(|slot| (Slot(slot as u32), self.published(slot))), news);
        self.told = told;
        Ok(())
    }
}
