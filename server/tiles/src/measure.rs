//! Bytes a non-zero and non-zeros a second, on one core: `earthshine bench tiles`.
//!
//! The one place in this package that reads a clock: the thread's own, which stands still while the
//! thread waits for a core, so that a loaded machine gives the same rates.

use crate::codec::RowCodec;
use crate::error::TileError;
use crate::format::Frame;
use crate::manifest::Manifest;
use crate::reader::decode_rows_of_bytes;
use crate::store::DirStore;
use crate::{EncodeOptions, decode_bytes, encode};
use earthshine_world::Chunk;
use rustix::time::{ClockId, clock_gettime};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Tiles to hold in memory while measuring; decoded they are four times as large.
const SAMPLE_BYTES: u64 = 1 << 26;

/// What [`measure`] found.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct TileFigures {
    /// Compressed bytes of the row frames a non-zero: columns, shares, sky and absorbed shares.
    pub bytes_per_nonzero: f64,
    /// Row frames verified and decoded on one core, million non-zeros a second.
    pub decode_mnz_s_core: f64,
    /// Whole tiles, with their points, patches, receivers and occluders, verified and decoded on one core,
    /// million non-zeros a second.
    pub tile_decode_mnz_s_core: f64,
    /// Whole chunks encoded on one core, million non-zeros a second.
    pub encode_mnz_s_core: f64,
    /// Bytes of the rows as plain CSR (4 a column, 4 a share, 32 a row) over compressed bytes.
    pub ratio: f64,
    /// Form factors in the whole world.
    pub nonzeros: u64,
    /// All tiles of the world together, patches, points, receivers and occluders included.
    pub tile_bytes: u64,
    /// Form factors of receivers in the whole world.
    pub receiver_nonzeros: u64,
    /// Compressed bytes of everything about receivers.
    pub receiver_bytes: u64,
}

/// Measures the tiles of the world in the folder `world`, for about `seconds` of one core's time, files in memory.
///
/// Sizes are of all tiles; rates are of the first tiles, 64 MiB or a little more of them.
///
/// # Errors
/// If the world or a tile cannot be read.
pub fn measure(world: &Path, seconds: f64) -> Result<TileFigures, TileError> {
    let store = DirStore::open(world)?;
    let mut figures = measure_sizes(&store)?;
    let sample = Sample::read(&store)?;
    if sample.nonzeros == 0 {
        return Ok(figures);
    }
    let budget = Duration::try_from_secs_f64(seconds / 3.0).unwrap_or_default();
    figures.decode_mnz_s_core = sample.rate(budget, |index| {
        let (path, bytes) = &sample.tiles[index];
        decode_rows_of_bytes(bytes, path).map(|rows| rows.columns.len() as u64)
    })?;
    figures.tile_decode_mnz_s_core = sample.rate(budget, |index| {
        let (path, bytes) = &sample.tiles[index];
        decode_bytes(bytes, path).map(|chunk| nonzeros(&chunk))
    })?;
    let mut options = EncodeOptions::new(store.manifest().world_hash);
    options.codec = sample.codec;
    figures.encode_mnz_s_core = sample.rate(budget, |index| {
        encode(&sample.chunks[index], &options).map(|_| nonzeros(&sample.chunks[index]))
    })?;
    Ok(figures)
}

fn measure_sizes(store: &DirStore) -> Result<TileFigures, TileError> {
    let (mut row_bytes, mut plain_bytes) = (0u64, 0u64);
    let mut figures = TileFigures::default();
    for entry in &store.manifest().chunks {
        let tile = store.map(entry.id())?;
        let row_sections = tile.sections().filter(|(frame, _)| matches!(frame, Frame::Rows(_)));
        row_bytes += row_sections.map(|(_, section)| u64::from(section.stored_bytes)).sum::<u64>();
        plain_bytes += entry.nonzero_count * 8 + u64::from(entry.patch_count) * 32;
        figures.receiver_bytes += tile
            .sections()
            .filter(|(frame, _)| {
                matches!(frame, Frame::Receivers | Frame::ReceiverSegments | Frame::ReceiverRows(_))
            })
            .map(|(_, section)| u64::from(section.stored_bytes))
            .sum::<u64>();
        figures.nonzeros += entry.nonzero_count;
        figures.receiver_nonzeros += entry.receiver_nonzero_count;
        figures.tile_bytes += entry.tile_bytes;
    }
    if figures.nonzeros > 0 {
        figures.bytes_per_nonzero = row_bytes as f64 / figures.nonzeros as f64;
        figures.ratio = plain_bytes as f64 / row_bytes as f64;
    }
    Ok(figures)
}

fn nonzeros(chunk: &Chunk) -> u64 {
    (chunk.rows.columns.len() + chunk.receivers.rows.columns.len()) as u64
}

/// Tiles in memory, encoded and decoded.
struct Sample {
    tiles: Vec<(PathBuf, Vec<u8>)>,
    chunks: Vec<Chunk>,
    nonzeros: u64,
    codec: RowCodec,
}

impl Sample {
    fn read(store: &DirStore) -> Result<Self, TileError> {
        let Manifest { chunks: entries, .. } = store.manifest();
        let mut sample = Self { tiles: vec![], chunks: vec![], nonzeros: 0, codec: RowCodec::default() };
        let mut sample_bytes = 0;
        for entry in entries {
            if sample_bytes >= SAMPLE_BYTES {
                break;
            }
            sample_bytes += entry.tile_bytes;
            let tile = store.map(entry.id())?;
            sample.codec = RowCodec::from_number(tile.header().row_codec).unwrap_or_default();
            let Some(path) = store.path_of(entry.id()) else { continue };
            let bytes = std::fs::read(&path).map_err(TileError::io("read", &path))?;
            sample.chunks.push(decode_bytes(&bytes, &path)?);
            sample.tiles.push((path, bytes));
            sample.nonzeros += entry.nonzero_count;
        }
        Ok(sample)
    }

    /// Runs `work` over the sample, again and again until `budget` is used; million non-zeros a second.
    fn rate(
        &self,
        budget: Duration,
        mut work: impl FnMut(usize) -> Result<u64, TileError>,
    ) -> Result<f64, TileError> {
        let start = thread_time();
        let mut done = 0;
        loop {
            for index in 0..self.tiles.len() {
                done += work(index)?;
            }
            let elapsed = thread_time().saturating_sub(start);
            if elapsed >= budget {
                return Ok(done as f64 / elapsed.as_secs_f64().max(1e-9) / 1e6);
            }
        }
    }
}

/// Time that this thread has run.
fn thread_time() -> Duration {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(now.tv_sec.cast_unsigned(), u32::try_from(now.tv_nsec).unwrap_or_default())
}
