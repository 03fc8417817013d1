//! Where receivers are: which voxels have them, and from which place in a voxel their rays go.

use crate::patches::PatchSet;
use crate::rows::{RAY_OFFSET, RowCaster};
use earthshine_world::{Grid, Vec3, VoxelCoord};
use glam::IVec3;
use std::collections::{BTreeMap, BTreeSet};

/// A voxel that may get receivers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    /// Which.
    pub(crate) voxel: VoxelCoord,
    /// In its open part, m.
    pub(crate) place: Vec3,
    /// Bit `a` says that direction `a` has a patch.
    pub(crate) taken: u8,
}

/// How far in front of a surface a place must lie, in voxel edges.
const CLEARANCE_VOXELS: f32 = 0.1;

/// Places in a voxel with surfaces, from its middle, in voxel edges: nearer ones first.
const OFFSETS: [Vec3; 15] = {
    const A: f32 = 0.25;
    const B: f32 = 0.4;
    [
        Vec3::ZERO,
        Vec3::new(0.0, B, 0.0),
        Vec3::new(0.0, -B, 0.0),
        Vec3::new(B, 0.0, 0.0),
        Vec3::new(-B, 0.0, 0.0),
        Vec3::new(0.0, 0.0, B),
        Vec3::new(0.0, 0.0, -B),
        Vec3::new(A, A, A),
        Vec3::new(-A, A, A),
        Vec3::new(A, A, -A),
        Vec3::new(-A, A, -A),
        Vec3::new(A, -A, A),
        Vec3::new(-A, -A, A),
        Vec3::new(A, -A, -A),
        Vec3::new(-A, -A, -A),
    ]
};

/// A voxel of a chunk within reach of patches, before its place is looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Voxel {
    pub(crate) at: VoxelCoord,
    /// Bit `a` says that direction `a` has a patch.
    pub(crate) taken: u8,
    /// The patch with the largest area.
    largest: Option<u32>,
}

/// The voxels of `chunk` that are within `reach` voxels of patches and between `low` and `high`, ascending; without
/// those that have patches all around.
pub(crate) fn voxels_near_patches(
    set: &PatchSet,
    grid: &Grid,
    chunk: [i32; 3],
    reach: u32,
    (low, high): (VoxelCoord, VoxelCoord),
) -> Vec<Voxel> {
    let edge = grid.chunk_edge_voxels.cast_signed();
    let reach = reach.cast_signed();
    let corner = IVec3::from(chunk) * edge;
    let (first, last) = (IVec3::ZERO, IVec3::splat(edge - 1));
    let own = voxels_with_patches(set, chunk);
    let mut is_near = vec![false; (edge * edge * edge) as usize];
    for neighbour in cube(IVec3::from(chunk), (reach + edge - 1) / edge) {
        let Some(range) = set.chunks.get(&neighbour.to_array()) else { continue };
        let mut voxels: Vec<[i32; 3]> = set.patches[range.start as usize..range.end as usize]
            .iter()
            .map(|source| source.patch.voxel.to_array())
            .collect();
        voxels.sort_unstable();
        voxels.dedup();
        for voxel in voxels {
            let at = IVec3::from(voxel) - corner;
            let (from, to) = ((at - reach).max(first), (at + reach).min(last));
            for x in from.x..=to.x {
                for y in from.y..=to.y {
                    for z in from.z..=to.z {
                        is_near[((x * edge + y) * edge + z) as usize] = true;
                    }
                }
            }
        }
    }
    let near = is_near.into_iter().enumerate().filter(|(_, near)| *near);
    near.map(|(index, _)| {
        let index = index as i32;
        corner + IVec3::new(index / (edge * edge), index / edge % edge, index % edge)
    })
    .filter(|voxel| voxel.cmpge(low).all() && voxel.cmple(high).all())
    .map(|voxel| own.get(&voxel.to_array()).copied().unwrap_or(Voxel { at: voxel, taken: 0, largest: None }))
    .filter(|voxel| voxel.taken != 0b11_1111)
    .collect()
}

/// The voxels of `chunk` that have patches.
fn voxels_with_patches(set: &PatchSet, chunk: [i32; 3]) -> BTreeMap<[i32; 3], Voxel> {
    let mut voxels: BTreeMap<[i32; 3], Voxel> = BTreeMap::new();
    let area = |patch: u32| set.patches[patch as usize].patch.area;
    for index in set.chunks.get(&chunk).cloned().unwrap_or(0..0) {
        let patch = &set.patches[index as usize].patch;
        let unknown = Voxel { at: patch.voxel, taken: 0, largest: None };
        let voxel = voxels.entry(patch.voxel.to_array()).or_insert(unknown);
        voxel.taken |= 1 << patch.direction.index();
        if voxel.largest.is_none_or(|largest| area(largest) < patch.area) {
            voxel.largest = Some(index);
        }
    }
    voxels
}

/// Every chunk that may have such voxels, ascending.
pub(crate) fn chunks_near_patches(set: &PatchSet, grid: &Grid, reach: u32) -> Vec<[i32; 3]> {
    let chunks = reach.div_ceil(grid.chunk_edge_voxels).cast_signed();
    let near = set.chunks.keys().flat_map(|&chunk| cube(IVec3::from(chunk), chunks));
    let near: BTreeSet<[i32; 3]> = near.map(|chunk| chunk.to_array()).collect();
    near.into_iter().collect()
}

/// A place for the rays of `voxel`, which must be in a chunk whose patches `caster` may begin on.
pub(crate) fn candidate(caster: &RowCaster<'_>, voxel: &Voxel) -> Candidate {
    Candidate { voxel: voxel.at, place: place_in(caster, voxel.at, voxel.largest), taken: voxel.taken }
}

fn cube(centre: IVec3, reach: i32) -> impl Iterator<Item = IVec3> {
    let steps = move || -reach..=reach;
    steps().flat_map(move |x| steps().flat_map(move |y| steps().map(move |z| centre + IVec3::new(x, y, z))))
}

/// The middle of an empty voxel. Among surfaces, the place nearest to the middle that the largest patch looks at.
fn place_in(caster: &RowCaster<'_>, voxel: VoxelCoord, largest: Option<u32>) -> Vec3 {
    let grid = caster.parameters.grid;
    let (edge, centre) = (grid.voxel_edge_m, grid.voxel_centre(voxel));
    let Some(largest) = largest else { return centre };
    let source = caster.source(largest);
    let sample = &caster.samples[source.sample_at(0.5) as usize];
    let origin = sample.position + sample.normal * (RAY_OFFSET * edge);
    let is_open = |place: &Vec3| {
        let way = *place - origin;
        way.dot(sample.normal) >= CLEARANCE_VOXELS * edge
            && !caster.tracer.is_blocked(origin, way.normalize_or(sample.normal), way.length())
    };
    OFFSETS.iter().map(|offset| centre + *offset * edge).find(is_open).unwrap_or_else(|| {
        // Nothing on the list is open: a little in front of the surface, half-way to whatever stands there.
        let free = caster.tracer.closest(origin, sample.normal, 2.0 * CLEARANCE_VOXELS * edge);
        origin + sample.normal * free.map_or(CLEARANCE_VOXELS * edge, |hit| 0.5 * hit.distance)
    })
}
