//! The one thread that owns the engine and its backends.
//!
//! It drains what has come, ticks, hands out what the tick asked for, and sleeps until the next. Cameras and
//! lights wait in one [`Mailbox`] a session, where the newest wins; decoded tiles wait in a bounded queue;
//! frames go out through `watch` channels, where the newest wins again. Nothing here ever waits for a
//! client or a disk. Start at [`EngineThread::run`].

use crate::loaded_engine::LoadedEngine;
use crate::metrics::Metrics;
use crate::observer::{ServerMemory, TickLog, TickSample};
use crate::pace::{News, Pace};
use crate::publish::Answered;
use crate::solver_wish::SolverWish;
use crate::takeover::{Attending, Takeover};
use crate::world_watch::NextWorld;
use earthshine_engine::{EngineConfig, EngineStats, Event, Frame, Promise, SessionId};
use earthshine_world::{Camera, LightRig, WorldIndex};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot, watch};

/// How often what is held in memory is added up.
const MEMORY_PERIOD: Duration = Duration::from_millis(100);

/// A frame on its way to a session, and the camera that it answers.
#[derive(Debug, Clone)]
pub(crate) struct Published {
    /// Whole.
    pub(crate) frame: Arc<Frame>,
    /// The newest camera that the engine had seen.
    pub(crate) camera: Answered,
}

/// A session's newest frame; `None` before the first.
pub(crate) type FrameSlot = Option<Published>;

/// What one session wants of the engine: the newest of each kind, taken at every tick.
#[derive(Debug, Default)]
pub(crate) struct Mailbox {
    newest: Mutex<Wishes>,
}

#[derive(Debug, Default)]
struct Wishes {
    camera: Option<(u64, Camera)>,
    lights: Option<LightRig>,
}

impl Mailbox {
    fn lock(&self) -> MutexGuard<'_, Wishes> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts in a camera; whether it replaced one that the engine had not seen.
    pub(crate) fn put_camera(&self, sequence: u64, camera: Camera) -> bool {
        self.lock().camera.replace((sequence, camera)).is_some()
    }

    /// Puts in lights.
    pub(crate) fn put_lights(&self, lights: LightRig) {
        self.lock().lights = Some(lights);
    }
}

/// A session that wants to be served. It ends when the receiver of `frames` is dropped, however that happens.
#[derive(Debug)]
pub(crate) struct Opening {
    /// Its name.
    pub(crate) session: SessionId,
    /// What it wants.
    pub(crate) mailbox: Arc<Mailbox>,
    /// Where its frames go.
    pub(crate) frames: watch::Sender<FrameSlot>,
}

/// The engine at its last tick, for metrics, health and statistics.
#[derive(Debug, Clone, Default)]
pub(crate) struct EngineReport {
    /// Its own counters.
    pub(crate) stats: EngineStats,
    /// What it promises now.
    pub(crate) promise: Arc<Promise>,
    /// Duration of the tick, s.
    pub(crate) tick_s: f64,
    /// The engine's clock, s.
    pub(crate) time_s: f64,
    /// Tiles asked for and not answered.
    pub(crate) tiles_pending: usize,
    /// Who held how much when that was last added up.
    pub(crate) memory: ServerMemory,
    /// When the tick ended; `None` before the first.
    pub(crate) ticked: Option<Instant>,
}

/// The newest report, written by the engine's thread alone.
#[derive(Debug, Default)]
pub(crate) struct SharedReport(Mutex<EngineReport>);

impl SharedReport {
    /// A copy.
    pub(crate) fn read(&self) -> EngineReport {
        self.lock().clone()
    }

    pub(crate) fn write(&self, report: EngineReport) {
        *self.lock() = report;
    }

