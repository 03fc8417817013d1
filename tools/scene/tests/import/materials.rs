//! What surfaces reflect, emit and let through.

use crate::glb::{Glb, UNSIGNED_BYTE};
use earthshine_scene::{ImportOptions, Scene, load_bytes};
use earthshine_world::{Rgb, Vec3};
use serde_json::{Value, json};

const RED: [u8; 4] = [255, 0, 0, 255];
const GREEN: [u8; 4] = [0, 255, 0, 255];
const BLUE: [u8; 4] = [0, 0, 255, 255];
const GREY: [u8; 4] = [188, 188, 188, 255];
const HOLE: [u8; 4] = [255, 255, 255, 0];

/// Reflectance at barycentric (u, v), which are the texture coordinates of the one triangle.
fn reflectance(scene: &Scene, u: f32, v: f32) -> Rgb {
    scene.surface(0, u, v, true).reflectance
}

/// The test triangle with a texture of two by two, nearest, and this texture info and sampler.
fn textured(info: Value, sampler: Value) -> Scene {
    let mut info = info;
    info["index"] = json!(0);
    let mut glb = Glb::with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": info}}));
    glb.texture(2, &[RED, GREEN, BLUE, GREY]);
    let mut sampler = sampler;
    sampler["magFilter"] = json!(9728);
    glb.push("samplers", sampler);
    glb.json["textures"][0]["sampler"] = json!(0);
    glb.scene()
}

fn close(found: Rgb, expected: [f32; 3]) {
    assert!((found - Rgb::from_array(expected)).length() < 3e-3, "{found} instead of {expected:?}");
}

#[test]
fn textures_are_sampled_where_the_ray_hits() {
    let scene = textured(json!({}), json!({}));
    close(reflectance(&scene, 0.1, 0.1), [0.98, 0., 0.]);
    close(reflectance(&scene, 0.8, 0.1), [0., 0.98, 0.]);
    close(reflectance(&scene, 0.1, 0.8), [0., 0., 0.98]);
    assert_eq!(scene.report.clamped_materials, 1, "pure red is above the limit");
}

#[test]
fn srgb_is_decoded_and_multiplied_by_the_factor() {
    let mut glb = Glb::with_material(json!({"pbrMetallicRoughness": {
        "baseColorFactor": [1.0, 0.5, 0.25, 1.0], "baseColorTexture": {"index": 0}}}));
    glb.texture(1, &[GREY]);
    close(reflectance(&glb.scene(), 0.3, 0.3), [0.5029, 0.2515, 0.1257]);
    assert_eq!(glb.scene().report.clamped_materials, 0);
}

#[test]
fn wrap_modes_come_from_the_sampler() {
    let shifted = json!({"extensions": {"KHR_texture_transform": {"offset": [1.0, 0.0]}}});
    close(reflectance(&textured(shifted.clone(), json!({})), 0.1, 0.1), [0.98, 0., 0.]);
    close(reflectance(&textured(shifted.clone(), json!({"wrapS": 33071})), 0.1, 0.1), [0., 0.98, 0.]);
    close(reflectance(&textured(shifted, json!({"wrapS": 33648})), 0.6, 0.1), [0.98, 0., 0.]);
}

#[test]
fn the_texture_transform_turns_as_its_worked_example_says() {
    // The lower left quadrant, whatever the corner: offset (0, 1), a quarter turn, half the scale.
    let quadrant = json!({"extensions": {"KHR_texture_transform": {
        "offset": [0.0, 1.0], "rotation": std::f32::consts::FRAC_PI_2, "scale": [0.5, 0.5]}}});
    let scene = textured(quadrant, json!({}));
    for (u, v) in [(0.05, 0.05), (0.9, 0.05), (0.05, 0.9), (0.4, 0.4)] {
        close(reflectance(&scene, u, v), [0., 0., 0.98]);
    }
    assert_eq!(scene.textures[0].transform, earthshine_scene::Texture::IDENTITY);
}

