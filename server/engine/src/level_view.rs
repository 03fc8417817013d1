//! One session's view of one level: its local set, what it should hold, and what it last said.
//!
//! A coarser view feeds the finer ones far light ([`crate::far`]) and is published beside them. Who comes and who goes is
//! [`crate::swaps`]' business; cameras, lights and light in the air are the [`Session`](crate::session::Session)'s.

use crate::chunks::ChunkTable;
use crate::config::EngineConfig;
use crate::far;
use crate::far_device::{FarAsked, FarDevice, FarTaken};
use crate::far_follow::follow;
use crate::local_set::{LocalSet, Resident};
use crate::priority::{Candidate, Outlook, Staying, SwapPlan, plan_swaps};
use crate::relight::{self, Relight};
use crate::stats::Counters;
use crate::{FrameQuality, PatchLight, SessionId};
use earthshine_radiosity::BackendError;
use earthshine_world::{Barrier, Chunk, ChunkId, LightRig, Vec3};
use std::sync::Arc;

/// Columns of a matrix that a tick refines while a repair is under way: one block of the CPU backend.
const REPAIR_COLUMNS_A_TICK: u32 = 32;
/// Drift beyond which a repair, which squares it, would take rounds; then the matrix is solved afresh.
const REPAIRABLE_DRIFT: f32 = 0.1;

/// Every so many ticks a coarse view's light is advanced where nothing is urgent: light from afar may be that old.
const COARSE_TURN_TICKS: u64 = 4;
/// Changes of the slots aimed at wait until they are this part of them.
const TARGET_STEP: u32 = 8;

/// A chunk that the session's camera wants, as far as its plan depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct WantedChunk {
    pub(crate) id: ChunkId,
    pub(crate) has_tile: bool,
    pub(crate) patch_count: u32,
}

/// The lights of a session, and how often they have changed.
#[derive(Debug, Clone)]
pub(crate) struct Lighting {
    pub(crate) rig: LightRig,
    pub(crate) generation: u64,
}

/// What one level is to one session.
#[derive(Debug)]
pub(crate) struct LevelView {
    pub(crate) session: SessionId,
    pub(crate) level: u8,
    pub(crate) local: Option<LocalSet>,
    /// Who gathers its far light beside the CPU.
    pub(crate) far_device: FarDevice,
    /// Ascending by id.
    chunks: Vec<WantedChunk>,
    pub(crate) plan: SwapPlan,
    /// Slots that the camera can be kept supplied with at its speed.
    pub(crate) target: u32,
    /// Where the plan measured distances from.
    pub(crate) focus: Vec3,
    pub(crate) is_plan_old: bool,
    pub(crate) are_sources_old: bool,
    /// Whether the far columns changed after far light was gathered.
    pub(crate) is_far_old: bool,
    /// Whether its light is not to wait for its turn: patches have come or gone, or lights have changed.
    pub(crate) is_urgent: bool,
    /// Whether what leaves its patches changed, or whose it is, after the finer views gathered.
    pub(crate) sends_news: bool,
    /// Whether light or row parts may differ from `published`.
    pub(crate) has_news: bool,
    /// Swaps that it has had, each counted by how small its part of the budget is: the next turn is whose number is lowest.
    pub(crate) had: u64,
    /// Generation of the shadow casters that direct light was held against.
    casters_seen: u64,
    /// The light of every slot as it was last told.
    published: Arc<[PatchLight]>,
    /// Room for what is to be told.
    telling: Vec<PatchLight>,
    pub(crate) drift: f32,
    /// What the last audit found; 0 before the first.
    pub(crate) audit_error: f32,
}