    fn lock(&self) -> MutexGuard<'_, EngineReport> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Handle of the running thread.
#[derive(Debug)]
pub(crate) struct EngineHandle {
    stop: Arc<AtomicBool>,
    /// Resolves when the thread has ended, with the reason if it was not asked to.
    pub(crate) ended: oneshot::Receiver<Option<String>>,
    /// To be joined after [`Self::stop`].
    pub(crate) thread: JoinHandle<()>,
}

impl EngineHandle {
    /// Asks the thread to end after the present tick.
    pub(crate) fn stop(&self) {
        self.stop.store(true, Ordering::Release);
        self.thread.thread().unpark();
    }
}

/// Everything the thread works with.
pub(crate) struct EngineThread {
    /// The state machine and its loader.
    pub(crate) running: LoadedEngine,
    /// Time between two ticks.
    pub(crate) period: Duration,
    /// New sessions.
    pub(crate) openings: mpsc::Receiver<Opening>,
    /// New states of the world.
    pub(crate) worlds: mpsc::Receiver<NextWorld>,
    /// What is in the world that is served, for sessions to come.
    pub(crate) served: watch::Sender<Arc<WorldIndex>>,
    /// Where each tick is reported.
    pub(crate) report: Arc<SharedReport>,
    /// Each tick, for those who observe.
    pub(crate) ticks: Arc<TickLog>,
    /// Tick times.
    pub(crate) metrics: Arc<Metrics>,
    /// How operators want light to be solved.
    pub(crate) solver: Arc<SolverWish>,
}

struct Client {
    mailbox: Arc<Mailbox>,
    frames: watch::Sender<FrameSlot>,
    camera: Option<Answered>,
    /// The newest of each, for an engine that takes over.
    outlook: Option<Camera>,
    lights: Option<LightRig>,
}

impl Client {
    /// Has its session send `frame`, as the answer to its newest camera.
    fn show(&self, frame: Arc<Frame>) {
        if let Some(camera) = self.camera {
            self.frames.send_replace(Some(Published { frame, camera }));
        }
    }
}

struct Running {
    shell: EngineThread,
    started: Instant,
    clients: BTreeMap<SessionId, Client>,
    /// The engine of a new state of the world, until it is as good as the present one.
    takeover: Option<Takeover>,
    events: Vec<Event>,
    pace: Pace,
    memory: ServerMemory,
    memory_added_up: Option<Instant>,
}

impl EngineThread {
    /// Starts the thread, named `earthshine-engine`.
    pub(crate) fn start(self) -> std::io::Result<EngineHandle> {
        let stop = Arc::new(AtomicBool::new(false));
        let (say_ended, ended) = oneshot::channel();
        let stopping = Arc::clone(&stop);
        let thread = std::thread::Builder::new().name("earthshine-engine".to_owned()).spawn(move || {
            let outcome = catch_unwind(AssertUnwindSafe(|| self.run(&stopping)));
            let cause = outcome.err().map(|panic| said(panic.as_ref()));
            // Nobody listens any more if the service was dropped meanwhile.
            drop(say_ended.send(cause));
        })?;
        Ok(EngineHandle { stop, ended, thread })
    }

    fn run(self, stop: &AtomicBool) {
        let period = self.period;
        let mut running = Running {
            shell: self,
            started: Instant::now(),
            clients: BTreeMap::new(),
            takeover: None,
            events: Vec::new(),
            pace: Pace::new(1.0 / period.as_secs_f64().max(1e-6)),
            memory: ServerMemory::default(),
            memory_added_up: None,
        };
        let mut due = Instant::now();
        while !stop.load(Ordering::Acquire) {
            let now = Instant::now();
            if now < due {
                std::thread::park_timeout(due - now);
                continue;
            }
            running.tick();
            // A long tick is not made up for: the next one begins when it was due, or now.
            due += period;
            let now = Instant::now();
            if now > due {
                running.shell.metrics.ticks_late.inc();
                due = now;
            }
        }
        // The loader may be another than the one that the server knows.
        running.shell.running.requests.stop();
        if let Some(takeover) = running.takeover {
            takeover.next.loaded.requests.stop();
        }
    }
}

/// Openings that wait, without those of sessions that are over: who came and left between two ticks is never opened. The
/// engine would count it beside whoever has its place by now, and with all places taken ignore the one that is still there.
fn lasting(openings: &mut mpsc::Receiver<Opening>) -> Vec<Opening> {
    let mut all: Vec<Opening> = std::iter::from_fn(|| openings.try_recv().ok()).collect();
    // Once all are taken: a place is free only after its session is over.
    all.retain(|opening| !opening.frames.is_closed());
    all
}

/// What a panic said, as far as it can be told.
fn said(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "a panic without words".to_owned())
}