#[test]
fn each_texture_reads_its_own_coordinates() {
    let mut glb = Glb::with_material(json!({
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
        "emissiveFactor": [1, 1, 1],
        "emissiveTexture": {"index": 0, "texCoord": 1},
    }));
    glb.texture(2, &[RED, GREEN, BLUE, GREY]);
    glb.push("samplers", json!({"magFilter": 9728}));
    glb.json["textures"][0]["sampler"] = json!(0);
    let second = glb.floats(&[0.75, 0.75, 0.75, 0.75, 0.75, 0.75], "VEC2");
    glb.primitive()["attributes"]["TEXCOORD_1"] = json!(second);
    // An untextured triangle before it, so that lists begin late.
    let mesh = glb.mesh(json!({"POSITION": 0}), json!({}));
    glb.push("nodes", json!({"mesh": mesh}));
    glb.json["scenes"][0]["nodes"] = json!([1, 0]);
    let scene = glb.scene();
    let surface = scene.surface(1, 0.1, 0.1, true);
    close(surface.reflectance, [0.98, 0., 0.]);
    close(surface.emitted_radiance, [0.5029; 3]);
    close(scene.surface(0, 0.1, 0.1, true).reflectance, [0.98; 3]);
    assert_eq!(scene.textures.len(), 1, "one image, one sampler: one texture");
}

#[test]
fn emission_is_factor_times_texture_times_strength_and_leaves_the_front() {
    let material = |double_sided: bool| {
        let mut glb = Glb::with_material(json!({
            "doubleSided": double_sided, "emissiveFactor": [1.0, 0.5, 0.0], "emissiveTexture": {"index": 0},
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 100.0}}}));
        glb.texture(1, &[GREY]);
        glb.scene()
    };
    let (single, double) = (material(false), material(true));
    let lit = Rgb::new(50.29, 25.15, 0.0);
    assert!((single.surface(0, 0.2, 0.2, true).emitted_radiance - lit).length() < 0.1);
    assert_eq!(single.surface(0, 0.2, 0.2, false).emitted_radiance, Rgb::ZERO);
    assert!((double.surface(0, 0.2, 0.2, false).emitted_radiance - lit).length() < 0.1);
    assert!(single.emissive_coordinates.is_none(), "one texture needs one list of coordinates");
}

/// Goal: what cannot emit is not taken for a lamp. Method: textures that leave nothing of a factor, and one that leaves some.
#[test]
fn emission_that_no_texel_lets_out_is_none() {
    let with = |texels: [[u8; 4]; 2]| {
        let mut glb =
            Glb::with_material(json!({"emissiveFactor": [1.0, 1.0, 0.0], "emissiveTexture": {"index": 0}}));
        glb.texture(2, &texels);
        glb.scene()
    };
    let dark = with([[0, 0, 0, 255], BLUE]);
    assert!(!dark.emits());
    assert_eq!((dark.materials[0].emitted_radiance, dark.materials[0].emissive_texture), (Rgb::ZERO, None));
    assert!(with([[0, 0, 0, 255], RED]).emits());
}

#[test]
fn emission_beyond_all_lamps_is_remarked_on_by_name() {
    let warnings = |strength: f32| {
        let mut glb = Glb::with_material(json!({
            "name": "Neon", "emissiveFactor": [1.0, 0.5, 0.0],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}}));
        glb.json["extensionsUsed"] = json!(["KHR_materials_emissive_strength"]);
        glb.scene().report.warnings
    };
    assert_eq!(warnings(1e8), [""; 0]);
    let [warning] = &warnings(3e8)[..] else { panic!("one material") };
    assert!(warning.contains("`Neon` emits 3.0e8 cd/m2") && warning.contains("cd/m2?"), "{warning}");
}

#[test]
fn masks_cut_holes_and_blending_is_counted() {
    let scene = |alpha: Value| {
        let mut material = alpha;
        material["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": 0}});
        let mut glb = Glb::with_material(material);
        glb.texture(2, &[HOLE, RED, HOLE, RED]);
        glb.push("samplers", json!({"magFilter": 9728}));
        glb.json["textures"][0]["sampler"] = json!(0);
        glb.scene()
    };
    for material in [json!({"alphaMode": "MASK", "alphaCutoff": 0.3}), json!({"alphaMode": "BLEND"})] {
        let scene = scene(material.clone());
        assert!(scene.surface(0, 0.1, 0.1, true).is_hole, "{material}");
        assert!(!scene.surface(0, 0.8, 0.1, true).is_hole, "{material}");
        assert_eq!(scene.report.blended_materials, u64::from(material["alphaMode"] == "BLEND"));
    }
    assert!(!scene(json!({})).has_masks());
}

