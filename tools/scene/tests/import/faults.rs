//! Bad input: a clear error that names file and cause, and never a panic.

use crate::glb::{BYTE, Glb, UNSIGNED_BYTE};
use earthshine_scene::{ImportOptions, SceneError, load, load_bytes};
use serde_json::json;
use std::path::Path;

fn load_text(bytes: &[u8]) -> SceneError {
    load_bytes(bytes, "test.glb", &ImportOptions::default()).expect_err("a bad file")
}

#[test]
fn a_missing_file_is_not_found_and_a_folder_is_not_read() {
    let options = ImportOptions::default();
    let error = load(Path::new("no such scene.glb"), &options).expect_err("nothing there");
    assert!(matches!(&error, SceneError::NotFound { file } if file == "no such scene.glb"));
    assert!(matches!(load(Path::new("."), &options), Err(SceneError::Io { .. })));
}

#[test]
fn other_formats_and_versions_are_not_gltf() {
    let mut old = Glb::triangle().bytes();
    old[4] = 1;
    for bytes in [&b""[..], b"PK\x03\x04 a zip", b"{\"a\": }", b"   ", &old] {
        let error = load_text(bytes);
        assert!(matches!(error, SceneError::NotGltf { .. }), "{error}");
    }
    let mut glb = Glb::triangle();
    glb.json["asset"]["version"] = json!("1.0");
    assert!(glb.error().to_string().contains("asset version is `1.0`"));
}

#[test]
fn every_truncation_of_a_glb_is_named_as_such() {
    let bytes = Glb::triangle().bytes();
    for length in 1..bytes.len() {
        let error = load_text(&bytes[..length]);
        assert!(matches!(error, SceneError::Truncated { .. }), "{length} bytes: {error}");
    }
}

#[test]
fn every_flipped_byte_of_a_glb_is_an_error_or_a_scene() {
    let mut glb = Glb::with_material(json!({
        "alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 3.0}}}));
    glb.texture(2, &[[1, 2, 3, 4], [5, 6, 7, 8]]);
    let indices = glb.accessor(&[0, 1, 2], UNSIGNED_BYTE, "SCALAR", 3);
    glb.primitive()["indices"] = json!(indices);
    let places = glb.floats(&[0., 0., 0., 5., 0., 0.], "VEC3");
    glb.json["nodes"][0]["extensions"] = json!({
        "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}},
        "KHR_lights_punctual": {"light": 0}});
    glb.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {}}]}});
    let sparse = glb.view(&[1, 0, 0, 0]);
    glb.json["accessors"][1]["sparse"] = json!({
        "count": 1, "indices": {"bufferView": sparse, "componentType": UNSIGNED_BYTE},
        "values": {"bufferView": 0}});
    assert_eq!(glb.scene().triangles.len(), 2);
    let good = glb.bytes();
    let options = ImportOptions { triangle_limit: 1_000_000, ..ImportOptions::default() };
    let (mut errors, mut scenes) = (0, 0);
    for place in 0..good.len() {
        for flip in [0x01, 0x02, 0x04, 0x08, 0x10, 0x20, 0x40, 0x80, 0xff] {
            let mut bytes = good.clone();
            bytes[place] ^= flip;
            match load_bytes(&bytes, "test.glb", &options) {
                Ok(scene) => {
                    scenes += 1;
                    assert!(scene.surface(0, 0.3, 0.3, true).reflectance.is_finite());
                }
                Err(error) => {
                    errors += 1;
                    assert!(error.to_string().starts_with("test.glb: "), "{error}");
                }
            }
        }
    }
    assert!(errors > 1000 && scenes > 1000, "{errors} errors, {scenes} scenes");
}

