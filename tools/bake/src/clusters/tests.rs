//! Clusters of boxes and spheres, whose patches are known.

use super::*;
use crate::builder::Builder;
use crate::progress::Silent;
use crate::test_shapes::{ball, boxed};
use earthshine_tiles::{BakeMethod, PatchBuilder};
use earthshine_world::Grid;

fn parameters(voxel_edge_m: f32, builder: PatchBuilder) -> BakeParameters {
    let grid = Grid { voxel_edge_m, chunk_edge_voxels: 4 };
    let method = BakeMethod { builder, ..BakeMethod::default() };
    BakeParameters { grid, method, two_sided: false, buried_rays: 0, ..BakeParameters::default() }
}

/// (voxel, direction, area) of every patch, in order.
fn patches(scene: &earthshine_scene::Scene, parameters: &BakeParameters) -> Vec<([i32; 3], Direction, f32)> {
    let tracer = SceneTracer::new(scene);
    let builder = Builder { tracer: &tracer, parameters };
    let surfaces = builder.surfaces(&Silent);
    for patch in &surfaces.set.patches {
        for &(sample, _) in &patch.samples {
            assert_eq!(surfaces.samples[sample as usize].voxel, patch.patch.voxel, "merging crossed voxels");
        }
    }
    let mut found: Vec<_> = surfaces
        .set
        .patches
        .iter()
        .map(|p| (p.patch.voxel.to_array(), p.patch.direction, p.patch.area))
        .collect();
    found.sort_by_key(|patch| (patch.0, patch.1));
    found
}

#[test]
fn six_clusters_of_an_axis_aligned_box_are_its_axis_aligned_patches() {
    // In one voxel, and over several with corners and edges in them.
    for (low, high, voxel_edge_m) in [(0.2, 0.8, 1.0), (0.15, 2.7, 1.0), (-0.3, 0.3, 0.25)] {
        let scene = boxed(Vec3::splat(low), Vec3::splat(high));
        let axis = patches(&scene, &parameters(voxel_edge_m, PatchBuilder::Axis));
        let clustered = patches(&scene, &parameters(voxel_edge_m, PatchBuilder::Clustered));
        assert_eq!(axis.len(), clustered.len(), "box {low}..{high}");
        for (a, c) in axis.iter().zip(&clustered) {
            assert_eq!((a.0, a.1), (c.0, c.1));
            assert!((a.2 - c.2).abs() < 1e-5 * a.2, "{a:?} {c:?}");
        }
    }
}

#[test]
fn the_sources_rule_keeps_as_many_clusters_as_it_may() {
    let scene = boxed(Vec3::ZERO, Vec3::ONE);
    let mut own = parameters(1.0, PatchBuilder::Clustered);
    own.method.cluster_distance = 0.0;
    own.method.clusters_per_voxel = 3;
    let found = patches(&scene, &own);
    // Each face lies in the voxel that it faces, alone: 16 samples become three.
    assert_eq!(found.len(), 6 * 3);
}

#[test]
fn clusters_of_a_ball_have_its_area_and_their_own_normals() {
    let scene = ball(1.0, 24, 48);
    let surface: f32 = scene.triangles.iter().map(|[a, b, c]| (b - a).cross(c - a).length() * 0.5).sum();
    let found = patches(&scene, &parameters(0.5, PatchBuilder::Clustered));
    let area: f32 = found.iter().map(|patch| patch.2).sum();
    assert!((area / surface - 1.0).abs() < 1e-4, "{area} of {surface}");
    let most = found.chunk_by(|a, b| a.0 == b.0).map(<[_]>::len).max();
    assert!(most <= Some(6) && most > Some(0));
}
