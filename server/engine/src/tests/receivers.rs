//! Receivers and far light gathered elsewhere: somebody else's sums, late, refused or lost, beside what the CPU gathers itself.

use super::backend::Faults;
use super::detail;
use super::harness::{ALICE, BOB, Harness, generous, lamp};
use super::world::{RandomWorld, WorldShape};
use crate::{EngineConfig, Event, Frame, PatchLight};
use earthshine_radiosity::receivers::{
    ReceiverGather, ReceiverLight, ReceiverSums, RowsOf, gather_receivers,
};
use earthshine_world::{Asked, LightRig, Rgb, Sky, Vec3};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// How somebody else gathers.
#[derive(Debug, Clone, Copy)]
struct Manner {
    /// Looks before sums are there.
    looks: u32,
    rows_max: usize,
    /// Of so many gathers one is refused, and one is lost; none for 0.
    refuses_every: u64,
    loses_every: u64,
}

const PROMPT: Manner = Manner { looks: 0, rows_max: 1 << 16, refuses_every: 0, loses_every: 0 };

/// Gathers in `f64`, at once, and says so later.
#[derive(Debug)]
struct Elsewhere {
    manner: Manner,
    /// What it was asked for first, and is asked for ever after.
    rows_of: Option<RowsOf>,
    /// Gathers of all sessions.
    begun: Arc<AtomicU64>,
    under_way: Option<(u32, Vec<ReceiverSums>)>,
}

impl ReceiverLight for Elsewhere {
    fn rows_max(&self) -> usize {
        self.manner.rows_max
    }

    fn begin(&mut self, gather: &ReceiverGather<'_>) -> bool {
        assert!(gather.rows.len() <= self.manner.rows_max && !gather.rows.is_empty());
        assert_eq!(*self.rows_of.get_or_insert(gather.rows_of), gather.rows_of);
        let number = self.begun.fetch_add(1, Ordering::Relaxed) + 1;
        if self.manner.refuses_every > 0 && number.is_multiple_of(self.manner.refuses_every) {
            return false;
        }
        let is_lost = self.manner.loses_every > 0 && number.is_multiple_of(self.manner.loses_every);
        self.under_way = (!is_lost).then(|| (self.manner.looks, gather_receivers(gather)));
        true
    }

    fn take(&mut self) -> Asked<Vec<ReceiverSums>> {
        match self.under_way.take() {
            None => Asked::Lost,
            Some((0, sums)) => Asked::Done(sums),
            Some((looks, sums)) => {
                self.under_way = Some((looks - 1, sums));
                Asked::UnderWay
            }
        }
    }
}

/// `harness` with receivers gathered in this manner, and how many gathers there were.
fn gathered_elsewhere(mut harness: Harness, manner: Manner) -> (Harness, Arc<AtomicU64>) {
    let begun = Arc::new(AtomicU64::default());
    let counted = Arc::clone(&begun);
    harness.engine = harness.engine.gathered_by(Box::new(move || {
        Box::new(Elsewhere { manner, rows_of: None, begun: Arc::clone(&counted), under_way: None })
    }));
    (harness, begun)
}

fn pyramid(seed: u64) -> RandomWorld {
    let shape = WorldShape { chunks: [4, 2, 3], patches_per_chunk_max: 12, ..WorldShape::default() };
    RandomWorld::new(seed, shape).with_levels(3)
}

fn rig() -> LightRig {
    LightRig { sky: Sky::constant(Rgb::new(1.0, 2.0, 3.0)), ..lamp(Vec3::ONE) }
}

fn look(world: RandomWorld, config: EngineConfig) -> Harness {
    let mut harness = Harness::new(world, config, Faults::default()).with_camera(Vec3::ZERO);
    harness.light(ALICE, rig());
    harness
}

