//! The stages that cast most rays: rows of patches, and of receivers. What they come to stays in the work folder.

use crate::BakeError;
use crate::balance::RowStore;
use crate::cells::{Eye, Seen};
use crate::estimator::{Estimator, emitter_factor};
use crate::progress::Stage;
use crate::receiver_places::{Voxel, chunks_near_patches, voxels_near_patches};
use crate::receivers::ReceiverBake;
use crate::row_files::{self, RowIndex};
use crate::rows::{RawRow, RowCaster};
use crate::shard::{for_all, visits};
use crate::stages::{Known, Run};
use crate::surfaces::ChunkSurfaces;
use crate::work_folder::{Kind, Stale, Stamp};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

/// The voxels of each chunk that may have receivers.
pub(crate) type ReceiverVoxels = BTreeMap<[i32; 3], Vec<Voxel>>;

/// Traces the rows of all chunks, or finds them in the work folder.
pub(crate) fn rows<'k, 'r: 'k>(run: &mut Run<'r>, known: &Known<'k>) -> Result<RowStore<'k>, BakeError> {
    let (set, parameters, grid) = (known.set, run.parameters(), run.parameters().grid);
    let chunks: Vec<[i32; 3]> = set.chunks.keys().copied().collect();
    let factor = emitter_factor(set, parameters);
    let key = xxh3_64(bytemuck::bytes_of(&[known.key, u64::from(factor)]));
    // Sums over points need the points of all patches.
    let whole = known.source.whole.as_ref();
    let of_world = whole.map(|surfaces| RowCaster::of_world(known.tracer, surfaces, parameters));
    let of_world = of_world.map(Estimator::new).transpose()?;
    // What a row takes where its error decides is not known before.
    let rays = u64::from(parameters.rays_per_patch);
    run.progress.begin(Stage::Rows, set.len() as u64 * rays);
    let started = Instant::now();
    let cast = AtomicU64::new(0);
    let done = for_all(&run.visits(set), |number| {
        let chunk = chunks[number];
        let count = set.chunks[&chunk].len();
        let now = Stamp { key, own: known.identities[&chunk], ..Stamp::default() };
        let (stale, kept) = kept(run, known, Kind::Rows, chunk, &now, count);
        if let Some((_, index)) = kept {
            run.progress.advance(rays * count as u64);
            return Ok((chunk, None, index));
        }
        let seen = Seen::nothing(&known.cells);
        let trace = |estimator: &Estimator<'_>| -> Vec<RawRow> {
            let row = |patch| {
                let row = estimator.row(patch);
                run.progress.advance(rays);
                row
            };
            set.chunks[&chunk].clone().into_par_iter().map(row).collect()
        };
        let rows = match &of_world {
            Some(estimator) => trace(estimator),
            None => {
                let surfaces = known.source.of(chunk, set)?;
                let eye = Eye::noting(known.tracer, &seen);
                trace(&Estimator::with_factor(caster(run, known, &surfaces, eye), factor))
            }
        };
        cast.fetch_add(rows.iter().map(|row| u64::from(row.rays)).sum(), Ordering::Relaxed);
        let stamp = Stamp { seen: seen.list(), ..now };
        let payload = row_files::encode(&rows, set, &grid);
        run.files.work.write(Kind::Rows, 0, chunk, &stamp, &payload)?;
        let (_, mut index) =
            row_files::decode(&payload, count, set, &grid).ok_or(BakeError::WorkChanged { chunk })?;
        index.seen = stamp.seen.len();
        Ok((chunk, Some(stale), index))
    })?;
    run.summary.rays = cast.into_inner();
    let core_seconds = started.elapsed().as_secs_f64() * rayon::current_num_threads() as f64;
    run.summary.mrays_s_core = run.summary.rays as f64 / core_seconds.max(1e-9) / 1e6;
    let mut indices = BTreeMap::new();
    for (chunk, stale, index) in done {
        run.summary.resumed_chunks += u64::from(stale.is_none());
        run.summary.stale.note(chunk, Stage::Rows, stale);
        indices.insert(chunk, index);
    }
    run.end(Stage::Rows);
    Ok(RowStore { work: run.files.work, set, grid, indices, content_hash: run.files.content_hash })
}

