//! Far light of one local set: which coarse parents stand for the columns that are not resident, and what they send.
//!
//! Each slot keeps its far columns summed by parent, one level up ([`crate::row_split`]). A parent's exitance is known where some coarser view of
//! the session holds it; else its own parent stands for it, and so on up to the top. What no view holds is a gap: it
//! brings no light, is counted, and is never given to the sky. Coupling goes one way, coarse to fine.

use crate::local_set::{LocalSet, Resident};
use crate::row_split::{NOBODY, RowSplit};
use crate::slots::{FREE, SlotTable};
use earthshine_world::lineage::{Lineage, Parents};
use earthshine_world::{Chunk, ChunkId, Rgb, Vec4};
use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// What one slot sees of one parent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FarShare {
    /// Of [`FarField`]: the parent's chunk.
    block: u32,
    /// The parent in its chunk.
    parent: u16,
    /// Sum of the form factors of its children that are not resident.
    pub(crate) share: f64,
}

/// Where the columns of one segment have their parents.
#[derive(Debug, Clone)]
pub(crate) struct FarSegment {
    block: u32,
    parents: Parents,
}

/// Parents in one coarse chunk that rows of this local set may lead to.
#[derive(Debug)]
struct Block {
    chunk: ChunkId,
    /// Segments of slot tables that use it.
    users: u32,
    lineage: Arc<Lineage>,
    /// One past the highest parent in use.
    parent_count: usize,
}

/// The parents of one local set.
#[derive(Debug, Default)]
pub(crate) struct FarField {
    blocks: Vec<Option<Block>>,
    free: BTreeSet<u32>,
    by_chunk: BTreeMap<ChunkId, u32>,
    /// Where the parents of each block begin in a list of all parents.
    starts: Vec<u32>,
    parent_count: usize,
    /// Scratch of [`Self::split`]: places in the row's list by parent, [`NOBODY`] between calls.
    places: Vec<u32>,
    /// Scratch of [`gather_those`].
    sent: SentRoom,
}

impl FarField {
    /// Finds the parents of every segment of `chunk`; [`Self::release`] is its undoing.
    pub(crate) fn acquire(&mut self, chunk: &Chunk, lineage: &Arc<Lineage>) -> Vec<Option<FarSegment>> {
        let segment = |&id: &ChunkId| {
            let parents = Arc::clone(lineage.of(id)?);
            let parent_count = parents.iter().max().map_or(0, |&last| usize::from(last) + 1);
            let at = self.block_of(id.parent(), lineage);
            let block = self.blocks[at as usize].as_mut().expect("a block in the index is there");
            block.users += 1;
            block.parent_count = block.parent_count.max(parent_count);
            Some(FarSegment { block: at, parents })
        };
        let segments = chunk.rows.segments.iter().map(segment).collect();
        self.number_parents();
        segments
    }

    fn block_of(&mut self, chunk: ChunkId, lineage: &Arc<Lineage>) -> u32 {
        if let Some(&block) = self.by_chunk.get(&chunk) {
            return block;
        }
        let fresh = Some(Block { chunk, users: 0, lineage: Arc::clone(lineage), parent_count: 0 });
        let block = match self.free.pop_first() {
            Some(block) => {
                self.blocks[block as usize] = fresh;
                block
            }
            None => {
                self.blocks.push(fresh);
                u32::try_from(self.blocks.len() - 1).expect("fewer blocks than chunks in memory see")
            }
        };
        self.by_chunk.insert(chunk, block);
        block
    }

    /// The table of these segments is gone.
    pub(crate) fn release(&mut self, segments: &[Option<FarSegment>]) {
        for segment in segments.iter().flatten() {
            let place = &mut self.blocks[segment.block as usize];
            let block = place.as_mut().expect("a used block is there");
            block.users -= 1;
            if block.users == 0 {
                self.by_chunk.remove(&block.chunk);
                *place = None;
                self.free.insert(segment.block);
            }
        }
        self.number_parents();
    }

    fn number_parents(&mut self) {
        let mut next = 0usize;
        self.starts.clear();
        for block in &self.blocks {
            self.starts.push(u32::try_from(next).expect("fewer parents than patches in memory see"));
            next += block.as_ref().map_or(0, |block| block.parent_count);
        }
        self.parent_count = next;
        self.places.resize(next, NOBODY);
    }

    /// Users of all blocks: the segments with parents of all tables.
    pub(crate) fn user_count(&self) -> u32 {
        self.blocks.iter().flatten().map(|block| block.users).sum()
    }

