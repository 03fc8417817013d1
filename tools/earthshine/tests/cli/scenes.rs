//! `bake` with scenes that are not: exit code 3, the file and the cause by name, and no trace of a world.

use crate::command::{INPUT, Run, bake, files, run};
use crate::glb::Gltf;
use serde_json::json;
use std::path::Path;
use tempfile::TempDir;

/// A scratch folder and the one scene in it.
struct Desk {
    folder: TempDir,
}

impl Desk {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a scratch folder") }
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    fn bake(&self, scene: &str) -> Run {
        run(self.path(), &bake(scene, "world"))
    }

    /// The scene is refused for `cause`, nothing is written, and the mended scene bakes into the same folder.
    #[track_caller]
    fn refuses(&self, scene: &str, words: &[&str], mend: impl FnOnce(&Path)) {
        let before = files(self.path());
        self.bake(scene).fails(INPUT, &[&[scene][..], words].concat());
        assert_eq!(files(self.path()), before, "nothing is written");
        assert!(!self.path().join("world").is_dir(), "not even a folder");
        mend(self.path());
        self.bake(scene).succeeds();
        run(self.path(), &["inspect", "world", "verify"]).succeeds();
    }

    /// As [`Self::refuses`] with a scene that `spoil` has spoiled.
    #[track_caller]
    fn refuses_spoiled(spoil: impl FnOnce(&mut Gltf), words: &[&str]) {
        let desk = Self::new();
        let mut scene = Gltf::lamp_over_floor();
        spoil(&mut scene);
        scene.write_glb(&desk.path().join("room.glb"));
        desk.refuses("room.glb", words, write_sound);
    }
}

fn write_sound(folder: &Path) {
    Gltf::lamp_over_floor().write_glb(&folder.join("room.glb"));
}

#[test]
fn a_missing_file() {
    Desk::new().refuses("room.glb", &["there is no such file", "check the path"], write_sound);
}

#[test]
fn a_file_that_is_not_gltf() {
    for bytes in [&b"solid a_stereolithography_file"[..], b"", b"PK\x03\x04 a zip", b"{\"asset\": }"] {
        let desk = Desk::new();
        std::fs::write(desk.path().join("room.glb"), bytes).expect("a scratch folder");
        desk.refuses("room.glb", &["not glTF 2.0", "export the scene as .glb"], write_sound);
    }
}

#[test]
fn a_truncated_glb() {
    let whole = Gltf::lamp_over_floor().glb();
    for length in [3, 11, 20, whole.len() / 2, whole.len() - 1] {
        let desk = Desk::new();
        std::fs::write(desk.path().join("room.glb"), &whole[..length]).expect("a scratch folder");
        desk.refuses("room.glb", &["truncated", "copy or export it again"], write_sound);
    }
}

#[test]
fn an_external_buffer_that_is_missing() {
    let desk = Desk::new();
    let scene = Gltf::lamp_over_floor();
    scene.write_gltf(&desk.path().join("room.gltf"), "walls.bin");
    desk.refuses("room.gltf", &["buffer walls.bin", "put it back at that path"], |folder| {
        std::fs::write(folder.join("walls.bin"), &scene.binary).expect("a scratch folder");
    });
}

#[test]
fn an_index_out_of_range() {
    let spoil = |scene: &mut Gltf| scene.binary[96..98].copy_from_slice(&7u16.to_le_bytes());
    Desk::refuses_spoiled(spoil, &["mesh 0 `Room`", "vertex 7 of 4", "export it again"]);
}

#[test]
fn positions_that_are_no_numbers() {
    let spoil = |scene: &mut Gltf| scene.binary[16..20].copy_from_slice(&f32::NAN.to_le_bytes());
    Desk::refuses_spoiled(spoil, &["mesh 0 `Room`", "vertex 1 is not finite", "repair the mesh"]);
}

#[test]
fn triangles_without_area_are_skipped_and_counted() {
    let desk = Desk::new();
    let mut scene = Gltf::lamp_over_floor();
    // The floor's second triangle collapses.
    scene.binary[102..104].copy_from_slice(&2u16.to_le_bytes());
    scene.write_glb(&desk.path().join("room.glb"));
    let baked = desk.bake("room.glb").succeeds();
    assert!(baked.errors.contains("1 triangles without area were skipped"), "{baked:?}");
    assert!(baked.output.contains("3 triangles"), "{baked:?}");
    run(desk.path(), &["inspect", "world", "verify"]).succeeds();
    let json = run(desk.path(), &[&bake("room.glb", "again")[..], &["--json"]].concat()).succeeds();
    assert_eq!(json.json()["triangles"], 3);
}

#[test]
fn a_scene_without_triangles() {
    Desk::refuses_spoiled(|scene| scene.json["nodes"][0] = json!({}), &["no triangles", "export meshes"]);
    let flat = |scene: &mut Gltf| scene.json["nodes"][0]["scale"] = json!([1, 1, 0]);
    Desk::refuses_spoiled(flat, &["no triangles", "all 4 have no area"]);
}

#[test]
fn a_required_extension_that_is_not_supported() {
    let spoil = |scene: &mut Gltf| {
        scene.json["extensionsUsed"] = json!(["ACME_portals"]);
        scene.json["extensionsRequired"] = json!(["ACME_portals"]);
    };
    Desk::refuses_spoiled(spoil, &["ACME_portals", "not supported", "export the scene without it"]);
}

#[test]
fn a_used_extension_that_changes_geometry() {
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression"] {
        let spoil = |scene: &mut Gltf| scene.json["extensionsUsed"] = json!([name]);
        Desk::refuses_spoiled(spoil, &[name, "`gltf-transform copy in.glb out.glb`"]);
    }
}

#[test]
fn a_texture_that_is_missing() {
    let desk = Desk::new();
    let mut scene = Gltf::lamp_over_floor();
    scene.paint_floor("boards.png");
    scene.write_gltf(&desk.path().join("room.gltf"), "room.bin");
    std::fs::write(desk.path().join("room.bin"), &scene.binary).expect("a scratch folder");
    desk.refuses("room.gltf", &["texture image boards.png", "put it back at that path"], |folder| {
        image::RgbaImage::from_pixel(2, 2, image::Rgba([120, 90, 60, 255]))
            .save(folder.join("boards.png"))
            .expect("a scratch folder");
    });
}

#[test]
fn lights_that_cannot_be() {
    let desk = Desk::new();
    write_sound(desk.path());
    let before = files(desk.path());
    let with_lights = [&bake("room.glb", "world")[..], &["--lights", "lamps.json"]].concat();
    run(desk.path(), &with_lights).fails(INPUT, &["lamps.json", "no such file"]);
    for (text, words) in [
        (
            r#"{"lights": [{"type": "point", "position": [0, 1, 0], "intensity": -5}]}"#,
            ["light 0", "negative"],
        ),
        (r#"{"lights": [{"type": "laser"}]}"#, ["light 0", "laser"]),
        ("lamp: on", ["the file", "expected"]),
    ] {
        std::fs::write(desk.path().join("lamps.json"), text).expect("a scratch folder");
        run(desk.path(), &with_lights).fails(INPUT, &[&["lamps.json"][..], &words].concat());
    }
    std::fs::remove_file(desk.path().join("lamps.json")).expect("a file");
    assert_eq!(files(desk.path()), before, "nothing is written");
}
