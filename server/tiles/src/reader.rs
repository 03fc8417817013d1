//! Bytes to chunks: every length, hash and limit is checked before what it guards is touched.

use crate::checksum;
use crate::codec::zstd_frame::Unpacker;
use crate::codec::{Decoded, RowCodec, occluders, patches, points, receivers, row_decode::RowSink, segments};
use crate::error::TileError;
use crate::format::{Frame, SectionEntry, TileHeader};
use crate::{limits, structure};
use earthshine_world::{Chunk, ChunkId, ChunkRows, OccluderMesh, Patch, Receivers, SamplePoint};
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Decodes the tile `bytes`; `path_for_messages` is named in errors and not touched.
///
/// # Errors
/// Whatever is wrong with them; any change of any byte and any other length is an error.
pub fn decode_bytes(bytes: &[u8], path_for_messages: &Path) -> Result<Chunk, TileError> {
    let layout = Layout::parse(bytes, path_for_messages)?;
    View { bytes, path: path_for_messages, layout: &layout }.decode(None)
}

/// Verifies and decodes all rows of the tile `bytes`, and nothing else: what the bench measures.
pub(crate) fn decode_rows_of_bytes(bytes: &[u8], path: &Path) -> Result<ChunkRows, TileError> {
    let layout = Layout::parse(bytes, path)?;
    View { bytes, path, layout: &layout }.rows(RowsOf::Patches, 0..u32::MAX, None, &mut Unpacker::new())
}

/// How many patches a chunk has; `None` if there is no such chunk.
pub(crate) type PatchCounts<'a> = &'a dyn Fn(ChunkId) -> Option<u32>;

/// A tile's file, mapped read-only. Its header and section table have been verified.
#[derive(Debug)]
pub struct MappedTile {
    map: memmap2::Mmap,
    file: File,
    path: PathBuf,
    layout: Layout,
}

impl MappedTile {
    /// Maps the tile at `path` and verifies header and section table.
    ///
    /// # Errors
    /// [`TileError::Io`] if it cannot be opened; otherwise what is wrong with header or table.
    pub fn open(path: &Path) -> Result<Self, TileError> {
        let file = File::open(path).map_err(TileError::io("open", path))?;
        let length = file.metadata().map_err(TileError::io("read", path))?.len();
        if length < size_of::<TileHeader>() as u64 {
            let expected = size_of::<TileHeader>() as u64;
            return Err(TileError::Truncated {
                path: path.into(),
                frame: Frame::Header,
                expected,
                found: length,
            });
        }
        if length > limits::TILE_BYTES_MAX {
            let (value, limit) = (length, limits::TILE_BYTES_MAX);
            return Err(TileError::Limit {
                path: path.into(),
                frame: Frame::Header,
                what: "bytes",
                value,
                limit,
            });
        }
        // SAFETY: tiles are immutable by protocol: written elsewhere, synced, renamed, never opened for
        // writing again, so the bytes do not change under the map. Whoever breaks that by changing a byte
        // meets the checksums; by cutting the file, the length checks here and before each decoding.
        let map = unsafe { memmap2::MmapOptions::new().len(length as usize).map(&file) }
            .map_err(TileError::io("map", path))?;
        read_no_more_than_asked(&map);
        let layout = Layout::parse(&map, path)?;
        Ok(Self { map, file, path: path.to_owned(), layout })
    }

    /// The verified header.
    #[must_use]
    pub fn header(&self) -> &TileHeader {
        &self.layout.header
    }

    /// The verified section table, in file order: sizes of the parts.
    pub fn sections(&self) -> impl ExactSizeIterator<Item = (Frame, &SectionEntry)> {
        self.layout.frames().zip(&self.layout.sections).collect::<Vec<_>>().into_iter()
    }

    /// Verifies and decodes everything.
    ///
    /// # Errors
    /// The first frame that is damaged or malformed.
    pub fn decode(&self) -> Result<Chunk, TileError> {
        read_ahead(&self.map, 0..self.map.len());
        self.view()?.decode(None)
    }

    /// [`Self::decode`], with columns held against the patch counts of their chunks.
    pub(crate) fn decode_within(&self, patch_counts: PatchCounts<'_>) -> Result<Chunk, TileError> {
        read_ahead(&self.map, 0..self.map.len());
        self.view()?.decode(Some(patch_counts))
    }

