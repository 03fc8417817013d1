//! From a file or bytes to a [`Scene`]: the order of the steps and the sentences of the report.
//!
//! Start at [`load`].

use crate::document::Document;
use crate::geometry::{Geometry, Skipped};
use crate::nodes::Walk;
use crate::{Scene, SceneError, materials, nodes, punctual, resource};
use std::path::Path;

/// How to read a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ImportOptions {
    /// Metals reflect nothing instead of their base colour: theirs is mirror light, which a diffuse scene has no
    /// place for. Reflecting it diffusely errs less, so this is off unless asked for.
    pub metals_black: bool,
    /// Most triangles after instancing; about 64 bytes each.
    pub triangle_limit: u64,
    /// Most texels of all decoded textures; 4 bytes each.
    pub texel_limit: u64,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self { metals_black: false, triangle_limit: 50_000_000, texel_limit: 512 << 20 }
    }
}

/// Reads a .glb or .gltf file with the buffers and images beside it.
///
/// # Errors
/// Any [`SceneError`]; nothing is half-loaded.
pub fn load(path: &Path, options: &ImportOptions) -> Result<Scene, SceneError> {
    let file = path.display().to_string();
    let bytes = resource::read_file(path).map_err(|error| SceneError::io(&file, error))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    import(&Document::open(&file, Some(folder), &bytes)?, options)
}

/// Reads a .glb or .gltf in memory; `name` stands for the file in messages. It has no files beside it.
///
/// # Errors
/// Any [`SceneError`].
pub fn load_bytes(bytes: &[u8], name: &str, options: &ImportOptions) -> Result<Scene, SceneError> {
    import(&Document::open(name, None, bytes)?, options)
}

fn import(document: &Document<'_>, options: &ImportOptions) -> Result<Scene, SceneError> {
    let walk = nodes::walk(document)?;
    let materials = materials::import(document, options)?;
    let geometry = Geometry::open(document, &walk.placements, &materials.uv_sources, options)?;
    let mut scene =
        Scene { materials: materials.materials, textures: materials.textures, ..Scene::default() };
    geometry.write(&walk.placements, &mut scene)?;
    if scene.triangles.is_empty() {
        let cause = if scene.report.zero_area_triangles > 0 {
            format!("all {} have no area", scene.report.zero_area_triangles)
        } else {
            format!("{} meshes are placed in the scene", walk.placements.len())
        };
        return Err(SceneError::NoTriangles { file: document.file.to_owned(), cause });
    }
    drop_unused_default(&mut scene);
    if scene.corner_colours.is_none() {
        drop_needless_masks(&mut scene, &materials.least_alpha);
    }
    let (lights, remarks) = punctual::lights(document, &walk.lights)?;
    scene.lights = lights;
    let kept = materials.is_clamped.iter().take(scene.materials.len());
    scene.report.clamped_materials = kept.filter(|&&is_clamped| is_clamped).count() as u64;
    scene.report.blended_materials = materials.blended;
    scene.report.gpu_instances = geometry.instance_count;
    let warnings = document.ignored_extensions.iter().cloned().chain(materials.warnings).chain(remarks);
    scene.report.warnings = warnings.chain(sentences(&walk, &geometry.skipped)).collect();
    Ok(scene)
}

/// The last material stands for none; a scene needs one material at least, but not that one.
fn drop_unused_default(scene: &mut Scene) {
    let default = (scene.materials.len() - 1) as u32;
    if default > 0 && !scene.material_of.contains(&default) {
        scene.materials.pop();
    }
}

/// A mask that cuts nothing off would have every ray ask for the texture.
fn drop_needless_masks(scene: &mut Scene, least_alpha: &[f32]) {
    for (material, &least_alpha) in scene.materials.iter_mut().zip(least_alpha) {
        material.alpha_cutoff = material.alpha_cutoff.filter(|&cutoff| least_alpha < cutoff);
    }
}

fn sentences(walk: &Walk<'_>, skipped: &Skipped) -> impl Iterator<Item = String> {
    let counted = [
        (skipped.point_and_line_primitives, "primitives of points or lines were skipped"),
        (skipped.primitives_without_positions, "primitives without positions were skipped"),
        (skipped.primitives_without_coordinates, "textured primitives have no texture coordinates"),
        (skipped.left_over_vertices, "vertices at the end of a primitive make no whole triangle"),
        (skipped.morphed_primitives, "primitives have morph targets, which are ignored"),
        (walk.skinned_nodes, "nodes have a skin, which is ignored: they stand in their rest pose"),
        (walk.hidden_nodes, "hidden nodes were left out, with all below them"),
    ];
    counted.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"))
}
