//! Camera paths as JSON or TOML files, by extension.

use crate::{Path, PathError};
use std::{fs::File, io::Read as _, path::Path as FilePath};

/// Longest path file, bytes.
const FILE_BYTES_MAX: u64 = 256 << 20;

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Json,
    Toml,
}

impl Format {
    fn of(file: &FilePath) -> Result<Self, PathError> {
        let extension = file.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        match extension.to_ascii_lowercase().as_str() {
            "json" => Ok(Self::Json),
            "toml" => Ok(Self::Toml),
            _ => Err(PathError::Extension { file: file.to_owned() }),
        }
    }
}

impl Path {
    /// Reads a path from a .json or .toml file, and checks it.
    ///
    /// # Errors
    /// [`PathError::Extension`], [`PathError::Read`], [`PathError::Format`], [`PathError::Invalid`].
    pub fn load(file: &FilePath) -> Result<Self, PathError> {
        let format = Format::of(file)?;
        let io = |cause| PathError::Read { file: file.to_owned(), cause };
        let mut text = String::new();
        let mut reader = File::open(file).map_err(io)?.take(FILE_BYTES_MAX + 1);
        reader.read_to_string(&mut text).map_err(io)?;
        let fault = |cause: String| PathError::Format { file: file.to_owned(), cause };
        if text.len() as u64 > FILE_BYTES_MAX {
            return Err(fault(format!("longer than {FILE_BYTES_MAX} bytes")));
        }
        let path: Self = match format {
            Format::Json => serde_json::from_str(&text).map_err(|error| fault(error.to_string()))?,
            Format::Toml => toml::from_str(&text).map_err(|error| fault(error.to_string()))?,
        };
        path.validate().map_err(|error| fault(error.to_string()))?;
        Ok(path)
    }

    /// Writes the path to a .json or .toml file: whole, or not at all.
    ///
    /// # Errors
    /// [`PathError::Extension`], [`PathError::Write`], [`PathError::Invalid`].
    pub fn save(&self, file: &FilePath) -> Result<(), PathError> {
        let format = Format::of(file)?;
        self.validate()?;
        let fault = |cause: String| PathError::Format { file: file.to_owned(), cause };
        let text = match format {
            Format::Json => serde_json::to_string_pretty(self).map_err(|error| fault(error.to_string()))?,
            Format::Toml => toml::to_string(self).map_err(|error| fault(error.to_string()))?,
        };
        let io = |cause| PathError::Write { file: file.to_owned(), cause };
        let mut unfinished = file.as_os_str().to_owned();
        unfinished.push(".unfinished");
        std::fs::write(&unfinished, text).map_err(io)?;
        std::fs::rename(&unfinished, file).map_err(io)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Key;
    use glam::Vec3;

    #[test]
    fn paths_survive_both_formats() {
        let folder = tempfile::tempdir().unwrap();
        let key = |time_s| Key { time_s, position: Vec3::splat(time_s), forward: Vec3::NEG_Z };
        let paths = [
            Path::Recorded { keys: vec![key(0.0), key(1.5)] },
            Path::Orbit { centre: Vec3::ONE, radius: 3.0, height: 0.1, period_s: 12.0 },
            Path::Teleports { seed: 9, bounds_min: Vec3::ZERO, bounds_max: Vec3::ONE, every_s: 0.5 },
        ];
        for path in paths {
            for name in ["path.json", "path.TOML"] {
                let file = folder.path().join(name);
                path.save(&file).unwrap();
                assert_eq!(Path::load(&file).unwrap(), path);
            }
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing unfinished is left");
    }

    #[test]
    fn bad_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let fault = |name: &str, text: &[u8]| {
            let file = folder.path().join(name);
            std::fs::write(&file, text).unwrap();
            Path::load(&file).unwrap_err().to_string()
        };
        assert!(fault("path.txt", b"").contains(".json or .toml"));
        assert!(fault("a.json", b"{\"type\": \"orbit\"").contains("a.json"));
        assert!(fault("b.json", b"{\"type\": \"spiral\"}").contains("spiral"));
        assert!(fault("c.toml", b"type = \"line\"\nspeeed = 1.0").contains("speeed"));
        assert!(fault("d.toml", b"type = \"recorded\"\nkeys = []").contains("keys"));
        assert!(fault("e.json", &[0xFF, 0xFE]).contains("UTF-8"));
        let missing = Path::load(&folder.path().join("missing.json")).unwrap_err();
        assert!(matches!(missing, PathError::Read { .. }), "{missing}");
    }
}
