//! The layout of a tile: drawing, header, section table; names and versions of files.
//!
//! ```text
//! 0    ┌────────────────────────────┐
//!      │ TileHeader           112 B │ magic, version, chunk, world, counts, hash of the table, own hash
//! 112  ├────────────────────────────┤
//!      │ SectionEntry          32 B │ one a frame, in the order of the frames:
//!      │   x section_count          │ kind, group, offset, bytes stored and raw, hash as stored
//!      ├────────────────────────────┤ <- each frame is one zstd frame; no gaps, no padding
//!      │ patches                    │ PatchRecord x patch_count, byte planes
//!      │ points                     │ step, origin; 3 x u16 position, 2 x u16 normal, byte planes
//!      │ segments                   │ SegmentRecord x segment_count: the chunks that columns point into
//!      │ rows 0                     │ 32 rows: own segment list, sky, absorbed, column gaps, shares
//!      │ ...                        │ ceil(patch_count / 32) groups in all
//!      │ receivers                  │ ReceiverRecord x receiver_count, byte planes: rows without columns; in version 5
//!      │                            │ LayeredRecord, in version 4 UnlayeredRecord
//!      │ receivers' segments        │ SegmentRecord x receiver_segment_count
//!      │ receivers' rows 0          │ as rows, one row a receiver
//!      │ ...                        │ ceil(receiver_count / 32) groups in all
//!      │ occluders                  │ vertices, triangles, surfaces, byte planes
//! file_bytes ───────────────────────┘ nothing follows
//! ```
//!
//! All numbers are little-endian. Every byte is under a hash: the header's own, the table's (in the
//! header) or a frame's (in the table). The header's hash therefore names the whole tile; it is in the
//! file's name and in the manifest.

use crate::{checksum, error::TileError, limits};
use bytemuck::{Pod, Zeroable};
use earthshine_world::{ChunkCoord, ChunkId};
use std::path::Path;

/// Version of the tile format and of `world.toml`, as written. Any change of a layout is a new number.
pub const VERSION: u32 = 6;
/// The oldest version that is read: its receivers have no layers. Those of version 5 have no barriers.
pub const VERSION_OLDEST: u32 = 4;
/// Which versions are read.
pub(crate) const VERSIONS: std::ops::RangeInclusive<u32> = VERSION_OLDEST..=VERSION;
/// First bytes of a tile. The last two find files that were copied as text.
pub const MAGIC: [u8; 8] = *b"EARTHS\r\n";
/// Sections besides row groups: patches, points, segments, receivers and their segments, occluders.
pub(crate) const SECTIONS_FIXED: u32 = 6;

const _: () = assert!(cfg!(target_endian = "little"), "tiles are read as they lie in memory");
const _: () = assert!(size_of::<TileHeader>() == 112, "the header is 112 bytes on disk");
const _: () = assert!(size_of::<SectionEntry>() == 32, "a section entry is 32 bytes on disk");

/// First 112 bytes of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct TileHeader {
    /// [`MAGIC`].
    pub magic: [u8; 8],
    /// [`VERSION_OLDEST`] to [`VERSION`].
    pub version: u32,
    /// The number of a [`RowCodec`](crate::RowCodec).
    pub row_codec: u32,
    /// Hash of bake parameters.
    pub world_hash: u64,
    /// Length of the whole file.
    pub file_bytes: u64,
    /// Where the chunk is, in chunk edges of its level.
    pub coord: [i32; 3],
    /// Level of the chunk, 0 to [`limits::LEVEL_MAX`].
    pub level: u32,
    /// Patches, and rows.
    pub patch_count: u32,
    /// Sample points.
    pub point_count: u32,
    /// Form factors in all rows.
    pub nonzero_count: u64,
    /// Chunks that columns point into.
    pub segment_count: u32,
    /// Entries of the section table.
    pub section_count: u32,
    /// Corners of the occluders.
    pub vertex_count: u32,
    /// Triangles of the occluders.
    pub triangle_count: u32,
    /// Receivers, and rows of them.
    pub receiver_count: u32,
    /// Chunks that the columns of receivers point into.
    pub receiver_segment_count: u32,
    /// Form factors in all rows of receivers.
    pub receiver_nonzero_count: u64,
    /// Hash of the section table.
    pub table_hash: u64,
    /// Hash of all header bytes before this one; names the tile.
    pub header_hash: u64,
}

/// One frame of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct SectionEntry {
    /// Number of its [`Frame`].
    pub kind: u32,
    /// Which row group; 0 for the others.
    pub group: u32,
    /// Where it begins in the file.
    pub offset: u64,
    /// Compressed length.
    pub stored_bytes: u32,
    /// Decompressed length.
    pub raw_bytes: u32,
    /// Hash of its compressed bytes.
    pub hash: u64,
}

/// Row groups of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct GroupCounts {
    /// Of patches' rows.
    pub(crate) patches: u32,
    /// Of receivers' rows.
    pub(crate) receivers: u32,
}

