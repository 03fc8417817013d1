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
use crate::air_light::{NearBy, RowSources, Segment, Teller};
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
    place: VoxelCoord,
    /// How many voxels are nearer.
    rank: u32,
    pub(crate) chunk: Arc<Chunk>,
    pub(crate) lineage: Arc<Lineage>,
    /// Rows of its receivers in the chunk.
    pub(crate) rows: Range<usize>,
    /// Generation of the patches' light that `lights` were gathered from; 0 for none yet.
    lit: u64,
    /// Of its air, those that know enough, by direction; of its surfaces, by direction, detail voxel and layer, with the
    /// coordinates of those.
    told: Told,
    /// Whether detail voxels are told of at all.
    pub(crate) has_detail: bool,
}

/// Names a voxel's receivers: their chunk, and the first of their rows.
pub(crate) type AirKey = (ChunkId, usize);

/// Light of receivers in the air and of detail, as a frame lists it.
#[derive(Debug, Default)]
pub(crate) struct Told {
    pub(crate) lights: Vec<PatchLight>,
    pub(crate) details: Vec<PatchLight>,
}

impl Told {
    fn clear(&mut self) {
        self.lights.clear();
        self.details.clear();
    }

    fn capacity(&self) -> usize {
        self.lights.capacity() + self.details.capacity()
    }
}

/// The receivers that one session is told of.
#[derive(Debug, Default)]
pub(crate) struct AirSet {
    /// Ascending by voxel (x, y, z).
    voxels: Vec<AirVoxel>,
    /// Lists of voxels that nobody chose any more, to be used again: [`LEFT_MAX`] at most, none of them longer than
    /// [`LEFT_ROOM_MAX`], or in time every voxel would have room for the detail of the richest.
    left: Vec<Told>,
    /// Room for what a tick tells.
    told: Told,
    /// Room for whose turn it is.
    turn: Vec<Turn>,
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
    pub(crate) fn key(&self) -> AirKey {
        (self.chunk.id, self.rows.start)
    }

    /// Takes light gathered from that of generation `lit`. Returns whether it is another.
    fn take(&mut self, told: &Told, lit: u64) -> bool {
        self.lit = lit;
        let take = |own: &mut Vec<PatchLight>, told: &[PatchLight]| {
            let is_new = own[..] != *told;
            if is_new {
                own.clear();
                own.extend_from_slice(told);
            }
            is_new
        };
        let has_lights = take(&mut self.told.lights, &told.lights);
        take(&mut self.told.details, &told.details) || has_lights
    }
}

/// A voxel whose light is out of date.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Turn {
    lit: u64,
    rank: u32,
    /// In the list of voxels.
    at: u32,
}

struct Near<'a> {
    chunk: &'a Arc<Chunk>,
    /// Squared distance as bits: they order like the number, which is never negative.
    distance: u32,
    key: AirKey,
    end: usize,
    voxel: VoxelCoord,
    /// How many are nearer, and whether its detail is told of; known once all are sorted.
    rank: u32,
    has_detail: bool,
}

impl Near<'_> {
    /// Whether `voxel` is this one, of the same tile.
    fn is_as(&self, voxel: &AirVoxel) -> bool {
        Arc::ptr_eq(&voxel.chunk, self.chunk)
            && voxel.rows.start == self.key.1
            && voxel.has_detail == self.has_detail
    }
}

/// Detail voxels that a session is told of, at most: those of the voxels nearest to the camera.
pub(crate) const DETAIL_VOXELS_MAX: usize = EngineConfig::DETAIL_VOXELS_LIMIT as usize;

