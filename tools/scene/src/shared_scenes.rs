//! Where the scenes and references lie that tests and benches measure against, outside the project.

use std::path::{Path, PathBuf};

/// Names the folder instead of the search.
pub const SCENES_VARIABLE: &str = "EARTHSHINE_SCENES";

/// The folder of shared scenes: what [`SCENES_VARIABLE`] names, else `../shared/scenes` beside the current folder or one
/// of its parents. `None` where there is none; say so when a test is skipped for it.
#[must_use]
pub fn scenes_dir() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os(SCENES_VARIABLE) {
        return Some(PathBuf::from(named)).filter(|folder| folder.is_dir());
    }
    let here = std::env::current_dir().ok()?;
    here.ancestors()
        .filter_map(Path::parent)
        .map(|parent| parent.join("shared").join("scenes"))
        .find(|folder| folder.is_dir())
}