/// Traces the receivers of all chunks, or finds them in the work folder.
pub(crate) fn receivers(run: &mut Run<'_>, known: &Known<'_>) -> Result<ReceiverVoxels, BakeError> {
    let (set, parameters, grid) = (known.set, run.parameters(), run.parameters().grid);
    let reach = parameters.receiver_reach_voxels;
    if reach == 0 {
        return Ok(ReceiverVoxels::new());
    }
    let bounds = known.tracer.scene().bounds();
    let within = (grid.voxel_at(bounds.min), grid.voxel_at(bounds.max));
    let chunks = chunks_near_patches(set, &grid, reach);
    let voxels: Vec<Vec<Voxel>> =
        chunks.par_iter().map(|&chunk| voxels_near_patches(set, &grid, chunk, reach, within)).collect();
    let rays = u64::from(parameters.receiver_rays);
    let total: usize = voxels.iter().map(Vec::len).sum();
    run.progress.begin(Stage::Receivers, total as u64 * rays);
    let done = for_all(&visits(run.options.shard, &chunks), |number| {
        let (chunk, voxels) = (chunks[number], &voxels[number]);
        run.progress.advance(rays * voxels.len() as u64);
        if voxels.is_empty() {
            return Ok((chunk, None, 0));
        }
        let own = own_of_receivers(known.identities.get(&chunk).copied(), voxels);
        let now = Stamp { key: known.key, own, ..Stamp::default() };
        let (stale, kept) = kept(run, known, Kind::Receivers, chunk, &now, voxels.len() * 6);
        if kept.is_some() {
            return Ok((chunk, None, 0));
        }
        let seen = Seen::nothing(&known.cells);
        let surfaces = known.source.of(chunk, set)?;
        let eye = Eye::noting(known.tracer, &seen);
        let (rows, cast) = ReceiverBake { caster: caster(run, known, &surfaces, eye) }.rows(voxels);
        let stamp = Stamp { seen: seen.list(), ..now };
        let payload = row_files::encode(&rows, set, &grid);
        run.files.work.write(Kind::Receivers, 0, chunk, &stamp, &payload)?;
        Ok((chunk, Some(stale), cast))
    })?;
    for (chunk, stale, cast) in done {
        run.summary.receiver_rays += cast;
        run.summary.stale.note(chunk, Stage::Receivers, stale);
    }
    run.end(Stage::Receivers);
    Ok(chunks.into_iter().zip(voxels).filter(|(_, voxels)| !voxels.is_empty()).collect())
}

pub(crate) fn caster<'b>(
    run: &'b Run<'_>,
    known: &'b Known<'_>,
    surfaces: &'b ChunkSurfaces<'_>,
    tracer: Eye<'b>,
) -> RowCaster<'b> {
    let ChunkSurfaces { samples, patches, first } = surfaces;
    let parameters = run.parameters();
    RowCaster { tracer, samples, sources: patches, first: *first, set: known.set, parameters }
}

fn own_of_receivers(surfaces: Option<u64>, voxels: &[Voxel]) -> u64 {
    let mut hash = Xxh3Default::new();
    hash.update(&surfaces.unwrap_or(0).to_le_bytes());
    for voxel in voxels {
        hash.update(bytemuck::cast_slice(&voxel.at.to_array()));
        hash.update(&[voxel.taken]);
    }
    hash.digest()
}

/// The rows of `chunk` in the work folder where they are of use; if not, why.
fn kept(
    run: &Run<'_>,
    known: &Known<'_>,
    kind: Kind,
    chunk: [i32; 3],
    now: &Stamp,
    row_count: usize,
) -> (Stale, Option<(Vec<RawRow>, RowIndex)>) {
    let Some((stamp, payload)) = run.files.work.read(kind, 0, chunk) else { return (Stale::Absent, None) };
    if let Some(stale) = stamp.staleness(now, &known.cells) {
        return (stale, None);
    }
    let mut found = row_files::decode(&payload, row_count, known.set, &run.parameters().grid);
    if let Some((_, index)) = &mut found {
        index.seen = stamp.seen.len();
    }
    (Stale::Absent, found)
}
