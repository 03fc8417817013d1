//! The newest whole state of the light: what a client reads.

use crate::{ClientError, decode};
use earthshine_protocol::{DETAIL_LAYERS_MAX, VOLUMES_MAX, detail_layer, v1};
use earthshine_volume::{Layout, LookedUp, Volume, lookup};
use glam::Vec3;

/// How complete a frame is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameQuality {
    /// Patches that are in the server's local matrix.
    pub resident_patches: u32,
    /// Patches that the camera would want with the present capacity.
    pub wanted_patches: u32,
    /// Patches whose direct light is older than the newest change of lights or occluders.
    pub stale_direct: u32,
    /// Whether everything wanted is resident, nothing is stale, and all of this light has come, of all volumes.
    pub settled: bool,
    /// Patches within the promised radius of the camera that have no light of level 0; 0 where nothing is promised.
    pub missing_near: u32,
}

/// Most volumes: those of levels, and layers of detail.
const HELD_MAX: usize = VOLUMES_MAX + DETAIL_LAYERS_MAX as usize;

/// One whole state of the light; it never changes while it is held.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Light {
    /// Fine to coarse.
    volumes: Vec<Volume>,
    /// The wire's name of each of them.
    ids: Vec<u32>,
    pub(crate) number: u64,
    camera_sequence: u64,
    frame: FrameQuality,
    time_s: f64,
}

impl Light {
    /// Indirect light at `position` (m) on a surface with `normal`; `None` where none is known (yet).
    #[must_use]
    pub fn lookup(&self, position: Vec3, normal: Vec3) -> Option<LookedUp> {
        lookup(&self.volumes, position, normal)
    }

    /// The volumes behind it, fine to coarse: to be uploaded as textures. Layers of detail come first, side by side.
    #[must_use]
    pub fn volumes(&self) -> &[Volume] {
        &self.volumes
    }

    /// Counts the states of a session; 0 is the empty one before the first.
    #[must_use]
    pub fn number(&self) -> u64 {
        self.number
    }

    /// The newest camera this light answers, as [`crate::Client::set_camera`] numbered it; 0 before the first.
    #[must_use]
    pub fn camera_sequence(&self) -> u64 {
        self.camera_sequence
    }

    /// How complete it is.
    #[must_use]
    pub fn frame(&self) -> FrameQuality {
        self.frame
    }

    /// The server's time of this light, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Patches that have light.
    #[must_use]
    pub fn patch_count(&self) -> usize {
        self.volumes.iter().map(Volume::patch_count).sum()
    }

    pub(crate) fn volume(&self, id: u32) -> Option<&Volume> {
        self.volumes.get(self.ids.iter().position(|&known| known == id)?)
    }

    /// Moves volume `id`, or adds it in the order of levels.
    pub(crate) fn place(&mut self, id: u32, layout: Layout) -> Result<(), ClientError> {
        let fault = |error| ClientError::protocol(format!("volume {id}: {error}"));
        // Detail stands beside the level that it is of.
        let is_rival = |other: u32| detail_layer(other).or(detail_layer(id)).is_none();
        let of_level = self
            .volumes
            .iter()
            .zip(&self.ids)
            .find(|(v, other)| v.layout().level == layout.level && is_rival(**other));
        if let Some((_, &other)) = of_level
            && other != id
        {
            return Err(ClientError::protocol(format!(
                "volumes {other} and {id} are both of level {}",
                layout.level
            )));
        }
        let mut volume = match self.ids.iter().position(|&known| known == id) {
            Some(at) => {
                self.ids.remove(at);
                self.volumes.remove(at)
            }
            None if self.ids.len() >= HELD_MAX => {
                return Err(ClientError::protocol(format!("more than {HELD_MAX} volumes")));
            }
            None => Volume::new(layout).map_err(fault)?,
        };
        volume.move_to(layout).map_err(fault)?;
        let order = |id: u32, level: u8| (level, detail_layer(id).is_none(), id);
        let at =
            self.ids.iter().zip(&self.volumes).take_while(|(other, volume)| {
                order(**other, volume.layout().level) < order(id, layout.level)
            });
        let at = at.count();
        self.ids.insert(at, id);
        self.volumes.insert(at, volume);
        Ok(())
    }

    /// Applies a delta that [`decode::check_delta`] has passed; `clear` empties the volume first.
    pub(crate) fn apply(&mut self, delta: &v1::Delta, clear: bool) {
        let Some(at) = self.ids.iter().position(|&id| id == delta.volume) else { return };
        let volume = &mut self.volumes[at];
        if clear {
            volume.clear();
        }
        decode::apply_delta(delta, volume);
        // Level 0 speaks for the whole; its detail comes last. Others say that there is more to come.
        if volume.layout().level > 0 || detail_layer(delta.volume).is_some() {
            self.frame.settled &= delta.frame.is_none_or(|frame| frame.settled);
            return;
        }
        self.camera_sequence = delta.camera_sequence;
        self.time_s = delta.time_s;
        if let Some(frame) = delta.frame {
            self.frame = FrameQuality {
                resident_patches: frame.resident_patches,
                wanted_patches: frame.wanted_patches,
                stale_direct: frame.stale_direct,
                settled: frame.settled,
                missing_near: frame.missing_near,
            };
        }
    }
}
