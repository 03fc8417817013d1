//! Light of receivers: those nearest to one session's camera, in the air and on surfaces (detail), gathered from the
//! resident patches.
//!
//! A receiver holds no slot. Its irradiance is one sparse gather over what leaves the resident patches
//! (`B = E + rho I`), plus the sky its row sees; for columns of the air that hold no slot their coarse parents stand in, as they
//! do for patches. Detail stands for parts of a patch: it speaks only where its patch is resident,
//! and has as much light from afar, for its far share, as that has. Whenever the light of the patches has changed all receivers are out of date; a tick gathers as many as its
//! budget allows, those whose turn was longest ago first and among equals the nearest. Where a device gathers
//! ([`crate::air_device`]) it takes all of them at once, and their light is told when it comes. How a row becomes light is [`crate::air_light`]'s business.

use crate::air_device::AirDevice;
use crate::air_light::{RowSources, Segment, Teller};
use crate::chunks::ChunkTable;
use crate::far::FarSenders;
use crate::local_set::LocalSet;
use crate::{EngineConfig, PatchLight};
use earthshine_radiosity::receivers::ReceiverLight;
use earthshine_world::lineage::Lineage;
use earthshine_world::{Chunk, ChunkId, Grid, LightRig, ReceiverPlace, Vec3, VoxelCoord};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// How far the focus moves before other voxels are chosen, in voxels.
const STEP_VOXELS: f32 = 0.5;

/// The receivers of one voxel.
#[derive(Debug)]
pub(crate) struct AirVoxel {
    pub(crate) chunk: Arc<Chunk>,
    pub(crate) lineage: Arc<Lineage>,
    /// Rows of its receivers in the chunk.
    pub(crate) rows: Range<usize>,
    /// Generation of the patches' light that `lights` were gathered from; 0 for none yet.
    lit: u64,
    /// Of its air, those that know enough, by direction.
    lights: Vec<PatchLight>,
    /// Of its surfaces, by direction, detail voxel and layer, with the coordinates of those.
    details: Vec<PatchLight>,
    /// Whether detail voxels are told of at all.
    pub(crate) has_detail: bool,
}

/// Names a voxel's receivers: their chunk, and the first of their rows.
pub(crate) type AirKey = (ChunkId, usize);

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
    device: AirDevice,
}

/// Rows that a tick gathered.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct RowsSpent {
    /// On the CPU.
    pub(crate) here: u32,
    /// Handed to a device.
    pub(crate) elsewhere: u32,
}

impl AirVoxel {
    /// Takes light gathered from that of generation `lit`. Returns whether it is another.
    fn take(&mut self, (lights, details): (Vec<PatchLight>, Vec<PatchLight>), lit: u64) -> bool {
        let is_new = lights != self.lights || details != self.details;
        (self.lights, self.details, self.lit) = (lights, details, lit);
        is_new
    }
}

