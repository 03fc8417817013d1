//! What a camera has no light for: patches near it that are not resident or not lit yet, level by level.
//!
//! It decides nothing. How far and how fast a camera is promised light is [`crate::promise`]'s business; here every tick
//! is held against it.

use crate::chunks::ChunkTable;
use crate::engine::Engine;
use crate::levels::LevelPlan;
use crate::local_set::LocalSet;
use crate::promise::{Means, Promise, Prospect};
use crate::stats::{LEVELS, ViolationCauses};
use earthshine_world::{PatchId, Vec3};
use std::sync::Arc;

/// Patches near a camera that there is no light of, by what they wait for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Missing {
    /// Their tile. All patches of such a chunk count as near: where they lie is not known.
    pub(crate) tile: u32,
    /// A slot.
    pub(crate) slot: u32,
    /// In their slots, their solver.
    pub(crate) light: u32,
}

impl Missing {
    pub(crate) fn total(&self) -> u32 {
        self.tile.saturating_add(self.slot).saturating_add(self.light)
    }

    fn and(self, other: Self) -> Self {
        Self {
            tile: self.tile.saturating_add(other.tile),
            slot: self.slot.saturating_add(other.slot),
            light: self.light.saturating_add(other.light),
        }
    }

    /// Where a tick that lacks these is counted.
    fn cause<'a>(&self, causes: &'a mut ViolationCauses) -> &'a mut u64 {
        match self {
            Self { tile: 1.., .. } => &mut causes.tiles,
            Self { slot: 1.., .. } => &mut causes.slots,
            Self { .. } => &mut causes.light,
        }
    }
}

/// Patches of one level within `radius_m` of `position` that `local` has no light of. What the backend refused is counted
/// elsewhere.
pub(crate) fn missing_near(
    table: &ChunkTable,
    plan: &LevelPlan,
    local: Option<&LocalSet>,
    position: Vec3,
    radius_m: f32,
) -> Missing {
    let mut missing = Missing::default();
    for (id, entry, _) in table.near(plan, position, radius_m) {
        let Some(tile) = &entry.tile else {
            missing.tile = missing.tile.saturating_add(entry.patch_count);
            continue;
        };
        let slots = local.and_then(|local| local.slots_of(id));
        for (patch, at) in tile.chunk.patches.iter().zip(0u16..) {
            let is_near = patch.centroid.distance_squared(position) <= radius_m * radius_m;
            if !is_near {
                continue;
            }
            let slot = slots.and_then(|slots| slots.slot(usize::from(at)));
            match local.zip(slot) {
                Some((local, slot)) => {
                    missing.light += u32::from(local.resident(slot).light.irradiance.is_none());
                }
                None => {
                    let patch = PatchId { chunk: id, local: at };
                    missing.slot += u32::from(!local.is_some_and(|local| local.was_refused(patch)));
                }
            }
        }
    }
    missing
}

impl Engine {
    /// Holds every tick from now on against what `prospect` promises with `means`.
    #[must_use]
    pub fn with_promise(mut self, prospect: Prospect, means: Means) -> Self {
        self.promise = Arc::new(prospect.promise(means));
        self.prospect = Some(prospect);
        self
    }

    /// What every tick is held against now.
    #[must_use]
    pub fn promise(&self) -> &Arc<Promise> {
        &self.promise
    }

    /// Promises what can be kept at another rate of ticks.
    pub(crate) fn take_pace(&mut self, tick_rate_hz: f32) {
        if !(tick_rate_hz.is_finite() && tick_rate_hz > 0.0) {
            self.counters.ignored.paces += 1;
        } else if let Some(prospect) = &self.prospect {
            let means = Means { tick_rate_hz, ..self.promise.means };
            self.promise = Arc::new(prospect.promise(means));
        }
    }

    /// Counts what the cameras lack within the radius promised of each level.
    ///
    /// After a jump there is time to recover; what is missing until then is told, and counted as a miss, and is no violation.
    pub(crate) fn hold_promise(&mut self) {
        for session in self.sessions.values_mut() {
            let Some(outlook) = session.outlook else { continue };
            let speed_m_s = session.motion.speed_m_s;
            let mut missing_finest = 0;
            let (mut is_promised, mut all_missing) = (false, Missing::default());
            for (view, plan) in session.views.iter().zip(self.chunks.levels()) {
                let radius_m = self.promise.radius_of(plan.level, speed_m_s);
                if radius_m <= 0.0 {
                    continue;
                }
                is_promised = true;
                let local = view.local.as_ref();
                let missing = missing_near(&self.chunks, plan, local, outlook.position, radius_m);
                if missing.total() == 0 {
                    continue;
                }
                all_missing = all_missing.and(missing);
                let (session, level) = (session.id.0, plan.level);
                tracing::debug!(
                    session,
                    level,
                    speed_m_s,
                    radius_m,
                    ?missing,
                    "light is missing near a camera"
                );
                self.counters.misses_by_level[usize::from(plan.level).min(LEVELS - 1)] += 1;
                if plan.level == 0 {
                    missing_finest = missing.total();
                }
            }
            session.missing_near = missing_finest;
            let is_held = is_promised && self.now_s >= session.motion.held_from_s;
            self.counters.promised_ticks += u64::from(is_held);
            if is_held && all_missing.total() > 0 {
                session.violations += 1;
                self.counters.violations += 1;
                *all_missing.cause(&mut self.counters.violation_causes) += 1;
            }
        }
    }
}
