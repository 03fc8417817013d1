//! A step of each method, and what starting one takes.

use super::{GATHER_SETTLED, SolverBackend, State};
use crate::backend::BackendError;
use crate::solver::sampler::RowSampler;
use crate::solver::temporal::{RowNoise, Scene};
use crate::solver::{Method, remainder, shooting, step_gather, temporal};

impl SolverBackend {
    pub(super) fn enter(&mut self, method: Method) {
        let slots = self.links.capacity();
        let noise = || vec![RowNoise::default(); slots];
        // What a hybrid has estimated is part of the light that was published.
        if let State::Hybrid(_, _, rest) = &self.state {
            for (irradiance, rest) in self.irradiance.iter_mut().zip(rest) {
                crate::solver::add_scaled(irradiance, 1.0, rest);
            }
        }
        let mut begin = || shooting::begin(&self.links, &self.direct, &self.outside, &mut self.irradiance);
        self.state = match method {
            Method::Matrix => State::Matrix,
            Method::Gather => State::Gather { is_settled: false },
            Method::Alias => State::Alias(RowSampler::new(&self.links), noise()),
            Method::Cdf => State::Cdf(RowSampler::new(&self.links), noise()),
            Method::Progressive => State::Progressive(begin()),
            Method::Hybrid => State::Hybrid(begin(), RowSampler::new(&self.links), vec![[0.0; 4]; slots]),
        };
    }

    /// What leaves each patch, and what a draw of the outside brings it.
    pub(super) fn prepare_draws(&mut self, shares: &mut Vec<f32>) {
        for slot in 0..self.links.capacity() {
            let (direct, light) = (&self.direct[slot], &self.irradiance[slot]);
            self.sent[slot] = shooting::sent(&self.links, slot, direct, light, &[0.0; 4]);
            let outside = self.outside[slot];
            self.drawn_outside[slot] = if outside == [0.0; 4] {
                outside
            } else {
                let share = self.links.outside_share(slot, shares);
                // A row that sees residents only has nothing from outside but rounding.
                outside.map(|light| if share > 0.0 { light / share } else { 0.0 })
            };
        }
    }

    pub(super) fn advance(&mut self) -> Result<(), BackendError> {
        let settings = self.settings;
        let budget = settings.rebuild_items_per_step;
        let shots = u64::from(settings.shot_links_per_patch) * self.links.taken_count() as u64;
        if matches!(self.state, State::Alias(..) | State::Cdf(..) | State::Gather { .. }) {
            self.prepare_draws(&mut Vec::new());
        }
        let scene = Scene { sent: &self.sent, outside: &self.drawn_outside };
        match &mut self.state {
            State::Matrix => {}
            State::Gather { is_settled } => {
                let mut next = vec![[0.0; 4]; self.links.capacity()];
                step_gather::bounce(&self.links, &self.sent, &self.outside, &mut next);
                *is_settled = step_gather::change(&self.irradiance, &next) < GATHER_SETTLED;
                self.irradiance = next;
            }
            State::Alias(sampler, noise) => {
                sampler.rebuild(&self.links, budget).map_err(BackendError::Table)?;
                temporal::step(
                    &self.links,
                    sampler,
                    scene,
                    &settings,
                    self.frame,
                    noise,
                    &mut self.irradiance,
                );
            }
            State::Cdf(sampler, noise) => {
                sampler.rebuild(&self.links, budget).map_err(BackendError::Table)?;
                temporal::step(
                    &self.links,
                    sampler,
                    scene,
                    &settings,
                    self.frame,
                    noise,
                    &mut self.irradiance,
                );
            }
            State::Progressive(unshot) => {
                self.last_shot =
                    unshot.step(&self.links, &self.direct, &self.outside, shots, &mut self.irradiance);
            }
            State::Hybrid(unshot, sampler, rest) => {
                sampler.rebuild(&self.links, budget).map_err(BackendError::Table)?;
                self.last_shot =
                    unshot.step(&self.links, &self.direct, &self.outside, shots, &mut self.irradiance);
                if self.last_shot.unshot_share > remainder::UNSHOT_MIN && !unshot.is_settled {
                    remainder::step(&self.links, sampler, &unshot.exitance, &settings, self.frame, rest);
                } else if self.last_shot.unshot_share <= remainder::UNSHOT_MIN {
                    rest.fill([0.0; 4]);
                }
            }
        }
        Ok(())
    }
}
