//! Far light of one local set, gathered by somebody else from the rows of its patches; the tick waits for it.
//!
//! The CPU sums each row's far columns by parent ([`crate::far`]); a device has the rows and sums over columns, of which a
//! table says who is far. Both come to the same but for rounding.

use crate::far::{FarSenders, exitances_of};
use crate::gatherer::Gatherer;
use crate::local_set::LocalSet;
use crate::receiver_columns::ReceiverColumns;
use earthshine_radiosity::receivers::{ReceiverRow, ReceiverSums, RowsOf};
use earthshine_world::{ChunkId, Rgb, Sky};
use std::collections::BTreeMap;

/// Gathers far light of every slot of `local` from the views above it, as [`crate::far::gather`]; nothing where the CPU has to.
pub(crate) fn gather(
    gatherer: &mut Gatherer,
    local: &mut LocalSet,
    coarser: &[Option<&LocalSet>],
) -> Option<bool> {
    if local.far.is_none() || local.len() == 0 {
        return None;
    }
    let (light, rows_max) = gatherer.ready()?;
    if local.len() as usize > rows_max {
        return None;
    }
    let Some(sums) =
        sums_of(local, coarser, |columns, rows| light.gather_now(&columns.gather(&Sky::default(), rows)))
    else {
        gatherer.rest();
        return None;
    };
    let mut changed = false;
    for (resident, sums) in local.residents.iter_mut().flatten().zip(&sums) {
        changed |= resident.take_far(sums.far_irradiance, sums.fed_share);
    }
    Some(changed)
}

/// Asks about the rows of all residents, ascending by slot.
fn sums_of(
    local: &LocalSet,
    coarser: &[Option<&LocalSet>],
    ask: impl FnOnce(&mut ReceiverColumns<'_>, &[ReceiverRow]) -> Option<Vec<ReceiverSums>>,
) -> Option<Vec<ReceiverSums>> {
    let exitances = exitances_of(coarser);
    let mut far = FarSenders::new(coarser.to_vec(), &exitances);
    // What residents send arrives by way of the backend.
    let dark = vec![Rgb::ZERO; local.capacity() as usize];
    let mut columns = ReceiverColumns::new(RowsOf::Patches, local, dark);
    let mut numbers: BTreeMap<ChunkId, u32> = BTreeMap::new();
    for table in local.tables() {
        numbers.insert(table.chunk.id, columns.add(&table.chunk, &table.lineage, &mut far));
    }
    let rows: Vec<ReceiverRow> = local
        .iter()
        .map(|(_, of)| ReceiverRow { chunk: numbers[&of.id.chunk], row: u32::from(of.id.local) })
        .collect();
    ask(&mut columns, &rows)
}
