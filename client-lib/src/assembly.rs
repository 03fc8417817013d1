//! Puts volumes and deltas together until a state is whole, then publishes it.
//!
//! Two buffers: readers hold the front, messages go into the back. After a swap the old front catches up by the
//! messages it missed; only while a reader still holds it is the new front copied instead.

use crate::{ClientError, Light, decode};
use earthshine_protocol::{detail_layer, v1};
use glam::UVec3;
use std::{collections::BTreeMap, sync::Arc};
use tokio::sync::watch;

/// What is held of one volume.
#[derive(Debug, Default)]
struct Held {
    generation: u64,
    /// The delta that is arriving in parts, as (from, to).
    arriving: Option<(u64, u64)>,
}

#[derive(Debug)]
enum Change {
    Place(u32, earthshine_volume::Layout),
    Apply { delta: Box<v1::Delta>, clear: bool },
}

/// The back buffer.
#[derive(Debug)]
pub(crate) struct Assembly {
    /// What the client asked for; a server gives no more.
    dims_max: UVec3,
    back: Light,
    /// What the front does not know yet.
    changes: Vec<Change>,
    held: BTreeMap<u32, Held>,
    published: u64,
}

impl Assembly {
    pub(crate) fn new(dims_max: UVec3) -> Self {
        let (back, changes, held) = (Light::default(), Vec::new(), BTreeMap::new());
        Self { dims_max, back, changes, held, published: 0 }
    }

    /// A volume appeared or moved. It shows with the next whole state.
    pub(crate) fn place(&mut self, volume: &v1::Volume) -> Result<(), ClientError> {
        let layout = decode::layout(volume)?;
        if layout.dims.cmpgt(self.dims_max).any() {
            let cause =
                format!("volume of {} voxels, but at most {} were asked for", layout.dims, self.dims_max);
            return Err(ClientError::protocol(cause));
        }
        let before = self.back.volume(volume.volume).map(|known| *known.layout());
        self.back.place(volume.volume, layout)?;
        let held = self.held.entry(volume.volume).or_default();
        let is_same = before.is_none_or(|b| (b.level, b.voxel_edge_m) == (layout.level, layout.voxel_edge_m));
        if !is_same {
            *held = Held::default();
        }
        self.changes.push(Change::Place(volume.volume, layout));
        Ok(())
    }

    /// New light. Says whether the state is whole now.
    pub(crate) fn apply(&mut self, delta: v1::Delta) -> Result<bool, ClientError> {
        let id = delta.volume;
        let fault = |cause: String| ClientError::protocol(format!("delta of volume {id}: {cause}"));
        let (Some(volume), Some(held)) = (self.back.volume(id), self.held.get_mut(&id)) else {
            return Err(fault("there is no such volume".to_owned()));
        };
        let (from, to) = (delta.from_generation, delta.to_generation);
        if from >= to || from > held.generation || to <= held.generation {
            return Err(fault(format!("from generation {from} to {to}, but {} is held", held.generation)));
        }
        decode::check_delta(&delta, volume.layout().voxel_count())?;
        let clear = from == 0 && held.arriving != Some((from, to));
        held.arriving = Some((from, to));
        if delta.complete {
            *held = Held { generation: to, arriving: None };
        }
        let complete = delta.complete;
        self.back.apply(&delta, clear);
        self.changes.push(Change::Apply { delta: Box::new(delta), clear });
        Ok(complete && self.held.values().all(|held| held.arriving.is_none()))
    }

    /// Whether `volume` is that of level 0, which speaks for the whole.
    pub(crate) fn is_finest(&self, volume: u32) -> bool {
        detail_layer(volume).is_none()
            && self.back.volume(volume).is_some_and(|volume| volume.layout().level == 0)
    }

    /// The generation held of `volume`, to be acknowledged.
    pub(crate) fn generation(&self, volume: u32) -> u64 {
        self.held.get(&volume).map_or(0, |held| held.generation)
    }

    /// Swaps the buffers.
    pub(crate) fn publish(&mut self, front: &watch::Sender<Arc<Light>>) {
        self.published += 1;
        self.back.number = self.published;
        let shown = Arc::new(std::mem::take(&mut self.back));
        let old = front.send_replace(Arc::clone(&shown));
        let changes = std::mem::take(&mut self.changes);
        self.back = Arc::try_unwrap(old)
            .ok()
            .and_then(|light| catch_up(light, &changes).ok())
            .unwrap_or_else(|| Light::clone(&shown));
    }
}