    /// Verifies and decodes the patches only.
    ///
    /// # Errors
    /// If their frame is damaged or malformed.
    pub fn decode_patches(&self) -> Result<Vec<Patch>, TileError> {
        if let Some((_, section)) = self.sections().find(|(frame, _)| *frame == Frame::Patches) {
            let start = section.offset as usize;
            read_ahead(&self.map, start..start + section.stored_bytes as usize);
        }
        self.view()?.patches(&mut Unpacker::new())
    }

    /// Verifies and decodes the sample points only.
    ///
    /// # Errors
    /// If their frame is damaged or malformed.
    pub fn decode_points(&self) -> Result<Vec<SamplePoint>, TileError> {
        self.view()?.points(&mut Unpacker::new())
    }

    /// Verifies and decodes the rows of the row groups `groups`, clamped to what the tile has. Group `g`
    /// holds the patches from `32 g` on; the result's rows count from the first of them.
    ///
    /// # Errors
    /// If one of their frames is damaged or malformed.
    pub fn decode_rows(&self, groups: Range<u32>) -> Result<ChunkRows, TileError> {
        self.view()?.rows(RowsOf::Patches, groups, None, &mut Unpacker::new())
    }

    /// Verifies and decodes the receivers only.
    ///
    /// # Errors
    /// If one of their frames is damaged or malformed.
    pub fn decode_receivers(&self) -> Result<Receivers, TileError> {
        self.view()?.receivers(None, &mut Unpacker::new())
    }

    /// Verifies and decodes the occluders only.
    ///
    /// # Errors
    /// If their frame is damaged or malformed.
    pub fn decode_occluders(&self) -> Result<OccluderMesh, TileError> {
        self.view()?.occluders(&mut Unpacker::new())
    }

    /// The bytes, once the file is known to be as long as it was: touching a map beyond the file's end kills.
    fn view(&self) -> Result<View<'_>, TileError> {
        let found = self.file.metadata().map_err(TileError::io("read", &self.path))?.len();
        let expected = self.layout.header.file_bytes;
        if found < expected {
            return Err(TileError::Truncated {
                path: self.path.clone(),
                frame: Frame::Occluders,
                expected,
                found,
            });
        }
        Ok(View { bytes: &self.map, path: &self.path, layout: &self.layout })
    }
}

/// Has the system fetch the pages that are touched and none around them: who wants the parents of far patches reads a little of
/// many tiles. A hint: where it is refused more is read, and nothing else differs.
fn read_no_more_than_asked(map: &memmap2::Mmap) {
    #[cfg(unix)]
    drop(map.advise(memmap2::Advice::Random));
    #[cfg(not(unix))]
    let _ = map;
}

/// Has the system fetch `range` at once instead of page by page. A hint.
fn read_ahead(map: &memmap2::Mmap, range: Range<usize>) {
    #[cfg(unix)]
    drop(map.advise_range(memmap2::Advice::WillNeed, range.start, range.len()));
    #[cfg(not(unix))]
    let _ = (map, range);
}

/// A tile's verified header and section table.
#[derive(Debug)]
pub(crate) struct Layout {
    pub(crate) header: TileHeader,
    pub(crate) sections: Vec<SectionEntry>,
    codec: RowCodec,
}

impl Layout {
    pub(crate) fn parse(bytes: &[u8], path: &Path) -> Result<Self, TileError> {
        let header = TileHeader::parse(bytes, path)?;
        // The header's check put the table inside the file.
        let table = &bytes[size_of::<TileHeader>()..header.frames_offset() as usize];
        let (found, expected) = (checksum::hash(table), header.table_hash);
        if found != expected {
            return Err(TileError::Checksum { path: path.into(), frame: Frame::Table, expected, found });
        }
        let sections =
            table.chunks_exact(size_of::<SectionEntry>()).map(bytemuck::pod_read_unaligned).collect();
        let codec = RowCodec::from_number(header.row_codec)
            .ok_or_else(|| format!("there is no row codec {}", header.row_codec))
            .map_err(TileError::structure(path, Frame::Header))?;
        let layout = Self { header, sections, codec };
        layout.check_table().map_err(TileError::structure(path, Frame::Table))?;
        Ok(layout)
    }

    pub(crate) fn frames(&self) -> impl Iterator<Item = Frame> + use<> {
        Frame::in_order(self.header.groups())
    }

