//! How many patches of each level a camera on the move can be kept supplied with, and how far they reach.
//!
//! A camera that flies at `v` over a disc of radius `r` with `n(r)` patches needs `2 v n(r) / (pi r)` new ones a second. A swap
//! costs by the square of how many patches the matrix holds ([`crate::swap_price`]), so fewer slots flow much faster: a fast
//! camera gets smaller local sets that it is really surrounded by, not large ones that trail behind it. Light from beyond
//! comes from the coarser levels, as always.
//!
//! Work and bytes are dealt to the coarsest level first, each for its part of what is left: coarse levels need little, and
//! what they leave is level 0's.

use crate::config::EngineConfig;
use crate::crowding::Crowding;
use crate::levels::LevelPlan;
use crate::swap_price::{PARTS, largest_matrix, price};
use crate::turns::parts;
use std::f32::consts::PI;

/// What a tile takes from the request to its first patch in a slot, beside the time its bytes take, s.
pub(crate) const TILE_LATENCY_S: f32 = 0.25;
/// A camera whose flow nothing can follow still has this part of a local set's slots.
const SLOTS_PART_MIN: u32 = 16;

/// One level, as far as its flow depends on it.
#[derive(Debug, Clone)]
pub(crate) struct LevelFlow {
    pub(crate) level: u8,
    pub(crate) crowding: Crowding,
    pub(crate) capacity: u32,
    /// Held whole, wherever the camera is.
    pub(crate) is_pinned: bool,
    /// Within it the level fits the memory.
    pub(crate) load_radius_m: f32,
    /// Bytes of tiles a metre of flight.
    pub(crate) bytes_per_m: f32,
}

/// What one level has at one speed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Supply {
    /// Slots that can be kept filled with what is nearest.
    pub(crate) slots: u32,
    /// Within it of the focus everything is resident, m; 0 for nothing, infinite for all of the world.
    pub(crate) rest_m: f32,
}

/// Rates that are counted on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rates {
    /// Swaps a second of the largest matrix.
    pub(crate) swaps_per_s: f32,
    pub(crate) tile_bytes_per_s: f32,
}

/// All levels, finest first.
#[derive(Debug, Clone)]
pub(crate) struct Flow {
    levels: Vec<LevelFlow>,
    largest: u32,
    hysteresis: f32,
    tile_look_ahead_s: f32,
}

impl Flow {
    pub(crate) fn new(levels: Vec<LevelFlow>, plans: &[LevelPlan], config: &EngineConfig) -> Self {
        let largest = largest_matrix(plans);
        let tile_look_ahead_s = config.tile_look_ahead_s;
        Self { levels, largest, hysteresis: config.hysteresis, tile_look_ahead_s }
    }

    /// Bytes of tiles a metre of flight, over all levels.
    pub(crate) fn bytes_per_m(&self) -> f32 {
        self.levels.iter().map(|level| level.bytes_per_m).sum()
    }

    /// The part of all swaps that level 0 has where every level wants some.
    pub(crate) fn finest_share(&self) -> f32 {
        let moving = self.levels.iter().filter(|level| !level.is_pinned);
        parts(0) as f32 / moving.map(|level| parts(level.level) as f32).sum::<f32>().max(1.0)
    }

    /// What each level, finest first, has around a camera at `speed` (m/s).
    pub(crate) fn at(&self, speed: f32, rates: Rates) -> Vec<Supply> {
        let Rates { swaps_per_s: mut swaps, tile_bytes_per_s: mut bytes } = rates;
        let moving = self.levels.iter().filter(|level| !level.is_pinned);
        let mut parts_left: u64 = moving.map(|level| parts(level.level)).sum();
        let mut supplies = vec![Supply::default(); self.levels.len()];
        for (level, supply) in self.levels.iter().zip(&mut supplies).rev() {
            if level.is_pinned {
                *supply = Supply { slots: level.capacity, rest_m: f32::INFINITY };
                continue;
            }
            let own = parts(level.level);
            let share = swaps * own as f32 / parts_left as f32;
            parts_left -= own;
            bytes -= speed * level.bytes_per_m;
            let (found, spent) = self.supply(level, speed, share, bytes >= 0.0);
            swaps -= spent;
            *supply = found;
        }
        supplies
    }

    /// What `level` has for `share` swaps a second, and how many of those it takes.
    fn supply(&self, level: &LevelFlow, speed: f32, share: f32, is_read: bool) -> (Supply, f32) {
        let spent = |radius: f32, most: f32| {
            let each = price(most as u32, self.largest) as f32 / PARTS as f32;
            2.0 * speed * most * each / (PI * radius)
        };
        let capacity = level.capacity as f32;
        let holds = |radius: f32, most: f32| most <= capacity && spent(radius, most) <= share;
        let reach_m = level.crowding.reach(holds);
        // A tile is asked for when it comes within the load radius of where the camera will be.
        let early_m = level.load_radius_m + speed * (self.tile_look_ahead_s - TILE_LATENCY_S);
        let rest_m = (reach_m / (1.0 + self.hysteresis)).min(level.load_radius_m).min(early_m).max(0.0);
        let least = level.capacity.div_ceil(SLOTS_PART_MIN);
        let is_full = level.crowding.reach(|_, most| most <= capacity) <= reach_m;
        let within = level.crowding.most_within(reach_m);
        let slots = if is_full { level.capacity } else { (within as u32).max(least) };
        let spent = if reach_m > 0.0 { spent(reach_m, within) } else { share };
        (Supply { slots, rest_m: if is_read { rest_m } else { 0.0 } }, spent)
    }
}
