//! Light of receivers: those nearest to one session's camera, in the air and on surfaces (detail), gathered from the
//! resident patches.
//!
//! A receiver holds no slot. Its irradiance is one sparse gather over what leaves the resident patches
//! (`B = E + rho I`), plus the sky its row sees; for columns of the air that hold no slot their coarse parents stand in, as they
//! do for patches. Detail stands for parts of a patch: it speaks only where its patch is resident,
//! and has as much light from afar, for its far share, as that has. Whenever the light of the patches has changed all receivers are out of date; a tick gathers as many as its
//! budget allows, those whose turn was longest ago first and among equals the nearest.

use crate::chunks::ChunkTable;
use crate::far::FarSenders;
use crate::local_set::{LocalSet, Resident};
use crate::slots::{FREE, parts_of_row};
use crate::{EngineConfig, PatchLight};
use earthshine_light::{NEAR_SHARE_MIN, NearPatch, Viewer};
use earthshine_world::lineage::Lineage;
use earthshine_world::{
    Chunk, ChunkId, DetailVoxel, Direction, Grid, LightRig, Patch, ReceiverPlace, Rgb, Vec3, Vec4, VoxelCoord,
};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// A receiver that rests on less than this share of its row, what coarse levels bring included, says nothing: half of a room is not its light.
const KNOWN_SHARE_MIN: f32 = 0.5;

/// How far the focus moves before other voxels are chosen, in voxels.
const STEP_VOXELS: f32 = 0.5;

/// The receivers of one voxel.
#[derive(Debug)]
struct AirVoxel {
    chunk: Arc<Chunk>,
    lineage: Arc<Lineage>,
    /// Rows of its receivers in the chunk.
    rows: Range<usize>,
    /// Generation of the patches' light that `lights` were gathered from; 0 for none yet.
    lit: u64,
    /// Of its air, those that know enough, by direction.
    lights: Vec<PatchLight>,
    /// Of its surfaces, by direction and detail voxel, with the coordinates of those.
    details: Vec<PatchLight>,
    /// Whether detail voxels are told of at all.
    has_detail: bool,
}

/// Names a voxel's receivers: their chunk, and the first of their rows.
type AirKey = (ChunkId, usize);

/// The receivers that one session is told of.
#[derive(Debug, Default)]
pub(crate) struct AirSet {
    voxels: BTreeMap<AirKey, AirVoxel>,
    /// Keys of all voxels, nearest first.
    nearest_first: Vec<AirKey>,
    /// Keys of all voxels, ascending by voxel (x, y, z).
    by_place: Vec<AirKey>,
    /// Counts changes of the patches' light.
    generation: u64,
    stale: usize,
    /// Detail voxels along a voxel's edge, and voxels.
    detail: u32,
    grid: Option<Grid>,
    /// Whether [`Self::lights`] or [`Self::details`] may have changed after it was asked about.
    has_news: bool,
    /// Where the voxels were chosen from: the focus, and the chunks.
    planned: Option<(Vec3, Vec<Arc<Chunk>>)>,
}

struct Near<'a> {
    chunk: &'a Arc<Chunk>,
    /// Squared distance as bits: they order like the number, which is never negative.
    distance: u32,
    key: AirKey,
    end: usize,
    voxel: VoxelCoord,
}

/// One segment of a chunk's rows.
struct Segment<'a> {
    /// By patch, or none.
    slots: &'a [u32],
    /// Where what stands for its patches is listed.
    senders: usize,
}

/// What receivers gather from.
struct Sources<'a> {
    local: &'a LocalSet,
    rig: &'a LightRig,
    /// By slot, lm/m2.
    exitance: Vec<Rgb>,
    /// Slots of patches by place, where there is detail.
    by_place: BTreeMap<([i32; 3], Direction), u32>,
    /// Detail voxels along a voxel's edge, and voxels.
    detail: u32,
    grid: Grid,
    /// Whether any patch has light that differs between its points.
    has_near: bool,
}

/// Detail voxels that a session is told of, at most: those of the voxels nearest to the camera.
pub(crate) const DETAIL_VOXELS_MAX: usize = EngineConfig::DETAIL_VOXELS_LIMIT as usize;

