//! What patches that emit see of detail voxels: the other estimate of the light that lamps send there.
//!
//! One file a chunk with emitters, in parts that the chunks their rays end in can read on their own:
//!
//! │ sections │ section: chunk 3 x i32, entries u32 │ entry: emitter u32, detail voxel u32, piece u32, share f32 │
//!
//! Sections ascend by chunk, entries by emitter (its [`PatchSet::stable_id`]), then detail voxel ([`detail_id`]), then piece
//! ([`piece_of`]): layers of a detail voxel consist of pieces, and what an emitter sees of one it need not see of another. A
//! share is one of the emitter's rays.
//!
//! Places that patches leave out, behind a lamp, are lit by lamps as others are, and in a detail voxel something may stand for
//! them. So they are pieces of their own, as are those that emit: a part has the light of what it consists of, and a wall
//! beside a flame not what the flame throws on itself.

use crate::BakeError;
use crate::cells::Seen;
use crate::detail::{detail_id, detail_voxel_of};
use crate::estimator::{emits, emitter_factor};
use crate::eye::Eye;
use crate::inquiry::QUESTION_RAYS;
use crate::memory;
use crate::offload::Offload;
use crate::patches::PatchSet;
use crate::places::Place;
use crate::rows::{RAY_OFFSET, RowCaster};
use crate::sample::side_weights;
use crate::shard::{for_all, visits};
use crate::spread::Spread;
use crate::stages::{Known, Run};
use crate::tracing::caster;
use crate::words::{Reader, Writer};
use crate::work_folder::{Kind, Stamp};
use earthshine_scene::Scene;
use earthshine_tiles::{BakeMethod, BakeParameters};
use earthshine_trace::hemisphere::cosine_direction;
use earthshine_trace::{Hit, Query};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

const SECTION_BYTES: u64 = 16;
const ENTRY_BYTES: u64 = 16;

/// A share of an emitter's rays that ends in one detail voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FromEmitter {
    /// See [`detail_id`].
    pub(crate) detail: u32,
    /// See [`piece_of`].
    pub(crate) piece: u32,
    pub(crate) patch: u32,
    pub(crate) share: f32,
}

/// In the number of a piece: the back of a triangle, places that their patch leaves out, and places that emit.
const BACK: u32 = 1;
const LEFT_OUT: u32 = 2;
const EMITS: u32 = 4;

/// A number of a side of a triangle, and of what `place` on it is to the patches of `set`, that does not change with edits
/// elsewhere. Two that share a number matter only in one detail voxel.
pub(crate) fn piece_of(scene: &Scene, set: &PatchSet, place: &Place) -> u32 {
    let Place { side, voxel, position, emits, .. } = *place;
    let corners = xxh3_64(bytemuck::bytes_of(&scene.triangles[side as usize / 2]));
    let bit = |bit: u32, is_set: bool| if is_set { bit } else { 0 };
    (corners as u32 & !(BACK | LEFT_OUT | EMITS))
        | bit(BACK, side & 1 == 1)
        | bit(LEFT_OUT, set.hidden().contains(side, voxel, position))
        | bit(EMITS, emits)
}

/// Whether a patch stands for the places of `piece` and they do not emit: as nearly everywhere.
pub(crate) fn is_plain(piece: u32) -> bool {
    piece & (LEFT_OUT | EMITS) == 0
}

/// The files of all chunks with emitters.
#[derive(Debug, Default)]
pub(crate) struct EmittedFiles {
    files: BTreeMap<[i32; 3], FileIndex>,
    /// By chunk where rays end: the chunks that they come from.
    leading_to: BTreeMap<[i32; 3], Vec<[i32; 3]>>,
}

/// Where the parts of a file are.
#[derive(Debug, Default)]
struct FileIndex {
    /// Cells in its stamp.
    seen: usize,
    sections: BTreeMap<[i32; 3], Range<u64>>,
}

/// How many rays an emitter casts towards detail voxels: as many as for its own row.
pub(crate) fn emitter_rays(set: &PatchSet, parameters: &BakeParameters) -> u32 {
    parameters.rays_per_patch.saturating_mul(emitter_factor(set, parameters)).min(BakeMethod::RAYS_MAX)
}

