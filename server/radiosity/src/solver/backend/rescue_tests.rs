//! Devices that fail, at any call, and others that come instead: light goes on, and ends where it would have ended.

use super::{MATRIX_ADDS_A_STEP, SolverBackend};
use crate::backend::{ApplyStats, Backend, BackendError, Repaired, Slot, StepStats, Update};
use crate::bench::Streamed;
use crate::closed_box::ClosedBox;
use crate::cpu::CpuBackend;
use crate::solver::row_light::{Frame, RowLight};
use crate::solver::{CpuRowLight, Light, Method, Residents, SolverSettings};
use earthshine_world::Rgb;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

const COUNT: usize = 150;

/// A device that may be gone, be without room, and be there again.
#[derive(Debug, Default)]
struct Machine {
    is_gone: AtomicBool,
    is_full: AtomicBool,
    /// What was lost with a device that is there again counts as gone.
    generation: AtomicU32,
    made: AtomicU32,
}

impl Machine {
    fn check(&self, generation: u32) -> Result<(), BackendError> {
        if self.is_full.load(Ordering::Relaxed) {
            return Err(BackendError::OutOfMemory { slots: 0, bytes: 1 });
        }
        if self.is_gone.load(Ordering::Relaxed) || self.generation.load(Ordering::Relaxed) != generation {
            return Err(BackendError::DeviceLost { cause: "pulled out".to_owned() });
        }
        Ok(())
    }

    fn lose(&self) {
        self.is_gone.store(true, Ordering::Relaxed);
        self.generation.fetch_add(1, Ordering::Relaxed);
    }

    fn return_to_work(&self) {
        self.is_gone.store(false, Ordering::Relaxed);
    }

    /// The generation of what is made now, if it can be.
    fn make(&self) -> Result<u32, BackendError> {
        let generation = self.generation.load(Ordering::Relaxed);
        self.check(generation)?;
        self.made.fetch_add(1, Ordering::Relaxed);
        Ok(generation)
    }
}

/// What the CPU does, on a machine that may fail.
struct Fallible<T> {
    inner: T,
    machine: Arc<Machine>,
    generation: u32,
}

impl<T> Fallible<T> {
    fn check(&self) -> Result<(), BackendError> {
        self.machine.check(self.generation)
    }
}

impl Backend for Fallible<CpuBackend> {
    fn capacity(&self) -> u32 {
        self.inner.capacity()
    }

    fn apply(&mut self, updates: &[Update]) -> Result<ApplyStats, BackendError> {
        self.check()?;
        self.inner.apply(updates)
    }

    fn is_taken(&self, slot: Slot) -> bool {
        self.inner.is_taken(slot)
    }

    fn set_sources(&mut self, slots: &[Slot], direct: &[Rgb], outside: &[Rgb]) -> Result<(), BackendError> {
        self.inner.set_sources(slots, direct, outside)
    }

    fn step(&mut self) -> Result<StepStats, BackendError> {
        self.check()?;
        self.inner.step()
    }

    fn read_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        self.check()?;
        self.inner.read_irradiance(slots, out)
    }

    fn drift(&mut self, seed: u64) -> f32 {
        self.inner.drift(seed)
    }

    fn repair(&mut self, columns_max: u32) -> Result<Repaired, BackendError> {
        self.check()?;
        self.inner.repair(columns_max)
    }

    fn resolve(&mut self) -> Result<(), BackendError> {
        self.check()?;
        self.inner.resolve()
    }
}

impl RowLight for Fallible<CpuRowLight> {
    fn come(&mut self, residents: &Residents, slot: usize) -> Result<(), BackendError> {
        self.check()?;
        self.inner.come(residents, slot)
    }

    fn leave(&mut self, residents: &Residents, slot: usize) -> Result<(), BackendError> {
        self.check()?;
        self.inner.leave(residents, slot)
    }

    fn change(&mut self, residents: &Residents, slot: usize, own: &Light, outside: &Light) {
        self.inner.change(residents, slot, own, outside);
    }

    fn outdate(&mut self, slot: usize) {
        self.inner.outdate(slot);
    }

    fn advance(&mut self, residents: &mut Residents, frame: Frame<'_>) -> Result<(), BackendError> {
        self.check()?;
        self.inner.advance(residents, frame)
    }

    fn is_settled(&self) -> bool {
        self.inner.is_settled()
    }

    fn read(&mut self, residents: &Residents, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        self.check()?;
        self.inner.read(residents, slots, out)
    }

    fn take_news(&mut self, residents: &Residents, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        self.check()?;
        self.inner.take_news(residents, news)
    }
}

fn settings(method: Method) -> SolverSettings {
    let history_weight = if method.is_endless() { 0.9 } else { 0.998 };
    SolverSettings { method, history_weight, samples_per_row: 64, ..SolverSettings::default() }
}

