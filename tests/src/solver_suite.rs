//! What light over sparse rows promises whoever keeps it: the suite that makes a device's solvers the CPU's.
//!
//! It asks through the trait alone and holds light against the matrix of the CPU backend. Start at [`solver_conformance`]
//! for methods that settle, at [`drawing_conformance`] for those that draw.

use crate::news_suite::{Listener, news_conformance};
use earthshine_radiosity::bench::{Streamed, read, rel_rmse};
use earthshine_radiosity::closed_box::ClosedBox;
use earthshine_radiosity::solver::row_light::RowLightFactory;
use earthshine_radiosity::solver::shooting::SETTLE_FRAMES;
use earthshine_radiosity::solver::{Method, SolverBackend, SolverSettings};
use earthshine_radiosity::{Backend, BackendError, CpuBackend, Slot, Update};
use earthshine_world::Rgb;

const COUNT: u32 = 150;
const SETTLING: [Method; 3] = [Method::Gather, Method::Progressive, Method::Hybrid];
/// Relative RMSE against the matrix once light has settled.
const SETTLED_REL: f64 = 2e-4;

/// Makes what keeps the light.
pub type MakeLight<'a> = &'a dyn Fn() -> RowLightFactory;

/// Runs every promise of methods that settle.
///
/// # Panics
/// At the first that is broken.
pub fn solver_conformance(make: MakeLight<'_>) {
    for method in SETTLING {
        steady_light_is_the_matrix_and_constant_to_the_bit(make, method);
        light_that_goes_off_and_on_returns(make, method);
        streaming_ends_at_the_matrix_of_who_is_there(make, method);
        a_soak_stays_exact(make, method);
        news_conformance(|| Box::new(empty(make, 65, settings(method))));
    }
    for method in [Method::Progressive, Method::Hybrid] {
        a_step_of_light_takes_a_few_frames(make, method);
    }
    for method in SETTLING.into_iter().chain([Method::Alias, Method::Cdf]) {
        a_furnace_at_95_percent_stays_in_bounds(make, method);
        a_patch_that_sees_nothing_has_the_light_from_outside(make, method);
        light_and_rows_that_cannot_be_are_refused(make, method);
    }
    methods_change_without_a_jump(make);
    what_is_told_outlives_a_change_of_method(make);
}

/// Runs every promise of methods that draw.
///
/// # Panics
/// At the first that is broken.
pub fn drawing_conformance(make: MakeLight<'_>) {
    for method in [Method::Alias, Method::Cdf] {
        draws_are_the_matrix_on_average(make, method);
        draws_follow_who_comes_and_goes(make, method);
    }
}

fn settings(method: Method) -> SolverSettings {
    SolverSettings { method, ..SolverSettings::default() }
}

fn empty(make: MakeLight<'_>, capacity: u32, settings: SolverSettings) -> SolverBackend {
    let matrix = |slots| Ok(Box::new(CpuBackend::new(slots).expect("a small matrix")) as Box<dyn Backend>);
    SolverBackend::with_light(capacity, settings, Box::new(matrix), make()).expect("sound settings")
}

/// A backend and the matrix that it is held against, with the same patches and light.
struct Pair {
    backend: SolverBackend,
    oracle: CpuBackend,
    streamed: Streamed,
}

impl Pair {
    /// Five in six patches of a room are resident.
    fn new(make: MakeLight<'_>, settings: SolverSettings) -> Self {
        let room = ClosedBox::new(COUNT as usize * 6 / 5, 5);
        let oracle = CpuBackend::new(COUNT).expect("a small matrix");
        let streamed = Streamed::new(room, COUNT as usize, 5);
        let mut pair = Self { backend: empty(make, COUNT, settings), oracle, streamed };
        let updates = pair.streamed.enter(COUNT as usize);
        pair.apply(&updates);
        pair
    }

    fn apply(&mut self, updates: &[Update]) {
        self.backend.apply(updates).expect("a possible batch");
        self.oracle.apply(updates).expect("a possible batch");
    }

    /// As many patches leave as enter, in one batch.
    fn swap(&mut self, count: usize) {
        let mut updates = self.streamed.leave(count);
        updates.extend(self.streamed.enter(count));
        self.apply(&updates);
    }

