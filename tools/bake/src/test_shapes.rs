//! Scenes of known shape for tests: boxes, balls, pairs of squares.

use earthshine_scene::{Material, Scene};
use earthshine_world::{Rgb, Vec3};

/// A scene of white, single-sided triangles.
pub(crate) fn scene_of(triangles: Vec<[Vec3; 3]>) -> Scene {
    let count = triangles.len();
    let white = Material {
        name: "white".to_owned(),
        base_colour: [0.8; 4],
        base_colour_texture: None,
        emitted_radiance: Rgb::ZERO,
        emissive_texture: None,
        alpha_cutoff: None,
        double_sided: false,
        metallic: 0.0,
    };
    Scene {
        triangles,
        texture_coordinates: vec![[[0.0; 2]; 3]; count],
        material_of: vec![0; count],
        materials: vec![white],
        ..Scene::default()
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
