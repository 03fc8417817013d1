//! Where rows lie in a buffer that all share: regions of powers of two, used again once the device is done with them.

/// Room for some items.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Region {
    pub(super) first: u32,
    /// Power of two.
    class: u8,
}

impl Region {
    /// Items it has room for.
    pub(super) fn room(self) -> u32 {
        1 << self.class
    }
}

/// The smallest region, as a power of two.
const CLASS_MIN: u32 = 4;

/// Regions in use and free ones.
#[derive(Debug, Default)]
pub(super) struct Pool {
    /// By class.
    free: Vec<Vec<u32>>,
    /// Given back, and read by the device until what was submitted is done.
    retired: Vec<Region>,
    /// One past the last region.
    end: u32,
}

impl Pool {
    /// A region of at least `count` items.
    pub(super) fn take(&mut self, count: u32) -> Region {
        let class = count.max(1 << CLASS_MIN).next_power_of_two().trailing_zeros() as u8;
        let first = match self.free.get_mut(usize::from(class)).and_then(Vec::pop) {
            Some(first) => first,
            None => {
                let first = self.end;
                self.end += 1 << class;
                first
            }
        };
        Region { first, class }
    }

    /// Gives a region back; it is used again after the next [`Self::settle`].
    pub(super) fn retire(&mut self, region: Region) {
        self.retired.push(region);
    }

    /// What was retired is free: whatever reads it was submitted before whatever writes it next.
    pub(super) fn settle(&mut self) {
        for region in self.retired.drain(..) {
            let class = usize::from(region.class);
            if self.free.len() <= class {
                self.free.resize_with(class + 1, Vec::new);
            }
            self.free[class].push(region.first);
        }
    }

    /// Items that the buffer has to have room for.
    pub(super) fn end(&self) -> u64 {
        u64::from(self.end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_never_overlap_and_are_used_again_only_after_a_submission() {
        let mut pool = Pool::default();
        let regions: Vec<Region> = [1, 16, 17, 1000, 0].map(|count| pool.take(count)).to_vec();
        assert_eq!(regions.iter().map(|region| region.room()).collect::<Vec<_>>(), [16, 16, 32, 1024, 16]);
        let mut places: Vec<u32> =
            regions.iter().flat_map(|region| region.first..region.first + region.room()).collect();
        places.sort_unstable();
        assert!(places.iter().copied().eq(0..pool.end), "each once");
        pool.retire(regions[3]);
        assert_ne!(pool.take(900), regions[3]);
        pool.settle();
        assert_eq!(pool.take(900), regions[3]);
    }
}