#[test]
fn references_that_lead_nowhere_are_named() {
    type Break = fn(&mut Glb);
    let cases: [(Break, &str); 15] = [
        (|glb| glb.json["scene"] = json!(5), "scene 5: it is not there"),
        (|glb| glb.json["scenes"][0]["nodes"] = json!([9]), "node 9: it is not there"),
        (|glb| glb.json["nodes"][0]["mesh"] = json!(9), "mesh 9: it is not there"),
        (|glb| glb.primitive()["attributes"]["POSITION"] = json!(9), "accessor 9: it is not there"),
        (|glb| glb.primitive()["indices"] = json!(9), "accessor 9: it is not there"),
        (|glb| glb.primitive()["indices"] = json!(0), "unsigned integer scalars are needed"),
        (|glb| glb.primitive()["material"] = json!(9), "its material is not there"),
        (|glb| glb.primitive()["material"] = json!(0), "its material is not there"),
        (|glb| glb.primitive()["mode"] = json!(77), "its mode is none that glTF knows"),
        (|glb| glb.json["accessors"][0]["bufferView"] = json!(9), "buffer view 9 is not there"),
        (|glb| glb.json["accessors"][0]["count"] = json!(4), "reach beyond the 36 bytes of buffer view 0"),
        (|glb| glb.json["accessors"][0]["count"] = json!(u64::MAX), "more than the limit"),
        (|glb| glb.json["accessors"][0]["byteOffset"] = json!(u64::MAX), "reach beyond"),
        (|glb| glb.json["bufferViews"][0]["byteLength"] = json!(u64::MAX), "beyond the end of its buffer"),
        (|glb| glb.json["bufferViews"][0]["byteStride"] = json!(4), "its stride of 4 bytes"),
    ];
    for (break_it, cause) in cases {
        let mut glb = Glb::triangle();
        break_it(&mut glb);
        let text = glb.error().to_string();
        assert!(text.starts_with("test.glb: ") && text.contains(cause), "`{cause}` is not in: {text}");
    }
}

#[test]
fn a_vertex_beyond_the_mesh_is_named() {
    let mut glb = Glb::triangle();
    glb.json["meshes"][0]["name"] = json!("Wall");
    let indices = glb.accessor(&[0, 1, 3], UNSIGNED_BYTE, "SCALAR", 3);
    glb.primitive()["indices"] = json!(indices);
    let error = glb.error();
    assert!(matches!(error, SceneError::IndexOutOfRange { index: 3, vertices: 3, .. }), "{error}");
    assert!(error.to_string().contains("mesh 0 `Wall`, primitive 0"), "{error}");
}

#[test]
fn positions_that_are_not_finite_are_named() {
    for odd in [f32::NAN, f32::INFINITY] {
        let mut glb = Glb::triangle();
        glb.binary[16..20].copy_from_slice(&odd.to_le_bytes());
        let error = glb.error();
        assert!(matches!(error, SceneError::NotFinite { primitive: 0, vertex: 1, .. }), "{error}");
        assert!(error.to_string().contains("mesh 0, primitive 0: vertex 1"), "{error}");
    }
    let mut glb = Glb::triangle();
    glb.json["nodes"][0]["scale"] = json!([1e39, 1, 1]);
    assert!(glb.error().to_string().contains("node 0: its transform is not finite"));
}

#[test]
fn cycles_and_shared_nodes_are_refused() {
    for nodes in [
        json!([{"mesh": 0, "children": [0]}]),
        json!([{"mesh": 0, "children": [1]}, {"children": [0]}]),
        json!([{"children": [1, 1]}, {"mesh": 0}]),
    ] {
        let mut glb = Glb::triangle();
        glb.json["nodes"] = nodes;
        assert!(glb.error().to_string().contains("it is reached twice"), "{}", glb.error());
    }
    let mut glb = Glb::triangle();
    glb.json["nodes"] = json!([{"mesh": 0, "children": [0]}]);
    glb.json.as_object_mut().unwrap().remove("scene");
    glb.json.as_object_mut().unwrap().remove("scenes");
    assert!(glb.error().to_string().contains("cycle"));
}

#[test]
fn a_tree_a_hundred_thousand_nodes_deep_is_walked() {
    let mut glb = Glb::triangle();
    let mut nodes: Vec<_> = (1..100_000).map(|child| json!({"children": [child]})).collect();
    nodes.push(json!({"mesh": 0}));
    glb.json["nodes"] = json!(nodes);
    assert_eq!(glb.scene().triangles.len(), 1);
}

#[test]
fn no_triangles_is_said_with_what_was_there() {
    let mut glb = Glb::triangle();
    glb.primitive()["mode"] = json!(0);
    assert!(matches!(glb.error(), SceneError::NoTriangles { .. }));
    let mut glb = Glb::triangle();
    glb.json["nodes"][0]["scale"] = json!([0, 0, 0]);
    assert!(glb.error().to_string().contains("all 1 have no area"));
    assert!(matches!(Glb::new().error(), SceneError::NoTriangles { .. }));
}

