//! Progressive shooting on the device: a frame of rounds, and some rows gathered afresh.

use super::GpuRowLight;
use super::buffers::Buffers;
use super::passes::groups;
use crate::recorder::Recorder;
use earthshine_radiosity::BackendError;
use earthshine_radiosity::solver::SolverSettings;
use earthshine_radiosity::solver::links::LinkRows;
use earthshine_radiosity::solver::shooting::{REFRESH_SHARE, REFRESH_TOLERANCE, ROUNDS};
use earthshine_shaders::host::Pass;
use earthshine_shaders::kernel::{
    CHOOSE_CLASS, COUNT_LAST, FOLD_FLUX, SCAN_GROUPS, SHOOT_LINKS, TAKE_SHOOTERS,
};
use earthshine_shaders::limits::{LANES, SHOT_SHOOTERS};

/// Workgroups that share the list of shooters.
const SHOOTING_GROUPS: u32 = 2048;

impl GpuRowLight {
    /// Shoots for a frame.
    pub(super) fn shoot(&mut self, links: &LinkRows, settings: &SolverSettings) -> Result<(), BackendError> {
        let taken_count = links.taken_count() as u32;
        let budget = u64::from(settings.shot_links_per_patch) * u64::from(taken_count);
        let a_round = (budget / u64::from(ROUNDS)).clamp(1, u64::from(u32::MAX)) as u32;
        let fresh = self.rows_to_refresh(links, budget / REFRESH_SHARE);
        self.buffers.some_slots.fill(&self.device, &fresh)?;
        let at = 4 * u64::from(SHOT_SHOOTERS);
        self.device.queue().write_buffer(&self.buffers.shot_words, at, &[0; 4]);
        let pass = Pass { budget_links: a_round, taken_count, ..self.pass() };
        let (mut recorder, buffers) = self.recorder();
        for _ in 0..ROUNDS {
            recorder.fold_flux(buffers, pass);
            recorder.shoot_round(buffers, pass);
        }
        recorder.fold_flux(buffers, pass);
        recorder.clear(&buffers.classes);
        recorder.send_light(buffers, pass);
        let some = Pass { entry_count: fresh.len() as u32, ..pass };
        recorder.over(fresh.iter().map(|&slot| links.row(slot as usize).len() as u64).sum());
        recorder.gather_rows(buffers, &buffers.some_slots.buffer, &buffers.outside, some);
        recorder.take_gathered(buffers, &buffers.some_slots.buffer, REFRESH_TOLERANCE, some);
        recorder.measure_light(buffers, pass);
        recorder.submit().map(|_| ())
    }

    /// The next taken slots whose links fit `budget`, at least one.
    fn rows_to_refresh(&mut self, links: &LinkRows, mut budget: u64) -> Vec<u32> {
        let mut slots = Vec::new();
        for _ in 0..links.capacity() {
            let slot = self.refresh_cursor;
            self.refresh_cursor = (slot + 1) % links.capacity();
            if links.is_taken(slot) {
                slots.push(slot as u32);
                budget = budget.saturating_sub(links.row(slot).len().max(1) as u64);
                if budget == 0 {
                    break;
                }
            }
        }
        slots
    }
}

impl Recorder<'_> {
    fn fold_flux(&mut self, buffers: &Buffers, pass: Pass) {
        let bound = [
            &buffers.residents,
            &buffers.rows,
            &buffers.shot_words,
            &buffers.arrived,
            &buffers.arriving,
            &buffers.irradiance,
            &buffers.unshot,
            &buffers.classes,
        ];
        self.dispatch(&FOLD_FLUX, &bound, pass, groups(pass));
    }

    fn shoot_round(&mut self, buffers: &Buffers, pass: Pass) {
        self.dispatch(&CHOOSE_CLASS, &[&buffers.classes, &buffers.shot_words], pass, [1, 1, 1]);
        let [residents, rows] = [&buffers.residents, &buffers.rows];
        let bound = [residents, rows, &buffers.unshot, &buffers.shot_words, &buffers.group_counts];
        self.dispatch(&COUNT_LAST, &bound, pass, groups(pass));
        let counts = Pass { entry_count: pass.entry_count.div_ceil(LANES), ..pass };
        self.dispatch(&SCAN_GROUPS, &[&buffers.group_counts], counts, [1, 1, 1]);
        let bound = [
            residents,
            rows,
            &buffers.unshot,
            &buffers.shot_words,
            &buffers.group_counts,
            &buffers.shooters,
            &buffers.shot,
        ];
        self.dispatch(&TAKE_SHOOTERS, &bound, pass, groups(pass));
        let bound = [
            residents,
            rows,
            &buffers.links.buffer,
            &buffers.shooters,
            &buffers.shot,
            &buffers.shot_words,
            &buffers.arrived,
        ];
        let sharing = pass.entry_count.clamp(1, SHOOTING_GROUPS);
        self.dispatch(&SHOOT_LINKS, &bound, Pass { entry_count: sharing, ..pass }, [sharing, 1, 1]);
    }
}
