//! Split and pack: the table in parts that know nothing of each other, one a thread.
//!
//! Lehmann, Huebschle-Schneider and Sanders (2021), section 5. The sweep places light item `i` while the lights before it
//! lack less than the heavy items up to `j` have to spare, `D[i-1] < S[j]`, else heavy item `j`. That is the merge of two
//! ascending sequences, so where part `p` begins is found by bisection along a diagonal: **split**. From there a thread
//! sweeps its own part: **pack**.

use super::alias_table::AliasBin;
use super::masses::UNITS;

/// Light and heavy items of a row in its own order, and inclusive sums of what they lack and have to spare.
#[derive(Debug, Default)]
pub(super) struct Partition {
    pub(super) light: Vec<u32>,
    pub(super) heavy: Vec<u32>,
    /// `D`: what the lights up to each lack of a bin.
    pub(super) deficits: Vec<u32>,
    /// `S`: what the heavy ones up to each hold beyond a bin.
    pub(super) surpluses: Vec<u32>,
}

impl Partition {
    pub(super) fn of(masses: &[u32]) -> Self {
        let mut partition = Self::default();
        let (mut deficit, mut surplus) = (0, 0);
        for (place, &mass) in (0u32..).zip(masses) {
            if mass < UNITS {
                deficit += UNITS - mass;
                partition.light.push(place);
                partition.deficits.push(deficit);
            } else {
                surplus += mass - UNITS;
                partition.heavy.push(place);
                partition.surpluses.push(surplus);
            }
        }
        partition
    }

    /// `D` of the lights before light `i`.
    pub(super) fn deficit_before(&self, i: usize) -> u32 {
        if i == 0 { 0 } else { self.deficits[i - 1] }
    }

    /// How many of the first `placed` bins that the sweep fills are light: bisection along the diagonal.
    fn split(&self, placed: usize) -> usize {
        let (mut low, mut high) = (placed.saturating_sub(self.heavy.len()), placed.min(self.light.len()));
        while low < high {
            let i = (low + high) / 2;
            // Light `i` comes before heavy `placed - 1 - i`, so at least `i + 1` lights are among the first.
            if self.deficit_before(i) < self.surpluses[placed - 1 - i] {
                low = i + 1;
            } else {
                high = i;
            }
        }
        low
    }
}

/// Fills `bins` in `parts` parts, each as a thread of a workgroup would. The same bits as [`sweep`](super::sweep).
///
/// # Panics
/// If the lengths differ or there are no parts.
pub fn split_pack(masses: &[u32], parts: usize, bins: &mut [AliasBin]) {
    assert_eq!(masses.len(), bins.len(), "a bin an item");
    let partition = Partition::of(masses);
    for part in 0..parts {
        let (first, end) = (masses.len() * part / parts, masses.len() * (part + 1) / parts);
        pack(masses, &partition, first..end, bins);
    }
}

/// Fills the bins that the sweep fills in steps `steps`.
fn pack(masses: &[u32], partition: &Partition, steps: std::ops::Range<usize>, bins: &mut [AliasBin]) {
    let mut i = partition.split(steps.start);
    let mut j = steps.start - i;
    for _ in steps {
        let surplus = partition.surpluses.get(j);
        if i < partition.light.len() && surplus.is_some_and(|&surplus| partition.deficit_before(i) < surplus)
        {
            let place = partition.light[i];
            bins[place as usize] = AliasBin::new(place, masses[place as usize], partition.heavy[j]);
            i += 1;
        } else {
            let place = partition.heavy[j];
            let keep = UNITS + partition.surpluses[j] - partition.deficit_before(i);
            let alias = partition.heavy.get(j + 1).copied().unwrap_or(place);
            bins[place as usize] = AliasBin::new(place, keep, alias);
            j += 1;
        }
    }
}
