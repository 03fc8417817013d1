//! News through its life: late, lost, more than was guessed. Its kernels are held against their twins in `crate::twins`.

use super::*;
use crate::recorder::uniform_buffer;
use crate::twins::device_or_skip;
use earthshine_volume::rgb9e5;

/// As published.
const LIGHT_UNIT_LX: f32 = 16.0;

/// The code that is published.
pub(crate) fn code(light: Rgb) -> u32 {
    rgb9e5::encode(light / LIGHT_UNIT_LX)
}

/// A channel after the other.
pub(crate) fn planes(light: &[Rgb]) -> Vec<f32> {
    (0..3).flat_map(|channel| light.iter().map(move |light| light[channel])).collect()
}

/// News of light that is written by the host.
struct Life {
    device: GpuDevice,
    news: News,
    light: Buffer,
    uniforms: Buffer,
    slots: usize,
}

impl Life {
    /// Everybody there.
    fn new(device: GpuDevice, slots: usize) -> Self {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let mut news = News::new(&device, slots, 0).expect("small");
        (0..slots).for_each(|slot| news.know(slot));
        let light = device.buffer("light", 12 * slots as u64, usage).expect("small");
        let uniforms = uniform_buffer(&device).expect("small");
        Self { news, light, uniforms, slots, device }
    }

    fn step(&mut self, light: impl Fn(usize) -> f32) {
        let light: Vec<Rgb> = (0..self.slots).map(|slot| Rgb::splat(light(slot))).collect();
        self.news.make_room(&self.device).expect("a device that works");
        let mut recorder = Recorder::new(&self.device, &self.uniforms, None);
        recorder.write(&self.light, &planes(&light));
        self.news.record(&mut recorder, &self.light, self.slots as u32, None);
        let submission = recorder.submit().expect("a device that works");
        self.news.submitted(&self.device, submission);
    }

    fn take(&mut self) -> Vec<(u32, f32)> {
        let mut news = Vec::new();
        self.news.take(&self.device, &mut news).expect("a device that works");
        news.into_iter().map(|(slot, light)| (slot.0, light.x)).collect()
    }

    fn wait(&mut self) -> Vec<(u32, f32)> {
        self.news.wait(&self.device).expect("a device that works");
        self.take()
    }
}

/// Goal: no more is copied than twice what is needed, and nothing is missed where much more comes than was guessed. Method:
/// steps of which everything, nothing and something changes, one after the other; bytes are counted.
#[test]
fn copies_are_as_large_as_what_changed() {
    let Some(device) = device_or_skip() else { return };
    let slots = 1000;
    let mut life = Life::new(device, slots);
    let mut before = 0;
    let all = |light: f32| (0..slots as u32).map(|slot| (slot, light)).collect::<Vec<_>>();
    // Of each step: the light of slots below a bound, what is told, entries that are copied with the count.
    let steps = [
        (1.0, 1000, all(1.0), 1000),
        (2.0, 1000, all(2.0), 1000),
        (2.0, 1000, vec![], 1000),
        (2.0, 1000, vec![], 64),
        (5.0, 3, vec![(0, 5.0), (1, 5.0), (2, 5.0)], 64),
        (6.0, 3, vec![(0, 6.0), (1, 6.0), (2, 6.0)], 64),
    ];
    for (at, (light, bound, expected, copied)) in steps.into_iter().enumerate() {
        life.step(|slot| if slot < bound { light } else { 2.0 });
        assert_eq!(life.wait(), expected, "step {at}");
        let totals = life.device.news_totals();
        assert_eq!((totals.frames, totals.waits), (at as u64 + 1, 0));
        assert_eq!(totals.bytes - before, 16 * (1 + copied), "step {at}");
        before = totals.bytes;
    }
}

