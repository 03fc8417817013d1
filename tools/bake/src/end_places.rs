//! To whom the ends of rays belong, as a device is told it: the rule of [`RowCaster::end`](crate::rows::RowCaster) in tables.

use crate::apart::is_apart;
use crate::patches::PatchSet;
use crate::sample::{OFF_SURFACE, side_weights};
use earthshine_scene::Scene;
use earthshine_tiles::BakeParameters;
use earthshine_trace::ends::{COUNTED_PATCHES_MAX, EndPlaces, EndTriangle, EndVoxel, NO_PATCH};
use earthshine_world::Rgb;
use rayon::prelude::*;
use std::collections::BTreeSet;

const _: () = assert!(NO_PATCH == PatchSet::NONE, "one mark for no patch");

/// The triangles of `scene` as ends of rays, before there are patches.
pub(crate) fn end_triangles(scene: &Scene, parameters: &BakeParameters) -> Vec<EndTriangle> {
    let triangle = |triangle: usize| {
        let normal = scene.normal(triangle);
        let weights = side_weights(parameters.weights, normal).map(|(_, weight)| weight);
        let material = &scene.materials[scene.material_of[triangle] as usize];
        let is_two_sided = material.double_sided;
        EndTriangle { is_two_sided, ..EndTriangle::new(normal, weights, material.alpha_cutoff.is_some()) }
    };
    (0..scene.triangles.len()).into_par_iter().map(triangle).collect()
}

/// The places of `scene` with the axis-aligned patches of `set`.
///
/// # Panics
/// If there are more patches than a device can name: some four thousand million.
pub(crate) fn end_places(scene: &Scene, set: &PatchSet, parameters: &BakeParameters) -> EndPlaces {
    assert!(set.len() < COUNTED_PATCHES_MAX as usize, "{} patches", set.len());
    let mut triangles = end_triangles(scene, parameters);
    let left_out: BTreeSet<[i32; 3]> = set
        .hidden()
        .samples()
        .into_iter()
        .map(|piece| {
            triangles[piece.side as usize / 2].has_left_out = true;
            piece.voxel.to_array()
        })
        .collect();
    let split: BTreeSet<[i32; 3]> = set
        .patches
        .iter()
        .filter(|source| is_apart(source.key))
        .map(|source| source.patch.voxel.to_array())
        .collect();
    if !split.is_empty() {
        // In these voxels the texture says whose a hit is.
        let emits = |triangle: usize| {
            scene.materials[scene.material_of[triangle] as usize].emitted_radiance != Rgb::ZERO
        };
        triangles
            .par_iter_mut()
            .enumerate()
            .for_each(|(index, triangle)| triangle.has_left_out |= emits(index));
    }
    let asked: BTreeSet<[i32; 3]> = left_out.union(&split).copied().collect();
    let edge = parameters.grid.voxel_edge_m;
    EndPlaces {
        voxel_edge_m: edge,
        off_surface_m: OFF_SURFACE * edge,
        triangles,
        voxels: voxels(set, &asked),
    }
}

/// The voxels with patches or `asked` about, ascending: those with places left out or patches of emitters of their own.
fn voxels(set: &PatchSet, asked: &BTreeSet<[i32; 3]>) -> Vec<EndVoxel> {
    let with_patches = set.patches.iter().map(|source| source.patch.voxel.to_array());
    let mut voxels: Vec<[i32; 3]> = with_patches.chain(asked.iter().copied()).collect();
    voxels.par_sort_unstable();
    voxels.dedup();
    let end = |voxel: [i32; 3]| EndVoxel {
        voxel: voxel.into(),
        patches: set.of_voxel(voxel.into()),
        has_left_out: asked.contains(&voxel),
    };
    voxels.into_iter().map(end).collect()
}
