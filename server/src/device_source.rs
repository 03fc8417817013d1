//! Where a device comes from, now and after it is lost: opened again by a thread of its own while light goes on without it.
//!
//! Opening takes seconds with some drivers, and the engine's thread has none. Whoever needs a device asks
//! [`DeviceSource::find`] and is told at once; who is told to wait stands in by the CPU and asks again with the next frame.

use crate::pipeline_file::DeviceOpener;
use earthshine_gpu::{GpuDevice, GpuError};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// After a device could not be opened again, the CPU computes for so long before another attempt.
const RETRY_AFTER: Duration = Duration::from_secs(10);

/// The device that backends are built on, if any; shared so that it can be looked at from outside the engine's thread.
#[derive(Debug, Clone, Default)]
pub struct CurrentDevice(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    device: Mutex<Option<GpuDevice>>,
    counts: DeviceCounts<AtomicU64>,
}

/// What has happened to devices since the start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DeviceCounts<T = u64> {
    /// Devices that were opened after one was lost.
    pub reopened: T,
    /// Attempts at it that failed.
    pub failed: T,
    /// Lights over rows that were left to the CPU, since kernels do not draw as they were asked to.
    pub left_to_cpu: T,
}

impl CurrentDevice {
    /// None where the CPU computes.
    #[must_use]
    pub fn get(&self) -> Option<GpuDevice> {
        self.0.device.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// As of now.
    #[must_use]
    pub fn counts(&self) -> DeviceCounts {
        let DeviceCounts { reopened, failed, left_to_cpu } = &self.0.counts;
        let [reopened, failed, left_to_cpu] =
            [reopened, failed, left_to_cpu].map(|count| count.load(Ordering::Relaxed));
        DeviceCounts { reopened, failed, left_to_cpu }
    }

    /// Counts a light that is left to the CPU; true for the first.
    pub(crate) fn note_left_to_cpu(&self) -> bool {
        self.0.counts.left_to_cpu.fetch_add(1, Ordering::Relaxed) == 0
    }

    pub(crate) fn set(&self, device: Option<GpuDevice>) {
        *self.0.device.lock().unwrap_or_else(PoisonError::into_inner) = device;
    }
}

/// Opens a device. Blocks for as long as the driver takes.
pub(crate) type Open = dyn Fn() -> Result<GpuDevice, GpuError> + Send + Sync;

impl From<DeviceOpener> for Arc<Open> {
    fn from(opener: DeviceOpener) -> Self {
        Arc::new(move || opener.open())
    }
}

/// What there is to compute on.
#[derive(Debug)]
pub(crate) enum Found {
    /// A device that is not known to be lost.
    Device(GpuDevice),
    /// One is being opened.
    Wait,
    /// None for now.
    Nothing,
}

#[derive(Debug, Clone, Copy)]
enum State {
    Idle,
    Opening,
    Failed { at: Instant },
}

/// The device and the way to another. Clones share both.
#[derive(Clone)]
pub(crate) struct DeviceSource {
    current: CurrentDevice,
    open: Arc<Open>,
    state: Arc<Mutex<State>>,
}

impl std::fmt::Debug for DeviceSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DeviceSource").field("current", &self.current).finish_non_exhaustive()
    }
}

impl DeviceSource {
    /// Nothing yet: `current` is set by who opens the first device.
    pub(crate) fn new(current: CurrentDevice, open: Arc<Open>) -> Self {
        Self { current, open, state: Arc::new(Mutex::new(State::Idle)) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What there is now; never waits. Begins to open a device where that is worth a try: one thread at a time does.
    pub(crate) fn find(&self) -> Found {
        if let Some(device) = self.current.get().filter(|device| !device.is_lost()) {
            return Found::Device(device);
        }
        let mut state = self.state();
        match *state {
            State::Opening => return Found::Wait,
            State::Failed { at } if at.elapsed() < RETRY_AFTER => return Found::Nothing,
            State::Idle | State::Failed { .. } => {}
        }
        *state = State::Opening;
        drop(state);
        tracing::warn!("a lost device is being opened again");
        let own = self.clone();
        let thread = std::thread::Builder::new().name("earthshine-device".to_owned());
        match thread.spawn(move || own.reopen()) {
            Ok(_) => Found::Wait,
            Err(error) => {
                self.note_failure(&error);
                Found::Nothing
            }
        }
    }

    /// On its own thread.
    fn reopen(&self) {
        // A driver that panics is one that fails.
        let opened = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| (self.open)()));
        match opened {
            Ok(Ok(device)) => {
                tracing::warn!(adapter = device.name(), "a lost device was opened again");
                self.current.0.counts.reopened.fetch_add(1, Ordering::Relaxed);
                self.current.set(Some(device));
                *self.state() = State::Idle;
            }
            Ok(Err(error)) => self.note_failure(&error),
            Err(_) => self.note_failure(&"its driver panicked"),
        }
    }

    fn note_failure(&self, error: &dyn std::fmt::Display) {
        tracing::error!(%error, "a lost device could not be opened again; computing on the CPU");
        self.current.0.counts.failed.fetch_add(1, Ordering::Relaxed);
        *self.state() = State::Failed { at: Instant::now() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Barrier;

    fn until(what: impl Fn() -> bool) {
        let began = Instant::now();
        while !what() {
            assert!(began.elapsed() < Duration::from_secs(20), "it never happens");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Goal: one thread opens, nobody waits for it, and a failure is not tried again at once. Method: an opener that waits
    /// to be let go and fails, one that panics, many who ask.
    #[test]
    fn one_thread_opens_and_everybody_else_is_told_to_wait() {
        for panics in [false, true] {
            let (gate, attempts) = (Arc::new(Barrier::new(2)), Arc::new(AtomicU64::new(0)));
            let (held, counted) = (Arc::clone(&gate), Arc::clone(&attempts));
            let open: Arc<Open> = Arc::new(move || {
                counted.fetch_add(1, Ordering::Relaxed);
                held.wait();
                assert!(!panics, "as drivers do");
                Err(GpuError::NoAdapter)
            });
            let source = DeviceSource::new(CurrentDevice::default(), open);
            for _ in 0..100 {
                assert!(matches!(source.find(), Found::Wait));
            }
            gate.wait();
            until(|| source.current.counts().failed == 1);
            until(|| matches!(source.find(), Found::Nothing));
            assert_eq!(attempts.load(Ordering::Relaxed), 1);
            *source.state() = State::Failed { at: Instant::now() - RETRY_AFTER };
            assert!(matches!(source.find(), Found::Wait), "its time has come");
            gate.wait();
            until(|| source.current.counts() == DeviceCounts { failed: 2, ..DeviceCounts::default() });
        }
    }
}