#[test]
fn missing_short_and_unreachable_buffers_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("scene.gltf");
    let mut glb = Glb::triangle();
    let mut load_with = |uri: &str| {
        glb.json["buffers"][0] = json!({"uri": uri, "byteLength": glb.binary.len()});
        std::fs::write(&path, glb.json.to_string()).expect("a file");
        load(&path, &ImportOptions::default()).expect_err("a bad buffer")
    };
    std::fs::write(folder.path().join("short.bin"), [0; 8]).expect("a file");
    for uri in ["gone.bin", "http://example.org/a.bin", "/etc/hostname", "%ff.bin", "data:;base64,!!"] {
        let error = load_with(uri);
        assert!(matches!(&error, SceneError::MissingBuffer { uri: found, .. } if found == uri), "{error}");
    }
    let error = load_with("short.bin");
    assert!(matches!(error, SceneError::Truncated { .. }), "{error}");
    let mut glb = Glb::triangle();
    glb.json["buffers"][0] = json!({"uri": "a.bin", "byteLength": 1});
    assert!(glb.error().to_string().contains("loaded from memory"));
    let mut text = Glb::triangle();
    text.json["buffers"][0]["byteLength"] = json!(60);
    assert!(matches!(load_text(text.json.to_string().as_bytes()), SceneError::MissingBuffer { .. }));
}

#[test]
fn missing_and_broken_images_are_named() {
    let with_image = |image: serde_json::Value| {
        let mut glb = Glb::with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
        let view = glb.view(b"GIF89a and more");
        glb.push("images", if image.is_null() { json!({"bufferView": view}) } else { image });
        glb.push("textures", json!({"source": 0}));
        glb.error()
    };
    let error = with_image(json!({"uri": "gone.png"}));
    assert!(matches!(&error, SceneError::MissingTexture { uri, .. } if uri == "gone.png"), "{error}");
    assert!(matches!(with_image(json!({})), SceneError::MissingTexture { .. }));
    let error = with_image(serde_json::Value::Null);
    assert!(matches!(error, SceneError::BadImage { .. }), "{error}");
    let mut cut = Glb::with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    cut.texture(2, &[[1, 2, 3, 4], [5, 6, 7, 8]]);
    let view = cut.json["images"][0]["bufferView"].as_u64().unwrap() as usize;
    cut.json["bufferViews"][view]["byteLength"] = json!(50);
    assert!(matches!(cut.error(), SceneError::BadImage { .. }));
}

#[test]
fn limits_are_named() {
    let glb = Glb::triangle();
    let options = ImportOptions { triangle_limit: 0, ..ImportOptions::default() };
    let error = load_bytes(&glb.bytes(), "test.glb", &options).expect_err("over the limit");
    assert!(matches!(error, SceneError::Limit { amount: 1, limit: 0, .. }), "{error}");
    // Billions of instances out of thin air: an accessor without a view is all zeros, and costs no bytes.
    let mut glb = Glb::triangle();
    let many = json!({"componentType": 5126, "type": "VEC3", "count": 4_000_000_000u32});
    let many = glb.push("accessors", many);
    glb.json["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": many}}});
    assert!(matches!(glb.error(), SceneError::Limit { amount: 4_000_000_000, .. }));
}

#[test]
fn materials_with_impossible_numbers_are_named() {
    for material in [
        json!({"name": "Lamp", "emissiveFactor": [-1, 0, 0]}),
        json!({"name": "Lamp", "emissiveFactor": [1e39, 0, 0]}),
        json!({"name": "Lamp", "pbrMetallicRoughness": {"baseColorFactor": [-1, 0, 0, 1]}}),
        json!({"name": "Lamp", "alphaMode": "DITHER"}),
    ] {
        let error = Glb::with_material(material).error();
        assert!(error.to_string().contains("material 0 `Lamp`"), "{error}");
    }
}

#[test]
fn sparse_indices_must_increase_inside_the_accessor() {
    for indices in [[1, 1], [2, 1], [1, 3]] {
        let mut glb = Glb::triangle();
        let places = glb.view(&indices);
        let values = glb.view(&[0; 24]);
        glb.json["accessors"][0]["sparse"] = json!({
            "count": 2, "indices": {"bufferView": places, "componentType": UNSIGNED_BYTE},
            "values": {"bufferView": values}});
        assert!(glb.error().to_string().contains("sparse indices"), "{indices:?}");
        glb.json["accessors"][0]["sparse"]["indices"]["componentType"] = json!(BYTE);
        assert!(glb.error().to_string().contains("no valid type"));
    }
}
