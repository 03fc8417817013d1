//! Small scenes with known light, for this package's tests.

use earthshine_scene::{Material, Scene};
use earthshine_world::{Rgb, Vec3};

/// A grey diffuse material.
pub(crate) fn grey(reflectance: f32) -> Material {
    Material::grey("grey", reflectance)
}

/// A grey material whose front emits `radiance` cd/m2.
pub(crate) fn glowing(reflectance: f32, radiance: f32) -> Material {
    Material { emitted_radiance: Rgb::splat(radiance), ..grey(reflectance) }
}

/// Collects quads.
#[derive(Default)]
pub(crate) struct SceneBuilder {
    pub(crate) scene: Scene,
}

impl SceneBuilder {
    /// Adds a material; its index.
    pub(crate) fn material(&mut self, material: Material) -> u32 {
        self.scene.materials.push(material);
        self.scene.materials.len() as u32 - 1
    }

    /// A parallelogram at `corner`; its front is where `side x up` points.
    pub(crate) fn quad(&mut self, corner: Vec3, side: Vec3, up: Vec3, material: u32) {
        let corners = [corner, corner + side, corner + side + up, corner + up];
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
            self.scene.triangles.push([corners[a], corners[b], corners[c]]);
            self.scene.texture_coordinates.push([[0.0; 2]; 3]);
            self.scene.material_of.push(material);
        }
    }

    /// A horizontal square of edge `edge` around the y axis at height `y`, facing up or down.
    pub(crate) fn plate(&mut self, y: f32, edge: f32, faces_up: bool, material: u32) {
        let corner = Vec3::new(-0.5 * edge, y, -0.5 * edge);
        let (side, up) = if faces_up { (Vec3::Z, Vec3::X) } else { (Vec3::X, Vec3::Z) };
        self.quad(corner, side * edge, up * edge, material);
    }

    /// The inside of the unit cube.
    pub(crate) fn room(&mut self, material: u32) {
        let (x, y, z, o) = (Vec3::X, Vec3::Y, Vec3::Z, Vec3::ZERO);
        for (corner, side, up) in [(o, y, z), (x, z, y), (o, z, x), (y, x, z), (o, x, y), (z, y, x)] {
            self.quad(corner, side, up, material);
        }
    }
}
