//! Scenes of known shape for tests: boxes, balls, pairs of squares; and points on nothing in particular.

use crate::exposure::Exposure;
use crate::sample::SurfaceSample;
use earthshine_scene::{Material, Scene};
use earthshine_world::{Rgb, Vec3, VoxelCoord};

/// A scene of white, single-sided triangles.
pub(crate) fn scene_of(triangles: Vec<[Vec3; 3]>) -> Scene {
    let count = triangles.len();
    Scene {
        triangles,
        texture_coordinates: vec![[[0.0; 2]; 3]; count],
        material_of: vec![0; count],
        materials: vec![Material::grey("white", 0.8)],
        ..Scene::default()
    }
}

/// An open, white point of a square metre that emits nothing.
pub(crate) fn point(position: Vec3, normal: Vec3, voxel: VoxelCoord) -> SurfaceSample {
    SurfaceSample {
        position,
        normal,
        side: 0,
        voxel,
        area: 1.0,
        reflectance: Rgb::ONE,
        emission: Rgb::ZERO,
        exposure: Exposure::Open(1.0),
        is_suspect: false,
    }
}

/// A parallelogram whose front is where `e1 x e2` points.
pub(crate) fn quad(corner: Vec3, e1: Vec3, e2: Vec3) -> [[Vec3; 3]; 2] {
    [[corner, corner + e1, corner + e1 + e2], [corner, corner + e1 + e2, corner + e2]]
}

/// The outside of a box.
pub(crate) fn boxed(low: Vec3, high: Vec3) -> Scene {
    let size = high - low;
    let mut triangles = Vec::new();
    for axis in 0..3 {
        let (mut along, mut across, mut depth) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        along[(axis + 1) % 3] = size[(axis + 1) % 3];
        across[(axis + 2) % 3] = size[(axis + 2) % 3];
        depth[axis] = size[axis];
        triangles.extend(quad(low, across, along));
        triangles.extend(quad(low + depth, along, across));
    }
    scene_of(triangles)
}

/// The outside of a ball about the origin, in `rings` x `sectors` facets.
pub(crate) fn ball(radius_m: f32, rings: u32, sectors: u32) -> Scene {
    let corner = |ring: u32, sector: u32| {
        let (polar, turn) = (
            std::f32::consts::PI * ring as f32 / rings as f32,
            std::f32::consts::TAU * (sector % sectors) as f32 / sectors as f32,
        );
        radius_m * Vec3::new(polar.sin() * turn.cos(), polar.cos(), polar.sin() * turn.sin())
    };
    let mut triangles = Vec::new();
    for ring in 0..rings {
        for sector in 0..sectors {
            let [a, b, c, d] = [
                corner(ring, sector),
                corner(ring, sector + 1),
                corner(ring + 1, sector + 1),
                corner(ring + 1, sector),
            ];
            if ring > 0 {
                triangles.push([a, b, c]);
            }
            if ring + 1 < rings {
                triangles.push([a, c, d]);
            }
        }
    }
    scene_of(triangles)
}
