//! What of a scene rays notice, as hashes that hang on the thing and not on its number.
//!
//! Rays notice where surfaces are, whether they have holes, whether they glow, and from which faces. They do not
//! notice colours: a repainted wall has other hashes in [`SceneContent::look`] alone.

use earthshine_scene::{Material, Scene};
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

/// Hashes of a scene's materials and lamps.
#[derive(Debug)]
pub struct SceneContent<'a> {
    scene: &'a Scene,
    /// By material: what rays notice of it, and whether its texture coordinates matter.
    traced: Vec<(u64, bool)>,
    looks: Vec<u64>,
    /// Of all lamps, and whether anything emits.
    pub lamps: u64,
}

/// Whether anything emits: see [`Scene::emits`].
pub(crate) fn has_emitters(scene: &Scene) -> bool {
    scene.emits()
}

impl<'a> SceneContent<'a> {
    /// Hashes materials, textures and lamps.
    #[must_use]
    pub fn new(scene: &'a Scene) -> Self {
        let textures: Vec<u64> = scene.textures.iter().map(texture_hash).collect();
        let texture = |index: Option<usize>| index.map_or(0, |index| textures[index]);
        let traced = scene
            .materials
            .iter()
            .map(|material| {
                let glows = material.emits();
                let emissive = if glows { texture(material.emissive_texture) } else { 0 };
                let (holes, cutoff) = material.alpha_cutoff.map_or((0, 0), |cutoff| {
                    let alpha = u64::from(material.base_colour[3].to_bits());
                    (texture(material.base_colour_texture) ^ alpha, 1 + u64::from(cutoff.to_bits()))
                });
                let radiance = xxh3_64(bytemuck::bytes_of(&material.emitted_radiance));
                let words = [u64::from(material.double_sided), radiance, emissive, holes, cutoff];
                (xxh3_64(bytemuck::bytes_of(&words)), emissive != 0 || cutoff != 0)
            })
            .collect();
        let look = |material: &Material| {
            let maps = [texture(material.base_colour_texture), texture(material.emissive_texture)];
            let colours = (material.base_colour, material.emitted_radiance, material.alpha_cutoff);
            xxh3_64(format!("{colours:?} {maps:?} {}", material.double_sided).as_bytes())
        };
        let looks = scene.materials.iter().map(look).collect();
        let lamps = xxh3_64(format!("{:?} {}", scene.lights, has_emitters(scene)).as_bytes());
        Self { scene, traced, looks, lamps }
    }

    /// What rays notice of `triangle`.
    #[must_use]
    pub fn traced(&self, triangle: usize) -> u64 {
        let (material, has_maps) = self.traced[self.scene.material_of[triangle] as usize];
        let mut hash = Xxh3Default::new();
        hash.update(bytemuck::bytes_of(&self.scene.triangles[triangle]));
        hash.update(&material.to_le_bytes());
        if has_maps {
            self.add_attributes(triangle, &mut hash);
        }
        hash.digest()
    }

    /// Everything there is about `triangle`.
    #[must_use]
    pub fn look(&self, triangle: usize) -> u64 {
        let mut hash = Xxh3Default::new();
        hash.update(&self.traced(triangle).to_le_bytes());
        hash.update(&self.looks[self.scene.material_of[triangle] as usize].to_le_bytes());
        self.add_attributes(triangle, &mut hash);
        hash.digest()
    }

    fn add_attributes(&self, triangle: usize, hash: &mut Xxh3Default) {
        hash.update(bytemuck::bytes_of(&self.scene.texture_coordinates[triangle]));
        if let Some(all) = &self.scene.emissive_coordinates {
            hash.update(bytemuck::bytes_of(&all[triangle]));
        }
        if let Some(all) = &self.scene.corner_colours {
            hash.update(bytemuck::bytes_of(&all[triangle]));
        }
    }
}

fn texture_hash(texture: &earthshine_scene::Texture) -> u64 {
    let mut hash = Xxh3Default::new();
    hash.update(format!("{} {} {:?}", texture.width, texture.height, texture.wrap).as_bytes());
    hash.update(format!("{} {:?}", texture.nearest, texture.transform).as_bytes());
    hash.update(bytemuck::cast_slice(&texture.texels));
    // Zero stands for no texture.
    hash.digest().max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::{quad, scene_of};
    use earthshine_world::{Rgb, Vec3};

    #[test]
    fn materials_emit_where_triangles_have_them() {
        let mut scene = scene_of(quad(Vec3::ZERO, Vec3::Z, Vec3::X).to_vec());
        assert!(!has_emitters(&scene));
        let lamp = Material { emitted_radiance: Rgb::X, ..scene.materials[0].clone() };
        scene.materials.push(lamp);
        assert!(!has_emitters(&scene), "nothing is a lamp");
        let spare = SceneContent::new(&scene).lamps;
        scene.material_of[1] = 1;
        assert!(has_emitters(&scene));
        assert_ne!(SceneContent::new(&scene).lamps, spare);
    }
}
