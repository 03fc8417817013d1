//! Receivers of one session that somebody else gathers: what is asked, what is under way, and when the CPU does it.
//!
//! One gather is under way at a time and nobody waits for it: its sums are taken by a later tick, as of the light that they
//! were asked for.

use crate::air::{AirKey, AirVoxel};
use crate::far::FarSenders;
use crate::gatherer::Gatherer;
use crate::local_set::LocalSet;
use crate::receiver_columns::ReceiverColumns;
use earthshine_radiosity::receivers::{ReceiverLight, ReceiverRow, ReceiverSums, RowsOf};
use earthshine_world::{Asked, Chunk, ChunkId, LightRig};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Voxels whose receivers are being gathered.
#[derive(Debug)]
pub(crate) struct UnderWay {
    /// Of the patches' light that they are gathered from.
    pub(crate) generation: u64,
    /// In the order asked, with the chunk that they were of.
    pub(crate) voxels: Vec<(AirKey, Arc<Chunk>)>,
}

/// Whoever gathers beside the CPU, if there is one.
#[derive(Debug, Default)]
pub(crate) struct AirDevice {
    gatherer: Gatherer,
    under_way: Option<UnderWay>,
}

impl AirDevice {
    /// Has `gatherer` gather from now on, as far as that can.
    pub(crate) fn new(gatherer: Box<dyn ReceiverLight>) -> Self {
        Self { gatherer: Gatherer::new(gatherer), under_way: None }
    }

    /// Nobody wants what is under way any more.
    pub(crate) fn forget(&mut self) {
        self.under_way = None;
    }

    /// What has come, if it has.
    pub(crate) fn take(&mut self) -> Option<(UnderWay, Vec<ReceiverSums>)> {
        let gathering = self.gatherer.light().filter(|_| self.under_way.is_some())?.take();
        match gathering {
            Asked::UnderWay => None,
            Asked::Lost => {
                self.under_way = None;
                None
            }
            Asked::Done(sums) => Some((self.under_way.take()?, sums)),
        }
    }

    /// Asks for the light of the voxels of `turn`, as many as one gather holds, with rows of all `voxels` at hand. Returns the
    /// rows asked for, none while others are under way; nothing where the CPU has to gather.
    pub(crate) fn hand_over<'a>(
        &mut self,
        voxels: &'a [AirVoxel],
        turn: impl Iterator<Item = &'a AirVoxel>,
        generation: u64,
        local: &LocalSet,
        far: &mut FarSenders<'_>,
        rig: &LightRig,
    ) -> Option<u32> {
        if self.under_way.is_some() {
            return Some(0);
        }
        let (gatherer, rows_max) = self.gatherer.ready()?;
        let mut columns = ReceiverColumns::new(RowsOf::Receivers, local, local.exitances());
        let mut numbers: BTreeMap<ChunkId, u32> = BTreeMap::new();
        for voxel in voxels {
            let number = || columns.add(&voxel.chunk, &voxel.lineage, far);
            numbers.entry(voxel.chunk.id).or_insert_with(number);
        }
        let (mut rows, mut asked) = (Vec::new(), Vec::new());
        for voxel in turn {
            if rows.len() + voxel.rows.len() > rows_max {
                break;
            }
            let chunk = numbers[&voxel.chunk.id];
            rows.extend(voxel.rows.clone().map(|row| ReceiverRow { chunk, row: row as u32 }));
            asked.push((voxel.key(), Arc::clone(&voxel.chunk)));
        }
        if rows.is_empty() || !gatherer.begin(&columns.gather(&rig.sky, &rows)) {
            self.gatherer.rest();
            return None;
        }
        self.under_way = Some(UnderWay { generation, voxels: asked });
        Some(rows.len() as u32)
    }
}
