//! Worlds that are there already: whether they may be replaced, and what of them no longer belongs.

use crate::BakeError;
use crate::stages::BakeOptions;
use crate::tile_files::is_there;
use earthshine_tiles::Manifest;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What is in the folder of a world before a bake.
#[derive(Debug)]
pub(crate) enum Before {
    /// No manifest, or one that may be replaced whatever it says.
    Nothing,
    /// An earlier state of this world: of another scene, or not whole.
    Other(Manifest),
    /// Just what is to be baked; its coarse levels may be others.
    Same(Manifest),
}

/// Looks into the folder `world`. Another world is only replaced when asked; an edited scene of the same name is the
/// same world.
pub(crate) fn before(
    world: &Path,
    world_hash: u64,
    content_hash: u64,
    options: &BakeOptions,
) -> Result<Before, BakeError> {
    if !world.join(Manifest::FILE_NAME).is_file() {
        return Ok(Before::Nothing);
    }
    let manifest = match Manifest::load(world) {
        Ok(manifest) => manifest,
        Err(_) if options.overwrite => return Ok(Before::Nothing),
        Err(error) => return Err(error.into()),
    };
    if manifest.world_hash != world_hash || manifest.scene != options.scene_name {
        return if options.overwrite {
            Ok(Before::Nothing)
        } else {
            Err(BakeError::OtherWorld { path: world.to_owned(), scene: manifest.scene })
        };
    }
    let mut finest = manifest.chunks.iter().filter(|chunk| chunk.level == 0);
    let is_whole = finest.all(|chunk| is_there(world, chunk));
    let is_same = manifest.content_hash == content_hash && manifest.lights == options.lights;
    Ok(if is_whole && is_same { Before::Same(manifest) } else { Before::Other(manifest) })
}

/// Removes tiles that the manifest does not name: those of the world that this one replaced. Readers that have
/// them mapped keep them until they let go.
pub(crate) fn remove_unlisted(world: &Path, manifest: &Manifest) -> Result<(), BakeError> {
    let listed: BTreeSet<PathBuf> = manifest.chunks.iter().map(|chunk| world.join(&chunk.file)).collect();
    // Folders of levels that this world no longer has are looked into too.
    let folders: BTreeSet<&Path> = listed.iter().filter_map(|path| path.parent()?.parent()).collect();
    for level in folders.into_iter().map(entries).collect::<Result<Vec<_>, _>>()?.concat() {
        for path in entries(&level)? {
            if path.extension().is_some_and(|extension| extension == "tile") && !listed.contains(&path) {
                std::fs::remove_file(&path).map_err(BakeError::io(&path))?;
            }
        }
    }
    Ok(())
}

/// What lies in `folder`; nothing if it is none.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, BakeError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    std::fs::read_dir(folder)
        .and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect())
        .map_err(BakeError::io(folder))
}
