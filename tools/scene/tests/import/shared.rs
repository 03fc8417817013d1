//! The shared scenes: whole files from several tools, against the counts of their README.

use earthshine_scene::{ImportOptions, light_rig, load, load_lights, scenes_dir};
use std::io::Write;
use std::path::PathBuf;

/// The folder, or a line that says what is not tested.
fn folder(test: &str) -> Option<PathBuf> {
    let found = scenes_dir();
    if found.is_none() {
        say(&format!("SKIPPED {test}: no shared scenes; set EARTHSHINE_SCENES to their folder"));
    }
    found
}

/// Past the test harness, which swallows what passing tests print.
fn say(line: &str) {
    writeln!(std::io::stderr(), "{line}").expect("standard error");
}

#[test]
fn every_shared_scene_has_the_triangles_its_readme_counts() {
    let Some(folder) = folder("triangle counts") else { return };
    // The README counts triangles with area.
    let counts = [
        ("furnace_rho50", 12),
        ("furnace_rho80", 12),
        ("cornell", 32),
        ("office", 520),
        ("sponza", 66_444),
        // Two of its README's 488,768 have three corners in a line: no area in exact arithmetic.
        ("kaykit_city", 488_766),
        ("dungeon", 29_631),
        ("delft", 36_264),
    ];
    let mut files: Vec<_> =
        std::fs::read_dir(&folder).expect("a folder").map(|f| f.expect("a file").path()).collect();
    files.sort();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "glb"));
    assert!(!files.is_empty(), "{} holds no .glb", folder.display());
    for file in files {
        let start = std::time::Instant::now();
        let scene = load(&file, &ImportOptions::default()).expect("a good file");
        let name = file.file_stem().and_then(|stem| stem.to_str()).expect("a name");
        println!(
            "{name}: {} triangles, {} materials, {} textures, {} lights, {} masks, in {:.1} ms; bounds {:?}; {:?}",
            scene.triangles.len(),
            scene.materials.len(),
            scene.textures.len(),
            scene.lights.len(),
            scene.materials.iter().filter(|material| material.alpha_cutoff.is_some()).count(),
            start.elapsed().as_secs_f64() * 1e3,
            scene.bounds(),
            scene.report,
        );
        if let Some((_, count)) = counts.iter().find(|(known, _)| *known == name) {
            assert_eq!(scene.triangles.len(), *count, "{name}");
        }
        let lists = [scene.material_of.len(), scene.texture_coordinates.len()];
        assert_eq!(lists, [scene.triangles.len(); 2], "{name}");
    }
}

#[test]
fn the_shared_lights_are_read() {
    let Some(folder) = folder("lights files") else { return };
    for (name, lights, own) in [("sponza", 1, true), ("kaykit_city", 1, false)] {
        let Ok(file) = load_lights(&folder.join(format!("{name}.lights.json"))) else {
            say(&format!("SKIPPED {name}.lights.json: not in {}", folder.display()));
            continue;
        };
        assert_eq!((file.lights.len(), file.use_gltf_lights), (lights, own), "{name}");
        let scene =
            load(&folder.join(format!("{name}.glb")), &ImportOptions::default()).expect("a good file");
        let rig = light_rig(&scene, Some(&file));
        rig.validate().expect("good lights");
        assert_eq!(rig.lights.len(), lights + if own { scene.lights.len() } else { 0 }, "{name}");
        assert!(rig.sky.radiance(earthshine_world::Vec3::Y).x > 0.0);
    }
}
