//! What [`Backend::take_news`] promises: who only listens knows the light of every patch, to what is published of it.
//!
//! Held against [`Backend::read_irradiance`], which is exact. Both the suite of backends and that of solvers run it; light
//! has to come to rest where nothing changes, so methods that draw for ever are left out.

use earthshine_radiosity::bench::Streamed;
use earthshine_radiosity::closed_box::ClosedBox;
use earthshine_radiosity::{Backend, Slot, Update};
use earthshine_world::Rgb;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// A step of the published code, as a share of the brightest channel: nine bits of mantissa, the first of them set.
const CODE_STEP_REL: f32 = 1.0 / 256.0;
/// The smallest such step, lx.
const CODE_STEP_MIN_LX: f32 = 1e-6;
/// How long light may take to come to rest and be told.
const WITHIN: Duration = Duration::from_secs(60);

/// Runs every promise against what `make` builds.
///
/// # Panics
/// At the first that is broken.
pub fn news_conformance(make: impl Fn() -> Box<dyn Backend>) {
    what_is_told_adds_up_to_the_light(&mut *make());
    nothing_changed_is_no_news(&mut *make());
    changes_too_small_to_tell_add_up(&mut *make());
    everything_changed_is_told_of_everybody(&mut *make());
    news_on_its_way_is_not_the_next_patchs(&mut *make());
}

/// Somebody who knows what was told, and nothing else.
#[derive(Default)]
pub(crate) struct Listener {
    light: BTreeMap<Slot, Rgb>,
}

impl Listener {
    /// Takes what there is; returns how much it was.
    fn listen(&mut self, backend: &mut dyn Backend) -> usize {
        let mut news = Vec::new();
        backend.take_news(&mut news).expect("a device that works");
        for &(slot, light) in &news {
            assert!(backend.is_taken(slot), "{slot:?} is free, and is told of");
            assert!(light.is_finite(), "{slot:?}: {light}");
            self.light.insert(slot, light);
        }
        news.len()
    }

    /// A step, and what there is.
    fn step(&mut self, backend: &mut dyn Backend) -> usize {
        backend.step().expect("a device that works");
        self.listen(backend)
    }

    /// Steps until nothing more is to come; returns how much was told.
    pub(crate) fn hear_out(&mut self, backend: &mut dyn Backend) -> usize {
        let start = Instant::now();
        let mut count = self.step(backend);
        while !backend.is_settled() {
            assert!(start.elapsed() < WITHIN, "light does not come to rest");
            std::thread::yield_now();
            count += self.step(backend);
        }
        count
    }

    pub(crate) fn apply(&mut self, backend: &mut dyn Backend, updates: &[Update]) {
        backend.apply(updates).expect("a possible batch");
        for update in updates {
            if let Update::Remove { slot } = update {
                self.light.remove(slot);
            }
        }
    }

    /// Asserts that what was told of all taken slots, and of no others, is their light.
    pub(crate) fn assert_knows(&self, backend: &mut dyn Backend) {
        let slots: Vec<Slot> =
            (0..backend.capacity()).map(Slot).filter(|&slot| backend.is_taken(slot)).collect();
        assert!(self.light.keys().eq(&slots), "told of {:?}", self.light.keys());
        let mut exact = vec![Rgb::NAN; slots.len()];
        backend.read_irradiance(&slots, &mut exact).expect("taken slots");
        for (told, exact) in self.light.values().zip(exact) {
            // Rounding may leave a little less than nothing, which is published as nothing.
            let (told, exact) = (told.max(Rgb::ZERO), exact.max(Rgb::ZERO));
            let step = CODE_STEP_REL * told.max_element().max(exact.max_element()) + CODE_STEP_MIN_LX;
            assert!((told - exact).abs().max_element() <= step, "{exact} was told as {told}");
        }
    }
}

fn room(backend: &dyn Backend) -> Streamed {
    let size = backend.capacity() as usize;
    Streamed::new(ClosedBox::new(size + size / 2 + 1, 13), size, 13)
}

fn shine(backend: &mut dyn Backend, streamed: &Streamed, lamp: f32, outside: f32) {
    let slots = streamed.taken();
    let own: Vec<Rgb> = slots.iter().map(|&slot| streamed.source(slot) * lamp).collect();
    let around = vec![Rgb::new(0.5, 0.6, 1.0) * outside; slots.len()];
    backend.set_sources(&slots, &own, &around).expect("taken slots");
}

