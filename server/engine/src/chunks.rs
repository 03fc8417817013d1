//! All chunks of the world: their states, their tiles, their memory. Every move between states is made here.
//!
//! It does not decide: what is wanted is [`crate::schedule`]'s business.

use crate::config::EngineConfig;
use crate::direct::ShadowCasters;
use crate::error::TileFault;
use crate::levels::LevelPlan;
use crate::residency::ChunkState;
use crate::tile::{Tile, estimated_bytes};
use earthshine_light::{DirectLight, Occluders};
use earthshine_world::lineage::Lineage;
use earthshine_world::{Bounds, Chunk, ChunkCoord, ChunkId, Vec3, WorldIndex};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// What is known of one chunk.
#[derive(Debug)]
pub(crate) struct ChunkEntry {
    pub(crate) state: ChunkState,
    pub(crate) bounds: Bounds,
    /// Present exactly while [`ChunkState::has_tile`].
    pub(crate) tile: Option<Tile>,
    /// Slots that its patches hold, over all sessions.
    pub(crate) slots: u32,
    /// As the index says, until the tile says better.
    pub(crate) patch_count: u32,
    /// Memory of its tile: an estimate, until the tile was here once.
    pub(crate) bytes: u64,
    /// Size of its tile on disk.
    pub(crate) tile_bytes: u64,
    failures: u32,
    pub(crate) retry_at_s: f64,
    /// Since when nobody wants it, while its tile is in memory, s.
    unwanted_since_s: Option<f64>,
}

/// All chunks of all levels.
#[derive(Debug)]
pub(crate) struct ChunkTable {
    entries: BTreeMap<ChunkId, ChunkEntry>,
    /// One a level, finest first.
    casters: Vec<ShadowCasters>,
    levels: Vec<LevelPlan>,
    /// Detail voxels along a voxel's edge.
    detail: u32,
    decoded_bytes: u64,
    in_flight: u32,
    in_flight_bytes: u64,
    /// Decoded, and nobody wants them: what may go when room is needed.
    spare: BTreeSet<ChunkId>,
    spare_bytes: u64,
    quarantined: BTreeSet<ChunkId>,
}

/// Memory that chunks may take, bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    /// All of them, those on their way included.
    pub(crate) decoded_bytes_max: u64,
    /// Spare ones, and those on their way.
    pub(crate) spare_bytes_max: u64,
}

/// What became of a failed tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Failure {
    /// It is asked for again later.
    Retry,
    /// It is given up.
    Quarantined,
}

impl ChunkTable {
    /// Everything absent. Levels above a gap are left out.
    pub(crate) fn new(index: &WorldIndex, config: &EngineConfig) -> Self {
        let levels = LevelPlan::of(index, config);
        let entries = index
            .chunks
            .iter()
            .filter_map(|summary| {
                let plan = levels.get(usize::from(summary.id.level))?;
                let entry = ChunkEntry {
                    state: ChunkState::Absent,
                    bounds: plan.grid.chunk_bounds(summary.id.coord),
                    tile: None,
                    slots: 0,
                    patch_count: summary.patch_count,
                    bytes: estimated_bytes(summary),
                    tile_bytes: summary.tile_bytes,
                    failures: 0,
                    retry_at_s: f64::NEG_INFINITY,
                    unwanted_since_s: None,
                };
                Some((summary.id, entry))
            })
            .collect();
        let casters = levels
            .iter()
            .map(|plan| ShadowCasters::new(config.seed, plan.level, plan.grid.voxel_edge_m))
            .collect();
        Self {
            entries,
            casters,
            levels,
            decoded_bytes: 0,
            in_flight: 0,
            in_flight_bytes: 0,
            spare: BTreeSet::new(),
            spare_bytes: 0,
            quarantined: BTreeSet::new(),
            detail: index.detail,
        }
    }

    /// All levels, finest first; at least one.
    pub(crate) fn levels(&self) -> &[LevelPlan] {
        &self.levels
    }

    /// Detail voxels along a voxel's edge of level 0.
    pub(crate) fn detail(&self) -> u32 {
        self.detail
    }

    /// What casts shadows on `level`.
    pub(crate) fn casters(&self, level: u8) -> &ShadowCasters {
        &self.casters[usize::from(level)]
    }

    /// Has each level lit by what `make` gives.
    pub(crate) fn light_by(&mut self, mut make: impl FnMut() -> Box<dyn DirectLight>) {
        self.casters.iter_mut().for_each(|casters| casters.light_by(make()));
    }