impl LevelView {
    pub(crate) fn new(session: SessionId, level: u8) -> Self {
        Self {
            session,
            level,
            local: None,
            far_device: FarDevice::default(),
            chunks: Vec::new(),
            plan: SwapPlan::default(),
            target: u32::MAX,
            focus: Vec3::ZERO,
            is_plan_old: true,
            are_sources_old: true,
            is_far_old: true,
            is_urgent: true,
            sends_news: true,
            has_news: true,
            had: 0,
            casters_seen: 0,
            published: Arc::default(),
            telling: Vec::new(),
            drift: 0.0,
            audit_error: 0.0,
        }
    }

    /// The camera has moved.
    pub(crate) fn outdate_plan(&mut self) {
        self.is_plan_old = true;
    }

    /// Sky, emission or lights have changed.
    pub(crate) fn outdate_sources(&mut self) {
        self.are_sources_old = true;
        self.is_urgent = true;
        self.has_news = true;
    }

    /// Takes the chunks of its level wanted now, ascending.
    pub(crate) fn set_chunks(&mut self, chunks: Vec<WantedChunk>) {
        if chunks == self.chunks {
            return;
        }
        self.chunks = chunks;
        self.is_plan_old = true;
        if let Some(local) = &mut self.local {
            local.forget_refused(|id| self.chunks.binary_search_by_key(&id, |chunk| chunk.id).is_ok());
        }
    }

