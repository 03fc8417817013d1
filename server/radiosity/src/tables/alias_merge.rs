//! The table without packing: every item finds its own bin by one bisection, no order among them.
//!
//! ```text
//! light i   keeps mass_i                 alias: the first heavy j with S[j] > D[i-1]
//! heavy j   keeps 1 + S[j] - D[i*]       alias: heavy j + 1; i* is the first light with D[i*] >= S[j]
//! ```
//!
//! A heavy item that spares nothing before any light comes (`S[j] = 0`) is full, and so is the last. What split and pack
//! does by walking, this does by looking up: more reads, no loop that one lane has to finish for the others.

use super::alias_split::Partition;
use super::alias_table::AliasBin;
use super::masses::UNITS;

/// Fills `bins`, item by item, in any order. The same bits as [`sweep`](super::sweep). O(n log n).
///
/// # Panics
/// If the lengths differ.
pub fn merge(masses: &[u32], bins: &mut [AliasBin]) {
    assert_eq!(masses.len(), bins.len(), "a bin an item");
    let partition = Partition::of(masses);
    for (i, &place) in partition.light.iter().enumerate() {
        let before = partition.deficit_before(i);
        let j = partition.surpluses.partition_point(|&surplus| surplus <= before);
        bins[place as usize] = AliasBin::new(place, masses[place as usize], partition.heavy[j]);
    }
    for (j, &place) in partition.heavy.iter().enumerate() {
        let surplus = partition.surpluses[j];
        let i = partition.deficits.partition_point(|&deficit| deficit < surplus);
        let overdrawn =
            if surplus == 0 || i == partition.light.len() { 0 } else { partition.deficits[i] - surplus };
        let alias = partition.heavy.get(j + 1).copied().unwrap_or(place);
        bins[place as usize] = AliasBin::new(place, UNITS - overdrawn, alias);
    }
}
