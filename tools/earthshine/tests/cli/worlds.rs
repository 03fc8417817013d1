//! Worlds that are missing or damaged: exit code 4, or 9 where faults were asked for; the file and the cure by name.

use crate::command::{FAULTS, STORAGE, USAGE, WORLD, bake, cornell_world, files, run};
use earthshine_tiles::{Manifest, format};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn world() -> TempDir {
    let folder = tempfile::tempdir().expect("a scratch folder");
    cornell_world(folder.path());
    folder
}

/// Tiles of the world in `folder`, ascending; and the chunk of the first, as `inspect` wants it.
fn tiles(folder: &Path) -> (Vec<PathBuf>, String) {
    let manifest = Manifest::load(&folder.join("world")).expect("a manifest");
    let [x, y, z] = manifest.chunks[0].coord;
    let files = manifest.chunks.iter().map(|chunk| folder.join("world").join(&chunk.file));
    (files.collect(), format!("{x},{y},{z}"))
}

/// Goal: damage to a tile is found by whoever looks, and a bake mends it. Method: `spoil` one; ask for its chunk and
/// for all faults; bake again.
#[track_caller]
fn assert_damage_is_found(spoil: impl FnOnce(&mut Vec<u8>), words: &[&str]) {
    let folder = world();
    let (tiles, first) = tiles(folder.path());
    let sound = std::fs::read(&tiles[0]).expect("a tile");
    let mut bytes = sound.clone();
    spoil(&mut bytes);
    std::fs::write(&tiles[0], bytes).expect("a scratch folder");
    let name = tiles[0].file_name().expect("a name").to_string_lossy();
    let words = [&[&*name, "bake"][..], words].concat();
    run(folder.path(), &["inspect", "world", "chunk", &first]).fails(WORLD, &words);
    let verified = run(folder.path(), &["inspect", "world", "verify"]).fails(FAULTS, &["faults found"]);
    for word in words {
        assert!(verified.output.contains(word), "{word:?} is not in {verified:?}");
    }
    // What is not damaged can still be read.
    run(folder.path(), &["inspect", "world"]).succeeds();
    std::fs::remove_file(&tiles[0]).expect("a file");
    cornell_world(folder.path());
    assert!(std::fs::read(&tiles[0]).expect("a new tile") == sound, "the bake puts back what was there");
    run(folder.path(), &["inspect", "world", "verify"]).succeeds();
}

#[test]
fn a_folder_that_is_missing_or_no_world() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    std::fs::create_dir(folder.path().join("empty")).expect("a scratch folder");
    for world in ["nowhere", "empty"] {
        for command in [&["inspect", world][..], &["inspect", world, "verify"], &["serve", world]] {
            run(folder.path(), command).fails(WORLD, &[world, "is not a world", "earthshine bake"]);
        }
    }
    assert!(files(folder.path()).is_empty());
}

#[test]
fn a_truncated_tile() {
    for keep in [0, 5, 64] {
        assert_damage_is_found(|tile| tile.truncate(keep), &["is cut off"]);
    }
    assert_damage_is_found(|tile| tile.truncate(tile.len() - 1), &["is cut off"]);
}

/// Goal: whatever byte is wrong, it is found. Method: a few all over the file; the tile reader's own tests try every
/// bit of every byte.
#[test]
fn a_flipped_byte() {
    let folder = world();
    let (tiles, first) = tiles(folder.path());
    let sound = std::fs::read(&tiles[0]).expect("a tile");
    let step = sound.len() / 12;
    for place in (0..sound.len()).step_by(step).chain([sound.len() - 1]) {
        let mut bytes = sound.clone();
        bytes[place] ^= 0x20;
        std::fs::write(&tiles[0], bytes).expect("a scratch folder");
        run(folder.path(), &["inspect", "world", "chunk", &first]).fails(WORLD, &["bake it again"]);
        run(folder.path(), &["inspect", "world", "verify"]).fails(FAULTS, &["1 faults found"]);
    }
    std::fs::write(&tiles[0], sound).expect("a scratch folder");
    run(folder.path(), &["inspect", "world", "verify"]).succeeds();
}

#[test]
fn a_tile_of_another_version() {
    assert_damage_is_found(|tile| tile[8] = 77, &["format version 77", "this program reads"]);
}

