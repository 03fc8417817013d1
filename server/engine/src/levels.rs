//! What each level of the world is to every session: its grid, its slots, how far it reaches.

use crate::config::EngineConfig;
use earthshine_world::{Grid, WorldIndex};

/// One level, as all sessions see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LevelPlan {
    pub(crate) level: u8,
    pub(crate) grid: Grid,
    /// Slots of a session's matrix.
    pub(crate) capacity: u32,
    /// Chunks within this distance of a camera are wanted, m.
    pub(crate) load_radius_m: f32,
    /// The coarse top level, all of which fits the slots: wanted by every camera before anything else, wherever it is.
    pub(crate) is_pinned: bool,
}

impl LevelPlan {
    /// The levels of the world of `index`, finest first: those from 0 on without a gap.
    pub(crate) fn of(index: &WorldIndex, config: &EngineConfig) -> Vec<Self> {
        let patches_of = |level: u8| {
            let chunks = index.chunks.iter().filter(|chunk| chunk.id.level == level);
            chunks.map(|chunk| u64::from(chunk.patch_count)).reduce(|sum, count| sum + count)
        };
        let counts: Vec<u64> = (0..=Grid::LEVEL_MAX).map_while(patches_of).collect();
        let top = counts.len().saturating_sub(1);
        let plan = |(at, &patches): (usize, &u64)| {
            let level = at as u8;
            let most = config.slots(level);
            // Level 0 keeps the matrix it was asked for: a world may grow under a session.
            let needed = if level == 0 { u64::from(most) } else { patches.clamp(1, u64::from(most)) };
            Self {
                level,
                grid: index.grid.at_level(level),
                capacity: u32::try_from(needed).unwrap_or(most),
                load_radius_m: config.load_radius_m * f32::from(1u16 << level.min(15)),
                is_pinned: level > 0 && at == top && patches <= u64::from(most),
            }
        };
        if counts.is_empty() { vec![plan((0, &0))] } else { counts.iter().enumerate().map(plan).collect() }
    }
}