impl AirSet {
    /// Chooses the `voxels_max` nearest voxels with receivers of `chunks` (wanted, in memory). What stays keeps its light.
    ///
    /// It follows the focus in steps of [`STEP_VOXELS`]: in between nothing is done.
    pub(crate) fn replan(
        &mut self,
        focus: Vec3,
        chunks: &[&Arc<Chunk>],
        table: &ChunkTable,
        voxels_max: usize,
    ) {
        let step_m = STEP_VOXELS * table.levels()[0].grid.voxel_edge_m;
        let is_same = |planned: &[Arc<Chunk>]| {
            planned.len() == chunks.len() && planned.iter().zip(chunks).all(|(a, b)| Arc::ptr_eq(a, b))
        };
        let is_good = |(at, from): &(Vec3, Vec<Arc<Chunk>>)| at.distance(focus) < step_m && is_same(from);
        if self.planned.as_ref().is_some_and(is_good) {
            return;
        }
        self.planned = Some((focus, chunks.iter().map(|&chunk| Arc::clone(chunk)).collect()));
        let mut near = nearest(focus, chunks, table, voxels_max);
        near.sort_unstable_by_key(|candidate| (candidate.distance, candidate.key));
        self.detail = table.detail();
        self.grid = Some(table.levels()[0].grid);
        let mut before = std::mem::take(&mut self.voxels);
        let mut details = 0;
        for candidate in &near {
            let rows = candidate.key.1..candidate.end;
            details += detail_count(candidate.chunk, rows.clone());
            let has_detail = details <= DETAIL_VOXELS_MAX;
            let kept = before
                .remove(&candidate.key)
                .filter(|kept| Arc::ptr_eq(&kept.chunk, candidate.chunk) && kept.has_detail == has_detail);
            let chunk = || Arc::clone(candidate.chunk);
            let (lights, details) = (Vec::new(), Vec::new());
            let lineage =
                || table.tile(candidate.key.0).map(|tile| Arc::clone(&tile.lineage)).unwrap_or_default();
            let fresh =
                || AirVoxel { chunk: chunk(), lineage: lineage(), rows, lit: 0, lights, details, has_detail };
            self.voxels.insert(candidate.key, kept.unwrap_or_else(fresh));
        }
        self.nearest_first = near.iter().map(|candidate| candidate.key).collect();
        near.sort_unstable_by_key(|candidate| candidate.voxel.to_array());
        self.by_place = near.iter().map(|candidate| candidate.key).collect();
        self.stale = self.stale_now();
        self.has_news |= before.values().any(|gone| !(gone.lights.is_empty() && gone.details.is_empty()));
    }

    /// Whether its light may have changed since this was asked before.
    pub(crate) fn take_news(&mut self) -> bool {
        std::mem::take(&mut self.has_news)
    }

    /// The patches' light has changed.
    pub(crate) fn outdate(&mut self) {
        self.generation += 1;
        self.stale = self.voxels.len();
    }

    /// Forgets all light: the patches it rests on are gone.
    pub(crate) fn clear(&mut self) {
        *self = Self { generation: self.generation, has_news: true, ..Self::default() };
    }

    /// Voxels whose light is out of date.
    pub(crate) fn stale_count(&self) -> usize {
        self.stale
    }

    /// Voxels told of.
    pub(crate) fn len(&self) -> usize {
        self.voxels.len()
    }

    /// Gathers from `local`, and from what stands for patches beyond it, until `rows_max` rows are spent, one voxel at least.
    /// Returns the rows spent.
    pub(crate) fn gather(
        &mut self,
        local: &LocalSet,
        mut far: FarSenders<'_>,
        rig: &LightRig,
        rows_max: u32,
    ) -> u32 {
        if self.stale == 0 {
            return 0;
        }
        let Some(grid) = self.grid else { return 0 };
        let sources = Sources::new(local, rig, self.detail, grid);
        let mut turn: Vec<(u64, usize)> = (0..self.nearest_first.len())
            .map(|place| (self.voxels[&self.nearest_first[place]].lit, place))
            .filter(|&(lit, _)| lit < self.generation)
            .collect();
        turn.sort_unstable();
        let mut spent = 0u32;
        let mut chunks: BTreeMap<ChunkId, Vec<Segment<'_>>> = BTreeMap::new();
        for (_, place) in turn {
            let voxel = self.voxels.get_mut(&self.nearest_first[place]).expect("a planned voxel is there");
            let cost = u32::try_from(voxel.rows.len()).unwrap_or(u32::MAX);
            if spent > 0 && spent.saturating_add(cost) > rows_max {
                break;
            }
            let (chunk, lineage) = (&voxel.chunk, &voxel.lineage);
            let segments = chunks.entry(chunk.id).or_insert_with(|| {
                let slots = local.segment_slots(&chunk.receivers.rows);
                let ids = chunk.receivers.rows.segments.iter();
                ids.zip(slots)
                    .map(|(&id, slots)| Segment { slots, senders: far.place(id, lineage) })
                    .collect()
            });
            let (lights, details) = sources.gathered(voxel, segments, &far);
            self.has_news |= lights != voxel.lights || details != voxel.details;
            (voxel.lights, voxel.details) = (lights, details);
            voxel.lit = self.generation;
            spent = spent.saturating_add(cost);
            self.stale -= 1;
        }
        spent
    }

