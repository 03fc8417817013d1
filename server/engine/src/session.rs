//! One client: its camera, its lights, its views of all levels, light in the air, and what it was last told.
//!
//! What happens on one level is the [`LevelView`]'s business.

use crate::air::{AirSet, RowsSpent};
use crate::chunks::ChunkTable;
use crate::config::EngineConfig;
use crate::far::{FarSenders, SentRoom, exitances_of};
use crate::far_device::FarDevice;
use crate::frame::LevelLight;
use crate::level_view::{LevelView, Lighting, WantedChunk};
use crate::levels::LevelPlan;
use crate::local_set::LocalSet;
use crate::priority::{Candidate, Outlook};
use crate::promise::Promise;
use crate::stats::{Counters, SessionStats};
use crate::{Frame, FrameQuality, PatchLight, ReceiverLightFactory, SessionId};
use earthshine_radiosity::BackendError;
use earthshine_world::{Camera, LightRig, Vec3};
use std::sync::Arc;

/// Cameras come late and in bunches: a way of so many times what velocity and radius explain is no jump yet.
const JUMP_SLACK: f32 = 2.0;

/// One client's light.
#[derive(Debug)]
pub(crate) struct Session {
    pub(crate) id: SessionId,
    /// One a level, finest first, at least one.
    pub(crate) views: Vec<LevelView>,
    /// What it sees; nothing before the first camera.
    pub(crate) outlook: Option<Outlook>,
    pub(crate) motion: Motion,
    /// Patches of level 0 within the promised radius that it has no light for.
    pub(crate) missing_near: u32,
    /// Ticks that broke the promise.
    pub(crate) violations: u64,
    pub(crate) lighting: Lighting,
    pub(crate) backend_retry_at_s: f64,
    /// Light in empty air.
    pub(crate) air: AirSet,
    /// Light in the air as it was last told.
    receivers: Arc<[PatchLight]>,
    quality: FrameQuality,
    /// Detail as it was last told.
    details: Arc<[PatchLight]>,
    told: Option<FrameQuality>,
    frames: u64,
    /// The last frame, for invariants.
    pub(crate) last_frame: Option<Arc<Frame>>,
    /// Room for what parents send to light in the air.
    sent: SentRoom,
    /// Room for plans.
    candidates: Vec<Candidate>,
}

impl Session {
    /// Without a camera; lit as the world was made.
    pub(crate) fn new(id: SessionId, rig: LightRig, levels: &[LevelPlan]) -> Self {
        Self {
            id,
            views: levels.iter().map(|plan| LevelView::new(id, plan.level)).collect(),
            outlook: None,
            motion: Motion::default(),
            missing_near: 0,
            violations: 0,
            lighting: Lighting { rig, generation: 1 },
            backend_retry_at_s: f64::NEG_INFINITY,
            air: AirSet::default(),
            receivers: Arc::default(),
            quality: FrameQuality::default(),
            details: Arc::default(),
            told: None,
            frames: 0,
            last_frame: None,
            sent: SentRoom::default(),
            candidates: Vec::new(),
        }
    }

    /// Has rows gathered by what `make` gives: those of receivers, and of patches of every level but the top one.
    pub(crate) fn gather_by(&mut self, make: &mut ReceiverLightFactory) {
        self.air.gather_by(make());
        let fed = self.views.len().saturating_sub(1);
        self.views[..fed].iter_mut().for_each(|view| view.far_device = FarDevice::new(make()));
    }

    /// Takes a valid camera. Returns whether that changes what is wanted.
    pub(crate) fn set_camera(
        &mut self,
        camera: &Camera,
        config: &EngineConfig,
        promise: &Promise,
        now_s: f64,
    ) -> bool {
        self.motion = self.motion.next(self.outlook.map(|outlook| outlook.position), camera, promise, now_s);
        let lead_max_m = promise.lead_max_m(self.motion.speed_m_s);
        let outlook = Some(Outlook::of(camera, config, lead_max_m));
        let has_moved = outlook != self.outlook;
        self.outlook = outlook;
        if has_moved {
            self.views.iter_mut().for_each(LevelView::outdate_plan);
        }
        has_moved
    }

    /// Takes valid lights.
    pub(crate) fn set_lights(&mut self, rig: LightRig) {
        if rig.lights != self.lighting.rig.lights {
            self.lighting.generation += 1;
        }
        if rig != self.lighting.rig {
            self.views.iter_mut().for_each(LevelView::outdate_sources);
        }
        if rig.sky != self.lighting.rig.sky {
            // Patches may not say so: where none is resident, nothing is solved.
            self.air.outdate();
        }
        self.lighting.rig = rig;
    }

    /// Takes the chunks of all levels wanted now, ascending.
    pub(crate) fn set_chunks(&mut self, mut chunks: Vec<WantedChunk>) {
        for view in self.views.iter_mut().rev() {
            view.set_chunks(chunks.split_off(chunks.partition_point(|chunk| chunk.id.level < view.level)));
        }
    }

