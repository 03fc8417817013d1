//! Every method against the matrix, through the trait: steady light, steps of light, streaming, changes of method.

mod clearing;
mod settling;

use super::links::LinkRows;
use super::sampler::{FAR, RowSampler, SKY};
use super::shooting::SETTLE_FRAMES;
use super::{DrawnRows, Method, SettingsError, SolverBackend, SolverSettings};
use crate::backend::{Backend, BackendError, Slot, Update};
use crate::bench::{Streamed, read, rel_rmse};
use crate::closed_box::ClosedBox;
use crate::cpu::CpuBackend;
use crate::tables::{AliasTable, RowTable};
use earthshine_world::Rgb;

const COUNT: u32 = 150;
const SETTLING: [Method; 4] = [Method::Matrix, Method::Gather, Method::Progressive, Method::Hybrid];

fn settings(method: Method) -> SolverSettings {
    SolverSettings { method, ..SolverSettings::default() }
}

fn empty(capacity: u32, settings: SolverSettings) -> SolverBackend {
    let make = |capacity| {
        let matrix: Box<dyn Backend> = Box::new(CpuBackend::new(capacity).expect("a small matrix"));
        Ok(matrix)
    };
    SolverBackend::new(capacity, settings, Box::new(make)).expect("sound settings")
}

/// A backend and the matrix that it is held against, with the same patches and light.
struct Pair {
    backend: SolverBackend,
    oracle: CpuBackend,
    streamed: Streamed,
}

impl Pair {
    /// Five in six patches of a room are resident.
    fn new(settings: SolverSettings) -> Self {
        let mut streamed = Streamed::new(ClosedBox::new(COUNT as usize * 6 / 5, 5), COUNT as usize, 5);
        let (mut backend, mut oracle) =
            (empty(COUNT, settings), CpuBackend::new(COUNT).expect("a small matrix"));
        let updates = streamed.enter(COUNT as usize);
        backend.apply(&updates).expect("free slots");
        oracle.apply(&updates).expect("free slots");
        Self { backend, oracle, streamed }
    }

    /// A lamp on a few patches, and something from outside on all.
    fn shine(&mut self, lamp: f32, outside: f32) {
        let slots = self.streamed.taken();
        let direct: Vec<Rgb> = slots
            .iter()
            .map(|slot| if slot.0 % 16 == 3 { Rgb::new(1.0, 0.7, 0.4) * lamp } else { Rgb::ZERO })
            .collect();
        let around = vec![Rgb::new(0.5, 0.6, 1.0) * outside; slots.len()];
        self.backend.set_sources(&slots, &direct, &around).expect("taken slots");
        // Part of what comes from outside is the sky's, in another colour.
        let sky = vec![Rgb::new(0.1, 0.2, 0.9) * outside; slots.len()];
        self.backend.set_sky(&slots, &vec![0.05; slots.len()], &sky).expect("taken slots");
        self.oracle.set_sources(&slots, &direct, &around).expect("taken slots");
        self.oracle.step().expect("the CPU steps");
    }

    fn exact(&mut self) -> Vec<Rgb> {
        read(&mut self.oracle, &self.streamed.taken())
    }

    fn light(&mut self) -> Vec<Rgb> {
        read(&mut self.backend, &self.streamed.taken())
    }

    fn step(&mut self, frames: u32) {
        for _ in 0..frames {
            self.backend.step().expect("the CPU steps");
        }
    }

    fn error(&mut self) -> f64 {
        let (light, exact) = (self.light(), self.exact());
        rel_rmse(&light, &exact)
    }
}

#[test]
fn what_settles_is_the_matrix() {
    for method in SETTLING {
        let mut pair = Pair::new(settings(method));
        pair.shine(10.0, 1.0);
        pair.step(SETTLE_FRAMES);
        assert!(pair.backend.is_settled(), "{method}");
        let error = pair.error();
        assert!(error < 1e-4, "{method}: {error}");
    }
}