impl EmittedFiles {
    /// Traces the emitters of all chunks, or finds what they see in the work folder; and how many rays that took.
    pub(crate) fn trace(run: &Run<'_>, known: &Known<'_>) -> Result<(Self, u64), BakeError> {
        let set = known.set;
        let rays = emitter_rays(set, run.parameters());
        let has_emitters = |range: &Range<u32>| range.clone().any(|patch| emits(set, patch as usize));
        let chunks: Vec<[i32; 3]> =
            set.chunks.iter().filter(|(_, range)| has_emitters(range)).map(|(&chunk, _)| chunk).collect();
        let key = xxh3_64(bytemuck::bytes_of(&[known.key, u64::from(rays)]));
        let done = for_all(&visits(run.options.shard, &chunks), |number| {
            let chunk = chunks[number];
            let now = Stamp { key, own: known.identities[&chunk], ..Stamp::default() };
            if let Some((stamp, payload)) = run.files.work.read(Kind::Emitted, 0, chunk)
                && stamp.staleness(&now, &known.cells).is_none()
                && let Some(index) = FileIndex::of(&payload, stamp.seen.len())
            {
                return Ok((chunk, index, 0));
            }
            let seen = Seen::nothing(&known.cells);
            let surfaces = known.source.of(chunk, set)?;
            let caster = caster(run, known, &surfaces, Eye::noting(known.tracer, &seen));
            let emitters: Vec<u32> =
                set.chunks[&chunk].clone().filter(|&patch| emits(set, patch as usize)).collect();
            let cast = emitters.len() as u64 * u64::from(rays);
            let payload = encode(&caster, known.offload, &emitters, rays);
            let stamp = Stamp { seen: seen.list(), ..now };
            run.files.work.write(Kind::Emitted, 0, chunk, &stamp, &payload)?;
            let index = FileIndex::of(&payload, stamp.seen.len()).ok_or(BakeError::WorkChanged { chunk })?;
            Ok((chunk, index, cast))
        })?;
        let (mut all, mut cast) = (Self::default(), 0);
        for (chunk, index, rays) in done {
            cast += rays;
            index.sections.keys().for_each(|&to| all.leading_to.entry(to).or_default().push(chunk));
            all.files.insert(chunk, index);
        }
        all.leading_to.values_mut().for_each(|from| from.sort_unstable());
        Ok((all, cast))
    }

    /// What emitters see of `chunk`, ascending by detail voxel, then patch; and a hash of it that does not change when
    /// patches elsewhere come or go.
    pub(crate) fn towards(
        &self,
        run: &Run<'_>,
        known: &Known<'_>,
        chunk: [i32; 3],
    ) -> Result<(Vec<FromEmitter>, u64), BakeError> {
        let (mut found, mut hash) = (Vec::new(), Xxh3Default::new());
        for &from in self.leading_to.get(&chunk).map_or(&[][..], Vec::as_slice) {
            let FileIndex { seen, sections } = &self.files[&from];
            let part = run.files.work.read_part(Kind::Emitted, from, *seen, sections[&chunk].clone())?;
            hash.update(bytemuck::bytes_of(&from));
            hash.update(&part);
            let mut reader = Reader(&part);
            while !reader.is_empty() {
                let mut entry = || Some((reader.u32()?, reader.u32()?, reader.u32()?, reader.f32()?));
                let known_entry = entry().and_then(|(id, detail, piece, share)| {
                    let id = u16::try_from(id).ok()?;
                    let patch = known.set.by_stable_id(from, id, &run.parameters().grid)?;
                    // Layers look at its middle.
                    hash.update(bytemuck::bytes_of(&known.set.patches[patch as usize].patch.centroid));
                    Some(FromEmitter { detail, piece, patch, share })
                });
                found.push(known_entry.ok_or(BakeError::WorkChanged { chunk: from })?);
            }
        }
        found.sort_by_key(|from| (from.detail, from.patch, from.piece));
        Ok((found, hash.digest()))
    }
}