/// Lists that are kept for other voxels, and lights that each has room for, at most.
const LEFT_MAX: usize = 1024;
const LEFT_ROOM_MAX: usize = 64;

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
        let mut details = 0;
        for (candidate, rank) in near.iter_mut().zip(0u32..) {
            candidate.rank = rank;
            details += detail_count(candidate.chunk, candidate.key.1..candidate.end);
            candidate.has_detail = details <= DETAIL_VOXELS_MAX;
        }
        near.sort_unstable_by_key(|candidate| candidate.voxel.to_array());
        self.choose(&near, table);
        self.stale = self.stale_now();
    }

    /// Makes the voxels of `near`, ascending, those that are told of.
    fn choose(&mut self, near: &[Near<'_>], table: &ChunkTable) {
        let mut chosen = Vec::with_capacity(near.len());
        let mut before = std::mem::take(&mut self.voxels).into_iter().peekable();
        for candidate in near {
            let place = candidate.voxel.to_array();
            while let Some(gone) = before.next_if(|voxel| voxel.place.to_array() < place) {
                self.let_go(gone);
            }
            match before.next_if(|voxel| voxel.place.to_array() == place) {
                Some(kept) if candidate.is_as(&kept) => {
                    chosen.push(AirVoxel { rank: candidate.rank, ..kept });
                }
                other => {
                    other.into_iter().for_each(|gone| self.let_go(gone));
                    chosen.push(self.fresh(candidate, table));
                }
            }
        }
        before.for_each(|gone| self.let_go(gone));
        self.voxels = chosen;
    }

    /// What it told is not to be told any more.
    fn let_go(&mut self, gone: AirVoxel) {
        self.has_news |= !(gone.told.lights.is_empty() && gone.told.details.is_empty());
        if self.left.len() < LEFT_MAX && gone.told.capacity() <= LEFT_ROOM_MAX {
            self.left.push(gone.told);
        }
    }

    fn fresh(&mut self, candidate: &Near<'_>, table: &ChunkTable) -> AirVoxel {
        let mut told = self.left.pop().unwrap_or_default();
        told.clear();
        let lineage = table.tile(candidate.key.0).map(|tile| Arc::clone(&tile.lineage)).unwrap_or_default();
        AirVoxel {
            place: candidate.voxel,
            rank: candidate.rank,
            chunk: Arc::clone(candidate.chunk),
            lineage,
            rows: candidate.key.1..candidate.end,
            lit: 0,
            told,
            has_detail: candidate.has_detail,
        }
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

    /// Memory of its voxels and their light, bytes.
    pub(crate) fn bytes(&self) -> usize {
        let told = self.voxels.iter().map(|voxel| &voxel.told).chain(&self.left);
        let lights: usize = told.chain([&self.told]).map(Told::capacity).sum();
        lights * size_of::<PatchLight>() + self.voxels.capacity() * size_of::<AirVoxel>()
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
        self.take_turns();
        let Self { voxels, generation, device, turn, .. } = self;
        let in_turn = turn.iter().map(|turn| &voxels[turn.at as usize]);
        match device.hand_over(voxels, in_turn, *generation, local, &mut far, rig) {
            Some(elsewhere) => RowsSpent { here: 0, elsewhere },
            None => {
                let sources = RowSources::new(local, rig, far);
                let here = self.gather_here(sources, &Teller::new(local, self.detail, grid), rows_max);
                RowsSpent { here, elsewhere: 0 }
            }
        }
    }

    /// Lists what is out of date: those whose turn was longest ago first, and among equals the nearest.
    fn take_turns(&mut self) {
        self.turn.clear();
        let stale = self.voxels.iter().zip(0u32..).filter(|(voxel, _)| voxel.lit < self.generation);
        self.turn.extend(stale.map(|(voxel, at)| Turn { lit: voxel.lit, rank: voxel.rank, at }));
        self.turn.sort_unstable();
    }

    fn gather_here(&mut self, mut sources: RowSources<'_>, teller: &Teller<'_>, rows_max: u32) -> u32 {
        let mut spent = 0u32;
        let mut chunks: BTreeMap<ChunkId, Vec<Segment<'_>>> = BTreeMap::new();
        for turn in &self.turn {
            let voxel = &mut self.voxels[turn.at as usize];
            let cost = u32::try_from(voxel.rows.len()).unwrap_or(u32::MAX);
            if spent > 0 && spent.saturating_add(cost) > rows_max {
                break;
            }
            let segments = chunks.entry(voxel.chunk.id).or_insert_with(|| sources.segments(voxel));
            self.told.clear();
            let gather =
                |row, near: Option<NearBy<'_>>| sources.gather(&voxel.chunk, row, segments, near.as_ref());
            teller.tell(voxel, gather, &mut self.told);
            self.has_news |= voxel.take(&self.told, self.generation);
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
            let run =
                chunk.receivers.places[key.1..].chunk_by(|a, b| a.voxel == b.voxel).next().unwrap_or(&[]);
            let (own, others) = rest.split_at(run.len());
            rest = others;
            let place = run.first().map(|receiver| receiver.voxel.to_array());
            let found =
                place.map(|place| self.voxels.binary_search_by_key(&place, |voxel| voxel.place.to_array()));
            let Some(Ok(at)) = found else { continue };
            let voxel = &mut self.voxels[at];
            if voxel.key() == key && Arc::ptr_eq(&voxel.chunk, &chunk) {
                self.told.clear();
                teller.tell_sums(voxel, own, &mut self.told);
                self.has_news |= voxel.take(&self.told, asked.generation);
            }
        }
        self.stale = self.stale_now();
    }

    /// Light on surfaces by detail voxel, ascending by detail voxel (x, y, z), then direction, then layer.
    pub(crate) fn details(&mut self) -> Arc<[PatchLight]> {
        self.told.details.clear();
        self.told.details.extend(self.voxels.iter().flat_map(|voxel| &voxel.told.details));
        let order = |light: &PatchLight| (light.voxel.to_array(), light.direction, light.layer);
        self.told.details.sort_unstable_by_key(order);
        Arc::from(&self.told.details[..])
    }

    /// Light of all receivers in the air that know enough, ascending by voxel (x, y, z), then direction.
    pub(crate) fn lights(&mut self) -> Arc<[PatchLight]> {
        self.told.lights.clear();
        self.voxels.iter().for_each(|voxel| self.told.lights.extend_from_slice(&voxel.told.lights));
        Arc::from(&self.told.lights[..])
    }

    /// Whether what is counted is what is there.
    pub(crate) fn is_counted(&self) -> bool {
        let is_ascending = self.voxels.is_sorted_by(|a, b| a.place.to_array() < b.place.to_array());
        is_ascending && self.stale == self.stale_now()
    }

    fn stale_now(&self) -> usize {
        self.voxels.iter().filter(|voxel| voxel.lit < self.generation).count()
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
            let (key, end) = ((chunk.id, first), first + run.len());
            near.push(Near { chunk, distance, key, end, voxel, rank: 0, has_detail: false });
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
