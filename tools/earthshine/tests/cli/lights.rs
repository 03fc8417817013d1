//! `--lights` and `--sun-path` with files that cannot be, or that are worth a word.
//!
//! Exit code 3; the file, the line where there is one, the cause and the cure by name; no trace of a world.

use crate::command::{CONNECTION, INPUT, Run, USAGE, bake, files, run};
use crate::glb::Gltf;
use image::{DynamicImage, Rgb32FImage, RgbImage};
use std::path::Path;
use tempfile::TempDir;

/// A scratch folder with a sound scene.
fn desk() -> TempDir {
    let folder = tempfile::tempdir().expect("a scratch folder");
    Gltf::lamp_over_floor().write_glb(&folder.path().join("room.glb"));
    folder
}

/// Bakes the room under `lights`.
fn bake_under(folder: &Path, lights: &str) -> Run {
    std::fs::write(folder.join("lights.json"), lights).expect("a scratch folder");
    run(folder, &[&bake("room.glb", "world")[..], &["--lights", "lights.json"]].concat())
}

#[track_caller]
fn refuses(folder: &Path, lights: &str, words: &[&str]) {
    std::fs::write(folder.join("lights.json"), lights).expect("a scratch folder");
    let before = files(folder);
    bake_under(folder, lights).fails(INPUT, &[&["lights.json"][..], words].concat());
    assert_eq!(files(folder), before, "nothing is written");
}

fn panorama(first: f32) -> DynamicImage {
    Rgb32FImage::from_fn(8, 4, |x, y| image::Rgb([if (x, y) == (2, 1) { first } else { 1.0 }; 3])).into()
}