    /// Light on surfaces by detail voxel, ascending by detail voxel (x, y, z), then direction.
    pub(crate) fn details(&self) -> Vec<PatchLight> {
        let mut details: Vec<_> =
            self.voxels.values().flat_map(|voxel| voxel.details.iter().copied()).collect();
        details.sort_unstable_by_key(|light| (light.voxel.to_array(), light.direction));
        details
    }

    /// Light of all receivers in the air that know enough, ascending by voxel (x, y, z), then direction.
    pub(crate) fn lights(&self) -> Vec<PatchLight> {
        self.by_place.iter().flat_map(|key| self.voxels[key].lights.iter().copied()).collect()
    }

    /// Whether what is counted is what is there.
    pub(crate) fn is_counted(&self) -> bool {
        let lengths = [self.nearest_first.len(), self.by_place.len()];
        lengths == [self.voxels.len(); 2] && self.stale == self.stale_now()
    }

    fn stale_now(&self) -> usize {
        self.voxels.values().filter(|voxel| voxel.lit < self.generation).count()
    }
}

/// The nearest voxels with receivers, in no order; chunks that lie too far away are not looked into.
fn nearest<'a>(
    focus: Vec3,
    chunks: &[&'a Arc<Chunk>],
    table: &ChunkTable,
    voxels_max: usize,
) -> Vec<Near<'a>> {
    let grid = &table.levels()[0].grid;
    let mut by_distance: Vec<(u32, &Arc<Chunk>)> = chunks
        .iter()
        .map(|&chunk| (grid.chunk_bounds(chunk.id.coord).distance(focus).powi(2).to_bits(), chunk))
        .collect();
    by_distance.sort_unstable_by_key(|&(distance, chunk)| (distance, chunk.id));
    let mut near: Vec<Near<'_>> = Vec::new();
    let mut farthest = u32::MAX;
    for (distance, chunk) in by_distance {
        if distance > farthest || voxels_max == 0 {
            break;
        }
        let mut first = 0;
        for run in chunk.receivers.places.chunk_by(|a, b| a.voxel == b.voxel) {
            let voxel = run[0].voxel;
            let distance = grid.voxel_centre(voxel).distance_squared(focus).to_bits();
            near.push(Near { chunk, distance, key: (chunk.id, first), end: first + run.len(), voxel });
            first += run.len();
        }
        if near.len() > voxels_max {
            near.select_nth_unstable_by_key(voxels_max, |candidate| (candidate.distance, candidate.key));
            near.truncate(voxels_max);
            farthest = near.iter().map(|candidate| candidate.distance).max().unwrap_or(0);
        }
    }
    near
}

/// How many of `rows` are of surfaces.
fn detail_count(chunk: &Chunk, rows: Range<usize>) -> usize {
    chunk.receivers.places[rows].iter().filter(|place| place.detail.is_some()).count()
}

impl<'a> Sources<'a> {
    fn new(local: &'a LocalSet, rig: &'a LightRig, detail: u32, grid: Grid) -> Self {
        let place = |(slot, resident): (u32, &Resident)| {
            ((resident.patch.voxel.to_array(), resident.patch.direction), slot)
        };
        let by_place = if detail > 1 { local.iter().map(place).collect() } else { BTreeMap::new() };
        let has_near = detail > 1 && local.iter().any(|(_, resident)| resident.light.on_points().is_some());
        Self { local, rig, exitance: local.exitances(), by_place, detail, grid, has_near }
    }

