//! `world.toml`: what a world's folder holds, for people and programs.
//!
//! Written last, so that a folder with a manifest is a whole world. Tiles that it does not list are
//! leftovers of older bakes and nobody's concern.

use crate::error::TileError;
use crate::format::{VERSION, VERSIONS};
use crate::{limits, parameters::BakeParameters, writer};
use earthshine_world::{Bounds, ChunkCoord, ChunkId, ChunkSummary, LightRig, WorldIndex};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path};

/// The contents of `world.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`VERSION`].
    pub format_version: u32,
    /// Hash of the bake parameters; in every tile's header too. A server takes a new manifest for another state of
    /// its world if this one has not changed.
    #[serde(with = "hex")]
    pub world_hash: u64,
    /// Hash of scene and parameters: which state of the world this is.
    #[serde(with = "hex")]
    pub content_hash: u64,
    /// Name of the scene, for people.
    pub scene: String,
    /// What the bake was asked for.
    pub parameters: BakeParameters,
    /// Box around all geometry, m.
    pub bounds: Bounds,
    /// The lights that came with the scene.
    pub lights: LightRig,
    /// Every chunk that has a tile, ascending by level and coordinates.
    #[serde(default)]
    pub chunks: Vec<ChunkEntry>,
}

/// One chunk of a world.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChunkEntry {
    /// 0 is the finest.
    pub level: u8,
    /// Where, in chunk edges of the level.
    pub coord: [i32; 3],
    /// Its tile, relative to the world's folder; see [`crate::tile_file_name`].
    pub file: String,
    /// Length of the tile.
    pub tile_bytes: u64,
    /// [`crate::tile_hash`] of the tile.
    #[serde(with = "hex")]
    pub tile_hash: u64,
    /// Hash of everything that its bake depended on; a bake that finds the same one leaves the tile.
    #[serde(with = "hex")]
    pub input_hash: u64,
    /// Patches in it.
    pub patch_count: u32,
    /// Form factors in it.
    pub nonzero_count: u64,
    /// Receivers in it.
    pub receiver_count: u32,
    /// Form factors of its receivers.
    pub receiver_nonzero_count: u64,
}

impl ChunkEntry {
    /// Which chunk.
    #[must_use]
    pub fn id(&self) -> ChunkId {
        ChunkId::new(self.level, ChunkCoord::from_array(self.coord))
    }
}

impl Manifest {
    /// Its name in the world's folder.
    pub const FILE_NAME: &'static str = "world.toml";

    /// Reads and checks the manifest of the world in the folder `world`.
    ///
    /// # Errors
    /// [`TileError::NotAWorld`] without a manifest, [`TileError::Version`] for another version's,
    /// [`TileError::Manifest`] for one that cannot be, [`TileError::Limit`] for a huge one.
    pub fn load(world: &Path) -> Result<Self, TileError> {
        let path = world.join(Self::FILE_NAME);
        let text = read_bounded(world, &path)?;
        let broken = |cause: String| TileError::Manifest { path: path.clone(), cause };
        // The version first: a newer manifest may have keys that this program does not know.
        let found = Version::of(&text).map_err(broken)?;
        if !VERSIONS.contains(&found) {
            return Err(TileError::Version { path, found });
        }
        let manifest: Self = toml::from_str(&text).map_err(|error| broken(error.to_string()))?;
        match manifest.fault() {
            None => Ok(manifest),
            Some(cause) => Err(broken(cause)),
        }
    }

    /// Checks and writes the manifest into the folder `world`, atomically.
    ///
    /// # Errors
    /// [`TileError::Manifest`] for one that [`Self::load`] would refuse, [`TileError::Io`].
    pub fn save(&self, world: &Path) -> Result<(), TileError> {
        let path = world.join(Self::FILE_NAME);
        let broken = |cause: String| TileError::Manifest { path: path.clone(), cause };
        if self.format_version != VERSION {
            return Err(TileError::Version { path, found: self.format_version });
        }
        if let Some(cause) = self.fault() {
            return Err(broken(cause));
        }
        let text = toml::to_string(self).map_err(|error| broken(error.to_string()))?;
        writer::write_atomic(&path, text.as_bytes())
    }

