//! Sun paths as TOML files.

use crate::SunPath;
use std::path::{Path, PathBuf};

/// Longest file, bytes.
const FILE_BYTES_MAX: u64 = 64 << 10;

/// A sun path that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SunPathError {
    /// The file cannot be read.
    #[error("sun path {file:?}: {cause}; check the path")]
    Io {
        /// Which.
        file: PathBuf,
        /// What the system says.
        #[source]
        cause: std::io::Error,
    },
    /// The file's contents are no sun path.
    #[error("sun path {file:?}: {cause}; config/day.example.toml shows every key")]
    Format {
        /// Which.
        file: PathBuf,
        /// What is wrong, and where.
        cause: String,
    },
}

impl SunPath {
    /// Reads a sun path from a TOML file, and checks it.
    ///
    /// # Errors
    /// [`SunPathError`], naming the file, and the line or the key.
    pub fn load(file: &Path) -> Result<Self, SunPathError> {
        use std::io::Read as _;
        let io = |cause| SunPathError::Io { file: file.to_owned(), cause };
        let fault = |cause: String| SunPathError::Format { file: file.to_owned(), cause };
        let mut text = String::new();
        let reader = std::fs::File::open(file).map_err(io)?;
        reader.take(FILE_BYTES_MAX + 1).read_to_string(&mut text).map_err(io)?;
        if text.len() as u64 > FILE_BYTES_MAX {
            return Err(fault(format!("longer than {FILE_BYTES_MAX} bytes")));
        }
        let path: Self = toml::from_str(&text).map_err(|error| fault(error.to_string().trim().to_owned()))?;
        path.validate().map_err(fault)?;
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SunCourse, SunLight};

    fn load(text: &str) -> Result<SunPath, String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("day.toml");
        std::fs::write(&file, text).unwrap();
        SunPath::load(&file).map_err(|error| error.to_string())
    }

    #[test]
    fn the_example_is_a_sun_path() {
        let example = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/day.example.toml"));
        let path = SunPath::load(example).unwrap();
        assert!(matches!(path.course, SunCourse::Solar { .. }), "{path:?}");
        assert!(matches!(path.light, SunLight::ClearSky { .. }), "{path:?}");
    }

    #[test]
    fn courses_and_lights_combine_and_have_defaults() {
        let path = load(
            "course = { type = \"straight\", azimuth_deg = [0, 90], elevation_deg = [-5, 60] }\n\
             light = { type = \"clear_sky\" }\n",
        );
        let expected = SunPath {
            course: SunCourse::Straight { azimuth_deg: [0.0, 90.0], elevation_deg: [-5.0, 60.0] },
            light: SunLight::ClearSky { ground_reflectance: 0.2 },
            rate_hz: 2.0,
        };
        assert_eq!(path, Ok(expected));
    }

    #[test]
    fn bad_files_are_named() {
        let light = "light = { type = \"clear_sky\" }\n";
        let fault = |text: &str, words: &[&str]| {
            let cause = load(text).unwrap_err();
            assert!(words.iter().all(|word| cause.contains(word)) && cause.contains("day.toml"), "{cause}");
        };
        fault("rate_hz = ", &["line 1", "day.example.toml"]);
        fault(light, &["course"]);
        fault(&format!("{light}course = {{ type = \"lunar\" }}"), &["lunar", "straight", "line 2"]);
        let north_pole =
            "course = { type = \"solar\", latitude_deg = 123, day_of_year = 1, from_hour = 1, to_hour = 2 }";
        fault(&format!("{light}{north_pole}"), &["course.latitude_deg is 123", "-90 to 90"]);
        let missing = SunPath::load(Path::new("no such day.toml")).unwrap_err().to_string();
        assert!(missing.contains("no such day.toml") && missing.contains("check the path"), "{missing}");
    }
}
