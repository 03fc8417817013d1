//! Which patches hold which slots of one session's matrix, and what the matrix is told about them.
//!
//! It owns the [`Backend`]; light on the slots is in [`crate::relight`]. Rows come from the chunks of the patches,
//! columns by reciprocity `F[i, new] = A_new F[new, i] / A_i`: rows on disk are reciprocal.

use crate::asked_light::AskedLight;
use crate::far::FarField;
use crate::far_follow::Moved;
use crate::relight::SlotLight;
use crate::row_split::{Move, Mover, RowSplit};
use crate::slots::{FREE, SlotTable, parts_of_row, segment_slots, split_row, visit_row};
use crate::tile::Tile;
use earthshine_radiosity::{Backend, BackendError, Slot, Update};
use earthshine_world::{Chunk, ChunkId, ChunkRows, Patch, PatchId, Rgb, RowParts, Vec3, Vec4};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// A patch in its slot.
#[derive(Debug)]
pub(crate) struct Resident {
    pub(crate) id: PatchId,
    pub(crate) patch: Patch,
    /// See [`Chunk::is_told`].
    pub(crate) is_told: bool,
    pub(crate) sky_shares: [f32; 6],
    /// How its row splits now.
    pub(crate) split: RowSplit,
    /// Shares of the row that do not depend on who is resident: true escapes, and what is known to bring no light.
    sky_share: f32,
    absorbed_share: f32,
    /// Of the far part: what coarser views bring.
    pub(crate) fed_share: f32,
    /// Whether far light was gathered for it.
    pub(crate) is_far_known: bool,
    /// What its far light has changed by since somebody else was asked for it; nothing if nobody was.
    pub(crate) far_moved: Option<Vec4>,
    pub(crate) light: SlotLight,
}

impl Resident {
    /// Takes what arrives from afar, lx, and how much of the row brings it. Returns whether either is another, to the bit.
    pub(crate) fn take_far(&mut self, irradiance: Rgb, fed_share: f32) -> bool {
        let is_new = (irradiance, fed_share) != (self.light.far_irradiance, self.fed_share);
        (self.light.far_irradiance, self.fed_share) = (irradiance, fed_share);
        self.is_far_known = true;
        is_new
    }

    /// Part of the row has become far, or near: `change` is what that brings, lx, and how much of the row brings it. Returns
    /// whether that is anything to who knows its far light.
    pub(crate) fn shift_far(&mut self, change: Vec4) -> bool {
        if let Some(moved) = &mut self.far_moved {
            *moved += change;
        }
        let far = (self.light.far_irradiance.extend(self.fed_share) + change).max(Vec4::ZERO);
        self.is_far_known && self.take_far(far.truncate(), far.w)
    }

    /// How its row splits now.
    pub(crate) fn parts(&self) -> RowParts {
        RowParts {
            resident: self.split.resident as f32,
            far: self.split.far as f32,
            sky: self.sky_share,
            absorbed: self.absorbed_share,
        }
    }
}

/// One session's resident patches.
pub(crate) struct LocalSet {
    pub(crate) backend: Box<dyn Backend>,
    pub(crate) residents: Vec<Option<Resident>>,
    free: BTreeSet<u32>,
    tables: BTreeMap<ChunkId, SlotTable>,
    refused: BTreeSet<PatchId>,
    /// Where far light comes from; nothing on the top level.
    pub(crate) far: Option<FarField>,
    /// Who came and went since far light was brought up to date, where it is fed.
    pub(crate) moved: Vec<Moved>,
    /// Slots in the order of frames; rebuilt when patches have come or gone.
    order: Vec<u32>,
    is_order_old: bool,
    /// Direct light that is on its way.
    pub(crate) asked: AskedLight,
    /// Room for what the backend tells.
    pub(crate) news: Vec<(Slot, Rgb)>,
    /// Whether the backend's matrix or sources changed after its last step.
    pub(crate) needs_step: bool,
    pub(crate) swaps_since_probe: u32,
    /// Whether a probe of the backend's matrix is to be told.
    pub(crate) is_probing: bool,
    /// Whether a repair of the backend's matrix is under way.
    pub(crate) is_repairing: bool,
    /// Whether its solver goes on for ever: still light is as settled as it gets.
    pub(crate) is_endless: bool,
    /// Whether its solver draws from tables, which are rebuilt nearest first.
    pub(crate) has_tables: bool,
}

/// What became of patches that were to be added.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Added {
    /// In their slots.
    pub(crate) slots: Vec<u32>,
    /// Refused at once for a weak pivot.
    pub(crate) weak_pivots: u32,
    /// Refused for another reason.
    pub(crate) refused: u32,
}

impl std::fmt::Debug for LocalSet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LocalSet").field("resident", &self.len()).finish_non_exhaustive()
    }
}

