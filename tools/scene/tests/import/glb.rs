//! A small writer of .glb and .gltf files. It knows nothing of what is valid, so that tests can break things.

use earthshine_scene::{ImportOptions, Scene, SceneError, load_bytes};
use serde_json::{Value, json};

pub(crate) const FLOAT: u32 = 5126;
pub(crate) const BYTE: u32 = 5120;
pub(crate) const UNSIGNED_BYTE: u32 = 5121;
pub(crate) const SHORT: u32 = 5122;
pub(crate) const UNSIGNED_SHORT: u32 = 5123;
pub(crate) const UNSIGNED_INT: u32 = 5125;

/// A file in the making.
#[derive(Clone)]
pub(crate) struct Glb {
    /// The tree; change it at will.
    pub(crate) json: Value,
    /// Buffer 0.
    pub(crate) binary: Vec<u8>,
}

impl Glb {
    /// One empty scene.
    pub(crate) fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}],
            "nodes": [], "meshes": [], "accessors": [], "bufferViews": [], "buffers": [{"byteLength": 0}],
        });
        Self { json, binary: Vec::new() }
    }

    /// Appends to a list of the tree, making it where needed; returns the index.
    pub(crate) fn push(&mut self, list: &str, value: Value) -> usize {
        if self.json.get(list).is_none() {
            self.json[list] = json!([]);
        }
        let list = self.json[list].as_array_mut().expect("a list");
        list.push(value);
        list.len() - 1
    }

    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let offset = self.binary.len();
        self.binary.extend_from_slice(bytes);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    pub(crate) fn accessor(&mut self, bytes: &[u8], kind: u32, shape: &str, count: usize) -> usize {
        let view = self.view(bytes);
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": kind, "type": shape, "count": count}),
        )
    }

    pub(crate) fn floats(&mut self, values: &[f32], shape: &str) -> usize {
        let width = match shape {
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 1,
        };
        self.accessor(&bytes_of(values), FLOAT, shape, values.len() / width)
    }

    /// A mesh of one primitive with these attributes and other members.
    pub(crate) fn mesh(&mut self, attributes: Value, others: Value) -> usize {
        let mut primitive = json!({"attributes": attributes});
        for (key, value) in others.as_object().expect("an object") {
            primitive[key] = value.clone();
        }
        self.push("meshes", json!({"primitives": [primitive]}))
    }

    /// A node at the root of the scene.
    pub(crate) fn node(&mut self, node: Value) -> usize {
        let index = self.push("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().expect("a list").push(json!(index));
        index
    }

    /// The triangle (0,0,0) (1,0,0) (0,1,0), facing +Z, as mesh 0 of node 0; texture coordinates are its x and y.
    pub(crate) fn triangle() -> Self {
        let mut glb = Self::new();
        let positions = glb.floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0.], "VEC3");
        let coordinates = glb.floats(&[0., 0., 1., 0., 0., 1.], "VEC2");
        let mesh = glb.mesh(json!({"POSITION": positions, "TEXCOORD_0": coordinates}), json!({}));
        glb.node(json!({"mesh": mesh}));
        glb
    }

    /// [`Self::triangle`] with this material.
    pub(crate) fn with_material(material: Value) -> Self {
        let mut glb = Self::triangle();
        let material = glb.push("materials", material);
        glb.json["meshes"][0]["primitives"][0]["material"] = json!(material);
        glb
    }

    /// A texture of `width` by however many texels, as a PNG inside the file.
    pub(crate) fn texture(&mut self, width: u32, texels: &[[u8; 4]]) -> usize {
        let view = self.view(&png(width, texels));
        let image = self.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
        self.push("textures", json!({"source": image}))
    }

    pub(crate) fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    /// The whole file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        if json["buffers"][0].get("uri").is_none() && json["buffers"][0]["byteLength"] == json!(0) {
            json["buffers"][0]["byteLength"] = json!(self.binary.len());
        }
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut binary = self.binary.clone();
        binary.resize(binary.len().next_multiple_of(4), 0);
        let length = 12 + 8 + text.len() + 8 + binary.len();
        let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
        let mut bytes = b"glTF".to_vec();
        bytes.extend(words(&[2, length as u32, text.len() as u32]));
        bytes.extend(b"JSON");
        bytes.extend(text);
        bytes.extend(words(&[binary.len() as u32]));
        bytes.extend(b"BIN\0");
        bytes.extend(binary);
        bytes
    }

    pub(crate) fn load(&self) -> Result<Scene, SceneError> {
        load_bytes(&self.bytes(), "test.glb", &ImportOptions::default())
    }

    pub(crate) fn scene(&self) -> Scene {
        self.load().expect("a good file")
    }

    pub(crate) fn error(&self) -> SceneError {
        self.load().expect_err("a bad file")
    }
}

pub(crate) fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

pub(crate) fn png(width: u32, texels: &[[u8; 4]]) -> Vec<u8> {
    let image = image::RgbaImage::from_raw(width, texels.len() as u32 / width, texels.concat());
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.expect("whole rows").write_to(&mut bytes, image::ImageFormat::Png).expect("memory");
    bytes.into_inner()
}
