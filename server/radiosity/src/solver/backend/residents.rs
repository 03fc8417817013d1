//! Who comes and goes: rows, light and what each method keeps of a patch.

use super::{SolverBackend, State};
use crate::backend::Update;
use crate::solver::draws::Draws as _;
use crate::solver::shooting;
use crate::solver::temporal::RowNoise;

impl SolverBackend {
    pub(super) fn apply_to_links(&mut self, updates: &[Update]) {
        for update in updates {
            match update {
                Update::Add { slot, reflectance, area, row, column: _ } => {
                    let at = slot.0 as usize;
                    let entries = row.iter().map(|&(other, share)| (other.0 as usize, share));
                    self.links.add(at, *area, *reflectance, entries);
                    self.welcome(at);
                }
                Update::Remove { slot } if self.links.is_taken(slot.0 as usize) => {
                    self.dismiss(slot.0 as usize);
                }
                Update::Remove { .. } => {}
            }
        }
        self.changed |= !updates.is_empty();
    }

    /// Everybody leaves. Methods that keep more than light let each go by itself.
    pub(super) fn clear_links(&mut self) {
        if matches!(self.state, State::Matrix | State::Gather { .. }) {
            self.links.clear();
            for light in [&mut self.direct, &mut self.outside, &mut self.irradiance] {
                light.fill([0.0; 4]);
            }
        } else {
            let taken = (0..self.links.capacity()).filter(|&slot| self.links.is_taken(slot));
            let leaving: Vec<usize> = taken.collect();
            leaving.into_iter().for_each(|slot| self.dismiss(slot));
        }
        self.changed = true;
    }

    /// Light on a patch that has just entered: what the others send.
    pub(super) fn welcome(&mut self, slot: usize) {
        let unshot = match &self.state {
            State::Progressive(unshot) | State::Hybrid(unshot, ..) => Some(&unshot.exitance),
            _ => None,
        };
        let mut arriving = [0.0; 4];
        for link in self.links.row(slot) {
            let other = link.slot as usize;
            let kept = unshot.map_or([0.0; 4], |unshot| unshot[other]);
            let sent =
                shooting::sent(&self.links, other, &self.direct[other], &self.irradiance[other], &kept);
            crate::solver::add_scaled(&mut arriving, link.share, &sent);
        }
        self.irradiance[slot] = arriving;
        let reflectance = crate::solver::light(self.links.reflectance(slot));
        match &mut self.state {
            State::Drawn(_, _, draws, noise) => {
                draws.come(&self.links, slot);
                noise[slot] = RowNoise::default();
            }
            State::Progressive(unshot) => unshot.change(reflectance, slot, [0.0; 4], arriving),
            State::Hybrid(unshot, sampler, rest) => {
                sampler.come(&self.links, slot);
                unshot.change(reflectance, slot, [0.0; 4], arriving);
                rest[slot] = [0.0; 4];
            }
            State::Matrix | State::Gather { .. } => {}
        }
    }

    pub(super) fn dismiss(&mut self, slot: usize) {
        if let State::Progressive(unshot) | State::Hybrid(unshot, ..) = &mut self.state {
            let (direct, light) = (&self.direct[slot], &self.irradiance[slot]);
            let sent = shooting::sent(&self.links, slot, direct, light, &unshot.exitance[slot]);
            unshot.leave(&self.links, slot, &sent);
        }
        let gone = self.links.remove(slot);
        match &mut self.state {
            State::Drawn(_, _, draws, _) => draws.go(&self.links, slot, &gone),
            State::Hybrid(_, sampler, rest) => {
                sampler.go(&self.links, slot, &gone);
                rest[slot] = [0.0; 4];
            }
            _ => {}
        }
        self.sky_shares[slot] = 0.0;
        for light in [&mut self.direct, &mut self.outside, &mut self.sky, &mut self.irradiance] {
            light[slot] = [0.0; 4];
        }
    }
}