    /// Wanted chunks in memory, ascending.
    pub(crate) fn loaded<'a>(&self, table: &'a ChunkTable) -> Vec<&'a Arc<Chunk>> {
        let has_tile = self.chunks.iter().filter(|wanted| wanted.has_tile);
        has_tile.map(|wanted| table.chunk(wanted.id).expect("a wanted chunk keeps its tile")).collect()
    }

    /// Compares what is resident with what is nearest, if either may have changed. Returns whether it did.
    pub(crate) fn replan(
        &mut self,
        outlook: &Outlook,
        table: &ChunkTable,
        config: &EngineConfig,
        room: &mut Vec<Candidate>,
    ) -> bool {
        let Some(local) = &self.local else { return false };
        let is_due = std::mem::take(&mut self.is_plan_old);
        if is_due {
            self.focus = outlook.focus;
            let stay = Staying { hysteresis: config.hysteresis, slots: self.target };
            self.plan = plan_swaps(outlook, &self.loaded(table), local, stay, room);
        }
        is_due
    }

    /// Takes how many slots a plan may fill, as many as there are for nothing. Small changes wait: a speed that wavers swaps nothing.
    pub(crate) fn aim_at(&mut self, slots: Option<u32>) {
        let capacity = self.local.as_ref().map_or(u32::MAX, LocalSet::capacity);
        let slots = slots.unwrap_or(u32::MAX).min(capacity);
        let is_small = slots.abs_diff(self.target) < self.target.min(capacity) / TARGET_STEP;
        if slots != self.target && (!is_small || slots == capacity) {
            self.target = slots;
            self.is_plan_old = true;
        }
    }

    /// Whether there is something to swap.
    pub(crate) fn wants_swaps(&self) -> bool {
        self.local.is_some() && !self.plan.is_empty()
    }

    /// How direct light on its slots is computed now.
    pub(crate) fn relight<'a>(
        &self,
        table: &'a ChunkTable,
        lighting: &'a Lighting,
        tick: u64,
    ) -> Relight<'a> {
        let edge_m = table.levels()[usize::from(self.level)].grid.voxel_edge_m;
        let has_detail = self.level == 0 && table.detail() > 1;
        let (casters, lights) = (table.casters(self.level), &lighting.rig.lights);
        Relight::new(casters, lights, lighting.generation, tick, edge_m, has_detail)
    }

    /// Finds the slots whose direct light may have changed because shadow casters came or went.
    pub(crate) fn note_casters(&mut self, table: &ChunkTable, lighting: &Lighting) {
        let seen = table.casters(self.level).generation();
        if std::mem::replace(&mut self.casters_seen, seen) != seen
            && let Some(mut local) = self.local.take()
        {
            self.relight(table, lighting, 0).note_casters(&mut local);
            self.local = Some(local);
        }
    }

    /// Takes the direct light that has come from elsewhere.
    pub(crate) fn take_direct(
        &mut self,
        table: &ChunkTable,
        lighting: &Lighting,
        tick: u64,
        counters: &mut Counters,
    ) {
        if self.local.as_ref().is_none_or(|local| local.asked.len() == 0) {
            return;
        }
        let Some(mut local) = self.local.take() else { return };
        let arrived = self.relight(table, lighting, tick).take_asked(&mut local);
        self.local = Some(local);
        counters.slots_lit += u64::from(arrived.slots);
        self.are_sources_old |= arrived.slots > 0;
        self.is_urgent |= arrived.is_other_light;
        // What is still on its way grows older.
        self.has_news = true;
    }

    /// Whether any slot's direct light is out of date and not on its way.
    pub(crate) fn has_unasked(&self, table: &ChunkTable, lighting: &Lighting) -> bool {
        self.local.as_ref().is_some_and(|local| self.relight(table, lighting, 0).has_unasked(local))
    }

    /// How many slots have direct light that is out of date.
    pub(crate) fn stale_count(&self, table: &ChunkTable, lighting: &Lighting) -> u32 {
        self.local.as_ref().map_or(0, |local| self.relight(table, lighting, 0).stale_count(local))
    }

    /// Lights slots again that are out of date, most urgent first, for up to `most` points times lights, one slot at least.
    pub(crate) fn refresh_direct(
        &mut self,
        table: &ChunkTable,
        lighting: &Lighting,
        most: u32,
        tick: u64,
        counters: &mut Counters,
    ) -> u32 {
        let Some(mut local) = self.local.take() else { return 0 };
        let relight = self.relight(table, lighting, tick);
        let unasked = relight.unasked_slots(&local);
        let (lit, spent) = relight.light(&mut local, &unasked, most);
        self.are_sources_old |= lit > 0;
        self.has_news |= !unasked.is_empty();
        self.local = Some(local);
        counters.slots_lit += u64::from(lit);
        counters.rays += u64::from(spent);
        spent
    }

    /// Whether its light is advanced in this tick. Level 0's always is; coarser ones, which others but see from afar, take turns
    /// unless there is something that must not wait.
    fn is_due(&self, tick: u64) -> bool {
        let goes_on = || self.local.as_ref().is_some_and(|local| !local.backend.is_settled());
        self.level == 0
            || self.is_urgent
            || self.far_device.is_under_way()
            || tick.wrapping_add(u64::from(self.level)).is_multiple_of(COARSE_TURN_TICKS)
            || goes_on()
    }

    /// Tends the matrix, gathers far light from `coarser` views (finest first; advanced before), hands changed sources
    /// over, steps the backend and takes its news, if it is due. Returns whether the light changed in this tick, or whose it is.
    ///
    /// # Errors
    /// Whatever a backend says: it is of no more use.
    pub(crate) fn advance(
        &mut self,
        coarser: &[Self],
        rig: &LightRig,
        config: &EngineConfig,
        tick: u64,
        counters: &mut Counters,
    ) -> Result<bool, BackendError> {
        if self.local.is_none() || !self.is_due(tick) {
            return Ok(false);
        }
        self.is_urgent = false;
        self.tend_matrix(config, tick, counters)?;
        let far_changed = self.gather_far(coarser);
        self.are_sources_old |= far_changed;
        self.has_news |= far_changed;
        let Some(local) = &mut self.local else { return Ok(false) };
        self.are_sources_old |=
            relight::stand_in(local, coarser.first().and_then(|view| view.local.as_ref()));
        if std::mem::take(&mut self.are_sources_old) {
            let set = relight::set_sources(local, rig)?;
            counters.limited_sources += set.limited;
            self.sends_news |= set.changed;
            self.has_news |= set.changed;
        }
        let is_new = relight::step(local)?;
        let is_audited = config.solver.audit_every_ticks > 0
            && tick.is_multiple_of(u64::from(config.solver.audit_every_ticks));
        if (is_audited || local.backend.is_audit_coming())
            && let Some(error) = local.backend.audit()?
        {
            self.audit_error = error;
            counters.audits += 1;
        }
        self.sends_news |= is_new;
        self.has_news |= is_new;
        Ok(self.sends_news)
    }

    /// Takes far light that has come, and gathers it where it is old, or has it gathered. Returns whether any is another.
    fn gather_far(&mut self, coarser: &[Self]) -> bool {
        let Some(local) = &mut self.local else { return false };
        let taken = self.far_device.take(local);
        let mut changed = taken == FarTaken::Light(true);
        self.is_far_old |= taken == FarTaken::Lost;
        if self.is_far_old {
            let coarser: Vec<_> = coarser.iter().map(|view| view.local.as_ref()).collect();
            if self.far_device.is_there() {
                changed |= follow(local, &coarser);
            }
            let asked = self.far_device.ask(local, &coarser);
            self.is_far_old = asked == FarAsked::Busy;
            if asked == FarAsked::Refused {
                changed |= far::gather(local, &coarser);
            }
        }
        changed
    }

    /// Tells the backend how light is to be solved. One that refuses goes on as before, and is counted.
    pub(crate) fn choose_solver(&mut self, config: &EngineConfig, counters: &mut Counters) {
        let Some(local) = &mut self.local else { return };
        let settings = config.solver_settings(self.level);
        let chosen = local.backend.set_solver(&settings).and_then(|has_choice| {
            local.is_endless = has_choice && settings.method.is_endless();
            local.has_tables = has_choice && settings.method.draws();
            local.backend.set_audited(config.solver.audit_every_ticks > 0)
        });
        local.needs_step = true;
        if let Err(error) = chosen {
            counters.solvers_refused += 1;
            tracing::warn!(session = self.session.0, level = self.level, %error, "a solver was refused");
        }
    }

    /// The finer views have gathered.
    pub(crate) fn forget_sent_news(&mut self) {
        self.sends_news = false;
    }

    /// Keeps the backend's matrix true: a probe when it is due, a repair a few columns a tick, a fresh solve. A probe may be
    /// told in a later tick, and a backend that is behind is given no more to do.
    fn tend_matrix(
        &mut self,
        config: &EngineConfig,
        tick: u64,
        counters: &mut Counters,
    ) -> Result<(), BackendError> {
        let Some(local) = &mut self.local else { return Ok(()) };
        if local.backend.is_behind() {
            return Ok(());
        }
        if local.swaps_since_probe >= config.drift_probe_every_swaps
            && !local.is_probing
            && !local.is_repairing
        {
            local.swaps_since_probe = 0;
            local.is_probing = true;
        }
        let told =
            if local.is_probing { local.backend.poll_drift(config.seed.wrapping_add(tick))? } else { None };
        if let Some(drift) = told {
            self.drift = drift;
            local.is_probing = false;
            counters.drift_probes += 1;
            if self.drift.is_nan() || self.drift > config.drift_max {
                counters.resolves += 1;
                local.is_repairing = self.drift <= REPAIRABLE_DRIFT;
                if !local.is_repairing {
                    match local.backend.resolve() {
                        // The matrix is what it was; the next probe asks again.
                        Err(error @ BackendError::OutOfMemory { .. }) => {
                            tracing::warn!(drift = self.drift, %error, "drift stays");
                        }
                        other => other?,
                    }
                    local.needs_step = true;
                }
            }
        }
        if local.is_repairing {
            local.is_repairing = !local.backend.repair(REPAIR_COLUMNS_A_TICK)?.is_complete;
            local.needs_step = true;
        }
        Ok(())
    }

    /// Frees every slot: the session closes, or its backend is of no more use.
    pub(crate) fn drop_local(&mut self, table: &mut ChunkTable) {
        if let Some(local) = self.local.take() {
            for (_, resident) in local.iter() {
                table.release(resident.id.chunk);
            }
        }
        self.plan = SwapPlan::default();
        self.far_device.forget();
        self.outdate();
    }

    /// Takes a fresh backend's empty local set.
    pub(crate) fn set_local(&mut self, local: LocalSet) {
        self.local = Some(local);
        self.outdate();
    }

    fn outdate(&mut self) {
        self.is_plan_old = true;
        self.are_sources_old = true;
        self.is_far_old = true;
        self.is_urgent = true;
        self.sends_news = true;
        self.has_news = true;
    }

    /// Whether some of its light waits for its turn.
    fn has_work(&self) -> bool {
        let needs_step = self.local.as_ref().is_some_and(|local| local.needs_step || local.is_probing);
        self.are_sources_old || self.is_far_old || self.far_device.is_under_way() || needs_step
    }

    /// How complete its light is; settled of itself.
    pub(crate) fn quality(&self, table: &ChunkTable, lighting: &Lighting) -> FrameQuality {
        let Some(local) = &self.local else { return FrameQuality::default() };
        let offered: u64 = self.chunks.iter().map(|chunk| u64::from(chunk.patch_count)).sum();
        let wanted = offered
            .saturating_sub(u64::from(local.refused_count()))
            .min(u64::from(local.capacity().min(self.target)));
        let stale_direct = self.stale_count(table, lighting);
        let is_loaded = self.chunks.iter().all(|chunk| chunk.has_tile);
        FrameQuality {
            resident_patches: local.len(),
            wanted_patches: u32::try_from(wanted).expect("limited by the capacity"),
            stale_direct,
            missing_near: 0,
            settled: is_loaded
                && stale_direct == 0
                && !self.is_plan_old
                && !self.has_work()
                && self.plan.is_empty()
                && local.is_at_rest(),
        }
    }

    /// The light of every slot, in the order of frames, and whether it differs from what was told before: what has
    /// not changed is the same allocation.
    pub(crate) fn publish(
        &mut self,
        table: &ChunkTable,
        lighting: &Lighting,
        tick: u64,
    ) -> (Arc<[PatchLight]>, bool) {
        let mut is_new = false;
        let relight = self.relight(table, lighting, tick);
        let voxel_edge_m = table.levels()[usize::from(self.level)].grid.voxel_edge_m;
        if std::mem::take(&mut self.has_news) {
            self.telling.clear();
            if let Some(local) = &mut self.local {
                local.sort_for_frames();
                let lights = local.in_frame_order();
                self.telling
                    .extend(lights.filter_map(|resident| patch_light(resident, voxel_edge_m, &relight)));
            }
            is_new = self.telling[..] != self.published[..];
            if is_new {
                self.published = Arc::from(&self.telling[..]);
            }
        }
        (Arc::clone(&self.published), is_new)
    }
}

/// Nothing of a patch that the backend has said nothing of yet: a client takes the coarser level's light meanwhile.
fn patch_light(resident: &Resident, voxel_edge_m: f32, relight: &Relight<'_>) -> Option<PatchLight> {
    Some(PatchLight {
        voxel: resident.patch.voxel,
        direction: resident.patch.direction,
        irradiance: resident.light.irradiance?,
        sky_irradiance: resident.light.sky_irradiance(),
        plane_offset: Some(resident.patch.plane_offset(voxel_edge_m)),
        layer: 0,
        tilt: None,
        barriers: [None; Barrier::PER_LAYER_MAX],
        known_share: resident.parts().known(),
        far_share: resident.parts().far.clamp(0.0, 1.0),
        fed_share: resident.fed_share.clamp(0.0, 1.0),
        staleness: relight.staleness(&resident.light),
    })
}
