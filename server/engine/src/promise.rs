//! What the engine promises: inside a radius, up to a speed, every frame has light of level 0.
//!
//! The promise is computed before the first tick, from the configuration, the index and how crowded the world is at
//! its most crowded places, and again whenever the shell says that ticks come at another rate than was counted on
//! ([`Event::Pace`](crate::Event::Pace)); [`Engine`](crate::Engine) holds every tick against it and counts violations. It is an
//! estimate with margins, not a proof: hence the counting.
//!
//! With `R` the distance of the M-th nearest patch at a crowded place, and `h` the hysteresis:
//!
//! ```text
//! at rest       everything within R' = R / (1 + h) of the focus is resident
//! lead          the focus runs ahead of the camera by min(v look_ahead, load_radius / 2)
//! behind        radius <= R' - lead                     what lies behind the camera is farther from the focus
//! flow          n(r) patches in a disc of radius r, flown over at v: 2 v n(r) / (pi r) new ones a second,
//!               at most FLOW_SHARE of what level 0 may add
//! tiles         bytes b(L) within the load radius L: 2 v b(L) / (pi L) new ones a second, over all levels that move,
//!               at most FLOW_SHARE of the rate at which tiles are read and decoded
//! memory        L shrinks until what lies within it fits
//! ```

use crate::config::EngineConfig;
use crate::levels::LevelPlan;
use crate::tile::estimated_bytes;
use earthshine_world::{Grid, Vec3, WorldIndex};
use std::f32::consts::PI;

/// How much of a rate the promise counts on: the rest is for bursts and for other levels' bad days.
const FLOW_SHARE: f32 = 0.5;
/// Part of `R'` that the promised radius is at least, at the promised speed.
const RADIUS_SHARE: f32 = 0.5;
/// What a tile takes from the request to its first patch in a slot, beside the time its bytes take, s.
const TILE_LATENCY_S: f32 = 0.25;
/// Fastest camera that anything is promised for, m/s.
const SPEED_LIMIT_M_S: f32 = 1000.0;
/// Steps in which the promised speed is searched.
const SPEED_STEPS: u32 = 400;
/// Places at which the bytes around a camera are summed: the chunks with the largest tiles.
const PLACES_MAX: usize = 64;

/// How crowded a world is: for each radius (m, ascending) the most patches of level 0 that lie within it of one place.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Crowding {
    radii_m: Vec<f32>,
    most_patches: Vec<u32>,
}

impl Crowding {
    /// Radii looked at.
    const RADII: usize = 96;
    /// The smallest and the largest of them, in voxels.
    const REACH_VOXELS: [f32; 2] = [0.5, 512.0];

    /// Nobody anywhere, for a world with voxels of `voxel_edge_m`.
    #[must_use]
    pub fn new(voxel_edge_m: f32) -> Self {
        let [from, to] = Self::REACH_VOXELS;
        let step = (to / from).powf(1.0 / (Self::RADII - 1) as f32);
        let radii_m = (0..Self::RADII).map(|at| voxel_edge_m * from * step.powi(at as i32)).collect();
        Self { radii_m, most_patches: vec![0; Self::RADII] }
    }

    /// Looks around each of `places` at `patches` (m). O(places x patches).
    pub fn look(&mut self, places: &[Vec3], patches: &[Vec3]) {
        for &place in places {
            let mut counts = vec![0u32; self.radii_m.len()];
            for patch in patches {
                let distance = patch.distance(place);
                if let Some(count) = counts.get_mut(self.radii_m.partition_point(|&radius| radius < distance))
                {
                    *count += 1;
                }
            }
            let mut within = 0;
            for (most, count) in self.most_patches.iter_mut().zip(counts) {
                within += count;
                *most = (*most).max(within);
            }
        }
    }

    /// The largest radius looked at for which `holds(radius, most patches within it)`, and for all smaller ones; zero for none.
    fn reach(&self, holds: impl Fn(f32, f32) -> bool) -> f32 {
        let radii = self.radii_m.iter().zip(&self.most_patches);
        radii
            .take_while(|&(&radius, &most)| holds(radius, most as f32))
            .last()
            .map_or(0.0, |(&radius, _)| radius)
    }
}

