//! The volumes of one session, one a level, and one of detail: what each client holds of each, and whose turn it is to be sent.
//!
//! Levels are independent: each has its deltas in flight, so that a large coarse volume never waits for a fine one.

use crate::convert::VolumesWanted;
use crate::engine_thread::Published;
use crate::flow::Flow;
use crate::publish::{Answered, Changes, DeltaStore};
use earthshine_engine::Frame;
use earthshine_world::{Grid, WorldIndex};
use glam::UVec3;
use std::sync::{Arc, Weak};

/// One volume on its way to one client.
#[derive(Debug)]
struct Stream {
    store: DeltaStore,
    flow: Flow,
    /// Since which news there may be something that the client has not been sent; none if there is not.
    waits_since: Option<u64>,
}

/// All volumes of a session, finest first.
#[derive(Debug)]
pub(crate) struct Streams {
    streams: Vec<Stream>,
    /// Counts news.
    news: u64,
    /// What was taken in last. A frame that is gone keeps its place in memory, but not its lists.
    newest: Option<(Weak<Frame>, Answered)>,
}

/// What a session's volumes may be.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VolumeLimits {
    /// Most voxels along the axes.
    pub(crate) dims_max: UVec3,
    /// Voxels a step.
    pub(crate) snap_voxels: u32,
    /// Deltas on their way.
    pub(crate) in_flight_max: u32,
}

impl Streams {
    /// Level 0, as many layers of its detail as the client reads, and the coarser levels of `index` that it has room for.
    pub(crate) fn new(
        wanted: &VolumesWanted,
        detail_layers: u8,
        index: &WorldIndex,
        limits: VolumeLimits,
    ) -> Self {
        let levels = index.level_count().max(1);
        let stream = |level: u8| {
            let dims = wanted.dims_of(level, limits.dims_max)?;
            let grid: Grid = index.grid.at_level(level);
            let store = DeltaStore::new(level, dims, grid.voxel_edge_m, limits.snap_voxels);
            Some(Stream { store, flow: Flow::new(limits.in_flight_max), waits_since: None })
        };
        let detail = |layer: u8| {
            let dims = wanted.dims_of(0, limits.dims_max).filter(|_| index.detail > 1)?;
            let detail_edge_m = index.grid.voxel_edge_m / index.detail as f32;
            let store = DeltaStore::of_detail(layer, dims, detail_edge_m, limits.snap_voxels);
            Some(Stream { store, flow: Flow::new(limits.in_flight_max), waits_since: None })
        };
        // The last goes first: what is read alone until others come is to be the layer of the most surface.
        let details = (0..detail_layers).rev().filter_map(detail);
        Self { streams: details.chain((0..levels).filter_map(stream)).collect(), news: 0, newest: None }
    }

    /// A frame came.
    pub(crate) fn mark_news(&mut self) {
        self.news += 1;
        let news = self.news;
        self.streams.iter_mut().for_each(|stream| stream.wait(news));
    }

    /// Whether every volume waits to be sent: then there is no need to hear of another frame.
    pub(crate) fn are_all_news(&self) -> bool {
        self.streams.iter().all(|stream| stream.waits_since.is_some())
    }

