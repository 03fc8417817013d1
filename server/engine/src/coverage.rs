//! What a camera has no light for: patches near it that are not resident or not lit yet, level by level.
//!
//! It decides nothing. How far and how fast a camera is promised light is [`crate::promise`]'s business; here every tick
//! is held against it.

use crate::chunks::ChunkTable;
use crate::engine::Engine;
use crate::levels::LevelPlan;
use crate::local_set::LocalSet;
use crate::promise::{Means, Promise, Prospect};
use crate::stats::LEVELS;
use earthshine_world::{PatchId, Vec3};
use std::sync::Arc;

/// Patches of one level within `radius_m` of `position` that `local` has no light of.
///
/// Of a chunk that is not in memory all patches count as near: where they lie is not known. What the backend refused is
/// counted elsewhere.
pub(crate) fn missing_near(
    table: &ChunkTable,
    plan: &LevelPlan,
    local: Option<&LocalSet>,
    position: Vec3,
    radius_m: f32,
) -> u32 {
    let mut missing = 0u32;
    for (id, entry, _) in table.near(plan, position, radius_m) {
        let Some(tile) = &entry.tile else {
            missing = missing.saturating_add(entry.patch_count);
            continue;
        };
        let slots = local.and_then(|local| local.slots_of(id));
        for (patch, at) in tile.chunk.patches.iter().zip(0u16..) {
            let is_near = patch.centroid.distance_squared(position) <= radius_m * radius_m;
            let light = || local?.resident(slots?.slot(usize::from(at))?).light.irradiance;
            let is_refused =
                || local.is_some_and(|local| local.was_refused(PatchId { chunk: id, local: at }));
            missing += u32::from(is_near && light().is_none() && !is_refused());
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
            session.missing_near = 0;
            let (mut is_promised, mut is_broken) = (false, false);
            for (view, plan) in session.views.iter().zip(self.chunks.levels()) {
                let radius_m = self.promise.radius_of(plan.level, speed_m_s);
                if radius_m <= 0.0 {
                    continue;
                }
                is_promised = true;
                let local = view.local.as_ref();
                let missing = missing_near(&self.chunks, plan, local, outlook.position, radius_m);
                if missing == 0 {
                    continue;
                }
                is_broken = true;
                self.counters.misses_by_level[usize::from(plan.level).min(LEVELS - 1)] += 1;
                if plan.level == 0 {
                    session.missing_near = missing;
                }
            }
            let is_held = is_promised && self.now_s >= session.motion.held_from_s;
            let is_violated = is_held && is_broken;
            self.counters.promised_ticks += u64::from(is_held);
            session.violations += u64::from(is_violated);
            self.counters.violations += u64::from(is_violated);
        }
    }
}
