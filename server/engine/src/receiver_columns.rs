//! What the columns of rows stand for at one moment, as a table for whoever gathers them elsewhere.
//!
//! One entry for each patch of each chunk that rows lead to: its slot, or else the coarse parent that stands for it.
//! Parents are numbered whether they are needed or not, so that an entry changes only if its patch comes or goes.

use crate::far::FarSenders;
use crate::local_set::LocalSet;
use crate::slots::{FREE, SlotTable};
use earthshine_radiosity::receivers::{ColumnSpan, NO_SOURCE, ReceiverGather, ReceiverRow, RowsOf};
use earthshine_world::lineage::Lineage;
use earthshine_world::{Chunk, ChunkId, Rgb, Sky, Vec4};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Of a parent that no column has asked for.
const NOT_ASKED: f32 = -1.0;

/// Columns of some chunks' rows.
pub(crate) struct ReceiverColumns<'a> {
    rows_of: RowsOf,
    local: &'a LocalSet,
    chunks: Vec<&'a Arc<Chunk>>,
    first_spans: Vec<u32>,
    spans: Vec<ColumnSpan>,
    columns: Vec<u32>,
    sources: Vec<Vec4>,
    slot_count: u32,
    by_segment: BTreeMap<ChunkId, ColumnSpan>,
    /// By coarse chunk and number: the place among `sources`.
    parents: BTreeMap<ChunkId, Vec<u32>>,
}

impl<'a> ReceiverColumns<'a> {
    /// Of no chunk yet, with what leaves each slot of `local`.
    pub(crate) fn new(rows_of: RowsOf, local: &'a LocalSet, exitances: Vec<Rgb>) -> Self {
        Self {
            rows_of,
            chunks: Vec::new(),
            first_spans: Vec::new(),
            spans: Vec::new(),
            columns: Vec::new(),
            sources: exitances.into_iter().map(|exitance| exitance.extend(0.0)).collect(),
            slot_count: local.capacity(),
            by_segment: BTreeMap::new(),
            parents: BTreeMap::new(),
            local,
        }
    }

    /// Lists what the rows of `chunk` lead to. Returns its number among the chunks.
    pub(crate) fn add(&mut self, chunk: &'a Arc<Chunk>, lineage: &Lineage, far: &mut FarSenders<'_>) -> u32 {
        self.chunks.push(chunk);
        self.first_spans.push(self.spans.len() as u32);
        for &segment in &self.rows_of.of(chunk).segments {
            let span = match self.by_segment.get(&segment) {
                Some(&span) => span,
                None => self.list(segment, lineage, far),
            };
            self.spans.push(span);
        }
        self.chunks.len() as u32 - 1
    }

    fn list(&mut self, segment: ChunkId, lineage: &Lineage, far: &mut FarSenders<'_>) -> ColumnSpan {
        let place = far.place(segment, lineage);
        let parents = far.parents(place);
        let slots = self.local.slots_of(segment).map_or(&[][..], SlotTable::slots);
        let numbers = self.parents.entry(segment.parent()).or_default();
        let first = self.columns.len() as u32;
        for patch in 0..slots.len().max(parents.len()) {
            let parent = parents.get(patch).map(|&parent| {
                let at = usize::from(parent);
                numbers.resize(numbers.len().max(at + 1), NO_SOURCE);
                if numbers[at] == NO_SOURCE {
                    numbers[at] = self.sources.len() as u32;
                    self.sources.push(Vec4::splat(NOT_ASKED));
                }
                (parent, numbers[at])
            });
            let slot = slots.get(patch).copied().filter(|&slot| slot != FREE);
            self.columns.push(match (slot, parent) {
                (Some(slot), _) => slot,
                (None, Some((parent, number))) => {
                    let sent = &mut self.sources[number as usize];
                    if sent.w == NOT_ASKED {
                        *sent = far.sent_by(place, parent);
                    }
                    number
                }
                (None, None) => NO_SOURCE,
            });
        }
        let span = ColumnSpan { first, count: self.columns.len() as u32 - first };
        self.by_segment.insert(segment, span);
        span
    }

    /// The question for the light of `rows` under `sky`.
    pub(crate) fn gather<'b>(&'b mut self, sky: &'b Sky, rows: &'b [ReceiverRow]) -> ReceiverGather<'b> {
        for sent in self.sources.iter_mut().filter(|sent| sent.w == NOT_ASKED) {
            *sent = Vec4::ZERO;
        }
        ReceiverGather {
            rows_of: self.rows_of,
            chunks: &self.chunks,
            first_spans: &self.first_spans,
            spans: &self.spans,
            columns: &self.columns,
            sources: &self.sources,
            slot_count: self.slot_count,
            sky,
            rows,
        }
    }
}
