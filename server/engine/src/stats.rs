//! Counters and gauges as plain data. What they are exported as is the shell's business.

use crate::SessionId;
use crate::residency::ChunkState;

/// Events that made no difference because they could not be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct IgnoredEvents {
    /// Sessions opened twice or beyond the limit, closed without being open.
    pub sessions: u64,
    /// Cameras that are not finite, too far out, or of nobody.
    pub cameras: u64,
    /// Lights that cannot be, are too many, or of nobody.
    pub lights: u64,
    /// Tiles, or failures of tiles, that were not asked for.
    pub tiles: u64,
    /// Choices of solvers that cannot be.
    pub solvers: u64,
    /// Rates of ticks, and efforts, that cannot be.
    pub paces: u64,
    /// Ticks whose time was not a number or before the last tick's.
    pub times: u64,
}

impl IgnoredEvents {
    /// All of them.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.sessions + self.cameras + self.lights + self.tiles + self.solvers + self.paces + self.times
    }
}

/// Levels that are counted apart; the last counts all above it too.
pub const LEVELS: usize = 16;

/// Broken promises by what was waited for: a tick counts once, for the first of these that any missing patch waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ViolationCauses {
    /// A tile: it was asked for too late, or is read too slowly.
    pub tiles: u64,
    /// A slot: swaps do not keep up with the camera.
    pub slots: u64,
    /// Light: the patch holds a slot, and its solver has not told of it.
    pub light: u64,
}

impl ViolationCauses {
    /// What was counted after `earlier`.
    fn since(&self, earlier: &Self) -> Self {
        Self {
            tiles: self.tiles - earlier.tiles,
            slots: self.slots - earlier.slots,
            light: self.light - earlier.light,
        }
    }
}

/// What has been done since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Ticks.
    pub ticks: u64,
    /// Events that were ignored, by kind.
    pub ignored: IgnoredEvents,
    /// Tiles asked for.
    pub tiles_requested: u64,
    /// Requests taken back.
    pub tiles_cancelled: u64,
    /// Tiles that came and were taken.
    pub tiles_decoded: u64,
    /// Tiles that could not be had, or did not hold what a tile holds.
    pub tile_failures: u64,
    /// Chunks given up.
    pub quarantined: u64,
    /// Memory of all tiles taken, bytes.
    pub bytes_decoded: u64,
    /// Size on disk of all tiles taken, bytes.
    pub tile_bytes: u64,
    /// Patches that entered a local set.
    pub adds: u64,
    /// Patches that left one, one by one.
    pub removes: u64,
    /// Patches that left one all together, after a jump of the camera.
    pub cleared: u64,
    /// What swaps cost: adds or removals, whichever was more, in parts of one in the largest matrix,
    /// [`CHEAPER_SWAPS_LIMIT`](crate::EngineConfig::CHEAPER_SWAPS_LIMIT) of them.
    pub swap_work: u64,
    /// Patches that a backend refused for a weak pivot.
    pub weak_pivots: u64,
    /// Patches that a backend refused for another reason.
    pub refused_adds: u64,
    /// Backends that could not be built, or failed and were replaced.
    pub backend_failures: u64,
    /// Slots whose direct light was computed.
    pub slots_lit: u64,
    /// Sample points times lights: the most shadow rays that may have been traced.
    pub rays: u64,
    /// Rows of receivers gathered.
    pub receiver_rows: u64,
    /// Sources that were not a number or beyond what `f32` light can carry, and were limited.
    pub limited_sources: u64,
    /// Measurements of drift.
    pub drift_probes: u64,
    /// Repairs and fresh solves because of drift.
    pub resolves: u64,
    /// Frames published.
    pub frames: u64,
    /// Audits of a solver by the matrix.
    pub audits: u64,
    /// Solvers that a backend refused: it goes on by another.
    pub solvers_refused: u64,
    /// Unwanted chunks that went because room was needed.
    pub evicted: u64,
    /// Ticks times sessions that were held against the promise.
    pub promised_ticks: u64,
    /// Of those, with a patch of any level missing inside the radius promised of it.
    pub violations: u64,
    /// The same by cause.
    pub violation_causes: ViolationCauses,
    /// Ticks times sessions, jumps included, with a patch missing inside the radius promised of its level.
    pub misses_by_level: [u64; LEVELS],
}

