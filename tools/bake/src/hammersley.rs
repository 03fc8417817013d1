//! The sources' sample points: Hammersley points on the six faces of a voxel, traced inwards.
//!
//! A ray along axis `a` stands for `face / points` of the face, and so for `face / points / |n_a|` of a surface
//! with normal `n` that it crosses. A side is crossed from up to three faces; were each hit given its whole area,
//! slanted surfaces would be covered up to three times. Weighted by `n_a^2`, which sum to one, the three covers are
//! one: a hit stands for **`|n_a| face / points`**, and the areas of a side's hits have its true area as their mean.
//!
//! A ray goes on behind what it hits, so that a voxel's inner layers count too; crossings nearer to each other than
//! `SAME_PLACE` are one (shared edges, triangles that lie twice in one place). A hit belongs to the voxel that its
//! side faces, as everywhere; rays begin and end a little outside their voxel for surfaces in its very faces.
//! Given up against sampling by area: exact areas, and pieces too small to be hit, whose light is then lost.

use crate::clip::clip_to_grid;
use crate::exposure::Exposure;
use crate::progress::{Progress, Stage};
use crate::sample::{OFF_SURFACE, SurfaceSample, side_of, voxel_of};
use earthshine_tiles::BakeParameters;
use earthshine_trace::{Hit, SceneTracer};
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{Direction, Vec3, VoxelCoord};
use rayon::prelude::*;

/// Crossings nearer to each other than this share of a voxel's edge are one.
const SAME_PLACE: f32 = 1e-5;
/// Most crossings of one ray in one voxel.
const CROSSINGS_MAX: usize = 64;

/// Samples of every voxel with surfaces, ascending by voxel.
#[must_use]
pub fn sample_voxels(
    tracer: &SceneTracer<'_>,
    parameters: &BakeParameters,
    progress: &dyn Progress,
) -> Vec<SurfaceSample> {
    let voxels = voxels_with_surfaces(tracer, parameters);
    progress.begin(Stage::Sample, voxels.len() as u64);
    voxels
        .par_iter()
        .flat_map_iter(|&voxel| {
            let samples = sample_voxel(tracer, VoxelCoord::from_array(voxel), parameters);
            progress.advance(1);
            samples
        })
        .collect()
}

/// The voxels that sides of triangles belong to, each once.
fn voxels_with_surfaces(tracer: &SceneTracer<'_>, parameters: &BakeParameters) -> Vec<[i32; 3]> {
    let edge = parameters.grid.voxel_edge_m;
    let scene = tracer.scene();
    let mut voxels: Vec<[i32; 3]> = (0..scene.triangles.len())
        .into_par_iter()
        .flat_map_iter(|triangle| {
            let off = scene.normal(triangle) * (OFF_SURFACE * edge);
            let mut own = Vec::new();
            for shift in [off, -off] {
                let shifted = scene.triangles[triangle].map(|corner| corner + shift);
                clip_to_grid(shifted, edge, |voxel, _| own.push(voxel.to_array()));
            }
            own
        })
        .collect();
    voxels.par_sort_unstable();
    voxels.dedup();
    voxels
}

fn sample_voxel(
    tracer: &SceneTracer<'_>,
    voxel: VoxelCoord,
    parameters: &BakeParameters,
) -> Vec<SurfaceSample> {
    let edge = parameters.grid.voxel_edge_m;
    let count = parameters.samples_per_voxel_face.max(1);
    let mut samples = Vec::new();
    for face in Direction::ALL {
        let inwards = -face.vector();
        let axis = face.axis();
        let key = crate::rows::patch_key(voxel, face.index());
        let (shift_u, shift_v) = unit_pair(hash(parameters.seed, Purpose::SamplePoint, key, 0));
        for index in 0..count {
            let (u, v) = hammersley(index, count, shift_u, shift_v);
            let mut start = Vec3::ZERO;
            start[(axis + 1) % 3] = u;
            start[(axis + 2) % 3] = v;
            start[axis] = if inwards[axis] > 0.0 { 0.0 } else { 1.0 };
            let on_face = (voxel.as_vec3() + start) * edge;
            for_crossings(tracer, on_face, inwards, edge, |hit| {
                samples.extend(sample_at(tracer, hit, inwards, voxel, parameters));
            });
        }
    }
    samples
}

/// Point `index` of `count`, shifted on the torus.
fn hammersley(index: u32, count: u32, shift_u: f32, shift_v: f32) -> (f32, f32) {
    let radical = index.reverse_bits() as f32 / (1u64 << 32) as f32;
    let u = (index as f32 + 0.5) / count as f32 + shift_u;
    let v = radical + shift_v;
    (u.fract(), v.fract())
}

