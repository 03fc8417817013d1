//! The engine's promise: inside a radius, up to a speed, every frame has light of level 0, and of each coarser level
//! farther out and faster.
//!
//! The promise is computed before the first tick, from the configuration, the index and how crowded the world is at
//! its most crowded places, and again whenever the shell says that ticks come at another rate than was counted on
//! ([`Event::Pace`](crate::Event::Pace)); [`Engine`](crate::Engine) holds every tick against it and counts violations. It is an
//! estimate with margins, not a proof: hence the counting.
//!
//! For each level, at speed `v` and with the hysteresis `h`:
//!
//! ```text
//! slots         as many as swaps can keep filled with what is nearest: crate::flow; all of them at rest
//! at rest       with R the distance of the last of them at a crowded place, everything within R' = R / (1 + h) of the
//!               focus is resident
//! lead          the focus runs ahead of the camera by min(v look_ahead, load_radius / 2, R' of level 0 / 2)
//! behind        radius <= R' - lead                     what lies behind the camera is farther from the focus
//! tiles         bytes b(L) within the load radius L: 2 v b(L) / (pi L) new ones a second, those of coarser levels first,
//!               at most FLOW_SHARE of the rate at which tiles are read and decoded
//! memory        L shrinks until what lies within it fits
//! ```
//!
//! The top level, where it is held whole, reaches everywhere at any speed: there is never nothing.

use crate::config::EngineConfig;
use crate::crowding::Crowding;
use crate::flow::{Flow, LevelFlow, Rates, Supply, TILE_LATENCY_S};
use crate::levels::LevelPlan;
use crate::tile::estimated_bytes;
use earthshine_world::{Grid, Vec3, WorldIndex};
use std::f32::consts::PI;

/// How much of a rate the promise counts on: the rest is for bursts and for other levels' bad days.
const FLOW_SHARE: f32 = 0.5;
/// Part of `R'` at rest that the promised radius is, and that it still is at the promised speed.
const RADIUS_SHARE: f32 = 0.5;
/// Part of `R'` of level 0 by which the focus leads at most.
const LEAD_SHARE: f32 = 0.5;
/// Fastest camera that anything but the top level is promised for, m/s.
const SPEED_LIMIT_M_S: f32 = 1000.0;
/// Steps in which what is promised is tabled by speed.
const SPEED_STEPS: u32 = 400;
/// Places at which the bytes around a camera are summed: the chunks with the largest tiles.
const PLACES_MAX: usize = 64;

/// What the shell brings to a promise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Means {
    /// Ticks a second while there is as much to do as a tick may.
    pub tick_rate_hz: f32,
    /// Bytes of tiles that are read, checked and decoded a second.
    pub tile_bytes_per_s: f32,
}

/// Inside [`radius_m`](Self::radius_m), at up to [`speed_m_s`](Self::speed_m_s), with tiles coming at
/// [`tile_bytes_per_s`](Self::tile_bytes_per_s), every frame has light of level 0; [`radius_of`](Self::radius_of) says the same of
/// any level at any speed. For one camera: several that are far apart share the budgets.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Promise {
    /// m; zero if nothing is promised of level 0.
    pub radius_m: f32,
    /// m/s.
    pub speed_m_s: f32,
    /// What flying at that speed needs of the disk and the decoder, bytes/s.
    pub tile_bytes_per_s: f32,
    /// After a jump the promise holds again within this time, s.
    pub recovery_s: f32,
    /// What it counts on.
    pub means: Means,
    /// By speed, ascending in equal steps from zero.
    steps: Vec<Step>,
    speed_step_m_s: f32,
}

/// What holds up to one speed.
#[derive(Debug, Clone, PartialEq, Default)]
struct Step {
    /// By level: within it of the camera everything is resident, m.
    radii_m: Vec<f32>,
    /// By level.
    slots: Vec<u32>,
    /// By how much the focus leads at most, m.
    lead_max_m: f32,
}