    /// Compares what is resident with what is nearest, where either may have changed.
    pub(crate) fn replan(&mut self, table: &ChunkTable, config: &EngineConfig, promise: &Promise) {
        let Some(outlook) = self.outlook else { return };
        for view in &mut self.views {
            view.aim_at(promise.slots_at(view.level, self.motion.speed_m_s));
            let is_new = view.replan(&outlook, table, config, &mut self.candidates);
            if is_new && view.level == 0 {
                let (loaded, voxels_max) = (view.loaded(table), config.receiver_voxels_max as usize);
                self.air.replan(outlook.focus, &loaded, table, voxels_max);
            }
        }
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
        let mut is_new = false;
        for at in (0..self.views.len()).rev() {
            let (finer, coarser) = self.views.split_at_mut(at + 1);
            let (view, finer) = finer.split_last_mut().expect("the view itself is there");
            if view.advance(coarser, &self.lighting.rig, config, tick, counters)? {
                is_new = true;
                finer.iter_mut().for_each(|view| view.is_far_old = true);
            }
        }
        if is_new {
            self.air.outdate();
        }
        self.views.iter_mut().for_each(LevelView::forget_sent_news);
        Ok(())
    }

    /// Gathers light in empty air that is out of date, for up to `rows_max` rows on the CPU.
    pub(crate) fn gather_air(&mut self, rows_max: u32) -> RowsSpent {
        let Some(local) = &self.views[0].local else { return RowsSpent::default() };
        let coarser: Vec<_> = self.views[1..].iter().map(|view| view.local.as_ref()).collect();
        let exitances = exitances_of(&coarser);
        let far = FarSenders::new(coarser, &exitances, &mut self.sent);
        self.air.gather(local, far, &self.lighting.rig, rows_max)
    }

    /// Frees every slot of every level: the session closes, or a backend of its is of no more use.
    pub(crate) fn drop_local(&mut self, table: &mut ChunkTable) {
        for view in &mut self.views {
            view.drop_local(table);
        }
        self.air.clear();
    }

    /// How complete the light is now: counts are of level 0, settled are all.
    pub(crate) fn measure_quality(&mut self, table: &ChunkTable) -> FrameQuality {
        let of = |view: &LevelView| view.quality(table, &self.lighting);
        let finest = of(&self.views[0]);
        let are_settled = finest.settled && self.views[1..].iter().all(|view| of(view).settled);
        let settled = self.outlook.is_some() && self.air.stale_count() == 0 && are_settled;
        self.quality = FrameQuality { settled, missing_near: self.missing_near, ..finest };
        self.quality
    }

    /// The light as it is now, if it or its `quality` is news.
    pub(crate) fn next_frame(
        &mut self,
        table: &ChunkTable,
        quality: FrameQuality,
        now_s: f64,
        tick: u64,
    ) -> Option<Arc<Frame>> {
        if self.outlook.is_none() || self.views[0].local.is_none() {
            return None;
        }
        let mut is_new = self.told != Some(quality);
        let mut levels = Vec::with_capacity(self.views.len());
        for (view, plan) in self.views.iter_mut().zip(table.levels()) {
            let (patches, has_changed) = view.publish(table, &self.lighting, tick);
            is_new |= has_changed;
            levels.push(LevelLight { level: plan.level, patches });
        }
        if self.air.take_news() {
            self.receivers = self.air.lights();
            self.details = self.air.details();
            is_new = true;
        }
        if !is_new {
            return None;
        }
        self.told = Some(quality);
        self.frames += 1;
        let frame = Arc::new(Frame {
            session: self.id,
            number: self.frames,
            time_s: now_s,
            voxel_edge_m: table.levels()[0].grid.voxel_edge_m,
            coarse: levels.split_off(1),
            patches: levels.swap_remove(0).patches,
            receivers: Arc::clone(&self.receivers),
            details: Arc::clone(&self.details),
            quality,
        });
        self.last_frame = Some(Arc::clone(&frame));
        Some(frame)
    }

    /// Plain numbers, as of the last tick.
    pub(crate) fn stats(&self) -> SessionStats {
        let quality = self.quality;
        let local = self.views[0].local.as_ref();
        let (mut far, mut fed, mut patches) = (0.0f64, 0.0f64, 0.0f64);
        for (_, resident) in local.into_iter().flat_map(LocalSet::iter) {
            far += resident.split.far;
            fed += f64::from(resident.fed_share);
            patches += 1.0;
        }
        SessionStats {
            session: self.id,
            resident_patches: quality.resident_patches,
            wanted_patches: quality.wanted_patches,
            stale_direct: quality.stale_direct,
            missing_near: quality.missing_near,
            violations: self.violations,
            refused_patches: local.map_or(0, LocalSet::refused_count),
            settled: quality.settled,
            frames: self.frames,
            drift: self.views.iter().map(|view| view.drift).fold(0.0, f32::max),
            audit_error: self.views.iter().map(|view| view.audit_error).fold(0.0, f32::max),
            far_share: (far / patches.max(1.0)) as f32,
            fed_share: (fed / patches.max(1.0)) as f32,
        }
    }
}

/// How a camera moves, as far as the promise depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Motion {
    /// As the client says.
    pub(crate) speed_m_s: f32,
    seen_at_s: f64,
    /// The promise holds from this time on: a jump takes time to recover from.
    pub(crate) held_from_s: f64,
}

impl Motion {
    /// A camera comes from `before` at time `now_s`. One that went farther than its velocity explains has jumped.
    fn next(self, before: Option<Vec3>, camera: &Camera, promise: &Promise, now_s: f64) -> Self {
        let speed_m_s = camera.velocity.as_dvec3().length() as f32;
        let elapsed_s = (now_s - self.seen_at_s) as f32;
        let explained_m = JUMP_SLACK * (speed_m_s.max(self.speed_m_s) * elapsed_s + promise.radius_m);
        let has_jumped = before.is_none_or(|before| before.distance(camera.position) > explained_m);
        let held_from_s = if has_jumped { now_s + f64::from(promise.recovery_s) } else { self.held_from_s };
        Self { speed_m_s, seen_at_s: now_s, held_from_s }
    }
}
