//! What the process's exit code says.

use crate::operators::OperatorsError;
use crate::same_scene::OtherScene;
use earthshine_bake::BakeError;
use earthshine_client::ClientError;
use earthshine_fly::{FlyError, PathError, SunPathError};
use earthshine_gen::GenError;
use earthshine_radiosity::solver::SettingsError;
use earthshine_render::camera::CameraError;
use earthshine_render::compare_points::CompareError;
use earthshine_render::csv::CsvError;
use earthshine_render::image_file::ImageFileError;
use earthshine_render::metrics::SizeError;
use earthshine_render::picture::SamplesError;
use earthshine_render::progressive::ProgressiveError;
use earthshine_render::screen_space::ScreenSpaceError;
use earthshine_scene::SceneError;
use earthshine_server::ServerError;
use earthshine_tiles::TileError;

/// Anything without a code of its own.
pub(crate) const OTHER: u8 = 1;
/// The command line (clap's own code).
pub(crate) const USAGE: u8 = 2;
/// A scene, lights, points or picture file.
pub(crate) const INPUT: u8 = 3;
/// A world folder or tile.
pub(crate) const WORLD: u8 = 4;
/// Connection refused, lost, timed out, or another version.
pub(crate) const CONNECTION: u8 = 7;
/// A file could not be written or read: disk full, permissions.
pub(crate) const STORAGE: u8 = 8;
/// A check that was asked for found faults.
pub(crate) const FAULTS: u8 = 9;

/// For `--help`.
pub(crate) const HELP: &str = "\
Exit codes: 0 done; 1 other; 2 command line; 3 input file (scene, lights, points, picture); 4 world or tile;
5 configuration; 6 address in use; 7 connection; 8 storage (disk full, permissions); 9 a check found faults;
10 the service failed while running; 11 it did not drain in time.

Examples:
  earthshine demo
  earthshine gen town town.glb && earthshine bake town.glb town.world
  earthshine serve town.world          (and in another terminal)
  earthshine fly --scene town.glb --out pictures";

/// A check that was asked for found faults; they have been printed.
#[derive(Debug, thiserror::Error)]
#[error("{count} faults found")]
pub(crate) struct FaultsFound {
    /// How many.
    pub count: usize,
}

/// Input files that do not fit each other.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Mismatch(pub String);

/// Options that do not go together.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct WrongUse(pub &'static str);

/// `error` and its causes in one line, each said once.
pub(crate) fn described(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if !text.contains(&cause) {
            text = if text.is_empty() { cause } else { format!("{text}: {cause}") };
        }
    }
    text
}

/// The code for `error`: that of the first cause that has one.
pub(crate) fn of(error: &anyhow::Error) -> u8 {
    error.chain().find_map(code).unwrap_or(OTHER)
}

fn code(cause: &(dyn std::error::Error + 'static)) -> Option<u8> {
    if let Some(error) = cause.downcast_ref::<ServerError>() {
        return Some(error.exit_code());
    }
    if let Some(error) = cause.downcast_ref::<TileError>() {
        return Some(tile_code(error));
    }
    if let Some(error) = cause.downcast_ref::<BakeError>() {
        return Some(match error {
            BakeError::Parameter { .. }
            | BakeError::TooFine { .. }
            | BakeError::TooManyPairs { .. }
            | BakeError::Memory { .. } => USAGE,
            BakeError::TooManyPatches { .. } | BakeError::NoPatches { .. } => INPUT,
            BakeError::OtherWorld { .. } => WORLD,
            BakeError::Io { .. } | BakeError::WorkChanged { .. } => STORAGE,
            BakeError::Tile(error) => tile_code(error),
        });
    }
    if let Some(error) = cause.downcast_ref::<FlyError>() {
        return Some(match error {
            FlyError::Options { .. } | FlyError::Path(_) => USAGE,
            FlyError::Client { .. } => CONNECTION,
        });
    }
    if let Some(error) = cause.downcast_ref::<GenError>() {
        return Some(if matches!(error, GenError::Write { .. }) { STORAGE } else { USAGE });
    }
    if let Some(error) = cause.downcast_ref::<ProgressiveError>() {
        return Some(if matches!(error, ProgressiveError::Option { .. }) { USAGE } else { INPUT });
    }
    let is_storage = cause.is::<std::io::Error>()
        || matches!(cause.downcast_ref(), Some(CsvError::Write { .. }))
        || matches!(cause.downcast_ref(), Some(PathError::Write { .. }))
        || matches!(cause.downcast_ref(), Some(ImageFileError { is_writing: true, .. }));
    let is_input = cause.is::<SceneError>()
        || cause.is::<CsvError>()
        || cause.is::<ImageFileError>()
        || cause.is::<CompareError>()
        || cause.is::<SizeError>()
        || cause.is::<PathError>()
        || cause.is::<SunPathError>()
        || cause.is::<Mismatch>();
    let is_usage = cause.is::<CameraError>()
        || cause.is::<SamplesError>()
        || cause.is::<ScreenSpaceError>()
        || cause.is::<SettingsError>()
        || matches!(cause.downcast_ref(), Some(OperatorsError::Refused { .. }))
        || cause.is::<WrongUse>();
    match () {
        () if cause.is::<OtherScene>() => Some(WORLD),
        () if is_storage => Some(STORAGE),
        () if is_input => Some(INPUT),
        () if is_usage => Some(USAGE),
        () if cause.is::<ClientError>() || cause.is::<OperatorsError>() => Some(CONNECTION),
        () if cause.is::<FaultsFound>() => Some(FAULTS),
        () => None,
    }
}

fn tile_code(error: &TileError) -> u8 {
    if matches!(error, TileError::Io { .. }) { STORAGE } else { WORLD }
}