/// Bytes that [`EmittedFiles::trace`] takes beside the patches of `set` and what makes them.
pub(crate) fn bytes(scene: &Scene, set: &PatchSet, parameters: &BakeParameters) -> u64 {
    let count = |range: &Range<u32>| range.clone().filter(|&patch| emits(set, patch as usize)).count() as u64;
    let emitters: Vec<u64> = set.chunks.values().map(count).collect();
    memory::of_emitters(scene, parameters, emitter_rays(set, parameters), emitters)
}

/// Of a file: emitter, detail voxel, piece, share.
type Entry = (u32, u32, u32, f32);

/// What one emitter sees: entries by chunk, both ascending.
type Entries = Vec<([i32; 3], Vec<Entry>)>;

/// The payload of the file of `caster`'s chunk.
fn encode(caster: &RowCaster<'_>, offload: &Offload<'_>, emitters: &[u32], rays: u32) -> Vec<u8> {
    let grid = &caster.parameters.grid;
    payload_of(emitters, |emitter| {
        let id = u32::from(caster.set.stable_id(emitter, grid));
        entries_of(id, shares_of(caster, offload, emitter, rays))
    })
}

/// The payload of what `emitters` see, by `seen`. A map of shares takes three times its entries, so only so many emitters as
/// there are threads are at work at once, and each leaves nothing but entries. The order is theirs, however many there are.
fn payload_of(emitters: &[u32], seen: impl Fn(u32) -> Entries + Sync) -> Vec<u8> {
    let mut sections: BTreeMap<[i32; 3], Vec<Vec<Entry>>> = BTreeMap::new();
    for batch in emitters.chunks(rayon::current_num_threads()) {
        let done: Vec<Entries> = batch.par_iter().map(|&emitter| seen(emitter)).collect();
        for (chunk, entries) in done.into_iter().flatten() {
            sections.entry(chunk).or_default().push(entries);
        }
    }
    let count: usize = sections.values().flatten().map(Vec::len).sum();
    let bytes = 4 + sections.len() * SECTION_BYTES as usize + count * ENTRY_BYTES as usize;
    let mut out = Writer(Vec::with_capacity(bytes));
    out.u32(sections.len() as u32);
    for (chunk, entries) in &sections {
        out.i32s(*chunk);
        out.u32(entries.iter().map(Vec::len).sum::<usize>() as u32);
    }
    for (id, detail, piece, share) in sections.into_values().flatten().flatten() {
        out.u32s([id, detail, piece]);
        out.f32s([share]);
    }
    out.0
}

/// `shares` of the emitter `id`, in lists that take no more than they hold.
fn entries_of(id: u32, shares: Shares) -> Entries {
    let all: Vec<_> = shares.into_iter().collect();
    let entry = |&((_, detail, piece), share): &(([i32; 3], u32, u32), f32)| (id, detail, piece, share);
    all.chunk_by(|before, after| before.0.0 == after.0.0)
        .map(|part| (part[0].0.0, part.iter().map(entry).collect()))
        .collect()
}

/// Shares by chunk, [`detail_id`] and [`piece_of`].
type Shares = BTreeMap<([i32; 3], u32, u32), f32>;

/// Where the rays of `emitter` end, by the device if there is one; what hits directions without a patch is left out, as no part
/// is there.
fn shares_of(caster: &RowCaster<'_>, offload: &Offload<'_>, emitter: u32, rays: u32) -> Shares {
    let source = caster.source(emitter);
    let BakeParameters { seed, method, grid, .. } = *caster.parameters;
    let spread = Spread::new(method.spread, rays, seed, !source.key);
    let query = |ray: u32| {
        let (u, v) = spread.pair(ray);
        let sample = &caster.samples[source.sample_at((ray as f32 + 0.5) / rays as f32) as usize];
        let direction = cosine_direction(sample.normal, u, v);
        let origin = sample.position + sample.normal * (RAY_OFFSET * grid.voxel_edge_m);
        Query { origin, direction, distance_max: f32::INFINITY }
    };
    let mut shares = Shares::new();
    for first in (0..rays).step_by(QUESTION_RAYS) {
        let queries: Vec<Query> = (first..rays).take(QUESTION_RAYS).map(query).collect();
        let triangles = offload.first(&queries);
        for (at, query) in queries.iter().enumerate() {
            let hit = match &triangles {
                Some(triangles) => {
                    caster.tracer.closest_named(query, triangles[at], || offload.note_returned(1))
                }
                None => caster.tracer.closest(query.origin, query.direction, query.distance_max),
            };
            if let Some(hit) = hit {
                add_shares(caster, query, &hit, rays, &mut shares);
            }
        }
    }
    shares
}