/// What the shell brings to a promise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Means {
    /// Ticks a second while there is as much to do as a tick may.
    pub tick_rate_hz: f32,
    /// Bytes of tiles that are read, checked and decoded a second.
    pub tile_bytes_per_s: f32,
}

/// Inside [`radius_m`](Self::radius_m), at up to [`speed_m_s`](Self::speed_m_s), with tiles coming at
/// [`tile_bytes_per_s`](Self::tile_bytes_per_s), every frame has light of level 0. For one camera: several that are far apart share
/// the budgets.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Promise {
    /// m; zero if nothing is promised.
    pub radius_m: f32,
    /// m/s.
    pub speed_m_s: f32,
    /// What flying at that speed needs of the disk and the decoder, bytes/s.
    pub tile_bytes_per_s: f32,
    /// After a jump the promise holds again within this time, s.
    pub recovery_s: f32,
    /// What it counts on.
    pub means: Means,
    /// Radius by speed, ascending by speed, in equal steps from zero.
    radii_m: Vec<f32>,
    speed_step_m_s: f32,
}

/// What a promise follows from, besides the means of the moment.
#[derive(Debug, Clone)]
pub struct Prospect {
    crowding: Crowding,
    /// `R'`.
    rest_m: f32,
    /// Patches of level 0 that a tick may add while all levels want some.
    adds_per_tick: f32,
    /// Bytes of tiles a metre of flight.
    bytes_per_m: f32,
    /// Within it level 0 fits the memory.
    load_radius_m: f32,
    look_ahead_s: f32,
    tile_look_ahead_s: f32,
    lead_max_m: f32,
    /// Of a first look: bytes around a camera.
    bytes_around: f32,
}

impl Prospect {
    /// Of an engine of `config` for the world of `index`.
    #[must_use]
    pub fn of(index: &WorldIndex, config: &EngineConfig, crowding: Crowding) -> Self {
        let levels = LevelPlan::of(index, config);
        let capacity = config.resident_patches_max as f32;
        let full_m = crowding.reach(|_, most| most <= capacity);
        let others = levels.iter().filter(|plan| plan.level > 0 && !plan.is_pinned).count();
        let finest = crate::turns::FINEST_PARTS as f32;
        let part = finest / (finest + others as f32);
        let swaps = config.adds_per_tick_max.min(config.removals_per_tick_max);
        let (load_radius_m, bytes_per_m, bytes_around) = loads(index, config, &levels);
        Self {
            crowding,
            rest_m: (full_m / (1.0 + config.hysteresis)).min(load_radius_m),
            adds_per_tick: part * swaps as f32,
            bytes_per_m,
            load_radius_m,
            look_ahead_s: config.look_ahead_s,
            tile_look_ahead_s: config.tile_look_ahead_s,
            lead_max_m: 0.5 * config.load_radius_m,
            bytes_around,
        }
    }

    /// What can be promised with `means`.
    #[must_use]
    pub fn promise(&self, means: Means) -> Promise {
        let flow = Flow {
            prospect: self,
            adds_per_s: FLOW_SHARE * self.adds_per_tick * means.tick_rate_hz,
            tile_bytes_per_s: FLOW_SHARE * means.tile_bytes_per_s,
        };
        let rest_m = flow.radius_at(0.0);
        if rest_m <= 0.0 {
            return Promise { means, ..Promise::default() };
        }
        let fits = |speed: f32| flow.radius_at(speed) >= RADIUS_SHARE * rest_m;
        // The radius falls with the speed: halving finds where it has fallen too far.
        let (mut low, mut high) = (0.0, SPEED_LIMIT_M_S);
        for _ in 0..32 {
            let middle = 0.5 * (low + high);
            *(if fits(middle) { &mut low } else { &mut high }) = middle;
        }
        let radius_m = RADIUS_SHARE * rest_m;
        let speed_step_m_s = SPEED_LIMIT_M_S / SPEED_STEPS as f32;
        let radii_m = (0..=SPEED_STEPS)
            .map(|step| flow.radius_at(step as f32 * speed_step_m_s).min(radius_m))
            .collect();
        let filled = self.crowding.most_within(radius_m);
        let recovery_s = flow.fill_s(filled) + TILE_LATENCY_S;
        Promise {
            radius_m,
            speed_m_s: low,
            tile_bytes_per_s: self.bytes_per_m * low,
            recovery_s,
            means,
            radii_m,
            speed_step_m_s,
        }
    }
}

