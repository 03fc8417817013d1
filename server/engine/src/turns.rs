//! Whose turn the work of a tick is: every level of every session wants patches and light, under budgets that they share.
//!
//! What a view does with its turn is [`crate::swaps`]' and [`crate::relight`]'s business.

use crate::SessionId;
use crate::budget::{Budget, Weight, rotated};
use crate::engine::Engine;
use crate::level_view::LevelView;
use crate::session::Session;
use crate::swap_price::PARTS;
use crate::swaps::Swaps;

impl Engine {
    /// Hears of patches that backends have refused late.
    pub(crate) fn take_refused(&mut self) {
        let mut lost = Vec::new();
        for (&id, session) in &mut self.sessions {
            let views = &mut session.views;
            let heard =
                views.iter_mut().try_for_each(|view| view.take_refused(&mut self.chunks, &mut self.counters));
            lost.extend(heard.err().map(|error| (id, error)));
        }
        for (id, error) in lost {
            self.lose_backend(id, &error);
        }
    }

    /// Swaps patches under the budgets. Returns what is left of the budget for direct light.
    pub(crate) fn swap_patches(&mut self) -> Budget {
        // New patches are lit as they come, for half of the budget: the other half follows moving lights.
        let points = self.effort.of(self.config.shadow_points_per_tick_max);
        let mut for_light = Budget::new(points);
        let whole = |swaps: u32| Budget::new(self.effort.of(swaps.saturating_mul(PARTS)).max(PARTS));
        let mut adds = whole(self.config.adds_per_tick_max);
        let mut removals = whole(self.config.removals_per_tick_max);
        let mut shadow_points = Budget::new(points.div_ceil(2));
        let tick = self.counters.ticks;
        for (id, level) in self.in_turn() {
            let session = self.sessions.get_mut(&id).expect("waiting sessions are open");
            let most =
                Swaps { adds: adds.left(), removals: removals.left(), shadow_points: shadow_points.left() };
            if most.adds.min(most.removals).min(most.shadow_points) == 0 {
                break;
            }
            let view = &mut session.views[usize::from(level)];
            match view.swap(&mut self.chunks, &session.lighting, most, tick, &mut self.counters) {
                Ok(done) => {
                    let parts_done = done.adds.max(done.removals);
                    self.counters.swap_work += u64::from(parts_done);
                    view.had += u64::from(parts_done) * FINEST_PARTS / parts(level);
                    adds.spend(done.adds);
                    removals.spend(done.removals);
                    shadow_points.spend(done.shadow_points);
                    for_light.spend(done.shadow_points);
                }
                Err(error) => self.lose_backend(id, &error),
            }
        }
        for_light
    }

    /// The views that want swaps, the one first that has had least for its part. A tick's work is one view's as far as it goes,
    /// not a little of each: a block of 32 patches costs less than twice one of eight.
    fn in_turn(&mut self) -> Vec<(SessionId, u8)> {
        let waiting = self.views_where(|_, view| view.wants_swaps());
        let mut turns = Vec::with_capacity(waiting.len());
        for (id, level) in waiting {
            let view =
                &mut self.sessions.get_mut(&id).expect("waiting sessions are open").views[usize::from(level)];
            // Who did not want anything for a while has no claim to what others had meanwhile.
            view.had = view.had.max(self.swaps_had);
            turns.push((view.had, (id, level)));
        }
        // Stable: among equals the order of `views_where`.
        turns.sort_by_key(|&(had, _)| had);
        self.swaps_had = turns.first().map_or(self.swaps_had, |&(had, _)| had);
        turns.into_iter().map(|(_, view)| view).collect()
    }

    /// Lights what is out of date, each view for its share of `budget`.
    pub(crate) fn refresh_direct(&mut self, mut budget: Budget) {
        let (chunks, tick) = (&self.chunks, self.counters.ticks);
        for session in self.sessions.values_mut() {
            for view in &mut session.views {
                view.note_casters(chunks, &session.lighting);
                view.take_direct(chunks, &session.lighting, tick, &mut self.counters);
            }
        }
        let waiting = self.views_where(|session, view| view.has_unasked(chunks, &session.lighting));
        for ((id, level), weight) in with_weights(&waiting) {
            let session = self.sessions.get_mut(&id).expect("waiting sessions are open");
            let view = &mut session.views[usize::from(level)];
            let (most, lighting) = (budget.share(weight), &session.lighting);
            budget.spend(view.refresh_direct(&self.chunks, lighting, most, tick, &mut self.counters));
        }
    }

    /// Every view that `waits`: coarse levels first, which leave what they do not need to level 0; among those another session
    /// is first each tick, so that none starves.
    fn views_where(&self, waits: impl Fn(&Session, &LevelView) -> bool) -> Vec<(SessionId, u8)> {
        let sessions: Vec<_> = self.sessions.values().collect();
        let sessions = rotated(&sessions, self.counters.ticks);
        let mut found = Vec::new();
        for is_coarse in [true, false] {
            for &session in &sessions {
                let views = session.views.iter().filter(|view| (view.level > 0) == is_coarse);
                found.extend(views.filter(|view| waits(session, view)).map(|view| (session.id, view.level)));
            }
        }
        found
    }
}

/// Parts of a budget that a view of level 0 gets, to one of a coarse view: level 0 is what is promised.
const FINEST_PARTS: u64 = 4;

/// Parts of a budget that a view of `level` gets.
pub(crate) fn parts(level: u8) -> u64 {
    if level == 0 { FINEST_PARTS } else { 1 }
}

/// Views in the order given, each with its part of what is left when its turn comes.
fn with_weights(waiting: &[(SessionId, u8)]) -> Vec<((SessionId, u8), Weight)> {
    let mut left: u64 = waiting.iter().map(|&(_, level)| parts(level)).sum();
    let weigh = |&(id, level): &(SessionId, u8)| {
        let weight = Weight { own: parts(level), waiting: left };
        left -= weight.own;
        ((id, level), weight)
    };
    waiting.iter().map(weigh).collect()
}
