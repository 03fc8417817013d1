//! Everything that can be wrong with a world on disk: which file, which frame, and the cure.

use crate::format::{Frame, VERSION, VERSION_OLDEST};
use earthshine_world::ChunkId;
use std::path::{Path, PathBuf};

/// Why a tile or a world could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum TileError {
    /// The operating system refused. A write that failed leaves nothing behind.
    #[error("cannot {action} {}: {source}{}", path.display(), io_cure(source))]
    Io {
        /// What was tried: "read", "write", ...
        action: &'static str,
        /// On what.
        path: PathBuf,
        /// What came back.
        source: std::io::Error,
    },
    /// The folder has no manifest.
    #[error("{} is not a world: it has no world.toml; name the folder that `earthshine bake` wrote", path.display())]
    NotAWorld {
        /// The folder.
        path: PathBuf,
    },
    /// `world.toml` cannot be understood, or what it says cannot be.
    #[error("{}: {cause}; bake the world again, or put the manifest back as the bake wrote it", path.display())]
    Manifest {
        /// The manifest.
        path: PathBuf,
        /// Where and what.
        cause: String,
    },
    /// Not a tile at all.
    #[error("{} is not a tile: it does not begin as one; bake it again", path.display())]
    Magic {
        /// The file.
        path: PathBuf,
    },
    /// Written by another version of the format.
    #[error("{} has format version {found}, this program reads {VERSION_OLDEST} to {VERSION}; bake it again with this program", path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: u32,
    },
    /// The bytes are not those that were written.
    #[error("{}: the {frame} is damaged (checksum {found:016x}, written as {expected:016x}); bake it again", path.display())]
    Checksum {
        /// The file.
        path: PathBuf,
        /// Which part.
        frame: Frame,
        /// As written.
        expected: u64,
        /// As read.
        found: u64,
    },
    /// The file ends too early.
    #[error("{} is cut off in the {frame}: {found} of at least {expected} bytes; bake it again", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// The first part that is not all there.
        frame: Frame,
        /// Bytes needed.
        expected: u64,
        /// Bytes there.
        found: u64,
    },
    /// A sound tile in the wrong place.
    #[error("{} does not belong here: its {what} is {found}, the manifest says {expected}; bake the world again", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// "world hash", "chunk", ...
        what: &'static str,
        /// What the manifest says.
        expected: String,
        /// What the file says.
        found: String,
    },
    /// More than this program agrees to hold.
    #[error("{}: the {frame} asks for {value} {what}, the limit is {limit}; bake with smaller chunks", path.display())]
    Limit {
        /// The file; empty while encoding.
        path: PathBuf,
        /// Which part.
        frame: Frame,
        /// "patches", "bytes", ...
        what: &'static str,
        /// Asked for.
        value: u64,
        /// Allowed.
        limit: u64,
    },
    /// Whole, but it contradicts itself.
    #[error("{}: the {frame} is malformed: {cause}; bake it again", path.display())]
    Structure {
        /// The file.
        path: PathBuf,
        /// Which part.
        frame: Frame,
        /// What is wrong.
        cause: String,
    },
    /// The chunk given to `encode` breaks its own rules.
    #[error("chunk {chunk} cannot be written: {cause}")]
    Unencodable {
        /// Which.
        chunk: ChunkId,
        /// What is wrong.
        cause: String,
    },
    /// The manifest lists the chunk, but its file is not there.
    #[error("the tile of chunk {chunk} is missing: {}; bake it again", path.display())]
    Missing {
        /// Which.
        chunk: ChunkId,
        /// Where it should be.
        path: PathBuf,
    },
    /// The manifest does not list the chunk.
    #[error("the world in {} has no chunk {chunk}", path.display())]
    UnknownChunk {
        /// Which.
        chunk: ChunkId,
        /// The world's folder.
        path: PathBuf,
    },
}

impl TileError {
    /// Adapter for `map_err`: `action` on `path` failed.
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { action, path: path.to_owned(), source }
    }

    /// Adapter for `map_err`: a codec's complaint about `frame` of `path`.
    pub(crate) fn structure(path: &Path, frame: Frame) -> impl FnOnce(String) -> Self {
        move |cause| Self::Structure { path: path.to_owned(), frame, cause }
    }

    /// Whether trying again may help: the operating system refused. Everything else needs a new bake.
    #[must_use]
    pub fn is_transient(&self) -> bool {
        matches!(self, Self::Io { .. })
    }
}

/// What a user can do about a refusal of the system, to follow it in a message; empty where nothing is known.
#[must_use]
pub fn io_cure(source: &std::io::Error) -> &'static str {
    use std::io::ErrorKind as Kind;
    match source.kind() {
        Kind::StorageFull | Kind::QuotaExceeded | Kind::FileTooLarge => {
            "; free some space and run the same command again"
        }
        Kind::PermissionDenied => "; give this user access to it",
        _ => "",
    }
}