/// Goal: draws are unbiased, bounces and outside included. Method: the mean over many frames without history; the error
/// of a thousand frames is some seventh of a frame's, as each keeps nine tenths of the last.
#[test]
fn what_draws_is_the_matrix_on_average() {
    for (method, adaptive, rows) in [
        (Method::Alias, false, DrawnRows::FormFactors),
        (Method::Cdf, false, DrawnRows::FormFactors),
        (Method::Alias, true, DrawnRows::FormFactors),
        (Method::Alias, false, DrawnRows::Multibounce),
        (Method::Cdf, true, DrawnRows::Multibounce),
    ] {
        let mut pair = Pair::new(SolverSettings { history_weight: 0.9, adaptive, rows, ..settings(method) });
        pair.shine(10.0, 1.0);
        pair.step(200);
        let mut mean = vec![Rgb::ZERO; COUNT as usize];
        for _ in 0..1000 {
            pair.step(1);
            mean.iter_mut().zip(pair.light()).for_each(|(mean, light)| *mean += light / 1000.0);
        }
        let exact = pair.exact();
        let (error, noise) = (rel_rmse(&mean, &exact), pair.error());
        assert!(error < 0.013 && noise < 0.12, "{method} {adaptive} {rows:?}: {error} {noise}");
    }
}

#[test]
fn a_long_history_has_little_noise() {
    let mut pair = Pair::new(settings(Method::Alias));
    pair.shine(10.0, 1.0);
    pair.step(4000);
    let error = pair.error();
    assert!((1e-4..0.03).contains(&error), "{error}");
}

