//! Detail: receivers on surfaces, in parts of voxels.
//!
//! Each voxel is cut in detail voxels, half or a quarter of its edge. What faces one direction in a detail voxel, of the
//! samples that the voxel's patch consists of, gets a row of its own, with patches for columns. It only receives: what
//! patches exchange stays as it is, so that detail costs neither slots nor bounces. Light is read where it falls, not as
//! a voxel's mean.
//!
//! Few rays find a lamp by chance. So patches that emit cast theirs towards detail voxels too (`emitted`), and
//! both estimates are averaged by what they vary (`with_emitters`), layer by layer. Long rows are thinned as those in the air are.

use crate::content::has_emitters;
use crate::counted_rows::{RayPlan, RowInquiry};
use crate::crevices::Crevices;
use crate::detail_exposure;
use crate::emitted::{FromEmitter, is_plain};
use crate::estimator::emits;
use crate::inquiry::{Inquiry, Question};
use crate::layers::{Layers, layers_of};
use crate::patches::{BakePatch, PatchSet};
use crate::pieces::Pieces;
use crate::receivers::thin;
use crate::rows::{RawRow, RowCaster};
use crate::sample::{SurfaceSample, voxel_of};
use crate::spread::Spread;
use earthshine_tiles::BakeParameters;
use earthshine_trace::ends::RunEnds;
use earthshine_world::random::{Purpose, hash, unit_f32};
use earthshine_world::{DetailVoxel, Direction, Patch, ReceiverPlace, SurfacePlane, Vec3, VoxelCoord};
use glam::IVec3;
use xxhash_rust::xxh3::xxh3_64;

/// The detail voxel that a place on a surface belongs to, in the grid of detail voxels: one of `voxel`, even if the place
/// lies a hair outside of it.
pub(crate) fn detail_voxel_of(
    voxel: VoxelCoord,
    position: Vec3,
    normal: Vec3,
    parameters: &BakeParameters,
) -> VoxelCoord {
    let detail = parameters.detail.cast_signed();
    let low = voxel * detail;
    let at = voxel_of(position, normal, parameters.grid.voxel_edge_m / detail as f32);
    at.clamp(low, low + detail - 1)
}

/// A number of a direction in a detail voxel within its chunk.
pub(crate) fn detail_id(at: VoxelCoord, direction: Direction, parameters: &BakeParameters) -> u32 {
    let edge = (parameters.grid.chunk_edge_voxels * parameters.detail).cast_signed();
    let at = at.rem_euclid(IVec3::splat(edge));
    (((at.x * edge + at.y) * edge + at.z) * 6).cast_unsigned() + direction.index() as u32
}

/// Traces the detail of one chunk.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DetailBake<'a> {
    /// Casts rays that begin on the chunk's surfaces and end on patches.
    pub(crate) caster: RowCaster<'a>,
    /// Rays of an emitter towards detail voxels.
    pub(crate) emitter_rays: u32,
    /// What patches that emit see of the chunk, ascending by detail voxel, then patch.
    pub(crate) emitted: &'a [FromEmitter],
    /// Places of the chunk that patches leave out.
    pub(crate) crevices: &'a Crevices,
}

/// What a chunk's surfaces make up in its detail voxels.
#[derive(Debug)]
pub(crate) struct ChunkDetail {
    /// In detail voxels.
    pub(crate) samples: Vec<SurfaceSample>,
    /// Changes with their exposures, with what places in crevices count, and with their layers: rays decided some of them.
    pub(crate) exposures: u64,
    pub(crate) crevices: Crevices,
    /// Ascending by place.
    pub(crate) parts: Vec<DetailPart>,
    /// Rays cast to find walls.
    pub(crate) wall_rays: u64,
}

/// A layer of what faces one direction in a detail voxel: a receiver.
#[derive(Debug)]
pub(crate) struct DetailPart {
    pub(crate) place: ReceiverPlace,
    pub(crate) part: BakePatch,
    /// `None` for the only layer, where its pieces are [plain](is_plain): it has all of these in its detail voxel.
    pieces: Option<Pieces>,
}

