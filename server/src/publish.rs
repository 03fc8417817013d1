//! What a session's client holds, and the delta from there to now: a slow client costs one dirty set, never a queue.
//!
//! A [`DeltaStore`] keeps the newest light of one volume as the wire's codes, each voxel with the generation
//! that last changed it. A frame is absorbed whole, at the moment when there is room to send; frames in
//! between are skipped. It knows neither messages nor sockets. Start at [`DeltaStore::absorb`], then
//! [`DeltaStore::delta_since`]. How many deltas may be on their way is [`Flow`](crate::flow::Flow)'s business.

use earthshine_engine::{EngineConfig, Frame, FrameQuality, PatchLight};
use earthshine_protocol::{DELTA_VOXELS_MAX, DETAIL_LAYERS_MAX, DETAIL_VOLUME};
use earthshine_volume::barrier::{self, Barriers};
use earthshine_volume::tilt::{self, Tilt};
use earthshine_volume::{Layout, plane, rgb9e5};
use earthshine_world::{Barrier, DetailVoxel, SurfacePlane};
use glam::{IVec3, UVec3, Vec3};
use std::sync::Arc;

/// Emptied voxels that are remembered. Beyond it they are forgotten, and a client from before starts over.
const EMPTIED_MAX: usize = 32_768;

/// Voxels that patches or receivers light, at most.
const LIT_MAX: usize =
    EngineConfig::RESIDENT_PATCHES_LIMIT as usize + EngineConfig::RECEIVER_VOXELS_LIMIT as usize;

/// A delta is one message: all lit voxels and all emptied ones fit.
const _: () = assert!(LIT_MAX + EMPTIED_MAX <= DELTA_VOXELS_MAX);
const _: () = assert!(EngineConfig::DETAIL_VOXELS_LIMIT as usize + EMPTIED_MAX <= DELTA_VOXELS_MAX);

/// Every layer that a world may have is a volume.
const _: () = assert!(DETAIL_LAYERS_MAX == DetailVoxel::LAYERS_MAX as u32);

/// What a code of one stands for, lx: codes reach from 1e-6 to a million lux. A power of two, so that no bit is lost.
pub(crate) const LIGHT_UNIT_LX: f32 = 16.0;

/// Light of one voxel as it travels; equal codes need no sending.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct VoxelCodes {
    /// Bit `a` says that direction `a` has light.
    pub(crate) present: u8,
    /// Bit `a` says that it is a receiver's.
    pub(crate) air: u8,
    /// RGB9E5, in [`LIGHT_UNIT_LX`]; zero where there is no patch.
    pub(crate) irradiance: [u32; 6],
    /// As `irradiance`.
    pub(crate) sky_irradiance: [u32; 6],
    /// 0..=255 for 0..=1.
    pub(crate) quality: [u8; 6],
    /// Of `quality`: what coarse levels stand for.
    pub(crate) far: [u8; 6],
    /// As [`PatchLight::staleness`].
    pub(crate) staleness: [u8; 6],
    /// Where surfaces lie: see `earthshine_volume::plane`.
    pub(crate) plane: [u8; 6],
    /// The same with their normals: see `earthshine_volume::tilt`.
    pub(crate) tilt: [Tilt; 6],
    /// Where walls end what the light stands for: see `earthshine_volume::barrier`.
    pub(crate) barriers: [Barriers; 6],
}

impl VoxelCodes {
    const EMPTY: Self = Self {
        present: 0,
        air: 0,
        irradiance: [0; 6],
        sky_irradiance: [0; 6],
        quality: [0; 6],
        far: [0; 6],
        staleness: [0; 6],
        plane: [plane::UNKNOWN; 6],
        tilt: [tilt::UNKNOWN; 6],
        barriers: [barrier::NONE; 6],
    };

    fn add(&mut self, patch: &PatchLight, is_air: bool) {
        let direction = patch.direction.index();
        self.present |= 1 << direction;
        self.air |= u8::from(is_air) << direction;
        self.irradiance[direction] = rgb9e5::encode(patch.irradiance / LIGHT_UNIT_LX);
        self.sky_irradiance[direction] = rgb9e5::encode(patch.sky_irradiance / LIGHT_UNIT_LX);
        let code = |share: f32| (share.clamp(0.0, 1.0) * 255.0).round() as u8;
        self.quality[direction] = code(patch.known_share + patch.fed_share);
        self.far[direction] = code(patch.fed_share).min(self.quality[direction]);
        self.staleness[direction] = patch.staleness;
        self.plane[direction] = patch.plane_offset.map_or(plane::UNKNOWN, plane::encode);
        self.tilt[direction] = patch.tilt.map_or(tilt::UNKNOWN, SurfacePlane::code);
        self.barriers[direction] = Barrier::codes(patch.barriers);
    }

