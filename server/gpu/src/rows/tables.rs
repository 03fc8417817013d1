//! Tables of rows that have changed, built on the device: which ones and how many a frame is the host's to say.

use super::GpuRowLight;
use super::pool::{Pool, Region};
use crate::recorder::folded;
use earthshine_radiosity::BackendError;
use earthshine_radiosity::solver::links::LinkRows;
use earthshine_radiosity::solver::turns::Turns;
use earthshine_radiosity::solver::{Method, Residents};
use earthshine_radiosity::tables::SECTION_ITEMS_MAX;
use earthshine_shaders::host::{Pass, RowSpan, TableSpan};
use earthshine_shaders::kernel::{BUILD_ALIAS, BUILD_CDF, FILL_TABLES};
use std::convert::Infallible;

/// Whose tables are old, and where tables lie.
#[derive(Debug)]
pub(super) struct Tables {
    turns: Turns,
    pool: Pool,
    regions: Vec<Option<Region>>,
}

impl Tables {
    /// All rows wait.
    pub(super) fn new(links: &LinkRows) -> Self {
        Self { turns: Turns::new(links), pool: Pool::default(), regions: vec![None; links.capacity()] }
    }

    pub(super) fn come(&mut self, links: &LinkRows, slot: usize) {
        let neighbours = links.row(slot).iter().map(|link| link.slot as usize);
        neighbours.chain([slot]).for_each(|row| self.turns.outdate(row));
    }

    pub(super) fn leave(&mut self, links: &LinkRows, slot: usize) {
        links.row(slot).iter().for_each(|link| self.turns.outdate(link.slot as usize));
        self.turns.settle(slot);
        self.regions[slot].take().into_iter().for_each(|region| self.pool.retire(region));
    }

    pub(super) fn outdate(&mut self, slot: usize) {
        self.turns.outdate(slot);
    }

    /// What to build: about `items_max` items.
    fn choose(&mut self, links: &LinkRows, order: &[u32], items_max: u32) -> Builds {
        let Self { turns, pool, regions } = self;
        let mut builds = Builds::default();
        let done = turns.rebuild(order, items_max, |slot| {
            let item_count = links.row(slot).len() as u32 + 2;
            let sections = item_count.div_ceil(SECTION_ITEMS_MAX as u32);
            // A long alias table has its sections' bins on top.
            let bin_count = item_count + if sections > 1 { sections } else { 0 };
            let region = match regions[slot].filter(|region| region.room() >= bin_count) {
                Some(region) => region,
                None => {
                    regions[slot].into_iter().for_each(|region| pool.retire(region));
                    pool.take(bin_count)
                }
            };
            regions[slot] = Some(region);
            builds.push(slot as u32, item_count, sections, region.first);
            Ok::<_, Infallible>(item_count as usize)
        });
        let Ok(_) = done;
        builds
    }
}

/// Tables that are built together.
#[derive(Debug, Default)]
struct Builds {
    rows: Vec<RowSpan>,
    sections: Vec<TableSpan>,
    tops: Vec<TableSpan>,
    item_count: u32,
}

impl Builds {
    /// Weights lie one row after the other; bins where the table is.
    fn push(&mut self, slot: u32, item_count: u32, sections: u32, first_bin: u32) {
        let first_item = self.item_count;
        self.rows.push(RowSpan { first_item, item_count, first_bin, first_guide: first_bin, total_at: slot });
        let mut bin = first_bin;
        if sections > 1 {
            // Weights of a top table are totals of sections, which lie one after the other.
            let first_weight = self.sections.len() as u32;
            self.tops.push(TableSpan { first_weight, first_bin, item_count: sections });
            bin += sections;
        }
        for section in 0..sections {
            let before = section * SECTION_ITEMS_MAX as u32;
            let item_count = (item_count - before).min(SECTION_ITEMS_MAX as u32);
            let (first_weight, first_bin) = (first_item + before, bin + before);
            self.sections.push(TableSpan { first_weight, first_bin, item_count });
        }
        self.item_count += item_count;
    }
}

impl GpuRowLight {
    /// Rebuilds tables of changed rows, the first of `order` first, until `items_max` items are exceeded.
    pub(super) fn rebuild_tables(
        &mut self,
        residents: &Residents,
        order: &[u32],
        items_max: u32,
    ) -> Result<(), BackendError> {
        let Some(tables) = &mut self.tables else { return Ok(()) };
        let builds = tables.choose(&residents.links, order, items_max);
        if builds.rows.is_empty() {
            return Ok(());
        }
        self.reserve_for(&builds)?;
        let method = self.method;
        let pass = Pass { entry_count: builds.rows.len() as u32, ..self.pass() };
        let (mut recorder, buffers) = self.recorder();
        let bound = [
            &buffers.builds.buffer,
            &buffers.rows,
            &buffers.links.buffer,
            &buffers.sky_shares,
            &buffers.weights.buffer,
            &buffers.outcomes.buffer,
            &buffers.spans,
            &buffers.totals,
        ];
        recorder.over(u64::from(builds.item_count)).dispatch(
            &FILL_TABLES,
            &bound,
            pass,
            folded(pass.entry_count),
        );
        if method == Method::Alias {
            let stages = [
                (&buffers.sections, &builds.sections, &buffers.weights, &buffers.section_totals),
                (&buffers.tops, &builds.tops, &buffers.section_totals, &buffers.top_totals),
            ];
            for (spans, built, weights, totals) in
                stages.into_iter().filter(|(_, built, ..)| !built.is_empty())
            {
                let scratch = [&buffers.masses.buffer, &buffers.parts.buffer];
                let bound = [
                    &spans.buffer,
                    &weights.buffer,
                    scratch[0],
                    scratch[1],
                    &buffers.bins.buffer,
                    &totals.buffer,
                ];
                let pass = Pass { entry_count: built.len() as u32, ..pass };
                recorder.over(built.iter().map(|span| u64::from(span.item_count)).sum());
                recorder.dispatch(&BUILD_ALIAS, &bound, pass, folded(pass.entry_count));
            }
        } else {
            let tables = [&buffers.bins.buffer, &buffers.guide.buffer];
            let bound =
                [&buffers.builds.buffer, &buffers.weights.buffer, tables[0], tables[1], &buffers.totals];
            recorder.dispatch(&BUILD_CDF, &bound, pass, folded(pass.entry_count));
        }
        recorder.submit()?;
        if let Some(tables) = &mut self.tables {
            tables.pool.settle();
        }
        Ok(())
    }

    /// Room for the tables, and to build them in.
    fn reserve_for(&mut self, builds: &Builds) -> Result<(), BackendError> {
        let end = self.tables.as_ref().map_or(0, |tables| tables.pool.end());
        let (device, buffers, items) = (&self.device, &mut self.buffers, u64::from(builds.item_count));
        buffers.outcomes.reserve(device, end)?;
        buffers.bins.reserve(device, end)?;
        buffers.builds.fill(device, &builds.rows)?;
        buffers.weights.reserve(device, items)?;
        if self.method == Method::Alias {
            buffers.masses.reserve(device, items)?;
            buffers.parts.reserve(device, items)?;
            buffers.sections.fill(device, &builds.sections)?;
            buffers.section_totals.reserve(device, builds.sections.len() as u64)?;
            buffers.tops.fill(device, &builds.tops)?;
            buffers.top_totals.reserve(device, builds.tops.len() as u64)?;
        } else {
            buffers.guide.reserve(device, end)?;
        }
        Ok(())
    }
}