    /// A lamp on a few patches, and something from outside on all, part of it the sky's in another colour.
    fn shine(&mut self, lamp: f32, outside: f32) {
        let slots = self.streamed.taken();
        let own = |slot: &Slot| if slot.0 % 16 == 3 { Rgb::new(1.0, 0.7, 0.4) * lamp } else { Rgb::ZERO };
        let direct: Vec<Rgb> = slots.iter().map(own).collect();
        let around = vec![Rgb::new(0.5, 0.6, 1.0) * outside; slots.len()];
        let sky = vec![Rgb::new(0.1, 0.2, 0.9) * outside; slots.len()];
        self.backend.set_sources(&slots, &direct, &around).expect("taken slots");
        self.backend.set_sky(&slots, &vec![0.05; slots.len()], &sky).expect("taken slots");
        self.oracle.set_sources(&slots, &direct, &around).expect("taken slots");
        self.oracle.step().expect("the CPU steps");
    }

    fn step(&mut self, frames: u32) {
        for _ in 0..frames {
            self.backend.step().expect("it steps");
        }
    }

    /// Steps until light has settled.
    fn settle(&mut self) {
        for _ in 0..SETTLE_FRAMES {
            self.step(1);
            self.light();
            self.backend.take_news(&mut Vec::new()).expect("it is told");
            if self.backend.is_settled() {
                return;
            }
        }
        panic!("{} has not settled in {SETTLE_FRAMES} frames", self.backend.method());
    }

    fn light(&mut self) -> Vec<Rgb> {
        read(&mut self.backend, &self.streamed.taken())
    }

    fn exact(&mut self) -> Vec<Rgb> {
        read(&mut self.oracle, &self.streamed.taken())
    }

    fn error(&mut self) -> f64 {
        let (light, exact) = (self.light(), self.exact());
        rel_rmse(&light, &exact)
    }
}

fn steady_light_is_the_matrix_and_constant_to_the_bit(make: MakeLight<'_>, method: Method) {
    let mut pair = Pair::new(make, settings(method));
    pair.shine(10.0, 1.0);
    pair.settle();
    let error = pair.error();
    assert!(error < SETTLED_REL, "{method}: {error}");
    let before = pair.light();
    for _ in 0..5 {
        assert!(!pair.backend.step().expect("it steps").recomputed, "{method}");
    }
    assert!(pair.light() == before, "{method}");
}

fn light_that_goes_off_and_on_returns(make: MakeLight<'_>, method: Method) {
    let mut pair = Pair::new(make, settings(method));
    pair.shine(10.0, 0.0);
    pair.settle();
    let first = pair.light();
    let brightest = first.iter().map(|light| light.max_element()).fold(0.0, f32::max);
    for _ in 0..2 {
        pair.shine(0.0, 0.0);
        pair.settle();
        let dark = pair.light().iter().map(|light| light.abs().max_element()).fold(0.0, f32::max);
        assert!(dark < 1e-4 * brightest, "{method}: {dark} of {brightest}");
        pair.shine(10.0, 0.0);
        pair.settle();
    }
    let error = rel_rmse(&pair.light(), &first);
    assert!(error < SETTLED_REL, "{method}: {error}");
}

/// Goal: patches come and go. Method: seeded swaps with steps between, then the oracle's light.
fn streaming_ends_at_the_matrix_of_who_is_there(make: MakeLight<'_>, method: Method) {
    let mut pair = Pair::new(make, settings(method));
    for _ in 0..20 {
        pair.swap(7);
        pair.shine(10.0, 1.0);
        pair.step(2);
    }
    pair.settle();
    let error = pair.error();
    assert!(error < SETTLED_REL, "{method}: {error}");
    // Nobody is left behind.
    let everybody = pair.streamed.leave(COUNT as usize);
    pair.apply(&everybody);
    pair.step(1);
    assert!((0..COUNT).all(|slot| !pair.backend.is_taken(Slot(slot))), "{method}");
}

/// Goal: nothing piles up. Method: hundreds of swaps and changes of light in a row, steps between some.
fn a_soak_stays_exact(make: MakeLight<'_>, method: Method) {
    let mut pair = Pair::new(make, settings(method));
    for round in 0..150u16 {
        pair.swap(1 + usize::from(round % 5));
        pair.shine(f32::from(round % 7), f32::from(round % 3));
        pair.step(u32::from(round % 2));
    }
    pair.shine(10.0, 1.0);
    pair.settle();
    let error = pair.error();
    assert!(error < SETTLED_REL, "{method}: {error}");
}

