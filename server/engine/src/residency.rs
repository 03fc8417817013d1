//! The states of a chunk and the only moves between them.
//!
//! ```text
//!            request          tile            slot
//!  Absent ───────────▶ Requested ──▶ Decoded ◀────▶ Resident
//!    ▲ ▲ ◀───────────   │  cancel,    │   ▲           │  ▲
//!    │ │                │  failure    │   │ last slot │  │ wanted
//!    │ └────────────────┼─────────────┘   │ freed     ▼  │ again
//!    │                  ▼ too many        └──────── Leaving
//!    └──────────── Quarantined  failures
//!       its time is up
//! ```
//!
//! A Decoded chunk that nobody wants stays while there is room.

use ChunkState::{Absent, Decoded, Leaving, Quarantined, Requested, Resident};

/// Where a chunk stands, for all sessions together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ChunkState {
    /// Not in memory; nobody was asked for it.
    Absent,
    /// Its tile was asked for.
    Requested,
    /// Its tile is in memory: it casts shadows and its rows are usable. None of its patches holds a slot.
    Decoded,
    /// At least one of its patches holds a slot in some session.
    Resident,
    /// No longer wanted; its patches are being removed.
    Leaving,
    /// Its tile failed too often; it is not asked for for a while.
    Quarantined,
}

/// Every legal move. There are no others.
pub const MOVES: [(ChunkState, ChunkState); 11] = [
    (Absent, Requested),
    (Requested, Decoded),
    (Requested, Absent),
    (Requested, Quarantined),
    (Decoded, Resident),
    (Decoded, Absent),
    (Resident, Decoded),
    (Resident, Leaving),
    (Leaving, Resident),
    (Leaving, Decoded),
    (Quarantined, Absent),
];

impl ChunkState {
    /// All states.
    pub const ALL: [Self; 6] = [Absent, Requested, Decoded, Resident, Leaving, Quarantined];

    /// Whether [`MOVES`] has the edge from `self` to `next`.
    #[must_use]
    pub fn may_become(self, next: Self) -> bool {
        MOVES.contains(&(self, next))
    }

    /// Whether the chunk's tile is in memory.
    #[must_use]
    pub fn has_tile(self) -> bool {
        matches!(self, Decoded | Resident | Leaving)
    }

    /// Moves along an edge of [`MOVES`].
    ///
    /// # Panics
    /// If there is no such edge: a broken invariant of the engine.
    pub(crate) fn advance(&mut self, next: Self) {
        assert!(self.may_become(next), "a chunk cannot go from {self:?} to {next:?}");
        *self = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moves_are_what_the_drawing_shows() {
        for (from, reachable) in [
            (Absent, vec![Requested]),
            (Requested, vec![Absent, Decoded, Quarantined]),
            (Decoded, vec![Absent, Resident]),
            (Resident, vec![Decoded, Leaving]),
            (Leaving, vec![Decoded, Resident]),
            (Quarantined, vec![Absent]),
        ] {
            let found: Vec<_> = ChunkState::ALL.into_iter().filter(|&to| from.may_become(to)).collect();
            assert_eq!(found, reachable, "from {from:?}");
        }
    }

    #[test]
    #[should_panic(expected = "a chunk cannot go from Absent to Resident")]
    fn an_illegal_move_is_a_broken_invariant() {
        let mut state = Absent;
        state.advance(Resident);
    }
}
