//! Who holds how much of the engine's memory: lists with bounds, added up.
//!
//! What is taken for a moment and what the allocator keeps for itself is not in it: those are what a process has beside this.

use crate::engine::Engine;
use crate::level_view::LevelView;
use crate::local_set::Resident;
use crate::session::Session;
use crate::{Frame, PatchLight};
use earthshine_radiosity::HeldBytes;

/// Bytes, by who holds them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct EngineMemory {
    /// Decoded tiles that cameras want: patches, rows, shadow casters.
    pub tile_bytes: u64,
    /// Decoded tiles that nobody wants any more.
    pub spare_tile_bytes: u64,
    /// Local matrices, and the scratch of their updates.
    pub matrix_bytes: u64,
    /// Form factors between resident patches, in the backends.
    pub row_bytes: u64,
    /// Resident patches: their light, and how their rows split.
    pub resident_bytes: u64,
    /// Receivers in the air and on surfaces, and their light.
    pub receiver_bytes: u64,
    /// The newest frame of each session.
    pub frame_bytes: u64,
}

impl EngineMemory {
    /// All of it.
    #[must_use]
    pub fn total_bytes(&self) -> u64 {
        let Self { tile_bytes, spare_tile_bytes, matrix_bytes, row_bytes, .. } = self;
        let tiles_and_solvers = tile_bytes + spare_tile_bytes + matrix_bytes + row_bytes;
        tiles_and_solvers + self.resident_bytes + self.receiver_bytes + self.frame_bytes
    }
}

impl Engine {
    /// Adds up what is held. O(resident patches + receivers).
    #[must_use]
    pub fn memory(&self) -> EngineMemory {
        let spare_tile_bytes = self.chunks.spare_bytes();
        let tile_bytes = self.chunks.decoded_bytes() - spare_tile_bytes;
        let nothing = EngineMemory { tile_bytes, spare_tile_bytes, ..EngineMemory::default() };
        self.sessions.values().fold(nothing, add_session)
    }
}

fn add_session(sum: EngineMemory, session: &Session) -> EngineMemory {
    let with_air = EngineMemory {
        receiver_bytes: sum.receiver_bytes + session.air.bytes() as u64,
        frame_bytes: sum.frame_bytes + session.last_frame.as_deref().map_or(0, frame_bytes) as u64,
        ..sum
    };
    session.views.iter().fold(with_air, add_view)
}

fn add_view(sum: EngineMemory, view: &LevelView) -> EngineMemory {
    let Some(local) = &view.local else { return sum };
    let HeldBytes { matrix, rows } = local.backend.held_bytes();
    let of_splits: usize = local.iter().map(|(_, resident)| resident.split.bytes()).sum();
    let residents = of_splits + local.capacity() as usize * size_of::<Option<Resident>>();
    EngineMemory {
        matrix_bytes: sum.matrix_bytes + matrix,
        row_bytes: sum.row_bytes + rows,
        resident_bytes: sum.resident_bytes + residents as u64,
        ..sum
    }
}

fn frame_bytes(frame: &Frame) -> usize {
    let coarse: usize = frame.coarse.iter().map(|level| level.patches.len()).sum();
    let lights = frame.patches.len() + frame.receivers.len() + frame.details.len() + coarse;
    lights * size_of::<PatchLight>()
}
