//! Reference light on disk: one point a line, `x,y,z,nx,ny,nz,r,g,b,sr,sg,sb`.
//!
//! Metres, unit normals, irradiance as served in lx, standard error of its mean in lx. Columns are found
//! by name: their order is free and further ones are ignored. Other renderers write these files too, so
//! everything in them is checked and a fault is named by line and column.

use crate::PointEstimate;
use earthshine_world::{Rgb, Vec3};
use std::io::{ErrorKind, Read as _};
use std::path::{Path, PathBuf};

/// The columns, in the order they are written.
pub const COLUMNS: [&str; 12] = ["x", "y", "z", "nx", "ny", "nz", "r", "g", "b", "sr", "sg", "sb"];
/// Largest file that is read, bytes: some millions of points.
pub const FILE_BYTES_MAX: u64 = 1 << 30;
/// How far a normal's length may be from one: files carry six decimals.
const NORMAL_TOLERANCE: f32 = 1e-3;

/// Light at one point, as some renderer found it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferencePoint {
    /// m.
    pub position: Vec3,
    /// Unit.
    pub normal: Vec3,
    /// lx.
    pub irradiance: Rgb,
    /// Of the irradiance, lx.
    pub standard_error: Rgb,
}

impl ReferencePoint {
    /// What our own path tracer found at a place (position, unit normal).
    #[must_use]
    pub fn of((position, normal): (Vec3, Vec3), estimate: &PointEstimate) -> Self {
        let PointEstimate { irradiance, standard_error, .. } = *estimate;
        Self { position, normal, irradiance, standard_error }
    }
}

