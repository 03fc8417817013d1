//! Lamps: those of the glTF file and those of lights JSON.

use crate::glb::Glb;
use earthshine_scene::{SceneError, light_rig, load_lights, parse_lights};
use earthshine_world::{Light, Rgb, Sky, Vec3};
use serde_json::{Value, json};

fn with_lights(lights: Value) -> Glb {
    let mut glb = Glb::triangle();
    glb.json["extensions"] = json!({"KHR_lights_punctual": {"lights": lights}});
    glb.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    glb
}

fn at_node(light: usize) -> Value {
    json!({"KHR_lights_punctual": {"light": light}})
}

#[test]
fn punctual_lights_stand_in_the_world() {
    let mut glb = with_lights(json!([
        {"type": "directional", "color": [1.0, 0.5, 0.25], "intensity": 1000.0},
        {"type": "point", "intensity": 40.0, "range": 9.0},
        {"type": "spot", "intensity": 10.0, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.3}},
        {"type": "point", "name": "Off", "intensity": 0.0},
    ]));
    // The parent turns -Z to -Y and doubles lengths; intensities are not scaled.
    let quarter = std::f32::consts::FRAC_1_SQRT_2;
    let parent = glb.node(json!({"rotation": [-quarter, 0, 0, quarter], "scale": [2, 2, 2]}));
    let children: Vec<usize> = (0..4)
        .map(|light| glb.push("nodes", json!({"translation": [1, 0, 0], "extensions": at_node(light)})))
        .collect();
    glb.json["nodes"][parent]["children"] = json!(children);
    let scene = glb.scene();
    let [sun, point, spot] = scene.lights[..] else { panic!("{:?}", scene.lights) };
    let down = |direction: Vec3| (direction - Vec3::NEG_Y).length() < 1e-6;
    assert!(matches!(sun, Light::Directional { direction, illuminance, .. }
        if down(direction) && illuminance == Rgb::new(1000., 500., 250.)));
    assert!(matches!(point, Light::Point { position, intensity, range_m: Some(range) }
        if (position - Vec3::new(2., 0., 0.)).length() < 1e-6 && intensity == Rgb::splat(40.) && range == 9.0));
    assert!(matches!(spot, Light::Spot { direction, inner_cone_rad, outer_cone_rad, .. }
        if down(direction) && (inner_cone_rad, outer_cone_rad) == (0.1, 0.3)));
    assert_eq!(scene.report.warnings, ["without intensity and left out: light 3 `Off`"]);
}

#[test]
fn punctual_lights_brighter_than_likely_are_remarked_on() {
    let mut glb = with_lights(json!([{"type": "point", "name": "Lamp", "intensity": 1e12}]));
    glb.json["nodes"][0]["extensions"] = at_node(0);
    let warnings = glb.scene().report.warnings;
    assert_eq!(warnings, ["of more than 1e9 cd or lx; is a smaller intensity meant? light 0 `Lamp`"]);
}

#[test]
fn impossible_punctual_lights_are_named() {
    for (light, cause) in [
        (json!({"type": "point", "name": "Lamp", "color": [-1, -1, -1], "intensity": -1.0}), "is negative"),
        (json!({"type": "point", "name": "Lamp", "color": [0, -1, 0], "intensity": 0}), "is negative"),
        (
            json!({"type": "point", "name": "Lamp", "intensity": -1.0}),
            "color or intensity is negative; give zero",
        ),
        (json!({"type": "point", "name": "Lamp", "range": 0.0}), "range is not positive"),
        (json!({"type": "spot", "name": "Lamp", "spot": {"outerConeAngle": 3.0}}), "cone angles"),
        (json!({"type": "laser", "name": "Lamp"}), "none of directional, point and spot"),
    ] {
        let mut glb = with_lights(json!([light]));
        glb.json["nodes"][0]["extensions"] = at_node(0);
        let error = glb.error();
        assert!(matches!(error, SceneError::BadLights { .. }), "{error}");
        let text = error.to_string();
        assert!(text.contains("light 0 `Lamp`") && text.contains(cause), "{text}");
    }
    let mut glb = with_lights(json!([]));
    glb.json["nodes"][0]["extensions"] = at_node(7);
    assert!(glb.error().to_string().contains("light 7: it is not there"));
}

