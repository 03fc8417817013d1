//! Which patch of the next level covers a patch: what stands for it where it is not in memory.

use crate::{ChunkId, Direction, Grid, Patch, PatchId};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Numbers of the parents of a chunk's patches, in the chunk's parent; one a patch.
pub type Parents = Arc<[u16]>;

/// Parents of the patches of some chunks, of any levels.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Lineage {
    parents: BTreeMap<ChunkId, Parents>,
}

impl Lineage {
    /// Takes the parents of the patches of `chunk`.
    pub fn insert(&mut self, chunk: ChunkId, parents: Parents) {
        self.parents.insert(chunk, parents);
    }

    /// The parents of the patches of `chunk`, if they are known.
    #[must_use]
    pub fn of(&self, chunk: ChunkId) -> Option<&Parents> {
        self.parents.get(&chunk)
    }

    /// The patch that covers `patch` one level up, if that is known.
    #[must_use]
    pub fn parent(&self, patch: PatchId) -> Option<PatchId> {
        let local = *self.of(patch.chunk)?.get(usize::from(patch.local))?;
        Some(PatchId { chunk: patch.chunk.parent(), local })
    }

    /// Memory of the numbers, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.parents.values().map(|parents| size_of_val(&**parents)).sum()
    }
}

/// Where the patches of one level are, to find parents among them.
#[derive(Debug, Clone, Default)]
pub struct CoarsePlaces {
    /// By voxel, direction and whether it emits. Only looked up, never iterated.
    places: HashMap<([i32; 3], Direction, bool), u32>,
}

impl CoarsePlaces {
    /// Those of `coarser`, numbered as they come.
    pub fn new<'a>(coarser: impl Iterator<Item = &'a Patch>) -> Self {
        let place = |patch: &Patch| (patch.voxel.to_array(), patch.direction, patch.emits());
        Self { places: coarser.map(place).zip(0u32..).collect() }
    }

    /// The number of the parent of `patch`: of what emits, where both kinds are there, if it emits.
    #[must_use]
    pub fn parent(&self, patch: &Patch) -> Option<u32> {
        let voxel = Grid::parent_voxel(patch.voxel).to_array();
        let place = |emits: bool| self.places.get(&(voxel, patch.direction, emits)).copied();
        place(patch.emits()).or_else(|| place(!patch.emits()))
    }
}

/// The parents of `patches` among the patches of their parent chunk; `None` if one has no parent there.
#[must_use]
pub fn parents_among(patches: &[Patch], coarser: &[Patch]) -> Option<Parents> {
    let places = CoarsePlaces::new(coarser.iter());
    patches.iter().map(|patch| places.parent(patch).and_then(|local| u16::try_from(local).ok())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ChunkCoord, Vec3, VoxelCoord};

    fn patch(x: i32, direction: Direction) -> Patch {
        Patch {
            voxel: VoxelCoord::new(x, 0, -1),
            direction,
            area: 1.0,
            centroid: Vec3::ZERO,
            reflectance: Vec3::ZERO,
            emission: Vec3::ZERO,
            point_first: 0,
            point_count: 1,
        }
    }

    #[test]
    fn parents_are_found_by_place_and_direction() {
        let fine = [patch(-1, Direction::PosX), patch(-2, Direction::PosX), patch(2, Direction::NegX)];
        let coarse = [patch(1, Direction::NegX), patch(-1, Direction::PosX)];
        let parents = parents_among(&fine, &coarse).expect("all have parents");
        assert_eq!(*parents, [1, 1, 0]);
        assert_eq!(parents_among(&fine, &coarse[1..]), None);
        let glowing = |of: Patch| Patch { emission: Vec3::ONE, ..of };
        let apart = [coarse[0], coarse[1], glowing(coarse[1])];
        assert_eq!(*parents_among(&[fine[0], glowing(fine[0])], &apart).expect("both"), [1, 2]);
        assert_eq!(*parents_among(&[glowing(fine[0])], &coarse).expect("no other is there"), [1]);
        let (mut lineage, chunk) = (Lineage::default(), ChunkId::new(0, ChunkCoord::new(-3, 0, 0)));
        lineage.insert(chunk, parents);
        let of = |local| lineage.parent(PatchId { chunk, local });
        let parent = ChunkId::new(1, ChunkCoord::new(-2, 0, 0));
        assert_eq!(of(2), Some(PatchId { chunk: parent, local: 0 }));
        assert_eq!((of(3), lineage.bytes()), (None, 6));
    }
}