    /// Bit `a` says that walls end the light of direction `a`.
    pub(crate) fn barred(&self) -> u8 {
        let bit = |direction: usize| u8::from(self.barriers[direction] != barrier::NONE) << direction;
        (0..6).map(bit).sum()
    }

    /// Takes the directions of `other` that it has nothing on.
    fn fill_with(&mut self, other: &Self) {
        for direction in (0..6).filter(|direction| (other.present & !self.present) >> direction & 1 == 1) {
            self.irradiance[direction] = other.irradiance[direction];
            self.sky_irradiance[direction] = other.sky_irradiance[direction];
            self.quality[direction] = other.quality[direction];
            self.far[direction] = other.far[direction];
            self.staleness[direction] = other.staleness[direction];
            self.plane[direction] = other.plane[direction];
            self.tilt[direction] = other.tilt[direction];
            self.barriers[direction] = other.barriers[direction];
            self.air |= other.air & 1 << direction;
        }
        self.present |= other.present;
    }
}

#[derive(Debug, Clone, Copy)]
struct Entry {
    voxel: IVec3,
    codes: VoxelCodes,
    /// Generation that last changed it; an entry without patches was emptied then.
    changed: u64,
}

/// Order of linear indices: z is the slowest.
fn index_order(voxel: IVec3) -> [i32; 3] {
    [voxel.z, voxel.y, voxel.x]
}

/// The camera that a frame answers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Answered {
    /// The client's number of it.
    pub(crate) sequence: u64,
    /// m; volumes follow it.
    pub(crate) position: Vec3,
}

/// What is said of a generation as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Caption {
    /// Newest camera that the light answers.
    pub(crate) camera_sequence: u64,
    /// How complete the light is.
    pub(crate) quality: FrameQuality,
    /// The tick's time, s.
    pub(crate) time_s: f64,
}

/// Voxels that changed, ready for the wire.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Changes {
    /// Of the volume.
    pub(crate) volume: u32,
    /// The generation that the client must hold; 0 for none.
    pub(crate) from: u64,
    /// The generation that it holds afterwards.
    pub(crate) to: u64,
    /// Linear index and light, ascending.
    pub(crate) voxels: Vec<(u32, VoxelCodes)>,
    /// Of the whole.
    pub(crate) caption: Caption,
}

/// A frame's light of one level.
#[derive(Debug, Default)]
struct Seen {
    patches: Arc<[PatchLight]>,
    air: Arc<[PatchLight]>,
}

impl Seen {
    /// The detail of `frame`.
    fn detail_of(frame: &Frame) -> Self {
        Self { patches: Arc::clone(&frame.details), air: Arc::default() }
    }

    fn of(frame: &Frame, level: u8) -> Self {
        // Light in the air is of level 0 alone.
        let air = if level == 0 { Arc::clone(&frame.receivers) } else { Arc::default() };
        Self { patches: frame.patches_of(level).cloned().unwrap_or_default(), air }
    }

    /// Whether both are the very lists of `other`.
    fn is_same(&self, other: &Self) -> bool {
        let is_same =
            |a: &Arc<[PatchLight]>, b: &Arc<[PatchLight]>| Arc::ptr_eq(a, b) || a.is_empty() && b.is_empty();
        is_same(&self.patches, &other.patches) && is_same(&self.air, &other.air)
    }
}

/// The newest light of one volume of one session.
#[derive(Debug)]
pub(crate) struct DeltaStore {
    layout: Layout,
    /// Voxels a step of the volume.
    snap: i32,
    placed: bool,
    /// Ascending by [`index_order`], all inside of the layout.
    entries: Vec<Entry>,
    generation: u64,
    /// Generation of the last move.
    layout_generation: u64,
    /// Clients that hold less than this cannot be told what was emptied.
    answerable_from: u64,
    caption: Caption,
    /// What was merged last. It keeps a frame's lists in memory, and their addresses its own.
    seen: Seen,
    /// Whether it holds detail voxels instead of voxels, and which layer of them.
    detail_layer: Option<u8>,
}