/// What a promise follows from, besides the means of the moment.
#[derive(Debug, Clone)]
pub struct Prospect {
    flow: Flow,
    /// Swaps a tick of the largest matrix.
    swaps_per_tick: f32,
    look_ahead_s: f32,
    lead_max_m: f32,
    /// Of a first look: bytes around a camera, and the patches of level 0 that are most crowded.
    bytes_around: f32,
    crowding: Crowding,
}

impl Prospect {
    /// Of an engine of `config` for the world of `index`, whose levels, finest first, are as crowded as `crowding` says. Of a
    /// level that is not listed nobody is known.
    #[must_use]
    pub fn of(index: &WorldIndex, config: &EngineConfig, crowding: &[Crowding]) -> Self {
        let plans = LevelPlan::of(index, config);
        let (share, most) = loads(index, config, &plans);
        let of_level = |plan: &LevelPlan| {
            let at = usize::from(plan.level);
            LevelFlow {
                level: plan.level,
                crowding: crowding.get(at).cloned().unwrap_or_else(|| Crowding::new(plan.grid.voxel_edge_m)),
                capacity: plan.capacity,
                is_pinned: plan.is_pinned,
                load_radius_m: plan.load_radius_m * share,
                bytes_per_m: most.bytes_per_m[at],
            }
        };
        Self {
            flow: Flow::new(plans.iter().map(of_level).collect(), &plans, config),
            swaps_per_tick: config.adds_per_tick_max.min(config.removals_per_tick_max) as f32,
            look_ahead_s: config.look_ahead_s,
            lead_max_m: 0.5 * config.load_radius_m,
            bytes_around: most.tile_bytes,
            crowding: crowding.first().cloned().unwrap_or_default(),
        }
    }

    /// What can be promised with `means`.
    #[must_use]
    pub fn promise(&self, means: Means) -> Promise {
        let rates = Rates {
            swaps_per_s: FLOW_SHARE * self.swaps_per_tick * means.tick_rate_hz,
            tile_bytes_per_s: FLOW_SHARE * means.tile_bytes_per_s,
        };
        let at_rest = self.flow.at(0.0, rates);
        let caps: Vec<f32> = at_rest.iter().map(|supply| RADIUS_SHARE * supply.rest_m).collect();
        let speed_step_m_s = SPEED_LIMIT_M_S / SPEED_STEPS as f32;
        let mut steps = Vec::with_capacity(SPEED_STEPS as usize + 1);
        let mut before = Step { radii_m: caps.clone(), ..Step::default() };
        for step in 0..=SPEED_STEPS {
            let speed = step as f32 * speed_step_m_s;
            let mut next = self.step(speed, &self.flow.at(speed, rates));
            // What a slower camera is not promised a faster one is not either.
            for (radius, most) in next.radii_m.iter_mut().zip(&before.radii_m) {
                *radius = radius.min(*most);
            }
            before.clone_from(&next);
            steps.push(next);
        }
        let radius_m = caps.first().copied().unwrap_or(0.0);
        let last = steps.iter().rposition(|step| radius_m > 0.0 && step.radii_m[0] >= radius_m);
        let speed_m_s = last.map_or(0.0, |step| step as f32 * speed_step_m_s);
        let filling_per_s = self.flow.finest_share() * rates.swaps_per_s;
        let filling_s = self.crowding.most_within(radius_m) / filling_per_s.max(1.0);
        let reading_s = self.bytes_around / rates.tile_bytes_per_s.max(1.0);
        Promise {
            radius_m,
            speed_m_s,
            tile_bytes_per_s: self.flow.bytes_per_m() * speed_m_s,
            recovery_s: filling_s + reading_s + TILE_LATENCY_S,
            means,
            steps,
            speed_step_m_s,
        }
    }

