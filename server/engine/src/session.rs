//! One client's view of one level: its camera, its lights, its local set, and what it was last told.
//!
//! A client's view of level 0 owns its views of the coarser levels; those feed it far light ([`crate::far`]) and are
//! published with it.

use crate::air::AirSet;
use crate::budget::Budget;
use crate::chunks::ChunkTable;
use crate::config::EngineConfig;
use crate::far;
use crate::frame::LevelLight;
use crate::levels::LevelPlan;
use crate::local_set::{LocalSet, Resident};
use crate::priority::{SwapPlan, focus, plan_swaps};
use crate::relight::{self, Relight};
use crate::stats::{Counters, SessionStats};
use crate::{Frame, FrameQuality, PatchLight, SessionId};
use earthshine_radiosity::BackendError;
use earthshine_world::{Camera, ChunkId, LightRig, Vec3};
use std::sync::Arc;

/// Columns of a session's matrix that a tick refines while a repair is under way: one block of the CPU backend.
const REPAIR_COLUMNS_A_TICK: u32 = 32;
/// Drift beyond which a repair, which squares it, would take rounds; then the matrix is solved afresh.
const REPAIRABLE_DRIFT: f32 = 0.1;

/// A chunk that the session's camera wants, as far as its plan depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct WantedChunk {
    pub(crate) id: ChunkId,
    pub(crate) has_tile: bool,
    pub(crate) patch_count: u32,
}

/// What remains of the tick for swaps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SwapBudget {
    pub(crate) adds: Budget,
    pub(crate) removals: Budget,
    /// For the direct light of the patches added.
    pub(crate) shadow_points: Budget,
}

/// One client's view.
#[derive(Debug)]
pub(crate) struct Session {
    pub(crate) id: SessionId,
    /// Which level this is a view of.
    pub(crate) level: u8,
    /// Views of the levels above, finer first; of level 0's view alone.
    pub(crate) coarse: Vec<Self>,
    /// Where distances are measured from; nothing before the first camera.
    pub(crate) focus: Option<Vec3>,
    pub(crate) rig: LightRig,
    lights_generation: u64,
    pub(crate) local: Option<LocalSet>,
    pub(crate) backend_retry_at_s: f64,
    /// Ascending by id.
    chunks: Vec<WantedChunk>,
    plan: SwapPlan,
    is_plan_old: bool,
    /// Light in empty air.
    pub(crate) air: AirSet,
    are_sources_old: bool,
    /// Whether the far columns changed after far light was gathered.
    is_far_old: bool,
    /// Whether light or row parts changed after the last frame.
    has_news: bool,
    told: Option<FrameQuality>,
    frames: u64,
    drift: f32,
    /// The last frame, for invariants.
    pub(crate) last_frame: Option<Arc<Frame>>,
}

impl Session {
    /// Without a camera; lit as the world was made. `coarser` levels have views of their own.
    pub(crate) fn new(id: SessionId, level: u8, rig: LightRig, coarser: &[LevelPlan]) -> Self {
        Self {
            id,
            level,
            coarse: coarser.iter().map(|plan| Self::new(id, plan.level, rig.clone(), &[])).collect(),
            focus: None,
            rig,
            lights_generation: 1,
            local: None,
            backend_retry_at_s: f64::NEG_INFINITY,
            chunks: Vec::new(),
            plan: SwapPlan::default(),
            is_plan_old: true,
            air: AirSet::default(),
            are_sources_old: true,
            is_far_old: true,
            has_news: false,
            told: None,
            frames: 0,
            drift: 0.0,
            last_frame: None,
        }
    }

    /// Its views of all levels, finest first.
    pub(crate) fn views(&self) -> impl Iterator<Item = &Self> {
        std::iter::once(self).chain(&self.coarse)
    }

    /// Its view of `level`.
    ///
    /// # Panics
    /// If the world has no such level.
    pub(crate) fn view_mut(&mut self, level: u8) -> &mut Self {
        match usize::from(level).checked_sub(1) {
            None => self,
            Some(at) => &mut self.coarse[at],
        }
    }

    /// Takes a valid camera. Returns whether that changes what is wanted.
    pub(crate) fn set_camera(&mut self, camera: &Camera, config: &EngineConfig) -> bool {
        for view in &mut self.coarse {
            view.set_camera(camera, config);
        }
        let focus = Some(focus(camera, config.look_ahead_s, config.load_radius_m * 0.5));
        let moved = focus != self.focus;
        self.focus = focus;
        self.is_plan_old |= moved;
        moved
    }

