//! Which patches of one level make which patch of the next, and what number that has in its chunk.
//!
//! Coarse patches are ordered as fine ones are: by chunk, then direction, then Morton code. What emits is a patch of its own
//! on every level, and comes second: far light of a flame is not that of the wall behind it.

use crate::patches::morton;
use earthshine_world::{ChunkId, Direction, Grid, Patch, VoxelCoord};
use std::collections::BTreeMap;
use xxhash_rust::xxh3::Xxh3Default;

/// One patch of a finer level: a chunk and a patch of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Child {
    pub(super) chunk: ChunkId,
    pub(super) local: u16,
}

/// A coarse patch before it is merged.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) voxel: VoxelCoord,
    pub(super) direction: Direction,
    /// Ascending by chunk, then patch; at most eight, more where patches are clusters.
    pub(super) children: Vec<Child>,
}

/// A level's patches and their children.
#[derive(Debug)]
pub(super) struct Numbering {
    places: BTreeMap<ChunkId, Vec<Place>>,
    /// Of each patch of each finer chunk: its parent's number in the parent chunk.
    parents: BTreeMap<ChunkId, Vec<u16>>,
    hash: u64,
}

impl Numbering {
    /// Numbers the level above `finer`, whose chunks have `chunk_edge_voxels` along an edge.
    pub(super) fn new(finer: &BTreeMap<ChunkId, Vec<Patch>>, chunk_edge_voxels: u32) -> Self {
        let mut places: BTreeMap<ChunkId, Vec<Place>> = BTreeMap::new();
        let mut keyed: BTreeMap<ChunkId, BTreeMap<(Direction, u32, bool), Place>> = BTreeMap::new();
        for (&chunk, patches) in finer {
            let corner = chunk.parent().coord * chunk_edge_voxels.cast_signed();
            let parent = keyed.entry(chunk.parent()).or_default();
            for (local, patch) in patches.iter().enumerate() {
                let voxel = Grid::parent_voxel(patch.voxel);
                let (direction, code) = (patch.direction, morton((voxel - corner).to_array()));
                let place = parent.entry((direction, code, patch.emits())).or_insert_with(|| Place {
                    voxel,
                    direction,
                    children: Vec::new(),
                });
                place.children.push(Child { chunk, local: local as u16 });
            }
        }
        let mut parents: BTreeMap<ChunkId, Vec<u16>> =
            finer.iter().map(|(&chunk, patches)| (chunk, vec![0; patches.len()])).collect();
        let mut hash = Xxh3Default::new();
        for (id, keyed) in keyed {
            let list: Vec<Place> = keyed.into_values().collect();
            for (number, place) in list.iter().enumerate() {
                hash.update(bytemuck::cast_slice(&place.voxel.to_array()));
                hash.update(&[place.direction as u8]);
                for child in &place.children {
                    if let Some(numbers) = parents.get_mut(&child.chunk) {
                        numbers[usize::from(child.local)] = number as u16;
                    }
                }
            }
            places.insert(id, list);
        }
        Self { places, parents, hash: hash.digest() }
    }

    /// The patches of coarse chunk `id`.
    pub(super) fn places(&self, id: ChunkId) -> &[Place] {
        self.places.get(&id).map_or(&[], Vec::as_slice)
    }

    /// The number of each fine patch's parent in the parent of `chunk`.
    pub(super) fn parents(&self, chunk: ChunkId) -> &[u16] {
        self.parents.get(&chunk).map_or(&[], Vec::as_slice)
    }

    /// Changes with any place of any patch.
    pub(super) fn hash(&self) -> u64 {
        self.hash
    }
}