    fn step(&self, speed: f32, supplies: &[Supply]) -> Step {
        let finest_m = supplies.first().map_or(0.0, |supply| supply.rest_m);
        let lead_max_m =
            if finest_m > 0.0 { self.lead_max_m.min(LEAD_SHARE * finest_m) } else { self.lead_max_m };
        let lead_m = lead_max_m.min(speed * self.look_ahead_s);
        Step {
            radii_m: supplies.iter().map(|supply| (supply.rest_m - lead_m).max(0.0)).collect(),
            slots: supplies.iter().map(|supply| supply.slots).collect(),
            lead_max_m,
        }
    }
}

impl Promise {
    /// What is promised of level 0 at `speed_m_s`: see [`radius_of`](Self::radius_of).
    #[must_use]
    pub fn radius_at(&self, speed_m_s: f32) -> f32 {
        self.radius_of(0, speed_m_s)
    }

    /// Within which radius (m) light of `level` is promised at `speed_m_s`: less at higher speeds, in the end nothing. Infinite
    /// for a top level that is held whole.
    #[must_use]
    pub fn radius_of(&self, level: u8, speed_m_s: f32) -> f32 {
        let radii = |step: &Step| step.radii_m.get(usize::from(level)).copied();
        let Some(step) = self.step_at(speed_m_s) else {
            // Faster than anything is tabled for: what is promised whatever the speed.
            let slowest = self.steps.first().and_then(radii);
            return slowest.filter(|radius| radius.is_infinite()).unwrap_or(0.0);
        };
        radii(step).unwrap_or(0.0)
    }

    /// Levels that something is known of.
    #[must_use]
    pub fn level_count(&self) -> u8 {
        self.steps.first().map_or(0, |step| u8::try_from(step.radii_m.len()).unwrap_or(u8::MAX))
    }

    /// How many slots of `level` a camera at `speed_m_s` can be kept supplied with; nothing where that is not known.
    pub(crate) fn slots_at(&self, level: u8, speed_m_s: f32) -> Option<u32> {
        let step = self.step_at(speed_m_s).or(self.steps.last())?;
        step.slots.get(usize::from(level)).copied()
    }

    /// By how much the focus may lead a camera at `speed_m_s`, m.
    pub(crate) fn lead_max_m(&self, speed_m_s: f32) -> f32 {
        let step = self.step_at(speed_m_s).or(self.steps.last());
        step.map_or(f32::INFINITY, |step| step.lead_max_m)
    }

    /// Of the next faster step: rather too little.
    fn step_at(&self, speed_m_s: f32) -> Option<&Step> {
        let step = (speed_m_s / self.speed_step_m_s).ceil();
        if step.is_finite() { self.steps.get(step as usize) } else { None }
    }
}

/// The part of the load radii that fits the memory, and the most that lies within them around any place.
fn loads(index: &WorldIndex, config: &EngineConfig, levels: &[LevelPlan]) -> (f32, Around) {
    let mut largest: Vec<_> = index.chunks.iter().filter(|chunk| chunk.id.level == 0).collect();
    largest.sort_by_key(|chunk| std::cmp::Reverse((chunk.tile_bytes, chunk.id)));
    largest.truncate(PLACES_MAX);
    let centre = |chunk: &earthshine_world::ChunkSummary| index.grid.chunk_bounds(chunk.id.coord).centre();
    let places: Vec<Vec3> = largest.into_iter().map(centre).collect();
    let mut share = 1.0f32;
    loop {
        let around = places.iter().map(|&place| Around::of(index, levels, place, share));
        let most = around.fold(Around::none(levels), Around::max);
        let is_enough = most.decoded_bytes <= config.decoded_bytes_max as f32;
        if is_enough || share < 0.05 {
            return (if is_enough { share } else { 0.0 }, most);
        }
        share *= 0.8;
    }
}

/// What lies within the load radii around one place.
#[derive(Debug, Clone)]
struct Around {
    decoded_bytes: f32,
    tile_bytes: f32,
    /// By level.
    bytes_per_m: Vec<f32>,
}

