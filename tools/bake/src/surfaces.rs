//! The surfaces of one chunk: its samples and patches, made afresh whenever they are needed.
//!
//! Samples take most of a bake's memory, so only those of the chunks at work are there. What they cost are the rays
//! that tell their exposure; these are cast once and kept in the work folder with the patches.
//!
//! Methods whose patches or rows need the whole world at once ([`is_streamed`]) keep all of it in memory instead.

use crate::BakeError;
use crate::apart::{EMITTER_ORDINALS, is_apart};
use crate::builder::{Builder, Surfaces};
use crate::buried::BuriedPiece;
use crate::cells::{Cells, Seen};
use crate::content::SceneContent;
use crate::exposure::Exposure;
use crate::exposure_record::{Basis, Points};
use crate::hidden::PieceSample;
use crate::offload::Offload;
use crate::overlap::ChunkTriangles;
use crate::patches::{BakePatch, PatchSet};
use crate::rows::patch_key;
use crate::sample::{SurfaceSample, sample_triangle};
use crate::states::States;
use crate::words::{Reader, Writer};
use crate::work_folder::{Kind, Stale, Stamp, WorkFolder};
use earthshine_tiles::{BakeMethod, PatchBuilder, RowEstimator, SampleSource};
use earthshine_world::{Direction, Patch, Vec3, VoxelCoord};
use glam::IVec3;
use rayon::prelude::*;
use std::borrow::Cow;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

/// Triangles that are handled together.
const BATCH: usize = 256;

/// Whether a bake by `method` can go chunk by chunk.
#[must_use]
pub fn is_streamed(method: &BakeMethod) -> bool {
    method.samples == SampleSource::Area
        && method.builder == PatchBuilder::Axis
        && method.estimator == RowEstimator::Rays
}

/// Where the surfaces of chunks come from.
pub(crate) struct SurfaceSource<'a> {
    pub(crate) builder: Builder<'a>,
    /// The device that rays are cast on, if there is one.
    pub(crate) offload: &'a Offload<'a>,
    pub(crate) triangles: &'a ChunkTriangles,
    pub(crate) content: &'a SceneContent<'a>,
    pub(crate) work: &'a WorkFolder,
    /// Hash of what holds for all chunks.
    pub(crate) key: u64,
    /// All of the world, where the method needs it.
    pub(crate) whole: Option<Surfaces>,
}

/// The samples and patches of one chunk.
#[derive(Debug)]
pub(crate) struct ChunkSurfaces<'a> {
    pub(crate) samples: Cow<'a, [SurfaceSample]>,
    pub(crate) patches: Cow<'a, [BakePatch]>,
    /// Number of the first patch in the whole world.
    pub(crate) first: u32,
}

/// What became of a chunk in the first stage.
#[derive(Debug, Default)]
pub(crate) struct SurfaceRecord {
    /// Changes with all that rays from or to the chunk's surfaces hang on.
    pub(crate) identity: u64,
    pub(crate) patches: Vec<BakePatch>,
    pub(crate) hidden: Vec<PieceSample>,
    /// Those whose hits are absorbed.
    pub(crate) pieces: Vec<BuriedPiece>,
    pub(crate) samples: u64,
    pub(crate) buried: u64,
    pub(crate) rays: u64,
    /// Why rays were cast; `None` where the work folder had their result.
    pub(crate) stale: Option<Stale>,
}

