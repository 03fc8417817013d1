//! What always holds between ticks. [`Engine::validate`](crate::Engine::validate) checks all of it.
//!
//! | name | what |
//! |---|---|
//! | E1 tile | a chunk's tile is in memory exactly in the states Decoded, Resident, Leaving |
//! | E2 slots | a chunk is Resident or Leaving exactly while its patches hold slots; their number is the sum over sessions |
//! | E3 memory | bytes and flights are the sums over chunks; flights are within the limit |
//! | E4 casters | shadow casters are those of the tiles in memory, spare ones left out |
//! | E5 bijection | slots, free slots, slot tables and backend agree; a slot's patch is its chunk's |
//! | E6 parts | row parts are up to date; the sky's part is the stored one, to the bit; the parts sum to at most one |
//! | E7 frame | a frame is finite, not negative, ascending, and no larger than the capacity |
//! | E8 limit | sessions, receivers and questions about direct light are within their limits |
//! | E9 air | receivers are counted, and light in the air is finite, ascending and nowhere where a patch is resident |
//! | E9 detail voxels | light of detail is finite and ascending |
//! | E10 pinned | a settled pinned level is resident, all of it that is not refused or given up |
//! | E11 far | far columns by parent are no more than the far part; what is fed is no more than that; parents are counted |
//! | E12 spare | spare chunks are Decoded, wanted by nobody, those alone, and weigh what was counted; what waits to be taken is Requested, once |
//! | E13 promise | violations are ticks held against the promise; what a frame says is missing is missing |

use crate::PatchLight;
use crate::asked_light::QUESTIONS_MAX;
use crate::engine::Engine;
use crate::level_view::LevelView;
use crate::local_set::LocalSet;
use crate::residency::ChunkState;
use crate::session::Session;
use crate::stats::Counters;
use crate::tile::Tile;
use earthshine_radiosity::Slot;
use earthshine_world::{ChunkId, Direction, RowParts};
use std::collections::{BTreeMap, BTreeSet};

/// Most by which a row may exceed one, and by which row parts may differ from fresh ones.
const SHARE_TOLERANCE: f32 = 2e-3;

/// A broken promise of the engine to itself: always a bug.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("engine invariant {name} is broken: {detail}")]
pub struct InvariantError {
    /// As in the module's table.
    pub name: &'static str,
    /// Where and how.
    pub detail: String,
}

fn ensure(name: &'static str, holds: bool, detail: impl FnOnce() -> String) -> Result<(), InvariantError> {
    if holds { Ok(()) } else { Err(InvariantError { name, detail: detail() }) }
}

impl Engine {
    /// Checks every invariant; slow.
    ///
    /// # Errors
    /// The first that does not hold.
    pub fn validate(&self) -> Result<(), InvariantError> {
        let mut slots: BTreeMap<ChunkId, u32> = BTreeMap::new();
        for session in self.sessions.values() {
            for view in &session.views {
                if let Some(local) = &view.local {
                    self.check_local(view, local)?;
                    check_far(view, local)?;
                    ensure("E8 limit", local.asked.len() <= QUESTIONS_MAX, || {
                        format!("session {} asks {} questions", session.id.0, local.asked.len())
                    })?;
                    for (_, resident) in local.iter() {
                        *slots.entry(resident.id.chunk).or_default() += 1;
                    }
                }
            }
            self.check_pinned(session)?;
            check_frame(session)?;
            let most = self.config().receiver_voxels_max as usize;
            ensure("E8 limit", session.air.len() <= most, || {
                format!("session {} is told of {} voxels of air", session.id.0, session.air.len())
            })?;
            ensure("E9 air", session.air.is_counted(), || format!("session {}", session.id.0))?;
        }
        ensure("E8 limit", self.sessions.len() <= self.config().sessions_max as usize, || {
            format!("{} sessions", self.sessions.len())
        })?;
        self.check_spare()?;
        self.check_chunks(&slots)
    }

