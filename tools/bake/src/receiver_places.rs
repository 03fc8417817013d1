//! Where receivers are: which voxels have them, and from which place in a voxel their rays go.

use crate::rows::{RAY_OFFSET, RowCaster};
use earthshine_world::{Bounds, Vec3, VoxelCoord};
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

/// What is known of a voxel's patches.
#[derive(Clone, Copy, Default)]
struct VoxelPatches {
    taken: u8,
    /// The patch with the largest area.
    largest: Option<u32>,
}

/// The voxels within reach of patches and inside of the scene's bounds, by chunk; in each ascending.
pub(crate) fn candidates(caster: &RowCaster<'_>) -> BTreeMap<[i32; 3], Vec<Candidate>> {
    let grid = caster.parameters.grid;
    let reach = caster.parameters.receiver_reach_voxels.cast_signed();
    let Bounds { min, max } = caster.tracer.scene().bounds();
    let (low, high) = (grid.voxel_at(min), grid.voxel_at(max));
    let surfaces = surfaces(caster);
    let near: BTreeSet<[i32; 3]> = surfaces
        .keys()
        .flat_map(|&voxel| cube(IVec3::from(voxel), reach))
        .filter(|voxel| voxel.cmpge(low).all() && voxel.cmple(high).all())
        .map(|voxel| voxel.to_array())
        .collect();
    let mut by_chunk: BTreeMap<[i32; 3], Vec<Candidate>> = BTreeMap::new();
    for voxel in near {
        let VoxelPatches { taken, largest } = surfaces.get(&voxel).copied().unwrap_or_default();
        if taken != 0b11_1111 {
            let voxel = IVec3::from(voxel);
            let place = place_in(caster, voxel, largest);
            let chunk = grid.chunk_of(voxel).to_array();
            by_chunk.entry(chunk).or_default().push(Candidate { voxel, place, taken });
        }
    }
    by_chunk
}

fn surfaces(caster: &RowCaster<'_>) -> BTreeMap<[i32; 3], VoxelPatches> {
    let mut surfaces: BTreeMap<[i32; 3], VoxelPatches> = BTreeMap::new();
    let area = |patch: u32| caster.set.patches[patch as usize].patch.area;
    for (index, source) in caster.set.patches.iter().enumerate() {
        let (index, patch) = (index as u32, &source.patch);
        let known = surfaces.entry(patch.voxel.to_array()).or_default();
        known.taken |= 1 << patch.direction.index();
        if known.largest.is_none_or(|largest| area(largest) < patch.area) {
            known.largest = Some(index);
        }
    }
    surfaces
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
    let source = &caster.set.patches[largest as usize];
    let sample = &caster.samples[source.sample_at(0.5) as usize];
    let origin = sample.position + sample.normal * (RAY_OFFSET * edge);
    let is_open = |place: &Vec3| {
        let way = *place - origin;
        way.dot(sample.normal) >= CLEARANCE_VOXELS * edge
            && !caster.tracer.is_blocked(origin, way.normalize_or(sample.normal), way.length())
    };
    OFFSETS.iter().map(|offset| centre + *offset * edge).find(is_open).unwrap_or_else(|| {
        // Nothing on the list is open: a little in front of the surface, half-way to whatever stands there.
        let free = caster.tracer.closest(origin, sample.normal, 0.0, 2.0 * CLEARANCE_VOXELS * edge);
        origin + sample.normal * free.map_or(CLEARANCE_VOXELS * edge, |hit| 0.5 * hit.distance)
    })
}
