//! Extensions that place or change geometry.

use crate::glb::{Glb, SHORT, UNSIGNED_INT};
use earthshine_scene::SceneError;
use earthshine_world::Vec3;
use serde_json::json;

#[test]
fn instances_in_an_optional_extension_are_not_lost() {
    // 3,200 triangles 50 times: the gltf crate alone would see 3,200.
    let mut glb = Glb::triangle();
    let indices: Vec<u8> = (0..3200).flat_map(|_| [0u32, 1, 2]).flat_map(u32::to_le_bytes).collect();
    let indices = glb.accessor(&indices, UNSIGNED_INT, "SCALAR", 9600);
    glb.primitive()["indices"] = json!(indices);
    let places: Vec<f32> = (0..50).flat_map(|i| [i as f32, 0.0, 0.0]).collect();
    let places = glb.floats(&places, "VEC3");
    glb.json["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}});
    glb.json["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    let scene = glb.scene();
    assert_eq!(scene.triangles.len(), 160_000);
    assert_eq!(scene.report.gpu_instances, 50);
    assert_eq!(scene.bounds().max, Vec3::new(50., 1., 0.));
}

#[test]
fn instances_turn_and_scale_under_their_node() {
    let mut glb = Glb::triangle();
    let places = glb.floats(&[0., 0., 0., 5., 0., 0.], "VEC3");
    // A quarter turn about Z, as normalised shorts; the second scale mirrors.
    let turns = [0i16, 0, 23170, 23170, 0, 0, 0, 32767].map(i16::to_le_bytes).concat();
    let turns = glb.accessor(&turns, SHORT, "VEC4", 2);
    glb.json["accessors"][turns]["normalized"] = json!(true);
    let scales = glb.floats(&[2., 2., 2., -1., 1., 1.], "VEC3");
    glb.json["nodes"][0]["translation"] = json!([0, 0, 7]);
    glb.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {
        "TRANSLATION": places, "ROTATION": turns, "SCALE": scales, "_ID": places}}});
    glb.json["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    glb.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let scene = glb.scene();
    assert!((scene.triangles[0][1] - Vec3::new(0., 2., 7.)).length() < 1e-4, "{:?}", scene.triangles[0]);
    assert!((scene.triangles[1][2] - Vec3::new(4., 0., 7.)).length() < 1e-4, "{:?}", scene.triangles[1]);
    assert_eq!(scene.normal(1), Vec3::Z);
}

#[test]
fn instances_of_different_lengths_are_refused() {
    let mut glb = Glb::triangle();
    let places = glb.floats(&[0.; 6], "VEC3");
    let scales = glb.floats(&[1.; 3], "VEC3");
    glb.json["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places, "SCALE": scales}}});
    assert!(glb.error().to_string().contains("its attributes differ in length"));
}

#[test]
fn hidden_nodes_are_left_out() {
    let mut glb = Glb::triangle();
    glb.node(json!({"mesh": 0, "extensions": {"KHR_node_visibility": {"visible": false}}}));
    let scene = glb.scene();
    assert_eq!(scene.triangles.len(), 1);
    assert_eq!(scene.report.warnings, ["1 hidden nodes were left out, with all below them"]);
}

#[test]
fn compressed_geometry_is_refused_with_the_command_that_converts() {
    for (name, command) in [
        ("KHR_draco_mesh_compression", "gltf-transform copy in.glb out.glb"),
        ("EXT_meshopt_compression", "gltf-transform copy in.glb out.glb"),
    ] {
        let mut glb = Glb::triangle();
        glb.json["extensionsUsed"] = json!([name]);
        let error = glb.error();
        assert!(matches!(&error, SceneError::UnsupportedExtension { name: found, .. } if found == name));
        let text = error.to_string();
        assert!(text.starts_with("test.glb: ") && text.contains(command), "{text}");
    }
}

#[test]
fn unknown_required_extensions_are_refused_by_name() {
    let mut glb = Glb::triangle();
    glb.json["extensionsRequired"] = json!(["ACME_portal"]);
    assert!(glb.error().to_string().contains("ACME_portal"));
}

#[test]
fn texture_formats_we_cannot_decode_are_refused_by_name() {
    let mut glb = Glb::with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    glb.push("textures", json!({"extensions": {"KHR_texture_basisu": {"source": 0}}}));
    glb.json["extensionsUsed"] = json!(["KHR_texture_basisu"]);
    let text = glb.error().to_string();
    assert!(text.contains("KHR_texture_basisu") && text.contains("ktxdecompress"), "{text}");
}
