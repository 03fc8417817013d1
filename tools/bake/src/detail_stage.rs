//! The stage that traces detail, chunk by chunk ([`crate::detail`]). What it comes to stays in the work folder:
//!
//! │ exposures u64 │ receivers u32 │ place: voxel 3 x i32, direction u8, layer u8, detail voxel u16, plane 3 x u8, 0, barriers 2 x 2 x u8 │ run: bytes u32, rows as in row files │
//!
//! A run has [`RUN_ROWS`] rows, the last one what is left.

use crate::BakeError;
use crate::changes::Changes;
use crate::content::has_emitters;
use crate::crevices::Crevices;
use crate::detail::{ChunkDetail, DetailBake, DetailPart};
use crate::emitted::{EmittedFiles, emitter_rays};
use crate::eye::{Answer, Eye, Probe};
use crate::inquiry::count_all;
use crate::kept_rows::{Kept, Renewal};
use crate::patches::PatchSet;
use crate::progress::Stage;
use crate::receivers::BakeReceiver;
use crate::row_files::{self, FoundRows, RowIndex};
use crate::rows::{RawRow, RowCaster};
use crate::shard::for_all;
use crate::stages::{Known, Run};
use crate::tracing::caster;
use crate::words::{Reader, Writer};
use crate::work_folder::{Kind, Stale, Stamp};
use earthshine_tiles::{BakeParameters, PatchBuilder};
use earthshine_world::{Barrier, DetailVoxel, Direction, Grid, ReceiverPlace, SurfacePlane, VoxelCoord};
use xxhash_rust::xxh3::xxh3_64;

/// Rows are numbered by `u16` in row files.
const RUN_ROWS: usize = 1 << 16;
/// Which way of making and writing receivers: what was kept by another is of no use.
const PAYLOAD_VERSION: u64 = 5;
/// Bytes of a place.
const PLACE_BYTES: usize = 24;

/// Whether a bake by `parameters` has detail: clusters have none.
pub(crate) fn has_detail(parameters: &BakeParameters) -> bool {
    parameters.detail > 1 && parameters.method.builder == PatchBuilder::Axis
}

/// Traces the detail of all chunks, or finds it in the work folder.
pub(crate) fn trace(run: &mut Run<'_>, known: &Known<'_>) -> Result<(), BakeError> {
    let (set, parameters) = (known.set, run.parameters());
    if !has_detail(parameters) {
        return Ok(());
    }
    run.progress.begin(Stage::Detail, set.len() as u64);
    let (emitted, emitter_cast) = EmittedFiles::trace(run, known)?;
    let emitter_rays = emitter_rays(set, parameters);
    // What is buried in its piece hangs on it.
    let emits = u64::from(has_emitters(known.tracer.scene()));
    let key = xxh3_64(bytemuck::bytes_of(&[known.key, u64::from(emitter_rays), emits, PAYLOAD_VERSION]));
    let chunks: Vec<[i32; 3]> = set.chunks.keys().copied().collect();
    let done = for_all(&run.visits(set), |number| {
        let chunk = chunks[number];
        run.progress.advance(set.chunks[&chunk].len() as u64);
        let (emitted, hash) = emitted.towards(run, known, chunk)?;
        let own = xxh3_64(bytemuck::bytes_of(&[known.identities[&chunk], hash]));
        let now = Stamp { key, own, state: known.states.now, ..Stamp::default() };
        let mut before = (0, Vec::new());
        let kept = Kept::of(run, known, (Kind::Details, chunk), &now, |payload| {
            let (exposures, places, rows) = decode_found(payload, set, &parameters.grid)?;
            before = (exposures, places);
            Some(rows)
        });
        if matches!(kept, Kept::All(_)) {
            return Ok((chunk, None, (before.1.len(), 0)));
        }
        let surfaces = known.source.of(chunk, set)?;
        let caster = caster(run, known, &surfaces, known.tracer.into());
        let none = Crevices::default();
        let whole = DetailBake { caster, emitter_rays, emitted: &emitted, crevices: &none };
        let ChunkDetail { samples, exposures, crevices, parts, wall_rays } = whole.parts(chunk);
        let places: Vec<ReceiverPlace> = parts.iter().map(|part| part.place).collect();
        let kept = match kept {
            Kept::Earlier(..) if (before.0, &before.1) != (exposures, &places) => Kept::Nothing(Stale::Own),
            kept => kept,
        };
        let caster = RowCaster { samples: &samples, ..caster };
        let bake = DetailBake { caster, crevices: &crevices, ..whole };
        let renewal = renewed(known, &bake, &parts, kept);
        let cast = renewal.is_new.iter().filter(|is_new| **is_new).count() as u64
            * u64::from(parameters.detail_rays);
        let made = (parts.len(), cast + wall_rays);
        if renewal.index.is_none() || known.states.renew_all {
            let payload = encode(exposures, &places, &renewal.rows, (set, &parameters.grid));
            run.files.work.write(Kind::Details, 0, chunk, &now, &payload)?;
        }
        Ok((chunk, renewal.stale, made))
    })?;
    run.summary.detail_rays = emitter_cast;
    for (chunk, stale, (receivers, cast)) in done {
        run.summary.detail_receivers += receivers as u64;
        run.summary.detail_rays += cast;
        run.summary.stale.note(chunk, Stage::Detail, stale);
    }
    run.end(Stage::Detail);
    Ok(())
}