impl Promise {
    /// What an engine of `config` can promise for the world of `index`, with `means`.
    #[must_use]
    pub fn of(index: &WorldIndex, config: &EngineConfig, crowding: &Crowding, means: Means) -> Self {
        Prospect::of(index, config, crowding.clone()).promise(means)
    }

    /// What is promised at `speed_m_s`: the radius at the promised speed and below, less above, in the end nothing.
    #[must_use]
    pub fn radius_at(&self, speed_m_s: f32) -> f32 {
        if speed_m_s <= self.speed_m_s {
            return self.radius_m;
        }
        // The next faster step's: rather too little.
        let step = (speed_m_s / self.speed_step_m_s).ceil();
        if step.is_finite() { self.radii_m.get(step as usize).copied().unwrap_or(0.0) } else { 0.0 }
    }
}

impl Crowding {
    fn most_within(&self, radius_m: f32) -> f32 {
        let at = self.radii_m.partition_point(|&radius| radius < radius_m);
        self.most_patches.get(at).or(self.most_patches.last()).map_or(0.0, |&most| most as f32)
    }
}

/// A prospect and the rates that are counted on.
struct Flow<'a> {
    prospect: &'a Prospect,
    /// Patches of level 0 added a second.
    adds_per_s: f32,
    tile_bytes_per_s: f32,
}

impl Flow<'_> {
    fn radius_at(&self, speed: f32) -> f32 {
        let prospect = self.prospect;
        let lead_m = (speed * prospect.look_ahead_s).min(prospect.lead_max_m);
        let behind_m = prospect.rest_m - lead_m;
        let by_swaps =
            prospect.crowding.reach(|radius, most| 2.0 * speed * most <= PI * radius * self.adds_per_s);
        let is_read = speed * prospect.bytes_per_m <= self.tile_bytes_per_s;
        // A tile is asked for when it comes within the load radius of where the camera will be.
        let early_m = prospect.load_radius_m + speed * (prospect.tile_look_ahead_s - TILE_LATENCY_S);
        if is_read { behind_m.min(by_swaps).min(early_m).max(0.0) } else { 0.0 }
    }

    /// Time to take in `patches` and the tiles around a camera, s.
    fn fill_s(&self, patches: f32) -> f32 {
        patches / self.adds_per_s.max(1.0) + self.prospect.bytes_around / self.tile_bytes_per_s.max(1.0)
    }
}

/// The load radius of level 0 that fits the memory, the bytes of tiles a metre of flight needs, and those around a camera.
fn loads(index: &WorldIndex, config: &EngineConfig, levels: &[LevelPlan]) -> (f32, f32, f32) {
    let mut largest: Vec<_> = index.chunks.iter().filter(|chunk| chunk.id.level == 0).collect();
    largest.sort_by_key(|chunk| std::cmp::Reverse((chunk.tile_bytes, chunk.id)));
    largest.truncate(PLACES_MAX);
    let centre = |chunk: &earthshine_world::ChunkSummary| index.grid.chunk_bounds(chunk.id.coord).centre();
    let places: Vec<Vec3> = largest.into_iter().map(centre).collect();
    let mut share = 1.0f32;
    loop {
        let around = places.iter().map(|&place| Around::of(index, levels, place, share));
        let most = around.fold(Around::default(), Around::max);
        let is_enough = most.decoded_bytes <= config.decoded_bytes_max as f32;
        if is_enough || share < 0.05 {
            let load_radius_m = if is_enough { config.load_radius_m * share } else { 0.0 };
            return (load_radius_m, most.bytes_per_m, most.tile_bytes);
        }
        share *= 0.8;
    }
}

/// What lies within the load radii around one place.
#[derive(Debug, Clone, Copy, Default)]
struct Around {
    decoded_bytes: f32,
    tile_bytes: f32,
    bytes_per_m: f32,
}

