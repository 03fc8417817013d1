//! The engine: events in, one tick's work in a fixed order, commands out. Start at [`Engine::tick`].

use crate::budget::{Budget, Effort, Weight, rotated};
use crate::chunks::{ChunkTable, Failure, Room};
use crate::config::EngineConfig;
use crate::error::EngineError;
use crate::intake::{Arrival, Intake};
use crate::level_view::WantedChunk;
use crate::local_set::LocalSet;
use crate::promise::{Promise, Prospect};
use crate::residency::ChunkState;
use crate::schedule::{next_requests, wanted_chunks};
use crate::session::Session;
use crate::stats::{Counters, EngineStats, TickStats};
use crate::{Command, Event, SessionId, SolverConfig};
use earthshine_light::DirectLight;
use earthshine_light::Occluders;
use earthshine_radiosity::receivers::ReceiverLight;
use earthshine_radiosity::{Backend, BackendError};
use earthshine_world::lineage::Lineage;
use earthshine_world::{Camera, Chunk, ChunkId, Grid, LightRig, Vec3, WorldIndex};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Builds a backend with as many slots as asked for, or fewer if the device has no room for them.
pub type BackendFactory = Box<dyn FnMut(u32) -> Result<Box<dyn Backend>, BackendError> + Send>;

/// Makes who gathers rows, those of the receivers of one session or those of the patches of one of its levels.
pub type ReceiverLightFactory = Box<dyn FnMut() -> Box<dyn ReceiverLight> + Send>;