#[test]
fn lights_json_is_read_and_joined() {
    let mut glb = with_lights(json!([{"type": "point"}]));
    glb.json["nodes"][0]["extensions"] = at_node(0);
    let scene = glb.scene();
    let text = json!({
        "sky": {"color": [3000, 4000, 6000]},
        "lights": [
            {"type": "directional", "direction": [0, -2, 0], "color": [1, 0.5, 0], "intensity": 100},
            {"type": "point", "position": [1, 2, 3], "intensity": 5, "range": 7},
            {"type": "spot", "position": [0, 3, 0], "direction": [0, -1, 0], "innerConeAngle": 0.2},
            {"type": "point", "position": [0, 0, 0], "intensity": 0},
        ],
    });
    let mut file = parse_lights(text.to_string().as_bytes(), "x.json").expect("good lights");
    assert_eq!(file.sky, Sky::constant(Rgb::new(3000., 4000., 6000.)));
    assert_eq!(
        file.lights[0],
        Light::Directional {
            direction: Vec3::NEG_Y,
            illuminance: Rgb::new(100., 50., 0.),
            angular_diameter_rad: 0.0
        }
    );
    assert_eq!(
        file.lights[1],
        Light::Point { position: Vec3::new(1., 2., 3.), intensity: Rgb::splat(5.), range_m: Some(7.) }
    );
    assert!(matches!(file.lights[2], Light::Spot { inner_cone_rad: 0.2, .. }));
    assert_eq!(file.warnings, ["x.json: light 3, line 1 has no intensity and was left out"]);
    let blinding = json!({"lights": [{"type": "point", "position": [0, 0, 0], "intensity": 1e30}]});
    let blinding = parse_lights(blinding.to_string().as_bytes(), "x.json").expect("a light");
    let warned = &blinding.warnings[..];
    assert!(
        warned.len() == 1 && warned[0].contains("x.json: light 0, line 1 has an intensity"),
        "{warned:?}"
    );
    assert_eq!(light_rig(&scene, Some(&file)).lights.len(), 4);
    file.use_gltf_lights = false;
    assert_eq!(light_rig(&scene, Some(&file)).lights, file.lights);
    let own = light_rig(&scene, None);
    assert_eq!((own.lights.len(), own.sky, own.emission_scale), (1, Sky::default(), 1.0));
}

#[test]
fn bad_lights_json_names_the_entry_and_the_cause() {
    let point = |key: &str, value: Value| {
        let mut light = json!({"type": "point", "position": [0, 0, 0]});
        light[key] = value;
        json!({"lights": [{"type": "point", "position": [0, 0, 0]}, light]})
    };
    let cases = [
        (json!({"lights": [{"type": "laser"}]}), "light 0", "unknown variant `laser`"),
        (json!({"lights": [{"position": [0, 0, 0]}]}), "light 0", "missing field `type`"),
        (json!({"lights": [{"type": "directional", "direction": [0, 0, 0]}]}), "light 0", "no length"),
        (
            json!({"lights": [{"type": "directional", "direction": [0, 1, 0], "position": [0, 0, 0]}]}),
            "light 0",
            "unknown field `position`",
        ),
        (point("intensity", json!(-2)), "light 1", "intensity is negative; color and intensity must be"),
        (point("color", json!([1, -1, 1])), "light 1", "color is negative; color and intensity must be"),
        (
            json!({"lights": [{"type": "point", "position": [0, 0, 0], "color": [-1, -1, -1], "intensity": -1}]}),
            "light 0",
            "color is negative",
        ),
        (
            json!({"lights": [{"type": "point", "position": [0, 0, 0], "color": [-1, 0, 0], "intensity": 0}]}),
            "light 0",
            "color is negative",
        ),
        (point("colour", json!([1, 1, 1])), "light 1", "unknown field `colour`"),
        (point("range", json!(0)), "light 1", "range is not positive"),
        (point("position", json!([0, 0])), "light 1", "invalid length 2"),
        (json!({"sky": {"color": [1, -1, 1]}}), "sky", "negative"),
        (json!({"sky": {}}), "sky", "one of color, gradient and environment"),
        (json!({"sky": {"color": [1, 1, 1], "environment": "a.hdr"}}), "sky", "one of color, gradient"),
        (json!({"sky": {"color": [1, 1, 1], "scale": 2}}), "sky", "belong to an environment"),
        (
            json!({"sky": {"gradient": {"zenith": [1, 1, 1], "horizon": [1, 1, 1]}}}),
            "sky",
            "missing field `ground`",
        ),
        (json!({"sky": {"environment": "a.hdr", "scale": -1}}), "sky", "scale must be zero or more"),
        (json!({"skies": []}), "the file", "unknown field `skies`"),
    ];
    for (json, entry, cause) in cases {
        let text = parse_lights(json.to_string().as_bytes(), "x.json").expect_err("bad lights").to_string();
        let place = if entry == "the file" { entry.to_owned() } else { format!("{entry}, line 1") };
        assert!(text.starts_with(&format!("x.json: {place}: ")) && text.contains(cause), "{text}");
    }
    assert!(parse_lights(b"{\"lights\": [", "x.json").expect_err("cut").to_string().contains("EOF"));
    let missing = load_lights(std::path::Path::new("no such lights.json"));
    assert!(matches!(missing, Err(SceneError::NotFound { .. })));
}

