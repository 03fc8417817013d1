//! What every tool calls a scene: triangles in world space, their materials, the lights that came along.

use crate::texture::Texture;
use earthshine_world::{Bounds, Light, Rgb, Vec3};

/// A whole scene, instances flattened, transforms applied.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Three corners a triangle, m; counter-clockwise seen from the front.
    pub triangles: Vec<[Vec3; 3]>,
    /// Texture coordinates of the corners; zero where the mesh has none.
    pub texture_coordinates: Vec<[[f32; 2]; 3]>,
    /// Index into [`Self::materials`], one a triangle.
    pub material_of: Vec<u32>,
    /// At least one.
    pub materials: Vec<Material>,
    /// Decoded images, linear.
    pub textures: Vec<Texture>,
    /// `KHR_lights_punctual`, in world space.
    pub lights: Vec<Light>,
    /// What the import left out or changed.
    pub report: ImportReport,
}

/// Diffuse material.
#[derive(Debug, Clone)]
pub struct Material {
    /// For messages.
    pub name: String,
    /// Base colour factor, linear RGB and alpha.
    pub base_colour: [f32; 4],
    /// Index into [`Scene::textures`].
    pub base_colour_texture: Option<usize>,
    /// Emissive factor x strength, cd/m2.
    pub emitted_radiance: Rgb,
    /// Index into [`Scene::textures`]; multiplies the factor.
    pub emissive_texture: Option<usize>,
    /// Below it a texel is a hole; `None` for opaque. Blended surfaces are masked at 0.5 and counted.
    pub alpha_cutoff: Option<f32>,
    /// Emits from both faces.
    pub double_sided: bool,
    /// 0..=1.
    pub metallic: f32,
}

/// What a ray finds at a point of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Diffuse reflectance, clamped to `[0, Patch::REFLECTANCE_MAX]`.
    pub reflectance: Rgb,
    /// Radiance that leaves the asked face, cd/m2.
    pub emitted_radiance: Rgb,
    /// Whether the alpha mask has a hole here.
    pub is_hole: bool,
}

/// Counts of what was skipped or changed, for the summary.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct ImportReport {
    /// Triangles without area, or with a vertex that is not finite in an otherwise good mesh.
    pub zero_area_triangles: u64,
    /// Materials whose reflectance exceeds the limit somewhere and was clamped.
    pub clamped_materials: u64,
    /// Materials that blend: masked at 0.5.
    pub blended_materials: u64,
    /// Instances that `EXT_mesh_gpu_instancing` added.
    pub gpu_instances: u64,
    /// Sentences for people: other things worth knowing.
    pub warnings: Vec<String>,
}

impl Scene {
    /// Box around all triangles, m.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for corner in self.triangles.iter().flatten() {
            bounds.grow(*corner);
        }
        bounds
    }

    /// Unit geometric normal of the front face.
    #[must_use]
    pub fn normal(&self, triangle: usize) -> Vec3 {
        let [a, b, c] = self.triangles[triangle];
        (b - a).cross(c - a).normalize_or(Vec3::Y)
    }

    /// What is at barycentric `(u, v)` (weights of corners 1 and 2) of `triangle`, seen from its front or back.
    #[must_use]
    pub fn surface(&self, triangle: usize, u: f32, v: f32, front: bool) -> Surface {
        let material = &self.materials[self.material_of[triangle] as usize];
        let [p, q, r] = self.texture_coordinates[triangle];
        let at = |k: usize| p[k] * (1.0 - u - v) + q[k] * u + r[k] * v;
        material.surface(&self.textures, [at(0), at(1)], front)
    }

    /// Whether any material has an alpha mask, so that rays must ask [`Self::surface`].
    #[must_use]
    pub fn has_masks(&self) -> bool {
        self.materials.iter().any(|material| material.alpha_cutoff.is_some())
    }
}

impl Material {
    /// What a ray finds at texture coordinates `uv`.
    #[must_use]
    pub fn surface(&self, textures: &[Texture], uv: [f32; 2], front: bool) -> Surface {
        let texel = |index: Option<usize>| index.map_or([1.0; 4], |i| textures[i].sample(uv));
        let base = texel(self.base_colour_texture);
        let factor = self.base_colour;
        let reflectance = Rgb::new(base[0] * factor[0], base[1] * factor[1], base[2] * factor[2]);
        let emits = front || self.double_sided;
        let emitted_radiance = if emits && self.emitted_radiance != Rgb::ZERO {
            let glow = texel(self.emissive_texture);
            self.emitted_radiance * Rgb::new(glow[0], glow[1], glow[2])
        } else {
            Rgb::ZERO
        };
        Surface {
            reflectance: reflectance
                .clamp(Rgb::ZERO, Rgb::splat(earthshine_world::Patch::REFLECTANCE_MAX)),
            emitted_radiance,
            is_hole: self.alpha_cutoff.is_some_and(|cutoff| base[3] * factor[3] < cutoff),
        }
    }
}