/// Goal: a change of light arrives. Method: frames until nine tenths of the way are gone, dark to lit and back.
fn a_step_of_light_takes_a_few_frames(make: MakeLight<'_>, method: Method) {
    let mut pair = Pair::new(make, settings(method));
    for (lamp, outside) in [(10.0f32, 1.0), (0.0, 1.0)] {
        let before = pair.exact();
        pair.shine(lamp, outside);
        let after = pair.exact();
        let all = rel_rmse(&before, &after);
        let frames = (1..=60).find(|_| {
            pair.step(1);
            let light = pair.light();
            rel_rmse(&light, &after) < 0.1 * all
        });
        assert!(frames.is_some_and(|frames| frames <= 6), "{method}: {frames:?}");
    }
}

/// Goal: no runaway. Method: a closed room at reflectance 0.95, where light ends at 20 times its source.
fn a_furnace_at_95_percent_stays_in_bounds(make: MakeLight<'_>, method: Method) {
    let room = ClosedBox::new(80, 9);
    let slots: Vec<Slot> = (0..80).map(Slot).collect();
    let mut backend = empty(make, 80, SolverSettings { history_weight: 0.5, ..settings(method) });
    for i in 0..80usize {
        let row = (0..=i).map(|j| (Slot(j as u32), room.form_factor(i, j))).collect();
        let column = (0..i).map(|j| (Slot(j as u32), room.form_factor(j, i))).collect();
        let (slot, area, reflectance) = (Slot(i as u32), room.area(i), Rgb::splat(0.95));
        backend.apply(&[Update::Add { slot, reflectance, area, row, column }]).expect("a free slot");
    }
    backend.set_sources(&slots, &[Rgb::ONE; 80], &[Rgb::ZERO; 80]).expect("taken slots");
    for _ in 0..300 {
        backend.step().expect("it steps");
    }
    let light = read(&mut backend, &slots);
    let mean = light.iter().map(|light| f64::from(light.x)).sum::<f64>() / 80.0;
    assert!((mean - 20.0).abs() < 0.4, "{method}: {mean}");
    assert!(light.iter().all(|light| (light.x - 20.0).abs() < 4.0), "{method}");
}

fn a_patch_that_sees_nothing_has_the_light_from_outside(make: MakeLight<'_>, method: Method) {
    let mut backend = empty(make, 3, SolverSettings { history_weight: 0.0, ..settings(method) });
    let (row, column, reflectance) = (Vec::new(), Vec::new(), Rgb::splat(0.5));
    backend.apply(&[Update::Add { slot: Slot(1), reflectance, area: 2.0, row, column }]).expect("free");
    backend.set_sources(&[Slot(1)], &[Rgb::ONE], &[Rgb::splat(3.0)]).expect("taken");
    for _ in 0..10 {
        backend.step().expect("it steps");
    }
    let light = read(&mut backend, &[Slot(1)])[0];
    assert!((light - Rgb::splat(3.0)).length() < 1e-5, "{method}: {light}");
}

/// Goal: nothing that is not light or a share of it gets in, and a refusal changes nothing. Method: every such call on a
/// patch that sees half of itself, then the light of its one source.
fn light_and_rows_that_cannot_be_are_refused(make: MakeLight<'_>, method: Method) {
    let mut backend = empty(make, 4, SolverSettings { history_weight: 0.95, ..settings(method) });
    let add = |row: &[f32]| Update::Add {
        slot: Slot(0),
        reflectance: Rgb::splat(0.5),
        area: 1.0,
        row: row.iter().map(|&share| (Slot(0), share)).collect(),
        column: Vec::new(),
    };
    for share in [-0.1, 1.5, f32::NAN, f32::INFINITY] {
        let refused = backend.apply(&[add(&[share])]);
        assert!(matches!(refused, Err(BackendError::Share(..))), "{method}, {share}: {refused:?}");
    }
    let refused = backend.apply(&[add(&[0.6, 0.41])]);
    assert!(matches!(refused, Err(BackendError::RowSum { slot: Slot(0), .. })), "{method}: {refused:?}");
    assert!(!backend.is_taken(Slot(0)), "{method}");
    backend.apply(&[add(&[0.5])]).expect("a free slot");
    backend.set_sources(&[Slot(0)], &[Rgb::ONE], &[Rgb::ZERO]).expect("taken");
    for light in [f32::INFINITY, f32::NAN, -1.0].map(|channel| Rgb::new(1.0, channel, 1.0)) {
        for (own, outside) in [(light, Rgb::ZERO), (Rgb::ZERO, light)] {
            let refused = backend.set_sources(&[Slot(0)], &[own], &[outside]);
            assert_eq!(refused, Err(BackendError::NotFinite(Slot(0))), "{method}, {light}");
        }
        assert!(backend.set_sky(&[Slot(0)], &[0.5], &[light]).is_err(), "{method}, {light}");
    }
    for share in [1.5, -0.1, f32::NAN] {
        assert!(backend.set_sky(&[Slot(0)], &[share], &[Rgb::ONE]).is_err(), "{method}, {share}");
    }
    let free = Err(BackendError::SlotFree(Slot(1)));
    assert_eq!(backend.set_sources(&[Slot(1)], &[Rgb::ONE], &[Rgb::ZERO]), free, "{method}");
    assert_eq!(backend.set_sky(&[Slot(1)], &[0.5], &[Rgb::ONE]), free, "{method}");
    for _ in 0..300 {
        backend.step().expect("it steps");
    }
    // Arriving: half of what leaves, which is the source and half of what arrives.
    let light = read(&mut backend, &[Slot(0)])[0];
    assert!((light - Rgb::splat(0.5 / 0.75)).abs().max_element() < 0.08, "{method}: {light}");
}

