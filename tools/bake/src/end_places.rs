//! To whom the ends of rays belong, as a device is told it: the rule of [`RowCaster::end`](crate::rows::RowCaster) in tables.

use crate::apart::is_apart;
use crate::buried::BuriedPiece;
use crate::clip::clip_to_grid;
use crate::patches::PatchSet;
use crate::sample::{OFF_SURFACE, side_weights};
use earthshine_scene::Scene;
use earthshine_tiles::BakeParameters;
use earthshine_trace::ends::{
    Buried, BuriedHere, COUNTED_PATCHES_MAX, EndPlaces, EndTriangle, EndVoxel, NO_PATCH,
};
use earthshine_world::{Rgb, Vec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Pieces of less than this share of a voxel's face are crumbs of rounding, which no ray meets.
const SLIVER: f32 = 1e-8;

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
            triangles[piece.side as usize / 2].is_for_host_in_places = true;
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
            .for_each(|(index, triangle)| triangle.is_for_host_in_places |= emits(index));
    }
    let asked: BTreeSet<[i32; 3]> = left_out.union(&split).copied().collect();
    let edge = parameters.grid.voxel_edge_m;
    let buried = buried_ends(scene, set, parameters, &mut triangles);
    EndPlaces {
        voxel_edge_m: edge,
        off_surface_m: OFF_SURFACE * edge,
        triangles,
        voxels: voxels(set, &asked, &buried),
    }
}

/// Says of `triangles` which sides are buried, and of voxels what of those is there that are buried in places only.
fn buried_ends(
    scene: &Scene,
    set: &PatchSet,
    parameters: &BakeParameters,
    triangles: &mut [EndTriangle],
) -> BTreeMap<[i32; 3], BuriedHere> {
    let sides: Vec<&[BuriedPiece]> = set.buried().pieces().chunk_by(|a, b| a.side == b.side).collect();
    let open: Vec<Vec<[i32; 3]>> =
        sides.par_iter().map(|pieces| open_voxels(scene, pieces, parameters.grid.voxel_edge_m)).collect();
    let mut here: BTreeMap<[i32; 3], BuriedHere> = BTreeMap::new();
    let mut in_places = Vec::new();
    for (pieces, open) in sides.into_iter().zip(open) {
        let side = pieces[0].side as usize;
        let triangle = &mut triangles[side / 2];
        if open.is_empty() {
            triangle.buried[side % 2] = Buried::Everywhere;
            continue;
        }
        triangle.buried[side % 2] = Buried::InPlaces;
        let bit = 1u8 << EndTriangle::main_direction(side_normal(scene, side)).index();
        pieces.iter().for_each(|piece| here.entry(piece.voxel).or_default().buried |= bit);
        in_places.push((bit, open));
    }
    // Only where something that faces that way is buried does anybody ask what else is open.
    for (bit, open) in in_places {
        for voxel in open {
            if let Some(found) = here.get_mut(&voxel).filter(|found| found.buried & bit != 0) {
                found.open |= bit;
            }
        }
    }
    here
}

/// The voxels that cut something from the side of `pieces` that is none of them, all of which are of one side.
fn open_voxels(scene: &Scene, pieces: &[BuriedPiece], edge: f32) -> Vec<[i32; 3]> {
    let side = pieces[0].side as usize;
    let shift = side_normal(scene, side) * (OFF_SURFACE * edge);
    let shifted = scene.triangles[side / 2].map(|corner| corner + shift);
    let mut open = Vec::new();
    clip_to_grid(shifted, edge, |voxel, polygon| {
        let is_buried = pieces.binary_search_by_key(&voxel.to_array(), |piece| piece.voxel).is_ok();
        if !is_buried && polygon.area() > SLIVER * edge * edge {
            open.push(voxel.to_array());
        }
    });
    open
}

fn side_normal(scene: &Scene, side: usize) -> Vec3 {
    let normal = scene.normal(side / 2);
    if side.is_multiple_of(2) { normal } else { -normal }
}