fn assert_lights(found: &[PatchLight], expected: &[PatchLight]) {
    let place = |light: &PatchLight| (light.voxel.to_array(), light.direction);
    assert!(found.iter().map(place).eq(expected.iter().map(place)), "the same are told");
    let brightest = expected.iter().map(|light| light.irradiance.max_element()).fold(0.0, f32::max);
    for (found, expected) in found.iter().zip(expected) {
        let light = |of: &PatchLight| [of.irradiance, of.sky_irradiance];
        for (found, expected) in light(found).into_iter().zip(light(expected)) {
            let gap = (found - expected).abs().max_element();
            assert!(gap <= 1e-5 * brightest, "{found} for {expected}");
        }
        let shares = |of: &PatchLight| [of.known_share, of.far_share, of.fed_share];
        for (found, expected) in shares(found).into_iter().zip(shares(expected)) {
            assert!((found - expected).abs() <= 1e-5, "{found} for {expected}");
        }
        assert_eq!(found.plane_offset, expected.plane_offset);
        let part = |of: &PatchLight| (of.layer, of.tilt, of.barriers);
        assert_eq!(part(found), part(expected));
    }
}

pub(crate) fn assert_alike(found: &Frame, expected: &Frame) {
    assert_lights(&found.receivers, &expected.receivers);
    assert_lights(&found.details, &expected.details);
    assert_lights(&found.patches, &expected.patches);
    for (found, expected) in found.coarse.iter().zip(expected.coarse.iter()) {
        assert_lights(&found.patches, &expected.patches);
    }
}

/// Goal: who gathers makes no difference to what is told. Method: worlds in the air and of detail, whole and a third of
/// them resident; gathers that come at once, late, in small pieces, and that are refused or lost now and then; a camera
/// that goes and comes back.
#[test]
fn light_gathered_elsewhere_is_the_light_gathered_here() {
    let slow = Manner { looks: 3, ..PROMPT };
    let small = Manner { rows_max: 7, ..PROMPT };
    let unsure = Manner { refuses_every: 3, loses_every: 4, ..PROMPT };
    let places = [Vec3::ZERO, Vec3::new(5.0, 1.0, 3.0), Vec3::new(9.0, 0.0, 0.0), Vec3::ZERO];
    for (slots, world) in [
        (1000, pyramid(5)),
        (30, pyramid(6)),
        (1000, detail::world(5)),
        (40, detail::world(5).with_levels(2)),
    ] {
        let mut here = look(world.clone(), generous(slots));
        let frames: Vec<Frame> = places
            .iter()
            .map(|&place| {
                here.look_from(ALICE, place);
                here.settle();
                here.frame(ALICE).clone()
            })
            .collect();
        let told = |frame: &Frame| frame.receivers.len() + frame.details.len();
        assert!(
            frames.iter().any(|frame| told(frame) > 20),
            "{:?}",
            frames.iter().map(told).collect::<Vec<_>>()
        );
        for manner in [PROMPT, slow, small, unsure] {
            let (mut elsewhere, begun) = gathered_elsewhere(look(world.clone(), generous(slots)), manner);
            for (&place, expected) in places.iter().zip(&frames) {
                elsewhere.look_from(ALICE, place);
                elsewhere.settle();
                assert_alike(elsewhere.frame(ALICE), expected);
            }
            assert!(begun.load(Ordering::Relaxed) > 1, "{slots} slots, {manner:?}: {begun:?}");
        }
    }
}

/// Goal: what is under way when the camera has moved on, or the light has changed, does no harm. Method: both change in every
/// tick while gathers take four; invariants are checked in every tick.
#[test]
fn sums_that_come_late_are_told_of_voxels_that_are_still_there() {
    let few_voxels = EngineConfig { receiver_voxels_max: 12, ..generous(30) };
    let slow = Manner { looks: 3, ..PROMPT };
    let (mut harness, begun) = gathered_elsewhere(look(pyramid(6), few_voxels.clone()), slow);
    for step in 0..60 {
        harness.look_from(ALICE, Vec3::new(step as f32 * 0.2, 0.5, 0.5));
        harness.light(ALICE, LightRig { emission_scale: 1.0 + step as f32, ..rig() });
        harness.tick();
    }
    assert!(begun.load(Ordering::Relaxed) > 10);
    let mut here = look(pyramid(6), few_voxels);
    for harness in [&mut harness, &mut here] {
        harness.look_from(ALICE, Vec3::new(2.0, 1.0, 1.0));
        harness.light(ALICE, rig());
        harness.settle();
    }
    assert_alike(harness.frame(ALICE), here.frame(ALICE));
}