/// Adds the end of `query`, one of `rays`, at `hit`.
fn add_shares(caster: &RowCaster<'_>, query: &Query, hit: &Hit, rays: u32, shares: &mut Shares) {
    let (parameters, set) = (caster.parameters, caster.set);
    let place = caster.place(hit, query.origin + query.direction * hit.distance);
    let detail = detail_voxel_of(place.voxel, place.position, place.normal, parameters);
    let chunk = parameters.grid.chunk_of(place.voxel).to_array();
    let piece = piece_of(caster.tracer.tracer().scene(), set, &place);
    let patches = set.of_voxel(place.voxel);
    for (direction, weight) in side_weights(parameters.weights, place.normal) {
        if weight > 0.0 && patches[direction.index()] != PatchSet::NONE {
            let id = detail_id(detail, direction, parameters);
            *shares.entry((chunk, id, piece)).or_default() += weight / rays as f32;
        }
    }
}

impl FileIndex {
    /// Of a file with `payload` and `seen` cells in its stamp; `None` for a damaged one.
    fn of(payload: &[u8], seen: usize) -> Option<Self> {
        let mut reader = Reader(payload);
        let count = reader.count(SECTION_BYTES as usize)?;
        let mut at = 4 + count as u64 * SECTION_BYTES;
        let mut sections = BTreeMap::new();
        for _ in 0..count {
            let chunk = reader.i32s()?;
            let end = at + u64::from(reader.u32()?) * ENTRY_BYTES;
            sections.insert(chunk, at..end);
            at = end;
        }
        (at == payload.len() as u64).then_some(Self { seen, sections })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of emitter `id`: to two chunks, one of which all see.
    fn shares(id: u32) -> Shares {
        let own = [id.cast_signed() % 3, 0, 0];
        let to =
            |chunk: [i32; 3], detail: u32, piece: u32| ((chunk, detail, piece), (id + detail + piece) as f32);
        Shares::from([to(own, 7, 1), to([9, 0, -1], 4, 2), to(own, 7, 0), to(own, 2, 5)])
    }

    #[test]
    fn the_payload_does_not_hang_on_threads() {
        let emitters: Vec<u32> = (10..33).collect();
        let mut sections: BTreeMap<[i32; 3], Vec<Entry>> = BTreeMap::new();
        for &id in &emitters {
            for ((chunk, detail, piece), share) in shares(id) {
                sections.entry(chunk).or_default().push((id, detail, piece, share));
            }
        }
        let mut expected = Writer::default();
        expected.u32(sections.len() as u32);
        for (chunk, entries) in &sections {
            expected.i32s(*chunk);
            expected.u32(entries.len() as u32);
        }
        for (id, detail, piece, share) in sections.into_values().flatten() {
            expected.u32s([id, detail, piece]);
            expected.f32s([share]);
        }
        for threads in [1, 2, 5, 40] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let payload = pool.install(|| payload_of(&emitters, |id| entries_of(id, shares(id))));
            assert!(payload == expected.0, "{threads} threads");
            assert_eq!(FileIndex::of(&payload, 0).unwrap().sections.len(), 4);
        }
    }

    #[test]
    fn the_payload_of_none_is_empty() {
        let payload = payload_of(&[], |id| entries_of(id, Shares::new()));
        assert!(FileIndex::of(&payload, 0).unwrap().sections.is_empty());
    }
}