    /// What planning needs of it.
    #[must_use]
    pub fn index(&self) -> WorldIndex {
        let summary = |entry: &ChunkEntry| ChunkSummary {
            id: entry.id(),
            patch_count: entry.patch_count,
            nonzero_count: entry.nonzero_count.saturating_add(entry.receiver_nonzero_count),
            tile_bytes: entry.tile_bytes,
        };
        WorldIndex {
            detail: self.parameters.detail,
            grid: self.parameters.grid,
            bounds: self.bounds,
            chunks: self.chunks.iter().map(summary).collect(),
            lights: self.lights.clone(),
        }
    }

    /// The entry of chunk `id`.
    #[must_use]
    pub fn chunk(&self, id: ChunkId) -> Option<&ChunkEntry> {
        self.chunks.binary_search_by_key(&id, ChunkEntry::id).ok().map(|index| &self.chunks[index])
    }

    fn fault(&self) -> Option<String> {
        if let Some(cause) = self.parameters.fault() {
            return Some(cause.to_owned());
        }
        if let Err(error) = self.lights.validate() {
            return Some(format!("lights: {error}"));
        }
        let Bounds { min, max } = self.bounds;
        let empty = self.bounds == Bounds::EMPTY && self.chunks.is_empty();
        let finite = min.is_finite() && max.is_finite();
        if !(empty || finite && min.cmple(max).all()) {
            return Some("bounds: the box is empty or not finite".to_owned());
        }
        if let Some(pair) = self.chunks.windows(2).find(|pair| pair[0].id() >= pair[1].id()) {
            return Some(format!("chunks: {} comes after {}", pair[1].id(), pair[0].id()));
        }
        self.chunks.iter().find_map(|entry| Some(format!("chunk {}: {}", entry.id(), entry.fault()?)))
    }
}

impl ChunkEntry {
    fn fault(&self) -> Option<String> {
        if self.level > limits::LEVEL_MAX {
            Some(format!("its level is above {}", limits::LEVEL_MAX))
        } else if self.patch_count > limits::PATCHES_MAX {
            Some(format!("it has more than {} patches", limits::PATCHES_MAX))
        } else if self.receiver_count > limits::RECEIVERS_MAX {
            Some(format!("it has more than {} receivers", limits::RECEIVERS_MAX))
        } else if self.nonzero_count.max(self.receiver_nonzero_count) > limits::NONZEROS_MAX
            || self.tile_bytes > limits::TILE_BYTES_MAX
        {
            Some("it is larger than a tile can be".to_owned())
        } else if !stays_inside(&self.file) {
            Some(format!("the file name {:?} leads out of the world's folder", self.file))
        } else {
            None
        }
    }
}

/// Whether `name` is a plain relative path, on any system.
fn stays_inside(name: &str) -> bool {
    let plain = |component| matches!(component, Component::Normal(_));
    !name.is_empty() && !name.contains(['\\', ':', '\0']) && Path::new(name).components().all(plain)
}

fn read_bounded(world: &Path, path: &Path) -> Result<String, TileError> {
    use std::io::ErrorKind;
    let file = File::open(path).map_err(|error| match error.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => TileError::NotAWorld { path: world.to_owned() },
        _ => TileError::io("open", path)(error),
    })?;
    let limit = limits::MANIFEST_BYTES_MAX;
    let mut bytes = Vec::new();
    file.take(limit + 1).read_to_end(&mut bytes).map_err(TileError::io("read", path))?;
    if bytes.len() as u64 > limit {
        let cause = format!("it is longer than {limit} bytes");
        return Err(TileError::Manifest { path: path.to_owned(), cause });
    }
    String::from_utf8(bytes)
        .map_err(|error| TileError::Manifest { path: path.to_owned(), cause: error.to_string() })
}

/// The one key that all versions share.
#[derive(Deserialize)]
struct Version {
    format_version: u32,
}

impl Version {
    fn of(text: &str) -> Result<u32, String> {
        toml::from_str::<Self>(text).map(|version| version.format_version).map_err(|error| error.to_string())
    }
}

/// 64-bit hashes as text: TOML's integers are signed.
mod hex {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's `with` hands out references")]
    pub(super) fn serialize<S: Serializer>(hash: &u64, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&format!("{hash:016x}"))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
        let text = String::deserialize(deserializer)?;
        let digits = text.len() == 16 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        let hash = if digits { u64::from_str_radix(&text, 16).ok() } else { None };
        hash.ok_or_else(|| D::Error::custom(format!("{text:?} is not 16 hexadecimal digits")))
    }
}
