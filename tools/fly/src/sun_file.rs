//! Sun paths as TOML files.

use crate::toml_table::TomlTable;
use crate::{FlyOptions, SunCourse, SunLight, SunPath};
use glam::Vec3;
use std::path::{Path, PathBuf};
use toml::de::DeTable;

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

/// A sun path as it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct SunFile {
    /// Checked.
    pub sun: SunPath,
    /// A sentence for people about what is probably not meant.
    pub warning: Option<String>,
}

impl SunFile {
    /// Reads a sun path from a TOML file, and checks it.
    ///
    /// # Errors
    /// [`SunPathError`], naming the file, the line and the key.
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
        let read = Self::parse(&text).map_err(fault)?;
        let warning = read.warning.map(|warning| format!("sun path {file:?}: {warning}"));
        Ok(Self { warning, ..read })
    }

    /// Faults and warnings begin with their line.
    fn parse(text: &str) -> Result<Self, String> {
        let entries = DeTable::parse(text).map_err(|error| error.to_string().trim().to_owned())?;
        let mut file = TomlTable::file(text, entries.get_ref());
        let mut course = file.table("course", "course.")?;
        let mut light = file.table("light", "light.")?;
        let sun = SunPath {
            course: read_course(&mut course)?,
            light: read_light(&mut light)?,
            rate_hz: file.read_or("rate_hz", 2.0)?,
        };
        let (least, most) = (FlyOptions::RATE_HZ_MIN, FlyOptions::RATE_HZ_MAX);
        if !(least..=most).contains(&sun.rate_hz) {
            return Err(file.fault("rate_hz", &format!("is {}; it must be {least} to {most}", sun.rate_hz)));
        }
        sun.validate().map_err(|fault| {
            let table = if fault.table == "course" { &course } else { &light };
            table.fault(fault.key, &fault.cause)
        })?;
        let warning = sun.remark().map(|(key, remark)| light.fault(key, &remark));
        [course, light, file].into_iter().try_for_each(TomlTable::finish)?;
        Ok(Self { sun, warning })
    }
}

fn read_course(table: &mut TomlTable<'_>) -> Result<SunCourse, String> {
    match table.read::<String>("type")?.as_str() {
        "straight" => Ok(SunCourse::Straight {
            azimuth_deg: table.read_array("azimuth_deg")?,
            elevation_deg: table.read_array("elevation_deg")?,
        }),
        "solar" => Ok(SunCourse::Solar {
            latitude_deg: table.read("latitude_deg")?,
            day_of_year: table.read("day_of_year")?,
            from_hour: table.read("from_hour")?,
            to_hour: table.read("to_hour")?,
            north_azimuth_deg: table.read_or("north_azimuth_deg", -90.0)?,
        }),
        other => Err(table.fault("type", &format!("is `{other}`; it must be `straight` or `solar`"))),
    }
}