/// Every crossing of the ray through a voxel of edge `edge`, in order.
fn for_crossings(
    tracer: &SceneTracer<'_>,
    on_face: Vec3,
    inwards: Vec3,
    edge: f32,
    mut each: impl FnMut(&Hit),
) {
    let outside = 2.0 * OFF_SURFACE * edge;
    let origin = on_face - inwards * outside;
    let (mut from, to) = (0.0, edge + 2.0 * outside);
    for _ in 0..CROSSINGS_MAX {
        let Some(hit) = tracer.closest(origin, inwards, from, to) else { return };
        each(&hit);
        from = hit.distance + SAME_PLACE * edge;
    }
}

/// The sample that `hit` makes, if it is on a side that reflects and belongs to `voxel`.
fn sample_at(
    tracer: &SceneTracer<'_>,
    hit: &Hit,
    inwards: Vec3,
    voxel: VoxelCoord,
    parameters: &BakeParameters,
) -> Option<SurfaceSample> {
    let scene = tracer.scene();
    let material = &scene.materials[scene.material_of[hit.triangle] as usize];
    if !hit.front && !parameters.two_sided && !material.double_sided {
        return None;
    }
    let edge = parameters.grid.voxel_edge_m;
    let normal = tracer.normal(hit);
    let [a, b, c] = scene.triangles[hit.triangle];
    let position = a + (b - a) * hit.u + (c - a) * hit.v;
    if voxel_of(position, normal, edge) != voxel {
        return None;
    }
    let surface = tracer.surface(hit);
    let face_share = edge * edge / parameters.samples_per_voxel_face.max(1) as f32;
    Some(SurfaceSample {
        position: crate::sample::inset([a, b, c], position, crate::sample::OFF_EDGE * edge),
        normal,
        side: side_of(hit.triangle, hit.front),
        voxel,
        area: normal.dot(inwards).abs() * face_share,
        reflectance: surface.reflectance,
        emission: surface.emitted_radiance * std::f32::consts::PI,
        exposure: Exposure::Open(1.0),
        is_suspect: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use crate::test_shapes::{ball, boxed};
    use earthshine_scene::Scene;
    use earthshine_world::Grid;

    fn relative_error(scene: &Scene, points: u32, two_sided: bool) -> f32 {
        let grid = Grid { voxel_edge_m: 0.5, chunk_edge_voxels: 4 };
        let parameters =
            BakeParameters { grid, samples_per_voxel_face: points, two_sided, ..BakeParameters::default() };
        let samples = sample_voxels(&SceneTracer::new(scene), &parameters, &Silent);
        let found: f32 = samples.iter().map(|sample| sample.area).sum();
        let sides = if two_sided { 2.0 } else { 1.0 };
        let area = |[a, b, c]: &[Vec3; 3]| (*b - *a).cross(*c - *a).length() * 0.5 * sides;
        found / scene.triangles.iter().map(area).sum::<f32>() - 1.0
    }

    #[test]
    fn areas_converge_to_the_true_ones() {
        // Faces of the box in faces of the grid, and askew; both sides of a ball.
        let even = boxed(Vec3::splat(-0.5), Vec3::ONE);
        assert!(relative_error(&even, 16, false).abs() < 1e-4);
        let askew = boxed(Vec3::new(-0.33, 0.11, 0.21), Vec3::new(0.87, 1.23, 0.77));
        for (scene, two_sided) in [(askew, false), (ball(1.0, 24, 48), true)] {
            let (few, many) =
                (relative_error(&scene, 16, two_sided), relative_error(&scene, 1024, two_sided));
            assert!(few.abs() < 0.05 && many.abs() < 0.004, "{few} {many}");
        }
    }

    #[test]
    fn inner_layers_count_and_samples_lie_in_the_voxel_they_face() {
        let grid = Grid { voxel_edge_m: 4.0, chunk_edge_voxels: 4 };
        let parameters = BakeParameters {
            grid,
            samples_per_voxel_face: 4096,
            two_sided: true,
            ..BakeParameters::default()
        };
        let mut scene = boxed(Vec3::splat(0.5), Vec3::splat(3.5));
        let inner = boxed(Vec3::splat(1.0), Vec3::splat(3.0));
        scene.triangles.extend(inner.triangles);
        scene.texture_coordinates.extend(inner.texture_coordinates);
        scene.material_of.extend(inner.material_of);
        let samples = sample_voxels(&SceneTracer::new(&scene), &parameters, &Silent);
        let area = |inside: bool| -> f32 {
            let of = |sample: &&SurfaceSample| (sample.side >= 24) == inside;
            samples.iter().filter(of).map(|sample| sample.area).sum()
        };
        assert!((area(false) / (2.0 * 6.0 * 9.0) - 1.0).abs() < 0.01);
        assert!((area(true) / (2.0 * 6.0 * 4.0) - 1.0).abs() < 0.01);
        assert!(samples.iter().all(|s| voxel_of(s.position, s.normal, 4.0) == s.voxel));
    }
}
