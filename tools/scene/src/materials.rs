//! glTF materials to diffuse ones, and which texture coordinates each of them reads.
//!
//! Gloss, normal maps and transmission have no place in a diffuse scene and are not read. Start at [`import`].

use crate::document::Document;
use crate::images::Images;
use crate::punctual::names;
use crate::{ImportOptions, Material, SceneError, Texture};
use earthshine_world::light::RADIANCE_WARNING;
use earthshine_world::{Patch, Rgb};
use gltf::json;
use gltf::json::material::AlphaMode;
use gltf::json::validation::Checked;

/// Where a texture finds its coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct UvSource {
    /// `TEXCOORD_n`.
    pub(crate) set: u32,
    /// `KHR_texture_transform`, a 2 x 3 matrix, row by row.
    pub(crate) transform: [f32; 6],
}

/// Coordinates of the two textures a material may have.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct UvSources {
    pub(crate) base: Option<UvSource>,
    pub(crate) emissive: Option<UvSource>,
}

/// All materials of a file; the last is the one of primitives that name none, which counts only where used.
#[derive(Debug)]
pub(crate) struct Materials {
    pub(crate) materials: Vec<Material>,
    /// One a material.
    pub(crate) uv_sources: Vec<UvSources>,
    /// One a material: the least alpha it has anywhere, vertex colours apart.
    pub(crate) least_alpha: Vec<f32>,
    pub(crate) textures: Vec<Texture>,
    /// One a material: whether its reflectance exceeds the limit somewhere.
    pub(crate) is_clamped: Vec<bool>,
    pub(crate) blended: u64,
    pub(crate) warnings: Vec<String>,
}

/// Blended surfaces are solid from here on.
const BLEND_CUTOFF: f32 = 0.5;

/// glTF's own default for `MASK`.
const MASK_CUTOFF: f32 = 0.5;

/// Reads all materials and decodes the textures they use.
///
/// # Errors
/// Images as in [`Images::texture`], and factors that are not finite or negative.
pub(crate) fn import(document: &Document<'_>, options: &ImportOptions) -> Result<Materials, SceneError> {
    let mut images = Images::new(document, options.texel_limit);
    let count = document.root.materials.len() + 1;
    let mut all = Materials {
        materials: Vec::with_capacity(count),
        uv_sources: Vec::with_capacity(count),
        least_alpha: Vec::with_capacity(count),
        textures: Vec::new(),
        is_clamped: Vec::with_capacity(count),
        blended: 0,
        warnings: Vec::new(),
    };
    let (mut averaged_metalness, mut put_out) = (0, Vec::new());
    for (index, json) in document.root.materials.iter().enumerate() {
        let (mut material, uv_sources) = read(document, &mut images, index, json)?;
        if options.metals_black {
            let texture = json.pbr_metallic_roughness.metallic_roughness_texture.as_ref();
            if let Some(texture) = texture.filter(|_| material.metallic > 0.0) {
                material.metallic *= images.mean_blue(texture.index.value())?;
                averaged_metalness += 1;
            }
            let [red, green, blue, alpha] = material.base_colour;
            let left = 1.0 - material.metallic.clamp(0.0, 1.0);
            material.base_colour = [red * left, green * left, blue * left, alpha];
        }
        if is_put_out(json) {
            put_out.push(format!("material {index} `{}`", material.name));
        }
        let brightest = material.emitted_radiance.max_element();
        if brightest > RADIANCE_WARNING {
            all.warnings.push(format!(
                "material {index} `{}` emits {brightest:.1e} cd/m2, more than {RADIANCE_WARNING:.0e}: \
                 is its emissive strength in cd/m2?",
                material.name
            ));
        }
        all.blended += u64::from(json.alpha_mode == Checked::Valid(AlphaMode::Blend));
        all.push(material, uv_sources, &images);
    }
    let put_out = names(put_out.iter());
    all.warnings.extend(put_out.map(|names| format!("an emissive strength of zero gives no light: {names}")));
    // Whoever names no material did not mean a metal, although glTF's default for the factor is one.
    all.push(Material::grey("default", 1.0), UvSources::default(), &images);
    if averaged_metalness > 0 {
        all.warnings.push(format!(
            "metalness textures of {averaged_metalness} materials were averaged to make metals black"
        ));
    }
    if images.without_image > 0 {
        all.warnings.push(format!("{} textures without an image were taken as white", images.without_image));
    }
    all.textures = images.textures;
    Ok(all)
}

impl Materials {
    fn push(&mut self, material: Material, uv_sources: UvSources, images: &Images<'_>) {
        let range = images.range(material.base_colour_texture);
        let most = Patch::REFLECTANCE_MAX + 1e-6;
        self.is_clamped.push((0..3).any(|k| material.base_colour[k] * range.brightest[k] > most));
        self.least_alpha.push(range.least_alpha * material.base_colour[3]);
        self.materials.push(material);
        self.uv_sources.push(uv_sources);
    }
}

