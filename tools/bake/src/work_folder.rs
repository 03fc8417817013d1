//! What a bake keeps beside a world, so that a later run need not do it again: `WORLD/.bake/`.
//!
//! One file a stage and chunk, with a [`Stamp`] of everything that it depends on. A file is good for any bake that
//! finds the same stamp, of this scene or of an edited one; a damaged one is as good as none. Several processes may
//! work on one world: whoever finishes a file first puts it there whole, and others would put the same bytes.
//!
//! │ xxh3 of the rest │ key, own, look, state, payload bytes, seen cells │ (cell, content) each │ payload │, u64 but for
//! the payload.
//!
//! Beside them lie the states of the scene (`changes`) that stamps name.

use crate::BakeError;
use crate::cells::Cells;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use xxhash_rust::xxh3::xxh3_64;

/// Folder inside a world that holds them.
pub const FOLDER: &str = ".bake";
const HEAD_BYTES: usize = 56;
const STATES: &str = "states";

/// Which kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// How exposed points are, and the patches made of them.
    Surfaces,
    /// Rows as their own rays see them.
    Rows,
    /// Rows of receivers in the air.
    Receivers,
    /// What emitters see of detail voxels.
    Emitted,
    /// Receivers on surfaces.
    Details,
    /// Rows after both estimates of each pair were averaged. Goes when the world is whole.
    Averages,
    /// What the manifest will say of a finished tile. Goes when the world is whole.
    Tiles,
}

impl Kind {
    const ALL: [Self; 7] = [
        Self::Surfaces,
        Self::Rows,
        Self::Receivers,
        Self::Emitted,
        Self::Details,
        Self::Averages,
        Self::Tiles,
    ];

    fn folder(self) -> &'static str {
        match self {
            Self::Surfaces => "surfaces",
            Self::Rows => "rows",
            Self::Receivers => "receivers",
            Self::Emitted => "emitted",
            Self::Details => "details",
            Self::Averages => "averages",
            Self::Tiles => "tiles",
        }
    }

    /// Whether a finished world has no use for it.
    fn is_passing(self) -> bool {
        matches!(self, Self::Averages | Self::Tiles)
    }
}

/// What a file depends on.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Stamp {
    /// Parameters, and what else holds for all chunks.
    pub key: u64,
    /// The chunk's own surfaces, as rays notice them.
    pub own: u64,
    /// The same with their colours; zero where they do not matter.
    pub look: u64,
    /// Hash of the state of the scene that it was made from.
    pub state: u64,
    /// The cells that rays crossed, with what was in them, where that is what tells of changes.
    pub seen: Vec<(u32, u64)>,
}

/// Why a file is of no use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stale {
    /// There is none, or it is damaged.
    Absent,
    /// Parameters, lamps or the extent of the scene are others.
    Parameters,
    /// The chunk's own surfaces are others.
    Own,
    /// An edit can have changed what some of its rays find.
    Part {
        /// So many of its rows or points.
        renewed: u32,
        /// All of them.
        of: u32,
        /// The middle of a place that changed, m.
        at: [f32; 3],
    },
    /// What its rays cross has changed.
    Seen {
        /// So many cells of those crossed.
        changed: u32,
        /// Cells crossed.
        of: u32,
        /// The middle of one that changed, m.
        at: [f32; 3],
    },
}

impl Stamp {
    /// Why a file with this stamp is of no use where `now` holds, whatever changed elsewhere in the scene.
    #[must_use]
    pub fn difference(&self, now: &Self) -> Option<Stale> {
        if self.key != now.key {
            Some(Stale::Parameters)
        } else if self.own != now.own {
            Some(Stale::Own)
        } else {
            None
        }
    }

    /// As [`Self::difference`], or [`Self::changed_sight`].
    #[must_use]
    pub fn staleness(&self, now: &Self, cells: &Cells) -> Option<Stale> {
        self.difference(now).or_else(|| self.changed_sight(cells))
    }

    /// Whether `cells` have other contents than those seen.
    #[must_use]
    pub fn changed_sight(&self, cells: &Cells) -> Option<Stale> {
        let is_other = |entry: &&(u32, u64)| cells.content(entry.0) != entry.1;
        let first = self.seen.iter().find(is_other)?;
        Some(Stale::Seen {
            changed: self.seen.iter().filter(is_other).count() as u32,
            of: self.seen.len() as u32,
            at: cells.centre(first.0).to_array(),
        })
    }
}