/// Goal: nothing is lost on the way. Method: swaps and lamps, some frames apart and some not, light that goes out in the
/// end; whoever listened knows it all whenever it comes to rest.
fn what_is_told_adds_up_to_the_light(backend: &mut dyn Backend) {
    let (mut streamed, mut listener) = (room(backend), Listener::default());
    let size = backend.capacity() as usize;
    let entering = streamed.enter(size);
    listener.apply(backend, &entering);
    for (round, (lamp, outside)) in
        [(10.0, 1.0), (10.0, 1.0), (1e4, 0.0), (3.0, 0.2), (0.0, 0.0)].into_iter().enumerate()
    {
        for _ in 0..3 {
            let mut updates = streamed.leave(size / 5);
            updates.extend(streamed.enter(size / 5));
            listener.apply(backend, &updates);
            shine(backend, &streamed, lamp + round as f32, outside);
            listener.step(backend);
        }
        shine(backend, &streamed, lamp, outside);
        listener.hear_out(backend);
        listener.assert_knows(backend);
    }
    let everybody = streamed.leave(size);
    listener.apply(backend, &everybody);
    assert_eq!(listener.hear_out(backend), 0, "nobody is told of");
}

fn nothing_changed_is_no_news(backend: &mut dyn Backend) {
    let (mut streamed, mut listener) = (room(backend), Listener::default());
    assert_eq!(listener.hear_out(backend), 0, "nobody is there");
    let entering = streamed.enter(backend.capacity() as usize);
    listener.apply(backend, &entering);
    // Darkness is told, too: before that a patch has no light at all.
    assert!(listener.hear_out(backend) >= entering.len());
    listener.assert_knows(backend);
    shine(backend, &streamed, 5.0, 1.0);
    listener.hear_out(backend);
    for _ in 0..3 {
        assert_eq!(listener.step(backend), 0);
    }
    shine(backend, &streamed, 5.0, 1.0);
    assert_eq!(listener.hear_out(backend), 0, "the same light again");
}

/// Goal: drift cannot creep. Method: light grows by less than a code's step at a time, to twice of what it was.
fn changes_too_small_to_tell_add_up(backend: &mut dyn Backend) {
    let (mut streamed, mut listener) = (room(backend), Listener::default());
    let entering = streamed.enter(backend.capacity() as usize);
    listener.apply(backend, &entering);
    let mut lamp = 4.0;
    while lamp < 8.0 {
        shine(backend, &streamed, lamp, lamp);
        listener.hear_out(backend);
        lamp *= 1.003;
    }
    listener.assert_knows(backend);
    for _ in 0..20 {
        // Up and down within a step: whatever is told is true.
        shine(backend, &streamed, lamp, lamp);
        listener.hear_out(backend);
        shine(backend, &streamed, lamp * 1.0005, lamp);
        listener.hear_out(backend);
        listener.assert_knows(backend);
    }
}

fn everything_changed_is_told_of_everybody(backend: &mut dyn Backend) {
    let (mut streamed, mut listener) = (room(backend), Listener::default());
    let entering = streamed.enter(backend.capacity() as usize);
    listener.apply(backend, &entering);
    shine(backend, &streamed, 1.0, 1.0);
    listener.hear_out(backend);
    shine(backend, &streamed, 8.0, 8.0);
    assert!(listener.hear_out(backend) >= entering.len());
    listener.assert_knows(backend);
}

/// Goal: a patch never has its predecessor's light, however late that arrives. Method: a bright patch leaves between a
/// step and its news, a dim one takes its slot, in each frame again.
fn news_on_its_way_is_not_the_next_patchs(backend: &mut dyn Backend) {
    let alone = || Update::Add {
        slot: Slot(0),
        reflectance: Rgb::splat(0.5),
        area: 1.0,
        row: vec![],
        column: vec![],
    };
    let mut listener = Listener::default();
    listener.apply(backend, &[alone()]);
    for round in 0..20u32 {
        let own_light = if round.is_multiple_of(2) { 1e3 } else { 1.0 };
        backend.set_sources(&[Slot(0)], &[Rgb::ZERO], &[Rgb::splat(own_light)]).expect("taken");
        backend.step().expect("a device that works");
        if round % 3 == 0 {
            listener.hear_out(backend);
            listener.assert_knows(backend);
        }
        listener.apply(backend, &[Update::Remove { slot: Slot(0) }, alone()]);
        if round % 4 == 1 {
            let mut light = [Rgb::NAN];
            backend.read_irradiance(&[Slot(0)], &mut light).expect("taken");
            assert_eq!(light, [Rgb::ZERO], "who reads has nothing of it either");
        }
        listener.listen(backend);
        assert!(listener.light.get(&Slot(0)).is_none_or(|light| *light == Rgb::ZERO), "{:?}", listener.light);
    }
    listener.hear_out(backend);
    listener.assert_knows(backend);
}