/// A part that asks a device for the ends of its rays.
#[derive(Debug)]
pub(crate) struct PartInquiry<'a> {
    bake: DetailBake<'a>,
    of: &'a DetailPart,
    row: RowInquiry<'a>,
}

impl Inquiry for PartInquiry<'_> {
    type Made = RawRow;

    fn ray_count(&self) -> usize {
        self.row.ray_count()
    }

    fn ask(&mut self) -> Question {
        self.row.ask()
    }

    fn hear(&mut self, ends: &[RunEnds]) -> Option<RawRow> {
        self.row.hear(ends).map(|row| self.bake.finished(row, self.of))
    }
}

impl<'a> DetailBake<'a> {
    /// The receivers of `chunk`, without rows.
    pub(crate) fn parts(&self, chunk: [i32; 3]) -> ChunkDetail {
        let parameters = self.caster.parameters;
        let is_own = |sample: &&SurfaceSample| parameters.grid.chunk_of(sample.voxel).to_array() == chunk;
        let in_detail = |sample: &SurfaceSample| {
            let voxel = detail_voxel_of(sample.voxel, sample.position, sample.normal, parameters);
            SurfaceSample { voxel, ..*sample }
        };
        let own: Vec<&SurfaceSample> = self.caster.samples.iter().filter(is_own).collect();
        let crevices = Crevices::of(&own, parameters);
        let mut samples: Vec<SurfaceSample> = own.into_iter().map(in_detail).collect();
        detail_exposure::expose(&mut samples, &self.caster);
        // As what is buried absorbs: where paths cannot be trusted, nothing hangs on them.
        if !has_emitters(self.caster.tracer.scene()) {
            detail_exposure::reach(&mut samples, || self.caster.samples.iter().filter(is_own));
        }
        let of_detail = parameters.of_detail_voxels();
        let layers = layers_of(&samples, &of_detail, self.caster.tracer);
        let found = PatchSet::of_layers(&samples, &layers.of_samples, &of_detail);
        // Layers of one detail voxel and direction lie side by side.
        let is_same = |a: &BakePatch, b: &BakePatch| {
            (a.patch.voxel, a.patch.direction) == (b.patch.voxel, b.patch.direction)
        };
        let mut parts = Vec::new();
        for own in found.patches.chunk_by(is_same) {
            let pieces = Pieces::of(own, &samples, &self.caster);
            let part = |((layer, part), pieces): ((u8, &BakePatch), Option<Pieces>)| {
                let place = self.place(part, layer, &samples)?;
                let place = with_barriers(place, part, &layers);
                Some(DetailPart { place, part: part.clone(), pieces })
            };
            parts.extend((0..).zip(own).zip(pieces).filter_map(part));
        }
        parts.sort_by_key(|part| part.place.order());
        let exposures = samples.iter().map(|sample| sample.exposure.word());
        let words: Vec<f32> = exposures.chain(crevices.words().iter().copied()).collect();
        let hashes = [bytemuck::cast_slice(&words), layers.of_samples.as_flattened()].map(xxh3_64);
        let exposures = xxh3_64(bytemuck::bytes_of(&hashes));
        ChunkDetail { exposures, crevices, samples, parts, wall_rays: layers.rays }
    }

    /// The row of `of`, which is made of the caster's samples.
    pub(crate) fn row(&self, of: &DetailPart) -> RawRow {
        let spread = self.spread(of);
        let row = if self.is_beside_crevice(of) {
            self.row_in_crevice(of, &spread)
        } else {
            self.caster.cast(&of.part, &spread, 0..self.rays())
        };
        self.finished(row, of)
    }