/// Goal: a method may change at any time. Method: settled light, then every method in turn; no published light moves
/// further than draws scatter, and the matrix, made in steps, is exact at last.
fn methods_change_without_a_jump(make: MakeLight<'_>) {
    let mut pair = Pair::new(make, settings(Method::Hybrid));
    pair.shine(10.0, 1.0);
    pair.settle();
    let to =
        [Method::Matrix, Method::Cdf, Method::Gather, Method::Alias, Method::Progressive, Method::Hybrid];
    for method in to {
        let before = pair.light();
        assert_eq!(pair.backend.set_solver(&settings(method)), Ok(true));
        for _ in 0..10 {
            pair.step(1);
            let moved = rel_rmse(&pair.light(), &before);
            assert!(moved < 0.02, "to {method}: {moved}");
        }
        assert_eq!(pair.backend.method(), method);
    }
}

/// Goal: whoever knows what one method told goes on with the next. Method: lamps change under each of some methods in turn,
/// with a matrix that is kept all the time for audits, and told its own light before.
fn what_is_told_outlives_a_change_of_method(make: MakeLight<'_>) {
    let mut pair = Pair::new(make, settings(Method::Matrix));
    assert_eq!(pair.backend.set_audited(true), Ok(true));
    let mut listener = Listener::default();
    let to = [Method::Matrix, Method::Hybrid, Method::Matrix, Method::Gather, Method::Progressive];
    for (method, lamp) in to.into_iter().zip([10.0, 1.0, 10.0, 2.0, 2.0]) {
        assert_eq!(pair.backend.set_solver(&settings(method)), Ok(true));
        pair.shine(lamp, 1.0);
        listener.hear_out(&mut pair.backend);
        assert_eq!(pair.backend.method(), method);
        listener.assert_knows(&mut pair.backend);
    }
}

/// Goal: draws are unbiased, bounces and outside included. Method: the mean over many frames without history.
fn draws_are_the_matrix_on_average(make: MakeLight<'_>, method: Method) {
    let mut pair = Pair::new(make, SolverSettings { history_weight: 0.9, ..settings(method) });
    pair.shine(10.0, 1.0);
    pair.step(100);
    let mut mean = vec![Rgb::ZERO; COUNT as usize];
    for _ in 0..600 {
        pair.step(1);
        mean.iter_mut().zip(pair.light()).for_each(|(mean, light)| *mean += light / 600.0);
    }
    let exact = pair.exact();
    let (error, noise) = (rel_rmse(&mean, &exact), pair.error());
    assert!(error < 0.016 && noise < 0.12, "{method}: {error} {noise}");
}

fn draws_follow_who_comes_and_goes(make: MakeLight<'_>, method: Method) {
    let few = SolverSettings { rebuild_items_per_step: 500, history_weight: 0.99, ..settings(method) };
    let mut pair = Pair::new(make, few);
    for _ in 0..20 {
        pair.swap(7);
        pair.shine(10.0, 1.0);
        pair.step(1);
    }
    pair.step(600);
    let error = pair.error();
    assert!(error < 0.06, "{method}: {error}");
}