#[test]
fn lights_that_cannot_be_name_their_line() {
    let desk = desk();
    let with = |light: &str| format!("{{\n \"lights\": [\n  {light}\n ]\n}}");
    refuses(
        desk.path(),
        &with(r#"{"type": "laser", "position": [0, 0, 0]}"#),
        &["light 0, line 3", "`laser`", "`directional`, `point`, `spot`"],
    );
    refuses(
        desk.path(),
        &with(r#"{"type": "point", "position": [0, 1, 0], "intensity": -5}"#),
        &["light 0, line 3", "negative", "must be zero or more"],
    );
    refuses(
        desk.path(),
        &with(r#"{"type": "point", "position": [0, 1, 0], "color": [-1, -1, -1], "intensity": -5}"#),
        &["light 0, line 3", "the color is negative", "must be zero or more"],
    );
    refuses(desk.path(), "{\n \"emission_scale\": -1\n}", &["emission_scale, line 2", "give zero or more"]);
    refuses(desk.path(), "{\n \"lights\": [\n}", &["the file", "line 3", "config/lights.example.json"]);
}

#[test]
fn a_light_without_intensity_is_left_out_with_a_word() {
    let desk = desk();
    let baked =
        bake_under(desk.path(), r#"{"lights": [{"type": "point", "position": [0, 1, 0], "intensity": 0}]}"#);
    let words = "warning: lights.json: light 0, line 1 has no intensity and was left out";
    assert!(baked.succeeds().errors.contains(words));
    for (dark, words) in [
        (r#""sky": {"color": [0, 0, 0]}"#, "sky, line 2 is black and gives no light"),
        (r#""emission_scale": 0"#, "emission_scale, line 2: zero puts out all surfaces"),
    ] {
        let baked = bake_under(desk.path(), &format!("{{\n {dark}\n}}")).succeeds();
        assert_eq!(baked.errors.matches(words).count(), 1, "{baked:?}");
    }
}

#[test]
fn environment_maps_that_cannot_be() {
    let desk = desk();
    let save = |name: &str, image: &DynamicImage| {
        image.save(desk.path().join(name)).expect("a scratch folder");
    };
    save("eight.png", &RgbImage::new(8, 4).into());
    save("negative.exr", &panorama(-1.0));
    save("infinite.exr", &panorama(f32::INFINITY));
    save("nan.exr", &panorama(f32::NAN));
    let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 40000\n";
    std::fs::write(desk.path().join("huge.hdr"), huge).expect("a scratch folder");
    for (name, words) in [
        ("eight.png", ["Png", "save it as Radiance .hdr or OpenEXR"]),
        ("negative.exr", ["1 pixels are negative, the first in column 2, row 1", "repair them"]),
        ("infinite.exr", ["infinite or not a number, the first in column 2, row 1", "repair them"]),
        ("nan.exr", ["infinite or not a number, the first in column 2, row 1", "repair them"]),
        ("huge.hdr", ["more than the limit", "scale it down"]),
        ("none.hdr", ["there is no such file", "relative to the lights file"]),
    ] {
        let sky = format!("{{\n \"sky\": {{\"environment\": \"{name}\"}}\n}}");
        refuses(desk.path(), &sky, &[&["sky, line 2", name][..], &words].concat());
    }
}

#[test]
fn an_environment_map_lights_a_bake_and_says_how_well() {
    let desk = desk();
    let square = Rgb32FImage::from_pixel(4, 4, image::Rgb([1.0; 3]));
    square.save(desk.path().join("square.exr")).expect("a scratch folder");
    let baked = bake_under(desk.path(), r#"{"sky": {"environment": "square.exr", "scale": 5}}"#).succeeds();
    for words in ["4 x 4 pixels on six lobes: irradiance off by 0.0 %", "not twice as wide as high"] {
        assert!(baked.errors.contains(words), "{baked:?}");
    }
}

/// Goal: whatever is done with a scene, what is wrong with its lights is said, and once. Method: a lamp of another unit, a
/// light without intensity and a scale without bounds, through every command that reads scenes.
#[test]
fn every_command_remarks_on_lights_once() {
    let desk = desk();
    let mut scene = Gltf::lamp_over_floor();
    scene.json["extensionsUsed"] =
        serde_json::json!(["KHR_materials_emissive_strength", "KHR_lights_punctual"]);
    scene.json["materials"][1]["name"] = "Lamp".into();
    scene.json["materials"][1]["extensions"] =
        serde_json::json!({"KHR_materials_emissive_strength": {"emissiveStrength": 1e9}});
    scene.json["extensions"] = serde_json::json!({"KHR_lights_punctual": {"lights": [
        {"type": "point"}, {"type": "point", "name": "Spare", "intensity": 0}]}});
    scene.json["nodes"][0]["extensions"] = serde_json::json!({"KHR_lights_punctual": {"light": 1}});
    scene.write_glb(&desk.path().join("room.glb"));
    std::fs::write(desk.path().join("lights.json"), "{\n \"emission_scale\": 1e9\n}")
        .expect("a scratch folder");
    let coarse = ["--voxel", "0.5", "--rays", "32", "--detail", "1"];
    let few_points = ["--point-count", "4", "--noise", "0.5", "--json"];
    let accuracy = [&["bench", "accuracy", "--scene", "room.glb"][..], &coarse, &few_points].concat();
    let picture = ["--width", "8", "--height", "8", "--samples", "1", "--out", "pictures"];
    let render = [&["render", "room.glb"][..], &picture].concat();
    for command in [bake("room.glb", "world").to_vec(), accuracy, render] {
        let done = run(desk.path(), &[&command[..], &["--lights", "lights.json"]].concat()).succeeds();
        for words in [
            "warning: room.glb: material 1 `Lamp` emits",
            "warning: room.glb: without intensity and left out: light 1 `Spare`",
            "warning: lights.json: emission_scale, line 2: 1e9 makes material `Lamp` emit",
        ] {
            assert_eq!(done.errors.matches(words).count(), 1, "{words:?} in {done:?}");
        }
        assert_eq!(done.errors.matches("`Spare`").count(), 1, "{done:?}");
    }
}

#[test]
fn sun_paths_that_cannot_be() {
    let desk = desk();
    let fly = |text: &str| {
        std::fs::write(desk.path().join("day.toml"), text).expect("a scratch folder");
        run(desk.path(), &["fly", "--sun-path", "day.toml"])
    };
    fly("course = 3").fails(INPUT, &["day.toml", "line 1", "config/day.example.toml"]);
    let light = "light = { type = \"clear_sky\" }\n";
    let course =
        "[course]\ntype = \"solar\"\nlatitude_deg = 95\nday_of_year = 1\nfrom_hour = 0\nto_hour = 24\n";
    fly(&format!("{light}{course}")).fails(
        INPUT,
        &["day.toml", "line 4: course.latitude_deg is 95", "-90 to 90", "config/day.example.toml"],
    );
    let dark = "light = { type = \"constant\", illuminance = [0, 0, 0] }\n";
    let straight = "course = { type = \"straight\", azimuth_deg = [0, 90], elevation_deg = [10, 60] }\n";
    fly(&format!("{straight}{dark}")).fails(CONNECTION, &["warning: ", "line 2: light.illuminance is zero"]);
    for seconds in ["--seconds=-1", "--seconds=nan", "--seconds=1e30"] {
        run(desk.path(), &["fly", seconds]).fails(USAGE, &["--seconds has to be a number"]);
    }
    run(desk.path(), &["fly", "--sun-path", "none.toml"]).fails(INPUT, &["none.toml", "check the path"]);
}
