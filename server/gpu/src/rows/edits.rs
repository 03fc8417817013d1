//! Who comes and goes: collected on the host, run after run of one kind, and told to the device before it matters.

use super::GpuRowLight;
use super::passes::{groups, upload};
use super::pool::{Pool, Region};
use crate::recorder::folded;
use earthshine_radiosity::BackendError;
use earthshine_radiosity::solver::links::LinkRows;
use earthshine_shaders::host::{Link, Pass, RowEdit};
use earthshine_shaders::kernel::{CLEAR_SLOTS, EDIT_ROWS, FORGET_LEAVING};

/// Where a row is on the device, and how it is about to change.
#[derive(Debug, Clone, Copy, Default)]
struct Place {
    region: Option<Region>,
    /// Links on the device.
    count: u32,
    /// Links that are struck by the next flush.
    struck: u32,
    is_touched: bool,
}

/// Changes that the device has not been told.
#[derive(Debug)]
pub(super) struct Edits {
    pool: Pool,
    places: Vec<Place>,
    leaving: Vec<u32>,
    coming: Vec<u32>,
    /// Rows that a patch leaves.
    touched: Vec<u32>,
    /// Links of those who come and, back, of their neighbours: row and link.
    newcomers: Vec<(u32, Link)>,
}

impl Edits {
    /// Places for all rows, and their links in these places.
    pub(super) fn new(links: &LinkRows) -> (Self, Vec<Link>) {
        let mut pool = Pool::default();
        let mut uploaded = Vec::new();
        let place = |slot: usize| {
            let row = links.row(slot);
            if !links.is_taken(slot) {
                return Place::default();
            }
            let region = pool.take(row.len() as u32);
            uploaded.resize(pool.end() as usize, Link::default());
            for (to, link) in uploaded[region.first as usize..].iter_mut().zip(row) {
                *to = Link { slot: link.slot, share: link.share };
            }
            Place { region: Some(region), count: row.len() as u32, ..Place::default() }
        };
        let places = (0..links.capacity()).map(place).collect();
        let (leaving, coming, touched, newcomers) = Default::default();
        (Self { pool, places, leaving, coming, touched, newcomers }, uploaded)
    }

    /// Links of the rows of `slots`, as the device has them after the next flush.
    pub(super) fn links_of(&self, slots: impl IntoIterator<Item = u32>) -> u64 {
        slots.into_iter().map(|slot| u64::from(self.places[slot as usize].count)).sum()
    }

    /// A patch has come into `slot`; its links are there.
    pub(super) fn come(&mut self, links: &LinkRows, slot: usize) {
        self.coming.push(slot as u32);
        for link in links.row(slot) {
            self.newcomers.push((slot as u32, Link { slot: link.slot, share: link.share }));
            if link.slot as usize != slot {
                let share = link.share * links.area(slot) / links.area(link.slot as usize);
                self.newcomers.push((link.slot, Link { slot: slot as u32, share }));
            }
        }
    }

    /// The patch in `slot` goes; its links are still there.
    pub(super) fn leave(&mut self, links: &LinkRows, slot: usize) {
        self.leaving.push(slot as u32);
        for link in links.row(slot).iter().filter(|link| link.slot as usize != slot) {
            let place = &mut self.places[link.slot as usize];
            place.struck += 1;
            if !std::mem::replace(&mut place.is_touched, true) {
                self.touched.push(link.slot);
            }
        }
    }

    /// Strikes who leaves: what becomes of each row they are in, and of their own.
    fn strike(&mut self) -> Vec<RowEdit> {
        let mut edits = Vec::new();
        for &slot in &self.leaving {
            let place = std::mem::take(&mut self.places[slot as usize]);
            place.region.into_iter().for_each(|region| self.pool.retire(region));
            edits.push(RowEdit { slot, ..RowEdit::default() });
        }
        for slot in self.touched.drain(..) {
            let place = &mut self.places[slot as usize];
            // Who has left as well has no place any more.
            let Some(region) = place.region else { continue };
            let (old_first, old_count) = (region.first, place.count);
            edits.push(RowEdit { slot, old_first, old_count, first: old_first, ..RowEdit::default() });
            *place = Place { count: place.count - place.struck, struck: 0, is_touched: false, ..*place };
        }
        edits
    }

    /// Appends who comes, row by row; rows without room move. Returns the links to append as well.
    fn append(&mut self) -> (Vec<RowEdit>, Vec<Link>) {
        let mut newcomers = std::mem::take(&mut self.newcomers);
        // Rows without links have to be somewhere, too.
        let lonely = Link { slot: u32::MAX, share: 0.0 };
        newcomers.extend(self.coming.iter().map(|&slot| (slot, lonely)));
        newcomers.sort_by_key(|&(row, _)| row);
        let (mut edits, mut links) = (Vec::new(), Vec::new());
        for of_row in newcomers.chunk_by(|a, b| a.0 == b.0) {
            let first_new = links.len() as u32;
            links.extend(of_row.iter().map(|&(_, link)| link).filter(|link| *link != lonely));
            let new_count = links.len() as u32 - first_new;
            let slot = of_row[0].0;
            let place = &mut self.places[slot as usize];
            let count = place.count + new_count;
            let (old_first, old_count) = (place.region.map_or(0, |region| region.first), place.count);
            let region = match place.region.filter(|region| region.room() >= count) {
                Some(region) => region,
                None => {
                    place.region.into_iter().for_each(|region| self.pool.retire(region));
                    self.pool.take(count)
                }
            };
            (place.region, place.count) = (Some(region), count);
            edits.push(RowEdit { slot, old_first, old_count, first: region.first, first_new, new_count });
        }
        (edits, links)
    }
}