    /// Kinds in order, frames end to end up to the end of the file, sizes as the counts demand.
    fn check_table(&self) -> Decoded<()> {
        let header = &self.header;
        let mut offset = header.frames_offset();
        let (mut row_bytes, mut receiver_row_bytes) = (0u64, 0u64);
        for (frame, entry) in self.frames().zip(&self.sections) {
            if (entry.kind, entry.group) != frame.numbers() || entry.offset != offset {
                return Err(format!("the {frame} is not where it should be"));
            }
            offset += u64::from(entry.stored_bytes);
            let raw_bytes = u64::from(entry.raw_bytes);
            let fits = match frame {
                Frame::Header | Frame::Table => false,
                Frame::Patches => raw_bytes == u64::from(header.patch_count) * 64,
                Frame::Points => raw_bytes == points::HEAD_BYTES as u64 + u64::from(header.point_count) * 10,
                Frame::Segments => raw_bytes == u64::from(header.segment_count) * 16,
                Frame::Rows(_) => {
                    row_bytes += raw_bytes;
                    raw_bytes <= limits::GROUP_RAW_BYTES_MAX
                }
                Frame::Receivers => {
                    raw_bytes == u64::from(header.receiver_count) * receivers::record_bytes(header.version)
                }
                Frame::ReceiverSegments => raw_bytes == u64::from(header.receiver_segment_count) * 16,
                Frame::ReceiverRows(_) => {
                    receiver_row_bytes += raw_bytes;
                    raw_bytes <= limits::GROUP_RAW_BYTES_MAX
                }
                Frame::Occluders => {
                    raw_bytes == occluders::raw_bytes(header.vertex_count, header.triangle_count)
                }
            };
            if !fits {
                return Err(format!("{raw_bytes} bytes for the {frame}"));
            }
        }
        if offset != header.file_bytes {
            return Err(format!("the frames end at {offset} of {} bytes", header.file_bytes));
        }
        let least = 1 + self.codec.share_bytes() as u64;
        let counted =
            [(header.nonzero_count, row_bytes), (header.receiver_nonzero_count, receiver_row_bytes)];
        match counted.into_iter().find(|&(nonzeros, bytes)| bytes < nonzeros * least) {
            Some((nonzeros, bytes)) => Err(format!("{nonzeros} non-zeros in {bytes} bytes")),
            None => Ok(()),
        }
    }
}

/// Which of a tile's two sets of rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RowsOf {
    Patches,
    Receivers,
}

impl RowsOf {
    /// Rows, form factors and groups.
    fn counts(self, header: &TileHeader) -> (u32, u64, u32) {
        let groups = header.groups();
        match self {
            Self::Patches => (header.patch_count, header.nonzero_count, groups.patches),
            Self::Receivers => (header.receiver_count, header.receiver_nonzero_count, groups.receivers),
        }
    }

    fn segments(self) -> Frame {
        match self {
            Self::Patches => Frame::Segments,
            Self::Receivers => Frame::ReceiverSegments,
        }
    }

    fn group(self, group: u32) -> Frame {
        match self {
            Self::Patches => Frame::Rows(group),
            Self::Receivers => Frame::ReceiverRows(group),
        }
    }

    /// Undoes [`Self::group`].
    fn group_of(self, frame: Frame) -> Option<u32> {
        match (self, frame) {
            (Self::Patches, Frame::Rows(group)) | (Self::Receivers, Frame::ReceiverRows(group)) => {
                Some(group)
            }
            _ => None,
        }
    }
}

/// A whole tile in memory, its layout verified.
pub(crate) struct View<'a> {
    pub(crate) bytes: &'a [u8],
    pub(crate) path: &'a Path,
    pub(crate) layout: &'a Layout,
}