impl GroupCounts {
    /// Groups for so many patches and receivers.
    pub(crate) fn of(patch_count: u32, receiver_count: u32) -> Self {
        let groups = |rows: u32| rows.div_ceil(limits::ROWS_PER_GROUP);
        Self { patches: groups(patch_count), receivers: groups(receiver_count) }
    }

    fn total(self) -> u32 {
        self.patches + self.receivers
    }
}

/// A part of a tile, as messages name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Frame {
    /// The first 112 bytes.
    Header,
    /// The section table.
    Table,
    /// Patches.
    Patches,
    /// Sample points.
    Points,
    /// Chunks that columns point into.
    Segments,
    /// Rows `32 * n ..`.
    Rows(u32),
    /// Places of receivers.
    Receivers,
    /// Chunks that the columns of receivers point into.
    ReceiverSegments,
    /// Rows `32 * n ..` of receivers.
    ReceiverRows(u32),
    /// Shadow casters.
    Occluders,
}

impl std::fmt::Display for Frame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Header => f.write_str("header"),
            Self::Table => f.write_str("section table"),
            Self::Patches => f.write_str("frame of patches"),
            Self::Points => f.write_str("frame of sample points"),
            Self::Segments => f.write_str("frame of segments"),
            Self::Rows(group) => write!(f, "frame of row group {group}"),
            Self::Receivers => f.write_str("frame of receivers"),
            Self::ReceiverSegments => f.write_str("frame of receivers' segments"),
            Self::ReceiverRows(group) => write!(f, "frame of receivers' row group {group}"),
            Self::Occluders => f.write_str("frame of occluders"),
        }
    }
}

impl Frame {
    /// `kind` and `group` of its table entry; header and table have none and get zero.
    pub(crate) fn numbers(self) -> (u32, u32) {
        match self {
            Self::Header | Self::Table => (0, 0),
            Self::Patches => (1, 0),
            Self::Points => (2, 0),
            Self::Segments => (3, 0),
            Self::Rows(group) => (4, group),
            Self::Occluders => (5, 0),
            Self::Receivers => (6, 0),
            Self::ReceiverSegments => (7, 0),
            Self::ReceiverRows(group) => (8, group),
        }
    }

    /// Its place in the section table of a tile with `groups` row groups.
    pub(crate) fn place(self, groups: GroupCounts) -> Option<usize> {
        let after_rows = 3 + groups.patches as usize;
        match self {
            Self::Header | Self::Table => None,
            Self::Patches => Some(0),
            Self::Points => Some(1),
            Self::Segments => Some(2),
            Self::Rows(group) => (group < groups.patches).then_some(3 + group as usize),
            Self::Receivers => Some(after_rows),
            Self::ReceiverSegments => Some(after_rows + 1),
            Self::ReceiverRows(group) => {
                (group < groups.receivers).then_some(after_rows + 2 + group as usize)
            }
            Self::Occluders => Some(after_rows + 2 + groups.receivers as usize),
        }
    }

    /// The frames of a tile with `groups` row groups, in file order.
    pub(crate) fn in_order(groups: GroupCounts) -> impl Iterator<Item = Self> {
        [Self::Patches, Self::Points, Self::Segments]
            .into_iter()
            .chain((0..groups.patches).map(Self::Rows))
            .chain([Self::Receivers, Self::ReceiverSegments])
            .chain((0..groups.receivers).map(Self::ReceiverRows))
            .chain([Self::Occluders])
    }
}

impl TileHeader {
    /// The chunk whose tile this is.
    #[must_use]
    pub fn chunk_id(&self) -> ChunkId {
        ChunkId::new(self.level as u8, ChunkCoord::from_array(self.coord))
    }

    /// Row groups of the tile.
    pub(crate) fn groups(&self) -> GroupCounts {
        GroupCounts::of(self.patch_count, self.receiver_count)
    }

    /// The hash that `header_hash` must be.
    pub(crate) fn own_hash(&self) -> u64 {
        let bytes = bytemuck::bytes_of(self);
        checksum::hash(&bytes[..bytes.len() - size_of::<u64>()])
    }

    /// Where the frames begin.
    pub(crate) fn frames_offset(&self) -> u64 {
        size_of::<Self>() as u64 + u64::from(self.section_count) * size_of::<SectionEntry>() as u64
    }

