//! Whether results can be written, asked before minutes are spent on them.

use anyhow::Context as _;
use std::fs::OpenOptions;
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};

/// Whether a file can be written at `path`: one that is there, itself, or a new one in its folder. Writes nothing.
///
/// # Errors
/// The system's cause, naming `path`: it or its folder is read-only, its folder is missing, or `path` is a folder.
pub(crate) fn ensure_file(path: &Path) -> anyhow::Result<()> {
    let about = || path.display().to_string();
    match std::fs::metadata(path) {
        Ok(found) if found.is_dir() => {
            return Err(Error::from(ErrorKind::IsADirectory)).with_context(about);
        }
        // Pipes and devices are there already; asking one could wait for its other end.
        Ok(found) if !found.is_file() => return Ok(()),
        Ok(_) => return OpenOptions::new().append(true).open(path).map(drop).with_context(about),
        Err(_) => (),
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(folder).map(drop).with_context(about)
}

/// Whether files can be written for every one of `paths`.
///
/// # Errors
/// As [`ensure_file`], for the first.
pub(crate) fn ensure_files<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> anyhow::Result<()> {
    paths.into_iter().try_for_each(|path| ensure_file(path))
}

/// Whether a folder at `path` can be made and written to. Makes nothing.
///
/// # Errors
/// The system's cause, naming `path`.
pub(crate) fn ensure_folder(path: &Path) -> anyhow::Result<()> {
    let there = path.ancestors().find(|part| part.as_os_str().is_empty() || std::fs::metadata(part).is_ok());
    let there = there.filter(|part| !part.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let about = || path.display().to_string();
    if !there.is_dir() {
        return Err(Error::from(ErrorKind::NotADirectory)).with_context(about);
    }
    tempfile::tempfile_in(there).map(drop).with_context(about)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_written_is_told_from_what_can_and_nothing_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("file"), "kept").unwrap();
        ensure_files([&at("file"), &at("new")]).unwrap();
        ensure_folder(&at("a/b/c")).unwrap();
        ensure_folder(folder.path()).unwrap();
        ensure_file(Path::new("/dev/null")).unwrap();
        for error in [
            ensure_file(folder.path()).unwrap_err(),
            ensure_file(&at("none/new")).unwrap_err(),
            ensure_file(&at("file/new")).unwrap_err(),
            ensure_folder(&at("file")).unwrap_err(),
            ensure_folder(&at("file/below")).unwrap_err(),
        ] {
            assert!(error.to_string().starts_with(&folder.path().display().to_string()), "{error:#}");
            assert_eq!(crate::exit_code::of(&error), crate::exit_code::STORAGE, "{error:#}");
        }
        assert_eq!(std::fs::read(at("file")).unwrap(), b"kept");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// Goal: of files that are there, it is they that are asked, not their folders. Method: files of the system's that hold for
    /// root too: one that may be written, of a folder that takes no new ones, and one that may not.
    #[cfg(target_os = "linux")]
    #[test]
    fn files_that_are_there_are_asked_themselves() {
        ensure_file(Path::new("/proc/self/comm")).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let read_only = folder.path().join("read-only");
        std::os::unix::fs::symlink("/proc/sys/kernel/osrelease", &read_only).unwrap();
        ensure_file(&read_only).unwrap_err();
    }
}
