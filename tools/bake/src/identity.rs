//! What a bake is a bake of: one number for everything its bytes depend on.

use earthshine_scene::Scene;
use earthshine_tiles::BakeParameters;
use xxhash_rust::xxh3::Xxh3Default;

/// Raised when the same scene and parameters would give other bytes than before.
const RECIPE: u32 = 3;

/// Hash of the scene (geometry, materials, textures, lamps), the parameters and the recipe.
#[must_use]
pub fn world_hash(scene: &Scene, parameters: &BakeParameters) -> u64 {
    let mut hash = Xxh3Default::new();
    hash.update(&RECIPE.to_le_bytes());
    hash.update(format!("{parameters:?}").as_bytes());
    hash.update(bytemuck::cast_slice(&scene.triangles));
    hash.update(bytemuck::cast_slice(&scene.texture_coordinates));
    hash.update(bytemuck::cast_slice(&scene.material_of));
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
