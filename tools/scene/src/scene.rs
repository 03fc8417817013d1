//! What every tool calls a scene: triangles in world space, their materials, the lights that came along.

use crate::texture::Texture;
use earthshine_world::{Bounds, Light, Rgb, Vec3};
use glam::DAffine3;
use std::collections::BTreeSet;

/// A whole scene, instances flattened, transforms applied.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Three corners a triangle, m; counter-clockwise seen from the front.
    pub triangles: Vec<[Vec3; 3]>,
    /// Texture coordinates of the corners; zero where the mesh has none.
    pub texture_coordinates: Vec<[[f32; 2]; 3]>,
    /// Texture coordinates of the corners for emissive textures; `None` where they are the same everywhere.
    pub emissive_coordinates: Option<Vec<[[f32; 2]; 3]>>,
    /// Colours of the corners, linear RGB and alpha, 65535 for one; multiply the base colour. `None` for white.
    pub corner_colours: Option<Vec<[[u16; 4]; 3]>>,
    /// Index into [`Self::materials`], one a triangle.
    pub material_of: Vec<u32>,
    /// At least one.
    pub materials: Vec<Material>,
    /// Decoded images, linear.
    pub textures: Vec<Texture>,
    /// Runs of triangles that a mesh of the file was placed as, ascending; not all triangles are in one.
    pub placements: Vec<PlacedMesh>,
    /// `KHR_lights_punctual`, in world space.
    pub lights: Vec<Light>,
    /// What the import left out or changed.
    pub report: ImportReport,
}

/// A mesh of the file in its place: what trees over meshes are made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedMesh {
    /// The first of its [`Scene::triangles`].
    pub first: u32,
    /// How many there are.
    pub count: u32,
    /// Placements of one shape have triangle by triangle the same geometry in the frame of their mesh.
    pub shape: u32,
    /// From that frame to the world; can be inverted.
    pub to_world: DAffine3,
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
    /// What [`Self::corner_colours`] holds for a triangle without colours.
    pub const WHITE_CORNERS: [[u16; 4]; 3] = [[u16::MAX; 4]; 3];

    /// Box around all triangles, m.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for corner in self.triangles.iter().flatten() {
            bounds.grow(*corner);
        }
        bounds
    }

    /// Triangles of [`Self::placements`] of a shape that stands somewhere before.
    #[must_use]
    pub fn repeated_triangles(&self) -> u64 {
        let mut shapes = BTreeSet::new();
        let again = self.placements.iter().filter(|placed| !shapes.insert(placed.shape));
        again.map(|placed| u64::from(placed.count)).sum()
    }

    /// Area of all triangles, one side of each, m2.
    #[must_use]
    pub fn surface_area(&self) -> f64 {
        let area = |[a, b, c]: &[Vec3; 3]| f64::from((*b - *a).cross(*c - *a).length()) * 0.5;
        self.triangles.iter().map(area).sum()
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
        let weights = [1.0 - u - v, u, v];
        let uv = interpolated(&self.texture_coordinates[triangle], weights);
        let emissive_uv =
            self.emissive_coordinates.as_ref().map_or(uv, |all| interpolated(&all[triangle], weights));
        let colour = self.corner_colours.as_ref().map_or([1.0; 4], |all| {
            interpolated(&all[triangle].map(|corner| corner.map(f32::from)), weights)
                .map(|part| part / 65535.0)
        });
        material.surface_tinted(&self.textures, [uv, emissive_uv], colour, front)
    }

    /// Whether anything emits: some triangle has a material that does.
    #[must_use]
    pub fn emits(&self) -> bool {
        let emits: Vec<bool> = self.materials.iter().map(Material::emits).collect();
        // Where no material does, which is asked often, there is no need to go through millions of triangles.
        emits.contains(&true) && self.material_of.iter().any(|&of| emits[of as usize])
    }

    /// Whether any material has an alpha mask, so that rays must ask [`Self::surface`].
    #[must_use]
    pub fn has_masks(&self) -> bool {
        self.materials.iter().any(|material| material.alpha_cutoff.is_some())
    }
}

impl Material {
    /// Opaque, of one side, reflecting so much of all colours; emits nothing.
    #[must_use]
    pub fn grey(name: &str, reflectance: f32) -> Self {
        Self {
            name: name.to_owned(),
            base_colour: [reflectance, reflectance, reflectance, 1.0],
            base_colour_texture: None,
            emitted_radiance: Rgb::ZERO,
            emissive_texture: None,
            alpha_cutoff: None,
            double_sided: false,
            metallic: 0.0,
        }
    }

    /// Whether its factor lets anything out. The importer leaves none where a texture is black all over.
    #[must_use]
    pub fn emits(&self) -> bool {
        self.emitted_radiance.max_element() > 0.0
    }

    /// What a ray finds at texture coordinates `uv`, which serve both textures.
    #[must_use]
    pub fn surface(&self, textures: &[Texture], uv: [f32; 2], front: bool) -> Surface {
        self.surface_tinted(textures, [uv, uv], [1.0; 4], front)
    }

    /// As [`Self::surface`], with coordinates for base colour and emission apart and a colour that multiplies the
    /// base colour.
    #[must_use]
    pub fn surface_tinted(
        &self,
        textures: &[Texture],
        [uv, emissive_uv]: [[f32; 2]; 2],
        colour: [f32; 4],
        front: bool,
    ) -> Surface {
        let texel = |index: Option<usize>, uv| index.map_or([1.0; 4], |i: usize| textures[i].sample(uv));
        let base = texel(self.base_colour_texture, uv);
        let [red, green, blue, alpha] = std::array::from_fn(|k| base[k] * self.base_colour[k] * colour[k]);
        let emits = front || self.double_sided;
        let emitted_radiance = if emits && self.emitted_radiance != Rgb::ZERO {
            let [red, green, blue, _] = texel(self.emissive_texture, emissive_uv);
            self.emitted_radiance * Rgb::new(red, green, blue)
        } else {
            Rgb::ZERO
        };
        Surface {
            reflectance: Rgb::new(red, green, blue)
                .clamp(Rgb::ZERO, Rgb::splat(earthshine_world::Patch::REFLECTANCE_MAX)),
            emitted_radiance,
            is_hole: self.alpha_cutoff.is_some_and(|cutoff| alpha < cutoff),
        }
    }
}

fn interpolated<const N: usize>([p, q, r]: &[[f32; N]; 3], weights: [f32; 3]) -> [f32; N] {
    std::array::from_fn(|k| p[k] * weights[0] + q[k] * weights[1] + r[k] * weights[2])
}
