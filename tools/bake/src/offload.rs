//! The device of a bake for as long as it works: when it fails, that is said once, and the CPU does what is left.

use crate::progress::Progress;
use crate::summary::BakeSummary;
use earthshine_trace::ends::{CountedEnds, EndCounter, EndPlaces, Run, RunEnds, RunSum};
use earthshine_trace::{CasterError, Query, RayDevice, SceneTracer};
use std::collections::BTreeSet;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// A device with the scene's trees on it, if there is one, whether it has failed, and what it did.
pub(crate) struct Offload<'a> {
    counter: Option<Box<dyn EndCounter>>,
    failure: OnceLock<CasterError>,
    progress: &'a dyn Progress,
    rays: AtomicU64,
    returned_rays: AtomicU64,
    read_bytes: AtomicU64,
}

impl<'a> Offload<'a> {
    /// Puts the trees of `tracer` on `device`, and where rays through them end.
    pub(crate) fn new(
        device: Option<&dyn RayDevice>,
        tracer: &SceneTracer<'_>,
        places: impl FnOnce() -> EndPlaces,
        progress: &'a dyn Progress,
    ) -> Self {
        let counter = device.map(|device| device.counter(&tracer.layout(), &places()));
        let (counter, failure) = match counter.transpose() {
            Ok(counter) => (counter, None),
            Err(error) => (None, Some(error)),
        };
        let offload = Self {
            counter,
            failure: OnceLock::new(),
            progress,
            rays: AtomicU64::default(),
            returned_rays: AtomicU64::default(),
            read_bytes: AtomicU64::default(),
        };
        if let Some(error) = failure {
            offload.fail(error);
        }
        offload
    }

    /// Whether there is a device that has not failed.
    pub(crate) fn is_working(&self) -> bool {
        self.working().is_some()
    }

    fn working(&self) -> Option<&dyn EndCounter> {
        self.counter.as_deref().filter(|_| self.failure.get().is_none())
    }

    /// The ends of each of `runs` over `rays`, if there is a device that works.
    pub(crate) fn count(&self, rays: &[Query], runs: &[Run]) -> Option<Vec<RunEnds>> {
        let CountedEnds { runs: ends, read_bytes } =
            self.working()?.count(rays, runs).map_err(|error| self.fail(error)).ok()?;
        let whole = runs.iter().zip(&ends).filter(|(run, _)| !matches!(run.sum, RunSum::Facing(_)));
        let returned: BTreeSet<u32> =
            whole.flat_map(|(run, ends)| ends.unknown.iter().map(|place| run.first_ray + place)).collect();
        self.rays.fetch_add(rays.len() as u64, Ordering::Relaxed);
        self.returned_rays.fetch_add(returned.len() as u64, Ordering::Relaxed);
        self.read_bytes.fetch_add(read_bytes, Ordering::Relaxed);
        Some(ends)
    }

    /// The device is of no more use. Only the first failure is told.
    fn fail(&self, error: CasterError) {
        let mut is_first = false;
        let cause = self.failure.get_or_init(|| {
            is_first = true;
            error
        });
        if is_first {
            self.progress.device_failed(&cause.0);
        }
    }

    /// Books what it did and whether it failed.
    pub(crate) fn book(&self, summary: &mut BakeSummary) {
        summary.device_rays = self.rays.load(Ordering::Relaxed);
        summary.device_returned_rays = self.returned_rays.load(Ordering::Relaxed);
        summary.device_read_bytes = self.read_bytes.load(Ordering::Relaxed);
        summary.device_failure = self.failure.get().map(|error| error.0.clone());
    }
}