/// Goal: a change of light arrives. Method: frames until nine tenths of the way are gone, dark to lit and back.
#[test]
fn a_step_of_light_takes_a_hybrid_a_few_frames() {
    for method in [Method::Hybrid, Method::Progressive] {
        let mut pair = Pair::new(settings(method));
        for (lamp, least) in [(10.0f32, 1.0), (0.0, 1.0)] {
            let before = pair.exact();
            pair.shine(lamp, least);
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
}

#[test]
fn with_nothing_changing_light_is_constant_to_the_bit() {
    for method in SETTLING {
        let mut pair = Pair::new(settings(method));
        pair.shine(10.0, 1.0);
        pair.step(SETTLE_FRAMES);
        let before = pair.light();
        for _ in 0..50 {
            assert!(!pair.backend.step().expect("the CPU steps").recomputed, "{method}");
        }
        assert!(pair.light() == before, "{method}");
    }
}

#[test]
fn light_that_goes_off_and_on_returns() {
    for method in [Method::Gather, Method::Progressive, Method::Hybrid, Method::Matrix] {
        let mut pair = Pair::new(settings(method));
        pair.shine(10.0, 0.0);
        pair.step(SETTLE_FRAMES);
        let first = pair.light();
        for _ in 0..5 {
            pair.shine(0.0, 0.0);
            pair.step(SETTLE_FRAMES);
            let dark = pair.light();
            let dark = dark.iter().map(|light| light.abs().max_element()).fold(0.0, f32::max);
            let bright = first.iter().map(|light| light.max_element()).fold(0.0, f32::max);
            assert!(dark < 1e-4 * bright, "{method}: {dark} of {bright}");
            pair.shine(10.0, 0.0);
            pair.step(SETTLE_FRAMES);
        }
        let error = rel_rmse(&pair.light(), &first);
        assert!(error < 1e-4, "{method}: {error}");
    }
}

/// Goal: no runaway. Method: a closed room at reflectance 0.95, where light ends at 20 times its source, and any factor
/// too much on the feedback path would end far above.
#[test]
fn a_closed_room_at_95_percent_stays_in_bounds() {
    let room = ClosedBox::new(80, 9);
    let slots: Vec<Slot> = (0..80).map(Slot).collect();
    for method in Method::ALL {
        let mut backend = empty(80, SolverSettings { history_weight: 0.5, ..settings(method) });
        for i in 0..80usize {
            let row = (0..=i).map(|j| (Slot(j as u32), room.form_factor(i, j))).collect();
            let column = (0..i).map(|j| (Slot(j as u32), room.form_factor(j, i))).collect();
            let (slot, area, reflectance) = (Slot(i as u32), room.area(i), Rgb::splat(0.95));
            backend.apply(&[Update::Add { slot, reflectance, area, row, column }]).expect("a free slot");
        }
        backend.set_sources(&slots, &[Rgb::ONE; 80], &[Rgb::ZERO; 80]).expect("taken slots");
        for _ in 0..600 {
            backend.step().expect("the CPU steps");
        }
        let light = read(&mut backend, &slots);
        let mean = light.iter().map(|light| f64::from(light.x)).sum::<f64>() / 80.0;
        // Every patch emits as much: irradiance is 1 / (1 - 0.95) everywhere.
        assert!((mean - 20.0).abs() < 0.4, "{method}: {mean}");
        assert!(light.iter().all(|light| (light.x - 20.0).abs() < 4.0), "{method}");
    }
}

/// Goal: patches come and go under every method. Method: seeded swaps with steps between, then the oracle's light.
#[test]
fn streaming_ends_at_the_matrix_of_who_is_there() {
    for method in [Method::Gather, Method::Progressive, Method::Hybrid, Method::Matrix] {
        let mut pair = Pair::new(settings(method));
        for _ in 0..40 {
            let leaving = pair.streamed.leave(7);
            let entering = pair.streamed.enter(7);
            for updates in [leaving, entering] {
                pair.backend.apply(&updates).expect("a possible batch");
                pair.oracle.apply(&updates).expect("a possible batch");
            }
            pair.shine(10.0, 1.0);
            pair.step(2);
        }
        pair.step(SETTLE_FRAMES);
        let error = pair.error();
        assert!(error < 2e-4, "{method}: {error}");
    }
}

#[test]
fn draws_follow_who_comes_and_goes() {
    let few = SolverSettings { rebuild_items_per_step: 500, ..settings(Method::Alias) };
    let coloured = SolverSettings { rows: DrawnRows::Multibounce, ..few };
    for settings in [few, SolverSettings { method: Method::Cdf, ..few }, coloured] {
        let mut pair = Pair::new(settings);
        let method = settings.method;
        for _ in 0..40 {
            let mut updates = pair.streamed.leave(7);
            updates.extend(pair.streamed.enter(7));
            pair.backend.apply(&updates).expect("a possible batch");
            pair.oracle.apply(&updates).expect("a possible batch");
            pair.shine(10.0, 1.0);
            pair.step(1);
        }
        pair.step(4000);
        let error = pair.error();
        assert!(error < 0.04, "{method}: {error}");
    }
}

/// Goal: a method may change at any time. Method: settled light, then every method in turn; no published light moves
/// further than draws scatter, and the matrix, made in steps, is exact at last.
#[test]
fn methods_change_without_a_jump() {
    let mut pair = Pair::new(settings(Method::Hybrid));
    pair.shine(10.0, 1.0);
    pair.step(SETTLE_FRAMES);
    let all = [Method::Matrix, Method::Cdf, Method::Gather, Method::Alias, Method::Progressive];
    let plain = |method| (method, DrawnRows::FormFactors);
    let to =
        all.into_iter().map(plain).chain([(Method::Alias, DrawnRows::Multibounce), plain(Method::Alias)]);
    let back = [(Method::Cdf, DrawnRows::Multibounce), plain(Method::Matrix), plain(Method::Hybrid)];
    for (method, rows) in to.chain(back) {
        let before = pair.light();
        assert_eq!(pair.backend.set_solver(&SolverSettings { rows, ..settings(method) }), Ok(true));
        for _ in 0..10 {
            pair.step(1);
            let moved = rel_rmse(&pair.light(), &before);
            assert!(moved < 0.02, "to {method}: {moved}");
        }
        assert_eq!(pair.backend.method(), method);
        if method == Method::Matrix {
            let error = pair.error();
            assert!(error < 1e-5, "{error}");
        }
    }
    let refused = pair.backend.set_solver(&SolverSettings { samples_per_row: 0, ..settings(Method::Cdf) });
    assert_eq!(refused, Err(BackendError::Settings(SettingsError::Samples(0))));
    assert_eq!(pair.backend.method(), Method::Hybrid);
}

#[test]
fn an_audit_measures_what_the_oracle_does() {
    let mut pair = Pair::new(settings(Method::Alias));
    assert_eq!(pair.backend.audit(), Ok(None));
    assert_eq!(pair.backend.set_audited(true), Ok(true));
    pair.shine(10.0, 1.0);
    pair.step(20);
    let expected = pair.error();
    let found = pair.backend.audit().expect("the CPU steps").expect("a whole matrix");
    assert!((f64::from(found) - expected).abs() < 1e-3 * expected, "{found} {expected}");
    // A patch that leaves, leaves the matrix as well.
    let updates = pair.streamed.leave(3);
    pair.backend.apply(&updates).expect("resident");
    pair.oracle.apply(&updates).expect("resident");
    pair.shine(5.0, 1.0);
    pair.step(1);
    let expected = pair.error();
    let found = pair.backend.audit().expect("the CPU steps").expect("a whole matrix");
    assert!((f64::from(found) - expected).abs() < 1e-3 * expected, "{found} {expected}");
}

/// Goal: a table that waits for its turn is still a distribution. Method: patches leave and no table is rebuilt.
#[test]
fn a_stale_row_looks_outside_for_who_has_left() {
    let mut pair = Pair::new(settings(Method::Gather));
    let mut sampler = RowSampler::<AliasTable>::new(pair.backend.links());
    let sky_shares = vec![0.05; COUNT as usize];
    let rebuilt = sampler.rebuild(pair.backend.links(), &sky_shares, &[], u32::MAX).expect("sound rows");
    assert_eq!((rebuilt.rows, rebuilt.waiting), (COUNT, 0));
    let gone = pair.streamed.taken()[7].0 as usize;
    let neighbours: Vec<usize> =
        pair.backend.links().row(gone).iter().map(|link| link.slot as usize).collect();
    pair.backend.apply(&[Update::Remove { slot: Slot(gone as u32) }]).expect("resident");
    sampler.forget(gone, neighbours.iter().copied());
    for &row in neighbours.iter().filter(|&&row| row != gone) {
        let row = sampler.row(row);
        assert!(row.outcomes.iter().all(|&outcome| outcome != gone as u32));
        let of = |wanted| row.outcomes.iter().filter(|&&outcome| outcome == wanted).count();
        assert_eq!((of(FAR), of(SKY)), (2, 1));
        assert!((row.table.total() - 1.0).abs() < 1e-5);
    }
    let urgent: Vec<u32> = vec![gone as u32, neighbours[4] as u32];
    let first = sampler.rebuild(pair.backend.links(), &sky_shares, &urgent, 1).expect("sound rows");
    assert_eq!((first.rows, first.waiting as usize), (1, neighbours.len() - 1));
    let nearest = sampler.row(neighbours[4]);
    assert!(nearest.outcomes.iter().filter(|&&outcome| outcome == FAR).count() == 1, "the most urgent first");
    assert_eq!(sampler.clamped(), 0);
    assert!(sampler.bytes() > 0);
}

#[test]
fn light_and_rows_that_cannot_be_are_refused() {
    for method in [Method::Matrix, Method::Alias, Method::Hybrid] {
        let mut backend = empty(4, settings(method));
        let add = |share: f32| Update::Add {
            slot: Slot(0),
            reflectance: Rgb::splat(0.5),
            area: 1.0,
            row: vec![(Slot(0), share)],
            column: Vec::new(),
        };
        for share in [-0.1, 1.5, f32::NAN] {
            assert!(matches!(backend.apply(&[add(share)]), Err(BackendError::Share(..))), "{share}");
        }
        let Update::Add { slot, reflectance, area, column, .. } = add(0.5) else { panic!("an add") };
        let row = vec![(slot, 0.6), (slot, 0.41)];
        let too_much = Update::Add { slot, reflectance, area, row, column };
        let error = backend.apply(&[too_much]).expect_err("more than all");
        assert!(matches!(error, BackendError::RowSum { slot: Slot(0), .. }), "{error}");
        backend.apply(&[add(0.5)]).expect("a free slot");
        for light in [f32::INFINITY, f32::NAN, -1.0] {
            let error = backend.set_sources(&[Slot(0)], &[Rgb::splat(light)], &[Rgb::ZERO]);
            assert_eq!(error, Err(BackendError::NotFinite(Slot(0))), "{light}");
            let error = backend.set_sources(&[Slot(0)], &[Rgb::ZERO], &[Rgb::splat(light)]);
            assert_eq!(error, Err(BackendError::NotFinite(Slot(0))), "{light}");
        }
        assert!(backend.set_sources(&[Slot(1)], &[Rgb::ZERO], &[Rgb::ZERO]).is_err());
        let sky = |share, light| [Slot(0)].map(|slot| (slot, share, Rgb::splat(light)));
        for (share, light) in [(1.5, 1.0), (-0.1, 1.0), (f32::NAN, 1.0), (0.5, f32::INFINITY), (0.5, -1.0)] {
            let [(slot, share, light)] = sky(share, light);
            assert!(backend.set_sky(&[slot], &[share], &[light]).is_err(), "{share} {light}");
        }
        assert_eq!(backend.set_sky(&[Slot(1)], &[0.5], &[Rgb::ONE]), Err(BackendError::SlotFree(Slot(1))));
        assert_eq!(backend.set_order(&[Slot(4)]), Err(BackendError::SlotOutside(Slot(4), 4)));
    }
}

/// Goal: what is far and the sky are told apart. Method: a lone row of which a quarter is its own.
#[test]
fn far_and_sky_are_two_outcomes() {
    let mut links = LinkRows::new(1);
    links.add(0, 1.0, Rgb::ZERO, std::iter::once((0, 0.25)));
    let shares = |sky_share| {
        let mut sampler = RowSampler::<AliasTable>::new(&links);
        sampler.rebuild(&links, &[sky_share], &[], u32::MAX).expect("a sound row");
        let row = sampler.row(0);
        assert_eq!(row.outcomes, [0, FAR, SKY]);
        row.table.shares().into_iter().map(|share| (share * 1e4).round() / 1e4).collect::<Vec<_>>()
    };
    assert_eq!(shares(0.5), [0.25, 0.25, 0.5]);
    assert_eq!(shares(0.0), [0.25, 0.75, 0.0]);
    assert_eq!(shares(0.9), [0.25, 0.0, 0.75], "never more than there is outside");
}

/// A matrix that shows no rows is no ground to draw from, and that is said before anything changes.
#[test]
fn without_rows_of_a_matrix_none_are_drawn_from() {
    struct Shy(CpuBackend);
    impl Backend for Shy {
        fn capacity(&self) -> u32 {
            self.0.capacity()
        }
        fn apply(&mut self, updates: &[Update]) -> Result<crate::ApplyStats, BackendError> {
            self.0.apply(updates)
        }
        fn is_taken(&self, slot: Slot) -> bool {
            self.0.is_taken(slot)
        }
        fn set_sources(&mut self, slots: &[Slot], own: &[Rgb], outside: &[Rgb]) -> Result<(), BackendError> {
            self.0.set_sources(slots, own, outside)
        }
        fn step(&mut self) -> Result<crate::StepStats, BackendError> {
            self.0.step()
        }
        fn read_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
            self.0.read_irradiance(slots, out)
        }
        fn drift(&mut self, seed: u64) -> f32 {
            self.0.drift(seed)
        }
        fn resolve(&mut self) -> Result<(), BackendError> {
            self.0.resolve()
        }
    }
    let make = |capacity| {
        let matrix: Box<dyn Backend> = Box::new(Shy(CpuBackend::new(capacity).expect("a small matrix")));
        Ok(matrix)
    };
    let mut backend =
        SolverBackend::new(4, settings(Method::Hybrid), Box::new(make)).expect("sound settings");
    let coloured = SolverSettings { rows: DrawnRows::Multibounce, ..settings(Method::Cdf) };
    assert_eq!(backend.set_solver(&coloured), Err(BackendError::NoRows));
    assert_eq!(backend.method(), Method::Hybrid);
    backend.step().expect("it goes on");
    assert!(backend.is_settled());
}

/// Goal: what rounding leaves below zero is clamped and counted. Method: a row whose shares sum to a little above one.
#[test]
fn a_negative_rest_of_a_row_counts_as_none() {
    let mut links = LinkRows::new(2);
    links.add(0, 1.0, Rgb::ZERO, std::iter::empty());
    links.add(1, 1.0, Rgb::ZERO, [(0, 0.75), (1, 0.2501)].into_iter());
    let mut sampler = RowSampler::<AliasTable>::new(&links);
    sampler.rebuild(&links, &[0.5, 0.5], &[], u32::MAX).expect("sound rows");
    assert_eq!(sampler.clamped(), 1);
    let row = sampler.row(1);
    assert_eq!(row.table.shares()[2..], [0.0, 0.0], "neither far nor sky");
    assert!((row.table.total() - 1.0001).abs() < 1e-5);
}

/// A row of zeros is a patch that sees nothing: dark, never NaN.
#[test]
fn a_patch_that_sees_nothing_has_the_light_from_outside() {
    for method in Method::ALL {
        let mut backend = empty(3, SolverSettings { history_weight: 0.0, ..settings(method) });
        let (row, column, reflectance) = (Vec::new(), Vec::new(), Rgb::splat(0.5));
        backend.apply(&[Update::Add { slot: Slot(1), reflectance, area: 2.0, row, column }]).expect("free");
        backend.set_sources(&[Slot(1)], &[Rgb::ONE], &[Rgb::splat(3.0)]).expect("taken");
        for _ in 0..10 {
            backend.step().expect("the CPU steps");
        }
        let light = read(&mut backend, &[Slot(1)])[0];
        assert!((light - Rgb::splat(3.0)).length() < 1e-5, "{method}: {light}");
    }
}

#[test]
fn light_is_the_same_at_any_number_of_threads() {
    for method in Method::ALL {
        let live = || {
            let mut pair = Pair::new(settings(method));
            pair.shine(10.0, 1.0);
            pair.step(20);
            pair.light()
        };
        let on = |threads| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool").install(live)
        };
        assert!(on(1) == on(2), "{method}");
    }
}
