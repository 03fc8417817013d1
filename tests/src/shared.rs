//! The shared scenes, or a line that says they are not there.

use earthshine_render::ReferencePoint;
use earthshine_scene::{ImportOptions, Scene, light_rig, load, load_lights, scenes_dir};
use earthshine_world::LightRig;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A line past the test harness, which swallows what passing tests print.
///
/// # Panics
/// If there is no standard error.
pub fn say(line: &str) {
    writeln!(std::io::stderr(), "{line}").expect("standard error");
}

/// The folder of shared scenes; where there is none, a line says that `test` was skipped.
#[must_use]
pub fn folder(test: &str) -> Option<PathBuf> {
    let found = scenes_dir();
    if found.is_none() {
        say(&format!(
            "SKIPPED {test}: no shared scenes; set {} to their folder",
            earthshine_scene::shared_scenes::SCENES_VARIABLE
        ));
    }
    found
}

/// Every scene in `folder`, ascending by name.
///
/// # Panics
/// If the folder cannot be read or holds no scene.
#[must_use]
pub fn scene_files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder that can be read");
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "glb"));
    files.sort();
    assert!(!files.is_empty(), "{} holds no .glb", folder.display());
    files
}

/// A scene and what lights it: its own lights, and those of the `.lights.json` beside it where there is one.
///
/// # Panics
/// If either cannot be read.
#[must_use]
pub fn scene_and_lights(file: &Path) -> (Scene, LightRig) {
    let scene = load(file, &ImportOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    let beside = file.with_extension("lights.json");
    let lights = beside.is_file().then(|| load_lights(&beside).unwrap_or_else(|error| panic!("{error}")));
    let rig = light_rig(&scene, lights.as_ref());
    (scene, rig)
}

/// Light that another renderer found in the scene `name`.
///
/// # Panics
/// If the file cannot be read.
#[must_use]
pub fn reference(folder: &Path, name: &str) -> Vec<ReferencePoint> {
    earthshine_render::csv::read(&folder.join(format!("{name}.mitsuba.csv")))
        .unwrap_or_else(|error| panic!("{error}"))
}
