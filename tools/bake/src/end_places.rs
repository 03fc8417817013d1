//! To whom the ends of rays belong, as a device is told it: the rule of [`RowCaster::end`](crate::rows::RowCaster) in tables.

use crate::patches::PatchSet;
use crate::sample::{OFF_SURFACE, side_weights};
use earthshine_scene::Scene;
use earthshine_tiles::BakeParameters;
use earthshine_trace::ends::{COUNTED_PATCHES_MAX, EndPlaces, EndTriangle, EndVoxel, NO_PATCH};
use rayon::prelude::*;

const _: () = assert!(NO_PATCH == PatchSet::NONE, "one mark for no patch");

/// The places of `scene` with the axis-aligned patches of `set`.
///
/// # Panics
/// If there are more patches than a device can name: some four thousand million.
pub(crate) fn end_places(scene: &Scene, set: &PatchSet, parameters: &BakeParameters) -> EndPlaces {
    assert!(set.len() < COUNTED_PATCHES_MAX as usize, "{} patches", set.len());
    let mut is_for_host = vec![false; scene.triangles.len()];
    for piece in set.hidden().samples() {
        is_for_host[piece.side as usize / 2] = true;
    }
    let is_masked: Vec<bool> =
        scene.materials.iter().map(|material| material.alpha_cutoff.is_some()).collect();
    let triangle = |(triangle, is_for_host): (usize, bool)| {
        let normal = scene.normal(triangle);
        let weights = side_weights(parameters.weights, normal).map(|(_, weight)| weight);
        EndTriangle::new(normal, weights, is_for_host || is_masked[scene.material_of[triangle] as usize])
    };
    let edge = parameters.grid.voxel_edge_m;
    EndPlaces {
        voxel_edge_m: edge,
        off_surface_m: OFF_SURFACE * edge,
        triangles: is_for_host.into_par_iter().enumerate().map(triangle).collect(),
        voxels: voxels(set),
    }
}

/// The voxels with patches, ascending.
fn voxels(set: &PatchSet) -> Vec<EndVoxel> {
    let mut voxels: Vec<[i32; 3]> = set.patches.iter().map(|source| source.patch.voxel.to_array()).collect();
    voxels.par_sort_unstable();
    voxels.dedup();
    let patches = |voxel: [i32; 3]| EndVoxel { voxel: voxel.into(), patches: set.of_voxel(voxel.into()) };
    voxels.into_iter().map(patches).collect()
}