/// The work folder of one world.
#[derive(Debug, Clone)]
pub struct WorkFolder {
    folder: PathBuf,
}

impl WorkFolder {
    /// Opens, or makes, the work folder of `world`.
    ///
    /// # Errors
    /// A folder cannot be made.
    pub fn open(world: &Path) -> Result<Self, BakeError> {
        let folder = world.join(FOLDER);
        for name in Kind::ALL.map(Kind::folder).into_iter().chain([STATES]) {
            let path = folder.join(name);
            std::fs::create_dir_all(&path).map_err(BakeError::io(&path))?;
        }
        Ok(Self { folder })
    }

    /// How far the bake of a `world` that is not whole yet has come: finished chunks by stage, in the order in which a bake
    /// goes, of all levels. Nothing where no bake has begun.
    #[must_use]
    pub fn finished(world: &Path) -> Vec<(&'static str, usize)> {
        let count = |kind: Kind| {
            let files = std::fs::read_dir(world.join(FOLDER).join(kind.folder())).ok()?;
            Some((kind.folder(), files.count())).filter(|&(_, count)| count > 0)
        };
        Kind::ALL.into_iter().filter_map(count).collect()
    }

    /// Removes what a finished world has no use for; with `everything`, what an edit would use, too.
    ///
    /// # Errors
    /// A folder is there and cannot be removed.
    pub fn clear(world: &Path, everything: bool) -> Result<(), BakeError> {
        let folder = world.join(FOLDER);
        let passing = Kind::ALL.into_iter().filter(|kind| kind.is_passing());
        let gone =
            if everything { vec![folder] } else { passing.map(|kind| folder.join(kind.folder())).collect() };
        for path in gone {
            match std::fs::remove_dir_all(&path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    return Err(BakeError::io(path)(error));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// The file of `kind` for chunk `at` of `level`, if there is a sound one.
    #[must_use]
    pub fn read(&self, kind: Kind, level: u8, at: [i32; 3]) -> Option<(Stamp, Vec<u8>)> {
        let mut bytes = Vec::new();
        File::open(self.path(kind, level, at)).ok()?.read_to_end(&mut bytes).ok()?;
        decode(bytes)
    }

    /// Puts a file there, whole or not at all. It is not synced: what a power failure spoils is done again.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(
        &self,
        kind: Kind,
        level: u8,
        at: [i32; 3],
        stamp: &Stamp,
        payload: &[u8],
    ) -> Result<(), BakeError> {
        put(&self.path(kind, level, at), &encode(stamp, payload))
    }

    /// The bytes of a state, if they are there; whether they are sound is the caller's to find out.
    pub(crate) fn read_state(&self, state: u64) -> Option<Vec<u8>> {
        std::fs::read(self.state_path(state)).ok()
    }

    /// Puts the bytes of a state there. Those of one number are always the same.
    pub(crate) fn write_state(&self, state: u64, bytes: &[u8]) -> Result<(), BakeError> {
        put(&self.state_path(state), bytes)
    }

    /// How many states there are.
    pub(crate) fn count_states(&self) -> Result<usize, BakeError> {
        let folder = self.folder.join(STATES);
        Ok(std::fs::read_dir(&folder).map_err(BakeError::io(&folder))?.count())
    }

    /// Removes all states but those in `named`.
    pub(crate) fn keep_states(&self, named: &BTreeSet<u64>) -> Result<(), BakeError> {
        let folder = self.folder.join(STATES);
        let kept: BTreeSet<PathBuf> = named.iter().map(|&state| self.state_path(state)).collect();
        for entry in std::fs::read_dir(&folder).map_err(BakeError::io(&folder))? {
            let path = entry.map_err(BakeError::io(&folder))?.path();
            if !kept.contains(&path) {
                std::fs::remove_file(&path).map_err(BakeError::io(&path))?;
            }
        }
        Ok(())
    }

    fn state_path(&self, state: u64) -> PathBuf {
        self.folder.join(STATES).join(format!("{state:016x}.cells"))
    }

    /// Reads `bytes` of the payload of a file that has been read, or written, before, from `offset` on.
    ///
    /// # Errors
    /// It is no longer there, or shorter.
    pub fn read_part(
        &self,
        kind: Kind,
        at: [i32; 3],
        seen: usize,
        range: std::ops::Range<u64>,
    ) -> Result<Vec<u8>, BakeError> {
        let path = self.path(kind, 0, at);
        let mut part = vec![0; (range.end - range.start) as usize];
        let offset = payload_offset(seen) + range.start;
        File::open(&path)
            .and_then(|file| file.read_exact_at(&mut part, offset))
            .map_err(BakeError::io(&path))?;
        Ok(part)
    }

    fn path(&self, kind: Kind, level: u8, [x, y, z]: [i32; 3]) -> PathBuf {
        self.folder.join(kind.folder()).join(format!("{level}_{x}_{y}_{z}.work"))
    }
}

/// Writes `bytes` to `path`, whole or not at all.
fn put(path: &Path, bytes: &[u8]) -> Result<(), BakeError> {
    static COUNTER: AtomicU32 = AtomicU32::new(0);
    let unique = format!("{}-{}.temp", std::process::id(), COUNTER.fetch_add(1, Ordering::Relaxed));
    let temporary = path.with_extension(unique);
    let written = std::fs::write(&temporary, bytes)
        .and_then(|()| std::fs::rename(&temporary, path))
        .map_err(BakeError::io(path));
    if written.is_err() {
        drop(std::fs::remove_file(&temporary));
    }
    written
}

fn payload_offset(seen: usize) -> u64 {
    (HEAD_BYTES + 16 * seen) as u64
}

fn encode(stamp: &Stamp, payload: &[u8]) -> Vec<u8> {
    let Stamp { key, own, look, state, seen } = stamp;
    let mut bytes = Vec::with_capacity(payload_offset(seen.len()) as usize + payload.len());
    for word in [0, *key, *own, *look, *state, payload.len() as u64, seen.len() as u64] {
        bytes.extend(word.to_le_bytes());
    }
    for &(cell, content) in seen {
        bytes.extend(u64::from(cell).to_le_bytes());
        bytes.extend(content.to_le_bytes());
    }
    bytes.extend(payload);
    let hash = xxh3_64(&bytes[8..]);
    bytes[..8].copy_from_slice(&hash.to_le_bytes());
    bytes
}

fn decode(mut bytes: Vec<u8>) -> Option<(Stamp, Vec<u8>)> {
    let word = |at: usize| Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?));
    if word(0)? != xxh3_64(&bytes[8..]) {
        return None;
    }
    let (key, own, look, state, length) = (word(8)?, word(16)?, word(24)?, word(32)?, word(40)?);
    let count = usize::try_from(word(48)?).ok()?;
    let expected = (count as u64).checked_mul(16)?.checked_add(HEAD_BYTES as u64)?.checked_add(length)?;
    if expected != bytes.len() as u64 {
        return None;
    }
    let entry = |at: usize| Some((u32::try_from(word(at)?).ok()?, word(at + 8)?));
    let seen = (0..count).map(|index| entry(HEAD_BYTES + 16 * index)).collect::<Option<Vec<_>>>()?;
    let payload = bytes.split_off(HEAD_BYTES + 16 * count);
    Some((Stamp { key, own, look, state, seen }, payload))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_come_back_and_damage_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let work = WorkFolder::open(folder.path()).unwrap();
        let stamp = Stamp { key: 1, own: 2, look: 3, state: 8, seen: vec![(4, 5), (6, 7)] };
        let at = [-1, 0, 2];
        work.write(Kind::Rows, 0, at, &stamp, b"payload").unwrap();
        assert_eq!(work.read(Kind::Rows, 0, at), Some((stamp.clone(), b"payload".to_vec())));
        assert_eq!(work.read(Kind::Rows, 1, at), None);
        assert_eq!(work.read_part(Kind::Rows, at, 2, 3..7).unwrap(), b"load");
        assert!(work.read_part(Kind::Rows, at, 2, 3..8).is_err());
        let bytes = encode(&stamp, b"payload");
        for at in 0..bytes.len() {
            let mut flipped = bytes.clone();
            flipped[at] ^= 0x10;
            assert_eq!(decode(flipped), None, "byte {at}");
            assert_eq!(decode(bytes[..at].to_vec()), None, "cut at {at}");
        }
    }
}