#[test]
fn masks_that_cut_nothing_are_dropped() {
    let mut glb = Glb::with_material(json!({
        "alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.7]}}));
    assert!(!glb.scene().has_masks());
    let colours = glb.accessor(&[255, 255, 255, 100].repeat(3), UNSIGNED_BYTE, "VEC4", 3);
    glb.primitive()["attributes"]["COLOR_0"] = json!(colours);
    assert!(glb.scene().surface(0, 0.2, 0.2, true).is_hole, "vertex colours have alpha too");
}

#[test]
fn metals_reflect_their_colour_unless_they_are_asked_to_be_black() {
    let glb = Glb::with_material(json!({"pbrMetallicRoughness": {
        "baseColorFactor": [0.8, 0.4, 0.2, 1.0], "metallicFactor": 0.75}}));
    close(reflectance(&glb.scene(), 0.2, 0.2), [0.8, 0.4, 0.2]);
    let options = ImportOptions { metals_black: true, ..ImportOptions::default() };
    let black = load_bytes(&glb.bytes(), "test.glb", &options).expect("a good file");
    close(reflectance(&black, 0.2, 0.2), [0.2, 0.1, 0.05]);
}

#[test]
fn unlit_and_specular_glossiness_have_a_reflectance() {
    let unlit = Glb::with_material(json!({
        "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 1.0]},
        "extensions": {"KHR_materials_unlit": {}}}));
    close(reflectance(&unlit.scene(), 0.2, 0.2), [0.1, 0.2, 0.3]);
    let gloss = Glb::with_material(json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": {
        "diffuseFactor": [0.4, 0.5, 0.6, 1.0]}}}));
    close(reflectance(&gloss.scene(), 0.2, 0.2), [0.4, 0.5, 0.6]);
}

#[test]
fn vertex_colours_multiply_the_base_colour() {
    let mut glb =
        Glb::with_material(json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1.0]}}));
    let colours = glb.floats(&[1., 0., 0., 0., 1., 0., 0., 0., 1.], "VEC3");
    glb.primitive()["attributes"]["COLOR_0"] = json!(colours);
    let scene = glb.scene();
    close(reflectance(&scene, 0.0, 0.0), [0.5, 0., 0.]);
    close(reflectance(&scene, 0.5, 0.5), [0., 0.25, 0.25]);
    assert_eq!(Glb::triangle().scene().corner_colours, None);
}

#[test]
fn one_image_under_two_samplers_is_decoded_once_and_wrapped_twice() {
    let mut glb = Glb::with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    glb.texture(2, &[RED, GREEN]);
    glb.push("samplers", json!({"wrapS": 33071}));
    glb.push("textures", json!({"source": 0, "sampler": 0}));
    glb.push("materials", json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}}));
    let scene = glb.scene();
    assert_eq!(scene.textures.len(), 2);
    assert_eq!(scene.textures[0].texels, scene.textures[1].texels);
    assert_ne!(scene.textures[0].wrap, scene.textures[1].wrap);
}

#[test]
fn textured_meshes_without_coordinates_are_said() {
    let mut glb = Glb::with_material(
        json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 3}}}),
    );
    glb.texture(1, &[GREY]);
    let scene = glb.scene();
    assert_eq!(scene.report.warnings, ["1 textured primitives have no texture coordinates"]);
    assert_eq!(scene.texture_coordinates, vec![[[0.0; 2]; 3]]);
    assert_eq!(scene.triangles[0][1], Vec3::X);
}

/// Goal: a surface whose emission was put out is remarked on by name, and no black number becomes light.
#[test]
fn emission_of_no_strength_is_remarked_on_and_negative_strength_refused() {
    let with = |factor: Value, strength: f32| {
        let mut glb = Glb::with_material(json!({"name": "Lamp", "emissiveFactor": factor,
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}}));
        glb.json["extensionsUsed"] = json!(["KHR_materials_emissive_strength"]);
        glb
    };
    let warnings = |glb: Glb| glb.scene().report.warnings;
    let put_out = ["an emissive strength of zero gives no light: material 0 `Lamp`"];
    assert_eq!(warnings(with(json!([0, 0.5, 0]), 0.0)), put_out);
    assert_eq!(warnings(with(json!([0, 0, 0]), 0.0)), [""; 0], "nothing was to emit");
    let error = with(json!([-1, -1, -1]), -1.0).error().to_string();
    assert!(error.contains("material 0 `Lamp`: its emission is negative"), "{error}");
}