#[test]
fn faults_name_their_line_and_what_would_do() {
    let text = b"{\n  \"sky\": {\"color\": [1, 1, 1]},\n  \"lights\": [\n    {\"type\": \"point\",\n     \"position\": [0, 0, 0]},\n    {\"type\": \"laser\"}\n  ]\n}";
    let error = parse_lights(text, "x.json").expect_err("no such light").to_string();
    assert!(error.contains("light 1, line 6: unknown variant `laser`"), "{error}");
    assert!(error.contains("`directional`, `point`, `spot`"), "{error}");
}

/// Goal: no light that gives none, and none brighter than anything, passes without a word.
#[test]
fn skies_that_are_black_or_blinding_are_remarked_on() {
    let warnings = |sky: Value| {
        let text = json!({"lights": [], "sky": sky}).to_string();
        parse_lights(text.as_bytes(), "x.json").expect("a sky").warnings
    };
    let black = ["x.json: sky, line 1 is black and gives no light; leave it out, or give it cd/m2"];
    assert_eq!(warnings(json!({"color": [0, 0, 0]})), black);
    let none = [0, 0, 0];
    assert_eq!(warnings(json!({"gradient": {"zenith": none, "horizon": none, "ground": none}})), black);
    assert!(warnings(json!({"gradient": {"zenith": [0, 0, 1], "horizon": none, "ground": none}})).is_empty());
    let blinding = warnings(json!({"color": [1, 1e12, 1]}));
    assert!(
        blinding.len() == 1 && blinding[0].contains("sky, line 1 has 1.0e12 cd/m2, more than 1e8"),
        "{blinding:?}"
    );
}

#[test]
fn the_example_has_every_form_but_two_skies() {
    let example =
        std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/lights.example.json"));
    let file = load_lights(example).expect("the example");
    assert_eq!((file.lights.len(), file.emission_scale, file.use_gltf_lights), (3, 1.0, true));
    assert!(file.warnings.is_empty() && file.notes.is_empty(), "{file:?}");
    assert!(matches!(file.lights[0], Light::Directional { angular_diameter_rad: 0.0093, .. }));
    let (zenith, horizon) = (Rgb::new(1500., 3000., 7000.), Rgb::new(5000., 6000., 7000.));
    assert_eq!(file.sky, Sky::gradient(zenith, horizon, Rgb::new(800., 700., 600.)));
}