    /// The same for a device to count the ends of.
    pub(crate) fn inquiry(&self, of: &'a DetailPart) -> PartInquiry<'a> {
        let (spread, plan) = (self.spread(of), RayPlan::Fixed(self.rays()));
        let row = RowInquiry { caster: self.caster, source: &of.part, spread, plan };
        PartInquiry { bake: *self, of, row }
    }

    pub(crate) fn rays(&self) -> u32 {
        self.caster.parameters.detail_rays
    }

    /// Other random numbers than those of the patch with the same coordinates.
    pub(crate) fn spread(&self, of: &DetailPart) -> Spread {
        let BakeParameters { seed, detail_rays, method, .. } = *self.caster.parameters;
        Spread::new(method.spread, detail_rays, seed, !of.part.key)
    }

    /// What becomes of the `row` that rays of `of` say: with what emitters say, and no longer than it may be.
    pub(crate) fn finished(&self, mut row: RawRow, of: &DetailPart) -> RawRow {
        let BakeParameters { seed, detail_columns, .. } = *self.caster.parameters;
        let emitted = emitted_to(self.emitted, of, &self.caster);
        self.with_emitters(&mut row, of.part.patch.area, &emitted);
        let draw = unit_f32(hash(seed, Purpose::ReceiverRay, !of.part.key, 0));
        thin(&mut row.entries, detail_columns as usize, draw, |patch| emits(self.caster.set, patch as usize));
        row
    }

    /// Averages what the row of a part of `area` m2 says of emitters with what they say of it, and scales the rest so that
    /// the sum stays one. A share `F` found by `n` rays has the variance `F / n`; one found from the other side by `N` rays
    /// and turned round has `F (A_emitter / A_part) / N`: the weights are `n` and `N A_part / A_emitter`.
    fn with_emitters(&self, row: &mut RawRow, area: f32, emitted: &[FromEmitter]) {
        let is_emitter = |entry: &(u32, f32)| emits(self.caster.set, entry.0 as usize);
        let own: Vec<(u32, f32)> = row.entries.iter().copied().filter(is_emitter).collect();
        if own.is_empty() && emitted.is_empty() {
            return;
        }
        let weight = |patch: u32| self.own_weight(area, patch);
        let turned = |from: &FromEmitter| (from.patch, from.share * self.area(from.patch) / area);
        let theirs: Vec<(u32, f32)> = emitted.iter().map(turned).collect();
        let mut merged = RawRow::default();
        merged.entries.extend(own.iter().map(|&(patch, share)| (patch, share * weight(patch))));
        merged.entries.extend(theirs.iter().map(|&(patch, share)| (patch, share * (1.0 - weight(patch)))));
        merged.merge();
        let sum = |entries: &[(u32, f32)]| entries.iter().map(|entry| entry.1).sum::<f32>();
        let (seen, before) = (sum(&merged.entries), sum(&own).min(1.0));
        let noise =
            merged.entries.iter().map(|&(patch, share)| share * weight(patch) / (1.0 - weight(patch)));
        let after = emitters_share(before, sum(&theirs), seen, noise.sum());
        merged.scale(after / seen.max(f32::MIN_POSITIVE));
        row.entries.retain(|entry| !is_emitter(entry));
        row.scale(if before < 1.0 { (1.0 - after) / (1.0 - before) } else { 0.0 });
        row.absorbed += if before < 1.0 { 0.0 } else { 1.0 - after };
        row.entries.extend(merged.entries);
        row.merge();
    }

    /// How much the own rays of a part count beside those of emitter `patch`.
    fn own_weight(&self, area: f32, patch: u32) -> f32 {
        let own = self.rays() as f32;
        let theirs = self.emitter_rays as f32 * area / self.area(patch);
        own / (own + theirs)
    }

    fn area(&self, patch: u32) -> f32 {
        self.caster.set.patches[patch as usize].patch.area
    }

    /// Where the receiver of `part`, made of `samples`, is; `None` where its voxel has no patch.
    fn place(&self, part: &BakePatch, layer: u8, samples: &[SurfaceSample]) -> Option<ReceiverPlace> {
        let parameters = self.caster.parameters;
        let detail = parameters.detail.cast_signed();
        let edge_m = parameters.grid.voxel_edge_m / detail as f32;
        let BakePatch { patch: Patch { voxel: coord, direction, centroid, .. }, .. } = *part;
        let voxel = coord.div_euclid(IVec3::splat(detail));
        let has_patch = self.caster.set.of_voxel(voxel)[direction.index()] != PatchSet::NONE;
        let normal = part.areas().map(|(sample, area)| samples[sample as usize].normal * area);
        let normal = normal.sum::<Vec3>().normalize_or(direction.vector());
        let from_middle = centroid / edge_m - (coord.as_vec3() + 0.5);
        let plane = SurfacePlane::new(normal, from_middle.dot(normal));
        let detail = Some(DetailVoxel::new(coord - voxel * detail, layer, plane));
        has_patch.then_some(ReceiverPlace { voxel, direction, detail })
    }
}

/// `place` of `part`, with what ends its layer.
fn with_barriers(place: ReceiverPlace, part: &BakePatch, layers: &Layers) -> ReceiverPlace {
    let Patch { voxel, direction, .. } = part.patch;
    // Layers that make no patch leave gaps in those of samples.
    let layer = layers.of_samples[part.samples[0].0 as usize][direction.index()];
    let barriers = layers.barriers(voxel, direction, layer);
    ReceiverPlace { detail: place.detail.map(|detail| DetailVoxel { barriers, ..detail }), ..place }
}

/// Of `emitted`: what is of the detail voxel, the direction and the pieces of `of`.
fn emitted_to(emitted: &[FromEmitter], of: &DetailPart, caster: &RowCaster<'_>) -> Vec<FromEmitter> {
    let id = detail_id(of.part.patch.voxel, of.part.patch.direction, caster.parameters);
    let first = emitted.partition_point(|from| from.detail < id);
    let of_voxel = emitted[first..].iter().take_while(|from| from.detail == id);
    let Some(pieces) = &of.pieces else {
        return of_voxel.filter(|from| is_plain(from.piece)).copied().collect();
    };
    let count = of_voxel.count();
    let by_emitter = emitted[first..first + count].chunk_by(|a, b| a.patch == b.patch);
    let of_emitter = |entries: &[FromEmitter]| -> Vec<FromEmitter> {
        let lit = pieces.lit_by(&caster.set.patches[entries[0].patch as usize].patch, caster);
        let own =
            |from: &FromEmitter| Some(FromEmitter { share: from.share * lit.share(from.piece)?, ..*from });
        entries.iter().filter_map(own).collect()
    };
    by_emitter.flat_map(of_emitter).collect()
}

/// What a row sees of all emitters, if its own rays say `own` and theirs say `theirs`, a first guess is `guess`, and the
/// variance of `theirs` times the number of own rays is `noise`. Own rays know that all shares add up to one, so the
/// variance of `own` vanishes where emitters are all there is.
fn emitters_share(own: f32, theirs: f32, guess: f32, noise: f32) -> f32 {
    const ROUNDS: usize = 4;
    (0..ROUNDS).fold(guess.min(1.0), |share, _| {
        let own_noise = share * (1.0 - share);
        let both = (own * noise + theirs * own_noise) / (noise + own_noise).max(f32::MIN_POSITIVE);
        both.clamp(0.0, 1.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_all_is_emitters_they_are_seen_whole() {
        assert!((emitters_share(1.0, 0.7, 0.85, 1.0) - 1.0).abs() < 0.02);
        // Few and small ones are better known from their side.
        assert!((emitters_share(0.0, 0.01, 0.008, 0.001) - 0.01).abs() < 0.002);
    }

    #[test]
    fn ids_tell_all_detail_voxels_of_a_chunk_apart() {
        let parameters = BakeParameters { detail: 2, ..BakeParameters::default() };
        let edge = (parameters.grid.chunk_edge_voxels * parameters.detail).cast_signed();
        let chunk = IVec3::new(-2, 0, 3) * edge;
        let all = (0..edge.pow(3)).map(|n| chunk + IVec3::new(n / edge / edge, n / edge % edge, n % edge));
        let mut ids: Vec<u32> = all
            .flat_map(|at| Direction::ALL.map(|direction| detail_id(at, direction, &parameters)))
            .collect();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), (edge.pow(3) * 6) as usize);
    }
}
