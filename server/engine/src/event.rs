//! What goes into the engine and what comes out: closed enums, owned data.

use crate::{Frame, SolverConfig};
use earthshine_world::lineage::Lineage;
use earthshine_world::{Camera, Chunk, ChunkId, LightRig};
use std::sync::Arc;

/// One client's view of the world; given out by the shell, never reused in a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct SessionId(pub u64);

/// Something that happened outside.
#[derive(Debug, Clone)]
pub enum Event {
    /// A client arrived. Nothing is loaded for it before its first camera.
    SessionOpened {
        /// Its name from now on.
        session: SessionId,
    },
    /// A client left; its local set goes.
    SessionClosed {
        /// Who.
        session: SessionId,
    },
    /// A camera moved. Invalid cameras are ignored and counted.
    Camera {
        /// Whose.
        session: SessionId,
        /// Where to, and how fast.
        camera: Camera,
    },
    /// A client changed its lights. Invalid rigs are ignored and counted.
    Lights {
        /// Whose.
        session: SessionId,
        /// All of them; what is not listed is off.
        lights: LightRig,
    },
    /// Light is solved otherwise from now on, in all sessions. Settings that cannot be are ignored and counted.
    Solver {
        /// How.
        solver: SolverConfig,
    },
    /// How fast ticks that spend all of their budgets would come: the promise counts on it from now on. A rate that cannot be is
    /// ignored and counted.
    Pace {
        /// Ticks a second, above zero.
        tick_rate_hz: f32,
    },
    /// Which part of its budgets for swaps, rays and receivers a tick may spend from now on: ticks that take too long spread
    /// their work. One that cannot be is ignored and counted.
    Effort {
        /// Above 0, at most 1.
        share: f32,
    },
    /// A requested tile is here, verified and decoded.
    TileDecoded {
        /// What it held.
        chunk: Arc<Chunk>,
        /// Its shadow casters, ready for rays: built by the loader, off the engine's thread.
        occluders: Arc<earthshine_light::Occluders>,
        /// Parents of the patches of every chunk that its rows and its receivers' lead to, and of those parents, up to the top. A chunk
        /// that is missing here has no parents: its far light is a gap.
        lineage: Arc<Lineage>,
    },
    /// A requested tile could not be had.
    TileFailed {
        /// Which.
        chunk: ChunkId,
        /// Why, for people.
        cause: String,
    },
}

/// Something the engine wants done.
#[derive(Debug, Clone)]
pub enum Command {
    /// Read, verify and decode this tile; answer with `TileDecoded` or `TileFailed`.
    LoadTile {
        /// Which.
        chunk: ChunkId,
    },
    /// Forget a request that has not been answered; an answer that comes all the same is ignored.
    CancelTile {
        /// Which.
        chunk: ChunkId,
    },
    /// Send this to the session's client.
    PublishFrame {
        /// Whole: never half of an update.
        frame: Arc<Frame>,
    },
}
