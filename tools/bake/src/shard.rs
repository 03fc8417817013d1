//! Which chunks a process works on first, where several bake one world.
//!
//! Every process goes over its own share forwards and then, as whoever finds the others slow or gone, over theirs
//! from the end. So one process alone finishes any bake, none ever waits for another, and two that meet have little
//! in common.

use crate::BakeError;
use rayon::prelude::*;

/// One of several processes that bake the same world into the same folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// 0 to `count - 1`.
    pub index: u32,
    /// At least 1.
    pub count: u32,
}

impl Default for Shard {
    fn default() -> Self {
        Self { index: 0, count: 1 }
    }
}

impl Shard {
    /// Most processes.
    pub const COUNT_MAX: u32 = 65_536;

    /// The numbers 0 to `count - 1` in the order in which to work on them: first its own share, then the others'.
    #[must_use]
    pub fn shares(self, count: usize) -> Vec<Vec<usize>> {
        let bound = |share: u32| (count as u64 * u64::from(share) / u64::from(self.count)) as usize;
        (0..self.count)
            .map(|step| {
                let share = (self.index + step) % self.count;
                let range = bound(share)..bound(share + 1);
                if step == 0 { range.collect() } else { range.rev().collect() }
            })
            .collect()
    }
}

/// The shares of `shard` over the chunks at `coords`: neighbours in the world are neighbours in a share (Morton order).
pub(crate) fn visits(shard: Shard, coords: &[[i32; 3]]) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..coords.len()).collect();
    order.sort_by_key(|&index| morton_of_chunk(coords[index]));
    let shares = shard.shares(coords.len()).into_iter();
    shares.map(|share| share.into_iter().map(|place| order[place]).collect()).collect()
}

/// Does `work` for every number in `visits`, share after share, on all threads. Results in no particular order.
pub(crate) fn for_all<T: Send>(
    visits: &[Vec<usize>],
    work: impl Fn(usize) -> Result<T, BakeError> + Sync,
) -> Result<Vec<T>, BakeError> {
    let mut results = Vec::new();
    for share in visits {
        results.extend(share.par_iter().map(|&number| work(number)).collect::<Result<Vec<T>, _>>()?);
    }
    Ok(results)
}

/// Interleaves the low 21 bits of three coordinates, of which the lowest is -2^20.
fn morton_of_chunk(coord: [i32; 3]) -> u64 {
    let spread = |value: i32| {
        let value = u64::from((value + (1 << 20)).cast_unsigned());
        (0..21).fold(0u64, |code, bit| code | (value >> bit & 1) << (3 * bit))
    };
    spread(coord[0]) | spread(coord[1]) << 1 | spread(coord[2]) << 2
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text
            .split_once('/')
            .and_then(|(index, count)| Some(Self { index: index.parse().ok()?, count: count.parse().ok()? }));
        let is_possible = |shard: &Self| shard.index < shard.count && shard.count <= Self::COUNT_MAX;
        parsed
            .filter(is_possible)
            .ok_or_else(|| format!("{text:?} is no shard: write i/n with i from 0 to n - 1, as in 0/4"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shard_visits_everything_its_own_first() {
        let shard: Shard = "1/3".parse().unwrap();
        assert_eq!(shard.shares(10), [vec![3, 4, 5], vec![9, 8, 7, 6], vec![2, 1, 0]]);
        assert_eq!(Shard::default().shares(3), [vec![0, 1, 2]]);
        for wrong in ["", "1", "3/3", "0/0", "-1/2", "1/99999"] {
            assert!(wrong.parse::<Shard>().unwrap_err().contains("i/n"), "{wrong}");
        }
    }
}