    /// How row `local` of `table`'s chunk splits. Columns without a known parent are far, and nobody's.
    pub(crate) fn split(&mut self, table: &SlotTable, segments: &[&[u32]], local: usize) -> RowSplit {
        let rows = &table.chunk.rows;
        let mut split =
            RowSplit { parent_of: Vec::with_capacity(rows.row(local).len()), ..RowSplit::default() };
        for (column, share) in rows.row(local) {
            let (segment, place) = (usize::from(column.segment), usize::from(column.local));
            let share = f64::from(share);
            let is_resident = segments[segment].get(place).is_some_and(|&slot| slot != FREE);
            *(if is_resident { &mut split.resident } else { &mut split.far }) += share;
            let parent = table.far_segments[segment]
                .as_ref()
                .and_then(|FarSegment { block, parents }| Some((*block, *parents.get(place)?)));
            let Some((block, parent)) = parent else {
                split.parent_of.push(NOBODY);
                continue;
            };
            let at = &mut self.places[self.starts[block as usize] as usize + usize::from(parent)];
            if *at == NOBODY {
                *at = u32::try_from(split.parents.len()).expect("a row has fewer columns than that");
                split.parents.push(FarShare { block, parent, share: 0.0 });
            }
            split.parent_of.push(*at);
            if !is_resident {
                split.parents[*at as usize].share += share;
            }
        }
        for far in &split.parents {
            self.places[self.starts[far.block as usize] as usize + usize::from(far.parent)] = NOBODY;
        }
        split
    }

    /// Who stands for the parents of each block.
    fn ancestries<'a>(
        &'a self,
        coarser: &[Option<&'a LocalSet>],
        exitances: &'a [Vec<Rgb>],
    ) -> Vec<Option<Ancestry<'a>>> {
        let of = |block: &'a Block| Ancestry::of(block.chunk, &block.lineage, coarser, exitances);
        self.blocks.iter().map(|block| block.as_ref().map(of)).collect()
    }
}

/// What one parent sends: red, green, blue, and one if that is known, else all zero. Of the many parents that rows may lead to few are
/// asked for, most of those by many rows: what is asked for is worked out once.
#[derive(Debug, Clone)]
struct Sent(Cell<Vec4>);

impl Sent {
    /// Not asked for yet.
    fn unknown() -> Self {
        Self(Cell::new(Vec4::NEG_ONE))
    }

    fn get(&self, exitance: impl FnOnce() -> Option<Rgb>) -> Vec4 {
        if self.0.get().w < 0.0 {
            self.0.set(exitance().map_or(Vec4::ZERO, |exitance| exitance.extend(1.0)));
        }
        self.0.get()
    }
}

/// One level above a block: whose slots its patches hold, and who their parents are.
struct Generation<'a> {
    slots: &'a [u32],
    exitances: &'a [Rgb],
    parents: Option<Parents>,
}

/// The levels from a block's own on, finest first.
struct Ancestry<'a>(Vec<Generation<'a>>);

impl<'a> Ancestry<'a> {
    /// Of the patches of `chunk`, which is of the level of the first of `coarser`.
    fn of(
        mut chunk: ChunkId,
        lineage: &Lineage,
        coarser: &[Option<&'a LocalSet>],
        exitances: &'a [Vec<Rgb>],
    ) -> Self {
        let mut generations = Vec::with_capacity(coarser.len());
        for (view, exitances) in coarser.iter().zip(exitances) {
            let table = view.and_then(|view| view.slots_of(chunk));
            let slots = table.map_or(&[][..], SlotTable::slots);
            generations.push(Generation { slots, exitances, parents: lineage.of(chunk).cloned() });
            chunk = chunk.parent();
        }
        Self(generations)
    }

    /// What leaves patch `local` of the block, or the nearest of its ancestors that a view holds.
    fn exitance(&self, mut local: usize) -> Option<Rgb> {
        for generation in &self.0 {
            if let Some(&slot) = generation.slots.get(local).filter(|&&slot| slot != FREE) {
                return Some(generation.exitances[slot as usize]);
            }
            local = usize::from(*generation.parents.as_ref()?.get(local)?);
        }
        None
    }
}

/// What leaves the patches of each of `views`, by slot, lm/m2.
pub(crate) fn exitances_of(views: &[Option<&LocalSet>]) -> Vec<Vec<Rgb>> {
    views.iter().map(|view| view.map(LocalSet::exitances).unwrap_or_default()).collect()
}

/// Room for what parents send, used again tick by tick.
#[derive(Debug, Default)]
pub(crate) struct SentRoom(Vec<Sent>);

impl SentRoom {
    /// Room for `count` more, none of which is asked for yet. Returns where it begins.
    fn extend(&mut self, count: usize) -> usize {
        let start = self.0.len();
        self.0.resize(start + count, Sent::unknown());
        start
    }
}

/// What stands for patches that are not resident, by chunk: worked out once for the many rows that lead there.
pub(crate) struct FarSenders<'a> {
    coarser: Vec<Option<&'a LocalSet>>,
    exitances: &'a [Vec<Rgb>],
    places: BTreeMap<ChunkId, usize>,
    chunks: Vec<SendingChunk<'a>>,
    sent: &'a mut SentRoom,
}