#[test]
fn a_manifest_of_another_version() {
    let folder = world();
    let path = folder.path().join("world/world.toml");
    let text = std::fs::read_to_string(&path).expect("a manifest");
    std::fs::write(
        &path,
        text.replace(&format!("format_version = {}", format::VERSION), "format_version = 77"),
    )
    .expect("a scratch folder");
    for command in [&["inspect", "world"][..], &["serve", "world"], &bake("cornell", "world")[..10]] {
        run(folder.path(), command).fails(WORLD, &["world.toml", "format version 77", "this program reads"]);
    }
}

#[test]
fn a_detail_that_voxels_cannot_be_cut_in() {
    let folder = world();
    run(folder.path(), &["bake", "cornell", "other", "--voxel", "0.5", "--detail", "3"])
        .fails(USAGE, &["--detail", "1, 2, 4, 8 or auto"]);
    assert!(std::fs::read_dir(folder.path().join("other")).is_err(), "nothing is begun");
    let path = folder.path().join("world/world.toml");
    let text = std::fs::read_to_string(&path).expect("a manifest");
    assert!(text.contains("detail = 1\n"), "{text}");
    std::fs::write(&path, text.replace("detail = 1\n", "detail = 3\n")).expect("a scratch folder");
    for command in [&["inspect", "world"][..], &["serve", "world"]] {
        run(folder.path(), command).fails(WORLD, &["world.toml", "parameters.detail is not 1, 2, 4 or 8"]);
    }
}

#[test]
fn a_foreign_file() {
    let glb = |tile: &mut Vec<u8>| *tile = b"glTF\x02\0\0\0 and so on ".repeat(20);
    assert_damage_is_found(glb, &["is not a tile"]);
    // A sound tile of another world.
    let other = tempfile::tempdir().expect("a scratch folder");
    let coarse = ["--voxel", "0.5", "--rays", "33", "--chunk-voxels", "4", "--detail", "1", "-q"];
    run(other.path(), &[&["bake", "cornell", "world"][..], &coarse].concat()).succeeds();
    let foreign = std::fs::read(&tiles(other.path()).0[0]).expect("a tile");
    assert_damage_is_found(|tile| tile.clone_from(&foreign), &["does not belong here", "world hash"]);
    // A manifest of something else.
    let folder = world();
    std::fs::write(folder.path().join("world/world.toml"), "[package]\nname = \"cargo\"\n")
        .expect("a manifest");
    run(folder.path(), &["inspect", "world"])
        .fails(WORLD, &["world.toml", "format_version", "bake the world again"]);
}

#[test]
fn a_missing_tile() {
    let folder = world();
    let (tiles, first) = tiles(folder.path());
    std::fs::remove_file(&tiles[0]).expect("a file");
    run(folder.path(), &["inspect", "world", "chunk", &first]).fails(WORLD, &["is missing", "bake it again"]);
    run(folder.path(), &["inspect", "world", "verify"]).fails(FAULTS, &["1 faults found"]);
    cornell_world(folder.path());
    run(folder.path(), &["inspect", "world", "verify"]).succeeds();
}

#[test]
fn another_world_in_the_way_stays_as_it_is() {
    let folder = world();
    let before = files(folder.path());
    let other = ["bake", "furnace", "world", "--voxel", "0.5", "--rays", "32", "--quiet"];
    run(folder.path(), &other).fails(WORLD, &["world", "cornell", "--overwrite"]);
    assert_eq!(files(folder.path()), before);
}

#[test]
fn a_world_that_is_a_file() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    std::fs::write(folder.path().join("world"), "precious").expect("a scratch folder");
    run(folder.path(), &bake("cornell", "world")).fails(STORAGE, &["world"]);
    run(folder.path(), &["inspect", "world"]).fails(WORLD, &["world", "is not a world"]);
    assert_eq!(files(folder.path())["world"], b"precious");
}

/// The manifest is written last: without it the folder is what a killed bake leaves.
#[test]
fn a_bake_that_was_interrupted_says_how_far_it_came() {
    let folder = world();
    std::fs::remove_file(folder.path().join("world/world.toml")).expect("a bake writes a manifest");
    let words = ["interrupted", "surfaces of", "rows of", "goes on there"];
    run(folder.path(), &["inspect", "world"]).fails(WORLD, &words);
}
