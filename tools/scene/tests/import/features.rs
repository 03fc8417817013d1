//! Geometry: transforms, topologies, numbers of all kinds, files beside the file.

use crate::glb::{BYTE, Glb, SHORT, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT, bytes_of};
use earthshine_scene::{ImportOptions, ImportReport, Scene, load};
use earthshine_world::Vec3;
use serde_json::json;
use std::f32::consts::FRAC_1_SQRT_2;

fn near(a: Vec3, b: Vec3) -> bool {
    (a - b).length() < 1e-5
}

fn corners(scene: &Scene, triangle: usize) -> [[f32; 3]; 3] {
    scene.triangles[triangle].map(|corner| corner.to_array())
}

#[test]
fn a_triangle_arrives_as_written() {
    let scene = Glb::triangle().scene();
    assert_eq!(corners(&scene, 0), [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]);
    assert_eq!(scene.normal(0), Vec3::Z);
    assert_eq!((scene.materials.len(), scene.material_of[0]), (1, 0));
    assert_eq!(
        scene.report,
        ImportReport { clamped_materials: 1, ..ImportReport::default() },
        "plain white is clamped"
    );
}

#[test]
fn transforms_compose_down_the_tree() {
    let mut glb = Glb::triangle();
    glb.json["nodes"] = json!([
        {"translation": [10, 0, 0], "children": [1]},
        {"rotation": [0, 0, FRAC_1_SQRT_2, FRAC_1_SQRT_2], "children": [2]},
        {"matrix": [2,0,0,0, 0,2,0,0, 0,0,2,0, 0,0,5,1], "mesh": 0},
    ]);
    let scene = glb.scene();
    assert!(near(scene.triangles[0][1], Vec3::new(10., 2., 5.)), "{:?}", scene.triangles[0]);
    assert!(near(scene.triangles[0][2], Vec3::new(8., 0., 5.)), "{:?}", scene.triangles[0]);
}

#[test]
fn mirrored_nodes_keep_their_front_faces() {
    let mut glb = Glb::triangle();
    glb.json["nodes"][0]["scale"] = json!([-1, 1, 1]);
    let scene = glb.scene();
    assert!(near(scene.normal(0), Vec3::Z), "a mirror in x leaves the side that faces +Z in front");
    assert_eq!(corners(&scene, 0)[2], [-1., 0., 0.]);
    assert_eq!(scene.texture_coordinates[0], [[0.0; 2]; 3], "untextured: coordinates are not kept");
}

#[test]
fn strips_and_fans_keep_one_side_in_front() {
    let mut glb = Glb::new();
    let square = [0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0.];
    let positions = glb.floats(&square, "VEC3");
    let mesh = glb.mesh(json!({"POSITION": positions}), json!({"mode": 5}));
    glb.node(json!({"mesh": mesh}));
    let fan = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];
    let positions = glb.floats(&fan, "VEC3");
    let mesh = glb.mesh(json!({"POSITION": positions}), json!({"mode": 6}));
    glb.node(json!({"mesh": mesh}));
    let scene = glb.scene();
    assert_eq!(scene.triangles.len(), 4);
    for triangle in 0..4 {
        assert_eq!(scene.normal(triangle), Vec3::Z, "triangle {triangle}");
    }
}

#[test]
fn points_and_lines_are_skipped_with_a_warning() {
    let mut glb = Glb::triangle();
    for mode in [0, 1, 2, 3] {
        let mesh = glb.mesh(json!({"POSITION": 0}), json!({"mode": mode}));
        glb.node(json!({"mesh": mesh}));
    }
    let scene = glb.scene();
    assert_eq!(scene.triangles.len(), 1);
    assert!(scene.report.warnings[0].starts_with("4 primitives of points or lines"));
}

#[test]
fn indices_of_all_widths_are_read() {
    for (kind, bytes) in [
        (UNSIGNED_BYTE, vec![2, 0, 1]),
        (UNSIGNED_SHORT, vec![2, 0, 0, 0, 1, 0]),
        (UNSIGNED_INT, vec![2, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]),
    ] {
        let mut glb = Glb::triangle();
        let indices = glb.accessor(&bytes, kind, "SCALAR", 3);
        glb.primitive()["indices"] = json!(indices);
        assert_eq!(corners(&glb.scene(), 0), [[0., 1., 0.], [0., 0., 0.], [1., 0., 0.]]);
    }
}

#[test]
fn strides_and_offsets_are_honoured() {
    let mut glb = Glb::triangle();
    let view = glb.view(&bytes_of(&[9., 0., 0., 0., 9., 9., 1., 0., 0., 9., 9., 0., 1., 0., 9.]));
    glb.json["bufferViews"][view]["byteStride"] = json!(20);
    glb.json["accessors"][0] = json!({
        "bufferView": view, "byteOffset": 4, "componentType": 5126, "type": "VEC3", "count": 3});
    assert_eq!(corners(&glb.scene(), 0), [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]);
}