impl Running {
    fn tick(&mut self) {
        let began = Instant::now();
        let time_s = began.duration_since(self.started).as_secs_f64();
        self.collect_sessions();
        self.events.extend(self.shell.solver.take().map(|solver| Event::Solver { solver }));
        self.hear_of_worlds();
        let events = std::mem::take(&mut self.events);
        let clients = &self.clients;
        let publish = |frame: Arc<Frame>| {
            if let Some(client) = clients.get(&frame.session) {
                client.show(frame);
            }
        };
        let done = self.shell.running.tick(time_s, events, publish).done;
        self.answer_cameras();
        self.take_over(time_s);
        let tick_s = began.elapsed().as_secs_f64();
        self.keep_pace(tick_s, done.swap_work);
        self.shell.metrics.tick_seconds.observe(tick_s);
        self.add_up_memory();
        let LoadedEngine { engine, requests, .. } = &self.shell.running;
        let stats = engine.stats();
        let missing_near = stats.sessions.iter().map(|session| session.missing_near).max().unwrap_or(0);
        self.shell.ticks.push(TickSample { time_s, tick_s, missing_near });
        self.shell.report.write(EngineReport {
            stats,
            promise: Arc::clone(engine.promise()),
            tick_s,
            time_s,
            tiles_pending: requests.pending(),
            memory: self.memory,
            ticked: Some(Instant::now()),
        });
    }

    /// Once in [`MEMORY_PERIOD`]: it looks at every resident patch.
    fn add_up_memory(&mut self) {
        if self.memory_added_up.is_some_and(|then| then.elapsed() < MEMORY_PERIOD) {
            return;
        }
        self.memory_added_up = Some(Instant::now());
        self.memory = ServerMemory {
            engine: self.shell.running.engine.memory(),
            parent_bytes: self.shell.running.requests.parents_bytes() as u64,
            told_bytes: u64::try_from(self.shell.metrics.told_bytes.get()).unwrap_or(0),
        };
    }

    /// Has the engine do what a tick has time for, and promise what it can keep at the rate at which busy ticks really come.
    fn keep_pace(&mut self, tick_s: f64, swap_work: u64) {
        let config = self.shell.running.engine.config();
        let most = u64::from(config.adds_per_tick_max) * u64::from(EngineConfig::CHEAPER_SWAPS_LIMIT);
        let news = self.pace.note(tick_s, swap_work as f64 / most as f64);
        if let Some(tick_rate_hz) = news.tick_rate_hz {
            tracing::info!(
                tick_rate_hz,
                "the promise counts on another rate of ticks: see the promised_ metrics"
            );
        }
        self.tell_pace(news);
    }

    fn tell_pace(&mut self, news: News) {
        self.events.extend(news.tick_rate_hz.map(|tick_rate_hz| Event::Pace { tick_rate_hz }));
        self.events.extend(news.effort.map(|share| Event::Effort { share }));
    }

    fn collect_sessions(&mut self) {
        // Openings are taken before endings are looked for: whoever took the place of a session that
        // ended must reach the engine after that ending.
        let openings = lasting(&mut self.shell.openings);
        let events = &mut self.events;
        self.clients.retain(|&session, client| {
            let open = !client.frames.is_closed();
            if !open {
                events.push(Event::SessionClosed { session });
            }
            open
        });
        for Opening { session, mailbox, frames } in openings {
            self.events.push(Event::SessionOpened { session });
            self.clients
                .insert(session, Client { mailbox, frames, camera: None, outlook: None, lights: None });
        }
        for (&session, client) in &mut self.clients {
            let Wishes { camera, lights } = std::mem::take(&mut *client.mailbox.lock());
            if let Some(lights) = lights {
                client.lights = Some(lights.clone());
                self.events.push(Event::Lights { session, lights });
            }
            if let Some((sequence, camera)) = camera {
                self.events.push(Event::Camera { session, camera });
                client.outlook = Some(camera);
                client.camera = Some(Answered { sequence, position: camera.position });
            }
        }
    }

    /// Starts a takeover where a new world is there, and passes on what has come where one is under way.
    fn hear_of_worlds(&mut self) {
        if let Some(takeover) = &mut self.takeover {
            takeover.hear(&self.events);
        } else if let Ok(next) = self.shell.worlds.try_recv() {
            let sessions = self.clients.iter().map(|(&session, client)| Attending {
                session,
                camera: client.outlook,
                lights: client.lights.clone(),
            });
            // The next engine was made as the configuration says, which operators may have overruled meanwhile.
            self.takeover = Some(Takeover::new(next, self.shell.solver.newest(), sessions));
        }
    }

    /// Lets the next engine work, and puts it in the present one's place once it is as good.
    fn take_over(&mut self, time_s: f64) {
        let watching: Vec<SessionId> =
            self.clients.iter().filter(|(_, client)| client.outlook.is_some()).map(|(&id, _)| id).collect();
        let Some(mut takeover) = self.takeover.take() else { return };
        if !takeover.tick(time_s, &watching) {
            self.takeover = Some(takeover);
            return;
        }
        self.shell.running.requests.stop();
        let Takeover { next, frames, .. } = takeover;
        self.shell.running = next.loaded;
        // It has counted on the configured rate so far, and on all of its budgets.
        self.tell_pace(self.pace.told());
        self.shell.served.send_replace(next.index);
        for (session, frame) in frames {
            if let Some(client) = self.clients.get(&session) {
                client.show(frame);
            }
        }
        self.shell.metrics.worlds_taken.inc();
        tracing::info!(sessions = watching.len(), "a new state of the world is served");
    }