/// The rows of `parts`, of which `kept` are there.
fn renewed(known: &Known<'_>, bake: &DetailBake<'_>, parts: &[DetailPart], kept: Kept) -> Renewal {
    let trace = |wanted: &[usize]| {
        let inquiry = |part: usize| bake.inquiry(&parts[part]);
        let on_cpu = |part: usize| bake.row(&parts[part]);
        let (beside, open): (Vec<usize>, Vec<usize>) =
            wanted.iter().partition(|&&part| bake.is_beside_crevice(&parts[part]));
        let counted = count_all(known.offload, &open, inquiry, on_cpu, &|| ());
        let of_beside: Vec<&DetailPart> = beside.iter().map(|&part| &parts[part]).collect();
        let cast = bake.rows_in_crevices(&of_beside, known.offload);
        let mut rows: Vec<(usize, RawRow)> =
            open.into_iter().zip(counted).chain(beside.into_iter().zip(cast)).collect();
        rows.sort_unstable_by_key(|row| row.0);
        rows.into_iter().map(|(_, row)| vec![row]).collect()
    };
    let is_concerned = |part: usize, _: &[RawRow], changes: &Changes| {
        let probe = Probe::new(changes, Answer::Sky);
        let caster = RowCaster { tracer: Eye::asking(known.tracer, &probe), ..bake.caster };
        drop(DetailBake { caster, ..*bake }.row(&parts[part]));
        probe.is_concerned()
    };
    kept.renewed((parts.len(), 1), is_concerned, trace)
}

/// The detail of `chunk` that [`trace`] has put into the work folder, ascending by place.
pub(crate) fn read(
    run: &Run<'_>,
    known: &Known<'_>,
    chunk: [i32; 3],
) -> Result<Vec<BakeReceiver>, BakeError> {
    if !has_detail(run.parameters()) || !known.set.chunks.contains_key(&chunk) {
        return Ok(Vec::new());
    }
    let kept = run.files.work.read(Kind::Details, 0, chunk);
    kept.and_then(|(_, payload)| decode(&payload, known.set, &run.parameters().grid))
        .ok_or(BakeError::WorkChanged { chunk })
}

fn encode(
    exposures: u64,
    places: &[ReceiverPlace],
    rows: &[RawRow],
    (set, grid): (&PatchSet, &Grid),
) -> Vec<u8> {
    let mut out = Writer::default();
    out.u64(exposures);
    out.u32(rows.len() as u32);
    for place in places {
        let DetailVoxel { index, layer, plane, barriers } = place.detail.expect("detail is of detail voxels");
        let ([low, high], [x, y]) = (index.to_le_bytes(), plane.normal);
        let [[angle, distance], [second_angle, second_distance]] =
            barriers.map(|barrier| barrier.map_or([0; 2], Barrier::code));
        out.i32s(place.voxel.to_array());
        let words = [
            [place.direction as u8, layer, low, high],
            [x, y, plane.distance, 0],
            [angle, distance, second_angle, second_distance],
        ];
        out.u32s(words.map(u32::from_le_bytes));
    }
    for run in rows.chunks(RUN_ROWS) {
        let payload = row_files::encode(run, set, grid);
        out.u32(payload.len() as u32);
        out.0.extend(payload);
    }
    out.0
}

fn decode(payload: &[u8], set: &PatchSet, grid: &Grid) -> Option<Vec<BakeReceiver>> {
    let (_, places, found) = decode_found(payload, set, grid)?;
    let receivers = places.into_iter().zip(found.rows).map(|(place, row)| BakeReceiver { place, row });
    (!found.has_lost.contains(&true)).then(|| receivers.collect())
}

/// The hash of exposures, places and their rows, without entries whose patches are gone; the index is of no use.
fn decode_found(payload: &[u8], set: &PatchSet, grid: &Grid) -> Option<(u64, Vec<ReceiverPlace>, FoundRows)> {
    let mut reader = Reader(payload);
    let exposures = reader.u64()?;
    let count = reader.count(PLACE_BYTES)?;
    let place = |reader: &mut Reader<'_>| {
        let voxel = VoxelCoord::from_array(reader.i32s()?);
        let [direction, layer, low, high] = reader.u32()?.to_le_bytes();
        let [x, y, distance, _] = reader.u32()?.to_le_bytes();
        let barrier = |code: [u8; 2]| Barrier::from_code(code).ok();
        let [angle, along, second_angle, second_along] = reader.u32()?.to_le_bytes();
        let barriers = [barrier([angle, along])?, barrier([second_angle, second_along])?];
        let direction = Direction::from_index(direction)?;
        let (index, plane) = (u16::from_le_bytes([low, high]), SurfacePlane { normal: [x, y], distance });
        Some(ReceiverPlace { voxel, direction, detail: Some(DetailVoxel { index, layer, plane, barriers }) })
    };
    let places = (0..count).map(|_| place(&mut reader)).collect::<Option<Vec<_>>>()?;
    let (mut rows, mut has_lost) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for run in places.chunks(RUN_ROWS) {
        let bytes = reader.u32()? as usize;
        let (part, rest) = reader.0.split_at_checked(bytes)?;
        reader.0 = rest;
        let found = row_files::decode_found(part, run.len(), set, grid)?;
        rows.extend(found.rows);
        has_lost.extend(found.has_lost);
    }
    reader.is_empty().then_some((exposures, places, FoundRows { rows, has_lost, index: RowIndex::default() }))
}
