//! The engine: events in, one tick's work in a fixed order, commands out. Start at [`Engine::tick`].

use crate::budget::{Budget, rotated};
use crate::chunks::{ChunkTable, Failure};
use crate::config::EngineConfig;
use crate::error::EngineError;
use crate::local_set::LocalSet;
use crate::residency::ChunkState;
use crate::schedule::{next_requests, wanted_chunks};
use crate::session::{Session, SwapBudget, WantedChunk};
use crate::stats::{Counters, EngineStats, TickStats};
use crate::{Command, Event, SessionId};
use earthshine_light::Occluders;
use earthshine_radiosity::{Backend, BackendError};
use earthshine_world::lineage::Lineage;
use earthshine_world::{Camera, Chunk, ChunkId, Grid, LightRig, WorldIndex};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Builds a backend with as many slots as asked for, or fewer if the device has no room for them.
pub type BackendFactory = Box<dyn FnMut(u32) -> Result<Box<dyn Backend>, BackendError> + Send>;

/// The state machine. One thread calls it; it never waits.
pub struct Engine {
    config: EngineConfig,
    backends: BackendFactory,
    /// What a session is lit by before it says otherwise.
    world_lights: LightRig,
    pub(crate) chunks: ChunkTable,
    pub(crate) sessions: BTreeMap<SessionId, Session>,
    /// Chunks wanted by any session, nearest first.
    wanted: Vec<ChunkId>,
    are_wants_old: bool,
    now_s: f64,
    counters: Counters,
}

impl std::fmt::Debug for Engine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Engine")
            .field("now_s", &self.now_s)
            .field("sessions", &self.sessions)
            .finish_non_exhaustive()
    }
}

