//! The JSON part of a glTF 2.0 file, as far as these worlds need it. Field names are the specification's.

use serde::Serialize;
use std::collections::BTreeMap;

/// Element types of accessors.
pub(crate) const UNSIGNED_SHORT: u32 = 5123;
pub(crate) const UNSIGNED_INT: u32 = 5125;
pub(crate) const FLOAT: u32 = 5126;
/// What a buffer view is bound to.
pub(crate) const ARRAY_BUFFER: u32 = 34962;
pub(crate) const ELEMENT_ARRAY_BUFFER: u32 = 34963;

pub(crate) const LIGHTS: &str = "KHR_lights_punctual";
pub(crate) const EMISSIVE_STRENGTH: &str = "KHR_materials_emissive_strength";
pub(crate) const INSTANCING: &str = "EXT_mesh_gpu_instancing";

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Document {
    pub(crate) asset: Asset,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) extensions_used: Vec<&'static str>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) extensions_required: Vec<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) extensions: Option<RootExtensions>,
    pub(crate) scene: u32,
    pub(crate) scenes: Vec<Scene>,
    pub(crate) nodes: Vec<Node>,
    pub(crate) materials: Vec<Material>,
    pub(crate) meshes: Vec<Mesh>,
    pub(crate) accessors: Vec<Accessor>,
    pub(crate) buffer_views: Vec<BufferView>,
    pub(crate) buffers: Vec<Buffer>,
}

#[derive(Debug, Serialize)]
pub(crate) struct Asset {
    pub(crate) version: &'static str,
    pub(crate) generator: &'static str,
    pub(crate) extras: Provenance,
}

/// What to ask for to get the same bytes again.
#[derive(Debug, Serialize)]
pub(crate) struct Provenance {
    pub(crate) world: crate::WorldKind,
    pub(crate) options: crate::GenOptions,
}

#[derive(Debug, Serialize)]
pub(crate) struct RootExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub(crate) lights: LightList,
}

#[derive(Debug, Default, Serialize)]
pub(crate) struct LightList {
    pub(crate) lights: Vec<Light>,
}

#[derive(Debug, Serialize)]
pub(crate) struct Light {
    pub(crate) name: String,
    #[serde(rename = "type")]
    pub(crate) kind: &'static str,
    pub(crate) color: [f32; 3],
    pub(crate) intensity: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) range: Option<f32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) spot: Option<Cone>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Cone {
    pub(crate) inner_cone_angle: f32,
    pub(crate) outer_cone_angle: f32,
}

#[derive(Debug, Serialize)]
pub(crate) struct Scene {
    pub(crate) nodes: Vec<u32>,
}

#[derive(Debug, Default, Serialize)]
pub(crate) struct Node {
    pub(crate) name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) mesh: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) translation: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) rotation: Option<[f32; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) scale: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) children: Vec<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) extensions: Option<NodeExtensions>,
}

#[derive(Debug, Default, Serialize)]
pub(crate) struct NodeExtensions {
    #[serde(rename = "KHR_lights_punctual", skip_serializing_if = "Option::is_none")]
    pub(crate) light: Option<LightOfNode>,
    #[serde(rename = "EXT_mesh_gpu_instancing", skip_serializing_if = "Option::is_none")]
    pub(crate) instancing: Option<Instancing>,
}

#[derive(Debug, Serialize)]
pub(crate) struct LightOfNode {
    pub(crate) light: u32,
}

#[derive(Debug, Serialize)]
pub(crate) struct Instancing {
    pub(crate) attributes: BTreeMap<&'static str, u32>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Material {
    pub(crate) name: String,
    pub(crate) pbr_metallic_roughness: MetallicRoughness,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) emissive_factor: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(crate) double_sided: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) extensions: Option<MaterialExtensions>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct MetallicRoughness {
    pub(crate) base_color_factor: [f32; 4],
    pub(crate) metallic_factor: f32,
    pub(crate) roughness_factor: f32,
}

#[derive(Debug, Serialize)]
pub(crate) struct MaterialExtensions {
    #[serde(rename = "KHR_materials_emissive_strength")]
    pub(crate) emissive_strength: Strength,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Strength {
    pub(crate) emissive_strength: f32,
}

#[derive(Debug, Serialize)]
pub(crate) struct Mesh {
    pub(crate) name: String,
    pub(crate) primitives: Vec<Primitive>,
}

#[derive(Debug, Serialize)]
pub(crate) struct Primitive {
    pub(crate) attributes: BTreeMap<&'static str, u32>,
    pub(crate) indices: u32,
    pub(crate) material: u32,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Accessor {
    pub(crate) buffer_view: u32,
    #[serde(skip_serializing_if = "is_zero")]
    pub(crate) byte_offset: u64,
    pub(crate) component_type: u32,
    pub(crate) count: u64,
    #[serde(rename = "type")]
    pub(crate) shape: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) min: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) max: Option<[f32; 3]>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BufferView {
    pub(crate) buffer: u32,
    pub(crate) byte_offset: u64,
    pub(crate) byte_length: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) byte_stride: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) target: Option<u32>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Buffer {
    pub(crate) byte_length: u64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(value: &u64) -> bool {
    *value == 0
}
