//! A bounded pool of blocking reads: map, verify, decode, build the occluders, hand over.
//!
//! Requests are served in the order in which the engine made them, which is nearest first. The answers'
//! queue is bounded: while it is full the threads wait, so a busy engine slows the disk and not the reverse.
//! It decides nothing about residency. Start at [`TileLoader::start`].

use crate::lineage::LineageCache;
use crate::metrics::Metrics;
use earthshine_engine::Event;
use earthshine_light::Occluders;
use earthshine_tiles::TileStore;
use earthshine_world::ChunkId;
use std::collections::{BTreeSet, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

/// The engine's side of the pool: what is wanted, in order.
#[derive(Debug)]
pub(crate) struct TileRequests {
    queue: Mutex<Queue>,
    wake: Condvar,
    requests_max: usize,
    /// Memory of the ancestors that the loader keeps, bytes.
    parents_bytes: AtomicUsize,
}

#[derive(Debug, Default)]
struct Queue {
    waiting: VecDeque<ChunkId>,
    in_hand: BTreeSet<ChunkId>,
    /// Of those in hand: nobody wants them any more.
    cancelled: BTreeSet<ChunkId>,
    stopped: bool,
}

impl TileRequests {
    /// Empty, with room for `requests_max`.
    pub(crate) fn new(requests_max: u32) -> Self {
        let (queue, wake, requests_max) = (Mutex::default(), Condvar::new(), requests_max as usize);
        Self { queue, wake, requests_max, parents_bytes: AtomicUsize::new(0) }
    }

    /// Memory of the ancestors of patches that are kept for tiles to come, bytes.
    pub(crate) fn parents_bytes(&self) -> usize {
        self.parents_bytes.load(Ordering::Relaxed)
    }

    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Queues `chunk` behind what was asked before; `false` if as many wait as may.
    pub(crate) fn request(&self, chunk: ChunkId) -> bool {
        let mut queue = self.lock();
        if queue.waiting.len() >= self.requests_max {
            return false;
        }
        queue.waiting.push_back(chunk);
        drop(queue);
        self.wake.notify_one();
        true
    }

    /// Forgets `chunk`: unread it is not read, half read it is not answered.
    pub(crate) fn cancel(&self, chunk: ChunkId) {
        let mut queue = self.lock();
        let before = queue.waiting.len();
        queue.waiting.retain(|&waiting| waiting != chunk);
        if queue.waiting.len() == before && queue.in_hand.contains(&chunk) {
            queue.cancelled.insert(chunk);
        }
    }

    /// Tiles asked for and not answered.
    pub(crate) fn pending(&self) -> usize {
        let queue = self.lock();
        queue.waiting.len() + queue.in_hand.len()
    }

    /// Ends the pool: what waits is forgotten, threads end after the tile in hand.
    pub(crate) fn stop(&self) {
        let mut queue = self.lock();
        queue.stopped = true;
        queue.waiting.clear();
        drop(queue);
        self.wake.notify_all();
    }

    /// The next chunk to read; waits for one, `None` once stopped.
    fn take(&self) -> Option<ChunkId> {
        let mut queue = self.lock();
        loop {
            if queue.stopped {
                return None;
            }
            // A chunk that was cancelled in hand and asked for again waits for the first reading to end.
            let free = queue.waiting.iter().position(|chunk| !queue.in_hand.contains(chunk));
            if let Some(chunk) = free.and_then(|at| queue.waiting.remove(at)) {
                queue.in_hand.insert(chunk);
                return Some(chunk);
            }
            queue = self.wake.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn is_cancelled(&self, chunk: ChunkId) -> bool {
        self.lock().cancelled.contains(&chunk)
    }

    /// Marks `chunk` as done; whether it is still wanted.
    fn finish(&self, chunk: ChunkId) -> bool {
        let mut queue = self.lock();
        queue.in_hand.remove(&chunk);
        let wanted = !queue.cancelled.remove(&chunk);
        drop(queue);
        self.wake.notify_one();
        wanted
    }
}

/// The threads.
#[derive(Debug)]
pub(crate) struct TileLoader {
    /// What to read; shared with the engine's thread.
    pub(crate) requests: Arc<TileRequests>,
    /// To be joined after [`TileRequests::stop`].
    pub(crate) threads: Vec<JoinHandle<()>>,
}

impl TileLoader {
    /// Starts `thread_count` threads that read from `store` and answer into `answers`.
    pub(crate) fn start(
        store: &Arc<dyn TileStore>,
        thread_count: u32,
        requests_max: u32,
        answers: &SyncSender<Event>,
        metrics: &Arc<Metrics>,
    ) -> std::io::Result<Self> {
        let requests = Arc::new(TileRequests::new(requests_max));
        let lineages = Arc::new(LineageCache::default());
        let mut threads = Vec::new();
        for index in 0..thread_count {
            let worker = Worker {
                store: Arc::clone(store),
                requests: Arc::clone(&requests),
                answers: answers.clone(),
                metrics: Arc::clone(metrics),
                lineages: Arc::clone(&lineages),
            };
            let builder = std::thread::Builder::new().name(format!("earthshine-tile-{index}"));
            match builder.spawn(move || worker.run()) {
                Ok(thread) => threads.push(thread),
                Err(error) => {
                    requests.stop();
                    return Err(error);
                }
            }
        }
        Ok(Self { requests, threads })
    }
}

struct Worker {
    store: Arc<dyn TileStore>,
    requests: Arc<TileRequests>,
    answers: SyncSender<Event>,
    metrics: Arc<Metrics>,
    lineages: Arc<LineageCache>,
}

impl Worker {
    fn run(self) {
        while let Some(chunk) = self.requests.take() {
            let started = Instant::now();
            // A tile that trips a bug must cost that tile, not the pool.
            let answer = catch_unwind(AssertUnwindSafe(|| self.read(chunk))).unwrap_or_else(|_| {
                let cause = "the decoder panicked: please report this tile".to_owned();
                Some(Event::TileFailed { chunk, cause })
            });
            let wanted = self.requests.finish(chunk);
            let Some(answer) = answer.filter(|_| wanted) else {
                self.metrics.tiles_cancelled.inc();
                continue;
            };
            match &answer {
                Event::TileFailed { cause, .. } => {
                    tracing::warn!(%chunk, cause, "tile failed");
                    self.metrics.tiles_failed.inc();
                }
                _ => {
                    self.metrics.tiles_loaded.inc();
                    self.metrics.tile_seconds.observe(started.elapsed().as_secs_f64());
                }
            }
            if self.answers.send(answer).is_err() {
                return;
            }
        }
    }

    /// `None` if it was cancelled on the way.
    fn read(&self, id: ChunkId) -> Option<Event> {
        match self.store.load(id) {
            Err(error) => Some(Event::TileFailed { chunk: id, cause: error.to_string() }),
            Ok(_) if self.requests.is_cancelled(id) => None,
            Ok(mut chunk) => {
                // From here on the built occluders stand for the mesh; keeping both would double its memory.
                let mesh = std::mem::take(&mut chunk.occluders);
                let occluders = Arc::new(Occluders::build(&mesh));
                let lineage = self.lineages.of(&self.store, &chunk);
                self.requests.parents_bytes.store(self.lineages.bytes(), Ordering::Relaxed);
                Some(Event::TileDecoded { chunk: Arc::new(chunk), occluders, lineage })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_tiles::TileError;
    use earthshine_world::lineage::Parents;
    use earthshine_world::{Chunk, ChunkRows, OccluderMesh};
    use std::sync::mpsc::{Receiver, sync_channel};
    use std::time::Duration;

    /// Answers with empty chunks, once the gate is open; chunk -1 panics, chunk -2 is missing.
    struct GatedStore {
        gate: Mutex<Receiver<()>>,
    }

    impl TileStore for GatedStore {
        fn parents(&self, _id: ChunkId) -> Result<Option<Parents>, TileError> {
            Ok(None)
        }

        fn load(&self, id: ChunkId) -> Result<Chunk, TileError> {
            self.gate.lock().unwrap().recv().unwrap();
            assert_ne!(id.coord.x, -1, "this chunk panics");
            if id.coord.x == -2 {
                return Err(
                    earthshine_tiles::decode_bytes(&[], std::path::Path::new("empty.tile")).unwrap_err()
                );
            }
            let rows = ChunkRows { row_starts: vec![0], ..ChunkRows::default() };
            let receivers = earthshine_world::Receivers::default();
            Ok(Chunk {
                id,
                patches: vec![],
                points: vec![],
                rows,
                receivers,
                occluders: OccluderMesh::default(),
            })
        }
    }

    fn chunk(x: i32) -> ChunkId {
        ChunkId::new(0, earthshine_world::ChunkCoord::new(x, 0, 0))
    }

    fn pool(
        threads: u32,
        requests_max: u32,
        answers_max: usize,
    ) -> (TileLoader, SyncSender<()>, Receiver<Event>) {
        let (open, gate) = sync_channel(64);
        let (answers, received) = sync_channel(answers_max);
        let store: Arc<dyn TileStore> = Arc::new(GatedStore { gate: Mutex::new(gate) });
        let metrics = Arc::new(Metrics::new());
        (TileLoader::start(&store, threads, requests_max, &answers, &metrics).unwrap(), open, received)
    }

    fn id_of(event: &Event) -> (i32, bool) {
        match event {
            Event::TileDecoded { chunk, .. } => (chunk.id.coord.x, true),
            Event::TileFailed { chunk, .. } => (chunk.coord.x, false),
            other => panic!("unexpected {other:?}"),
        }
    }

    #[test]
    fn answers_come_in_order_and_faults_cost_one_tile() {
        let (loader, open, answers) = pool(1, 64, 8);
        for x in [3, -1, 1, -2, 2] {
            assert!(loader.requests.request(chunk(x)));
            open.send(()).unwrap();
        }
        let got: Vec<_> =
            (0..5).map(|_| id_of(&answers.recv_timeout(Duration::from_secs(5)).unwrap())).collect();
        assert_eq!(got, [(3, true), (-1, false), (1, true), (-2, false), (2, true)]);
        loader.requests.stop();
        loader.threads.into_iter().for_each(|thread| thread.join().unwrap());
    }

    #[test]
    fn cancelled_requests_are_not_answered_and_the_queue_is_bounded() {
        let (loader, open, answers) = pool(1, 2, 8);
        assert!(loader.requests.request(chunk(1)));
        while loader.requests.lock().in_hand.is_empty() {
            std::thread::yield_now();
        }
        assert!(loader.requests.request(chunk(2)) && loader.requests.request(chunk(3)));
        assert!(!loader.requests.request(chunk(4)), "two may wait");
        loader.requests.cancel(chunk(2));
        loader.requests.cancel(chunk(1));
        assert!(loader.requests.request(chunk(1)), "cancelled in hand, wanted again");
        for _ in 0..3 {
            open.send(()).unwrap();
        }
        let got: Vec<_> =
            (0..2).map(|_| id_of(&answers.recv_timeout(Duration::from_secs(5)).unwrap()).0).collect();
        assert_eq!(got, [3, 1]);
        assert_eq!(loader.requests.pending(), 0);
        loader.requests.stop();
        loader.threads.into_iter().for_each(|thread| thread.join().unwrap());
    }

    #[test]
    fn a_full_answer_queue_makes_threads_wait() {
        let (loader, open, answers) = pool(1, 64, 1);
        for x in 0..4 {
            assert!(loader.requests.request(chunk(x)));
            open.send(()).unwrap();
        }
        std::thread::sleep(Duration::from_millis(30));
        assert!(loader.requests.pending() >= 2, "one answered, one waiting to be");
        let got: Vec<_> =
            (0..4).map(|_| id_of(&answers.recv_timeout(Duration::from_secs(5)).unwrap()).0).collect();
        assert_eq!(got, [0, 1, 2, 3]);
        loader.requests.stop();
        drop(answers);
        loader.threads.into_iter().for_each(|thread| thread.join().unwrap());
    }
}