impl Engine {
    /// An engine for the world of `index`, with nothing loaded and nobody connected.
    ///
    /// Levels are used from 0 on, up to the first that is missing. Lights in the index that cannot be are replaced by none.
    ///
    /// # Errors
    /// [`EngineError`]: a setting out of range, an impossible grid, a chunk listed twice.
    pub fn new(
        index: WorldIndex,
        config: EngineConfig,
        backends: BackendFactory,
    ) -> Result<Self, EngineError> {
        config.validate()?;
        let Grid { voxel_edge_m, chunk_edge_voxels } = index.grid;
        let is_edge = voxel_edge_m.is_finite() && voxel_edge_m > 0.0;
        if !is_edge || !(1..=Grid::CHUNK_EDGE_VOXELS_MAX).contains(&chunk_edge_voxels) {
            return Err(EngineError::Grid { voxel_edge_m, chunk_edge_voxels });
        }
        let mut ids: Vec<_> = index.chunks.iter().map(|chunk| chunk.id).collect();
        ids.sort_unstable();
        if let Some(pair) = ids.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(EngineError::DuplicateChunk(pair[0]));
        }
        let chunks = ChunkTable::new(&index, &config);
        let world_lights = match index.lights.validate() {
            Ok(()) => index.lights,
            Err(error) => {
                tracing::warn!(%error, "the world's lights are left out");
                LightRig::emission_only()
            }
        };
        Ok(Self {
            config,
            backends,
            world_lights,
            chunks,
            sessions: BTreeMap::new(),
            wanted: Vec::new(),
            are_wants_old: false,
            now_s: 0.0,
            counters: Counters::default(),
        })
    }

    /// Takes `events` in order, does one tick's share of the work and appends what it wants done to `commands`.
    ///
    /// `now_s` is a monotone time of the caller's; one that runs backwards or is no number counts as the last one.
    /// At most one frame a session is published, and only when something in it is new.
    ///
    /// # Panics
    /// If an invariant of the engine is broken; never because of what is in `events`.
    pub fn tick(&mut self, now_s: f64, events: Vec<Event>, commands: &mut Vec<Command>) -> TickStats {
        let before = self.counters;
        self.counters.ticks += 1;
        if now_s.is_finite() && now_s >= self.now_s {
            self.now_s = now_s;
        } else {
            self.counters.ignored.times += 1;
        }
        for event in events {
            self.take(event);
        }
        self.build_backends();
        if std::mem::take(&mut self.are_wants_old) {
            self.plan_chunks(commands);
        }
        self.request_tiles(commands);
        for session in self.sessions.values_mut() {
            session.replan(&self.chunks, &self.config);
        }
        let left_for_light = self.swap_patches();
        self.refresh_direct(left_for_light);
        let settled = self.finish(commands);
        TickStats { done: self.counters.since(&before), settled }
    }

    /// Counters, chunks by state, sessions.
    #[must_use]
    pub fn stats(&self) -> EngineStats {
        EngineStats {
            counters: self.counters,
            chunks: self.chunks.iter().map(|(_, entry)| entry.state).collect(),
            decoded_bytes: self.chunks.decoded_bytes(),
            sessions: self.sessions.values().map(|session| session.stats(&self.chunks)).collect(),
        }
    }

    /// Every chunk of every level and its state, ascending by id.
    pub fn chunk_states(&self) -> impl Iterator<Item = (ChunkId, ChunkState)> {
        self.chunks.iter().map(|(id, entry)| (id, entry.state))
    }

    /// The settings it was made with.
    #[must_use]
    pub fn config(&self) -> &EngineConfig {
        &self.config
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::SessionOpened { session } => self.open(session),
            Event::SessionClosed { session } => self.close(session),
            Event::Camera { session, camera } => self.take_camera(session, &camera),
            Event::Lights { session, lights } => self.take_lights(session, lights),
            Event::TileDecoded { chunk, occluders, lineage } => self.take_tile(chunk, lineage, occluders),
            Event::TileFailed { chunk, cause } => {
                if self.chunks.awaits(chunk) {
                    self.fail_tile(chunk, &cause);
                } else {
                    self.counters.ignored.tiles += 1;
                }
            }
        }
    }

    fn open(&mut self, id: SessionId) {
        let is_full = self.sessions.len() >= self.config.sessions_max as usize;
        if is_full || self.sessions.contains_key(&id) {
            self.counters.ignored.sessions += 1;
        } else {
            let coarser = &self.chunks.levels()[1..];
            self.sessions.insert(id, Session::new(id, 0, self.world_lights.clone(), coarser));
        }
    }

    fn close(&mut self, id: SessionId) {
        match self.sessions.remove(&id) {
            Some(mut session) => {
                session.drop_local(&mut self.chunks);
                self.are_wants_old = true;
            }
            None => self.counters.ignored.sessions += 1,
        }
    }

    fn take_camera(&mut self, id: SessionId, camera: &Camera) {
        match self.sessions.get_mut(&id) {
            Some(session) if camera.is_valid() => {
                self.are_wants_old |= session.set_camera(camera, &self.config);
            }
            _ => self.counters.ignored.cameras += 1,
        }
    }

    fn take_lights(&mut self, id: SessionId, lights: LightRig) {
        let is_sound = lights.lights.len() <= self.config.lights_max as usize && lights.validate().is_ok();
        match self.sessions.get_mut(&id) {
            Some(session) if is_sound => session.set_lights(lights),
            _ => self.counters.ignored.lights += 1,
        }
    }

    fn take_tile(&mut self, chunk: Arc<Chunk>, lineage: Arc<Lineage>, occluders: Arc<Occluders>) {
        let id = chunk.id;
        if !self.chunks.awaits(id) {
            self.counters.ignored.tiles += 1;
            return;
        }
        match self.chunks.accept(chunk, lineage, occluders) {
            Ok(bytes) => {
                self.counters.tiles_decoded += 1;
                self.counters.bytes_decoded += bytes;
                // Its size is known now, and its patches are there to be had.
                self.are_wants_old = true;
            }
            Err(fault) => self.fail_tile(id, &fault.to_string()),
        }
    }

    fn fail_tile(&mut self, id: ChunkId, cause: &str) {
        self.counters.tile_failures += 1;
        let failure = self.chunks.fail(id, self.now_s, &self.config);
        tracing::warn!(chunk = %id, cause, ?failure, "a tile failed");
        if failure == Failure::Quarantined {
            self.counters.quarantined += 1;
            self.are_wants_old = true;
        }
    }

    /// Gives every view of every session with a camera its backend, the coarsest first: it is the last to be missed.
    fn build_backends(&mut self) {
        let levels = self.chunks.levels();
        for session in self.sessions.values_mut() {
            let is_due = session.focus.is_some() && session.backend_retry_at_s <= self.now_s;
            for plan in levels.iter().rev().filter(|_| is_due) {
                let view = session.view_mut(plan.level);
                if view.local.is_some() {
                    continue;
                }
                let is_fed = usize::from(plan.level) + 1 < levels.len();
                match (self.backends)(plan.capacity) {
                    Ok(backend) => view.set_local(LocalSet::new(backend, is_fed)),
                    Err(error) => {
                        tracing::warn!(session = session.id.0, level = plan.level, %error, "no backend could be built");
                        self.counters.backend_failures += 1;
                        session.backend_retry_at_s = self.now_s + self.config.retry_after_s;
                        break;
                    }
                }
            }
        }
    }

    /// Decides which chunks are wanted, lets the others go and tells the sessions.
    fn plan_chunks(&mut self, commands: &mut Vec<Command>) {
        let focuses = self
            .sessions
            .iter()
            .filter_map(|(&id, session)| Some((id, session.focus?)))
            .collect::<BTreeMap<_, _>>();
        let wants = wanted_chunks(&focuses, &self.chunks, &self.config);
        let mut keep = wants.nearest_first.clone();
        keep.sort_unstable();
        let unwanted: Vec<_> =
            self.chunks.iter().map(|(id, _)| id).filter(|id| keep.binary_search(id).is_err()).collect();
        for chunk in unwanted {
            if self.chunks.dismiss(chunk) {
                self.counters.tiles_cancelled += 1;
                commands.push(Command::CancelTile { chunk });
            }
        }
        for id in keep {
            self.chunks.keep(id);
        }
        for (id, own) in wants.by_session {
            let own = own.into_iter().filter_map(|id| {
                let entry = self.chunks.get(id)?;
                Some(WantedChunk { id, has_tile: entry.tile.is_some(), patch_count: entry.patch_count })
            });
            if let Some(session) = self.sessions.get_mut(&id) {
                session.set_chunks(own.collect());
            }
        }
        self.wanted = wants.nearest_first;
    }

    fn request_tiles(&mut self, commands: &mut Vec<Command>) {
        for chunk in next_requests(&self.wanted, &self.chunks, &self.config, self.now_s) {
            self.chunks.request(chunk);
            self.counters.tiles_requested += 1;
            commands.push(Command::LoadTile { chunk });
        }
    }

    /// Swaps patches under the budgets. Returns what is left of the budget for direct light.
    fn swap_patches(&mut self) -> Budget {
        // New patches are lit as they come, for half of the budget: the other half follows moving lights.
        let mut for_light = Budget::new(self.config.shadow_points_per_tick_max);
        let for_new_patches = self.config.shadow_points_per_tick_max.div_ceil(2);
        let mut budget = SwapBudget {
            adds: Budget::new(self.config.adds_per_tick_max),
            removals: Budget::new(self.config.removals_per_tick_max),
            shadow_points: Budget::new(for_new_patches),
        };
        let waiting = self.views_where(Session::wants_swaps);
        let rays_before = self.counters.rays;
        for (served, (id, level)) in rotated(&waiting, self.counters.ticks).into_iter().enumerate() {
            let session = self.sessions.get_mut(&id).expect("waiting sessions are open");
            let tick = self.counters.ticks;
            let waiting = waiting.len() - served;
            let view = session.view_mut(level);
            let swapped = view.swap(&mut self.chunks, &mut budget, waiting, tick, &mut self.counters);
            if let Err(error) = swapped {
                self.lose_backend(id, &error);
            }
        }
        for_light.spend(u32::try_from(self.counters.rays - rays_before).unwrap_or(u32::MAX));
        for_light
    }

    /// Lights what is out of date, each session for its share of `budget`.
    fn refresh_direct(&mut self, mut budget: Budget) {
        let waiting = self.views_where(|view| view.stale_count(&self.chunks) > 0);
        let tick = self.counters.ticks;
        for (served, (id, level)) in rotated(&waiting, tick).into_iter().enumerate() {
            let session = self.sessions.get_mut(&id).expect("waiting sessions are open");
            let share = budget.share(waiting.len() - served);
            let view = session.view_mut(level);
            budget.spend(view.refresh_direct(&self.chunks, share, tick, &mut self.counters));
        }
    }

    /// Every view that `waits`, by session, then level.
    fn views_where(&self, waits: impl Fn(&Session) -> bool) -> Vec<(SessionId, u8)> {
        let views = self.sessions.values().flat_map(Session::views);
        views.filter(|view| waits(view)).map(|view| (view.id, view.level)).collect()
    }

    /// Advances the light of every session and publishes what is new. Returns whether all are settled.
    fn finish(&mut self, commands: &mut Vec<Command>) -> bool {
        let tick = self.counters.ticks;
        let mut lost = Vec::new();
        let mut settled = !self.are_wants_old;
        for (&id, session) in &mut self.sessions {
            if let Err(error) = session.advance(&self.config, tick, &mut self.counters) {
                lost.push((id, error));
                settled = false;
            }
        }
        self.gather_air();
        for (&id, session) in &mut self.sessions {
            if lost.iter().any(|&(lost, _)| lost == id) {
                continue;
            }
            if let Some(frame) = session.next_frame(&self.chunks, self.now_s) {
                self.counters.frames += 1;
                commands.push(Command::PublishFrame { frame });
            }
            settled &= session.focus.is_none() || session.quality(&self.chunks).settled;
        }
        for (id, error) in lost {
            self.lose_backend(id, &error);
        }
        settled
    }

    /// Gathers light in empty air, each session for its share of the tick's budget.
    fn gather_air(&mut self) {
        let mut budget = Budget::new(self.config.receiver_rows_per_tick_max);
        let waiting: Vec<_> = self
            .sessions
            .iter()
            .filter(|(_, session)| session.air.stale_count() > 0)
            .map(|(&id, _)| id)
            .collect();
        for (served, id) in rotated(&waiting, self.counters.ticks).into_iter().enumerate() {
            let session = self.sessions.get_mut(&id).expect("waiting sessions are open");
            let spent = session.gather_air(budget.share(waiting.len() - served));
            budget.spend(spent);
            self.counters.receiver_rows += u64::from(spent);
        }
    }

    /// A backend failed: everything on it is gone, and a fresh one is filled again.
    fn lose_backend(&mut self, id: SessionId, error: &BackendError) {
        tracing::warn!(session = id.0, %error, "a backend failed and is replaced");
        self.counters.backend_failures += 1;
        if let Some(session) = self.sessions.get_mut(&id) {
            session.drop_local(&mut self.chunks);
            session.backend_retry_at_s = self.now_s + self.config.retry_after_s;
        }
    }
}