impl Around {
    fn none(levels: &[LevelPlan]) -> Self {
        Self { decoded_bytes: 0.0, tile_bytes: 0.0, bytes_per_m: vec![0.0; levels.len()] }
    }

    fn of(index: &WorldIndex, levels: &[LevelPlan], place: Vec3, share: f32) -> Self {
        let mut around = Self::none(levels);
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
                around.bytes_per_m[usize::from(plan.level)] += 2.0 * chunk.tile_bytes as f32 / (PI * wide_m);
            }
        }
        around
    }

    fn max(self, other: Self) -> Self {
        let by_level = self.bytes_per_m.iter().zip(&other.bytes_per_m);
        Self {
            decoded_bytes: self.decoded_bytes.max(other.decoded_bytes),
            tile_bytes: self.tile_bytes.max(other.tile_bytes),
            bytes_per_m: by_level.map(|(a, b)| a.max(*b)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crowding::tests::plane;
    use crate::tests::world::{RandomWorld, WorldShape};

    const MEANS: Means = Means { tick_rate_hz: 60.0, tile_bytes_per_s: 1e8 };

    fn promise(config: &EngineConfig, means: Means) -> Promise {
        let index = RandomWorld::new(1, WorldShape::default()).index;
        Prospect::of(&index, config, &[plane()]).promise(means)
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
        let promise = promise(&config, MEANS);
        let speeds = [0.0, 1.0, 500.0, 1e9];
        assert_eq!(
            (promise.radius_m, promise.speed_m_s, speeds.map(|v| promise.radius_at(v))),
            (0.0, 0.0, [0.0; 4])
        );
        assert_eq!(Promise::default().radius_at(0.0), 0.0);
    }

    /// Goal: a fast camera is promised less, of fewer slots, not nothing; and of coarser levels more than of finer ones.
    #[test]
    fn fast_cameras_have_fewer_slots_and_coarse_levels_reach_farther() {
        let world =
            RandomWorld::new(1, WorldShape { chunks: [9, 1, 9], ..WorldShape::default() }).with_levels(3);
        let config = EngineConfig {
            resident_patches_max: 2000,
            coarse_patches_max: 100,
            load_radius_m: 100.0,
            ..EngineConfig::default()
        };
        let coarse = |level: i32| {
            let mut crowding = Crowding::new(2.0f32.powi(level));
            let patches: Vec<Vec3> = (0..3600i16)
                .map(|at| {
                    Vec3::new(f32::from(at % 60 - 30), 0.0, f32::from(at / 60 - 30)) * 2.0f32.powi(level)
                })
                .collect();
            crowding.look(&[Vec3::ZERO], &patches);
            crowding
        };
        let crowding: Vec<Crowding> = (0..3).map(coarse).collect();
        let promise = Prospect::of(&world.index, &config, &crowding).promise(MEANS);
        assert!(promise.speed_m_s > 1.0, "{promise:?}");
        for speed in [0.0, 10.0, 50.0, 200.0] {
            let of = |level| (promise.radius_of(level, speed), promise.slots_at(level, speed).unwrap());
            let (finest, coarser) = (of(0), of(1));
            assert!(finest.0 > 0.0 && coarser.0 > 0.0, "{speed} m/s: {finest:?}, {coarser:?}");
            assert!(
                speed < 50.0 || finest.1 < 2000 && finest.0 <= promise.radius_m,
                "{speed} m/s: {finest:?}"
            );
            assert!(2.0 * promise.lead_max_m(speed) <= 1.001 * promise.lead_max_m(0.0).max(50.0));
        }
        assert_eq!(promise.slots_at(0, 0.0), Some(2000));
        assert!(promise.slots_at(0, 200.0) < promise.slots_at(0, 50.0));
        assert_eq!(promise.slots_at(0, 1e9), promise.slots_at(0, SPEED_LIMIT_M_S));
    }
}
