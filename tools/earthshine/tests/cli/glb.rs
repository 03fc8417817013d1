//! The smallest scenes that a test can break: a square lamp over a square floor.

use serde_json::{Value, json};
use std::path::Path;

const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;

/// A glTF file in the making; nothing is checked.
#[derive(Clone)]
pub(crate) struct Gltf {
    pub(crate) json: Value,
    /// Buffer 0: twelve floats of four floor corners, twelve of the lamp's, then twelve indices.
    pub(crate) binary: Vec<u8>,
}

impl Gltf {
    /// A floor of 2 m and a lamp of 1 m above it.
    pub(crate) fn lamp_over_floor() -> Self {
        let square = |edge: f32, height: f32| {
            [[-edge, height, -edge], [-edge, height, edge], [edge, height, edge], [edge, height, -edge]]
        };
        let corners = [square(1.0, 0.0), square(0.5, 1.2)].concat();
        let indices: [u16; 12] = [0, 1, 2, 0, 2, 3, 0, 2, 1, 0, 3, 2];
        let mut binary: Vec<u8> = corners.concat().iter().flat_map(|number| number.to_le_bytes()).collect();
        binary.extend(indices.iter().flat_map(|index| index.to_le_bytes()));
        let view =
            |offset: u32, length: u32| json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
        let corners =
            |view: u32| json!({"bufferView": view, "componentType": FLOAT, "type": "VEC3", "count": 4});
        let indices = |view: u32| json!({"bufferView": view, "componentType": UNSIGNED_SHORT, "type": "SCALAR", "count": 6});
        let part = |n: u32| json!({"attributes": {"POSITION": n}, "indices": 2 + n, "material": n});
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"name": "Room", "primitives": [part(0), part(1)]}],
            "materials": [
                {"pbrMetallicRoughness": {"baseColorFactor": [0.6, 0.5, 0.4, 1.0], "metallicFactor": 0.0}},
                {"emissiveFactor": [1.0, 0.9, 0.8]}],
            "accessors": [corners(0), corners(1), indices(2), indices(3)],
            "bufferViews": [view(0, 48), view(48, 48), view(96, 12), view(108, 12)],
            "buffers": [{"byteLength": binary.len()}],
        });
        Self { json, binary }
    }

    /// The floor's part of the mesh.
    pub(crate) fn floor(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    /// Gives the floor a picture.
    pub(crate) fn paint_floor(&mut self, image: &str) {
        self.json["images"] = json!([{"uri": image}]);
        self.json["textures"] = json!([{"source": 0}]);
        self.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": 0});
        self.floor()["attributes"]["TEXCOORD_0"] = json!(0);
        self.json["accessors"][0]["type"] = json!("VEC3");
        // The first two of every three floats serve as coordinates.
        self.json["accessors"].as_array_mut().expect("a list").push(json!({
            "bufferView": 4, "componentType": FLOAT, "type": "VEC2", "count": 4}));
        let mut view = self.json["bufferViews"][0].clone();
        view["byteStride"] = json!(12);
        self.json["bufferViews"].as_array_mut().expect("a list").push(view);
        self.floor()["attributes"]["TEXCOORD_0"] = json!(4);
    }

    /// As one file.
    pub(crate) fn glb(&self) -> Vec<u8> {
        let mut text = self.json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let words = |words: &[usize]| -> Vec<u8> {
            words.iter().flat_map(|&word| u32::try_from(word).expect("small").to_le_bytes()).collect()
        };
        let length = 12 + 8 + text.len() + 8 + self.binary.len();
        let mut bytes = b"glTF".to_vec();
        bytes.extend(words(&[2, length, text.len()]));
        bytes.extend(b"JSON");
        bytes.extend(text);
        bytes.extend(words(&[self.binary.len()]));
        bytes.extend(b"BIN\0");
        bytes.extend(&self.binary);
        bytes
    }

    /// As .glb at `path`.
    pub(crate) fn write_glb(&self, path: &Path) {
        std::fs::write(path, self.glb()).expect("a scratch folder");
    }

    /// As .gltf at `path` whose buffer is the file `uri` beside it; that file is not written.
    pub(crate) fn write_gltf(&self, path: &Path, uri: &str) {
        let mut json = self.json.clone();
        json["buffers"][0]["uri"] = json!(uri);
        std::fs::write(path, json.to_string()).expect("a scratch folder");
    }
}
