//! The device of a bake for as long as it works: when it fails, that is said once, and the CPU does what is left.

use crate::progress::Progress;
use crate::summary::BakeSummary;
use earthshine_trace::ends::{
    CountedEnds, EndCounter, EndPlaces, EndTriangle, FacedFans, FacedRays, FirstTriangles, Run, RunEnds,
    RunSum, Traffic,
};
use earthshine_trace::{CasterError, Query, RayDevice, RayFan, Rays, SceneTracer};
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
    sent_bytes: AtomicU64,
    read_bytes: AtomicU64,
}

impl<'a> Offload<'a> {
    /// Puts the trees of `tracer` on `device`, and its triangles.
    pub(crate) fn new(
        device: Option<&dyn RayDevice>,
        tracer: &SceneTracer<'_>,
        triangles: impl FnOnce() -> Vec<EndTriangle>,
        progress: &'a dyn Progress,
    ) -> Self {
        let counter = device.map(|device| device.counter(&tracer.layout(), &triangles()));
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
            sent_bytes: AtomicU64::default(),
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

    /// Tells the device where rays end, before it is asked for ends.
    pub(crate) fn settle(&self, places: impl FnOnce() -> EndPlaces) {
        if let Some(Err(error)) = self.working().map(|counter| counter.settle(&places())) {
            self.fail(error);
        }
    }

    /// What the rays of `fans` face, if there is a device that works.
    pub(crate) fn face(&self, fans: &[RayFan], near_m: f32) -> Option<Vec<FacedRays>> {
        let FacedFans { fans: faced, traffic } =
            self.working()?.face(fans, near_m).map_err(|error| self.fail(error)).ok()?;
        self.note(fans.iter().map(|fan| u64::from(fan.ray_count)).sum(), traffic);
        Some(faced)
    }

    /// What each of `rays` meets first, if there is a device that works.
    pub(crate) fn first(&self, rays: &[Query]) -> Option<Vec<Option<u32>>> {
        let FirstTriangles { triangles, traffic } =
            self.working()?.first(rays).map_err(|error| self.fail(error)).ok()?;
        self.note(rays.len() as u64, traffic);
        Some(triangles)
    }

    /// The ends of each of `runs` over `rays`, if there is a device that works.
    pub(crate) fn count(&self, rays: &Rays, runs: &[Run]) -> Option<Vec<RunEnds>> {
        let CountedEnds { runs: ends, traffic } =
            self.working()?.count(rays, runs).map_err(|error| self.fail(error)).ok()?;
        let whole = runs.iter().zip(&ends).filter(|(run, _)| !matches!(run.sum, RunSum::Facing(_)));
        let returned: BTreeSet<u32> =
            whole.flat_map(|(run, ends)| ends.unknown.iter().map(|place| run.first_ray + place)).collect();
        self.note(rays.count() as u64, traffic);
        self.note_returned(returned.len() as u64);
        Some(ends)
    }

    /// So many of the rays that it traced are of no use.
    pub(crate) fn note_returned(&self, rays: u64) {
        self.returned_rays.fetch_add(rays, Ordering::Relaxed);
    }

    fn note(&self, rays: u64, traffic: Traffic) {
        self.rays.fetch_add(rays, Ordering::Relaxed);
        self.sent_bytes.fetch_add(traffic.sent_bytes, Ordering::Relaxed);
        self.read_bytes.fetch_add(traffic.read_bytes, Ordering::Relaxed);
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

    /// Books what it did and whether it failed, once all rays are cast.
    pub(crate) fn book(&self, summary: &mut BakeSummary) {
        summary.device_rays = self.rays.load(Ordering::Relaxed);
        summary.device_returned_rays = self.returned_rays.load(Ordering::Relaxed);
        let kept = summary.device_rays.saturating_sub(summary.device_returned_rays);
        // Of receivers that lie inside of something fewer rays count than were asked about.
        summary.device_ray_share = (kept as f64 / summary.all_rays().max(1) as f64).min(1.0);
        summary.device_sent_bytes = self.sent_bytes.load(Ordering::Relaxed);
        summary.device_read_bytes = self.read_bytes.load(Ordering::Relaxed);
        summary.device_failure = self.failure.get().map(|error| error.0.clone());
    }
}
