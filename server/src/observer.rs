//! A look at the running service for tools in the same process: every tick, and the engine's own numbers.
//!
//! Metrics for operators are in [`crate::metrics`]; those are sums, these are single ticks.

use crate::engine_thread::SharedReport;
use earthshine_engine::{EngineMemory, EngineStats, Promise};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Ticks kept until they are taken; older ones are forgotten.
const TICKS_KEPT: usize = 1 << 14;

/// One tick of the engine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickSample {
    /// When it began, s of the engine's clock.
    pub time_s: f64,
    /// How long it took, s.
    pub tick_s: f64,
    /// Most patches that any session lacks within the promised radius.
    pub missing_near: u32,
}

/// Who holds how much of the server's memory, bytes. What is taken for a moment, and what the allocator keeps, is beside it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct ServerMemory {
    /// Of the engine.
    #[serde(flatten)]
    pub engine: EngineMemory,
    /// Ancestors of patches that the loader keeps for tiles to come.
    pub parent_bytes: u64,
    /// What clients were told: the codes of their volumes, from which deltas are made.
    pub told_bytes: u64,
}

impl ServerMemory {
    /// All of it.
    #[must_use]
    pub fn total_bytes(&self) -> u64 {
        self.engine.total_bytes() + self.parent_bytes + self.told_bytes
    }
}

/// The newest ticks, once somebody observes.
#[derive(Debug, Default)]
pub(crate) struct TickLog {
    is_observed: AtomicBool,
    ticks: Mutex<VecDeque<TickSample>>,
}

impl TickLog {
    pub(crate) fn push(&self, tick: TickSample) {
        if self.is_observed.load(Ordering::Relaxed) {
            let mut ticks = self.ticks.lock().unwrap_or_else(PoisonError::into_inner);
            if ticks.len() >= TICKS_KEPT {
                ticks.pop_front();
            }
            ticks.push_back(tick);
        }
    }
}

/// Sees what a [`Server`](crate::Server) does.
#[derive(Debug, Clone)]
pub struct Observer {
    /// Of before the first tick.
    promise: Arc<Promise>,
    report: Arc<SharedReport>,
    ticks: Arc<TickLog>,
}

impl Observer {
    pub(crate) fn new(promise: Arc<Promise>, report: Arc<SharedReport>, ticks: Arc<TickLog>) -> Self {
        ticks.is_observed.store(true, Ordering::Relaxed);
        Self { promise, report, ticks }
    }

    /// What the service promises now: it follows the rate at which ticks come.
    #[must_use]
    pub fn promise(&self) -> Arc<Promise> {
        let report = self.report.read();
        if report.ticked.is_some() { report.promise } else { Arc::clone(&self.promise) }
    }

    /// Ticks since this was asked last; after minutes the oldest are lost.
    #[must_use]
    pub fn take_ticks(&self) -> Vec<TickSample> {
        self.ticks.ticks.lock().unwrap_or_else(PoisonError::into_inner).drain(..).collect()
    }

    /// Who held how much a moment ago.
    #[must_use]
    pub fn memory(&self) -> ServerMemory {
        self.report.read().memory
    }

    /// The engine's numbers at its last tick.
    #[must_use]
    pub fn stats(&self) -> EngineStats {
        self.report.read().stats
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_kept_for_those_who_look_and_bounded() {
        let log = Arc::new(TickLog::default());
        let tick = |time_s| TickSample { time_s, tick_s: 0.01, missing_near: 0 };
        log.push(tick(1.0));
        let observer = Observer::new(Arc::default(), Arc::default(), Arc::clone(&log));
        assert_eq!(observer.take_ticks(), [], "nobody looked");
        (0..TICKS_KEPT + 5).for_each(|at| log.push(tick(at as f64)));
        let ticks = observer.take_ticks();
        assert_eq!((ticks.len(), ticks[0].time_s), (TICKS_KEPT, 5.0));
        assert_eq!(observer.take_ticks(), []);
    }
}