fn on(machine: &Arc<Machine>, settings: SolverSettings) -> SolverBackend {
    let (for_matrix, for_light) = (Arc::clone(machine), Arc::clone(machine));
    let matrix = Box::new(move |slots| {
        let generation = for_matrix.make()?;
        let inner = CpuBackend::new(slots).expect("a small matrix");
        Ok(Box::new(Fallible { inner, machine: Arc::clone(&for_matrix), generation }) as Box<dyn Backend>)
    });
    let light = Box::new(move |residents: &mut Residents, settings: &SolverSettings, light: &[Light]| {
        let generation = for_light.make()?;
        let inner = CpuRowLight::new(residents, settings, light);
        Ok(Box::new(Fallible { inner, machine: Arc::clone(&for_light), generation }) as Box<dyn RowLight>)
    });
    SolverBackend::with_light(COUNT as u32, settings, matrix, light).expect("sound settings")
}

/// A backend on a machine that may fail, and the exact light.
struct Life {
    machine: Arc<Machine>,
    backend: SolverBackend,
    exact: CpuBackend,
    streamed: Streamed,
}

impl Life {
    fn new(method: Method) -> Self {
        let machine = Arc::new(Machine::default());
        let mut life = Self {
            backend: on(&machine, settings(method)),
            machine,
            exact: CpuBackend::new(COUNT as u32).expect("a small matrix"),
            streamed: Streamed::new(ClosedBox::new(COUNT + 30, 5), COUNT, 5),
        };
        let entering = life.streamed.enter(COUNT);
        life.apply(&entering);
        life.shine();
        life
    }

    fn apply(&mut self, updates: &[Update]) {
        assert_eq!(self.backend.apply(updates), self.exact.apply(updates));
    }

    /// Some leave, others come.
    fn swap(&mut self) {
        let mut updates = self.streamed.leave(7);
        updates.extend(self.streamed.enter(7));
        self.apply(&updates);
        self.shine();
    }

    fn shine(&mut self) {
        let slots = self.streamed.taken();
        let own: Vec<Rgb> = slots.iter().map(|&slot| self.streamed.source(slot)).collect();
        let around = vec![Rgb::new(0.5, 0.6, 1.0); slots.len()];
        self.backend.set_sources(&slots, &own, &around).expect("taken slots");
        self.exact.set_sources(&slots, &own, &around).expect("taken slots");
    }

    fn light(&mut self) -> Vec<Rgb> {
        let slots = self.streamed.taken();
        let mut light = vec![Rgb::ZERO; slots.len()];
        self.backend.read_irradiance(&slots, &mut light).expect("taken slots");
        light
    }

    /// How far light is from the exact one in the root of mean squares, as a share.
    fn error(&mut self) -> f64 {
        self.exact.step().expect("the CPU works");
        let slots = self.streamed.taken();
        let mut exact = vec![Rgb::ZERO; slots.len()];
        self.exact.read_irradiance(&slots, &mut exact).expect("taken slots");
        let found = self.light();
        let square =
            |of: &mut dyn Iterator<Item = Rgb>| of.map(|rgb| f64::from(rgb.length_squared())).sum::<f64>();
        let gap = square(&mut found.iter().zip(&exact).map(|(found, exact)| *found - *exact));
        (gap / square(&mut exact.iter().copied())).sqrt()
    }

    /// Steps, as often; the largest error after any of them.
    fn steps(&mut self, count: usize) -> f64 {
        let mut worst = 0.0f64;
        for _ in 0..count {
            self.backend.step().expect("the CPU stands in");
            worst = worst.max(self.error());
        }
        worst
    }
}

/// What a method is off in a frame after something changed.
fn at_once(method: Method) -> f64 {
    if method.is_endless() { 0.5 } else { 0.35 }
}

/// What it is off in the end.
fn at_rest(method: Method) -> f64 {
    if method.is_endless() { 0.05 } else { 2e-3 }
}

const ALL: [Method; 6] =
    [Method::Matrix, Method::Gather, Method::Alias, Method::Cdf, Method::Progressive, Method::Hybrid];

/// Goal: who takes news alone knows all light, whoever computes it. Method: the machine is lost between a step and its news.
#[test]
fn news_of_a_lost_device_is_the_cpus() {
    for method in ALL {
        let mut life = Life::new(method);
        let mut told = BTreeMap::new();
        let mut news = Vec::new();
        for _ in 0..3 {
            life.backend.step().expect("a machine that works");
            life.backend.take_news(&mut news).expect("a machine that works");
        }
        life.swap();
        life.backend.step().expect("a machine that works");
        life.machine.lose();
        life.backend.take_news(&mut news).expect("the CPU stands in");
        told.extend(news);
        for (slot, light) in life.streamed.taken().iter().zip(life.light()) {
            assert_eq!(told.get(slot), Some(&light), "{method}");
        }
    }
}