    /// A camera that changed no light has its answer too: the frame before.
    fn answer_cameras(&self) {
        for client in self.clients.values() {
            let Some(newest) = client.camera else { continue };
            client.frames.send_if_modified(|slot| {
                let Some(published) = slot.as_mut().filter(|published| published.camera != newest) else {
                    return false;
                };
                published.camera = newest;
                true
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tile_loader::TileRequests;
    use earthshine_engine::Engine;
    use earthshine_world::{ChunkId, Vec3};

    #[test]
    fn in_a_mailbox_the_newest_wins() {
        let mailbox = Mailbox::default();
        let camera = |x| Camera { position: Vec3::splat(x), forward: Vec3::NEG_Z, velocity: Vec3::ZERO };
        assert!(!mailbox.put_camera(1, camera(1.0)));
        assert!(mailbox.put_camera(2, camera(2.0)));
        let wishes = std::mem::take(&mut *mailbox.lock());
        assert_eq!(wishes.camera, Some((2, camera(2.0))));
        assert!(mailbox.lock().camera.is_none());
    }

    /// Goal: an engine that breaks ends the service with its own words. Method: a backend that panics when built.
    #[tokio::test]
    async fn a_thread_that_breaks_says_why() {
        use earthshine_world::{Bounds, ChunkCoord, ChunkSummary, Grid};
        let id = ChunkId::new(0, ChunkCoord::ZERO);
        let index = WorldIndex {
            detail: 1,
            grid: Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 16 },
            bounds: Bounds { min: Vec3::ZERO, max: Vec3::ONE },
            chunks: vec![ChunkSummary { id, patch_count: 1, nonzero_count: 0, tile_bytes: 1 }],
            lights: LightRig::emission_only(),
        };
        let (served, _) = watch::channel(Arc::new(index.clone()));
        let engine = Engine::new(index, Default::default(), Box::new(|_| panic!("no such device"))).unwrap();
        let metrics = Arc::new(Metrics::new());
        let (open, openings) = mpsc::channel(1);
        let (_answers, tiles) = std::sync::mpsc::sync_channel(1);
        let (_next, worlds) = mpsc::channel(1);
        let running = LoadedEngine::new(engine, tiles, Arc::new(TileRequests::new(1)));
        let thread = EngineThread {
            running,
            period: Duration::from_millis(1),
            openings,
            worlds,
            served,
            report: Arc::default(),
            ticks: Arc::default(),
            metrics,
            solver: Arc::new(SolverWish::new(Default::default())),
        };
        let handle = thread.start().unwrap();
        let (frames, mut received) = watch::channel(None);
        let mailbox = Arc::new(Mailbox::default());
        mailbox.put_camera(1, Camera { position: Vec3::ZERO, forward: Vec3::X, velocity: Vec3::ZERO });
        open.send(Opening { session: SessionId(1), mailbox, frames }).await.unwrap();
        assert_eq!(handle.ended.await.unwrap(), Some("no such device".to_owned()));
        assert!(received.changed().await.is_err(), "sessions learn of it");
        handle.thread.join().unwrap();
    }

    /// Goal: of two sessions that had one place, one after the other within a tick, the engine opens the one that is there.
    #[test]
    fn a_session_that_came_and_left_within_a_tick_is_never_opened() {
        let (open, mut openings) = mpsc::channel(2);
        let opening = |number| {
            let (frames, receiver) = watch::channel(None);
            (Opening { session: SessionId(number), mailbox: Arc::default(), frames }, receiver)
        };
        let [(first, gone), (second, _here)] = [1, 2].map(opening);
        open.try_send(first).unwrap();
        drop(gone);
        open.try_send(second).unwrap();
        let opened: Vec<SessionId> = lasting(&mut openings).iter().map(|opening| opening.session).collect();
        assert_eq!(opened, [SessionId(2)]);
    }

    #[test]
    fn a_panic_is_quoted() {
        let panic = catch_unwind(|| panic!("slot {} is taken", 3)).unwrap_err();
        assert_eq!(said(panic.as_ref()), "slot 3 is taken");
    }
}