    /// Takes valid lights.
    pub(crate) fn set_lights(&mut self, rig: LightRig) {
        for view in &mut self.coarse {
            view.set_lights(rig.clone());
        }
        if rig.lights != self.rig.lights {
            self.lights_generation += 1;
        }
        self.are_sources_old |= rig != self.rig;
        if rig.sky != self.rig.sky {
            // Patches may not say so: where none is resident, nothing is solved.
            self.air.outdate();
        }
        self.rig = rig;
    }

    /// Takes the chunks of all levels wanted now, ascending.
    pub(crate) fn set_chunks(&mut self, mut chunks: Vec<WantedChunk>) {
        for view in self.coarse.iter_mut().rev() {
            view.set_chunks(chunks.split_off(chunks.partition_point(|chunk| chunk.id.level < view.level)));
        }
        if chunks == self.chunks {
            return;
        }
        self.chunks = chunks;
        self.is_plan_old = true;
        if let Some(local) = &mut self.local {
            local.forget_refused(|id| self.chunks.binary_search_by_key(&id, |chunk| chunk.id).is_ok());
        }
    }

    /// Compares what is resident with what is nearest, if either may have changed.
    pub(crate) fn replan(&mut self, table: &ChunkTable, config: &EngineConfig) {
        for view in &mut self.coarse {
            view.replan(table, config);
        }
        let (Some(focus), Some(local)) = (self.focus, &self.local) else { return };
        if std::mem::take(&mut self.is_plan_old) {
            let chunks: Vec<_> = self
                .chunks
                .iter()
                .filter(|wanted| wanted.has_tile)
                .map(|wanted| &**table.chunk(wanted.id).expect("a wanted chunk keeps its tile"))
                .collect();
            self.plan = plan_swaps(focus, &chunks, local, config.hysteresis);
            let ids: Vec<_> = chunks.iter().map(|chunk| chunk.id).collect();
            self.has_news |= self.air.replan(focus, &ids, table, config.receiver_voxels_max as usize);
        }
    }

    /// Whether there is something to swap.
    pub(crate) fn wants_swaps(&self) -> bool {
        self.local.is_some() && !self.plan.is_empty()
    }

    /// How direct light on the session's slots is computed now.
    pub(crate) fn relight<'a>(&'a self, table: &'a ChunkTable, tick: u64) -> Relight<'a> {
        Relight::new(table.casters(self.level), &self.rig.lights, self.lights_generation, tick)
    }

    /// Removes and adds as planned, as far as a share of `budget` (one of `waiting`) goes; new patches are lit.
    ///
    /// # Errors
    /// Whatever the backend says: it is of no more use.
    pub(crate) fn swap(
        &mut self,
        table: &mut ChunkTable,
        budget: &mut SwapBudget,
        waiting: usize,
        tick: u64,
        counters: &mut Counters,
    ) -> Result<(), BackendError> {
        let Some(mut local) = self.local.take() else { return Ok(()) };
        let shadow_points = budget.shadow_points.share(waiting);
        let removals = budget.removals.share(waiting) as usize;
        let forced = self.plan.forced.len().min(removals);
        let free = local.free_count() as usize + forced;
        let affordable =
            self.affordable_adds(table, budget.adds.share(waiting) as usize, shadow_points, tick);
        // What is displaced makes room for what comes now, never more: a slot in hand is light.
        let displaced = self.plan.displaced.len().min(removals - forced).min(affordable.saturating_sub(free));
        let adds = affordable.min(free + displaced);

        let mut leaving = take_last(&mut self.plan.forced, forced);
        leaving.extend(take_last(&mut self.plan.displaced, displaced));
        let removed = if leaving.is_empty() { Ok(()) } else { local.remove(&leaving) };
        if let Err(error) = removed {
            self.local = Some(local);
            return Err(error);
        }
        for id in &leaving {
            table.release(id.chunk);
        }
        let mut newcomers = Vec::with_capacity(adds);
        for id in take_last(&mut self.plan.adds, adds).into_iter().rev() {
            newcomers.push((id, table.tile(id.chunk).expect("a planned patch's tile is in memory").clone()));
        }
        let added = if newcomers.is_empty() { Default::default() } else { local.add(&newcomers) };
        for &slot in &added.slots {
            table.hold(local.resident(slot).id.chunk);
        }
        let (lit, spent) = self.relight(table, tick).light(&mut local, &added.slots, u32::MAX);
        local.refresh_parts();
        let refused = added.weak_pivots + added.refused;
        self.is_plan_old |= refused > 0;
        self.are_sources_old |= lit > 0;
        let has_moved = !leaving.is_empty() || !added.slots.is_empty();
        self.is_far_old |= has_moved;
        self.has_news |= has_moved;
        self.local = Some(local);

        budget.adds.spend(count(newcomers.len()));
        budget.removals.spend(count(leaving.len()));
        budget.shadow_points.spend(spent);
        counters.adds += added.slots.len() as u64;
        counters.removes += leaving.len() as u64;
        counters.weak_pivots += u64::from(added.weak_pivots);
        counters.refused_adds += u64::from(added.refused);
        counters.slots_lit += u64::from(lit);
        counters.rays += u64::from(spent);
        Ok(())
    }