impl SurfaceSource<'_> {
    /// Finds out, or reads, how exposed the samples of `chunk` are and which patches they make.
    pub(crate) fn record(
        &self,
        chunk: [i32; 3],
        cells: &Cells,
        states: &States<'_>,
    ) -> Result<SurfaceRecord, BakeError> {
        let now = Stamp { state: states.now, ..self.stamp(chunk) };
        let Some((stamp, payload)) = self.work.read(Kind::Surfaces, 0, chunk) else {
            return self.exposed(chunk, now, cells, Stale::Absent);
        };
        if let Some(stale) = stamp.difference(&now) {
            return self.exposed(chunk, now, cells, stale);
        }
        let Some(changes) = states.since(stamp.state, cells) else {
            return self.exposed(chunk, now, cells, Stale::Absent);
        };
        let is_same = stamp.look == now.look && changes.is_empty();
        if is_same && let Some(record) = self.decoded(&payload, now.own, chunk) {
            return Ok(record);
        }
        let mut points = Points::new(self.samples(chunk));
        if !put_exposures(&payload, &mut points) {
            return self.exposed(chunk, now, cells, Stale::Absent);
        }
        let paths_changed = stamp.changed_sight(cells).is_some();
        let concerned = points.concerned(&self.builder, &changes, paths_changed);
        let renewed = concerned.iter().filter(|&&concerned| concerned).count() as u32;
        if renewed == 0
            && stamp.look == now.look
            && !states.renew_all
            && let Some(record) = self.decoded(&payload, now.own, chunk)
        {
            return Ok(record);
        }
        let seen = Seen::nothing(cells);
        if !paths_changed {
            stamp.seen.iter().for_each(|&(cell, _)| seen.mark(cell as usize));
        }
        let (of, at) = (concerned.len() as u32, changes.example().to_array());
        let rays = points.expose(&self.builder, self.offload, concerned, &seen);
        let stale = (renewed > 0).then_some(Stale::Part { renewed, of, at });
        let record = self.finished(chunk, &points, Stamp { seen: seen.list(), ..now })?;
        Ok(SurfaceRecord { rays, stale, ..record })
    }

    /// Casts the rays of all samples of `chunk`.
    fn exposed(
        &self,
        chunk: [i32; 3],
        now: Stamp,
        cells: &Cells,
        stale: Stale,
    ) -> Result<SurfaceRecord, BakeError> {
        let mut points = Points::new(self.samples(chunk));
        let seen = Seen::nothing(cells);
        let all = vec![true; points.samples.len()];
        let rays = points.expose(&self.builder, self.offload, all, &seen);
        let record = self.finished(chunk, &points, Stamp { seen: seen.list(), ..now })?;
        Ok(SurfaceRecord { rays, stale: Some(stale), ..record })
    }

    fn stamp(&self, chunk: [i32; 3]) -> Stamp {
        let (mut own, mut look) = (Xxh3Default::new(), Xxh3Default::new());
        for &triangle in self.triangles.of(chunk) {
            own.update(&self.content.traced(triangle as usize).to_le_bytes());
            look.update(&self.content.look(triangle as usize).to_le_bytes());
        }
        Stamp { key: self.key, own: own.digest(), look: look.digest(), ..Stamp::default() }
    }

    fn finished(&self, chunk: [i32; 3], points: &Points, stamp: Stamp) -> Result<SurfaceRecord, BakeError> {
        let samples = &points.samples;
        let set = PatchSet::group(samples, self.builder.parameters);
        let hidden = set.hidden().samples();
        let pieces = self.builder.buried_pieces(samples);
        let payload = encode(points, &set.patches, &hidden, &pieces, self.triangles.of(chunk));
        self.work.write(Kind::Surfaces, 0, chunk, &stamp, &payload)?;
        let buried = samples.iter().filter(|sample| sample.exposure == Exposure::Buried).count() as u64;
        let identity = identity(stamp.own, &payload, samples.len());
        let samples = samples.len() as u64;
        let patches = set.patches;
        Ok(SurfaceRecord { identity, patches, hidden, pieces, samples, buried, rays: 0, stale: None })
    }

    /// The surfaces of `chunk`, whose patches are `range` of `set`.
    pub(crate) fn of(&self, chunk: [i32; 3], set: &PatchSet) -> Result<ChunkSurfaces<'_>, BakeError> {
        let range = set.chunks.get(&chunk).cloned().unwrap_or(0..0);
        if let Some(Surfaces { samples, set }) = &self.whole {
            let own = range.start as usize..range.end as usize;
            return Ok(ChunkSurfaces {
                samples: Cow::Borrowed(samples),
                patches: Cow::Borrowed(&set.patches[own]),
                first: range.start,
            });
        }
        let mut points = Points::new(if range.is_empty() { Vec::new() } else { self.samples(chunk) });
        if !points.samples.is_empty() {
            let kept = self.work.read(Kind::Surfaces, 0, chunk);
            if !kept.is_some_and(|(_, payload)| put_exposures(&payload, &mut points)) {
                return Err(BakeError::WorkChanged { chunk });
            }
        }
        let samples = points.samples;
        let patches = PatchSet::group(&samples, self.builder.parameters).patches;
        if patches.len() != range.len() {
            return Err(BakeError::WorkChanged { chunk });
        }
        Ok(ChunkSurfaces { samples: Cow::Owned(samples), patches: Cow::Owned(patches), first: range.start })
    }

    fn samples(&self, chunk: [i32; 3]) -> Vec<SurfaceSample> {
        // Where there is detail, no sample crosses a detail voxel's face, so that areas in it are exact.
        let parameters = &self.builder.parameters.of_detail_voxels();
        let detail = IVec3::splat(self.builder.parameters.detail.cast_signed());
        let edge = parameters.grid.chunk_edge_voxels.cast_signed();
        let low = VoxelCoord::from_array(chunk) * edge;
        let within = (low, low + (edge - 1));
        let batches: Vec<Vec<SurfaceSample>> = self
            .triangles
            .of(chunk)
            .par_chunks(BATCH)
            .map(|triangles| {
                let mut samples = Vec::new();
                for &triangle in triangles {
                    let scene = self.builder.tracer.scene();
                    sample_triangle(scene, triangle as usize, parameters, within, |sample| {
                        let voxel = sample.voxel.div_euclid(detail);
                        samples.push(SurfaceSample { voxel, ..sample });
                    });
                }
                samples
            })
            .collect();
        batches.concat()
    }

    fn decoded(&self, payload: &[u8], own: u64, chunk: [i32; 3]) -> Option<SurfaceRecord> {
        let mut reader = Reader(payload);
        let samples = reader.count(5)?;
        let mut buried = 0;
        for _ in 0..samples {
            buried += u64::from(Exposure::from_word(reader.f32()?) == Exposure::Buried);
        }
        reader.bytes(samples)?;
        let patches = reader.count(56)?;
        let patches = (0..patches).map(|_| decode_patch(&mut reader)).collect::<Option<Vec<_>>>()?;
        let pieces = reader.count(32)?;
        let triangles = self.triangles.of(chunk);
        let hidden = (0..pieces).map(|_| decode_piece(&mut reader, triangles)).collect::<Option<Vec<_>>>()?;
        let count = reader.count(16)?;
        let pieces = (0..count).map(|_| decode_buried(&mut reader, triangles)).collect::<Option<Vec<_>>>()?;
        let identity = identity(own, payload, samples);
        let samples = samples as u64;
        let record =
            SurfaceRecord { identity, patches, hidden, pieces, samples, buried, ..SurfaceRecord::default() };
        reader.is_empty().then_some(record)
    }
}

