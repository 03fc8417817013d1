//! What a bake is a bake of: one number for how it is baked, one for everything its bytes depend on.

use earthshine_scene::Scene;
use earthshine_tiles::BakeParameters;
use xxhash_rust::xxh3::Xxh3Default;

/// Raised when the same scene and parameters would give other bytes than before.
pub(crate) const RECIPE: u32 = 9;

/// Hash of the parameters and the recipe: worlds that share it can have tiles in common, whatever the scene.
#[must_use]
pub fn world_hash(parameters: &BakeParameters) -> u64 {
    let mut hash = Xxh3Default::new();
    hash.update(&RECIPE.to_le_bytes());
    hash.update(&parameters.content_hash().to_le_bytes());
    hash.digest()
}

/// Hash of the scene (geometry, materials, textures, lamps), the parameters and the recipe: everything that the bytes
/// of a world depend on.
#[must_use]
pub fn content_hash(scene: &Scene, parameters: &BakeParameters) -> u64 {
    let mut hash = Xxh3Default::new();
    hash.update(&world_hash(parameters).to_le_bytes());
    hash.update(bytemuck::cast_slice(&scene.triangles));
    hash.update(bytemuck::cast_slice(&scene.texture_coordinates));
    hash.update(bytemuck::cast_slice(&scene.material_of));
    if let Some(coordinates) = &scene.emissive_coordinates {
        hash.update(bytemuck::cast_slice(coordinates));
    }
    if let Some(colours) = &scene.corner_colours {
        hash.update(bytemuck::cast_slice(colours));
    }
    for material in &scene.materials {
        hash.update(format!("{material:?}").as_bytes());
    }
    for texture in &scene.textures {
        hash.update(format!("{} {} {:?}", texture.width, texture.height, texture.wrap).as_bytes());
        hash.update(format!("{} {:?}", texture.nearest, texture.transform).as_bytes());
        hash.update(bytemuck::cast_slice(&texture.texels));
    }
    hash.update(format!("{:?}", scene.lights).as_bytes());
    hash.digest()
}