#[test]
fn the_emission_scale_reaches_the_rig() {
    let file = parse_lights(br#"{"emission_scale": 0.25}"#, "x.json").expect("good lights");
    assert_eq!(light_rig(&Glb::triangle().scene(), Some(&file)).emission_scale, 0.25);
    let error = parse_lights(br#"{"emission_scale": -1}"#, "x.json").expect_err("negative").to_string();
    assert!(error.contains("x.json: emission_scale, line 1: ") && error.contains("zero or more"), "{error}");
    let text = b"{\n  \"lights\": [],\n  \"emission_scale\": \"bright\"\n}";
    let error = parse_lights(text, "x.json").expect_err("no number").to_string();
    assert!(error.starts_with("x.json: emission_scale, line 3: invalid type"), "{error}");
}

#[test]
fn an_emission_scale_beyond_all_lamps_is_remarked_on() {
    let glb = Glb::with_material(json!({"name": "Lamp", "emissiveFactor": [1, 0.5, 0]}));
    let warned = |text: &[u8], scene: &Glb| {
        let file = parse_lights(text, "x.json").expect("good lights");
        file.emission_warning(&scene.scene()).expect("numbers")
    };
    let warning = warned(b"{\n\"emission_scale\": 1e9}", &glb).expect("a warning");
    assert!(
        warning.starts_with("x.json: emission_scale, line 2: 1e9 makes material `Lamp` emit 1.0e9"),
        "{warning}"
    );
    assert_eq!(warned(br#"{"emission_scale": 1e7}"#, &glb), None);
    assert_eq!(warned(br#"{"emission_scale": 1e9}"#, &Glb::triangle()), None, "nothing emits");
    let dark = warned(b"{\n\n\"emission_scale\": 0}", &glb).expect("a warning");
    assert!(dark.starts_with("x.json: emission_scale, line 3: zero puts out all surfaces"), "{dark}");
    assert_eq!(warned(br#"{"emission_scale": 0}"#, &Glb::triangle()), None, "nothing emits");
    let strong = Glb::with_material(json!({"name": "Lamp", "emissiveFactor": [1, 0.5, 0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 1e5}}}));
    let file = parse_lights(br#"{"emission_scale": 1e38}"#, "x.json").expect("a number");
    let error = file.emission_warning(&strong.scene()).expect_err("no number").to_string();
    assert!(
        error.starts_with("x.json: emission_scale, line 1: 1e38 makes material `Lamp` brighter"),
        "{error}"
    );
}

#[test]
fn an_environment_beside_the_file_becomes_lobes_and_is_kept() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let write = |name: &str, width, height, radiance: [f32; 3]| {
        let path = folder.path().join(name);
        image::Rgb32FImage::from_pixel(width, height, image::Rgb(radiance)).save(path).expect("a picture");
    };
    write("even.exr", 16, 8, [1.0, 2.0, 4.0]);
    write("square.exr", 8, 8, [1.0, 1.0, 1.0]);
    let load = |sky: Value| {
        let path = folder.path().join("lights.json");
        std::fs::write(&path, json!({"sky": sky}).to_string()).expect("a scratch folder");
        load_lights(&path)
    };
    let file = load(json!({"environment": "even.exr", "scale": 10, "rotation_deg": 45})).expect("a sky");
    for lobe in file.sky.lobes {
        assert!((lobe - Rgb::new(10., 20., 40.)).length() < 1e-4, "{lobe}");
    }
    assert_eq!(file.environment.expect("the map").texel(3, 3), Rgb::new(10., 20., 40.));
    assert!(file.warnings.is_empty(), "{:?}", file.warnings);
    let [note] = &file.notes[..] else { panic!("{:?}", file.notes) };
    assert!(note.contains("even.exr: 16 x 8 pixels") && note.contains("off by 0.0 %"), "{note}");

    let warned = load(json!({"environment": "square.exr"})).expect("a sky");
    assert!(warned.warnings[0].contains("square.exr: it is 8 x 8 pixels, not twice as wide"), "{warned:?}");
    let error = load(json!({"environment": "none.hdr"})).expect_err("no map").to_string();
    assert!(error.contains("sky, line 1: none.hdr: there is no such file"), "{error}");
}

#[test]
fn a_map_with_a_sun_in_it_is_remarked_on() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let texel = |x, y| image::Rgb([if (x, y) == (30, 5) { 1e6 } else { 100.0 }; 3]);
    image::Rgb32FImage::from_fn(64, 32, texel).save(folder.path().join("noon.exr")).expect("a picture");
    let path = folder.path().join("lights.json");
    std::fs::write(&path, r#"{"sky": {"environment": "noon.exr"}}"#).expect("a scratch folder");
    let file = load_lights(&path).expect("a sky");
    assert!(file.warnings[0].contains("give it as a directional light"), "{:?}", file.warnings);
}