#[test]
fn quantised_positions_and_coordinates_are_read() {
    let mut glb = Glb::with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    glb.texture(2, &[[0, 0, 0, 255], [255, 255, 255, 255]]);
    let positions = [0i16, 0, 0, 32767, 0, 0, 0, 32767, 0].map(i16::to_le_bytes).concat();
    let positions = glb.accessor(&positions, SHORT, "VEC3", 3);
    glb.json["accessors"][positions]["normalized"] = json!(true);
    let coordinates = glb.accessor(&[0, 0, 255, 0, 0, 255], UNSIGNED_BYTE, "VEC2", 3);
    glb.json["accessors"][coordinates]["normalized"] = json!(true);
    glb.primitive()["attributes"] = json!({"POSITION": positions, "TEXCOORD_0": coordinates});
    glb.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    glb.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let scene = glb.scene();
    assert_eq!(corners(&scene, 0)[1], [1., 0., 0.]);
    assert_eq!(scene.texture_coordinates[0], [[0., 0.], [1., 0.], [0., 1.]]);
    let bytes = glb.accessor(&[0, 0, 0, 10, 0, 0, 0, 0xf6, 0], BYTE, "VEC3", 3);
    glb.primitive()["attributes"]["POSITION"] = json!(bytes);
    assert_eq!(corners(&glb.scene(), 0), [[0., 0., 0.], [10., 0., 0.], [0., -10., 0.]]);
}

#[test]
fn sparse_accessors_replace_and_start_from_zero() {
    let mut glb = Glb::triangle();
    let indices = glb.view(&[1, 0, 2, 0]);
    let values = glb.view(&bytes_of(&[3., 0., 0., 0., 4., 0.]));
    let sparse = json!({
        "count": 2, "indices": {"bufferView": indices, "componentType": UNSIGNED_SHORT},
        "values": {"bufferView": values}});
    glb.json["accessors"][0]["sparse"] = sparse;
    let expected = [[0., 0., 0.], [3., 0., 0.], [0., 4., 0.]];
    assert_eq!(corners(&glb.scene(), 0), expected);
    glb.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(corners(&glb.scene(), 0), expected, "without a view the rest is zero");
}

#[test]
fn without_a_default_scene_all_roots_count() {
    let mut glb = Glb::triangle();
    glb.json.as_object_mut().unwrap().remove("scene");
    glb.json["nodes"] = json!([{"mesh": 0}, {"children": [2]}, {"mesh": 0, "translation": [0, 0, 1]}]);
    glb.json["scenes"] = json!([{"nodes": [0]}, {"nodes": [1]}]);
    assert_eq!(glb.scene().triangles.len(), 2);
    glb.json["scene"] = json!(1);
    assert_eq!(glb.scene().triangles[0][0], Vec3::Z);
}

#[test]
fn triangles_without_area_are_skipped_and_counted() {
    let mut glb = Glb::triangle();
    let indices = glb.accessor(&[0, 1, 2, 0, 1, 1, 2, 2, 2], UNSIGNED_BYTE, "SCALAR", 9);
    glb.primitive()["indices"] = json!(indices);
    let scene = glb.scene();
    assert_eq!((scene.triangles.len(), scene.report.zero_area_triangles), (1, 2));
}

#[test]
fn skins_morphs_and_left_over_vertices_are_said() {
    let mut glb = Glb::triangle();
    glb.primitive()["targets"] = json!([{"POSITION": 0}]);
    glb.push("skins", json!({"joints": [0]}));
    glb.json["nodes"][0]["skin"] = json!(0);
    let indices = glb.accessor(&[0, 1, 2, 0], UNSIGNED_BYTE, "SCALAR", 4);
    glb.primitive()["indices"] = json!(indices);
    let warnings = glb.scene().report.warnings.join("; ");
    for part in ["1 vertices at the end", "1 primitives have morph targets", "1 nodes have a skin"] {
        assert!(warnings.contains(part), "{part} is missing in {warnings}");
    }
}

#[test]
fn buffers_and_images_beside_a_gltf_are_found() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut glb = Glb::with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    glb.push("images", json!({"uri": "red%20brick.png"}));
    glb.push("textures", json!({"source": 0}));
    let red = crate::glb::png(1, &[[255, 0, 0, 255]]);
    std::fs::write(folder.path().join("red brick.png"), red).expect("a file");
    std::fs::write(folder.path().join("mesh.bin"), &glb.binary).expect("a file");
    glb.json["buffers"][0] = json!({"uri": "mesh.bin", "byteLength": glb.binary.len()});
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, glb.json.to_string()).expect("a file");
    let scene = load(&path, &ImportOptions::default()).expect("a good file");
    assert!((scene.surface(0, 0.3, 0.3, true).reflectance - Vec3::new(0.98, 0., 0.)).length() < 1e-6);
}

#[test]
fn data_uris_are_decoded() {
    let mut glb = Glb::triangle();
    // Three vertices of three floats: zeros, then 1.0 at bytes 12 and 28.
    let text = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    glb.push(
        "buffers",
        json!({"uri": format!("data:application/octet-stream;base64,{text}"), "byteLength": 36}),
    );
    let view = glb.push("bufferViews", json!({"buffer": 1, "byteLength": 36}));
    glb.json["accessors"][0]["bufferView"] = json!(view);
    assert_eq!(corners(&glb.scene(), 0), [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]);
}