/// The state machine. One thread calls it; it never waits.
pub struct Engine {
    pub(crate) config: EngineConfig,
    backends: BackendFactory,
    /// Who gathers light of receivers and far light of each level for each session beside the CPU.
    gatherers: Option<ReceiverLightFactory>,
    /// What a session is lit by before it says otherwise.
    world_lights: LightRig,
    pub(crate) chunks: ChunkTable,
    pub(crate) sessions: BTreeMap<SessionId, Session>,
    /// Chunks wanted by any session, most urgent first.
    wanted: Vec<ChunkId>,
    are_wants_old: bool,
    /// Tiles that have come and are not taken yet.
    pub(crate) intake: Intake,
    /// What is held against every tick, and what it is computed from.
    pub(crate) promise: Arc<Promise>,
    pub(crate) prospect: Option<Prospect>,
    /// What the view whose turn it was last had had of swaps; see `LevelView::had`.
    pub(crate) swaps_had: u64,
    pub(crate) now_s: f64,
    /// What ticks may spend of their budgets.
    pub(crate) effort: Effort,
    pub(crate) counters: Counters,
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
    /// Levels are used from 0 on, up to the first that is missing (said in the log). Lights in the index that cannot be are replaced by none.
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
        let level_count = index.level_count();
        let unused = index.chunks.iter().filter(|chunk| chunk.id.level >= level_count.max(1)).count();
        if unused > 0 {
            tracing::warn!(
                missing_level = level_count,
                chunks = unused,
                "levels above a missing one are not used: far light is coarser than it could be; bake the levels again"
            );
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
            gatherers: None,
            world_lights,
            chunks,
            sessions: BTreeMap::new(),
            wanted: Vec::new(),
            are_wants_old: false,
            intake: Intake::default(),
            promise: Arc::default(),
            prospect: None,
            swaps_had: 0,
            now_s: 0.0,
            effort: Effort::FULL,
            counters: Counters::default(),
        })
    }

    /// Has direct light of each level computed by what `make` gives, as far as that can; the CPU does the rest.
    #[must_use]
    pub fn lit_by(mut self, make: impl FnMut() -> Box<dyn DirectLight>) -> Self {
        self.chunks.light_by(make);
        self
    }

    /// Has light of each session's receivers, and far light of each of its levels, gathered by what `make` gives, as far as
    /// that can; the CPU does the rest. Frames then depend on when its answers come.
    #[must_use]
    pub fn gathered_by(mut self, make: ReceiverLightFactory) -> Self {
        self.gatherers = Some(make);
        self
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
        self.are_wants_old |= self.chunks.release_quarantined(self.now_s);
        self.accept_tiles();
        self.take_refused();
        self.build_backends();
        if std::mem::take(&mut self.are_wants_old) {
            self.plan_chunks(commands);
        }
        self.request_tiles(commands);
        for session in self.sessions.values_mut() {
            session.replan(&self.chunks, &self.config, &self.promise);
        }
        let left_for_light = self.swap_patches();
        self.make_room(0);
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
            promised_radius_m: self.promise.radius_m,
            promised_speed_m_s: self.promise.speed_m_s,
            promised_tick_rate_hz: self.promise.means.tick_rate_hz,
            effort: self.effort.share(),
            spare_chunks: u32::try_from(self.chunks.spare().len()).unwrap_or(u32::MAX),
            sessions: self.sessions.values().map(Session::stats).collect(),
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
            Event::Solver { solver } => self.take_solver(solver),
            Event::Pace { tick_rate_hz } => self.take_pace(tick_rate_hz),
            Event::Effort { share } => match Effort::new(share) {
                Some(effort) => self.effort = effort,
                None => self.counters.ignored.paces += 1,
            },
            Event::TileDecoded { chunk, occluders, lineage } => self.take_tile(chunk, lineage, occluders),
            Event::TileFailed { chunk, cause } => {
                if self.chunks.awaits(chunk) && !self.intake.holds(chunk) {
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
            let mut session = Session::new(id, self.world_lights.clone(), self.chunks.levels());
            if let Some(make) = &mut self.gatherers {
                session.gather_by(make);
            }
            self.sessions.insert(id, session);
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
                self.are_wants_old |= session.set_camera(camera, &self.config, &self.promise, self.now_s);
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

    fn take_solver(&mut self, solver: SolverConfig) {
        if let Err(error) = solver.validate() {
            tracing::warn!(%error, "a choice of solvers is ignored");
            self.counters.ignored.solvers += 1;
            return;
        }
        self.config.solver = solver;
        for view in self.sessions.values_mut().flat_map(|session| &mut session.views) {
            view.choose_solver(&self.config, &mut self.counters);
        }
    }

    fn take_tile(&mut self, chunk: Arc<Chunk>, lineage: Arc<Lineage>, occluders: Arc<Occluders>) {
        let is_awaited = self.chunks.awaits(chunk.id);
        if !(is_awaited && self.intake.put(Arrival { chunk, lineage, occluders })) {
            self.counters.ignored.tiles += 1;
        }
    }

    /// Takes tiles that have come, in that order, for a tick's bytes, one at least.
    fn accept_tiles(&mut self) {
        let mut bytes = 0u64;
        while bytes < self.config.accepted_bytes_per_tick_max
            && let Some(Arrival { chunk, lineage, occluders }) = self.intake.take()
        {
            let id = chunk.id;
            match self.chunks.accept(chunk, lineage, occluders) {
                Ok(own) => {
                    bytes = bytes.saturating_add(own);
                    self.counters.tiles_decoded += 1;
                    self.counters.bytes_decoded += own;
                    self.counters.tile_bytes += self.chunks.get(id).map_or(0, |entry| entry.tile_bytes);
                    // Its size is known now, and its patches are there to be had.
                    self.are_wants_old = true;
                }
                Err(fault) => self.fail_tile(id, &fault.to_string()),
            }
        }
    }

    /// Lets spare chunks go until `bytes` fit the memory.
    fn make_room(&mut self, bytes: u64) {
        let focuses: Vec<Vec3> =
            self.sessions.values().filter_map(|session| Some(session.outlook?.focus)).collect();
        let EngineConfig { decoded_bytes_max, spare_bytes_max, .. } = self.config;
        let room = Room { decoded_bytes_max, spare_bytes_max };
        self.counters.evicted += self.chunks.make_room(bytes, room, &focuses, self.now_s);
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
            let is_due = session.outlook.is_some() && session.backend_retry_at_s <= self.now_s;
            for plan in levels.iter().rev().filter(|_| is_due) {
                let view = &mut session.views[usize::from(plan.level)];
                if view.local.is_some() {
                    continue;
                }
                let is_fed = usize::from(plan.level) + 1 < levels.len();
                match (self.backends)(plan.capacity) {
                    Ok(backend) => {
                        view.set_local(LocalSet::new(backend, is_fed));
                        view.choose_solver(&self.config, &mut self.counters);
                    }
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
        let outlooks = self
            .sessions
            .iter()
            .filter_map(|(&id, session)| Some((id, session.outlook?)))
            .collect::<BTreeMap<_, _>>();
        let wants = wanted_chunks(&outlooks, &self.chunks, &self.config);
        let mut keep = wants.most_urgent_first.clone();
        keep.sort_unstable();
        for &chunk in self.wanted.iter().filter(|id| keep.binary_search(id).is_err()) {
            if self.chunks.dismiss(chunk, self.now_s) {
                self.intake.forget(chunk);
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
        self.wanted = wants.most_urgent_first;
    }

    /// Whether any session wants `id`, as far as was planned.
    pub(crate) fn is_wanted(&self, id: ChunkId) -> bool {
        self.wanted.contains(&id)
    }

    fn request_tiles(&mut self, commands: &mut Vec<Command>) {
        for chunk in next_requests(&self.wanted, &self.chunks, &self.config, self.now_s) {
            self.make_room(self.chunks.get(chunk).map_or(0, |entry| entry.bytes));
            self.chunks.request(chunk);
            self.counters.tiles_requested += 1;
            commands.push(Command::LoadTile { chunk });
        }
    }

    /// Advances the light of every session, holds the tick against the promise and publishes what is new. Returns whether all are settled.
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
        self.hold_promise();
        for (&id, session) in &mut self.sessions {
            if lost.iter().any(|&(lost, _)| lost == id) {
                continue;
            }
            let quality = session.measure_quality(&self.chunks);
            if let Some(frame) = session.next_frame(&self.chunks, quality, self.now_s, tick) {
                self.counters.frames += 1;
                commands.push(Command::PublishFrame { frame });
            }
            settled &= session.outlook.is_none() || quality.settled;
        }
        for (id, error) in lost {
            self.lose_backend(id, &error);
        }
        settled
    }

    /// Gathers light in empty air, each session for its share of the tick's budget, or all of it on a device.
    fn gather_air(&mut self) {
        let mut budget = Budget::new(self.effort.of(self.config.receiver_rows_per_tick_max));
        let waiting: Vec<_> = self
            .sessions
            .iter()
            .filter(|(_, session)| session.air.stale_count() > 0)
            .map(|(&id, _)| id)
            .collect();
        for (served, id) in rotated(&waiting, self.counters.ticks).into_iter().enumerate() {
            let session = self.sessions.get_mut(&id).expect("waiting sessions are open");
            let weight = Weight { own: 1, waiting: waiting.len() as u64 - served as u64 };
            let spent = session.gather_air(budget.share(weight));
            budget.spend(spent.here);
            self.counters.receiver_rows += u64::from(spent.here) + u64::from(spent.elsewhere);
        }
    }

    /// A backend failed: everything on it is gone, and a fresh one is filled again.
    pub(crate) fn lose_backend(&mut self, id: SessionId, error: &BackendError) {
        tracing::warn!(session = id.0, %error, "a backend failed and is replaced");
        self.counters.backend_failures += 1;
        if let Some(session) = self.sessions.get_mut(&id) {
            session.drop_local(&mut self.chunks);
            session.backend_retry_at_s = self.now_s + self.config.retry_after_s;
        }
    }
}