impl DeltaStore {
    /// An empty volume of `level` and `dims` voxels that moves in steps of `snap_voxels`.
    pub(crate) fn new(level: u8, dims: UVec3, voxel_edge_m: f32, snap_voxels: u32) -> Self {
        // A volume smaller than two steps would lose its camera between them.
        let snap = snap_voxels.min(dims.min_element() / 2).max(1).cast_signed();
        Self {
            layout: Layout { level, origin: IVec3::ZERO, dims, voxel_edge_m },
            snap,
            placed: false,
            entries: Vec::new(),
            generation: 0,
            layout_generation: 0,
            answerable_from: 0,
            caption: Caption::default(),
            seen: Seen::default(),
            detail_layer: None,
        }
    }

    /// The same of layer `layer` of level 0's detail: voxels of `detail_edge_m`.
    pub(crate) fn of_detail(layer: u8, dims: UVec3, detail_edge_m: f32, snap_voxels: u32) -> Self {
        Self { detail_layer: Some(layer), ..Self::new(0, dims, detail_edge_m, snap_voxels) }
    }

    /// The volume's name on the wire.
    pub(crate) fn name(&self) -> u32 {
        self.detail_layer.map_or(self.layout.level.into(), |layer| DETAIL_VOLUME + u32::from(layer))
    }

    /// Whether what is said of the whole is said with it.
    pub(crate) fn speaks_for_all(&self) -> bool {
        self.layout.level == 0 && self.detail_layer.is_none()
    }

    /// Whether the client believes that light is settled.
    pub(crate) fn is_called_settled(&self) -> bool {
        self.caption.quality.settled
    }

    /// Another volume has told the client that light is not settled: this one says so again once it is.
    pub(crate) fn unsettle(&mut self) {
        self.caption.quality.settled = false;
    }

    /// Where the volume is.
    pub(crate) fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Generation from which on deltas index the present layout.
    pub(crate) fn layout_generation(&self) -> u64 {
        self.layout_generation
    }