    pub(crate) fn get(&self, id: ChunkId) -> Option<&ChunkEntry> {
        self.entries.get(&id)
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (ChunkId, &ChunkEntry)> {
        self.entries.iter().map(|(&id, entry)| (id, entry))
    }

    /// The tile of `id` and what hangs on it, if it is in memory.
    pub(crate) fn tile(&self, id: ChunkId) -> Option<&Tile> {
        self.entries.get(&id)?.tile.as_ref()
    }

    /// The tile of `id`, if it is in memory.
    pub(crate) fn chunk(&self, id: ChunkId) -> Option<&Arc<Chunk>> {
        self.entries.get(&id)?.tile.as_ref().map(|tile| &tile.chunk)
    }

    /// Memory of all tiles held, bytes.
    pub(crate) fn decoded_bytes(&self) -> u64 {
        self.decoded_bytes
    }

    /// Memory that the tiles in flight are expected to take, bytes.
    pub(crate) fn in_flight_bytes(&self) -> u64 {
        self.in_flight_bytes
    }

    /// Chunks in memory that nobody wants, ascending.
    pub(crate) fn spare(&self) -> &BTreeSet<ChunkId> {
        &self.spare
    }

    /// Requests not yet answered.
    pub(crate) fn in_flight(&self) -> u32 {
        self.in_flight
    }

    /// Chunks of `plan`'s level whose cube is within `radius_m` of `focus`, with the distance, ascending by id.
    pub(crate) fn near(
        &self,
        plan: &LevelPlan,
        focus: Vec3,
        radius_m: f32,
    ) -> impl Iterator<Item = (ChunkId, &ChunkEntry, f32)> {
        let edge = plan.grid.chunk_edge_m();
        let slab = |x: f32, rest: i32| ChunkId::new(plan.level, ChunkCoord::new(x as i32, rest, rest));
        let first = slab(((focus.x - radius_m) / edge).floor() - 1.0, i32::MIN);
        let last = slab(((focus.x + radius_m) / edge).floor() + 1.0, i32::MAX);
        self.entries.range(first..=last).filter_map(move |(&id, entry)| {
            let distance = entry.bounds.distance(focus);
            (distance <= radius_m).then_some((id, entry, distance))
        })
    }

    /// Absent to Requested.
    pub(crate) fn request(&mut self, id: ChunkId) {
        let entry = entry_of(&mut self.entries, id);
        entry.state.advance(ChunkState::Requested);
        self.in_flight += 1;
        self.in_flight_bytes += entry.bytes;
    }

    /// Requested to Absent: nobody wants it any more.
    pub(crate) fn cancel(&mut self, id: ChunkId) {
        self.land(id).state.advance(ChunkState::Absent);
    }

    /// Whether an answer for `id` is awaited.
    pub(crate) fn awaits(&self, id: ChunkId) -> bool {
        self.get(id).is_some_and(|entry| entry.state == ChunkState::Requested)
    }

    /// Requested to Decoded. Returns the memory it takes; after an error the chunk is still Requested.
    pub(crate) fn accept(
        &mut self,
        chunk: Arc<Chunk>,
        lineage: Arc<Lineage>,
        occluders: Arc<Occluders>,
    ) -> Result<u64, TileFault> {
        let id = chunk.id;
        let level = usize::from(id.level);
        let tile = Tile::new(chunk, lineage, Arc::clone(&occluders), &self.levels[level].grid)?;
        let bytes = tile.bytes;
        let entry = self.land(id);
        entry.state.advance(ChunkState::Decoded);
        entry.patch_count =
            u32::try_from(tile.chunk.patches.len()).expect("a checked tile has at most 65,536 patches");
        entry.bytes = bytes;
        entry.tile = Some(tile);
        entry.failures = 0;
        self.decoded_bytes += bytes;
        self.casters[level].insert(id, occluders);
        Ok(bytes)
    }

    /// Requested to Absent, to be tried again, or to Quarantined.
    pub(crate) fn fail(&mut self, id: ChunkId, now_s: f64, config: &EngineConfig) -> Failure {
        let (retry_after_s, retries_max) = (config.retry_after_s, config.retries_max);
        let entry = self.land(id);
        entry.failures += 1;
        if entry.failures > retries_max {
            entry.state.advance(ChunkState::Quarantined);
            entry.retry_at_s = now_s + config.quarantine_s;
            self.quarantined.insert(id);
            return Failure::Quarantined;
        }
        entry.state.advance(ChunkState::Absent);
        const DOUBLINGS_MAX: u32 = 16;
        let doublings = (entry.failures - 1).min(DOUBLINGS_MAX);
        entry.retry_at_s = now_s + retry_after_s * f64::from(1u32 << doublings);
        Failure::Retry
    }

    /// Quarantined to Absent, for all whose time is up. Returns whether there was any.
    pub(crate) fn release_quarantined(&mut self, now_s: f64) -> bool {
        let is_due = |id: &&ChunkId| self.entries[*id].retry_at_s <= now_s;
        let due: Vec<_> = self.quarantined.iter().filter(is_due).copied().collect();
        for &id in &due {
            self.quarantined.remove(&id);
            entry_of(&mut self.entries, id).state.advance(ChunkState::Absent);
        }
        !due.is_empty()
    }

    /// Wanted, perhaps again: Leaving goes back to Resident, and nothing wanted is spare.
    pub(crate) fn keep(&mut self, id: ChunkId) {
        let entry = entry_of(&mut self.entries, id);
        entry.unwanted_since_s = None;
        if entry.state == ChunkState::Leaving {
            entry.state.advance(ChunkState::Resident);
        }
        if self.spare.remove(&id) {
            let tile = entry.tile.as_ref().expect("a spare chunk is in memory");
            self.spare_bytes -= tile.bytes;
            self.casters[usize::from(id.level)].insert(id, Arc::clone(&tile.occluders));
        }
    }

    /// Nobody wants decoded chunk `id`: it may go, and casts no shadow meanwhile, so that light at rest does not depend on where
    /// cameras have been.
    fn make_spare(&mut self, id: ChunkId) {
        self.spare.insert(id);
        let tile = self.entries[&id].tile.as_ref().expect("a spare chunk is in memory");
        self.spare_bytes += tile.bytes;
        self.casters[usize::from(id.level)].remove(id, &tile.occluders);
    }

    /// Unwanted: Decoded becomes spare, Resident starts to leave. Returns whether a request has to be cancelled.
    pub(crate) fn dismiss(&mut self, id: ChunkId, now_s: f64) -> bool {
        let entry = entry_of(&mut self.entries, id);
        match entry.state {
            ChunkState::Requested => {
                self.cancel(id);
                return true;
            }
            ChunkState::Decoded | ChunkState::Resident => {
                entry.unwanted_since_s = Some(now_s);
                if entry.state == ChunkState::Resident {
                    entry.state.advance(ChunkState::Leaving);
                } else {
                    self.make_spare(id);
                }
            }
            ChunkState::Absent | ChunkState::Leaving | ChunkState::Quarantined => {}
        }
        false
    }

    /// Memory of the chunks that nobody wants, bytes.
    pub(crate) fn spare_bytes(&self) -> u64 {
        self.spare_bytes
    }

    /// Decoded to Absent for spare chunks until they are not too many, with what is in flight and `bytes`, and those fit beside what is in
    /// memory. The first to go is the one
    /// whose time unwanted times its distance from the nearest of `focuses`, in chunks of its level, is largest. Returns how many went.
    pub(crate) fn make_room(&mut self, bytes: u64, room: Room, focuses: &[Vec3], now_s: f64) -> u64 {
        let fits = |table: &Self| {
            let coming = table.in_flight_bytes.saturating_add(bytes);
            // What is on its way takes the place of what is spare: a burst of tiles is no peak of memory.
            table.decoded_bytes.saturating_add(coming) <= room.decoded_bytes_max
                && table.spare_bytes.saturating_add(coming) <= room.spare_bytes_max
        };
        if self.spare.is_empty() || fits(self) {
            return 0;
        }
        let mut order: Vec<(u64, ChunkId)> =
            self.spare.iter().map(|&id| (self.worth(id, focuses, now_s), id)).collect();
        order.sort_unstable();
        let mut gone = 0;
        while !fits(self)
            && let Some((_, id)) = order.pop()
        {
            self.drop_tile(id);
            gone += 1;
        }
        gone
    }

    /// How soon spare chunk `id` should go, as bits of a number that is not negative: they order like it.
    fn worth(&self, id: ChunkId, focuses: &[Vec3], now_s: f64) -> u64 {
        let entry = &self.entries[&id];
        let edge_m = self.levels[usize::from(id.level)].grid.chunk_edge_m();
        let distance =
            focuses.iter().map(|&focus| entry.bounds.distance(focus)).fold(f32::INFINITY, f32::min);
        let age_s = now_s - entry.unwanted_since_s.unwrap_or(now_s);
        ((age_s.max(0.0) + 1.0) * f64::from(1.0 + distance / edge_m)).to_bits()
    }

    /// One more patch of `id` holds a slot.
    pub(crate) fn hold(&mut self, id: ChunkId) {
        let entry = entry_of(&mut self.entries, id);
        entry.slots += 1;
        if entry.slots == 1 {
            entry.state.advance(ChunkState::Resident);
        }
    }

    /// One patch of `id` fewer holds a slot; with the last one a leaving chunk is spare.
    pub(crate) fn release(&mut self, id: ChunkId) {
        let entry = entry_of(&mut self.entries, id);
        entry.slots -= 1;
        if entry.slots == 0 {
            let is_unwanted = entry.state == ChunkState::Leaving;
            entry.state.advance(ChunkState::Decoded);
            if is_unwanted {
                self.make_spare(id);
            }
        }
    }

    /// Decoded to Absent, of a spare chunk.
    fn drop_tile(&mut self, id: ChunkId) {
        let entry = entry_of(&mut self.entries, id);
        entry.state.advance(ChunkState::Absent);
        let tile = entry.tile.take().expect("a chunk that leaves memory was there");
        self.decoded_bytes -= tile.bytes;
        self.spare_bytes -= tile.bytes;
        entry.unwanted_since_s = None;
        self.spare.remove(&id);
    }

    /// Ends a flight; the caller moves the state on.
    fn land(&mut self, id: ChunkId) -> &mut ChunkEntry {
        let entry = entry_of(&mut self.entries, id);
        self.in_flight -= 1;
        self.in_flight_bytes -= entry.bytes;
        entry
    }
}

fn entry_of(entries: &mut BTreeMap<ChunkId, ChunkEntry>, id: ChunkId) -> &mut ChunkEntry {
    entries.get_mut(&id).expect("only chunks of the index are moved")
}