/// The exposures are at the front; with what rays notice of the triangles they decide all but colours.
fn identity(own: u64, payload: &[u8], samples: usize) -> u64 {
    xxh3_64(bytemuck::bytes_of(&[own, xxh3_64(&payload[..4 + 4 * samples])]))
}

fn encode(
    points: &Points,
    patches: &[BakePatch],
    hidden: &[PieceSample],
    buried: &[BuriedPiece],
    triangles: &[u32],
) -> Vec<u8> {
    let mut out = Writer::default();
    out.u32(points.samples.len() as u32);
    out.f32s(points.samples.iter().map(|sample| sample.exposure.word()));
    out.0.extend(points.bases.iter().map(|&basis| basis as u8));
    out.u32(patches.len() as u32);
    for BakePatch { patch, key, .. } in patches {
        out.i32s(patch.voxel.to_array());
        let emitters = if is_apart(*key) { EMITTER_ORDINALS } else { 0 };
        out.u32(patch.direction as u32 + u32::from(emitters));
        out.f32s([patch.area]);
        for triple in [patch.centroid, patch.reflectance, patch.emission] {
            out.f32s(triple.to_array());
        }
    }
    out.u32(hidden.len() as u32);
    for piece in hidden {
        out.u32(kept_side(piece.side, triangles));
        out.i32s(piece.voxel.to_array());
        out.f32s(piece.position.to_array());
        out.u32(u32::from(piece.left_out));
    }
    out.u32(buried.len() as u32);
    for piece in buried {
        out.u32(kept_side(piece.side, triangles));
        out.i32s(piece.voxel);
    }
    out.0
}

/// Numbers of triangles change with edits elsewhere; their places in the chunk's list do not.
fn kept_side(side: u32, triangles: &[u32]) -> u32 {
    let place = triangles.partition_point(|&triangle| triangle < side / 2) as u32;
    place * 2 + side % 2
}

/// What [`kept_side`] made.
fn side_kept(kept: u32, triangles: &[u32]) -> Option<u32> {
    Some(triangles.get(kept as usize / 2)? * 2 + kept % 2)
}

/// Gives `points` the exposures at the front of `payload`, and what they rest on; `false` if they are not as many.
fn put_exposures(payload: &[u8], points: &mut Points) -> bool {
    let mut reader = Reader(payload);
    let count = points.samples.len();
    if reader.count(5) != Some(count) {
        return false;
    }
    let Some(exposures) = (0..count).map(|_| reader.f32()).collect::<Option<Vec<_>>>() else { return false };
    let bases =
        reader.bytes(count).and_then(|bytes| bytes.iter().map(|&byte| Basis::from_byte(byte)).collect());
    let Some(bases) = bases else { return false };
    points.bases = bases;
    for (sample, word) in points.samples.iter_mut().zip(exposures) {
        sample.exposure = Exposure::from_word(word);
    }
    points.note_suspects();
    true
}

fn decode_patch(reader: &mut Reader<'_>) -> Option<BakePatch> {
    let voxel = VoxelCoord::from_array(reader.i32s()?);
    let ordinal = reader.u32()? as usize;
    let is_emitter = ordinal >= usize::from(EMITTER_ORDINALS);
    let direction =
        *Direction::ALL.get(ordinal - if is_emitter { usize::from(EMITTER_ORDINALS) } else { 0 })?;
    let area = reader.f32()?;
    let mut triple = || reader.f32s().map(Vec3::from_array);
    let (centroid, reflectance, emission) = (triple()?, triple()?, triple()?);
    let patch =
        Patch { voxel, direction, area, centroid, reflectance, emission, point_first: 0, point_count: 0 };
    Some(BakePatch { patch, key: patch_key(voxel, ordinal), samples: Vec::new() })
}

fn decode_piece(reader: &mut Reader<'_>, triangles: &[u32]) -> Option<PieceSample> {
    let side = side_kept(reader.u32()?, triangles)?;
    let voxel = VoxelCoord::from_array(reader.i32s()?);
    let position = Vec3::from_array(reader.f32s()?);
    Some(PieceSample { side, voxel, position, left_out: reader.u32()? == 1 })
}

fn decode_buried(reader: &mut Reader<'_>, triangles: &[u32]) -> Option<BuriedPiece> {
    Some(BuriedPiece { side: side_kept(reader.u32()?, triangles)?, voxel: reader.i32s()? })
}