impl Counters {
    /// What was counted after `earlier`.
    #[must_use]
    pub fn since(&self, earlier: &Self) -> Self {
        Self {
            ticks: self.ticks - earlier.ticks,
            ignored: IgnoredEvents {
                sessions: self.ignored.sessions - earlier.ignored.sessions,
                cameras: self.ignored.cameras - earlier.ignored.cameras,
                lights: self.ignored.lights - earlier.ignored.lights,
                tiles: self.ignored.tiles - earlier.ignored.tiles,
                solvers: self.ignored.solvers - earlier.ignored.solvers,
                paces: self.ignored.paces - earlier.ignored.paces,
                times: self.ignored.times - earlier.ignored.times,
            },
            tiles_requested: self.tiles_requested - earlier.tiles_requested,
            tiles_cancelled: self.tiles_cancelled - earlier.tiles_cancelled,
            tiles_decoded: self.tiles_decoded - earlier.tiles_decoded,
            tile_failures: self.tile_failures - earlier.tile_failures,
            quarantined: self.quarantined - earlier.quarantined,
            bytes_decoded: self.bytes_decoded - earlier.bytes_decoded,
            tile_bytes: self.tile_bytes - earlier.tile_bytes,
            adds: self.adds - earlier.adds,
            removes: self.removes - earlier.removes,
            cleared: self.cleared - earlier.cleared,
            swap_work: self.swap_work - earlier.swap_work,
            weak_pivots: self.weak_pivots - earlier.weak_pivots,
            refused_adds: self.refused_adds - earlier.refused_adds,
            backend_failures: self.backend_failures - earlier.backend_failures,
            slots_lit: self.slots_lit - earlier.slots_lit,
            rays: self.rays - earlier.rays,
            receiver_rows: self.receiver_rows - earlier.receiver_rows,
            limited_sources: self.limited_sources - earlier.limited_sources,
            drift_probes: self.drift_probes - earlier.drift_probes,
            resolves: self.resolves - earlier.resolves,
            frames: self.frames - earlier.frames,
            audits: self.audits - earlier.audits,
            solvers_refused: self.solvers_refused - earlier.solvers_refused,
            evicted: self.evicted - earlier.evicted,
            promised_ticks: self.promised_ticks - earlier.promised_ticks,
            violations: self.violations - earlier.violations,
            violation_causes: self.violation_causes.since(&earlier.violation_causes),
            misses_by_level: std::array::from_fn(|at| self.misses_by_level[at] - earlier.misses_by_level[at]),
        }
    }
}

/// What one tick did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TickStats {
    /// Counted in this tick alone.
    pub done: Counters,
    /// Whether every session with a camera is settled: another tick with the same input would do nothing.
    pub settled: bool,
}

/// Chunks by state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ChunkCounts {
    /// [`ChunkState::Absent`]
    pub absent: u32,
    /// [`ChunkState::Requested`]
    pub requested: u32,
    /// [`ChunkState::Decoded`]
    pub decoded: u32,
    /// [`ChunkState::Resident`]
    pub resident: u32,
    /// [`ChunkState::Leaving`]
    pub leaving: u32,
    /// [`ChunkState::Quarantined`]
    pub quarantined: u32,
}

impl FromIterator<ChunkState> for ChunkCounts {
    fn from_iter<I: IntoIterator<Item = ChunkState>>(states: I) -> Self {
        let mut counts = Self::default();
        for state in states {
            *match state {
                ChunkState::Absent => &mut counts.absent,
                ChunkState::Requested => &mut counts.requested,
                ChunkState::Decoded => &mut counts.decoded,
                ChunkState::Resident => &mut counts.resident,
                ChunkState::Leaving => &mut counts.leaving,
                ChunkState::Quarantined => &mut counts.quarantined,
            } += 1;
        }
        counts
    }
}

/// One session at this moment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SessionStats {
    /// Whose.
    pub session: SessionId,
    /// Patches that hold slots.
    pub resident_patches: u32,
    /// Patches its camera would want with the present capacity.
    pub wanted_patches: u32,
    /// Patches whose direct light is out of date.
    pub stale_direct: u32,
    /// Patches within the promised radius that have no light of level 0.
    pub missing_near: u32,
    /// Ticks that broke the promise.
    pub violations: u64,
    /// Patches that its backend refused and that are not offered again while their chunk is near.
    pub refused_patches: u32,
    /// Whether everything wanted is resident and nothing is stale.
    pub settled: bool,
    /// Frames published.
    pub frames: u64,
    /// Rounding of its matrix at the last probe, relative; 0 before the first.
    pub drift: f32,
    /// Relative RMSE of its light against the matrix at the last audit, the worst level; 0 before the first.
    pub audit_error: f32,
    /// Mean share of the rows of level 0 whose columns exist but are not resident, 0..=1.
    pub far_share: f32,
    /// Mean of what coarse levels bring of it, 0..=1: the rest is a gap.
    pub fed_share: f32,
}

/// The engine at this moment.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EngineStats {
    /// Since the start.
    pub counters: Counters,
    /// Chunks by state.
    pub chunks: ChunkCounts,
    /// Memory of the tiles held, bytes.
    pub decoded_bytes: u64,
    /// What is promised: light of level 0 within this radius of a camera, m; 0 for no promise.
    pub promised_radius_m: f32,
    /// Up to this speed, m/s.
    pub promised_speed_m_s: f32,
    /// Ticks a second that the promise counts on.
    pub promised_tick_rate_hz: f32,
    /// The part of its budgets that a tick may spend, 0..=1.
    pub effort: f32,
    /// Chunks in memory that nobody wants: they go when room is needed.
    pub spare_chunks: u32,
    /// Open sessions, ascending.
    pub sessions: Vec<SessionStats>,
}

impl EngineStats {
    /// The worst error that an audit found in any session.
    #[must_use]
    pub fn audit_error(&self) -> f32 {
        self.sessions.iter().map(|session| session.audit_error).fold(0.0, f32::max)
    }

    /// The worst drift of any session.
    #[must_use]
    pub fn drift(&self) -> f32 {
        self.sessions.iter().map(|session| session.drift).fold(0.0, f32::max)
    }
}