/// Who stands for the patches of one chunk.
struct SendingChunk<'a> {
    parents: Option<Parents>,
    ancestry: Ancestry<'a>,
    /// Where in the room what stands for its patches begins.
    first: usize,
}

impl<'a> FarSenders<'a> {
    /// `coarser` views, finest first, one a level, and their [`exitances_of`].
    pub(crate) fn new(
        coarser: Vec<Option<&'a LocalSet>>,
        exitances: &'a [Vec<Rgb>],
        sent: &'a mut SentRoom,
    ) -> Self {
        sent.0.clear();
        Self { coarser, exitances, places: BTreeMap::new(), chunks: Vec::new(), sent }
    }

    /// The number by which [`Self::sent`] knows `chunk`.
    pub(crate) fn place(&mut self, chunk: ChunkId, lineage: &Lineage) -> usize {
        if let Some(&place) = self.places.get(&chunk) {
            return place;
        }
        let parents = lineage.of(chunk).cloned();
        let ancestry = Ancestry::of(chunk.parent(), lineage, &self.coarser, self.exitances);
        let first = self.sent.extend(parents.as_ref().map_or(0, |parents| parents.len()));
        self.chunks.push(SendingChunk { parents, ancestry, first });
        self.places.insert(chunk, self.chunks.len() - 1);
        self.chunks.len() - 1
    }

    /// Numbers of the parents of the patches of the chunk at `place`, in the chunk's parent.
    pub(crate) fn parents(&self, place: usize) -> &[u16] {
        self.chunks[place].parents.as_deref().unwrap_or_default()
    }

    /// What parent `parent` of the chunk at `place` sends, as [`Self::sent`]; worked out each time.
    pub(crate) fn sent_by(&self, place: usize, parent: u16) -> Vec4 {
        let exitance = self.chunks[place].ancestry.exitance(usize::from(parent));
        exitance.map_or(Vec4::ZERO, |exitance| exitance.extend(1.0))
    }

    /// What stands for patch `patch` of the chunk at `place`: red, green, blue, and one if that is known, else all zero.
    pub(crate) fn sent(&self, place: usize, patch: usize) -> Vec4 {
        let SendingChunk { parents, ancestry, first } = &self.chunks[place];
        // One that is not listed has no parent.
        let Some(&parent) = parents.as_ref().and_then(|parents| parents.get(patch)) else {
            return Vec4::ZERO;
        };
        self.sent.0[first + patch].get(|| ancestry.exitance(usize::from(parent)))
    }
}

/// Gathers far light of every slot of `local` from the views above it, finest first, one a level; a level that has no
/// local set for now is passed over. Returns whether any changed.
pub(crate) fn gather(local: &mut LocalSet, coarser: &[Option<&LocalSet>]) -> bool {
    local.moved.clear();
    gather_those(local, coarser, |_| true)
}

/// As [`gather`], of those slots alone for which `is_asked`.
pub(crate) fn gather_those(
    local: &mut LocalSet,
    coarser: &[Option<&LocalSet>],
    is_asked: impl Fn(&Resident) -> bool,
) -> bool {
    let Some(field) = &mut local.far else { return false };
    let mut room = std::mem::take(&mut field.sent);
    room.0.clear();
    room.extend(field.parent_count);
    let field = &*field;
    let exitances = exitances_of(coarser);
    let ancestries = field.ancestries(coarser, &exitances);
    let sent = |far: &FarShare| {
        let (block, parent) = (far.block as usize, usize::from(far.parent));
        let at = field.starts[block] as usize + parent;
        room.0[at].get(|| ancestries[block].as_ref().and_then(|ancestry| ancestry.exitance(parent)))
    };
    let mut changed = false;
    for resident in local.residents.iter_mut().flatten().filter(|resident| is_asked(resident)) {
        // Some hundred products of one sign: `f32` is enough.
        let mut sum = Vec4::ZERO;
        for far in resident.split.parents.iter().filter(|far| far.share > 0.0) {
            sum += far.share as f32 * sent(far);
        }
        changed |= resident.take_far(sum.truncate(), sum.w);
    }
    drop(ancestries);
    if let Some(field) = &mut local.far {
        field.sent = room;
    }
    changed
}