    /// Reads and checks the header of a tile of `bytes` bytes in all: identity, hash, limits, length.
    pub(crate) fn parse(bytes: &[u8], path: &Path) -> Result<Self, TileError> {
        let truncated = |expected: u64| TileError::Truncated {
            path: path.to_owned(),
            frame: Frame::Header,
            expected,
            found: bytes.len() as u64,
        };
        let magic_length = bytes.len().min(MAGIC.len());
        if bytes[..magic_length] != MAGIC[..magic_length] {
            return Err(TileError::Magic { path: path.to_owned() });
        }
        let Some(first) = bytes.get(..size_of::<Self>()) else {
            return Err(truncated(size_of::<Self>() as u64));
        };
        let header: Self = bytemuck::pod_read_unaligned(first);
        if !VERSIONS.contains(&header.version) {
            return Err(TileError::Version { path: path.to_owned(), found: header.version });
        }
        let found = header.own_hash();
        if found != header.header_hash {
            let expected = header.header_hash;
            return Err(TileError::Checksum { path: path.to_owned(), frame: Frame::Header, expected, found });
        }
        header.check_limits(path)?;
        if header.file_bytes > bytes.len() as u64 {
            return Err(TileError::Truncated {
                path: path.to_owned(),
                frame: header.frame_at(bytes),
                expected: header.file_bytes,
                found: bytes.len() as u64,
            });
        }
        let structure = TileError::structure(path, Frame::Header);
        if header.file_bytes < bytes.len() as u64 {
            let surplus = bytes.len() as u64 - header.file_bytes;
            return Err(structure(format!("{surplus} bytes follow the end of the tile")));
        }
        if header.section_count != SECTIONS_FIXED + header.groups().total() {
            return Err(structure(format!(
                "{} sections for {} patches and {} receivers",
                header.section_count, header.patch_count, header.receiver_count
            )));
        }
        if header.frames_offset() > header.file_bytes {
            return Err(structure("the section table is longer than the file".to_owned()));
        }
        Ok(header)
    }

    /// The first frame that the end of `bytes` cuts off, as far as the table can be believed.
    fn frame_at(&self, bytes: &[u8]) -> Frame {
        let Some(table) = bytes.get(size_of::<Self>()..self.frames_offset() as usize) else {
            return Frame::Table;
        };
        Frame::in_order(self.groups())
            .zip(table.chunks_exact(size_of::<SectionEntry>()))
            .find(|(_, entry)| {
                let entry: SectionEntry = bytemuck::pod_read_unaligned(entry);
                entry.offset.saturating_add(u64::from(entry.stored_bytes)) > bytes.len() as u64
            })
            .map_or(Frame::Occluders, |(frame, _)| frame)
    }

    pub(crate) fn check_limits(&self, path: &Path) -> Result<(), TileError> {
        let bounded = [
            ("levels", u64::from(self.level), u64::from(limits::LEVEL_MAX)),
            ("patches", u64::from(self.patch_count), u64::from(limits::PATCHES_MAX)),
            ("sample points", u64::from(self.point_count), u64::from(limits::POINTS_MAX)),
            ("non-zeros", self.nonzero_count, limits::NONZEROS_MAX),
            ("segments", u64::from(self.segment_count), u64::from(limits::SEGMENTS_MAX)),
            ("receivers", u64::from(self.receiver_count), u64::from(limits::RECEIVERS_MAX)),
            ("receivers' non-zeros", self.receiver_nonzero_count, limits::NONZEROS_MAX),
            ("receivers' segments", u64::from(self.receiver_segment_count), u64::from(limits::SEGMENTS_MAX)),
            ("vertices", u64::from(self.vertex_count), u64::from(limits::VERTICES_MAX)),
            ("triangles", u64::from(self.triangle_count), u64::from(limits::TRIANGLES_MAX)),
            ("bytes", self.file_bytes, limits::TILE_BYTES_MAX),
        ];
        match bounded.into_iter().find(|(_, value, limit)| value > limit) {
            None => Ok(()),
            Some((what, value, limit)) => {
                Err(TileError::Limit { path: path.to_owned(), frame: Frame::Header, what, value, limit })
            }
        }
    }
}

/// The hash that names the tile `bytes`, as the header holds it: it changes with every byte of the file.
#[must_use]
pub fn tile_hash(bytes: &[u8]) -> u64 {
    let covered = size_of::<TileHeader>() - size_of::<u64>();
    checksum::hash(&bytes[..bytes.len().min(covered)])
}

/// Where in its world the tile with hash `tile_hash` of chunk `id` lies: `tiles/L0/x_y_z.<hash>.tile`.
#[must_use]
pub fn tile_file_name(id: ChunkId, tile_hash: u64) -> String {
    let [x, y, z] = id.coord.to_array();
    format!("tiles/L{}/{x}_{y}_{z}.{tile_hash:016x}.tile", id.level)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_is_at_its_place() {
        for (patches, receivers) in [(0, 0), (1, 0), (0, 2), (5, 3)] {
            let groups = GroupCounts { patches, receivers };
            for (place, frame) in Frame::in_order(groups).enumerate() {
                assert_eq!(frame.place(groups), Some(place), "{frame}");
            }
            assert_eq!(Frame::in_order(groups).count() as u32, SECTIONS_FIXED + groups.total());
            assert_eq!(Frame::Rows(patches).place(groups), None);
            assert_eq!(Frame::ReceiverRows(receivers).place(groups), None);
        }
    }

    #[test]
    fn names_hold_chunk_and_hash() {
        let id = ChunkId::new(2, ChunkCoord::new(-1, 0, 17));
        assert_eq!(tile_file_name(id, 0xABC), "tiles/L2/-1_0_17.0000000000000abc.tile");
    }
}