/// Goal: who always refuses changes nothing, to the bit, tick by tick; neither does who has no room for a single voxel.
#[test]
fn a_refusal_leaves_all_to_the_cpu() {
    for manner in [Manner { refuses_every: 1, ..PROMPT }, Manner { rows_max: 0, ..PROMPT }] {
        let (mut refused, _) = gathered_elsewhere(look(pyramid(6), generous(30)), manner);
        let mut here = look(pyramid(6), generous(30));
        for step in 0..40 {
            for harness in [&mut refused, &mut here] {
                harness.look_from(ALICE, Vec3::new(step as f32 * 0.25, 0.5, 0.5));
                harness.tick();
            }
            assert_eq!(refused.frames.get(&ALICE), here.frames.get(&ALICE));
        }
    }
}

/// Goal: two sessions gather each for itself, one budget holds for neither, and a backend's end ends what is under way.
#[test]
fn sessions_gather_for_themselves_and_survive_their_backends() {
    let config = EngineConfig { receiver_rows_per_tick_max: 1, retry_after_s: 0.01, ..generous(30) };
    let faults = Faults { fail_step_every: 61, ..Faults::default() };
    let start = Harness::new(pyramid(6), config.clone(), faults).with_camera(Vec3::ZERO);
    let (mut harness, _) = gathered_elsewhere(start, Manner { looks: 2, ..PROMPT });
    harness.events.push(Event::SessionOpened { session: BOB });
    harness.look_from(BOB, Vec3::new(9.0, 0.0, 0.0));
    let mut rows = 0;
    for step in 0..100 {
        harness.light(ALICE, LightRig { emission_scale: 1.0 + step as f32, ..rig() });
        rows = rows.max(harness.tick().done.receiver_rows);
    }
    assert!(rows > 6, "{rows} at once");
    harness.light(ALICE, rig());
    harness.settle();
    let mut here = look(pyramid(6), config);
    here.settle();
    assert_alike(harness.frame(ALICE), here.frame(ALICE));
    assert!(!harness.frame(BOB).receivers.is_empty());
}

/// Goal: far light that is gathered elsewhere, late, is counted neither twice nor not at all while patches come and go. Method:
/// a flight along the corridor, here and with gathers that take eight looks, tick by tick.
#[test]
fn late_far_light_follows_who_is_resident() {
    let config = EngineConfig { load_radius_m: 9.0, coarse_patches_max: 32, ..generous(16) };
    let start = |config| {
        let world = super::far::corridor().with_levels(4);
        let mut harness =
            Harness::new(world, config, Faults::default()).with_camera(Vec3::new(0.0, 0.5, 0.5));
        harness.light(ALICE, LightRig { sky: Sky::constant(Rgb::splat(2.0)), ..LightRig::emission_only() });
        harness
    };
    let mut here = start(config.clone());
    let (mut elsewhere, begun) = gathered_elsewhere(start(config), Manner { looks: 8, ..PROMPT });
    here.settle();
    elsewhere.settle();
    let (mut worst, mut ticks) = (0.0f32, 0);
    for tick in 0..200 {
        for harness in [&mut here, &mut elsewhere] {
            harness.look_from(ALICE, Vec3::new(tick as f32 * 0.25, 0.5, 0.5));
            harness.tick();
        }
        let (found, expected) = (&elsewhere.frame(ALICE).patches, &here.frame(ALICE).patches);
        for (found, expected) in found.iter().zip(expected.iter()) {
            assert_eq!((found.voxel, found.direction), (expected.voxel, expected.direction));
            let gap = (found.irradiance - expected.irradiance).abs().max_element();
            worst = worst.max(gap / expected.irradiance.max_element());
            let gap = (found.fed_share - found.far_share).abs();
            assert!(gap < 1e-4, "tick {tick}: all that is far is fed, to the share: {found:?}");
        }
        ticks += 1;
    }
    assert!(ticks == 200 && begun.load(Ordering::Relaxed) > 20);
    assert!(worst < 0.1, "{worst}");
}
