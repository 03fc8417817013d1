//! From a voxel's number to its place in a list, in pages: what has no light takes next to no memory.
//!
//! Few voxels of a box are lit, and those lie along surfaces. A table over all of them would be megabytes that each copy and
//! each move of a volume goes through; here a directory leads from each run of voxels to a page, or to none. Pages that
//! nothing lies in are used again.

/// Voxels of one page: a run along x, mostly.
const RUN: usize = 64;

/// Places by voxel.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Places {
    /// One a run: 0 for no page, else one more than its number.
    directory: Vec<u32>,
    pages: Vec<Page>,
    /// Pages in which nothing lies.
    free: Vec<u32>,
    voxel_count: u32,
}

#[derive(Debug, Clone, PartialEq)]
struct Page {
    /// By voxel of the run: 0 for none, else one more than the place.
    places: [u32; RUN],
    taken: u32,
}

impl Page {
    const EMPTY: Self = Self { places: [0; RUN], taken: 0 };
}

impl Places {
    /// None taken, of `voxel_count` voxels: four bytes a run.
    pub(crate) fn new(voxel_count: u32) -> Self {
        let directory = vec![0; (voxel_count as usize).div_ceil(RUN)];
        Self { directory, pages: Vec::new(), free: Vec::new(), voxel_count }
    }

    /// Whether there is a voxel `index`.
    pub(crate) fn has(&self, index: u32) -> bool {
        index < self.voxel_count
    }

    /// The place of voxel `index`; `None` without one, and outside.
    pub(crate) fn get(&self, index: u32) -> Option<u32> {
        let (run, at) = split(index);
        let page = self.directory.get(run)?.checked_sub(1)?;
        self.pages[page as usize].places[at].checked_sub(1)
    }

    /// Gives voxel `index`, which is there, `place`, or another one than it had.
    pub(crate) fn set(&mut self, index: u32, place: u32) {
        let (run, at) = split(index);
        if self.directory[run] == 0 {
            let page = self.free.pop().unwrap_or_else(|| {
                self.pages.push(Page::EMPTY);
                // Fewer than runs.
                self.pages.len() as u32 - 1
            });
            self.directory[run] = page + 1;
        }
        let page = &mut self.pages[self.directory[run] as usize - 1];
        page.taken += u32::from(page.places[at] == 0);
        page.places[at] = place + 1;
    }

    /// Takes the place of voxel `index` away, if it has one.
    pub(crate) fn remove(&mut self, index: u32) {
        let (run, at) = split(index);
        let Some(number) = self.directory.get(run).and_then(|page| page.checked_sub(1)) else { return };
        let page = &mut self.pages[number as usize];
        if std::mem::take(&mut page.places[at]) != 0 {
            page.taken -= 1;
            if page.taken == 0 {
                self.directory[run] = 0;
                self.free.push(number);
            }
        }
    }

    /// Takes all away.
    pub(crate) fn clear(&mut self) {
        self.directory.fill(0);
        self.pages.clear();
        self.free.clear();
    }
}

fn split(index: u32) -> (usize, usize) {
    (index as usize / RUN, index as usize % RUN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// Goal: pages never get mixed up and none is lost. Method: places given and taken in a scrambled order beside a map.
    #[test]
    fn places_are_a_map_of_voxels_in_as_many_pages_as_runs_are_taken() {
        const VOXELS: u32 = 1000;
        let (mut places, mut model) = (Places::new(VOXELS), BTreeMap::new());
        let mut most = 0;
        for step in 0..20_000u32 {
            let index = (step.wrapping_mul(2_654_435_761) >> 7) % VOXELS;
            // Fills up and empties again, three times.
            if step % 7 < 2 + step / 2_000 % 4 {
                places.set(index, step);
                model.insert(index, step);
            } else {
                places.remove(index);
                model.remove(&index);
            }
            assert_eq!(places.get(index), model.get(&index).copied());
            let runs: std::collections::BTreeSet<_> = model.keys().map(|&index| split(index).0).collect();
            assert_eq!(places.pages.len() - places.free.len(), runs.len());
            most = most.max(runs.len());
            assert!(places.pages.len() <= most, "a page was not used again");
        }
        for index in 0..VOXELS + RUN as u32 {
            assert_eq!(places.get(index), model.get(&index).copied());
            assert_eq!(places.has(index), index < VOXELS);
        }
        places.clear();
        assert_eq!(places, Places::new(VOXELS));
    }
}
