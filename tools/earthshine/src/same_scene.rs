//! Whether a world was baked from a scene: what whoever holds one against the other asks first.
//!
//! A world knows the hash of its scene, parameters and recipe, and that of parameters and recipe alone. Where even the
//! latter is not ours, another version baked it, and whether from this scene cannot be told.

use crate::scene_source::SceneSource;
use earthshine_bake::identity;
use earthshine_tiles::Manifest;
use std::path::{Path, PathBuf};

/// A world that is not of the scene it is held against.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}", world.display())]
pub(crate) struct OtherScene {
    world: PathBuf,
    cause: String,
}

/// What a world is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kinship {
    Same,
    OtherScene,
    OtherMetals,
    OtherVersion,
}

fn kinship(source: &SceneSource, metals_black: bool, manifest: &Manifest) -> Kinship {
    let parameters = &manifest.parameters;
    if identity::content_hash(&source.scene, parameters) == manifest.content_hash {
        Kinship::Same
    } else if parameters.metals_black != metals_black {
        Kinship::OtherMetals
    } else if identity::world_hash(parameters) == manifest.world_hash {
        Kinship::OtherScene
    } else {
        Kinship::OtherVersion
    }
}

/// Refuses a world that is not what this version bakes from `source`, whose metals are black or not.
///
/// # Errors
/// [`OtherScene`], with what to do.
pub(crate) fn ensure_same(
    source: &SceneSource,
    metals_black: bool,
    world: &Path,
    manifest: &Manifest,
) -> Result<(), OtherScene> {
    let baked = &manifest.scene;
    let cause = match kinship(source, metals_black, manifest) {
        Kinship::Same => return Ok(()),
        Kinship::OtherScene => other_scene(source, manifest),
        Kinship::OtherMetals => {
            let metals = if manifest.parameters.metals_black { "black" } else { "diffuse" };
            format!("baked with --metals {metals}: ask for the same here, if it is of this scene")
        }
        Kinship::OtherVersion => format!("baked from {baked} by another version: bake it again"),
    };
    Err(OtherScene { world: world.into(), cause })
}

/// Refuses a world of another scene; of one by another version, which may be of this scene, it warns.
///
/// # Errors
/// [`OtherScene`], with what to do.
pub(crate) fn ensure_related(
    source: &SceneSource,
    world: &Path,
    manifest: &Manifest,
) -> Result<(), OtherScene> {
    let other = || OtherScene { world: world.into(), cause: other_scene(source, manifest) };
    match kinship(source, manifest.parameters.metals_black, manifest) {
        Kinship::Same => Ok(()),
        Kinship::OtherVersion if source.scene.bounds() == manifest.bounds => {
            let (world, baked) = (world.display(), &manifest.scene);
            eprintln!(
                "warning: {world}: baked from {baked} by another version: whether {} is the same cannot be told",
                source.name
            );
            Ok(())
        }
        Kinship::OtherScene | Kinship::OtherMetals | Kinship::OtherVersion => Err(other()),
    }
}

/// Warns of a world of another scene: an edited scene may be looked at in the light that it had.
pub(crate) fn warn_if_other(source: &SceneSource, world: &Path, manifest: &Manifest) {
    if kinship(source, manifest.parameters.metals_black, manifest) != Kinship::Same {
        eprintln!("warning: {}: {}", world.display(), other_scene(source, manifest));
    }
}

fn other_scene(source: &SceneSource, manifest: &Manifest) -> String {
    format!(
        "baked from {}, not from {} as it is now (or by another version): bake it again, or name the scene that it is of",
        manifest.scene, source.name
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_source::load;
    use earthshine_bake::{BakeOptions, Levels, Silent, bake};
    use earthshine_tiles::BakeParameters;

    /// Goal: figures of a world against a scene that it is not of are never printed; a world of this scene by another
    /// version may still be looked at.
    #[test]
    fn worlds_of_other_scenes_are_told_from_those_of_other_versions() {
        let [cornell, rooms] = ["cornell", "two-rooms"].map(|name| load(name, None, false).unwrap());
        let folder = tempfile::tempdir().unwrap();
        let mut parameters = BakeParameters { rays_per_patch: 16, ..BakeParameters::default() };
        parameters.grid.voxel_edge_m = 1.0;
        let base = BakeOptions::new("cornell", parameters, cornell.lights.clone());
        let options = BakeOptions { levels: Levels::Exactly(1), ..base };
        bake(&cornell.scene, folder.path(), &options, &Silent).unwrap();
        let manifest = Manifest::load(folder.path()).unwrap();
        let same =
            |source: &SceneSource, manifest: &Manifest| ensure_same(source, false, folder.path(), manifest);
        let related =
            |source: &SceneSource, manifest: &Manifest| ensure_related(source, folder.path(), manifest);
        assert!(same(&cornell, &manifest).is_ok() && related(&cornell, &manifest).is_ok());
        for error in [same(&rooms, &manifest).unwrap_err(), related(&rooms, &manifest).unwrap_err()] {
            assert!(
                error.to_string().contains("baked from cornell, not from two-rooms as it is now"),
                "{error}"
            );
        }
        let older = Manifest { world_hash: 1, content_hash: 2, ..manifest.clone() };
        assert!(
            same(&cornell, &older).unwrap_err().to_string().contains("by another version: bake it again")
        );
        assert!(related(&cornell, &older).is_ok(), "it may be of this scene");
        assert!(related(&rooms, &older).is_err(), "it fills another box");
        let black = BakeParameters { metals_black: true, ..manifest.parameters };
        let black = Manifest { parameters: black, content_hash: 2, ..manifest };
        assert!(
            same(&cornell, &black)
                .unwrap_err()
                .to_string()
                .contains("--metals black: ask for the same here, if it is of this scene")
        );
    }
}