/// A file that holds no reference light.
#[derive(Debug, thiserror::Error)]
pub enum CsvError {
    /// Cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Cannot be written.
    #[error("{}: {source}", path.display())]
    Write {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Too large to be what it says.
    #[error("{}: {bytes} bytes or more; a reference may have {FILE_BYTES_MAX}", path.display())]
    TooLarge {
        /// Which file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// Nothing but a header.
    #[error("{}: there are no points in it", path.display())]
    NoPoints {
        /// Which file.
        path: PathBuf,
    },
    /// Something in the file is wrong.
    #[error("{}, line {line}: {fault}", path.display())]
    Line {
        /// Which file.
        path: PathBuf,
        /// Counted from one.
        line: usize,
        /// What is wrong there.
        fault: LineFault,
    },
}

/// What is wrong with a line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LineFault {
    /// The file is empty.
    #[error("there is no header; expected {}", COLUMNS.join(","))]
    NoHeader,
    /// The header lacks a column.
    #[error("the header has no column `{0}`; expected {expected}", expected = COLUMNS.join(","))]
    ColumnMissing(&'static str),
    /// The header has a column twice.
    #[error("the header has the column `{0}` twice; leave one of them out")]
    ColumnTwice(&'static str),
    /// A line is shorter than the header.
    #[error("column `{0}` is missing")]
    ValueMissing(&'static str),
    /// A line is longer than the header.
    #[error("{found} values under {columns} columns")]
    ValuesLeft {
        /// Columns of the header.
        columns: usize,
        /// Values of the line.
        found: usize,
    },
    /// Not a number.
    #[error("column `{column}` is `{text}`, which is not a finite number")]
    NotFinite {
        /// Which column.
        column: &'static str,
        /// What it holds.
        text: String,
    },
    /// Light and its error cannot be negative.
    #[error("column `{column}` is {value}, below zero")]
    Negative {
        /// Which column.
        column: &'static str,
        /// What it holds.
        value: f32,
    },
    /// A direction must be one.
    #[error("the normal has length {length}, not one")]
    NormalNotUnit {
        /// Its length.
        length: f32,
    },
}

/// Reads reference points.
///
/// # Errors
/// The file cannot be read, is too large, or a line is not a point.
pub fn read(path: &Path) -> Result<Vec<ReferencePoint>, CsvError> {
    parse(&text_of(path)?).map_err(|(line, fault)| CsvError::Line { path: path.into(), line, fault })
}

/// Reads places (position, unit normal) alone: the first six columns suffice, further ones are ignored.
///
/// # Errors
/// As [`read`].
pub fn read_places(path: &Path) -> Result<Vec<(Vec3, Vec3)>, CsvError> {
    parse_places(&text_of(path)?).map_err(|(line, fault)| CsvError::Line { path: path.into(), line, fault })
}

fn text_of(path: &Path) -> Result<String, CsvError> {
    let io = |source| CsvError::Read { path: path.into(), source };
    let file = std::fs::File::open(path).map_err(io)?;
    let bytes = file.metadata().map_err(io)?.len();
    let mut text = String::new();
    // What a pipe or a device holds is known once it is read.
    if bytes <= FILE_BYTES_MAX {
        file.take(FILE_BYTES_MAX + 1).read_to_string(&mut text).map_err(io)?;
    }
    let bytes = bytes.max(text.len() as u64);
    if bytes > FILE_BYTES_MAX { Err(CsvError::TooLarge { path: path.into(), bytes }) } else { Ok(text) }
}

/// Writes reference points; the file appears whole or not at all. Pipes and devices, and files whose folder takes no new
/// one, are written to as they are.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, points: &[ReferencePoint]) -> Result<(), CsvError> {
    let text = to_text(points);
    // A file that took the place of a device would be the end of the device.
    let found = std::fs::metadata(path);
    let written = if found.as_ref().is_ok_and(|found| !found.is_file()) {
        std::fs::write(path, text)
    } else {
        let mut unfinished = path.as_os_str().to_owned();
        unfinished.push(".part");
        match std::fs::write(&unfinished, &text) {
            Err(error) if error.kind() == ErrorKind::PermissionDenied && found.is_ok() => {
                std::fs::write(path, text)
            }
            unfinished_written => unfinished_written.and_then(|()| std::fs::rename(&unfinished, path)),
        }
    };
    written.map_err(|source| CsvError::Write { path: path.into(), source })
}

/// The file's contents for `points`; numbers read back to the same bits.
#[must_use]
pub fn to_text(points: &[ReferencePoint]) -> String {
    let mut text = COLUMNS.join(",") + "\n";
    for point in points {
        let values = [point.position, point.normal, point.irradiance, point.standard_error];
        let numbers: Vec<String> = values.iter().flat_map(Vec3::to_array).map(|v| v.to_string()).collect();
        text.push_str(&numbers.join(","));
        text.push('\n');
    }
    text
}

/// The points in `text`.
///
/// # Errors
/// The first faulty line, counted from one, and its fault.
pub fn parse(text: &str) -> Result<Vec<ReferencePoint>, (usize, LineFault)> {
    rows::<12>(text)?
        .into_iter()
        .map(|(line, values)| {
            for (&value, column) in values.iter().zip(COLUMNS).skip(6) {
                if value < 0.0 {
                    return Err((line, LineFault::Negative { column, value }));
                }
            }
            let (position, normal) = place_of(&values).map_err(|fault| (line, fault))?;
            let at = |first: usize| Vec3::new(values[first], values[first + 1], values[first + 2]);
            Ok(ReferencePoint { position, normal, irradiance: at(6), standard_error: at(9) })
        })
        .collect()
}

fn parse_places(text: &str) -> Result<Vec<(Vec3, Vec3)>, (usize, LineFault)> {
    rows::<6>(text)?
        .into_iter()
        .map(|(line, values)| place_of(&values).map_err(|fault| (line, fault)))
        .collect()
}

/// A line's number and the first `N` of its [`COLUMNS`].
type Row<const N: usize> = (usize, [f32; N]);

/// The first `N` of [`COLUMNS`] of every line that is not empty, with the line's number.
fn rows<const N: usize>(text: &str) -> Result<Vec<Row<N>>, (usize, LineFault)> {
    let mut lines = text.lines().enumerate();
    let (_, header) = lines.next().ok_or((1, LineFault::NoHeader))?;
    let places = column_places::<N>(header).map_err(|fault| (1, fault))?;
    let columns = header.split(',').count();
    lines
        .filter(|(_, line)| !line.trim().is_empty())
        .map(|(index, line)| {
            let found = line.split(',').count();
            let is_longer = found > columns;
            let fault = is_longer.then_some(LineFault::ValuesLeft { columns, found });
            let values = fault.map_or_else(|| values_of(line, &places), Err);
            values.map(|values| (index + 1, values)).map_err(|fault| (index + 1, fault))
        })
        .collect()
}

fn column_places<const N: usize>(header: &str) -> Result<[usize; N], LineFault> {
    let names: Vec<&str> = header.trim_start_matches('\u{feff}').split(',').map(str::trim).collect();
    let mut places = [0; N];
    for (place, column) in places.iter_mut().zip(COLUMNS) {
        let found = names.iter().position(|&name| name == column);
        *place = found.ok_or(LineFault::ColumnMissing(column))?;
        if names[*place + 1..].contains(&column) {
            return Err(LineFault::ColumnTwice(column));
        }
    }
    Ok(places)
}

fn values_of<const N: usize>(line: &str, places: &[usize; N]) -> Result<[f32; N], LineFault> {
    let fields: Vec<&str> = line.split(',').map(str::trim).collect();
    let mut values = [0.0f32; N];
    for ((value, &place), column) in values.iter_mut().zip(places).zip(COLUMNS) {
        let text = *fields.get(place).ok_or(LineFault::ValueMissing(column))?;
        *value = match text.parse::<f32>() {
            Ok(number) if number.is_finite() => number,
            _ => return Err(LineFault::NotFinite { column, text: text.into() }),
        };
    }
    Ok(values)
}

/// Position and normal, the first six values.
fn place_of(values: &[f32]) -> Result<(Vec3, Vec3), LineFault> {
    let normal = Vec3::from_slice(&values[3..6]);
    let length = normal.length();
    if (length - 1.0).abs() > NORMAL_TOLERANCE {
        return Err(LineFault::NormalNotUnit { length });
    }
    Ok((Vec3::from_slice(values), normal / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "x,y,z,nx,ny,nz,r,g,b,sr,sg,sb\n";

    fn fault(text: &str) -> (usize, LineFault) {
        parse(text).expect_err("a fault")
    }

    #[test]
    fn points_survive_a_round_trip_through_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.csv");
        let points: Vec<ReferencePoint> = (1..50)
            .map(|i| ReferencePoint {
                position: Vec3::new(0.1, -7.3, 1e-5) * i as f32,
                normal: Vec3::NEG_Z,
                irradiance: Rgb::new(1e5, 1.0 / 3.0, 0.0) * i as f32,
                standard_error: Rgb::splat(1e-7),
            })
            .collect();
        write(&path, &points).unwrap();
        assert_eq!(read(&path).unwrap(), points);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing unfinished is left");
    }

    /// Goal: a device is written to, not replaced by a file. Method: a link to one; a file would take the link's place, or that
    /// of the device.
    #[cfg(unix)]
    #[test]
    fn devices_stay_devices() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("null.csv");
        std::os::unix::fs::symlink("/dev/null", &path).unwrap();
        write(&path, &[]).unwrap();
        assert!(std::fs::symlink_metadata(&path).unwrap().is_symlink());
        assert_eq!(std::fs::read(&path).unwrap(), b"");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing unfinished is left");
    }

    /// Goal: a file that may be written is, where its folder takes no new one. Root may write everywhere: for it, this is
    /// the way of all other files.
    #[cfg(unix)]
    #[test]
    fn files_of_folders_that_take_no_new_ones_are_written() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.csv");
        std::fs::write(&path, "old").unwrap();
        let allow = |mode| std::fs::set_permissions(folder.path(), PermissionsExt::from_mode(mode)).unwrap();
        allow(0o555);
        let written = write(&path, &[]);
        allow(0o755);
        written.unwrap();
        assert_eq!(read(&path).unwrap(), []);
    }

    #[test]
    fn columns_are_found_by_name() {
        let text = "name,sb,sg,sr,b,g,r,nz,ny,nx,z,y,x\nA,12,11,10,9,8,7,0,1,0,3,2,1\n\n";
        let point = parse(text).unwrap()[0];
        assert_eq!((point.position, point.normal), (Vec3::new(1.0, 2.0, 3.0), Vec3::Y));
        assert_eq!((point.irradiance.x, point.standard_error.z), (7.0, 12.0));
    }

    #[test]
    fn faults_name_line_and_column() {
        assert_eq!(fault(""), (1, LineFault::NoHeader));
        assert_eq!(fault("x,y,z,nx,ny,nz,r,g,b\n"), (1, LineFault::ColumnMissing("sr")));
        assert_eq!(fault("r,x,y,z,nx,ny,nz,r,g,b,sr,sg,sb\n"), (1, LineFault::ColumnTwice("r")));
        let good = "0,0,0,0,1,0,1,1,1,0,0,0\n";
        let second = |line: &str| fault(&format!("{HEADER}{good}{line}"));
        assert_eq!(second("0,0,0,0,1,0,1,1,1,0,0"), (3, LineFault::ValueMissing("sb")));
        let longer = LineFault::ValuesLeft { columns: 12, found: 13 };
        assert_eq!(second("0,0,0,0,1,0,1,1,1,0,0,0,0"), (3, longer));
        let not_finite = |column, text: &str| (3, LineFault::NotFinite { column, text: text.into() });
        assert_eq!(second("0,0,0,0,1,0,1,NaN,1,0,0,0"), not_finite("g", "NaN"));
        assert_eq!(second("0,inf,0,0,1,0,1,1,1,0,0,0"), not_finite("y", "inf"));
        assert_eq!(second("0,,0,0,1,0,1,1,1,0,0,0"), not_finite("y", ""));
        assert_eq!(second("0,0,0,0,1,0,1,1,-1,0,0,0"), (3, LineFault::Negative { column: "b", value: -1.0 }));
        assert_eq!(second("0,0,0,0,2,0,1,1,1,0,0,0"), (3, LineFault::NormalNotUnit { length: 2.0 }));
    }

    #[test]
    fn places_need_no_light() {
        let text = "x,y,z,nx,ny,nz,r\n1,2,3,0,1,0,NaN\n";
        assert_eq!(parse_places(text).unwrap(), [(Vec3::new(1.0, 2.0, 3.0), Vec3::Y)]);
        let fault = parse_places("x,y,z,nx,ny,nz\n0,0,0,0,0,3\n").unwrap_err();
        assert_eq!(fault, (2, LineFault::NormalNotUnit { length: 3.0 }));
        assert_eq!(parse_places("x,y,z\n").unwrap_err(), (1, LineFault::ColumnMissing("nx")));
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = read(Path::new("no-such-points.csv")).unwrap_err().to_string();
        assert!(error.starts_with("no-such-points.csv: "), "{error}");
    }
}