    /// Light of the receivers of `voxel`, of its air and of its detail voxels.
    fn gathered(
        &self,
        voxel: &AirVoxel,
        segments: &[Segment<'_>],
        far: &FarSenders<'_>,
    ) -> (Vec<PatchLight>, Vec<PatchLight>) {
        let (mut lights, mut details) = (Vec::new(), Vec::new());
        for row in voxel.rows.clone() {
            let place = voxel.chunk.receivers.places[row];
            let Some(detail) = place.detail else {
                let (light, far_light) = self.light(&voxel.chunk, row, segments, far, None);
                let light = PatchLight {
                    irradiance: finite(light.irradiance + far_light.truncate()),
                    fed_share: far_light.w.clamp(0.0, 1.0),
                    ..light
                };
                lights.extend((light.known_share + light.fed_share >= KNOWN_SHARE_MIN).then_some(light));
                continue;
            };
            let slot = self.by_place.get(&(place.voxel.to_array(), place.direction));
            let Some(&slot) = slot.filter(|_| voxel.has_detail) else { continue };
            let resident = self.local.resident(slot);
            let viewer = self.has_near.then(|| self.viewer(&place, detail, resident));
            let light = fed_as(resident, self.light(&voxel.chunk, row, segments, far, viewer.as_ref()).0);
            let (voxel, plane_offset) = (detail.coord(light.voxel, self.detail), Some(detail.plane_offset()));
            details.push(PatchLight { voxel, plane_offset, ..light });
        }
        (lights, details)
    }

    /// The surface in part `detail` of `resident`, as it looks out.
    fn viewer(&self, place: &ReceiverPlace, detail: DetailVoxel, resident: &Resident) -> Viewer {
        let own = self.local.chunk_of(resident.id).points_of(&resident.patch);
        Viewer::new(place, detail, self.detail, &self.grid, own)
    }

    /// By how much what `viewer` sees of the patch in `slot` is brighter than the whole of it, lm/m2.
    fn excess(&self, viewer: &Viewer, slot: u32) -> Rgb {
        let resident = self.local.resident(slot);
        let Some((mean, irradiance)) = resident.light.on_points() else { return Rgb::ZERO };
        let points = self.local.chunk_of(resident.id).points_of(&resident.patch);
        let seen = viewer.sees(NearPatch { points, irradiance });
        let reflectance = resident.patch.reflectance.min(Rgb::splat(Patch::REFLECTANCE_MAX));
        seen.map_or(Rgb::ZERO, |seen| reflectance * (seen - mean))
    }

    /// Light of the receiver in row `row`, without that of far columns; and that, with how much of the row it stands for.
    /// A `viewer` tells parts of patches near by apart.
    fn light(
        &self,
        chunk: &Chunk,
        row: usize,
        segments: &[Segment<'_>],
        far_senders: &FarSenders<'_>,
        viewer: Option<&Viewer>,
    ) -> (PatchLight, Vec4) {
        let rows = &chunk.receivers.rows;
        let (mut resident, mut far) = (0.0f64, 0.0f64);
        let (mut irradiance, mut far_light) = (Rgb::ZERO, Vec4::ZERO);
        for (column, share) in rows.row(row) {
            let (segment, patch) = (&segments[usize::from(column.segment)], usize::from(column.local));
            match segment.slots.get(patch) {
                Some(&slot) if slot != FREE => {
                    resident += f64::from(share);
                    irradiance += share * self.exitance[slot as usize];
                    if let Some(viewer) = viewer.filter(|_| share >= NEAR_SHARE_MIN) {
                        irradiance += share * self.excess(viewer, slot);
                    }
                }
                _ => {
                    far += f64::from(share);
                    far_light += share * far_senders.sent(segment.senders, patch);
                }
            }
        }
        let parts = parts_of_row(rows, row, resident, far);
        let sky = self.rig.sky.irradiance(&rows.sky_shares[row]);
        let place = chunk.receivers.places[row];
        let light = PatchLight {
            voxel: place.voxel,
            direction: place.direction,
            irradiance: finite(irradiance + sky),
            sky_irradiance: finite(sky),
            plane_offset: None,
            known_share: parts.known(),
            far_share: parts.far.clamp(0.0, 1.0),
            fed_share: 0.0,
            staleness: 0,
        };
        (light, far_light)
    }
}

/// `light` of a detail voxel with what comes from afar to the patch that it is part of, for its own far share.
fn fed_as(patch: &Resident, light: PatchLight) -> PatchLight {
    if patch.parts().far <= 0.0 {
        return light;
    }
    let ratio = light.far_share / patch.parts().far;
    PatchLight {
        irradiance: finite(light.irradiance + patch.light.far_irradiance * ratio),
        fed_share: (patch.fed_share * ratio).clamp(0.0, light.far_share),
        ..light
    }
}

/// Light that an `f32` cannot carry is as bright as it can be.
fn finite(light: Rgb) -> Rgb {
    light.max(Rgb::ZERO).min(Rgb::splat(f32::MAX))
}
