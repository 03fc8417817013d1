//! Writing files so that a reader sees the old one or the new one, whole.

use crate::error::TileError;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

/// Writes `bytes` to `path`: to a temporary name in the same folder, synced, renamed, folder synced.
///
/// Missing folders on the way are made. If anything fails (a full disk), `path` is as it was and the
/// temporary file is gone.
///
/// # Errors
/// [`TileError::Io`] with the step that failed.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), TileError> {
    static COUNTER: AtomicU32 = AtomicU32::new(0);
    let name = path.file_name().ok_or_else(|| {
        TileError::io("write", path)(std::io::Error::new(
            std::io::ErrorKind::InvalidInput,
            "it names no file",
        ))
    })?;
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    fs::create_dir_all(folder).map_err(TileError::io("create the folder", folder))?;
    let mut temporary = OsString::from(".");
    temporary.push(name);
    temporary.push(format!(".{}-{}.temp", std::process::id(), COUNTER.fetch_add(1, Ordering::Relaxed)));
    let temporary = folder.join(temporary);

    let written = write_synced(&temporary, bytes)
        .and_then(|()| fs::rename(&temporary, path))
        .map_err(TileError::io("write", path));
    if written.is_err() {
        // It may not even have been created; the first error is the one to report.
        drop(fs::remove_file(&temporary));
    }
    written?;
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(TileError::io("sync the folder", folder))
}

fn write_synced(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = File::options().write(true).create_new(true).open(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_whole_and_no_temporary_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tiles/L0/a.tile");
        write_atomic(&path, b"old").unwrap();
        write_atomic(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    }

    #[test]
    fn what_cannot_be_written_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let occupied = folder.path().join("occupied");
        fs::create_dir_all(occupied.join("inside")).unwrap();
        let error = write_atomic(&occupied, b"bytes").expect_err("a folder is in the way");
        assert!(error.to_string().starts_with("cannot write "), "{error}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        assert!(write_atomic(Path::new("/"), b"").is_err());
    }
}