    /// Memory of the codes, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.entries.capacity() * size_of::<Entry>()
    }

    /// The newest generation; 0 before the first frame.
    pub(crate) fn generation(&self) -> u64 {
        self.generation
    }

    /// The frame's light of this volume.
    fn seen_of(&self, frame: &Frame) -> Seen {
        match self.detail_layer {
            Some(_) => Seen::detail_of(frame),
            None => Seen::of(frame, self.layout.level),
        }
    }

    /// Whether `frame` may hold light that this volume has not taken in.
    pub(crate) fn may_lack(&self, frame: &Frame, camera: Answered) -> bool {
        !self.placed
            || self.origin_for(camera.position) != self.layout.origin
            || !self.seen_of(frame).is_same(&self.seen)
    }

    /// Takes in a whole frame; whether the volume moved with it. Every move has to be announced before the next
    /// delta: what a move leaves outside is not emptied by deltas. Light is called settled only if `is_rest_told`: the client
    /// has been sent all else of this frame.
    pub(crate) fn absorb(&mut self, frame: &Frame, camera: Answered, is_rest_told: bool) -> bool {
        let next = self.generation + 1;
        let moved = self.follow(camera.position);
        let news = self.seen_of(frame);
        // Lists that were seen are in `entries` already, unless the volume lies elsewhere now.
        let changed = (moved || !news.is_same(&self.seen)) && self.merge(&news, next);
        self.seen = news;
        let quality = FrameQuality { settled: frame.quality.settled && is_rest_told, ..frame.quality };
        let caption = Caption { camera_sequence: camera.sequence, quality, time_s: frame.time_s };
        // Time alone is no news, and what is said of the whole is said with level 0.
        let said =
            self.speaks_for_all() && Caption { time_s: self.caption.time_s, ..caption } != self.caption;
        self.caption = caption;
        if moved || changed || said {
            self.generation = next;
        }
        if moved {
            self.layout_generation = next;
        }
        moved
    }

    /// Where the volume belongs: it moves once the camera has left the middle by more than a step.
    fn origin_for(&self, camera: Vec3) -> IVec3 {
        let half = (self.layout.dims / 2).as_ivec3();
        let wanted = (camera / self.layout.voxel_edge_m).floor().as_ivec3();
        let mut origin = self.layout.origin;
        for axis in 0..3 {
            let off_centre = i64::from(wanted[axis]) - i64::from(origin[axis]) - i64::from(half[axis]);
            if !self.placed || off_centre.abs() > i64::from(self.snap) {
                let corner =
                    wanted[axis].saturating_sub(half[axis]).clamp(-Layout::ORIGIN_MAX, Layout::ORIGIN_MAX);
                // Towards zero at the far ends, where rounding down would leave the range.
                origin[axis] = (corner.div_euclid(self.snap) * self.snap).max(-Layout::ORIGIN_MAX);
            }
        }
        origin
    }

    /// Moves the volume to where it belongs; whether that is elsewhere.
    fn follow(&mut self, camera: Vec3) -> bool {
        let origin = self.origin_for(camera);
        let moved = !self.placed || origin != self.layout.origin;
        self.placed = true;
        self.layout.origin = origin;
        moved
    }

    /// Merges the frame's voxels with what is held; whether any code changed.
    fn merge(&mut self, news: &Seen, next: u64) -> bool {
        let fresh = self.codes_of(news);
        let layout = self.layout;
        // What a move left outside is gone without a word: the client drops it by itself.
        let mut held = std::mem::take(&mut self.entries)
            .into_iter()
            .filter(|entry| layout.index_of(entry.voxel).is_some())
            .peekable();
        let mut changed = false;
        let mut emptied = 0;
        let mut merged = Vec::with_capacity(fresh.len());
        let mut keep_without_patches = |mut entry: Entry, merged: &mut Vec<Entry>| {
            let news = entry.codes.present != 0;
            if news {
                entry = Entry { codes: VoxelCodes::EMPTY, changed: next, ..entry };
            }
            emptied += 1;
            merged.push(entry);
            news
        };
        for (voxel, codes) in fresh {
            while let Some(gone) = held.next_if(|entry| index_order(entry.voxel) < index_order(voxel)) {
                changed |= keep_without_patches(gone, &mut merged);
            }
            let before = held.next_if(|entry| entry.voxel == voxel);
            let entry =
                before.filter(|entry| entry.codes == codes).unwrap_or(Entry { voxel, codes, changed: next });
            changed |= entry.changed == next;
            merged.push(entry);
        }
        for gone in held {
            changed |= keep_without_patches(gone, &mut merged);
        }
        self.entries = merged;
        if emptied > EMPTIED_MAX {
            self.forget_emptied(next);
        }
        changed
    }

    /// The frame's light inside the volume, voxel by voxel, ascending by index.
    fn codes_of(&self, news: &Seen) -> Vec<(IVec3, VoxelCodes)> {
        let mut voxels: Vec<(IVec3, VoxelCodes)> = Vec::with_capacity(news.patches.len());
        for (lights, is_air) in [(&news.patches, false), (&news.air, true)] {
            for group in lights.chunk_by(|a, b| a.voxel == b.voxel) {
                if self.layout.index_of(group[0].voxel).is_some() {
                    let mut codes = VoxelCodes::EMPTY;
                    let own = group.iter().filter(|light| light.layer == self.detail_layer.unwrap_or(0));
                    own.for_each(|light| codes.add(light, is_air));
                    if codes.present != 0 {
                        voxels.push((group[0].voxel, codes));
                    }
                }
            }
        }
        // Stable: where a voxel has both, patches come first.
        voxels.sort_by_key(|&(voxel, _)| index_order(voxel));
        voxels.dedup_by(|air, patches| {
            let is_same = air.0 == patches.0;
            if is_same {
                patches.1.fill_with(&air.1);
            }
            is_same
        });
        voxels
    }

    /// Drops what was emptied up to `generation`: no client needs to hear of it again.
    pub(crate) fn forget_emptied(&mut self, generation: u64) {
        self.answerable_from = self.answerable_from.max(generation);
        self.entries.retain(|entry| entry.codes.present != 0 || entry.changed > generation);
    }

    /// What a client that holds `held` lacks; `None` if nothing. A client from too long ago gets everything, from 0.
    pub(crate) fn delta_since(&self, held: u64) -> Option<Changes> {
        if held >= self.generation {
            return None;
        }
        let from = if held < self.answerable_from { 0 } else { held };
        let voxels = self
            .entries
            .iter()
            .filter(|entry| entry.changed > from && (from > 0 || entry.codes.present != 0))
            .filter_map(|entry| Some((self.layout.index_of(entry.voxel)?, entry.codes)))
            .collect();
        Some(Changes { volume: self.name(), from, to: self.generation, voxels, caption: self.caption })
    }
}

#[cfg(test)]
#[path = "publish/tests.rs"]
mod tests;