struct Near<'a> {
    chunk: &'a Arc<Chunk>,
    /// Squared distance as bits: they order like the number, which is never negative.
    distance: u32,
    key: AirKey,
    end: usize,
    voxel: VoxelCoord,
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
        let mut device = std::mem::take(&mut self.device);
        device.forget();
        *self = Self { generation: self.generation, has_news: true, device, ..Self::default() };
    }

    /// Voxels whose light is out of date.
    pub(crate) fn stale_count(&self) -> usize {
        self.stale
    }

    /// Voxels told of.
    pub(crate) fn len(&self) -> usize {
        self.voxels.len()
    }

    /// Has `gatherer` gather from now on, as far as that can; the CPU does the rest.
    pub(crate) fn gather_by(&mut self, gatherer: Box<dyn ReceiverLight>) {
        self.device = AirDevice::new(gatherer);
    }

    /// Takes what a device has gathered, and has it gather all that is out of date. Where there is none: gathers from `local`,
    /// and from what stands for patches beyond it, until `rows_max` rows are spent, one voxel at least.
    pub(crate) fn gather(
        &mut self,
        local: &LocalSet,
        mut far: FarSenders<'_>,
        rig: &LightRig,
        rows_max: u32,
    ) -> RowsSpent {
        let Some(grid) = self.grid else { return RowsSpent::default() };
        self.take_arrived(local, grid);
        if self.stale == 0 {
            return RowsSpent::default();
        }
        let turn = self.turn();
        let Self { voxels, generation, device, .. } = self;
        match device.hand_over(voxels, &turn, *generation, local, &mut far, rig) {
            Some(elsewhere) => RowsSpent { here: 0, elsewhere },
            None => {
                let sources = RowSources::new(local, rig, far);
                let here = self.gather_here(&turn, sources, &Teller::new(local, self.detail, grid), rows_max);
                RowsSpent { here, elsewhere: 0 }
            }
        }
    }

    /// What is out of date: those whose turn was longest ago first, and among equals the nearest.
    fn turn(&self) -> Vec<AirKey> {
        let mut turn: Vec<(u64, usize)> = (0..self.nearest_first.len())
            .map(|place| (self.voxels[&self.nearest_first[place]].lit, place))
            .filter(|&(lit, _)| lit < self.generation)
            .collect();
        turn.sort_unstable();
        turn.into_iter().map(|(_, place)| self.nearest_first[place]).collect()
    }

    fn gather_here(
        &mut self,
        turn: &[AirKey],
        mut sources: RowSources<'_>,
        teller: &Teller<'_>,
        rows_max: u32,
    ) -> u32 {
        let mut spent = 0u32;
        let mut chunks: BTreeMap<ChunkId, Vec<Segment<'_>>> = BTreeMap::new();
        for key in turn {
            let voxel = self.voxels.get_mut(key).expect("a planned voxel is there");
            let cost = u32::try_from(voxel.rows.len()).unwrap_or(u32::MAX);
            if spent > 0 && spent.saturating_add(cost) > rows_max {
                break;
            }
            let segments = chunks.entry(key.0).or_insert_with(|| sources.segments(voxel));
            let told =
                teller.tell(voxel, |row, near| sources.gather(&voxel.chunk, row, segments, near.as_ref()));
            self.has_news |= voxel.take(told, self.generation);
            spent = spent.saturating_add(cost);
            self.stale -= 1;
        }
        spent
    }

    /// Tells what a device has gathered of voxels that are still planned.
    fn take_arrived(&mut self, local: &LocalSet, grid: Grid) {
        let Some((asked, sums)) = self.device.take() else { return };
        let teller = Teller::new(local, self.detail, grid);
        let mut rest = &sums[..];
        for (key, chunk) in asked.voxels {
            let run = chunk.receivers.places[key.1..].chunk_by(|a, b| a.voxel == b.voxel).next();
            let (own, others) = rest.split_at(run.map_or(0, <[_]>::len));
            rest = others;
            if let Some(voxel) = self.voxels.get_mut(&key).filter(|voxel| Arc::ptr_eq(&voxel.chunk, &chunk)) {
                let told = teller.tell_sums(voxel, own);
                self.has_news |= voxel.take(told, asked.generation);
            }
        }
        self.stale = self.stale_now();
    }

    /// Light on surfaces by detail voxel, ascending by detail voxel (x, y, z), then direction, then layer.
    pub(crate) fn details(&self) -> Vec<PatchLight> {
        let mut details: Vec<_> =
            self.voxels.values().flat_map(|voxel| voxel.details.iter().copied()).collect();
        details.sort_unstable_by_key(|light| (light.voxel.to_array(), light.direction, light.layer));
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

/// How many of `rows` are of surfaces, those in one detail voxel counted once a direction: each further layer is told in a delta of
/// its own.
fn detail_count(chunk: &Chunk, rows: Range<usize>) -> usize {
    let is_first = |place: &&ReceiverPlace| place.detail.is_some_and(|detail| detail.layer == 0);
    chunk.receivers.places[rows].iter().filter(is_first).count()
}