    /// Memory of what the client was told, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.streams.iter().map(|stream| stream.store.bytes()).sum()
    }

    /// Whether a volume waits and may be sent.
    pub(crate) fn may_send(&self) -> bool {
        self.streams.iter().any(Stream::may_send)
    }

    /// The client holds `generation` of the volume `name`. Whether that can be.
    pub(crate) fn acknowledge(&mut self, name: u32, generation: u64) -> bool {
        let found = self.streams.iter_mut().find(|stream| stream.store.name() == name);
        let Some(stream) = found else { return false };
        if stream.flow.acknowledge(generation).is_err() {
            return false;
        }
        stream.store.forget_emptied(stream.flow.held());
        // It holds less than it was sent: it lost something, which no new frame is needed to tell.
        if stream.flow.is_empty() && stream.flow.held() < stream.store.generation() {
            stream.wait(self.news);
        }
        true
    }

    /// Takes `published` into the volume that waits for longest and may be sent: where it is, if it moved, and what changed. Of those
    /// that wait alike the coarsest goes first, so that there is something to show. Volumes that were sent the frame before wait again:
    /// nobody may tell them of one that came in between, and it may be the last. Light is called settled with or after the
    /// last of it.
    pub(crate) fn next(&mut self, published: &Published) -> Option<(Option<&DeltaStore>, Option<Changes>)> {
        let Published { frame, camera } = published;
        if !self.is_newest(published) {
            self.newest = Some((Arc::downgrade(frame), *camera));
            self.mark_news();
        }
        let ready = self.streams.iter().enumerate().rev().filter(|(_, stream)| stream.may_send());
        let (at, _) = ready.min_by_key(|(_, stream)| stream.waits_since)?;
        let mut others = self.streams.iter().enumerate().filter(|&(other, _)| other != at);
        let is_rest_told = !others.any(|(_, other)| other.lacks(published));
        let stream = &mut self.streams[at];
        stream.waits_since = None;
        let moved = stream.store.absorb(frame, *camera, is_rest_told);
        // A frame whose changes are too small for the wire makes no new generation: what is on its way is enough.
        let is_new = stream.store.generation() > stream.flow.newest();
        let changes = if is_new { stream.store.delta_since(stream.flow.held()) } else { None };
        if let Some(changes) = &changes {
            stream.flow.sent(changes.to);
        }
        let is_unsettled = changes.as_ref().is_some_and(|changes| !changes.caption.quality.settled);
        if let Some(speaker) = self.streams.iter_mut().find(|stream| stream.store.speaks_for_all()) {
            if is_unsettled {
                speaker.store.unsettle();
            }
            if is_rest_told && frame.quality.settled && !speaker.store.is_called_settled() {
                speaker.wait(self.news);
            }
        }
        Some((moved.then_some(&self.streams[at].store), changes))
    }

    fn is_newest(&self, published: &Published) -> bool {
        self.newest.as_ref().is_some_and(|(frame, camera)| {
            frame.as_ptr() == Arc::as_ptr(&published.frame) && *camera == published.camera
        })
    }
}

impl Stream {
    fn may_send(&self) -> bool {
        self.waits_since.is_some() && self.flow.has_room()
    }

    /// There is something to send, as of `news`, if not for longer.
    fn wait(&mut self, news: u64) {
        self.waits_since.get_or_insert(news);
    }

