//! Far light of one local set: which coarse parents stand for the columns that are not resident, and what they send.
//!
//! Each slot keeps its far columns summed by parent, one level up. A parent's exitance is known where some coarser view of
//! the session holds it; else its own parent stands for it, and so on up to the top. What no view holds is a gap: it
//! brings no light, is counted, and is never given to the sky. Coupling goes one way, coarse to fine.

use crate::local_set::LocalSet;
use crate::slots::{FREE, SlotTable};
use earthshine_world::lineage::{Lineage, Parents};
use earthshine_world::{Chunk, ChunkId, PatchId, Rgb};
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
    pub(crate) share: f32,
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
    /// What each parent sends, and the gathering that found it.
    sent: Vec<(u64, Option<Rgb>)>,
}

/// The parents of one local set.
#[derive(Debug, Default)]
pub(crate) struct FarField {
    blocks: Vec<Option<Block>>,
    free: BTreeSet<u32>,
    by_chunk: BTreeMap<ChunkId, u32>,
    gathering: u64,
}

impl FarField {
    /// Finds the parents of every segment of `chunk`; [`Self::release`] is its undoing.
    pub(crate) fn acquire(&mut self, chunk: &Chunk, lineage: &Arc<Lineage>) -> Vec<Option<FarSegment>> {
        let segment = |&id: &ChunkId| {
            let parents = Arc::clone(lineage.of(id)?);
            let parent_count = parents.iter().max().map_or(0, |&last| usize::from(last) + 1);
            let block = self.block_of(id.parent(), lineage);
            let entry = self.blocks[block as usize].as_mut().expect("a block in the index is there");
            entry.users += 1;
            entry.sent.resize(entry.sent.len().max(parent_count), (0, None));
            Some(FarSegment { block, parents })
        };
        chunk.rows.segments.iter().map(segment).collect()
    }

    fn block_of(&mut self, chunk: ChunkId, lineage: &Arc<Lineage>) -> u32 {
        if let Some(&block) = self.by_chunk.get(&chunk) {
            return block;
        }
        let fresh = Some(Block { chunk, users: 0, lineage: Arc::clone(lineage), sent: Vec::new() });
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
    }

    /// Users of all blocks: the segments with parents of all tables.
    pub(crate) fn user_count(&self) -> u32 {
        self.blocks.iter().flatten().map(|block| block.users).sum()
    }

    /// A new gathering: what parents send has to be looked up again.
    fn begin(&mut self) {
        self.gathering += 1;
    }

    fn sent(&mut self, far: &FarShare, coarser: &[&LocalSet]) -> Option<Rgb> {
        let block = self.blocks[far.block as usize].as_mut().expect("a used block is there");
        let (found_in, sent) = &mut block.sent[usize::from(far.parent)];
        if *found_in != self.gathering {
            *found_in = self.gathering;
            *sent = exitance(PatchId { chunk: block.chunk, local: far.parent }, &block.lineage, coarser);
        }
        *sent
    }
}

/// What leaves `patch`, or the nearest of its ancestors that one of `coarser` (finest first, from the patch's level on) holds.
fn exitance(mut patch: PatchId, lineage: &Lineage, coarser: &[&LocalSet]) -> Option<Rgb> {
    for (step, view) in coarser.iter().enumerate() {
        if step > 0 {
            patch = lineage.parent(patch)?;
        }
        if let Some(slot) = view.slot_of(patch) {
            let resident = view.resident(slot);
            return Some(resident.light.exitance(&resident.patch));
        }
    }
    None
}

/// The far columns of row `local` of `table`'s chunk by parent, ascending. What has no known parent is left out.
pub(crate) fn far_shares(table: &SlotTable, segments: &[&[u32]], local: usize) -> Vec<FarShare> {
    let mut found: Vec<(u64, f64)> = Vec::new();
    for (column, share) in table.chunk.rows.row(local) {
        let place = usize::from(column.local);
        if segments[usize::from(column.segment)].get(place).is_some_and(|&slot| slot != FREE) {
            continue;
        }
        let Some(segment) = &table.far_segments[usize::from(column.segment)] else { continue };
        let Some(&parent) = segment.parents.get(place) else { continue };
        let key = u64::from(segment.block) << 16 | u64::from(parent);
        match found.last_mut() {
            Some((last, sum)) if *last == key => *sum += f64::from(share),
            _ => found.push((key, f64::from(share))),
        }
    }
    // Stable: equal keys are summed in the row's order.
    found.sort_by_key(|&(key, _)| key);
    found
        .chunk_by(|a, b| a.0 == b.0)
        .map(|run| FarShare {
            block: (run[0].0 >> 16) as u32,
            parent: (run[0].0 & 0xFFFF) as u16,
            share: run.iter().map(|&(_, share)| share).sum::<f64>() as f32,
        })
        .collect()
}

/// Gathers far light of every slot of `local` from `coarser` views, finest first. Returns whether any changed.
pub(crate) fn gather(local: &mut LocalSet, coarser: &[&LocalSet]) -> bool {
    let Some(mut field) = local.far.take() else { return false };
    field.begin();
    let mut changed = false;
    for resident in local.residents.iter_mut().flatten() {
        let (mut light, mut fed) = ([0.0f64; 3], 0.0f64);
        for far in &resident.far {
            if let Some(sent) = field.sent(far, coarser) {
                let share = f64::from(far.share);
                fed += share;
                for (sum, sent) in light.iter_mut().zip(sent.to_array()) {
                    *sum += share * f64::from(sent);
                }
            }
        }
        let light = Rgb::from_array(light.map(|sum| sum as f32));
        changed |= (light, fed as f32) != (resident.light.far_irradiance, resident.fed_share);
        resident.light.far_irradiance = light;
        resident.fed_share = fed as f32;
    }
    local.far = Some(field);
    changed
}
