//! What `bake` chooses where nothing was said, and that it is told, kept after edits, and never forced on anybody.

use crate::command::{USAGE, run};

#[test]
fn a_file_gets_a_voxel_edge_and_keeps_it_after_an_edit() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let here = folder.path();
    run(here, &["gen", "cornell", "box.glb", "--quiet"]).succeeds();
    let quick = ["--rays", "4", "--receivers", "0", "--detail", "1", "--json"];
    let bake = [&["bake", "box.glb", "world"][..], &quick].concat();
    let first = run(here, &bake).succeeds().json();
    let (made, chosen) = (first["patches"].as_f64().expect("a count"), &first["chosen"]);
    assert!((made / 13_000.0 - 1.0).abs() < 0.15, "{first}");
    assert_eq!((&chosen["is_voxel_chosen"], &chosen["is_detail_chosen"]), (&true.into(), &false.into()));
    // The same name, another size: the grid has to stay for anything to be kept.
    run(here, &["gen", "two-rooms", "box.glb", "--quiet"]).succeeds();
    let edited = run(here, &bake).succeeds().json();
    assert_eq!(edited["levels"][0]["voxel_edge_m"], first["levels"][0]["voxel_edge_m"]);
    let fresh = run(here, &[&["bake", "box.glb", "other"][..], &quick].concat()).succeeds().json();
    assert_ne!(
        fresh["levels"][0]["voxel_edge_m"], first["levels"][0]["voxel_edge_m"],
        "else this shows nothing"
    );
}

#[test]
fn detail_is_chosen_told_and_can_be_declined() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let here = folder.path();
    // Voxels that the lamp is not small beside.
    let coarse = ["bake", "cornell", "world", "--voxel", "0.25", "--rays", "16", "--receivers", "0"];
    let told = run(here, &coarse).succeeds().output;
    assert!(told.contains("detail 2 (2048 rays, 64 points a patch), chosen for about "), "{told}");
    let manifest = std::fs::read_to_string(here.join("world/world.toml")).expect("a manifest");
    for line in ["detail = 2", "detail_rays = 2048", "points_per_patch = 64", "samples_per_voxel_face = 64"] {
        assert!(manifest.contains(line), "{line:?} is not in {manifest}");
    }
    let declined = run(here, &[&coarse[..], &["--detail", "1", "--overwrite"]].concat()).succeeds().output;
    assert!(!declined.contains("chosen"), "{declined}");
    run(here, &[&coarse[..], &["--detail", "3"]].concat()).fails(USAGE, &["--detail", "auto"]);
}
