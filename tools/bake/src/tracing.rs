//! The stages that cast most rays: rows of patches, and of receivers. What they come to stays in the work folder.

use crate::BakeError;
use crate::balance::RowStore;
use crate::changes::Changes;
use crate::counted_receivers::ReceiverInquiry;
use crate::estimator::{Estimator, emitter_factor};
use crate::eye::{Answer, Eye, Probe};
use crate::inquiry::count_all;
use crate::kept_rows::{Kept, Renewal};
use crate::progress::Stage;
use crate::receiver_places::{Voxel, chunks_near_patches, voxels_near_patches};
use crate::receivers::ReceiverBake;
use crate::row_files;
use crate::rows::{RawRow, RowCaster};
use crate::shard::{for_all, visits};
use crate::stages::{Known, Run};
use crate::surfaces::ChunkSurfaces;
use crate::work_folder::{Kind, Stamp};
use earthshine_world::{Grid, Vec3, VoxelCoord};
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
        let range = set.chunks[&chunk].clone();
        let now = Stamp { key, own: known.identities[&chunk], state: known.states.now, ..Stamp::default() };
        let kept = Kept::of(run, known, (Kind::Rows, chunk), &now, |payload| {
            row_files::decode_found(payload, range.len(), set, &grid)
        });
        if let Kept::All(index) = kept {
            run.progress.advance(rays * range.len() as u64);
            return Ok((chunk, None, index));
        }
        let renewal = match &of_world {
            Some(estimator) => {
                let trace = |&row: &usize| {
                    let traced = vec![estimator.row(range.start + row as u32)];
                    run.progress.advance(rays);
                    traced
                };
                let trace_rows = |rows: &[usize]| rows.par_iter().map(trace).collect();
                kept.renewed((range.len(), 1), |_, _, _| true, trace_rows)
            }
            None => rows_of_chunk(run, known, &known.source.of(chunk, set)?, factor, kept),
        };
        let new = renewal.rows.iter().zip(&renewal.is_new).filter(|(_, is_new)| **is_new);
        cast.fetch_add(new.map(|(row, _)| u64::from(row.rays)).sum(), Ordering::Relaxed);
        if let Some(index) = renewal.index.filter(|_| !known.states.renew_all) {
            return Ok((chunk, None, index));
        }
        let payload = row_files::encode(&renewal.rows, set, &grid);
        run.files.work.write(Kind::Rows, 0, chunk, &now, &payload)?;
        let (_, index) =
            row_files::decode(&payload, range.len(), set, &grid).ok_or(BakeError::WorkChanged { chunk })?;
        Ok((chunk, renewal.stale, index))
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

/// The rows of a chunk with `surfaces`, of which `kept` are there.
fn rows_of_chunk(
    run: &Run<'_>,
    known: &Known<'_>,
    surfaces: &ChunkSurfaces<'_>,
    factor: u32,
    kept: Kept,
) -> Renewal {
    let (caster, first) = (caster(run, known, surfaces, known.tracer.into()), surfaces.first);
    let rays = run.parameters().rays_per_patch;
    let advance = || run.progress.advance(u64::from(rays));
    let estimator = Estimator::with_factor(caster, factor);
    let inquiry = |row: usize| estimator.inquiry(first + row as u32);
    let on_cpu = |row: usize| estimator.row(first + row as u32);
    let trace_rows = |rows: &[usize]| {
        count_all(known.offload, rows, inquiry, on_cpu, &advance).into_iter().map(|row| vec![row]).collect()
    };
    let is_concerned = |row: usize, old: &[RawRow], changes: &Changes| {
        let probe = Probe::new(changes, Answer::Sky);
        let asking = RowCaster { tracer: Eye::asking(known.tracer, &probe), ..caster };
        Estimator::with_factor(asking, factor).recast(first + row as u32, old[0].rays);
        if !probe.is_concerned() {
            advance();
        }
        probe.is_concerned()
    };
    kept.renewed((surfaces.patches.len(), 1), is_concerned, trace_rows)
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
        let now = Stamp { key: known.key, own, state: known.states.now, ..Stamp::default() };
        let kept = Kept::of(run, known, (Kind::Receivers, chunk), &now, |payload| {
            row_files::decode_found(payload, voxels.len() * 6, set, &grid)
        });
        if matches!(kept, Kept::All(_)) {
            return Ok((chunk, None, 0));
        }
        let surfaces = known.source.of(chunk, set)?;
        let caster = caster(run, known, &surfaces, known.tracer.into());
        let looking = ReceiverBake { caster };
        let candidate = |voxel: usize| looking.candidate(&voxels[voxel]);
        let inquiry = |voxel: usize| ReceiverInquiry { bake: looking, candidate: candidate(voxel) };
        let on_cpu = |voxel: usize| looking.rows(&candidate(voxel));
        let cast = AtomicU64::new(0);
        let trace_voxels = |voxels: &[usize]| {
            let traced = count_all(known.offload, voxels, inquiry, on_cpu, &|| ());
            cast.fetch_add(traced.iter().map(|(_, rays)| rays).sum(), Ordering::Relaxed);
            traced.into_iter().map(|(rows, _)| rows.to_vec()).collect()
        };
        let is_concerned = |voxel: usize, _: &[RawRow], changes: &Changes| {
            let (low, high) = around(grid, voxels[voxel].at);
            let probe = Probe::new(changes, Answer::Sky);
            changes.touch(low, high) || {
                let asking = RowCaster { tracer: Eye::asking(known.tracer, &probe), ..caster };
                let _ = ReceiverBake { caster: asking }.rows(&looking.candidate(&voxels[voxel]));
                probe.is_concerned()
            }
        };
        let renewal = kept.renewed((voxels.len(), 6), is_concerned, trace_voxels);
        if renewal.index.is_none() || known.states.renew_all {
            let payload = row_files::encode(&renewal.rows, set, &grid);
            run.files.work.write(Kind::Receivers, 0, chunk, &now, &payload)?;
        }
        Ok((chunk, renewal.stale, cast.into_inner()))
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

/// The voxel at `at` with what lies around it: where its place is looked for, m.
fn around(grid: Grid, at: VoxelCoord) -> (Vec3, Vec3) {
    let (centre, edge) = (grid.voxel_centre(at), Vec3::splat(grid.voxel_edge_m));
    (centre - edge, centre + edge)
}
