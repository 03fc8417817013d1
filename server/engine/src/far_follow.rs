//! Far light between two gathers that somebody else does ([`crate::far_device`]): who comes or goes moves one column of each row that
//! sees it from one side to the other, and the light of the parent that stood for it with it.
//!
//! So nothing is counted twice, or missed, however late sums come; what parents send may have changed meanwhile, and newcomers'
//! own far light is gathered here.

use crate::far::{FarSenders, SentRoom, exitances_of, gather_those};
use crate::local_set::LocalSet;
use crate::row_split::Move;
use crate::slots::{FREE, visit_row};
use earthshine_world::{Chunk, PatchId, Vec4};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A patch that came or went after far light was last gathered or followed.
#[derive(Debug)]
pub(crate) struct Moved {
    pub(crate) id: PatchId,
    pub(crate) chunk: Arc<Chunk>,
    pub(crate) way: Move,
}

/// Brings the far light of `local` up to what came and went since; `coarser` as in [`crate::far::gather`]. Returns whether any
/// changed.
pub(crate) fn follow(local: &mut LocalSet, coarser: &[Option<&LocalSet>]) -> bool {
    let moved = std::mem::take(&mut local.moved);
    if moved.is_empty() {
        return false;
    }
    let (exitances, mut room) = (exitances_of(coarser), SentRoom::default());
    let mut far = FarSenders::new(coarser.to_vec(), &exitances, &mut room);
    let mut changes: BTreeMap<u32, Vec4> = BTreeMap::new();
    for Moved { id, chunk, way } in &moved {
        let inwards = if *way == Move::In { -1.0 } else { 1.0 };
        let (local_number, area) = (usize::from(id.local), chunk.patches[usize::from(id.local)].area);
        let mut sent = None;
        visit_row(&local.segment_slots(&chunk.rows), &chunk.rows, local_number, |slot, share| {
            if slot == FREE {
                return;
            }
            let neighbour = local.resident(slot);
            // Its row leads to the patch, so its lineage knows the patch's parents.
            let sent = *sent.get_or_insert_with(|| {
                let lineage =
                    &local.slots_of(neighbour.id.chunk).expect("a resident's chunk has a table").lineage;
                let place = far.place(id.chunk, lineage);
                far.sent(place, local_number)
            });
            let share = (share * area / neighbour.patch.area).min(1.0);
            *changes.entry(slot).or_default() += inwards * share * sent;
        });
    }
    let mut changed = false;
    for (slot, change) in changes {
        changed |= local.resident_mut(slot).shift_far(change);
    }
    gather_those(local, coarser, |resident| !resident.is_far_known) || changed
}