impl LocalSet {
    /// Nothing resident yet. `is_fed`: there are coarser views.
    pub(crate) fn new(backend: Box<dyn Backend>, is_fed: bool) -> Self {
        let capacity = backend.capacity();
        Self {
            backend,
            residents: (0..capacity).map(|_| None).collect(),
            free: (0..capacity).collect(),
            tables: BTreeMap::new(),
            refused: BTreeSet::new(),
            far: is_fed.then(FarField::default),
            moved: Vec::new(),
            order: Vec::new(),
            is_order_old: false,
            asked: AskedLight::default(),
            news: Vec::new(),
            needs_step: false,
            swaps_since_probe: 0,
            is_probing: false,
            is_repairing: false,
            is_endless: false,
            has_tables: false,
        }
    }

    /// Whether light would stay as it is, but for noise.
    pub(crate) fn is_at_rest(&self) -> bool {
        self.is_endless || self.backend.is_settled()
    }

    pub(crate) fn capacity(&self) -> u32 {
        self.backend.capacity()
    }

    pub(crate) fn len(&self) -> u32 {
        self.capacity() - self.free_count()
    }

    pub(crate) fn free_count(&self) -> u32 {
        u32::try_from(self.free.len()).expect("slots are u32")
    }

    pub(crate) fn free(&self) -> &BTreeSet<u32> {
        &self.free
    }

    /// Chunks with patches here, ascending.
    pub(crate) fn chunks(&self) -> impl Iterator<Item = ChunkId> {
        self.tables.keys().copied()
    }

    /// The same, with their slots.
    pub(crate) fn tables(&self) -> impl Iterator<Item = &SlotTable> {
        self.tables.values()
    }

    pub(crate) fn slots_of(&self, chunk: ChunkId) -> Option<&SlotTable> {
        self.tables.get(&chunk)
    }

    /// Resident patches of `chunk`, ascending.
    pub(crate) fn patches_of(&self, chunk: ChunkId) -> impl Iterator<Item = PatchId> {
        self.tables.get(&chunk).into_iter().flat_map(SlotTable::patches)
    }

    pub(crate) fn slot_of(&self, id: PatchId) -> Option<u32> {
        self.tables.get(&id.chunk)?.slot(usize::from(id.local))
    }

    /// Whether the backend would not take `id`; it is not offered again while its chunk is near.
    pub(crate) fn was_refused(&self, id: PatchId) -> bool {
        !self.refused.is_empty() && self.refused.contains(&id)
    }

    pub(crate) fn refused_count(&self) -> u32 {
        u32::try_from(self.refused.len()).unwrap_or(u32::MAX)
    }

    /// Refused patches of chunks that are not `near` may be offered again.
    pub(crate) fn forget_refused(&mut self, near: impl Fn(ChunkId) -> bool) {
        self.refused.retain(|id| near(id.chunk));
    }

