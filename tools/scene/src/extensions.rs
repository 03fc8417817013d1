//! Which glTF extensions are read, which may be ignored, and which make a file unusable.
//!
//! A file is refused rather than loaded wrong: required extensions that are not read, and used ones that change
//! geometry even where the file calls them optional. Start at [`check`].

use crate::SceneError;

/// Read and honoured.
const READ: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Gloss, glass and data beside the picture: a diffuse scene has no place for them and stays right without.
const WITHOUT_DIFFUSE_LIGHT: &[&str] = &[
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_structural_metadata",
    "FB_geometry_metadata",
    "KHR_animation_pointer",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_lod",
];

/// They replace or add geometry, so ignoring them would load another scene.
const CHANGES_GEOMETRY: &[&str] = &[
    "EXT_meshopt_compression",
    "EXT_primitive_voxels",
    "KHR_draco_mesh_compression",
    "KHR_gaussian_splatting",
    "KHR_gaussian_splatting_compression_spz",
    "KHR_meshopt_compression",
    "MPEG_mesh_linking",
];

/// What a file says of its extensions.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct Declared {
    extensions_used: Vec<String>,
    extensions_required: Vec<String>,
}

/// Refuses what cannot be loaded right; returns a sentence for each extension that is ignored.
///
/// # Errors
/// [`SceneError::UnsupportedExtension`], with the command that converts the file.
pub(crate) fn check(file: &str, declared: &Declared) -> Result<Vec<String>, SceneError> {
    let known = |list: &[&str], name: &String| list.contains(&name.as_str());
    let refused = declared
        .extensions_required
        .iter()
        .find(|name| !known(READ, name) && !known(WITHOUT_DIFFUSE_LIGHT, name));
    let refused =
        refused.or_else(|| declared.extensions_used.iter().find(|name| known(CHANGES_GEOMETRY, name)));
    if let Some(name) = refused {
        return Err(unsupported(file, name));
    }
    let mut names: Vec<&String> =
        declared.extensions_used.iter().chain(&declared.extensions_required).collect();
    names.sort();
    names.dedup();
    names.retain(|name| !known(READ, name));
    let sentence = |name: &String| {
        if known(WITHOUT_DIFFUSE_LIGHT, name) {
            format!("{name} is ignored: surfaces are diffuse and opaque")
        } else {
            format!("{name} is unknown and ignored")
        }
    };
    Ok(names.into_iter().map(sentence).collect())
}

/// The error for extension `name`, with its cure.
pub(crate) fn unsupported(file: &str, name: &str) -> SceneError {
    let command = match name {
        "KHR_draco_mesh_compression" | "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
            Some("gltf-transform copy in.glb out.glb")
        }
        "KHR_texture_basisu" => Some("gltf-transform ktxdecompress in.glb out.glb"),
        "EXT_texture_webp" | "EXT_texture_avif" => Some("gltf-transform png in.glb out.glb --formats \"*\""),
        _ => None,
    };
    let cure = match command {
        Some(command) => format!("convert the file with `{command}`"),
        None => "export the scene without it".to_owned(),
    };
    SceneError::UnsupportedExtension { file: file.to_owned(), name: name.to_owned(), cure }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn declared(used: &[&str], required: &[&str]) -> Declared {
        let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        Declared { extensions_used: owned(used), extensions_required: owned(required) }
    }

    #[test]
    fn geometry_in_an_optional_extension_is_refused_by_name_and_cure() {
        let error = check("a.glb", &declared(&["KHR_draco_mesh_compression"], &[])).unwrap_err().to_string();
        assert!(error.contains("KHR_draco_mesh_compression"), "{error}");
        assert!(error.contains("gltf-transform copy in.glb out.glb"), "{error}");
    }

    #[test]
    fn unknown_extensions_are_refused_only_where_required() {
        assert!(check("a.glb", &declared(&["ACME_sparkle"], &["ACME_sparkle"])).is_err());
        let warnings = check("a.glb", &declared(&["ACME_sparkle", "KHR_texture_transform"], &[])).unwrap();
        assert_eq!(warnings, ["ACME_sparkle is unknown and ignored"]);
    }

    #[test]
    fn gloss_may_be_required() {
        let warnings = check("a.glb", &declared(&[], &["KHR_materials_ior"])).unwrap();
        assert!(warnings[0].starts_with("KHR_materials_ior is ignored"));
    }
}
