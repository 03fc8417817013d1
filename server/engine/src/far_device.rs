//! Far light of one local set, gathered by somebody else from the rows of its patches; nobody waits for it.
//!
//! The CPU sums each row's far columns by parent ([`crate::far`]); a device has the rows and sums over columns, of which a
//! table says who is far. Both come to the same but for rounding, some ticks later. Until then [`crate::far_follow`] keeps what is
//! there, and what is on its way, true to who is resident.

use crate::far::{FarSenders, SentRoom, exitances_of};
use crate::gatherer::Gatherer;
use crate::local_set::LocalSet;
use crate::receiver_columns::ReceiverColumns;
use earthshine_radiosity::receivers::{ReceiverLight, ReceiverRow, RowsOf};
use earthshine_world::{Asked, ChunkId, Rgb, Sky, Vec4};
use std::collections::BTreeMap;

/// Whoever gathers far light beside the CPU, if there is one.
#[derive(Debug, Default)]
pub(crate) struct FarDevice {
    gatherer: Gatherer,
    /// Slots asked for. A patch that took one since does not know of it (`Resident::far_moved`).
    under_way: Option<Vec<u32>>,
}

/// What became of a gather that somebody was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FarTaken {
    /// There is none, or it has not come yet.
    Nothing,
    /// It was taken; whether any light is another, to the bit.
    Light(bool),
    /// It will not come.
    Lost,
}

/// Who gathers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FarAsked {
    /// Somebody else, as of now.
    Begun,
    /// Somebody else, once what is under way has come.
    Busy,
    /// The CPU has to.
    Refused,
}

impl FarDevice {
    /// Has `gatherer` gather from now on, as far as that can.
    pub(crate) fn new(gatherer: Box<dyn ReceiverLight>) -> Self {
        Self { gatherer: Gatherer::new(gatherer), under_way: None }
    }

    /// Whether there is anybody.
    pub(crate) fn is_there(&self) -> bool {
        self.gatherer.is_there()
    }

    /// Whether somebody gathers.
    pub(crate) fn is_under_way(&self) -> bool {
        self.under_way.is_some()
    }

    /// Nobody wants what is under way any more.
    pub(crate) fn forget(&mut self) {
        self.under_way = None;
    }

    /// Gives what has come to the patches that it was asked for, if they still hold their slots.
    pub(crate) fn take(&mut self, local: &mut LocalSet) -> FarTaken {
        let Some(light) = self.gatherer.light().filter(|_| self.under_way.is_some()) else {
            return FarTaken::Nothing;
        };
        let gathering = light.take();
        if gathering == Asked::UnderWay {
            return FarTaken::Nothing;
        }
        let asked = self.under_way.take().unwrap_or_default();
        let Asked::Done(sums) = gathering else { return FarTaken::Lost };
        let mut changed = false;
        for (slot, sums) in asked.into_iter().zip(&sums) {
            let resident = local.residents[slot as usize].as_mut();
            if let Some((resident, moved)) =
                resident.and_then(|of| of.far_moved.take().map(|moved| (of, moved)))
            {
                let far = (sums.far_irradiance.extend(sums.fed_share) + moved).max(Vec4::ZERO);
                changed |= resident.take_far(far.truncate(), far.w);
            }
        }
        FarTaken::Light(changed)
    }

    /// Has far light of every slot of `local` gathered from the views above it; who came and went has been followed.
    pub(crate) fn ask(&mut self, local: &mut LocalSet, coarser: &[Option<&LocalSet>]) -> FarAsked {
        if self.under_way.is_some() {
            return FarAsked::Busy;
        }
        if local.far.is_none() || local.len() == 0 {
            return FarAsked::Refused;
        }
        let Some((light, rows_max)) = self.gatherer.ready() else { return FarAsked::Refused };
        if local.len() as usize > rows_max {
            return FarAsked::Refused;
        }
        if !begin(&mut **light, local, coarser) {
            self.gatherer.rest();
            return FarAsked::Refused;
        }
        self.under_way = Some(local.iter().map(|(slot, _)| slot).collect());
        local.residents.iter_mut().flatten().for_each(|resident| resident.far_moved = Some(Vec4::ZERO));
        FarAsked::Begun
    }
}

/// Asks about the rows of all residents, ascending by slot.
fn begin(light: &mut dyn ReceiverLight, local: &LocalSet, coarser: &[Option<&LocalSet>]) -> bool {
    let (exitances, mut room) = (exitances_of(coarser), SentRoom::default());
    let mut far = FarSenders::new(coarser.to_vec(), &exitances, &mut room);
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
    light.begin(&columns.gather(&Sky::default(), &rows))
}