    /// Every resident with its slot, ascending by slot.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (u32, &Resident)> {
        (0u32..).zip(&self.residents).filter_map(|(slot, resident)| Some((slot, resident.as_ref()?)))
    }

    pub(crate) fn resident(&self, slot: u32) -> &Resident {
        self.residents[slot as usize].as_ref().expect("the slot is taken")
    }

    pub(crate) fn resident_mut(&mut self, slot: u32) -> &mut Resident {
        self.residents[slot as usize].as_mut().expect("the slot is taken")
    }

    /// The chunk of a resident patch.
    pub(crate) fn chunk_of(&self, id: PatchId) -> &Arc<Chunk> {
        &self.tables[&id.chunk].chunk
    }

    /// How the row of the patch in `slot` splits, computed afresh.
    pub(crate) fn parts_of(&self, slot: u32) -> RowParts {
        let id = self.resident(slot).id;
        let chunk = self.chunk_of(id);
        let local = usize::from(id.local);
        let split = split_row(&segment_slots(&self.tables, &chunk.rows), &chunk.rows, local);
        parts_of_row(&chunk.rows, local, split.resident, split.far)
    }

    /// The slots that the columns of `rows` point at, by segment.
    pub(crate) fn segment_slots(&self, rows: &ChunkRows) -> Vec<&[u32]> {
        segment_slots(&self.tables, rows)
    }

    /// What leaves the patch in each slot, lm/m2; nothing leaves a free one.
    pub(crate) fn exitances(&self) -> Vec<Rgb> {
        let leaving = |resident: &Option<Resident>| {
            resident.as_ref().map_or(Rgb::ZERO, |resident| resident.light.exitance(&resident.patch))
        };
        self.residents.iter().map(leaving).collect()
    }

    /// Tells a backend with tables whose are to be rebuilt first: those of the patches nearest to `focus`.
    pub(crate) fn order_tables(&mut self, focus: Vec3) {
        if !self.has_tables {
            return;
        }
        // Squared distances as bits: they order like the numbers, which are never negative.
        let distance = |resident: &Resident| resident.patch.centroid.distance_squared(focus).to_bits();
        let mut order: Vec<_> = self.iter().map(|(slot, resident)| (distance(resident), slot)).collect();
        order.sort_unstable();
        let slots: Vec<Slot> = order.into_iter().map(|(_, slot)| Slot(slot)).collect();
        self.backend.set_order(&slots).expect("residents hold slots of the backend");
    }

    /// Brings [`Self::in_frame_order`] up to date.
    pub(crate) fn sort_for_frames(&mut self) {
        if std::mem::take(&mut self.is_order_old) {
            let told = self.iter().filter(|(_, resident)| resident.is_told);
            let mut order: Vec<_> = told
                .map(|(slot, resident)| (resident.patch.voxel.to_array(), resident.patch.direction, slot))
                .collect();
            order.sort_unstable();
            self.order = order.into_iter().map(|(_, _, slot)| slot).collect();
        }
    }

    /// Residents whose light is told, as frames list them, as of the last [`Self::sort_for_frames`]: ascending by voxel (x, y, z), then direction.
    pub(crate) fn in_frame_order(&self) -> impl Iterator<Item = &Resident> {
        self.order.iter().map(|&slot| self.resident(slot))
    }

    /// Removes resident patches.
    ///
    /// # Errors
    /// Whatever the backend says: it is of no more use.
    pub(crate) fn remove(&mut self, ids: &[PatchId]) -> Result<(), BackendError> {
        let slots: Vec<u32> =
            ids.iter().map(|&id| self.slot_of(id).expect("only residents are removed")).collect();
        let updates: Vec<_> = slots.iter().map(|&slot| Update::Remove { slot: Slot(slot) }).collect();
        self.backend.apply(&updates)?;
        for slot in slots {
            self.free_slot(slot);
        }
        self.count_swaps(ids.len());
        Ok(())
    }

    /// Removes all residents at once, for the price of a few removals.
    ///
    /// # Errors
    /// Whatever the backend says: it is of no more use.
    pub(crate) fn clear(&mut self) -> Result<(), BackendError> {
        self.backend.clear()?;
        for table in std::mem::take(&mut self.tables).into_values() {
            if let Some(far) = &mut self.far {
                far.release(&table.far_segments);
            }
        }
        self.residents.fill_with(|| None);
        self.moved.clear();
        // What is asked of those who left is not to stand in the way of who comes.
        self.asked = AskedLight::default();
        // Nor is what was found of a matrix that is no more to be mended in the next.
        (self.is_probing, self.is_repairing, self.swaps_since_probe) = (false, false, 0);
        self.free = (0..self.capacity()).collect();
        self.is_order_old = true;
        self.needs_step = true;
        Ok(())
    }

    /// Adds patches that are not resident, as many as there are free slots at most, in the order given.
    pub(crate) fn add(&mut self, newcomers: &[(PatchId, Tile)]) -> Added {
        let mut slots = Vec::with_capacity(newcomers.len());
        let mut updates = Vec::with_capacity(newcomers.len());
        for (id, tile) in newcomers {
            let slot = self.take_slot(*id, tile);
            updates.push(self.add_update(slot));
            slots.push(slot);
        }
        let mut added = Added::default();
        match self.backend.apply(&updates) {
            Ok(_) => {
                for (&slot, (id, _)) in slots.iter().zip(newcomers) {
                    if self.backend.is_taken(Slot(slot)) {
                        added.slots.push(slot);
                    } else {
                        self.free_slot(slot);
                        self.refused.insert(*id);
                        added.weak_pivots += 1;
                    }
                }
            }
            Err(error) => {
                for &slot in slots.iter().rev() {
                    self.free_slot(slot);
                }
                if let &[(id, _)] = newcomers {
                    tracing::warn!(chunk = %id.chunk, local = id.local, %error, "a patch was refused");
                    self.refused.insert(id);
                    added.refused = 1;
                } else {
                    // Nothing of the batch was applied: find the culprit one by one.
                    for newcomer in newcomers {
                        let one = self.add(std::slice::from_ref(newcomer));
                        added.slots.extend(one.slots);
                        added.weak_pivots += one.weak_pivots;
                        added.refused += one.refused;
                    }
                    return added;
                }
            }
        }
        self.count_swaps(added.slots.len());
        added
    }

    /// Takes whom the backend has refused since it took them for residents; returns those patches.
    ///
    /// # Errors
    /// Whatever the backend says: it is of no more use.
    pub(crate) fn take_refused(&mut self) -> Result<Vec<PatchId>, BackendError> {
        let mut slots = Vec::new();
        self.backend.take_refused(&mut slots)?;
        let ids: Vec<PatchId> = slots.iter().map(|slot| self.resident(slot.0).id).collect();
        slots.iter().for_each(|slot| self.free_slot(slot.0));
        self.refused.extend(&ids);
        Ok(ids)
    }

    fn count_swaps(&mut self, swaps: usize) {
        self.swaps_since_probe =
            self.swaps_since_probe.saturating_add(u32::try_from(swaps).unwrap_or(u32::MAX));
        self.needs_step |= swaps > 0;
    }

    fn take_slot(&mut self, id: PatchId, tile: &Tile) -> u32 {
        let chunk = &tile.chunk;
        let slot = self.free.pop_first().expect("no more patches are added than slots are free");
        let local = usize::from(id.local);
        let table = self.tables.entry(id.chunk).or_insert_with(|| {
            let far = self.far.as_mut().map(|far| far.acquire(chunk, &tile.lineage));
            SlotTable::new(Arc::clone(chunk), Arc::clone(&tile.lineage), far.unwrap_or_default())
        });
        table.take(local, slot);
        if self.far.is_some() {
            self.moved.push(Moved { id, chunk: Arc::clone(chunk), way: Move::In });
        }
        let patch = chunk.patches[local];
        let sky_shares = chunk.rows.sky_shares[local];
        let RowParts { sky: sky_share, absorbed: absorbed_share, .. } =
            parts_of_row(&chunk.rows, local, 0.0, 0.0);
        self.residents[slot as usize] = Some(Resident {
            id,
            patch,
            is_told: chunk.is_told(local),
            sky_shares,
            split: RowSplit::default(),
            sky_share,
            absorbed_share,
            fed_share: 0.0,
            is_far_known: false,
            far_moved: None,
            light: SlotLight::default(),
        });
        self.is_order_old = true;
        slot
    }

    fn free_slot(&mut self, slot: u32) {
        let resident = self.residents[slot as usize].take().expect("a taken slot is freed");
        let table = self.tables.get_mut(&resident.id.chunk).expect("a resident's chunk has a table");
        let chunk = Arc::clone(&table.chunk);
        let local = usize::from(resident.id.local);
        table.free(local);
        if self.far.is_some() {
            self.moved.push(Moved { id: resident.id, chunk: Arc::clone(&chunk), way: Move::Out });
        }
        if table.is_empty() {
            if let Some(far) = &mut self.far {
                far.release(&table.far_segments);
            }
            self.tables.remove(&resident.id.chunk);
        }
        let mut mover = Mover::new(resident.id, Move::Out);
        visit_row(&segment_slots(&self.tables, &chunk.rows), &chunk.rows, local, |neighbour, _| {
            if neighbour != FREE {
                let other = self.residents[neighbour as usize].as_mut().expect("a table names taken slots");
                let rows = &self.tables[&other.id.chunk].chunk.rows;
                mover.shift(&mut other.split, other.id.chunk, rows, usize::from(other.id.local));
            }
        });
        self.free.insert(slot);
        self.is_order_old = true;
    }

    /// The update for a patch that has just taken its slot: its neighbours are those that took theirs before.
    fn add_update(&mut self, slot: u32) -> Update {
        let &Resident { id, patch, .. } = self.resident(slot);
        let table = &self.tables[&id.chunk];
        let (chunk, local) = (&table.chunk, usize::from(id.local));
        let (mut row, mut column) = (Vec::new(), Vec::new());
        let segments = segment_slots(&self.tables, &chunk.rows);
        let split = match &mut self.far {
            Some(far) => far.split(table, &segments, local),
            None => split_row(&segments, &chunk.rows, local),
        };
        let mut mover = Mover::new(id, Move::In);
        visit_row(&segments, &chunk.rows, local, |neighbour, share| {
            if neighbour == FREE {
                return;
            }
            if neighbour == slot {
                row.push((Slot(neighbour), share));
                return;
            }
            let other = self.residents[neighbour as usize].as_mut().expect("a table names taken slots");
            let rows = &self.tables[&other.id.chunk].chunk.rows;
            mover.shift(&mut other.split, other.id.chunk, rows, usize::from(other.id.local));
            if share == 0.0 {
                return;
            }
            // Rounding on disk may carry the share of a tiny patch past one; both ways have to stay alike.
            let share = share.min(other.patch.area / patch.area);
            row.push((Slot(neighbour), share));
            column.push((Slot(neighbour), (share * patch.area / other.patch.area).min(1.0)));
        });
        self.resident_mut(slot).split = split;
        let reflectance = patch.reflectance.min(Rgb::splat(Patch::REFLECTANCE_MAX));
        Update::Add { slot: Slot(slot), reflectance, area: patch.area, row, column }
    }
}