/// Goal: drift cannot creep, and what is told is told once. Method: light grows by a tenth of a code's step a frame.
#[test]
fn light_is_compared_with_what_was_told() {
    let Some(device) = device_or_skip() else { return };
    let mut life = Life::new(device, 65);
    let (mut told, mut times) = (0.0f32, 0);
    for frame in 0..200u16 {
        // Between 16 and 32 lx a code's step is 1/16 lx.
        let light = 16.0 + f32::from(frame) / 160.0;
        life.step(|_| light);
        let news = life.wait();
        assert!(news.is_empty() || news.len() == 65 && news[0].1 == light, "{news:?}");
        if let Some(&(_, light)) = news.first() {
            (told, times) = (light, times + 1);
        }
        assert_eq!(code(Rgb::splat(told)), code(Rgb::splat(light)), "frame {frame}");
    }
    assert!((18..=22).contains(&times), "{times} of 200");
}

/// Goal: a bounded number of steps is on its way, none is lost, and the newest counts. Method: many steps that nobody asks
/// about.
#[test]
fn steps_that_nobody_asks_about_are_told_at_last() {
    let Some(device) = device_or_skip() else { return };
    let mut life = Life::new(device, 300);
    for frame in 0..20usize {
        life.step(|slot| if slot % 20 == frame { 7.0 + frame as f32 } else { 1.0 });
        assert!(life.news.flights.len() <= FLIGHTS_MAX);
    }
    let mut news = life.wait();
    assert!(!life.news.is_coming());
    news.sort_by_key(|&(slot, _)| slot);
    let expected = |slot: u32| (slot, if slot % 20 == 19 { 26.0 } else { 1.0 });
    assert_eq!(news, (0..300).map(expected).collect::<Vec<_>>());
    assert_eq!(life.take(), []);
}

/// Goal: light on its way is not the next patch's, who is told afresh. Method: a slot changes hands after its step, before
/// and after its news has arrived.
#[test]
fn a_slot_that_changes_hands_is_told_of_the_new_patch_alone() {
    let Some(device) = device_or_skip() else { return };
    let mut life = Life::new(device, 65);
    for has_arrived in [false, true] {
        life.step(|_| 40.0 + f32::from(has_arrived));
        if has_arrived {
            life.news.wait(&life.device).expect("a device that works");
        }
        life.news.forget(64);
        assert!(!life.news.is_known(64));
        assert!(life.wait().iter().all(|&(slot, _)| slot != 64));
        // Free, or not evaluated: not told.
        life.step(|_| 40.0 + f32::from(has_arrived));
        assert_eq!(life.wait(), []);
        // The same light again, and news nevertheless.
        life.news.know(64);
        life.step(|_| 40.0 + f32::from(has_arrived));
        assert_eq!(life.wait(), [(64, 40.0 + f32::from(has_arrived))]);
    }
}

/// Goal: light that is no number is an error of the slot's, never light. Method: each kind of it on one slot, once of a
/// patch that has left.
#[test]
fn light_that_is_no_number_is_an_error() {
    let Some(device) = device_or_skip() else { return };
    for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut life = Life::new(device.clone(), 65);
        life.step(|slot| if slot == 3 { wrong } else { 1.0 });
        life.news.forget(3);
        assert_eq!(life.wait().len(), 64, "who left does not matter");
        life.step(|slot| if slot == 4 { wrong } else { 2.0 });
        assert_eq!(life.news.wait(&life.device), Err(BackendError::NotANumber(Slot(4))));
    }
}

/// Goal: nothing of a lost device is told, half a step least of all. Method: it is destroyed with steps on their way, the
/// rest of one among them.
#[test]
fn a_device_lost_on_the_way_tells_nothing() {
    let Some(device) = device_or_skip() else { return };
    let mut life = Life::new(device, 500);
    life.step(|_| 3.0);
    life.step(|_| 4.0);
    life.device.destroy();
    let mut news = Vec::new();
    let taken = life.news.take(&life.device, &mut news);
    assert!(matches!(taken, Err(BackendError::DeviceLost { .. })), "{taken:?}");
    assert!(news.is_empty());
    let room = life.news.make_room(&life.device);
    assert!(matches!(room, Err(BackendError::DeviceLost { .. })), "{room:?}");
}