fn catch_up(mut light: Light, changes: &[Change]) -> Result<Light, ClientError> {
    for change in changes {
        match change {
            Change::Place(id, layout) => light.place(*id, *layout)?,
            Change::Apply { delta, clear } => light.apply(delta, *clear),
        }
    }
    Ok(light)
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_volume::rgb9e5;
    use glam::Vec3;

    fn volume(x: i32) -> v1::Volume {
        v1::Volume {
            volume: 1,
            level: 0,
            origin: Some(v1::VoxelCoord { x, y: 0, z: 0 }),
            dims: Some(v1::Dims { x: 4, y: 1, z: 1 }),
            voxel_edge_m: 1.0,
            generation: 0,
        }
    }

    /// Up-facing light `value` in voxel `index`.
    fn delta(from: u64, to: u64, index: u32, value: f32, complete: bool) -> v1::Delta {
        v1::Delta {
            volume: 1,
            from_generation: from,
            to_generation: to,
            camera_sequence: to,
            voxels: vec![index],
            present: vec![0b100],
            irradiance: vec![rgb9e5::encode(Vec3::splat(value))],
            quality: vec![255],
            complete,
            ..v1::Delta::default()
        }
    }

    fn read(light: &Light, x: f32) -> Option<f32> {
        light.lookup(Vec3::new(x + 0.5, 0.25, 0.5), Vec3::Y).map(|read| read.irradiance.x)
    }

    /// Goal: both buffers tell the same story. Method: publish with and without a reader holding the front, and
    /// compare what is read with what was sent.
    #[test]
    fn states_are_whole_and_readers_keep_theirs() {
        let (front, reader) = watch::channel(Arc::new(Light::default()));
        let mut assembly = Assembly::new(UVec3::splat(8));
        assembly.place(&volume(0)).unwrap();
        assert!(!assembly.apply(delta(0, 1, 0, 1.0, false)).unwrap(), "half a state");
        assert!(assembly.apply(delta(0, 1, 2, 2.0, true)).unwrap());
        assembly.publish(&front);
        let first = Arc::clone(&reader.borrow());
        assert_eq!((read(&first, 0.0), read(&first, 2.0), first.number()), (Some(1.0), Some(2.0), 1));

        assembly.place(&volume(1)).unwrap();
        assert!(assembly.apply(delta(1, 2, 3, 4.0, true)).unwrap());
        assembly.publish(&front);
        let second = Arc::clone(&reader.borrow());
        assert_eq!(read(&first, 4.0), None, "held states never change");
        assert_eq!((read(&second, 2.0), read(&second, 4.0)), (Some(2.0), Some(4.0)));
        assert_eq!(read(&second, 0.0), None, "left behind by the move");
        drop((first, second));

        for step in 3..8 {
            assert!(assembly.apply(delta(step - 1, step, 0, step as f32, true)).unwrap());
            assembly.publish(&front);
            let light = Arc::clone(&reader.borrow());
            assert_eq!((read(&light, 1.0), read(&light, 2.0)), (Some(step as f32), Some(2.0)));
            assert_eq!((light.number(), light.camera_sequence()), (step, step));
        }
        assert_eq!(assembly.generation(1), 7);
    }

    #[test]
    fn from_nothing_clears_the_volume_once() {
        let (front, reader) = watch::channel(Arc::new(Light::default()));
        let mut assembly = Assembly::new(UVec3::splat(8));
        assembly.place(&volume(0)).unwrap();
        assembly.apply(delta(0, 1, 0, 1.0, true)).unwrap();
        assembly.apply(delta(0, 5, 2, 2.0, false)).unwrap();
        assembly.apply(delta(0, 5, 3, 3.0, true)).unwrap();
        assembly.publish(&front);
        let light = Arc::clone(&reader.borrow());
        assert_eq!([0.0, 2.0, 3.0].map(|x| read(&light, x)), [None, Some(2.0), Some(3.0)]);
    }

    #[test]
    fn light_is_settled_when_level_0_says_so_until_any_volume_takes_it_back() {
        let (front, reader) = watch::channel(Arc::new(Light::default()));
        let mut assembly = Assembly::new(UVec3::splat(8));
        let detail = earthshine_protocol::DETAIL_VOLUME;
        assembly.place(&volume(0)).unwrap();
        assembly.place(&v1::Volume { volume: detail, voxel_edge_m: 0.5, ..volume(0) }).unwrap();
        let steps = [
            (1, 1, true, true),
            (detail, 1, true, true),
            (detail, 2, false, false),
            (detail, 3, true, false),
            (1, 2, true, true),
        ];
        for (volume, to, says, is_settled) in steps {
            let frame = Some(v1::FrameQuality { settled: says, ..v1::FrameQuality::default() });
            assembly.apply(v1::Delta { volume, frame, ..delta(to - 1, to, 0, 1.0, true) }).unwrap();
            assembly.publish(&front);
            assert_eq!(reader.borrow().frame().settled, is_settled, "{volume} to {to}");
        }
    }

    #[test]
    fn gaps_and_strangers_are_refused() {
        let mut assembly = Assembly::new(UVec3::splat(8));
        assert!(assembly.apply(delta(0, 1, 0, 1.0, true)).is_err(), "no volume yet");
        assembly.place(&volume(0)).unwrap();
        assert!(assembly.apply(delta(1, 2, 0, 1.0, true)).is_err(), "generation 1 is not held");
        assert!(assembly.apply(delta(0, 0, 0, 1.0, true)).is_err(), "goes nowhere");
        assembly.apply(delta(0, 4, 0, 1.0, true)).unwrap();
        assert!(assembly.apply(delta(0, 4, 0, 1.0, true)).is_err(), "goes back");
        assert!(assembly.apply(delta(2, 6, 4, 1.0, true)).is_err(), "voxel 4 of 4");
        assembly.apply(delta(2, 6, 3, 1.0, true)).unwrap();
        let twin = v1::Volume { volume: 2, ..volume(0) };
        assert!(assembly.place(&twin).is_err(), "two volumes of one level");
        let wide = v1::Volume { dims: Some(v1::Dims { x: 9, y: 1, z: 1 }), ..volume(0) };
        assert!(assembly.place(&wide).is_err(), "more than asked for");
    }
}
