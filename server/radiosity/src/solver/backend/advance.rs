//! A step of each method, and what starting one takes.

use super::{GATHER_SETTLED, SolverBackend, State};
use crate::backend::{Backend, BackendError};
use crate::solver::coloured::ColouredSampler;
use crate::solver::draws::{Draws, TableSources};
use crate::solver::links::LinkRows;
use crate::solver::sampler::{RowSampler, sky_part};
use crate::solver::temporal::{RowNoise, Scene};
use crate::solver::{DrawnRows, Light, Method, SolverSettings, remainder, shooting, step_gather, temporal};
use crate::tables::{AliasTable, CdfTable};
use rayon::prelude::*;

/// Slots that a task prepares at least.
const SLOTS_A_TASK: usize = 4096;

impl SolverBackend {
    pub(super) fn enter(&mut self, settings: &SolverSettings) {
        let slots = self.links.capacity();
        // What a hybrid has estimated is part of the light that was published.
        if let State::Hybrid(_, _, rest) = &self.state {
            for (irradiance, rest) in self.irradiance.iter_mut().zip(rest) {
                crate::solver::add_scaled(irradiance, 1.0, rest);
            }
        }
        let links = &self.links;
        let mut begin = || shooting::begin(links, &self.direct, &self.outside, &mut self.irradiance);
        self.state = match settings.method {
            Method::Matrix => State::Matrix,
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
                State::Drawn(settings.method, settings.rows, draws, vec![RowNoise::default(); slots])
            }
            Method::Progressive => State::Progressive(begin()),
            Method::Hybrid => State::Hybrid(begin(), RowSampler::new(links), vec![[0.0; 4]; slots]),
        };
    }

    /// What leaves each patch if `light` arrives.
    fn prepare_sent(links: &LinkRows, direct: &[Light], light: &[Light], sent: &mut [Light]) {
        sent.par_iter_mut().with_min_len(SLOTS_A_TASK).enumerate().for_each(|(slot, sent)| {
            *sent = shooting::sent(links, slot, &direct[slot], &light[slot], &[0.0; 4]);
        });
    }

    /// What a draw of what is far, and one of the sky, bring to each row.
    fn prepare_outside(&mut self) {
        // A row that sees residents only has nothing from outside but rounding.
        let over = |light: Light, share: f32| if share > 0.0 { light.map(|c| c / share) } else { [0.0; 4] };
        let outside_shares = self.links.outside_shares();
        let (outside, sky, sky_shares) = (&self.outside, &self.sky, &self.sky_shares);
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

    pub(super) fn advance(&mut self) -> Result<(), BackendError> {
        let budget = self.settings.rebuild_items_per_step;
        let shots = u64::from(self.settings.shot_links_per_patch) * self.links.taken_count() as u64;
        match &mut self.state {
            State::Matrix => {}
            State::Gather { .. } => self.advance_gathered(),
            State::Drawn(..) => self.advance_drawn()?,
            State::Progressive(unshot) => {
                unshot.step(&self.links, &self.direct, &self.outside, shots, &mut self.irradiance);
            }
            State::Hybrid(unshot, sampler, rest) => {
                let rebuilt = sampler.rebuild(&self.links, &self.sky_shares, &self.order, budget);
                rebuilt.map_err(BackendError::Table)?;
                let shot = unshot.step(&self.links, &self.direct, &self.outside, shots, &mut self.irradiance);
                if shot.unshot_share > remainder::UNSHOT_MIN && !unshot.is_settled {
                    let (settings, frame) = (&self.settings, self.frame);
                    remainder::step(&self.links, sampler, &unshot.exitance, settings, frame, rest);
                } else if shot.unshot_share <= remainder::UNSHOT_MIN {
                    rest.fill([0.0; 4]);
                }
            }
        }
        Ok(())
    }

    fn advance_gathered(&mut self) {
        Self::prepare_sent(&self.links, &self.direct, &self.irradiance, &mut self.sent);
        let mut next = vec![[0.0; 4]; self.links.capacity()];
        step_gather::bounce(&self.links, &self.sent, &self.outside, &mut next);
        let is_settled = step_gather::change(&self.irradiance, &next) < GATHER_SETTLED;
        self.irradiance = next;
        self.state = State::Gather { is_settled };
    }

    fn advance_drawn(&mut self) -> Result<(), BackendError> {
        if self.lives_on_matrix() {
            // Every bounce is in the rows: what leaves first is what comes in from outside, reflected.
            Self::prepare_sent(&self.links, &self.direct, &self.outside, &mut self.sent);
        } else {
            Self::prepare_sent(&self.links, &self.direct, &self.irradiance, &mut self.sent);
            self.prepare_outside();
        }
        let State::Drawn(_, _, draws, noise) = &mut self.state else { return Ok(()) };
        let links = &self.links;
        let from = TableSources {
            links,
            sky_shares: &self.sky_shares,
            order: &self.order,
            matrix: self.matrix.as_deref_mut().map(|matrix| matrix as &mut dyn Backend),
        };
        draws.rebuild(from, self.settings.rebuild_items_per_step)?;
        let scene =
            Scene { sent: &self.sent, far: &self.drawn_far, sky: &self.drawn_sky, outside: &self.outside };
        let (draws, spread) = (&**draws, self.settings.spread());
        let draw = |slot, key, samples| draws.drawn(links, scene, slot, key, samples, spread);
        temporal::step(links, &self.settings, self.frame, noise, &mut self.irradiance, draw);
        Ok(())
    }
}
