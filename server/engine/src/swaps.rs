//! Patches of one view come and go as planned, under a tick's budgets.
//!
//! Where a camera jumped and nothing that is resident is wanted any more, all of it goes at once. A matrix that is mostly empty
//! is cheap to grow: work counts by the square of how full it is, so that light is there soon after.
//!
//! A camera on the move is given fewer slots ([`crate::flow`]): where more are taken, more go than come.

use crate::chunks::ChunkTable;
use crate::level_view::{LevelView, Lighting};
use crate::local_set::LocalSet;
use crate::stats::Counters;
use crate::swap_price::{adds_for, largest_matrix, price};
use earthshine_radiosity::BackendError;

/// Work on swaps: what may be done, or what was. Adds and removals count in parts of their price: see [`crate::swap_price`].
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Swaps {
    pub(crate) adds: u32,
    pub(crate) removals: u32,
    /// For the direct light of the patches added.
    pub(crate) shadow_points: u32,
}

/// What a view does with its turn.
struct Turn {
    /// Of [`SwapPlan::forced`](crate::priority::SwapPlan), patches that go.
    forced: usize,
    /// Of those displaced.
    displaced: usize,
    /// Patches that come.
    adds: usize,
    /// Parts that each add costs.
    add_price: u32,
    /// Parts that each removal costs.
    removal_price: u32,
}

impl LevelView {
    /// Lets patches go that the backend has refused since they came: they have never had light.
    ///
    /// # Errors
    /// Whatever the backend says: it is of no more use.
    pub(crate) fn take_refused(
        &mut self,
        table: &mut ChunkTable,
        counters: &mut Counters,
    ) -> Result<(), BackendError> {
        let Some(local) = &mut self.local else { return Ok(()) };
        let refused = local.take_refused()?;
        for id in &refused {
            table.release(id.chunk);
        }
        counters.weak_pivots += refused.len() as u64;
        if !refused.is_empty() {
            self.is_plan_old = true;
            self.note_moves();
        }
        Ok(())
    }

    /// Patches have come or gone: far light and frames follow.
    fn note_moves(&mut self) {
        self.is_far_old = true;
        self.is_urgent = true;
        self.sends_news = true;
        self.has_news = true;
    }

    /// Removes and adds as planned, as far as `most` goes; new patches are lit. Returns what was done: nothing as long as the
    /// backend is behind with what it was told before.
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
        let Some(mut local) = self.local.take_if(|local| !local.backend.is_behind()) else {
            return Ok(Swaps::default());
        };
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
        let Turn { forced, displaced, adds, add_price, removal_price } =
            self.turn(local, table, lighting, most, tick);
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
            let resident = local.resident_mut(slot);
            resident.light.came(tick);
            table.hold(resident.id.chunk);
        }
        let (lit, spent) = self.relight(table, lighting, tick).light(local, &added.slots, u32::MAX);
        self.is_plan_old |= added.weak_pivots + added.refused > 0;
        self.are_sources_old |= lit > 0;
        let has_moved = cleared > 0 || !leaving.is_empty() || !added.slots.is_empty();
        if has_moved {
            local.order_tables(self.focus);
            self.note_moves();
        }

        counters.adds += added.slots.len() as u64;
        counters.removes += leaving.len() as u64;
        counters.cleared += u64::from(cleared);
        counters.weak_pivots += u64::from(added.weak_pivots);
        counters.refused_adds += u64::from(added.refused);
        counters.slots_lit += u64::from(lit);
        counters.rays += u64::from(spent);
        Ok(Swaps {
            adds: count(newcomers.len()) * add_price,
            removals: count(leaving.len()) * removal_price,
            shadow_points: spent,
        })
    }

    /// How much of the plan `most` pays for.
    fn turn(
        &self,
        local: &LocalSet,
        table: &ChunkTable,
        lighting: &Lighting,
        most: Swaps,
        tick: u64,
    ) -> Turn {
        let largest = largest_matrix(table.levels());
        let target = self.target.min(local.capacity());
        let removal_price = price(local.len(), largest);
        let removals = (most.removals / removal_price) as usize;
        let forced = self.plan.forced.len().min(removals);
        let staying = local.len() - count(forced);
        let (adds_max, add_price) = adds_for(most.adds, staying, target, largest);
        // A set that is larger than it should be shrinks: half as many come.
        let adds_max = if staying > target { adds_max.div_ceil(2) } else { adds_max };
        let affordable = self.affordable_adds(table, lighting, Swaps { adds: adds_max, ..most }, tick);
        // What is displaced makes room for what comes now, never more: a slot in hand is light.
        let wanted_room = (staying as usize + affordable).saturating_sub(target as usize);
        let displaced = self.plan.displaced.len().min(removals - forced).min(wanted_room);
        let room =
            if staying > target { local.free_count() as usize + forced } else { (target - staying) as usize };
        Turn { forced, displaced, adds: affordable.min(room + displaced), add_price, removal_price }
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

fn take_last<T>(list: &mut Vec<T>, how_many: usize) -> Vec<T> {
    list.split_off(list.len() - how_many)
}

fn count(length: usize) -> u32 {
    u32::try_from(length).expect("budgets are u32")
}
