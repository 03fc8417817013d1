//! Where chunks come from: a trait for the loader, and the folder on disk.

use crate::error::TileError;
use crate::format::Frame;
use crate::manifest::{ChunkEntry, Manifest};
use crate::reader::MappedTile;
use earthshine_world::lineage::{Parents, parents_among};
use earthshine_world::{Chunk, ChunkId};
use std::path::{Path, PathBuf};

/// A source of chunks. Loads block; callers have threads for it.
pub trait TileStore: Send + Sync {
    /// Reads, verifies and decodes chunk `id`.
    ///
    /// # Errors
    /// Whatever is wrong with its tile. [`TileError::is_transient`] says whether to try again.
    fn load(&self, id: ChunkId) -> Result<Chunk, TileError>;

    /// The parents of the patches of chunk `id`; `None` if the world has no level above it.
    ///
    /// # Errors
    /// Whatever is wrong with the patches in its tile or its parent's.
    fn parents(&self, id: ChunkId) -> Result<Option<Parents>, TileError>;
}

impl<S: TileStore + ?Sized> TileStore for Box<S> {
    fn load(&self, id: ChunkId) -> Result<Chunk, TileError> {
        (**self).load(id)
    }

    fn parents(&self, id: ChunkId) -> Result<Option<Parents>, TileError> {
        (**self).parents(id)
    }
}

impl<S: TileStore + ?Sized> TileStore for std::sync::Arc<S> {
    fn load(&self, id: ChunkId) -> Result<Chunk, TileError> {
        (**self).load(id)
    }

    fn parents(&self, id: ChunkId) -> Result<Option<Parents>, TileError> {
        (**self).parents(id)
    }
}

/// A world's folder.
#[derive(Debug)]
pub struct DirStore {
    world: PathBuf,
    manifest: Manifest,
}

impl DirStore {
    /// Opens the world in the folder `world`: reads its manifest; tiles are opened as they are asked for.
    ///
    /// # Errors
    /// As [`Manifest::load`].
    pub fn open(world: &Path) -> Result<Self, TileError> {
        Ok(Self { world: world.to_owned(), manifest: Manifest::load(world)? })
    }

    /// What the world holds.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Where the tile of `id` is; `None` if the world has no such chunk.
    #[must_use]
    pub fn path_of(&self, id: ChunkId) -> Option<PathBuf> {
        self.manifest.chunk(id).map(|entry| self.world.join(&entry.file))
    }

    /// Maps the tile of `id` and holds its header against the manifest.
    ///
    /// # Errors
    /// [`TileError::UnknownChunk`], [`TileError::Missing`], [`TileError::Foreign`], or as [`MappedTile::open`].
    pub fn map(&self, id: ChunkId) -> Result<MappedTile, TileError> {
        let entry = self
            .manifest
            .chunk(id)
            .ok_or_else(|| TileError::UnknownChunk { chunk: id, path: self.world.clone() })?;
        let path = self.world.join(&entry.file);
        let tile = MappedTile::open(&path).map_err(|error| match error {
            TileError::Io { source, path, .. } if source.kind() == std::io::ErrorKind::NotFound => {
                TileError::Missing { chunk: id, path }
            }
            other => other,
        })?;
        self.check_belongs(&tile, entry, &path)?;
        Ok(tile)
    }

    fn check_belongs(&self, tile: &MappedTile, entry: &ChunkEntry, path: &Path) -> Result<(), TileError> {
        let header = tile.header();
        let hex = |hash: u64| format!("{hash:016x}");
        let facts = [
            ("world hash", hex(self.manifest.world_hash), hex(header.world_hash)),
            ("chunk", entry.id().to_string(), header.chunk_id().to_string()),
            ("tile hash", hex(entry.tile_hash), hex(header.header_hash)),
            ("length", entry.tile_bytes.to_string(), header.file_bytes.to_string()),
            ("number of patches", entry.patch_count.to_string(), header.patch_count.to_string()),
            ("number of receivers", entry.receiver_count.to_string(), header.receiver_count.to_string()),
            (
                "number of receivers' non-zeros",
                entry.receiver_nonzero_count.to_string(),
                header.receiver_nonzero_count.to_string(),
            ),
            ("number of non-zeros", entry.nonzero_count.to_string(), header.nonzero_count.to_string()),
        ];
        match facts.into_iter().find(|(_, expected, found)| expected != found) {
            None => Ok(()),
            Some((what, expected, found)) => {
                Err(TileError::Foreign { path: path.to_owned(), what, expected, found })
            }
        }
    }
}

/// Every column of a loaded chunk names a patch that the manifest counts.
impl TileStore for DirStore {
    fn load(&self, id: ChunkId) -> Result<Chunk, TileError> {
        self.map(id)?.decode_within(&|id| self.manifest.chunk(id).map(|entry| entry.patch_count))
    }

    fn parents(&self, id: ChunkId) -> Result<Option<Parents>, TileError> {
        if self.manifest.chunk(id).is_none() || self.manifest.chunk(id.parent()).is_none() {
            return Ok(None);
        }
        let fine = self.map(id)?.decode_patches()?;
        let coarse = self.map(id.parent())?.decode_patches()?;
        let orphan = || {
            let path = self.path_of(id).unwrap_or_default();
            let cause = format!("a patch has no parent in chunk {}", id.parent());
            TileError::structure(&path, Frame::Patches)(cause)
        };
        parents_among(&fine, &coarse).map(Some).ok_or_else(orphan)
    }
}