fn read_light(table: &mut TomlTable<'_>) -> Result<SunLight, String> {
    match table.read::<String>("type")?.as_str() {
        "constant" => {
            Ok(SunLight::Constant { illuminance: Vec3::from_array(table.read_array("illuminance")?) })
        }
        "clear_sky" => {
            Ok(SunLight::ClearSky { ground_reflectance: table.read_or("ground_reflectance", 0.2)? })
        }
        other => Err(table.fault("type", &format!("is `{other}`; it must be `constant` or `clear_sky`"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(text: &str) -> Result<SunFile, String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("day.toml");
        std::fs::write(&file, text).unwrap();
        SunFile::load(&file).map_err(|error| error.to_string())
    }

    #[test]
    fn the_example_is_a_sun_path() {
        let example = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/day.example.toml"));
        let SunFile { sun: path, warning } = SunFile::load(example).unwrap();
        assert_eq!(warning, None);
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
        assert_eq!(path, Ok(SunFile { sun: expected, warning: None }));
    }

    #[test]
    fn faults_name_file_line_and_key() {
        let light = "light = { type = \"clear_sky\" }\n";
        let fault = |text: &str, words: &[&str]| {
            let cause = load(text).unwrap_err();
            for word in [&["day.toml", "day.example.toml"], words].concat() {
                assert!(cause.contains(word), "{word:?} is not in {cause}");
            }
        };
        fault("rate_hz = ", &["line 1"]);
        fault(light, &["line 1: course is missing"]);
        fault("course = 3", &["line 1: course is of type integer, not a table"]);
        fault(&format!("{light}[course]\nlatitude_deg = 3"), &["line 2: course.type is missing"]);
        let solar = |keys: &str| format!("{light}[course]\ntype = \"solar\"\n{keys}");
        for (keys, words) in [
            (
                "day_of_year = 1\nlatitude_deg = 123\nfrom_hour = 1\nto_hour = 2",
                "line 5: course.latitude_deg is 123",
            ),
            (
                "latitude_deg = nan\nday_of_year = 1\nfrom_hour = 1\nto_hour = 2",
                "line 4: course.latitude_deg is NaN",
            ),
            (
                "latitude_deg = 1\nday_of_year = 1\nfrom_hour = 9\nto_hour = 2",
                "line 7: course.to_hour is 2; it must be 9 to 48",
            ),
            ("latitude_deg = \"x\"", "line 4: course.latitude_deg: invalid type: string \"x\""),
            (
                "latitude_deg = 1\nday_of_year = 70000",
                "line 5: course.day_of_year: invalid value: integer `70000`",
            ),
            ("latitude_deg = 1\nday_of_year = 7\nfrom_hour = 1", "line 2: course.to_hour is missing"),
            (
                "latitude_deg = 1\nday_of_year = 7\nfrom_hour = 1\nto_hour = 2\nazimuth_deg = 3",
                "line 8: course.azimuth_deg means nothing here",
            ),
        ] {
            fault(&solar(keys), &[words]);
        }
        let straight = "course = { type = \"straight\", azimuth_deg = [0, 90], elevation_deg = [-5, 60] }\n";
        fault(
            &format!("{straight}light = {{ type = \"moon\" }}"),
            &["line 2: light.type is `moon`", "clear_sky"],
        );
        fault(
            &format!("{straight}[light]\ntype = \"constant\"\nilluminance = [1, -1, 1]"),
            &["line 4: light.illuminance is negative"],
        );
        fault(
            &format!("{straight}[light]\ntype = \"constant\"\nilluminance = [1, 2, 3, 4]"),
            &["line 4: light.illuminance has 4 numbers, not 3"],
        );
        let straight_course = |azimuths: &str| {
            format!("{light}[course]\ntype = \"straight\"\nazimuth_deg = {azimuths}\nelevation_deg = [1, 2]")
        };
        fault(&straight_course("[0, 90, 180]"), &["line 4: course.azimuth_deg has 3 numbers, not 2"]);
        fault(&straight_course("[0]"), &["line 4: course.azimuth_deg has 1 numbers, not 2"]);
        fault(&format!("{straight}{light}rate_hz = 0"), &["line 3: rate_hz is 0; it must be"]);
        fault(&format!("{straight}{light}rates = 0"), &["line 3: rates means nothing here"]);
        let missing = SunFile::load(Path::new("no such day.toml")).unwrap_err().to_string();
        assert!(missing.contains("no such day.toml") && missing.contains("check the path"), "{missing}");
    }

    #[test]
    fn suns_that_are_dark_or_blinding_are_remarked_on() {
        let warning = |illuminance: &str, elevation: &str| {
            let text = format!(
                "course = {{ type = \"straight\", azimuth_deg = [0, 90], elevation_deg = {elevation} }}\n\
                 [light]\ntype = \"constant\"\nilluminance = {illuminance}\n"
            );
            load(&text).unwrap().warning
        };
        let dark = warning("[0, 0, 0]", "[10, 20]").unwrap();
        assert!(dark.contains("day.toml") && dark.contains("line 4: light.illuminance is zero"), "{dark}");
        let blinding = warning("[1, 1e12, 1]", "[10, 20]").unwrap();
        assert!(blinding.contains("line 4: light.illuminance is 1.0e12 lx, more than 1e9"), "{blinding}");
        assert_eq!(warning("[0, 0, 1]", "[10, 20]"), None);
        assert_eq!(warning("[1, 1, 1]", "[-20, -10]"), None, "nights are dark");
    }
}
