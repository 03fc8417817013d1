//! Direct light computed elsewhere: somebody else's, late, refused or lost, beside what the CPU computes itself.

use super::backend::Faults;
use super::harness::{ALICE, BOB, Harness, generous, lamp};
use super::receivers::assert_alike;
use super::world::{RandomWorld, WorldShape};
use crate::asked_light::QUESTIONS_MAX;
use crate::local_set::LocalSet;
use crate::{EngineConfig, Event};
use earthshine_light::{
    DirectLight, LightUnderWay, LitPatch, OccluderSet, PatchPoints, direct_irradiance, direct_irradiance_on,
};
use earthshine_world::{Asked, Light, LightRig, PatchId, Rgb, Vec3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// How somebody else lights.
#[derive(Debug, Clone, Copy)]
struct Manner {
    /// Looks, at any question, before an answer is there.
    looks: u64,
    rays_min: usize,
    /// Of so many questions one is refused, and one is lost; none for 0.
    refuses_every: u64,
    loses_every: u64,
}

const PROMPT: Manner = Manner { looks: 0, rays_min: 0, refuses_every: 0, loses_every: 0 };
const SLOW: Manner = Manner { looks: 4, ..PROMPT };

/// What all who light together share.
#[derive(Debug, Default)]
struct Shared {
    looks: AtomicU64,
    begun: AtomicU64,
    under_way: AtomicU64,
    /// No answer is given, and none ever will be.
    is_stuck: AtomicBool,
    is_gone: AtomicBool,
}

/// Computes light at once, as the CPU does, and says so later.
#[derive(Debug)]
struct Elsewhere(Manner, Arc<Shared>);

#[derive(Debug)]
struct Answer {
    due: u64,
    light: Option<Vec<LitPatch>>,
    shared: Arc<Shared>,
}

impl DirectLight for Elsewhere {
    fn rays_min(&self) -> usize {
        self.0.rays_min
    }

    fn begin(
        &mut self,
        occluders: &OccluderSet,
        lights: &[Light],
        patches: &[PatchPoints<'_>],
        wants_points: bool,
    ) -> Option<Box<dyn LightUnderWay>> {
        assert!(!lights.is_empty() && !patches.is_empty(), "there is something to light");
        let Self(manner, shared) = self;
        let number = shared.begun.fetch_add(1, Ordering::Relaxed) + 1;
        let is_refused = manner.refuses_every > 0 && number.is_multiple_of(manner.refuses_every);
        if is_refused || shared.is_gone.load(Ordering::Relaxed) {
            return None;
        }
        let is_lost = manner.loses_every > 0 && number.is_multiple_of(manner.loses_every);
        let lit = |of: &PatchPoints<'_>| {
            let (mean, on_points) = direct_irradiance_on(occluders, lights, of.points, of.epsilon_m, of.seed);
            (mean, if wants_points { on_points } else { Box::default() })
        };
        shared.under_way.fetch_add(1, Ordering::Relaxed);
        Some(Box::new(Answer {
            due: shared.looks.load(Ordering::Relaxed) + manner.looks,
            light: (!is_lost).then(|| patches.iter().map(lit).collect()),
            shared: Arc::clone(shared),
        }))
    }
}

impl LightUnderWay for Answer {
    fn look(&mut self) -> Asked<Vec<LitPatch>> {
        if self.shared.is_gone.load(Ordering::Relaxed) {
            return Asked::Lost;
        }
        if self.shared.looks.fetch_add(1, Ordering::Relaxed) < self.due
            || self.shared.is_stuck.load(Ordering::Relaxed)
        {
            return Asked::UnderWay;
        }
        self.light.take().map_or(Asked::Lost, Asked::Done)
    }
}

impl Drop for Answer {
    fn drop(&mut self) {
        self.shared.under_way.fetch_sub(1, Ordering::Relaxed);
    }
}

fn lit_elsewhere(mut harness: Harness, manner: Manner) -> (Harness, Arc<Shared>) {
    let shared = Arc::new(Shared::default());
    harness.engine = harness.engine.lit_by(|| Box::new(Elsewhere(manner, Arc::clone(&shared))));
    (harness, shared)
}

fn world(seed: u64, has_occluders: bool) -> RandomWorld {
    let shape =
        WorldShape { chunks: [5, 2, 4], patches_per_chunk_max: 12, has_occluders, ..WorldShape::default() };
    RandomWorld::new(seed, shape).with_levels(3)
}

fn look(world: RandomWorld, config: EngineConfig) -> Harness {
    let mut harness = Harness::new(world, config, Faults::default()).with_camera(Vec3::ZERO);
    harness.light(ALICE, rig(0));
    harness
}

/// Another one for each step: a sun and a lamp that move, nothing in every fifth.
fn rig(step: usize) -> LightRig {
    let turn = step as f32 * 0.1;
    let sun = Light::Directional {
        direction: Vec3::new(0.48 * turn.cos(), -0.8, 0.36 + 0.2 * turn.sin()).normalize_or(Vec3::NEG_Y),
        illuminance: Rgb::new(300.0, 200.0, 100.0),
        angular_diameter_rad: 0.0,
    };
    let lamps = if step % 5 == 4 { Vec::new() } else { lamp(Vec3::splat(1.0 + turn)).lights };
    let suns = if step % 5 == 4 { Vec::new() } else { vec![sun] };
    LightRig { lights: [suns, lamps].concat(), ..LightRig::emission_only() }
}

fn local_sets(harness: &Harness) -> impl Iterator<Item = &LocalSet> {
    harness.engine.sessions.values().flat_map(|session| &session.views).filter_map(|view| view.local.as_ref())
}

fn patches_by_slot(set: &LocalSet) -> BTreeMap<u32, PatchId> {
    set.iter().map(|(slot, resident)| (slot, resident.id)).collect()
}

/// Goal: who lights makes no difference to what is told. Method: a world with shadows, whole and a part of it resident; answers
/// that come at once or late, refusals, losses, questions too small; a camera that goes and comes back, a light that changes.
#[test]
fn light_computed_elsewhere_is_the_light_computed_here() {
    let unsure = Manner { refuses_every: 3, loses_every: 4, ..SLOW };
    let large = Manner { rays_min: 36, ..SLOW };
    let places = [Vec3::ZERO, Vec3::new(5.0, 1.0, 3.0), Vec3::new(15.0, 2.0, 9.0), Vec3::ZERO];
    for slots in [1000, 30] {
        let settled = |harness: &mut Harness, at: usize| {
            harness.look_from(ALICE, places[at]);
            harness.light(ALICE, rig(2 * at));
            harness.settle();
            harness.frame(ALICE).clone()
        };
        let mut here = look(world(24, true), generous(slots));
        let frames: Vec<_> = (0..places.len()).map(|at| settled(&mut here, at)).collect();
        for manner in [PROMPT, SLOW, unsure, large] {
            let (mut elsewhere, shared) = lit_elsewhere(look(world(24, true), generous(slots)), manner);
            for (at, expected) in frames.iter().enumerate() {
                assert_alike(&settled(&mut elsewhere, at), expected);
            }
            assert!(shared.begun.load(Ordering::Relaxed) > 3, "{slots} slots, {manner:?}: {shared:?}");
            assert_eq!(shared.under_way.load(Ordering::Relaxed), 0, "settled light waits for none");
        }
    }
}

/// Goal: light under way is never written onto another patch, and no older light over newer. Method: other lights and another
/// place in every tick, so that slots change hands while four ticks' questions are under way; without shadows all light is a
/// function of the patch and its lights, which is computed afresh after each tick.
#[test]
fn late_light_goes_to_its_own_patch_or_to_none() {
    let config = EngineConfig { hysteresis: 0.0, ..generous(30) };
    let (mut harness, _) = lit_elsewhere(look(world(25, false), config), SLOW);
    harness.settle();
    let generation = |harness: &Harness| harness.engine.sessions[&ALICE].lighting.generation;
    let mut rigs = BTreeMap::from([(generation(&harness), rig(0))]);
    let mut newest: BTreeMap<(u8, u32), u64> = BTreeMap::new();
    let (mut unlit, mut late, mut reused) = (0, 0, 0);
    for step in 1..150 {
        harness.light(ALICE, rig(step));
        harness.look_from(ALICE, Vec3::new((step % 50) as f32 * 0.4, 0.5, 0.5));
        let before: Vec<_> = local_sets(&harness).map(patches_by_slot).collect();
        harness.tick();
        rigs.insert(generation(&harness), rig(step));
        for (level, (set, before)) in (0u8..).zip(local_sets(&harness).zip(before)) {
            for (slot, resident) in set.iter() {
                if before.get(&slot).is_none_or(|&id| id != resident.id) {
                    reused += u32::from(before.contains_key(&slot));
                    newest.remove(&(level, slot));
                }
                let (found, Some(lights)) = resident.light.direct() else {
                    unlit += 1;
                    continue;
                };
                let points = set.chunk_of(resident.id).points_of(&resident.patch);
                let expected = direct_irradiance(&OccluderSet::new(), &rigs[&lights].lights, points, 1e-3, 0);
                let gap = (found - expected).abs().max_element();
                assert!(
                    gap <= 1e-4 * expected.max_element(),
                    "step {step}, slot {slot}: {found} for {expected}"
                );
                let newest = newest.entry((level, slot)).or_default();
                assert!(lights >= *newest, "step {step}, slot {slot}: light of before");
                *newest = lights;
                late += u32::from(lights < generation(&harness));
            }
        }
    }
    assert!(unlit > 100 && late > 1000 && reused > 50, "{unlit} unlit, {late} late, {reused} reused");
}

/// Goal: the tick of a question tells its answers apart. Method: two sessions, so that shadow casters of the one go after newcomers of
/// the other were asked for, in the same tick.
#[test]
fn a_slot_is_asked_for_once_a_tick() {
    let config = EngineConfig { hysteresis: 0.0, ..generous(30) };
    let (mut harness, _) = lit_elsewhere(look(world(28, true), config), SLOW);
    harness.events.push(Event::SessionOpened { session: BOB });
    harness.light(BOB, rig(0));
    let mut asked = 0;
    for step in 0..200 {
        harness.look_from(ALICE, Vec3::new((step % 40) as f32 * 0.5, 0.5, 0.5));
        harness.look_from(BOB, Vec3::new((39 - (step + 7) % 40) as f32 * 0.5, 1.5, 2.5));
        harness.tick();
        for set in local_sets(&harness) {
            let mut seen = BTreeSet::new();
            for (tick, slot) in set.asked.slots() {
                assert!(
                    seen.insert((tick, slot)),
                    "step {step}: slot {slot} was asked for twice in tick {tick}"
                );
            }
            asked += seen.len();
        }
    }
    assert!(asked > 1000, "{asked}");
}

/// Goal: a tick waits for nobody, asks no more than it may, and is right once answers come. Method: a device that says nothing
/// while the camera and the light go on; frames keep coming. Then it answers, or is lost.
#[test]
fn a_device_that_does_not_answer_makes_no_tick_wait() {
    for is_lost in [false, true] {
        let (mut harness, shared) = lit_elsewhere(look(world(26, true), generous(30)), SLOW);
        harness.settle();
        shared.is_stuck.store(true, Ordering::Relaxed);
        let frames = harness.frame(ALICE).number;
        let mut most = 0;
        for step in 0..60 {
            harness.look_from(ALICE, Vec3::new(step as f32 * 0.3, 0.5, 0.5));
            harness.light(ALICE, rig(5 * (step / 2)));
            assert!(!harness.tick().settled, "light is on its way");
            most = most.max(shared.under_way.load(Ordering::Relaxed));
        }
        let frames = harness.frame(ALICE).number - frames;
        assert!(frames > 30, "{frames} frames of 60 ticks");
        assert!(
            harness.frame(ALICE).patches.iter().any(|light| light.staleness > 3),
            "and say how old they are"
        );
        let views = harness.engine.sessions[&ALICE].views.len();
        assert!((2..=(views * QUESTIONS_MAX) as u64).contains(&most), "{most} questions");
        let flag = if is_lost { &shared.is_gone } else { &shared.is_stuck };
        flag.store(is_lost, Ordering::Relaxed);
        let mut here = look(world(26, true), generous(30));
        for harness in [&mut harness, &mut here] {
            harness.look_from(ALICE, Vec3::new(2.0, 1.0, 1.0));
            harness.light(ALICE, rig(7));
            harness.settle();
        }
        assert_alike(harness.frame(ALICE), here.frame(ALICE));
        harness.events.push(Event::SessionClosed { session: ALICE });
        harness.tick();
        assert_eq!(shared.under_way.load(Ordering::Relaxed), 0, "who leaves wants nothing more");
    }
}

/// Goal: newcomers whose light is on its way do not take the light out of their surroundings. Method: a flight under one sun;
/// every newcomer has the light of the coarse patch that stood for it before, from its first tick on.
#[test]
fn newcomers_are_lit_as_what_stood_for_them() {
    let config = EngineConfig { hysteresis: 0.0, ..generous(30) };
    let (mut harness, _) = lit_elsewhere(look(world(27, false), config), SLOW);
    harness.settle();
    let mut stood_in = 0;
    for step in 0..60 {
        harness.look_from(ALICE, Vec3::new(step as f32 * 0.3, 0.5, 0.5));
        harness.tick();
        let sets: Vec<_> = local_sets(&harness).collect();
        for (fine, coarse) in sets.iter().zip(&sets[1..]) {
            for (_, resident) in fine.iter().filter(|(_, resident)| resident.light.direct().1.is_none()) {
                let table = fine.slots_of(resident.id.chunk).expect("a resident's chunk has a table");
                let Some(parents) = table.lineage.of(resident.id.chunk) else { continue };
                let parent = parents[usize::from(resident.id.local)];
                let above = PatchId { chunk: resident.id.chunk.parent(), local: parent };
                let Some(slot) = coarse.slot_of(above) else { continue };
                let (expected, found) = (coarse.resident(slot).light.direct().0, resident.light.direct().0);
                assert_eq!(found, expected, "step {step}");
                stood_in += u32::from(found != Rgb::ZERO);
            }
        }
    }
    assert!(stood_in > 20, "{stood_in}");
}
