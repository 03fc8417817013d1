//! The stage that traces detail, chunk by chunk ([`crate::detail`]). What it comes to stays in the work folder:
//!
//! │ receivers u32 │ place: voxel 3 x i32, direction u8, layer u8, detail voxel u16, plane 3 x u8, 0 │ run: bytes u32, rows as in row files │
//!
//! A run has [`RUN_ROWS`] rows, the last one what is left.

use crate::BakeError;
use crate::cells::Seen;
use crate::detail::DetailBake;
use crate::emitted::{EmittedFiles, emitter_rays};
use crate::eye::Eye;
use crate::patches::PatchSet;
use crate::progress::Stage;
use crate::receivers::BakeReceiver;
use crate::row_files;
use crate::rows::RawRow;
use crate::shard::for_all;
use crate::stages::{Known, Run};
use crate::tracing::caster;
use crate::words::{Reader, Writer};
use crate::work_folder::{Kind, Stale, Stamp};
use earthshine_tiles::{BakeParameters, PatchBuilder};
use earthshine_world::{DetailVoxel, Direction, Grid, ReceiverPlace, SurfacePlane, VoxelCoord};
use xxhash_rust::xxh3::xxh3_64;

/// Rows are numbered by `u16` in row files.
const RUN_ROWS: usize = 1 << 16;
/// Which way of making and writing receivers: what was kept by another is of no use.
const PAYLOAD_VERSION: u64 = 3;
/// Bytes of a place.
const PLACE_BYTES: usize = 20;

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
    let key = xxh3_64(bytemuck::bytes_of(&[known.key, u64::from(emitter_rays), PAYLOAD_VERSION]));
    let chunks: Vec<[i32; 3]> = set.chunks.keys().copied().collect();
    let done = for_all(&run.visits(set), |number| {
        let chunk = chunks[number];
        run.progress.advance(set.chunks[&chunk].len() as u64);
        let (emitted, hash) = emitted.towards(run, known, chunk)?;
        let own = xxh3_64(bytemuck::bytes_of(&[known.identities[&chunk], hash]));
        let now = Stamp { key, own, ..Stamp::default() };
        let kept = run.files.work.read(Kind::Details, 0, chunk);
        let stale = match &kept {
            None => Stale::Absent,
            Some((stamp, payload)) => match stamp.staleness(&now, &known.cells) {
                None => match decode(payload, set, &parameters.grid) {
                    Some(kept) => return Ok((chunk, None, (kept.len(), 0))),
                    None => Stale::Absent,
                },
                Some(stale) => stale,
            },
        };
        let seen = Seen::nothing(&known.cells);
        let surfaces = known.source.of(chunk, set)?;
        let caster = caster(run, known, &surfaces, Eye::noting(known.tracer, &seen));
        let (receivers, cast) = DetailBake { caster, emitter_rays }.receivers(chunk, &emitted);
        let stamp = Stamp { seen: seen.list(), ..now };
        let made = (receivers.len(), cast);
        let payload = encode(receivers, set, &parameters.grid);
        run.files.work.write(Kind::Details, 0, chunk, &stamp, &payload)?;
        Ok((chunk, Some(stale), made))
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

fn encode(receivers: Vec<BakeReceiver>, set: &PatchSet, grid: &Grid) -> Vec<u8> {
    let mut out = Writer::default();
    out.u32(receivers.len() as u32);
    let mut rows = Vec::with_capacity(receivers.len());
    for BakeReceiver { place, row } in receivers {
        let DetailVoxel { index, layer, plane } = place.detail.expect("detail is of detail voxels");
        let ([low, high], [x, y]) = (index.to_le_bytes(), plane.normal);
        out.i32s(place.voxel.to_array());
        out.u32s(
            [[place.direction as u8, layer, low, high], [x, y, plane.distance, 0]].map(u32::from_le_bytes),
        );
        rows.push(row);
    }
    for run in rows.chunks(RUN_ROWS) {
        let payload = row_files::encode(run, set, grid);
        out.u32(payload.len() as u32);
        out.0.extend(payload);
    }
    out.0
}

fn decode(payload: &[u8], set: &PatchSet, grid: &Grid) -> Option<Vec<BakeReceiver>> {
    let mut reader = Reader(payload);
    let count = reader.count(PLACE_BYTES)?;
    let place = |reader: &mut Reader<'_>| {
        let voxel = VoxelCoord::from_array(reader.i32s()?);
        let [direction, layer, low, high] = reader.u32()?.to_le_bytes();
        let [x, y, distance, _] = reader.u32()?.to_le_bytes();
        let direction = Direction::from_index(direction)?;
        let (index, plane) = (u16::from_le_bytes([low, high]), SurfacePlane { normal: [x, y], distance });
        Some(ReceiverPlace { voxel, direction, detail: Some(DetailVoxel { index, layer, plane }) })
    };
    let places = (0..count).map(|_| place(&mut reader)).collect::<Option<Vec<_>>>()?;
    let mut rows: Vec<RawRow> = Vec::with_capacity(count);
    for run in places.chunks(RUN_ROWS) {
        let bytes = reader.u32()? as usize;
        let (part, rest) = reader.0.split_at_checked(bytes)?;
        reader.0 = rest;
        rows.extend(row_files::decode(part, run.len(), set, grid)?.0);
    }
    let receivers = places.into_iter().zip(rows).map(|(place, row)| BakeReceiver { place, row });
    reader.is_empty().then(|| receivers.collect())
}
