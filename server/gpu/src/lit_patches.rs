//! Direct light of patches on its way from a device: means, and light on single points of patches where it differs.
//!
//! Patches are summed on the device ([`SUM_POINTS`]), which lists the points of those that are not lit alike
//! ([`LIST_POINTS`]) if anybody wants them.

use crate::device::GpuDevice;
use crate::flight::Flight;
use crate::recorder::{Recorder, folded};
use earthshine_light::{LightUnderWay, LitPatch};
use earthshine_radiosity::BackendError;
use earthshine_shaders::host::{LitPatch as ToldPatch, Pass};
use earthshine_shaders::kernel::{LIST_POINTS, SCAN_GROUPS, SUM_POINTS};
use earthshine_shaders::limits::LANES;
use earthshine_world::{Asked, Rgb};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use wgpu::{Buffer, BufferUsages, SubmissionIndex};

/// As which bytes and waits are counted.
const WHAT: &str = "direct light";

/// Points that are copied with their count at least.
const COPIED_MIN: u32 = 64;

/// How many points the next answer will tell of: as large a share as the last one's that has come.
#[derive(Debug, Clone)]
pub(crate) struct Guess(Arc<AtomicU32>);

impl Default for Guess {
    /// All.
    fn default() -> Self {
        Self(Arc::new(AtomicU32::new(1.0f32.to_bits())))
    }
}

impl Guess {
    /// Of `points` points, with some room.
    fn of(&self, points: u32) -> u32 {
        let share = f32::from_bits(self.0.load(Ordering::Relaxed));
        (1.25 * share * points as f32) as u32 + COPIED_MIN
    }

    fn learn(&self, told: usize, points: u32) {
        self.0.store((told as f32 / points.max(1) as f32).to_bits(), Ordering::Relaxed);
    }
}

/// Light of the patches of one submission.
#[derive(Debug)]
pub(crate) struct Coming {
    flight: Flight<[f32; 3]>,
    point_count: u32,
    is_here: bool,
}

impl Coming {
    /// Records what sums `on_points` over the patches of `spans`, so many of both, and its way to the host; points too where there
    /// is a `guess` of how many.
    pub(crate) fn record(
        device: &GpuDevice,
        recorder: &mut Recorder<'_>,
        [spans, on_points]: [&Buffer; 2],
        [patch_count, point_count]: [u32; 2],
        guess: Option<&Guess>,
    ) -> Result<Self, BackendError> {
        let words_bytes = size_of::<ToldPatch>() as u64 * u64::from(patch_count);
        let listed = if guess.is_some() { point_count } else { 0 };
        let mut flight = Flight::new(device, WHAT, listed, words_bytes)?;
        let groups = patch_count.div_ceil(LANES);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let lit = device.buffer("lit", words_bytes, usage)?;
        let counts = device.buffer("counts of points", 4 * u64::from(groups), BufferUsages::STORAGE)?;
        let pass = Pass { rows: point_count, entry_count: patch_count, ..Pass::default() };
        recorder.dispatch(&SUM_POINTS, &[spans, on_points, &lit, &counts], pass, folded(groups));
        if guess.is_some() {
            let scanned = Pass { entry_count: groups, ..pass };
            recorder.dispatch(&SCAN_GROUPS, &[&counts], scanned, [1, 1, 1]);
            let bound = [spans, on_points, &lit, &counts, flight.list()];
            recorder.dispatch(&LIST_POINTS, &bound, pass, folded(groups));
        }
        let copied = guess.map_or(0, |guess| guess.of(point_count));
        flight.record(recorder.encoder(), copied, Some(&lit));
        Ok(Self { flight, point_count, is_here: false })
    }

    fn arrive(&mut self, device: &GpuDevice, guess: Option<&Guess>) -> Result<bool, BackendError> {
        if !self.is_here {
            self.is_here = self.flight.arrive(device)?;
            if let Some(guess) = guess.filter(|_| self.is_here) {
                guess.learn(self.flight.entries().len(), self.point_count);
            }
        }
        Ok(self.is_here)
    }

    /// Appends the light of its patches.
    fn read(&self, wants_points: bool, lit: &mut Vec<LitPatch>) {
        let mut points = self.flight.entries().iter().map(|&light| Rgb::from_array(light));
        for patch in bytemuck::cast_slice::<u32, ToldPatch>(self.flight.words()) {
            let told_points = if wants_points { patch.told_points as usize } else { 0 };
            lit.push((Rgb::from_array(patch.mean), points.by_ref().take(told_points).collect()));
        }
    }
}

/// Light on its way from a device to the host.
#[derive(Debug)]
pub struct GpuLight {
    device: GpuDevice,
    /// Where light on single points is wanted.
    guess: Option<Guess>,
    /// One a dispatch.
    coming: Vec<Coming>,
    /// Patches without a light, before all others.
    dark: usize,
    is_given: bool,
}

impl GpuLight {
    pub(crate) fn new(device: &GpuDevice, guess: Option<Guess>) -> Self {
        Self { device: device.clone(), guess, coming: Vec::new(), dark: 0, is_given: false }
    }

    pub(crate) fn guess(&self) -> Option<&Guess> {
        self.guess.as_ref()
    }

    /// So many patches have no light.
    pub(crate) fn push_dark(&mut self, patches: usize) {
        self.dark += patches;
    }

    /// What was recorded is on its way.
    pub(crate) fn push(&mut self, mut coming: Coming, submission: SubmissionIndex) {
        coming.flight.depart(&self.device, submission);
        self.coming.push(coming);
    }

    /// Waits for it.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], also if it was given before.
    pub fn wait(mut self) -> Result<Vec<LitPatch>, BackendError> {
        loop {
            match self.look() {
                Asked::Done(lit) => return Ok(lit),
                Asked::Lost => return Err(self.device.lose("light could not be read")),
                Asked::UnderWay => {}
            }
            let late = self.coming.iter().find(|coming| !coming.is_here);
            if let Some(submission) = late.and_then(|coming| coming.flight.submission()) {
                self.device.wait(WHAT, submission)?;
            }
        }
    }

    /// Takes in what has come; returns whether that is all.
    fn arrive(&mut self) -> Result<bool, BackendError> {
        self.device.poll()?;
        let mut is_here = true;
        for coming in &mut self.coming {
            is_here &= coming.arrive(&self.device, self.guess.as_ref())?;
        }
        Ok(is_here)
    }
}

impl LightUnderWay for GpuLight {
    fn look(&mut self) -> Asked<Vec<LitPatch>> {
        if self.is_given {
            return Asked::Lost;
        }
        match self.arrive() {
            Ok(false) => return Asked::UnderWay,
            Ok(true) => self.is_given = true,
            Err(_) => return Asked::Lost,
        }
        let mut lit = vec![LitPatch::default(); self.dark];
        for coming in &self.coming {
            coming.read(self.guess.is_some(), &mut lit);
        }
        Asked::Done(lit)
    }
}