    /// How many of the next adds may come: by number, and by what their direct light costs; one in any case.
    fn affordable_adds(&self, table: &ChunkTable, most: usize, shadow_points: u32, tick: u64) -> usize {
        let relight = self.relight(table, tick);
        let most = most.min(self.plan.adds.len());
        let mut spent = 0u32;
        for (adds, id) in self.plan.adds.iter().rev().take(most).enumerate() {
            let chunk = table.chunk(id.chunk).expect("a planned patch's tile is in memory");
            spent = spent.saturating_add(relight.cost(&chunk.patches[usize::from(id.local)]));
            if adds > 0 && spent > shadow_points {
                return adds;
            }
        }
        most
    }

    /// How many slots have direct light that is out of date.
    pub(crate) fn stale_count(&self, table: &ChunkTable) -> u32 {
        self.local.as_ref().map_or(0, |local| self.relight(table, 0).stale_count(local))
    }

    /// Lights stale slots again, most urgent first, for up to `most` points times lights, one slot at least.
    pub(crate) fn refresh_direct(
        &mut self,
        table: &ChunkTable,
        most: u32,
        tick: u64,
        counters: &mut Counters,
    ) -> u32 {
        let Some(mut local) = self.local.take() else { return 0 };
        let relight = self.relight(table, tick);
        let stale = relight.stale_slots(&local);
        let (lit, spent) = relight.light(&mut local, &stale, most);
        self.are_sources_old |= lit > 0;
        self.local = Some(local);
        counters.slots_lit += u64::from(lit);
        counters.rays += u64::from(spent);
        spent
    }

    /// Advances the views of all levels, coarsest first, so that far light is of this tick.
    ///
    /// # Errors
    /// Whatever a backend says: none of the session's is of more use.
    pub(crate) fn advance(
        &mut self,
        config: &EngineConfig,
        tick: u64,
        counters: &mut Counters,
    ) -> Result<(), BackendError> {
        let mut coarse = std::mem::take(&mut self.coarse);
        let mut advance = || {
            let mut is_news = false;
            for at in (0..coarse.len()).rev() {
                let (finer, coarser) = coarse.split_at_mut(at + 1);
                is_news |= finer[at].advance_view(coarser, is_news, config, tick, counters)?;
            }
            self.advance_view(&coarse, is_news, config, tick, counters)
        };
        let result = advance();
        self.coarse = coarse;
        self.has_news |= result? | self.coarse.iter_mut().fold(false, |any, view| view.take_news() | any);
        Ok(())
    }

    fn take_news(&mut self) -> bool {
        std::mem::take(&mut self.has_news)
    }