/// The voxels with patches, those `asked` about (with places left out or patches of emitters of their own), and those with
/// sides `buried` in places; ascending.
fn voxels(
    set: &PatchSet,
    asked: &BTreeSet<[i32; 3]>,
    buried: &BTreeMap<[i32; 3], BuriedHere>,
) -> Vec<EndVoxel> {
    let with_patches = set.patches.iter().map(|source| source.patch.voxel.to_array());
    let mut voxels: Vec<[i32; 3]> =
        with_patches.chain(asked.iter().copied()).chain(buried.keys().copied()).collect();
    voxels.par_sort_unstable();
    voxels.dedup();
    let end = |voxel: [i32; 3]| EndVoxel {
        voxel: voxel.into(),
        patches: set.of_voxel(voxel.into()),
        asks_host: asked.contains(&voxel),
        buried: buried.get(&voxel).copied().unwrap_or_default(),
    };
    voxels.into_iter().map(end).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builder::Builder;
    use crate::progress::Silent;
    use crate::rows::{RayEnd, RowCaster};
    use crate::test_shapes::boxed;
    use earthshine_trace::ends::{RAY_PARTS, Run, RunSum, count_ends};
    use earthshine_trace::{Query, SceneTracer};
    use earthshine_world::Grid;
    use earthshine_world::random::{Purpose, hash, unit_f32};

    /// Goal: a device absorbs the rays that the CPU absorbs, and asks it about few. Method: rays from all over a slab with a
    /// block that reaches into it, askew in the grid, so that its sides are buried here and open there; the twin of a device.
    #[test]
    fn buried_sides_absorb_as_on_the_cpu() {
        let mut scene = boxed(Vec3::new(-3.0, -0.6, -3.0), Vec3::new(3.0, 0.0, 3.0));
        let block = boxed(Vec3::new(-1.3, -0.3, -0.9), Vec3::new(0.8, 1.4, 1.2));
        scene.triangles.extend(block.triangles);
        scene.texture_coordinates.extend(block.texture_coordinates);
        scene.material_of.extend(block.material_of);
        let turn = glam::Quat::from_euler(glam::EulerRot::YXZ, 0.4, 0.2, 0.1);
        scene.triangles.iter_mut().flatten().for_each(|corner| *corner = turn * *corner);
        let parameters = BakeParameters {
            grid: Grid { voxel_edge_m: 0.5, chunk_edge_voxels: 4 },
            ..BakeParameters::default()
        };
        let tracer = SceneTracer::new(&scene);
        let surfaces = Builder { tracer: &tracer, parameters: &parameters }.surfaces(&Silent);
        let places = end_places(&scene, &surfaces.set, &parameters);
        let of_kind =
            |kind| places.triangles.iter().flat_map(|of| of.buried).filter(|of| *of == kind).count();
        assert!(of_kind(Buried::Everywhere) > 4 && of_kind(Buried::InPlaces) > 4);
        let is_asked = |of: &EndVoxel| of.buried.open & !of.buried.buried == 0;
        assert!(places.voxels.iter().all(is_asked), "open, with nothing buried that faces that way");
        let caster = RowCaster::of_world(&tracer, &surfaces, &parameters);
        let (mut absorbed, mut unknown, mut landed) = (0, 0, 0);
        for ray in 0..20_000 {
            let number = |kind: u64| unit_f32(hash(5, Purpose::Simulation, kind, ray));
            let place = Vec3::from_array([0, 1, 2].map(number)) * 2.0 - 1.0;
            let origin = turn * (place * Vec3::new(2.9, 1.0, 2.9));
            let direction = (Vec3::from_array([3, 4, 5].map(number)) * 2.0 - 1.0).normalize_or(Vec3::X);
            let query = Query { origin, direction, distance_max: f32::INFINITY };
            let run = Run { first_ray: 0, ray_count: 1, sum: RunSum::Whole };
            let ends = &count_ends(&tracer, &places, &[query], &[run])[0];
            let end = caster.end(origin, direction);
            let RayEnd::Surface(_) = end else { continue };
            landed += 1;
            if ends.unknown.is_empty() {
                let is_absorbed = ends.absorbed == RAY_PARTS;
                // By what is buried, or for want of any patch that faces that way.
                let by_cpu = end.absorbed_share() > 0.999;
                assert_eq!(is_absorbed, by_cpu, "ray {ray}: {ends:?}, {end:?}");
                absorbed += usize::from(is_absorbed);
            } else {
                unknown += 1;
            }
        }
        assert!(absorbed > 2000 && landed - absorbed > 1000, "{absorbed} of {landed}");
        assert!(unknown * 20 < landed, "{unknown} of {landed} for the host");
    }
}