    /// Whether the client has yet to be sent some of `published`.
    fn lacks(&self, published: &Published) -> bool {
        self.store.may_lack(&published.frame, published.camera)
            || self.store.generation() > self.flow.newest()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_engine::{FrameQuality, LevelLight, PatchLight, SessionId};
    use earthshine_world::{
        Barrier, Bounds, ChunkCoord, ChunkId, ChunkSummary, Direction, LightRig, Rgb, Vec3, VoxelCoord,
    };

    fn index(levels: u8) -> WorldIndex {
        let chunk = |level| ChunkSummary {
            id: ChunkId::new(level, ChunkCoord::ZERO),
            patch_count: 1,
            nonzero_count: 0,
            tile_bytes: 0,
        };
        WorldIndex {
            detail: 1,
            grid: Grid { voxel_edge_m: 0.5, chunk_edge_voxels: 4 },
            bounds: Bounds { min: Vec3::ZERO, max: Vec3::ONE },
            chunks: (0..levels).map(chunk).collect(),
            lights: LightRig::emission_only(),
        }
    }

    fn streams(wanted: &VolumesWanted) -> Streams {
        let limits = VolumeLimits { dims_max: UVec3::splat(16), snap_voxels: 2, in_flight_max: 1 };
        Streams::new(wanted, 1, &index(3), limits)
    }

    fn published(light: f32) -> Published {
        of_quality(light, FrameQuality::default())
    }

    fn of_quality(light: f32, quality: FrameQuality) -> Published {
        let patches: Arc<[PatchLight]> = Arc::new([PatchLight {
            voxel: VoxelCoord::ZERO,
            direction: Direction::PosY,
            irradiance: Rgb::splat(light),
            sky_irradiance: Rgb::ZERO,
            plane_offset: Some(0.5),
            layer: 0,
            tilt: None,
            barriers: [None; Barrier::PER_LAYER_MAX],
            known_share: 1.0,
            far_share: 0.0,
            fed_share: 0.0,
            staleness: 0,
        }]);
        let coarse = |level| LevelLight { level, patches: Arc::clone(&patches) };
        let frame = Frame {
            session: SessionId(1),
            number: 1,
            time_s: 0.0,
            voxel_edge_m: 0.5,
            receivers: Arc::default(),
            details: Arc::default(),
            coarse: vec![coarse(1), coarse(2)],
            patches: Arc::clone(&patches),
            quality,
        };
        let camera = Answered { sequence: 1, position: Vec3::ZERO };
        Published { frame: Arc::new(frame), camera }
    }

    /// Whether each volume that waits has changes for the wire.
    fn all_sent(streams: &mut Streams, published: &Published) -> Vec<bool> {
        std::iter::from_fn(|| Some(streams.next(published)?.1.is_some())).collect()
    }

    #[test]
    fn each_level_is_sent_once_the_coarsest_first_and_waits_for_its_own_acks() {
        let mut streams = streams(&VolumesWanted::Any);
        assert!(!streams.may_send());
        streams.mark_news();
        let mut levels = Vec::new();
        let first = published(1.0);
        while streams.may_send() {
            let (moved, changes) = streams.next(&first).unwrap();
            let layout = *moved.unwrap().layout();
            assert_eq!(layout.voxel_edge_m, 0.5 * f32::from(1u16 << layout.level));
            assert_eq!(changes.unwrap().voxels.len(), 1);
            levels.push(layout.level);
        }
        assert_eq!(levels, [2, 1, 0]);
        streams.mark_news();
        assert!(!streams.may_send(), "one delta in flight a level");
        assert!(streams.acknowledge(1, 1) && streams.may_send());
        assert!(!streams.acknowledge(1, 9) && !streams.acknowledge(3, 1), "never sent");
        let (moved, changes) = streams.next(&published(2.0)).unwrap();
        assert!(moved.is_none() && changes.is_some_and(|changes| changes.from == 1));
        assert!(!streams.may_send() && !streams.are_all_news());
    }

    #[test]
    fn what_is_on_its_way_is_not_sent_again() {
        let limits = VolumeLimits { dims_max: UVec3::splat(16), snap_voxels: 2, in_flight_max: 2 };
        let mut streams = Streams::new(&VolumesWanted::Any, 1, &index(3), limits);
        for _ in 0..2 {
            streams.mark_news();
            assert_eq!(all_sent(&mut streams, &published(1.0)).len(), 3);
        }
        streams.mark_news();
        let is_sent = all_sent(&mut streams, &published(1.0));
        assert_eq!(is_sent, [false; 3], "the same light, sent and not yet acknowledged");
        streams.mark_news();
        assert!(streams.next(&published(2.0)).unwrap().1.is_some());
    }

    /// Goal: no volume is left with the frame before the last. Method: another frame comes while the first is on its way to one
    /// volume after the other.
    #[test]
    fn a_frame_that_comes_between_two_volumes_reaches_both() {
        let limits = VolumeLimits { dims_max: UVec3::splat(16), snap_voxels: 2, in_flight_max: 2 };
        let mut streams = Streams::new(&VolumesWanted::Any, 1, &index(2), limits);
        streams.mark_news();
        assert!(streams.next(&published(1.0)).unwrap().1.is_some());
        assert_eq!(all_sent(&mut streams, &published(2.0)), [true; 2]);
        let light_of = |stream: &Stream| stream.store.delta_since(0).unwrap().voxels;
        assert_eq!(light_of(&streams.streams[0]), light_of(&streams.streams[1]));
    }

    /// Goal: settled light that changes on one level alone is called settled again. Method: another coarse level, and for level 0 another
    /// list of the same light.
    #[test]
    fn what_a_coarse_volume_unsettles_level_0_settles_again() {
        let mut streams = streams(&VolumesWanted::These(vec![(0, None), (1, None)]));
        let settled = |light| of_quality(light, FrameQuality { settled: true, ..FrameQuality::default() });
        let mut told = |published: &Published| -> Vec<(u32, bool)> {
            let sent: Vec<_> = std::iter::from_fn(|| Some(streams.next(published)?.1)).flatten().collect();
            sent.iter().for_each(|changes| assert!(streams.acknowledge(changes.volume, changes.to)));
            sent.iter().map(|changes| (changes.volume, changes.caption.quality.settled)).collect()
        };
        assert_eq!(told(&settled(1.0)), [(1, false), (0, true)]);
        let [fine, coarse] = [1.0, 2.0].map(settled);
        let mut frame = Frame::clone(&fine.frame);
        frame.coarse.clone_from(&coarse.frame.coarse);
        assert_eq!(told(&Published { frame: Arc::new(frame), ..fine }), [(1, false), (0, true)]);
    }

    /// Goal: light that never rests leaves no volume waiting. Method: another frame before every message, and acks at once.
    #[test]
    fn under_frames_without_end_every_volume_has_its_turn() {
        let mut streams = streams(&VolumesWanted::Any);
        let mut sent = [0; 3];
        for step in 0..12 {
            streams.next(&published(step as f32));
            for (level, stream) in streams.streams.iter_mut().enumerate() {
                let newest = stream.flow.newest();
                if newest > stream.flow.held() {
                    sent[level] += 1;
                    stream.flow.acknowledge(newest).unwrap();
                }
            }
        }
        assert_eq!(sent, [4; 3]);
    }

    /// Goal: who reads light that is called settled reads all of it. Method: a volume that is sent after level 0, or has no
    /// room at first, has another light than before; then a frame at rest for another camera.
    #[test]
    fn light_is_called_settled_once_all_of_it_is_sent() {
        let index = WorldIndex { detail: 2, ..index(1) };
        let limits = VolumeLimits { dims_max: UVec3::splat(16), snap_voxels: 2, in_flight_max: 1 };
        let mut streams = Streams::new(&VolumesWanted::Any, 1, &index, limits);
        let with_detail = |light| {
            let Published { frame, camera } =
                of_quality(light, FrameQuality { settled: true, ..FrameQuality::default() });
            let details = Arc::clone(&frame.patches);
            Published { frame: Arc::new(Frame { details, ..Frame::clone(&frame) }), camera }
        };
        let told = |streams: &mut Streams, published: &Published| -> Vec<(u32, bool)> {
            let sent = std::iter::from_fn(|| Some(streams.next(published)?.1));
            sent.flatten().map(|changes| (changes.volume, changes.caption.quality.settled)).collect()
        };
        let detail = earthshine_protocol::DETAIL_VOLUME;
        let first = with_detail(1.0);
        assert_eq!(told(&mut streams, &first), [(0, false), (detail, true)]);
        streams.acknowledge(0, 1);
        assert_eq!(told(&mut streams, &first), [(0, true)]);
        streams.acknowledge(0, 2);
        let second = with_detail(2.0);
        assert_eq!(told(&mut streams, &second), [(0, false)], "the detail before is on its way");
        streams.acknowledge(0, 3);
        streams.acknowledge(detail, 1);
        assert_eq!(told(&mut streams, &second), [(detail, true), (0, true)]);
        streams.acknowledge(0, 4);
        let camera = Answered { sequence: 2, ..second.camera };
        assert_eq!(told(&mut streams, &Published { camera, ..second }), [(0, true)]);
    }

    #[test]
    fn a_client_gets_the_levels_that_it_has_room_for() {
        let wanted = VolumesWanted::These(vec![(0, None), (2, Some(UVec3::splat(4)))]);
        let mut streams = streams(&wanted);
        streams.mark_news();
        let (moved, _) = streams.next(&published(1.0)).unwrap();
        let layout = *moved.unwrap().layout();
        assert_eq!((layout.level, layout.dims), (2, UVec3::splat(4)));
        streams.next(&published(1.0)).unwrap();
        assert_eq!((streams.streams[0].store.layout().dims, streams.may_send()), (UVec3::splat(16), false));
    }

    #[test]
    fn levels_above_a_missing_one_are_not_offered() {
        let mut index = index(4);
        index.chunks.retain(|chunk| chunk.id.level != 2);
        let limits = VolumeLimits { dims_max: UVec3::splat(16), snap_voxels: 2, in_flight_max: 1 };
        let streams = Streams::new(&VolumesWanted::Any, 0, &index, limits);
        let levels: Vec<u8> = streams.streams.iter().map(|stream| stream.store.layout().level).collect();
        assert_eq!((levels, index.level_count()), (vec![0, 1], 2));
    }
}