    /// Measures drift when it is due, gathers far light, hands changed sources over, steps the backend and reads the
    /// light. `is_news`: one of `coarser` has changed. Returns whether this one has.
    fn advance_view(
        &mut self,
        coarser: &[Self],
        is_news: bool,
        config: &EngineConfig,
        tick: u64,
        counters: &mut Counters,
    ) -> Result<bool, BackendError> {
        let Some(local) = &mut self.local else { return Ok(false) };
        if local.swaps_since_probe >= config.drift_probe_every_swaps {
            local.swaps_since_probe = 0;
            self.drift = local.backend.drift(config.seed.wrapping_add(tick));
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
        if std::mem::take(&mut self.is_far_old) || is_news {
            let coarser: Vec<&LocalSet> = coarser.iter().filter_map(|view| view.local.as_ref()).collect();
            let changed = far::gather(local, &coarser);
            self.are_sources_old |= changed;
            self.has_news |= changed;
        }
        if std::mem::take(&mut self.are_sources_old) {
            counters.limited_sources += relight::set_sources(local, &self.rig)?;
        }
        if relight::step(local)? {
            self.has_news = true;
            self.air.outdate();
        }
        Ok(self.has_news)
    }

    /// Gathers light in empty air that is out of date, for up to `rows_max` rows. Returns the rows spent.
    pub(crate) fn gather_air(&mut self, rows_max: u32) -> u32 {
        let Some(local) = &self.local else { return 0 };
        let spent = self.air.gather(local, &self.rig, rows_max);
        self.has_news |= spent > 0;
        spent
    }

    /// Frees every slot of every level: the session closes, or a backend of its is of no more use.
    pub(crate) fn drop_local(&mut self, table: &mut ChunkTable) {
        for view in &mut self.coarse {
            view.drop_local(table);
        }
        if let Some(local) = self.local.take() {
            for (_, resident) in local.iter() {
                table.release(resident.id.chunk);
            }
        }
        self.plan = SwapPlan::default();
        self.air.clear();
        self.is_plan_old = true;
        self.are_sources_old = true;
        self.is_far_old = true;
    }

    /// Takes a fresh backend's empty local set.
    pub(crate) fn set_local(&mut self, local: LocalSet) {
        self.local = Some(local);
        self.is_plan_old = true;
        self.are_sources_old = true;
        self.is_far_old = true;
    }

    /// How complete the light is: counts are of this level, settled are all.
    pub(crate) fn quality(&self, table: &ChunkTable) -> FrameQuality {
        let Some(local) = &self.local else { return FrameQuality::default() };
        let offered: u64 = self.chunks.iter().map(|chunk| u64::from(chunk.patch_count)).sum();
        let wanted =
            offered.saturating_sub(u64::from(local.refused_count())).min(u64::from(local.capacity()));
        let stale_direct = self.stale_count(table);
        let is_loaded = self.focus.is_some() && self.chunks.iter().all(|chunk| chunk.has_tile);
        FrameQuality {
            resident_patches: local.len(),
            wanted_patches: u32::try_from(wanted).expect("limited by the capacity"),
            stale_direct,
            settled: is_loaded
                && stale_direct == 0
                && self.air.stale_count() == 0
                && !self.is_plan_old
                && self.plan.is_empty()
                && self.coarse.iter().all(|view| view.quality(table).settled),
        }
    }

    /// The light as it is now, if that is news.
    pub(crate) fn next_frame(&mut self, table: &ChunkTable, now_s: f64) -> Option<Arc<Frame>> {
        let quality = self.quality(table);
        self.focus?;
        let local = self.local.as_mut()?;
        if !std::mem::take(&mut self.has_news) && self.told == Some(quality) {
            return None;
        }
        let voxel_edge_m = table.levels()[0].grid.voxel_edge_m;
        let patches = patch_lights(local, voxel_edge_m);
        let mut coarse = Vec::with_capacity(self.coarse.len());
        for (view, plan) in self.coarse.iter_mut().zip(&table.levels()[1..]) {
            let (level, voxel_edge_m) = (plan.level, plan.grid.voxel_edge_m);
            let local = view.local.as_mut();
            let patches = local.map(|local| patch_lights(local, voxel_edge_m)).unwrap_or_default();
            coarse.push(LevelLight { level, voxel_edge_m, patches });
        }
        self.told = Some(quality);
        self.frames += 1;
        let frame = Arc::new(Frame {
            session: self.id,
            number: self.frames,
            time_s: now_s,
            voxel_edge_m,
            patches,
            receivers: self.air.lights(),
            coarse,
            quality,
        });
        self.last_frame = Some(Arc::clone(&frame));
        Some(frame)
    }

    /// Plain numbers.
    pub(crate) fn stats(&self, table: &ChunkTable) -> SessionStats {
        let quality = self.quality(table);
        SessionStats {
            session: self.id,
            resident_patches: quality.resident_patches,
            wanted_patches: quality.wanted_patches,
            stale_direct: quality.stale_direct,
            refused_patches: self.local.as_ref().map_or(0, LocalSet::refused_count),
            settled: quality.settled,
            frames: self.frames,
            drift: self.views().map(|view| view.drift).fold(0.0, f32::max),
        }
    }
}

/// The light of every slot, in the order of frames.
fn patch_lights(local: &mut LocalSet, voxel_edge_m: f32) -> Vec<PatchLight> {
    let order = local.frame_order().to_vec();
    order.into_iter().map(|slot| patch_light(local.resident(slot), voxel_edge_m)).collect()
}

fn patch_light(resident: &Resident, voxel_edge_m: f32) -> PatchLight {
    let parts = resident.parts;
    PatchLight {
        voxel: resident.patch.voxel,
        direction: resident.patch.direction,
        irradiance: resident.light.irradiance,
        sky_irradiance: resident.light.sky_irradiance(),
        plane_offset: Some(resident.patch.plane_offset(voxel_edge_m)),
        known_share: (parts.resident + parts.sky + parts.absorbed).clamp(0.0, 1.0),
        far_share: parts.far.clamp(0.0, 1.0),
        fed_share: resident.fed_share.clamp(0.0, 1.0),
    }
}

fn take_last<T>(list: &mut Vec<T>, how_many: usize) -> Vec<T> {
    list.split_off(list.len() - how_many)
}

fn count(length: usize) -> u32 {
    u32::try_from(length).expect("budgets are u32")
}