    fn check_chunks(&self, slots: &BTreeMap<ChunkId, u32>) -> Result<(), InvariantError> {
        let (mut bytes, mut flights, mut flight_bytes) = (0, 0, 0);
        for (id, entry) in self.chunks.iter() {
            let state = entry.state;
            ensure("E1 tile", state.has_tile() == entry.tile.is_some(), || format!("{id} is {state:?}"))?;
            let held = slots.get(&id).copied().unwrap_or(0);
            let holds = matches!(state, ChunkState::Resident | ChunkState::Leaving);
            ensure("E2 slots", entry.slots == held && holds == (held > 0), || {
                format!("{id} is {state:?} with {held} slots held and {} counted", entry.slots)
            })?;
            bytes += entry.tile.as_ref().map_or(0, |tile| tile.bytes);
            if state == ChunkState::Requested {
                flights += 1;
                flight_bytes += entry.bytes;
            }
        }
        let table = &self.chunks;
        let counted = (table.decoded_bytes(), table.in_flight(), table.in_flight_bytes());
        let is_within = flights <= self.config().tiles_in_flight_max;
        ensure("E3 memory", counted == (bytes, flights, flight_bytes) && is_within, || {
            format!("{counted:?} counted, {:?} found", (bytes, flights, flight_bytes))
        })?;
        let casting = table
            .iter()
            .filter(|(id, entry)| {
                let casts = |tile: &Tile| tile.occluders.triangle_count() > 0;
                !table.spare().contains(id) && entry.tile.as_ref().is_some_and(casts)
            })
            .count();
        let found: usize = table.levels().iter().map(|plan| table.casters(plan.level).len()).sum();
        ensure("E4 casters", found == casting, || format!("{found} chunks cast shadows, {casting} should"))
    }

    fn check_spare(&self) -> Result<(), InvariantError> {
        let spare = self.chunks.spare();
        let bytes: u64 = spare.iter().filter_map(|&id| Some(self.chunks.tile(id)?.bytes)).sum();
        let counted = self.chunks.spare_bytes();
        ensure("E12 spare", counted == bytes, || format!("{counted} bytes counted, {bytes} there"))?;
        for (id, entry) in self.chunks.iter() {
            let is_idle = entry.state == ChunkState::Decoded && !self.is_wanted(id);
            ensure("E12 spare", spare.contains(&id) == is_idle, || format!("{id} is {:?}", entry.state))?;
        }
        let waiting: Vec<ChunkId> = self.intake.ids().collect();
        let distinct: BTreeSet<ChunkId> = waiting.iter().copied().collect();
        let are_awaited = waiting.iter().all(|&id| self.chunks.awaits(id));
        ensure("E12 spare", are_awaited && distinct.len() == waiting.len(), || format!("{waiting:?} wait"))?;
        let Counters { violations, promised_ticks, .. } = self.counters;
        ensure("E13 promise", violations <= promised_ticks, || {
            format!("{violations} of {promised_ticks} ticks")
        })
    }

    /// Once all of a pinned level is in memory and nothing of it waits, all of it is resident.
    fn check_pinned(&self, session: &Session) -> Result<(), InvariantError> {
        for (view, plan) in session.views.iter().zip(self.chunks.levels()) {
            let quality = view.quality(&self.chunks, &session.lighting);
            if !(plan.is_pinned && quality.settled) {
                continue;
            }
            let held = self
                .chunks
                .iter()
                .filter(|(id, entry)| id.level == plan.level && entry.state != ChunkState::Quarantined);
            let patches: u32 = held.map(|(_, entry)| entry.patch_count).sum();
            let refused = view.local.as_ref().map_or(0, LocalSet::refused_count);
            let is_whole =
                quality.resident_patches + refused >= patches.min(quality.wanted_patches + refused);
            ensure("E10 pinned", is_whole, || {
                format!("session {}: {quality:?} of {patches} on the top level", session.id.0)
            })?;
        }
        Ok(())
    }

    fn check_local(&self, view: &LevelView, local: &LocalSet) -> Result<(), InvariantError> {
        let at = |slot: u32| format!("session {} level {} slot {slot}", view.session.0, view.level);
        for slot in 0..local.capacity() {
            let resident = local.residents[slot as usize].as_ref();
            let is_taken = local.backend.is_taken(Slot(slot));
            let is_free = local.free().contains(&slot);
            ensure("E5 bijection", is_taken == resident.is_some() && is_free != is_taken, || at(slot))?;
            let Some(resident) = resident else { continue };
            let of_table = local.slot_of(resident.id);
            let tile = self.chunks.chunk(resident.id.chunk);
            let of_chunk = tile.and_then(|chunk| chunk.patches.get(usize::from(resident.id.local)));
            ensure("E5 bijection", of_table == Some(slot) && of_chunk == Some(&resident.patch), || at(slot))?;
            let stored = tile.map(|chunk| chunk.rows.sky_shares[usize::from(resident.id.local)]);
            ensure("E6 parts", stored == Some(resident.sky_shares), || at(slot))?;
            check_parts(resident.parts(), local.parts_of(slot), || at(slot))?;
        }
        let tabled: u32 = local.chunks().filter_map(|id| local.slots_of(id)).map(|table| table.taken()).sum();
        ensure("E5 bijection", tabled == local.len(), || {
            format!("{tabled} slots in tables, {} taken", local.len())
        })
    }
}