impl Around {
    fn of(index: &WorldIndex, levels: &[LevelPlan], place: Vec3, share: f32) -> Self {
        let mut around = Self::default();
        for chunk in &index.chunks {
            let Some(plan) = levels.get(usize::from(chunk.id.level)) else { continue };
            let grid: &Grid = &plan.grid;
            let radius_m = plan.load_radius_m * share;
            if !plan.is_pinned && grid.chunk_bounds(chunk.id.coord).distance(place) > radius_m {
                continue;
            }
            around.decoded_bytes += estimated_bytes(chunk) as f32;
            around.tile_bytes += chunk.tile_bytes as f32;
            if !plan.is_pinned {
                // Whole chunks are loaded: the disc is wider than the radius by half a chunk.
                let wide_m = radius_m + 0.5 * grid.chunk_edge_m();
                around.bytes_per_m += 2.0 * chunk.tile_bytes as f32 / (PI * wide_m);
            }
        }
        around
    }

    fn max(self, other: Self) -> Self {
        Self {
            decoded_bytes: self.decoded_bytes.max(other.decoded_bytes),
            tile_bytes: self.tile_bytes.max(other.tile_bytes),
            bytes_per_m: self.bytes_per_m.max(other.bytes_per_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::world::{RandomWorld, WorldShape};

    const MEANS: Means = Means { tick_rate_hz: 60.0, tile_bytes_per_s: 1e8 };

    /// A plane with a patch every metre.
    fn plane() -> Crowding {
        let mut crowding = Crowding::new(1.0);
        let patches: Vec<Vec3> = (-60i16..60)
            .flat_map(|x| (-60i16..60).map(move |z| Vec3::new(f32::from(x), 0.0, f32::from(z))))
            .collect();
        crowding.look(&[Vec3::ZERO, Vec3::X * 55.0], &patches);
        crowding
    }

    fn promise(config: &EngineConfig, means: Means) -> Promise {
        Promise::of(&RandomWorld::new(1, WorldShape::default()).index, config, &plane(), means)
    }

    #[test]
    fn crowding_counts_what_lies_within_at_the_most_crowded_place() {
        let crowding = plane();
        for radius in [3.0f32, 10.0, 40.0] {
            let found = crowding.most_within(radius);
            let disc = PI * radius * radius;
            assert!((0.85..1.35).contains(&(found / disc)), "{found} within {radius} m");
        }
        let far = crowding.reach(|_, most| most <= 2048.0);
        assert!((far / (2048.0 / PI).sqrt() - 1.0).abs() < 0.1, "{far}");
    }

    #[test]
    fn more_slots_reach_farther_and_more_work_goes_faster() {
        let config = EngineConfig {
            resident_patches_max: 1000,
            load_radius_m: 100.0,
            look_ahead_s: 0.0,
            ..EngineConfig::default()
        };
        let base = promise(&config, MEANS);
        assert!(base.radius_m > 5.0 && base.speed_m_s > 1.0, "{base:?}");
        let wider = promise(&EngineConfig { resident_patches_max: 4000, ..config.clone() }, MEANS);
        assert!((wider.radius_m / base.radius_m - 2.0).abs() < 0.25, "{wider:?}");
        let busy = EngineConfig { adds_per_tick_max: 64, removals_per_tick_max: 64, ..config.clone() };
        assert!(promise(&busy, MEANS).speed_m_s > 1.3 * base.speed_m_s);
        let slow_disk = promise(&config, Means { tile_bytes_per_s: 10.0, ..MEANS });
        assert!(slow_disk.speed_m_s < 0.1 * base.speed_m_s, "{slow_disk:?}");
        assert!(slow_disk.tile_bytes_per_s <= 10.0);
    }

    #[test]
    fn the_radius_falls_with_the_speed_and_ends() {
        let config =
            EngineConfig { resident_patches_max: 1000, load_radius_m: 100.0, ..EngineConfig::default() };
        let promise = promise(&config, MEANS);
        let radii: Vec<f32> = (0..200).map(|speed| promise.radius_at(speed as f32 * 5.0)).collect();
        assert!(radii.is_sorted_by(|a, b| a >= b), "{radii:?}");
        assert_eq!(promise.radius_at(promise.speed_m_s), promise.radius_m);
        assert_eq!([promise.radius_at(f32::INFINITY), promise.radius_at(f32::NAN)], [0.0; 2]);
    }

    #[test]
    fn nothing_is_promised_where_nothing_fits() {
        let config = EngineConfig { decoded_bytes_max: 1, ..EngineConfig::default() };
        assert_eq!(promise(&config, MEANS), Promise { means: MEANS, ..Promise::default() });
        assert_eq!(Promise::default().radius_at(0.0), 0.0);
    }
}
