//! Patches of one view come and go as planned, under a tick's budgets.
//!
//! Where a camera jumped and nothing that is resident is wanted any more, all of it goes at once. A matrix that is mostly empty
//! is cheap to grow: work counts by the square of how full it is, so that light is there soon after.

use crate::chunks::ChunkTable;
use crate::config::EngineConfig;
use crate::level_view::{LevelView, Lighting};
use crate::local_set::LocalSet;
use crate::stats::Counters;
use earthshine_radiosity::BackendError;

/// Work on swaps: what may be done, or what was.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Swaps {
    /// In adds to a full matrix.
    pub(crate) adds: u32,
    pub(crate) removals: u32,
    /// For the direct light of the patches added.
    pub(crate) shadow_points: u32,
}

impl LevelView {
    /// Removes and adds as planned, as far as `most` goes; new patches are lit. Returns what was done.
    ///
    /// # Errors
    /// Whatever the backend says: it is of no more use.
    pub(crate) fn swap(
        &mut self,
        table: &mut ChunkTable,
        lighting: &Lighting,
        most: Swaps,
        tick: u64,
        counters: &mut Counters,
    ) -> Result<Swaps, BackendError> {
        let Some(mut local) = self.local.take() else { return Ok(Swaps::default()) };
        let done = self.swap_in(&mut local, table, lighting, most, tick, counters);
        self.local = Some(local);
        done
    }

    fn swap_in(
        &mut self,
        local: &mut LocalSet,
        table: &mut ChunkTable,
        lighting: &Lighting,
        most: Swaps,
        tick: u64,
        counters: &mut Counters,
    ) -> Result<Swaps, BackendError> {
        let cleared = self.clear_after_a_jump(local, table)?;
        let cheaper = cheaper_adds(local.len(), local.capacity(), most.adds);
        let removals = most.removals as usize;
        let forced = self.plan.forced.len().min(removals);
        let free = local.free_count() as usize + forced;
        let most_adds = most.adds.saturating_mul(cheaper);
        let affordable = self.affordable_adds(table, lighting, Swaps { adds: most_adds, ..most }, tick);
        // What is displaced makes room for what comes now, never more: a slot in hand is light.
        let displaced = self.plan.displaced.len().min(removals - forced).min(affordable.saturating_sub(free));
        let adds = affordable.min(free + displaced);

        let mut leaving = take_last(&mut self.plan.forced, forced);
        leaving.extend(take_last(&mut self.plan.displaced, displaced));
        if !leaving.is_empty() {
            local.remove(&leaving)?;
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
        let (lit, spent) = self.relight(table, lighting, tick).light(local, &added.slots, u32::MAX);
        self.is_plan_old |= added.weak_pivots + added.refused > 0;
        self.are_sources_old |= lit > 0;
        let has_moved = cleared > 0 || !leaving.is_empty() || !added.slots.is_empty();
        if has_moved {
            local.order_tables(self.focus);
        }
        self.is_far_old |= has_moved;
        self.sends_news |= has_moved;
        self.has_news |= has_moved;

        counters.adds += added.slots.len() as u64;
        counters.removes += leaving.len() as u64;
        counters.cleared += u64::from(cleared);
        counters.weak_pivots += u64::from(added.weak_pivots);
        counters.refused_adds += u64::from(added.refused);
        counters.slots_lit += u64::from(lit);
        counters.rays += u64::from(spent);
        let adds = count(newcomers.len()).div_ceil(cheaper);
        Ok(Swaps { adds, removals: count(leaving.len()), shadow_points: spent })
    }

    /// Lets everything go at once if none of it is wanted. Returns how many patches that were.
    fn clear_after_a_jump(
        &mut self,
        local: &mut LocalSet,
        table: &mut ChunkTable,
    ) -> Result<u32, BackendError> {
        let residents = local.len();
        if residents == 0 || self.plan.forced.len() != residents as usize {
            return Ok(0);
        }
        local.clear()?;
        for id in self.plan.forced.drain(..) {
            table.release(id.chunk);
        }
        Ok(residents)
    }

    /// How many of the next adds may come: by number, and by what their direct light costs; one in any case.
    fn affordable_adds(&self, table: &ChunkTable, lighting: &Lighting, most: Swaps, tick: u64) -> usize {
        let relight = self.relight(table, lighting, tick);
        let shadow_points = most.shadow_points;
        let most = self.plan.adds.len().min(most.adds as usize);
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
}

/// How many adds to a matrix with `residents` of `capacity` slots taken cost as much as one to a full one, of `adds` of those:
/// the square of how much larger the full one is.
fn cheaper_adds(residents: u32, capacity: u32, adds: u32) -> u32 {
    let limit = EngineConfig::CHEAPER_ADDS_LIMIT;
    let fits = |times: u32| {
        let filled = u64::from(residents) + u64::from(adds) * u64::from(times);
        filled * filled * u64::from(times) <= u64::from(capacity) * u64::from(capacity)
    };
    (2..=limit).rev().find(|&times| fits(times)).unwrap_or(1)
}

fn take_last<T>(list: &mut Vec<T>, how_many: usize) -> Vec<T> {
    list.split_off(list.len() - how_many)
}

fn count(length: usize) -> u32 {
    u32::try_from(length).expect("budgets are u32")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_add_costs_by_the_square_of_what_is_there() {
        assert_eq!(cheaper_adds(2048, 2048, 32), 1);
        assert_eq!(cheaper_adds(1400, 2048, 18), 2);
        assert_eq!(cheaper_adds(0, 2048, 32), EngineConfig::CHEAPER_ADDS_LIMIT);
        assert_eq!(cheaper_adds(0, 8, 32), 1, "the first adds fill it");
        for residents in 0..2048 {
            let times = cheaper_adds(residents, 2048, 20);
            let filled = f64::from(residents + 20 * times) / 2048.0;
            assert!(times == 1 || f64::from(times) * filled * filled <= 1.0, "{residents}: {times}");
        }
    }
}
