//! An engine for the new state of a world comes up beside the running one and takes its place when it is as good.
//!
//! Both hear the same sessions, cameras and lights. Clients see the old one's frames until the new one has what every
//! camera wants, and the new one's from then on: no frame is missing, none mixes two states of the world, and the
//! light afterwards is that of a server that was started afresh. The price is two engines' memory and work meanwhile.
//! An engine takes over after [`PATIENCE`] in any case: a camera that never rests must not keep a world for ever, nor must
//! a backend that finds no room beside the running one. Clients keep the old frame until the new engine has one.

use crate::world_watch::NextWorld;
use earthshine_engine::{Event, Frame, SessionId, SolverConfig};
use earthshine_world::{Camera, LightRig};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// After so long a frame with nearly all light will do: a camera on the move never has all.
const SETTLING: Duration = Duration::from_secs(5);
/// After so long an engine takes over with whatever light it has.
const PATIENCE: Duration = Duration::from_secs(60);

/// A session as a new engine has to know it.
pub(crate) struct Attending {
    pub(crate) session: SessionId,
    pub(crate) camera: Option<Camera>,
    pub(crate) lights: Option<LightRig>,
}

/// An engine on its way in.
pub(crate) struct Takeover {
    pub(crate) next: NextWorld,
    began: Instant,
    /// The newest of each session.
    pub(crate) frames: BTreeMap<SessionId, Arc<Frame>>,
    /// What it has not been told.
    pending: Vec<Event>,
}

impl Takeover {
    /// Says how light is solved, and introduces the sessions that there are.
    pub(crate) fn new(
        next: NextWorld,
        solver: SolverConfig,
        sessions: impl Iterator<Item = Attending>,
    ) -> Self {
        let mut pending = vec![Event::Solver { solver }];
        for Attending { session, camera, lights } in sessions {
            pending.push(Event::SessionOpened { session });
            pending.extend(lights.map(|lights| Event::Lights { session, lights }));
            pending.extend(camera.map(|camera| Event::Camera { session, camera }));
        }
        Self { next, began: Instant::now(), frames: BTreeMap::new(), pending }
    }

    /// Passes on what the running engine hears.
    pub(crate) fn hear(&mut self, events: &[Event]) {
        self.pending.extend_from_slice(events);
    }

    /// One tick; whether it is as good as the running one for the sessions in `watching`, those with a camera.
    pub(crate) fn tick(&mut self, time_s: f64, watching: &[SessionId]) -> bool {
        let (events, frames) = (std::mem::take(&mut self.pending), &mut self.frames);
        self.next.loaded.tick(time_s, events, |frame| drop(frames.insert(frame.session, frame)));
        let waited = self.began.elapsed();
        waited >= PATIENCE
            || watching
                .iter()
                .all(|session| self.frames.get(session).is_some_and(|frame| is_good(frame, waited)))
    }
}

/// Whether a frame has what its camera wants: all of it, or after a while nearly all.
fn is_good(frame: &Frame, waited: Duration) -> bool {
    let quality = frame.quality;
    let is_nearly = quality.wanted_patches > 0
        && u64::from(quality.resident_patches) * 20 >= u64::from(quality.wanted_patches) * 19
        && quality.stale_direct == 0;
    quality.settled || (waited >= SETTLING && is_nearly)
}