/// Goal: light goes on when a device fails, whatever is asked of it then, and is exact again on the next. Method: it is lost
/// before updates, before a step, between a step and its light, and before a probe's repair.
#[test]
fn light_goes_on_without_the_device_and_returns_to_the_next() {
    for (method, moment) in ALL.into_iter().flat_map(|method| [0, 1, 2, 3].map(|moment| (method, moment))) {
        let mut life = Life::new(method);
        life.steps(100);
        assert!(life.error() < at_rest(method), "{method}: {}", life.error());
        let before = life.machine.made.load(Ordering::Relaxed);
        match moment {
            0 => {
                life.machine.lose();
                life.swap();
            }
            1 => life.machine.lose(),
            2 => {
                life.swap();
                life.backend.step().expect("a machine that works");
                life.machine.lose();
            }
            _ => {
                life.machine.lose();
                assert!(life.backend.repair(8).is_ok() && life.backend.resolve().is_ok());
            }
        }
        // Light of all patches is there at once, and never less.
        let dark = life.light().iter().filter(|light| light.max_element() <= 0.0).count();
        assert_eq!(dark, 0, "{method}, {moment}");
        let worst = life.steps(4);
        assert!(worst < at_once(method), "{method}, {moment}: {worst} on the CPU");
        life.swap();
        life.steps(100);
        assert!(life.error() < at_rest(method), "{method}, {moment}: {} on the CPU", life.error());
        assert_eq!(life.machine.made.load(Ordering::Relaxed), before, "nothing can be made");
        assert!(!life.backend.is_settled(), "it waits");

        life.machine.return_to_work();
        let worst = life.steps(COUNT / MATRIX_ADDS_A_STEP + 3);
        assert!(worst < at_once(method), "{method}, {moment}: {worst} on the way back");
        assert_eq!(life.machine.made.load(Ordering::Relaxed), before + 1, "{method}: one was made");
        assert_eq!(life.backend.method(), method);
        life.swap();
        life.steps(100);
        assert!(life.error() < at_rest(method), "{method}, {moment}: {} in the end", life.error());
    }
}

/// Goal: a backend that is made while the device is away works, and takes to it later; changes of method too.
#[test]
fn what_is_made_without_a_device_waits_for_it() {
    for method in ALL {
        let machine = Arc::new(Machine::default());
        machine.lose();
        let mut backend = on(&machine, settings(Method::Gather));
        assert_eq!(backend.set_solver(&settings(method)), Ok(true));
        assert_eq!(backend.set_audited(true), Ok(true));
        let mut streamed = Streamed::new(ClosedBox::new(COUNT, 5), COUNT, 5);
        let entering = streamed.enter(COUNT);
        backend.apply(&entering).expect("free slots");
        backend.step().expect("the CPU stands in");
        assert_eq!(machine.made.load(Ordering::Relaxed), 0);
        machine.return_to_work();
        for _ in 0..COUNT / MATRIX_ADDS_A_STEP + 3 {
            backend.step().expect("a machine that works");
        }
        assert_eq!(backend.method(), method);
        let made = if method == Method::Matrix { 1 } else { 2 };
        assert_eq!(machine.made.load(Ordering::Relaxed), made, "{method}, audited");
        assert!(backend.audit().is_ok());
    }
}

/// Goal: want of memory is no loss: the CPU goes on, and nobody asks again until somebody chooses.
#[test]
fn want_of_memory_is_not_waited_for() {
    for method in ALL {
        let mut life = Life::new(method);
        life.steps(100);
        let before = life.machine.made.load(Ordering::Relaxed);
        life.machine.is_full.store(true, Ordering::Relaxed);
        life.swap();
        let worst = life.steps(4);
        assert!(worst < at_once(method), "{method}: {worst}");
        life.machine.is_full.store(false, Ordering::Relaxed);
        life.steps(100);
        assert!(life.error() < at_rest(method), "{method}: {}", life.error());
        assert_eq!(life.machine.made.load(Ordering::Relaxed), before, "{method}");
        let other = if method == Method::Gather { Method::Hybrid } else { Method::Gather };
        assert_eq!(life.backend.set_solver(&settings(other)), Ok(true));
        assert_eq!(life.machine.made.load(Ordering::Relaxed), before + 1, "{method}");
    }
}

/// Goal: a matrix that there is no memory for is refused to an audit, and light stays where it is. Method: losing the device
/// afterwards is noticed.
#[test]
fn an_audit_without_memory_costs_no_light() {
    let mut life = Life::new(Method::Hybrid);
    life.steps(100);
    life.machine.is_full.store(true, Ordering::Relaxed);
    assert!(matches!(life.backend.set_audited(true), Err(BackendError::OutOfMemory { .. })));
    life.machine.is_full.store(false, Ordering::Relaxed);
    life.swap();
    life.steps(1);
    life.machine.lose();
    life.swap();
    life.steps(1);
    assert!(!life.backend.is_settled(), "it waits for the device that it was on");
}

/// Goal: what is not the device's fault is an error as ever.
#[test]
fn other_errors_are_not_rescued() {
    let mut life = Life::new(Method::Hybrid);
    let free = life.streamed.leave(1);
    life.apply(&free);
    let Update::Remove { slot } = free[0] else { panic!("it leaves") };
    let refused = life.backend.set_sources(&[slot], &[Rgb::ONE], &[Rgb::ONE]);
    assert_eq!(refused, Err(BackendError::SlotFree(slot)));
    assert_eq!(life.backend.method(), Method::Hybrid);
    life.steps(2);
}