impl GpuRowLight {
    /// Sums all rows as they are.
    pub(super) fn sum_all_rows(&mut self) -> Result<(), BackendError> {
        let places = (0u32..).zip(&self.edits.places);
        let edit = |(slot, place): (u32, &Place)| {
            let (first, old_count) = (place.region?.first, place.count);
            Some(RowEdit { slot, old_first: first, old_count, first, ..RowEdit::default() })
        };
        let edits: Vec<RowEdit> = places.filter_map(edit).collect();
        self.edit_rows(&edits, &[], false)
    }

    /// Tells the device who has left.
    pub(super) fn flush_leaving(&mut self) -> Result<(), BackendError> {
        if self.edits.leaving.is_empty() {
            return Ok(());
        }
        let edits = self.edits.strike();
        let leaving = std::mem::take(&mut self.edits.leaving);
        let mut bits = vec![0u32; self.residents.len().div_ceil(32)];
        leaving.iter().for_each(|&slot| bits[slot as usize / 32] |= 1 << (slot % 32));
        upload(&self.device, &self.buffers.leaving, &bits, 0..bits.len());
        self.edit_rows(&edits, &[], true)?;
        self.buffers.some_slots.fill(&self.device, &leaving)?;
        for &slot in &leaving {
            self.residents[slot as usize] = Default::default();
            self.new_residents.mark(slot as usize);
        }
        let pass = Pass { entry_count: leaving.len() as u32, ..self.pass() };
        let (mut recorder, buffers) = self.recorder();
        let bound = [
            &buffers.some_slots.buffer,
            &buffers.own,
            &buffers.outside,
            &buffers.irradiance,
            &buffers.unshot,
            &buffers.arriving,
            &buffers.rest,
        ];
        recorder.dispatch(&CLEAR_SLOTS, &bound, pass, groups(pass));
        recorder.submit()?;
        self.upload_residents();
        Ok(())
    }

    /// Tells the device who has come, and lights them by what the others send.
    pub(super) fn flush_coming(&mut self) -> Result<(), BackendError> {
        if self.edits.coming.is_empty() {
            return Ok(());
        }
        self.upload_residents();
        let (edits, newcomers) = self.edits.append();
        self.edit_rows(&edits, &newcomers, false)?;
        let coming = std::mem::take(&mut self.edits.coming);
        self.buffers.some_slots.fill(&self.device, &coming)?;
        let pass = Pass { entry_count: coming.len() as u32, ..self.pass() };
        let links = self.edits.links_of(coming);
        let (mut recorder, buffers) = self.recorder();
        recorder.over(links).send_light(buffers, pass);
        // Nothing comes from outside before somebody says so.
        recorder.gather_rows(buffers, &buffers.some_slots.buffer, &buffers.dark, pass);
        recorder.take_gathered(buffers, &buffers.some_slots.buffer, 0.0, pass);
        recorder.submit().map(|_| ())
    }

    fn edit_rows(
        &mut self,
        edits: &[RowEdit],
        newcomers: &[Link],
        is_leaving: bool,
    ) -> Result<(), BackendError> {
        self.buffers.links.reserve(&self.device, self.edits.pool.end())?;
        self.buffers.edits.fill(&self.device, edits)?;
        self.buffers.newcomers.fill(&self.device, newcomers)?;
        let has_tables = self.tables.is_some();
        let entry_count = edits.len() as u32;
        let pass = Pass { entry_count, is_leaving: u32::from(is_leaving), ..self.pass() };
        let (mut recorder, buffers) = self.recorder();
        recorder.send_light(buffers, pass);
        let bound = [
            &buffers.edits.buffer,
            &buffers.leaving,
            &buffers.newcomers.buffer,
            &buffers.links.buffer,
            &buffers.rows,
            &buffers.outside_shares,
            &buffers.sent,
            &buffers.arriving,
        ];
        let items = |edit: &RowEdit| u64::from(edit.old_count) + u64::from(edit.new_count);
        recorder.over(edits.iter().map(items).sum());
        recorder.dispatch(&EDIT_ROWS, &bound, pass, folded(entry_count));
        if is_leaving && has_tables {
            let bound = [&buffers.edits.buffer, &buffers.leaving, &buffers.spans, &buffers.outcomes.buffer];
            recorder.dispatch(&FORGET_LEAVING, &bound, pass, folded(entry_count));
        }
        recorder.submit()?;
        self.edits.pool.settle();
        Ok(())
    }
}