fn check_parts(kept: RowParts, fresh: RowParts, at: impl Fn() -> String) -> Result<(), InvariantError> {
    let is_current = (kept.resident - fresh.resident).abs() <= SHARE_TOLERANCE
        && (kept.far - fresh.far).abs() <= SHARE_TOLERANCE
        && kept.sky.to_bits() == fresh.sky.to_bits()
        && kept.absorbed.to_bits() == fresh.absorbed.to_bits();
    let sum = kept.resident + kept.far + kept.sky + kept.absorbed;
    ensure("E6 parts", is_current && sum <= 1.0 + SHARE_TOLERANCE, || {
        format!("{}: {kept:?} kept, {fresh:?} found", at())
    })
}

fn check_far(view: &LevelView, local: &LocalSet) -> Result<(), InvariantError> {
    let at = |slot: u32| format!("session {} level {} slot {slot}", view.session.0, view.level);
    let Some(field) = &local.far else { return Ok(()) };
    let mut used = 0;
    for id in local.chunks() {
        used += local.slots_of(id).map_or(0, |table| table.far_segments.iter().flatten().count());
    }
    ensure("E11 far", field.user_count() as usize == used, || {
        format!("{} users of parents counted, {used} found", field.user_count())
    })?;
    for (slot, resident) in local.iter() {
        let kept: f64 = resident.split.parents.iter().map(|far| far.share).sum();
        // What has no parent is left out; nothing is made up.
        let is_within = kept <= resident.split.far + f64::from(SHARE_TOLERANCE);
        let is_fed = f64::from(resident.fed_share) <= kept + f64::from(SHARE_TOLERANCE);
        ensure("E11 far", is_within && is_fed, || {
            format!("{}: {kept} by parents, {} fed, {:?}", at(slot), resident.fed_share, resident.parts())
        })?;
    }
    Ok(())
}

fn check_frame(session: &Session) -> Result<(), InvariantError> {
    let Some(frame) = &session.last_frame else { return Ok(()) };
    let at = || format!("session {} frame {}", session.id.0, frame.number);
    ensure("E7 frame", ascend(&frame.patches), at)?;
    let is_sound = frame.patches.iter().all(is_light);
    let quality = frame.quality;
    // Light of the others is on its way.
    let is_counted = frame.patches.len() <= quality.resident_patches as usize;
    let is_within = quality.stale_direct <= quality.resident_patches;
    ensure("E7 frame", is_sound && is_counted && is_within && frame.session == session.id, at)?;
    let is_apart = |air: &PatchLight| frame.patches.binary_search_by_key(&place(air), place).is_err();
    let is_air = frame.receivers.iter().all(|air| is_light(air) && is_apart(air));
    ensure("E9 air", is_air && ascend(&frame.receivers), at)?;
    ensure("E9 detail voxels", frame.details.iter().all(is_light) && ascend(&frame.details), at)
}

fn place(light: &PatchLight) -> ([i32; 3], Direction, u8) {
    (light.voxel.to_array(), light.direction, light.layer)
}

fn ascend(lights: &[PatchLight]) -> bool {
    lights.is_sorted_by(|a, b| place(a) < place(b))
}

fn is_light(light: &PatchLight) -> bool {
    let is_finite = |rgb: earthshine_world::Rgb| rgb.is_finite() && rgb.min_element() >= 0.0;
    is_finite(light.irradiance)
        && is_finite(light.sky_irradiance)
        && (0.0..=1.0).contains(&light.known_share)
        && (0.0..=1.0).contains(&light.far_share)
        && (0.0..=1.0).contains(&light.fed_share)
}
