//! [`CdfTable`]: a row's items along a line, as long as their weights; a draw finds where a number falls.
//!
//! Items in Morton order lie near each other on the line if they do in space, so systematic draws
//! ([`Spread::Systematic`](super::draw::Spread)) look at every part of space as often as it deserves. An alias table
//! scatters its items over its bins and cannot. Ends are integers of 31 bits: sums in any order give the same table.

use super::masses::masses_of;
use super::{BuildRoom, RowTable, TableError, negative_weights};

/// Length of the line.
const LINE: u32 = 1 << 31;
/// Most entries of a guide.
const GUIDE_MAX: usize = 1 << 12;

/// A row's cumulative distribution and a guide into it. Built by [`RowTable::rebuild`].
#[derive(Debug, Clone, Default)]
pub struct CdfTable {
    /// Where each item ends; the last item with weight ends at [`LINE`].
    ends: Vec<u32>,
    /// First item that may lie in each part of the line; a power of two of parts.
    guide: Vec<u32>,
    /// Bits that a place on the line is shifted by to find its part.
    shift: u32,
    total: f32,
}

impl CdfTable {
    /// Where each item ends on the line of `2^31`: the words that a shader reads.
    #[must_use]
    pub fn ends(&self) -> &[u32] {
        &self.ends
    }

    /// First item of each part of the line, and the shift from a place to its part.
    #[must_use]
    pub fn guide(&self) -> (&[u32], u32) {
        (&self.guide, self.shift)
    }

    /// What the table gives each item, as a share of the whole: for tests.
    #[must_use]
    pub fn shares(&self) -> Vec<f64> {
        let starts = std::iter::once(&0).chain(&self.ends);
        starts.zip(&self.ends).map(|(start, end)| f64::from(end - start) / f64::from(LINE)).collect()
    }

    fn build_guide(&mut self) {
        let parts = self.ends.len().next_power_of_two().min(GUIDE_MAX);
        self.shift = LINE.trailing_zeros() - parts.trailing_zeros();
        self.guide.clear();
        let mut item = 0u32;
        for part in 0..parts as u32 {
            while self.ends[item as usize] <= part << self.shift {
                item += 1;
            }
            self.guide.push(item);
        }
    }
}

impl RowTable for CdfTable {
    fn rebuild(&mut self, weights: &[f32], _room: &mut BuildRoom) -> Result<u32, TableError> {
        let negative = negative_weights(weights)?;
        self.ends.clear();
        self.guide.clear();
        self.ends.resize(weights.len(), 0);
        if weights.is_empty() {
            self.total = 0.0;
            return Ok(negative);
        }
        self.total = masses_of(weights, LINE, &mut self.ends);
        let mut end = 0;
        for mass in &mut self.ends {
            end += *mass;
            *mass = end;
        }
        if self.total == 0.0 {
            // Nobody looks, but whoever does shall find an item.
            self.ends.fill(LINE);
        }
        self.build_guide();
        Ok(negative)
    }

    fn total(&self) -> f32 {
        self.total
    }

    #[inline]
    fn draw(&self, random: u32) -> usize {
        if self.ends.is_empty() {
            return 0;
        }
        let place = random >> 1;
        let mut item = self.guide[(place >> self.shift) as usize] as usize;
        while self.ends[item] <= place {
            item += 1;
        }
        item
    }

    fn bytes(&self) -> usize {
        (self.ends.len() + self.guide.len()) * size_of::<u32>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tables::AliasTable;
    use crate::tables::draw::{Spread, random, row_key};
    use crate::tables::edge_rows::edge_rows;

    #[test]
    fn shares_are_the_weights() {
        for row in edge_rows() {
            let mut table = CdfTable::default();
            assert_eq!(table.rebuild(&row.weights, &mut BuildRoom::default()), Ok(0));
            let total: f64 = row.weights.iter().map(|&weight| f64::from(weight)).sum();
            if total == 0.0 {
                assert_eq!(table.total(), 0.0, "{}", row.name);
                continue;
            }
            for (item, (share, &weight)) in table.shares().iter().zip(&row.weights).enumerate() {
                let error_bins = (share - f64::from(weight) / total).abs() * row.weights.len() as f64;
                assert!(error_bins < 0.01, "{} {item}: {error_bins}", row.name);
                assert!(weight > 0.0 || *share == 0.0, "{} {item}", row.name);
            }
        }
    }

    /// Goal: the guide leads to where a search from the start ends. Method: all edge rows, draws over the whole line.
    #[test]
    fn the_guide_changes_nothing() {
        for row in edge_rows().iter().filter(|row| !row.weights.is_empty()) {
            let mut table = CdfTable::default();
            table.rebuild(&row.weights, &mut BuildRoom::default()).expect("finite");
            for sample in 0..5000 {
                let random = random(row_key(1, 2, 3), sample, 5000, Spread::Systematic);
                let expected = table.ends.partition_point(|&end| end <= random >> 1);
                assert_eq!(table.draw(random), expected, "{}", row.name);
            }
            assert!(table.draw(0) < row.weights.len() && table.draw(u32::MAX) < row.weights.len());
        }
    }

    /// Goal: what the table is for. Method: light that varies slowly along the row, 16 draws, both kinds of table and
    /// spread; the mean squared error of systematic draws on the line is far below that of independent ones.
    #[test]
    fn systematic_draws_in_order_err_less() {
        let weights: Vec<f32> = (0..900u16).map(|i| 1.0 + f32::from(i % 7)).collect();
        let light = |item: usize| (item as f32 / 150.0).sin() + 1.5;
        let exact: f32 = weights.iter().enumerate().map(|(item, weight)| weight * light(item)).sum();
        let (mut alias, mut cdf) = (AliasTable::default(), CdfTable::default());
        alias.rebuild(&weights, &mut BuildRoom::default()).expect("finite");
        cdf.rebuild(&weights, &mut BuildRoom::default()).expect("finite");
        let error = |table: &dyn Fn(u32) -> usize, spread| {
            let squares = (0..500).map(|frame| {
                let key = row_key(1, frame, 0);
                let sum: f32 = (0..16).map(|sample| light(table(random(key, sample, 16, spread)))).sum();
                (f64::from(alias.total() * sum / 16.0 - exact) / f64::from(exact)).powi(2)
            });
            (squares.sum::<f64>() / 500.0).sqrt()
        };
        let independent = error(&|random| alias.draw(random), Spread::Independent);
        let systematic = error(&|random| cdf.draw(random), Spread::Systematic);
        assert!(systematic * 8.0 < independent && independent < 0.2, "{systematic} {independent}");
    }

    #[test]
    fn weights_that_cannot_be_are_refused() {
        let mut table = CdfTable::default();
        assert!(table.rebuild(&[1.0, f32::NAN], &mut BuildRoom::default()).is_err());
        assert_eq!(table.rebuild(&[1.0, -0.5], &mut BuildRoom::default()), Ok(1));
        assert_eq!(table.shares(), [1.0, 0.0]);
    }
}
