//! [`AliasTable`]: a row's items in bins of four bytes, one read a draw.
//!
//! ```text
//! bin          │ keep (u16, high) │ alias (u16, low) │   keep = UNITS is written as alias = itself
//! table        │ a bin an item, up to 4,096 items
//! longer table │ a bin a section │ section 0: 4,096 bins │ section 1 │ ..        aliases count within their section
//! ```
//!
//! The words of a table are what a shader reads; see [`AliasTable::bins`].

use super::alias_sweep::sweep;
use super::draw::mix;
use super::masses::{UNITS, masses_of};
use super::{BuildRoom, RowTable, TableError, negative_weights};

/// Most items of a section: what one workgroup builds in its own memory.
pub const SECTION_ITEMS_MAX: usize = 4096;

/// Where a draw goes that hits an item's bin: it stays with the chance `keep / UNITS`, else it goes to the alias.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
#[repr(transparent)]
pub struct AliasBin(pub u32);

impl AliasBin {
    /// The bin of item `place`. One that keeps everything is its own alias, so that `keep` fits 16 bits.
    #[inline]
    #[must_use]
    pub const fn new(place: u32, keep: u32, alias: u32) -> Self {
        let is_full = keep >= UNITS;
        let keep = if is_full { UNITS - 1 } else { keep };
        let alias = if is_full { place } else { alias };
        Self(keep << 16 | (alias & 0xFFFF))
    }

    /// Units of the bin that are the item's own; the rest is the alias'.
    #[inline]
    #[must_use]
    pub const fn keep(self) -> u32 {
        self.0 >> 16
    }

    /// Whom the rest belongs to, counted within the section.
    #[inline]
    #[must_use]
    pub const fn alias(self) -> u32 {
        self.0 & 0xFFFF
    }
}

/// A row's alias table. Built by [`RowTable::rebuild`].
#[derive(Debug, Clone, Default)]
pub struct AliasTable {
    bins: Vec<AliasBin>,
    item_count: usize,
    total: f32,
}

impl AliasTable {
    /// Most items of a row: a full table of sections on top.
    pub const ITEMS_MAX: usize = SECTION_ITEMS_MAX * SECTION_ITEMS_MAX;

    /// The words that a shader reads: bins of the sections' totals first, if there is more than one, then all sections'.
    #[must_use]
    pub fn bins(&self) -> &[AliasBin] {
        &self.bins
    }

    /// Items of the row.
    #[must_use]
    pub fn item_count(&self) -> usize {
        self.item_count
    }

    fn section_count(&self) -> usize {
        self.item_count.div_ceil(SECTION_ITEMS_MAX)
    }

    /// What the table gives each item, as shares of the whole: for tests, exact up to one rounding a section.
    #[must_use]
    pub fn shares(&self) -> Vec<f64> {
        let sections = self.section_count();
        if sections <= 1 {
            return bin_shares(&self.bins);
        }
        let (top, rest) = self.bins.split_at(sections);
        let of_sections = bin_shares(top);
        let sections = rest.chunks(SECTION_ITEMS_MAX).zip(of_sections);
        sections.flat_map(|(bins, share)| bin_shares(bins).into_iter().map(move |own| own * share)).collect()
    }
}

/// Bin and place in it that `random` hits: the upper bits of `random * bins / 2^32`, in 32-bit words.
#[inline]
fn hit(bins: &[AliasBin], random: u32) -> usize {
    let n = bins.len() as u32;
    let position = (random >> 16) * n + (((random & 0xFFFF) * n) >> 16);
    let (place, within) = (position >> 16, position & 0xFFFF);
    let bin = bins[place as usize];
    // Strictly: what keeps nothing is never drawn.
    (if within < bin.keep() { place } else { bin.alias() }) as usize
}

/// Mass of each item over all bins, exactly, then as a share of all.
fn bin_shares(bins: &[AliasBin]) -> Vec<f64> {
    let all = bins.len() as f64 * f64::from(UNITS);
    bin_masses(bins).into_iter().map(|mass| mass as f64 / all).collect()
}

/// Mass of each item over all bins.
pub(super) fn bin_masses(bins: &[AliasBin]) -> Vec<u64> {
    let mut masses = vec![0u64; bins.len()];
    for (place, bin) in bins.iter().enumerate() {
        masses[place] += u64::from(bin.keep());
        masses[bin.alias() as usize] += u64::from(UNITS - bin.keep());
    }
    masses
}

/// Fills `bins` with the table of `weights`; returns their total.
fn build(weights: &[f32], room: &mut BuildRoom, bins: &mut [AliasBin]) -> f32 {
    room.masses.resize(weights.len(), 0);
    let total = masses_of(weights, weights.len() as u32 * UNITS, &mut room.masses);
    sweep(&room.masses, &mut room.sweep, bins);
    total
}

impl RowTable for AliasTable {
    fn rebuild(&mut self, weights: &[f32], room: &mut BuildRoom) -> Result<u32, TableError> {
        let negative = negative_weights(weights)?;
        self.item_count = weights.len();
        let sections = self.section_count();
        let top = if sections > 1 { sections } else { 0 };
        self.bins.clear();
        self.bins.resize(top + weights.len(), AliasBin::default());
        let (top, rest) = self.bins.split_at_mut(top);
        if top.is_empty() {
            self.total = build(weights, room, rest);
            return Ok(negative);
        }
        let sections = weights.chunks(SECTION_ITEMS_MAX).zip(rest.chunks_mut(SECTION_ITEMS_MAX));
        let totals: Vec<f32> = sections.map(|(weights, bins)| build(weights, room, bins)).collect();
        self.total = build(&totals, room, top);
        Ok(negative)
    }

    fn total(&self) -> f32 {
        self.total
    }

    #[inline]
    fn draw(&self, random: u32) -> usize {
        if self.item_count <= SECTION_ITEMS_MAX {
            return if self.bins.is_empty() { 0 } else { hit(&self.bins, random) };
        }
        let (top, rest) = self.bins.split_at(self.section_count());
        let first = hit(top, random) * SECTION_ITEMS_MAX;
        let end = (first + SECTION_ITEMS_MAX).min(rest.len());
        first + hit(&rest[first..end], mix(random))
    }

    fn bytes(&self) -> usize {
        self.bins.len() * size_of::<AliasBin>()
    }
}

const _: () = assert!(size_of::<AliasBin>() == 4, "a bin is four bytes in memory and in shaders");

#[cfg(test)]
mod tests;