impl View<'_> {
    fn decode(&self, patch_counts: Option<PatchCounts<'_>>) -> Result<Chunk, TileError> {
        let unpacker = &mut Unpacker::new();
        let chunk = Chunk {
            id: self.layout.header.chunk_id(),
            patches: self.patches(unpacker)?,
            points: self.points(unpacker)?,
            rows: self.rows(RowsOf::Patches, 0..u32::MAX, patch_counts, unpacker)?,
            receivers: self.receivers(patch_counts, unpacker)?,
            occluders: self.occluders(unpacker)?,
        };
        structure::check_apart(&chunk.patches, &chunk.receivers.places)
            .map_err(TileError::structure(self.path, Frame::Receivers))?;
        Ok(chunk)
    }

    fn patches(&self, unpacker: &mut Unpacker) -> Result<Vec<Patch>, TileError> {
        self.frame(Frame::Patches, unpacker, |raw| {
            let patches = patches::decode(raw)?;
            structure::check_patches(&patches, self.layout.header.point_count as usize)?;
            Ok(patches)
        })
    }

    fn points(&self, unpacker: &mut Unpacker) -> Result<Vec<SamplePoint>, TileError> {
        self.frame(Frame::Points, unpacker, points::decode)
    }

    fn occluders(&self, unpacker: &mut Unpacker) -> Result<OccluderMesh, TileError> {
        let header = &self.layout.header;
        let decode = |raw: &[u8]| occluders::decode(raw, header.vertex_count, header.triangle_count);
        self.frame(Frame::Occluders, unpacker, decode)
    }

    fn receivers(
        &self,
        patch_counts: Option<PatchCounts<'_>>,
        unpacker: &mut Unpacker,
    ) -> Result<Receivers, TileError> {
        Ok(Receivers {
            places: self.frame(Frame::Receivers, unpacker, |raw| {
                receivers::decode(raw, self.layout.header.version)
            })?,
            rows: self.rows(RowsOf::Receivers, 0..u32::MAX, patch_counts, unpacker)?,
        })
    }

    fn rows(
        &self,
        of: RowsOf,
        groups: Range<u32>,
        patch_counts: Option<PatchCounts<'_>>,
        unpacker: &mut Unpacker,
    ) -> Result<ChunkRows, TileError> {
        let header = &self.layout.header;
        let (row_total, nonzeros, group_total) = of.counts(header);
        let groups = groups.start.min(group_total)..groups.end.min(group_total);
        let whole = groups == (0..group_total);
        let segments = self.frame(of.segments(), unpacker, segments::decode)?;
        let own = header.chunk_id();
        let counts = segments.iter().map(|&id| match patch_counts {
            _ if id == own => Ok(header.patch_count),
            Some(counts) => {
                counts(id).ok_or_else(|| format!("columns point into chunk {id}, which the world lacks"))
            }
            None => Ok(limits::PATCHES_MAX),
        });
        let counts = counts.collect::<Decoded<Vec<u32>>>();
        let counts = counts.map_err(TileError::structure(self.path, of.segments()))?;

        let rows_before = |group: u32| (group * limits::ROWS_PER_GROUP).min(row_total);
        let row_count = (rows_before(groups.end) - rows_before(groups.start.min(groups.end))) as usize;
        let nonzero_limit = if whole { nonzeros } else { self.nonzeros_at_most(of, groups.clone()) };
        let mut sink = RowSink::new(segments, counts, row_count, nonzero_limit as usize);
        for group in groups {
            let rows = rows_before(group + 1) - rows_before(group);
            self.frame(of.group(group), unpacker, |raw| sink.push_group(raw, self.layout.codec, rows))?;
        }
        if whole {
            sink.finish().map_err(TileError::structure(self.path, Frame::Header))
        } else {
            Ok(sink.into_rows())
        }
    }

    /// A bound for the non-zeros of `groups` from the sizes that the table gives.
    fn nonzeros_at_most(&self, of: RowsOf, groups: Range<u32>) -> u64 {
        let sections = self
            .frames_with_entries()
            .filter(|(frame, _)| of.group_of(*frame).is_some_and(|group| groups.contains(&group)));
        let raw_bytes: u64 = sections.map(|(_, entry)| u64::from(entry.raw_bytes)).sum();
        (raw_bytes / (1 + self.layout.codec.share_bytes() as u64)).min(of.counts(&self.layout.header).1)
    }

    pub(crate) fn frames_with_entries(&self) -> impl Iterator<Item = (Frame, &SectionEntry)> {
        self.layout.frames().zip(&self.layout.sections)
    }

    /// Finds, verifies, decompresses and decodes one frame.
    fn frame<T>(
        &self,
        frame: Frame,
        unpacker: &mut Unpacker,
        decode: impl FnOnce(&[u8]) -> Decoded<T>,
    ) -> Result<T, TileError> {
        let structure = || TileError::structure(self.path, frame);
        let entry = frame
            .place(self.layout.header.groups())
            .and_then(|place| self.layout.sections.get(place))
            .ok_or_else(|| structure()("the tile has none".to_owned()))?;
        // The layout's check put all frames inside the file.
        let first = entry.offset as usize;
        let stored = &self.bytes[first..first + entry.stored_bytes as usize];
        let (found, expected) = (checksum::hash(stored), entry.hash);
        if found != expected {
            return Err(TileError::Checksum { path: self.path.to_owned(), frame, expected, found });
        }
        unpacker.unpack(stored, entry.raw_bytes).and_then(decode).map_err(structure())
    }
}