fn read(
    document: &Document<'_>,
    images: &mut Images<'_>,
    index: usize,
    json: &json::Material,
) -> Result<(Material, UvSources), SceneError> {
    let name = json.name.clone().unwrap_or_else(|| format!("material {index}"));
    let wrong = |cause: &str| document.malformed(format!("material {index} `{name}`"), cause);
    let extensions = json.extensions.as_ref();
    let metal_rough = &json.pbr_metallic_roughness;
    // Archives from before metal and roughness: their diffuse colour is the reflectance.
    let (base_colour, base_texture, metallic) =
        match extensions.and_then(|known| known.pbr_specular_glossiness.as_ref()) {
            Some(gloss) => (gloss.diffuse_factor.0, gloss.diffuse_texture.as_ref(), 0.0),
            None => {
                let metallic = metal_rough.metallic_factor.0;
                (metal_rough.base_color_factor.0, metal_rough.base_color_texture.as_ref(), metallic)
            }
        };
    let is_unlit = extensions.is_some_and(|known| known.unlit.is_some());
    let strength = emissive_strength(json);
    let emitted_radiance = Rgb::from_array(json.emissive_factor.0) * strength;
    if !(base_colour.iter().all(|part| part.is_finite() && *part >= 0.0) && metallic.is_finite()) {
        return Err(wrong("its base colour or metalness is negative or not finite"));
    }
    // Two negative numbers would make a light.
    if !(emitted_radiance.is_finite() && emitted_radiance.min_element() >= 0.0 && strength >= 0.0) {
        return Err(wrong("its emission is negative or not finite"));
    }
    let alpha_cutoff = match json.alpha_mode {
        Checked::Valid(AlphaMode::Opaque) => None,
        Checked::Valid(AlphaMode::Mask) => Some(json.alpha_cutoff.map_or(MASK_CUTOFF, |cutoff| cutoff.0)),
        Checked::Valid(AlphaMode::Blend) => Some(BLEND_CUTOFF),
        Checked::Invalid => return Err(wrong("its alpha mode is none of OPAQUE, MASK and BLEND")),
    };
    let emissive = json.emissive_texture.as_ref().filter(|_| emitted_radiance != Rgb::ZERO);
    let (base_colour_texture, base) = textured(images, base_texture)?;
    let (emissive_texture, emissive) = textured(images, emissive)?;
    // Black all over, which is common beside a factor of one: nobody else looks at all texels to find that nothing emits.
    let most = emitted_radiance * Rgb::from_array(images.range(emissive_texture).brightest);
    let (emitted_radiance, emissive_texture, emissive) = if most == Rgb::ZERO {
        (Rgb::ZERO, None, None)
    } else {
        (emitted_radiance, emissive_texture, emissive)
    };
    let material = Material {
        base_colour,
        base_colour_texture,
        emitted_radiance,
        emissive_texture,
        alpha_cutoff,
        double_sided: json.double_sided,
        metallic: if is_unlit { 0.0 } else { metallic.clamp(0.0, 1.0) },
        name,
    };
    Ok((material, UvSources { base, emissive }))
}

fn emissive_strength(json: &json::Material) -> f32 {
    let strength = json.extensions.as_ref().and_then(|known| known.emissive_strength.as_ref());
    strength.map_or(1.0, |known| known.emissive_strength.0)
}

/// Whether it has a colour to emit and no strength to do it.
fn is_put_out(json: &json::Material) -> bool {
    emissive_strength(json) == 0.0 && json.emissive_factor.0.iter().any(|&part| part > 0.0)
}

type Textured = (Option<usize>, Option<UvSource>);

fn textured(images: &mut Images<'_>, info: Option<&json::texture::Info>) -> Result<Textured, SceneError> {
    let Some(info) = info else {
        return Ok((None, None));
    };
    let texture = images.texture(info.index.value())?;
    let mut source = UvSource { set: info.tex_coord, transform: Texture::IDENTITY };
    if let Some(json) = info.extensions.as_ref().and_then(|known| known.texture_transform.as_ref()) {
        source.set = json.tex_coord.unwrap_or(source.set);
        let ([left, top], [wide, high]) = (json.offset.0, json.scale.0);
        // Counter-clockwise as seen, with v down the image: the extension's worked example fixes the signs.
        let (sine, cosine) = json.rotation.0.sin_cos();
        source.transform = [cosine * wide, sine * high, left, -sine * wide, cosine * high, top];
    }
    Ok((texture, texture.map(|_| source)))
}
