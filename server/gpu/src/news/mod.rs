//! What of a step's light the host does not know yet, and its way there: `News`.
//!
//! After a step the light of every slot is turned into the code that will be published, and compared with the code that
//! was told last: with what was *told*, not with the step before, so that small changes add up until they count. Slots that
//! differ are listed by their number and copied to the host while later steps run; nobody waits for them, unless
//! [`FLIGHTS_MAX`] steps are on their way.
//!
//! ```text
//! light of all slots ▶ count_news ▶ scan_groups ▶ list_news ──count, entries──▶ staging ┄┄▶ host, some steps later
//!                         codes told ◀─────────────┘
//! ```
//!
//! How much is copied is guessed from the step that arrived last: as many entries as it had, up to a power of two, and
//! [`COPIED_MIN`] at least. If there are more, the rest is fetched once the count is known, out of the step's own list; a step is told whole.
//! Who keeps the light does not matter here: a matrix ([`crate::GpuBackend`]) or rows ([`crate::GpuRowLight`]).

#[cfg(test)]
pub(crate) mod tests;

use crate::device::{GpuDevice, buffer_bytes};
use crate::flight::Flight;
use crate::recorder::{Recorder, folded};
use earthshine_radiosity::{BackendError, Slot};
use earthshine_shaders::host::{NewsEntry, NewsMarks, Pass};
use earthshine_shaders::kernel::{COUNT_NEWS, LIST_NEWS, SCAN_GROUPS};
use earthshine_shaders::limits::LANES;
use earthshine_world::Rgb;
use std::collections::VecDeque;
use wgpu::{Buffer, BufferUsages, SubmissionIndex};

/// Steps whose news may be on its way; for one more the oldest is waited for. So many steps light may be late.
pub const FLIGHTS_MAX: usize = 3;
/// Entries that are copied with a step's count at least.
pub const COPIED_MIN: u32 = 64;

/// Bytes on the device of the list of one step, for `slots` slots.
fn list_bytes(slots: u32) -> u64 {
    Flight::<NewsEntry>::list_bytes(slots)
}

/// Bytes of the marks, of the codes told and of the counts of workgroups, for `slots` slots.
fn table_bytes(slots: usize) -> [u64; 3] {
    let marks = size_of::<NewsMarks>() * slots.div_ceil(32);
    [marks, 4 * slots, 4 * slots.div_ceil(LANES as usize)].map(|bytes| bytes as u64)
}

/// Bytes of each buffer on the device, for `slots` slots.
pub(crate) fn sizes(slots: u32) -> impl Iterator<Item = u64> {
    table_bytes(slots as usize).into_iter().chain([list_bytes(slots); FLIGHTS_MAX]).map(buffer_bytes)
}

/// News of all backends of a device so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NewsTotals {
    /// Steps whose news has arrived.
    pub frames: u64,
    /// Slots that they told of.
    pub entries: u64,
    /// Bytes that were copied to the host for it.
    pub bytes: u64,
    /// How often, in all, news was asked for before it was there.
    pub late_frames: u64,
    /// Steps that waited because too many were on their way.
    pub waits: u64,
}

/// News of one backend's slots.
#[derive(Debug)]
pub(crate) struct News {
    marks: Vec<NewsMarks>,
    /// The first step whose light is that of the patch in each slot.
    since: Vec<u64>,
    /// The newest step.
    step: u64,
    /// How often news was asked for.
    asked: u64,
    /// Entries that the next copy takes along.
    copied: u32,
    marks_there: Buffer,
    told: Buffer,
    group_counts: Buffer,
    /// On their way, the oldest first; and those that may be used again.
    flights: VecDeque<OfStep>,
    idle: Vec<Flight<NewsEntry>>,
    waiting: Waiting,
    /// Of the newest step that arrived: its number, and the words that came with it.
    words: Option<(u64, Vec<u32>)>,
}

/// News of a step on its way.
#[derive(Debug)]
struct OfStep {
    flight: Flight<NewsEntry>,
    step: u64,
    /// How often news had been asked for when it departed.
    asked: u64,
}

/// What has arrived and was not taken yet, by slot.
#[derive(Debug)]
struct Waiting {
    light: Vec<Option<Rgb>>,
    is_listed: Vec<bool>,
    list: Vec<u32>,
}

impl Waiting {
    fn put(&mut self, slot: usize, light: Rgb) {
        self.light[slot] = Some(light);
        if !std::mem::replace(&mut self.is_listed[slot], true) {
            self.list.push(slot as u32);
        }
    }

    fn take(&mut self, news: &mut Vec<(Slot, Rgb)>) {
        for slot in self.list.drain(..) {
            self.is_listed[slot as usize] = false;
            news.extend(self.light[slot as usize].take().map(|light| (Slot(slot), light)));
        }
    }
}

impl News {
    /// Of `slots` slots, nobody in them; `words_bytes` bytes of another buffer come with each step.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn new(device: &GpuDevice, slots: usize, words_bytes: u64) -> Result<Self, BackendError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let [marks_bytes, told_bytes, counts_bytes] = table_bytes(slots);
        let words = slots.div_ceil(32);
        let idle = (0..FLIGHTS_MAX).map(|_| Flight::new(device, "news", slots as u32, words_bytes));
        Ok(Self {
            marks: vec![NewsMarks { known: 0, fresh: u32::MAX }; words],
            since: vec![0; slots],
            step: 0,
            asked: 0,
            copied: COPIED_MIN,
            marks_there: device.buffer("marks of news", marks_bytes, usage)?,
            told: device.buffer("codes told", told_bytes, usage)?,
            group_counts: device.buffer("counts of news", counts_bytes, usage)?,
            flights: VecDeque::with_capacity(FLIGHTS_MAX),
            idle: idle.collect::<Result<_, _>>()?,
            waiting: Waiting {
                light: vec![None; slots],
                is_listed: vec![false; slots],
                list: Vec::with_capacity(slots),
            },
            words: None,
        })
    }

    fn mark(&mut self, slot: usize) -> (&mut NewsMarks, u32) {
        (&mut self.marks[slot / 32], 1 << (slot % 32))
    }

    /// From the next step on, the light of `slot` is that of the patch in it.
    pub(crate) fn know(&mut self, slot: usize) {
        let (marks, bit) = self.mark(slot);
        marks.known |= bit;
    }

    /// Whether a step has evaluated the patch in `slot`, or is about to.
    pub(crate) fn is_known(&self, slot: usize) -> bool {
        self.marks[slot / 32].known >> (slot % 32) & 1 == 1
    }

    /// The patch in `slot` leaves: nothing of it is told any more, what is on its way included.
    pub(crate) fn forget(&mut self, slot: usize) {
        let (marks, bit) = self.mark(slot);
        marks.known &= !bit;
        marks.fresh |= bit;
        self.since[slot] = self.step + 1;
        self.waiting.light[slot] = None;
    }

    /// Everybody is told of by the next step, whatever was told before; nothing of what is on its way is.
    pub(crate) fn tell_afresh(&mut self) {
        self.marks.iter_mut().for_each(|marks| marks.fresh = u32::MAX);
        self.since.fill(self.step + 1);
        self.waiting.light.fill(None);
    }

    /// Whether light of step `step`, and words that came with it, are of the patch in `slot`.
    pub(crate) fn is_of_patch_at(&self, slot: usize, step: u64) -> bool {
        self.since[slot] <= step
    }

    /// Whether the newest step came after the patch in `slot`, or the last one that left it.
    pub(crate) fn is_of_patch(&self, slot: usize) -> bool {
        self.is_of_patch_at(slot, self.step)
    }

    /// The newest step.
    pub(crate) fn step(&self) -> u64 {
        self.step
    }

    /// The words that came with the newest step that arrived, and its number.
    pub(crate) fn words(&self) -> Option<(u64, &[u32])> {
        self.words.as_ref().map(|(step, words)| (*step, &words[..]))
    }

    /// Whether news of a step is on its way.
    pub(crate) fn is_coming(&self) -> bool {
        !self.flights.is_empty()
    }

    /// Whether all that there was to be told has arrived and was taken.
    pub(crate) fn is_told(&self) -> bool {
        !self.is_coming() && self.waiting.list.is_empty()
    }

    /// Whether room for the news of another step has to be waited for, as far as was looked.
    pub(crate) fn is_full(&self) -> bool {
        self.idle.is_empty()
    }

    /// Makes room for the news of another step; waits only if too many are on their way.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::NotANumber`].
    pub(crate) fn make_room(&mut self, device: &GpuDevice) -> Result<(), BackendError> {
        self.collect(device)?;
        if self.idle.is_empty() {
            device.note_news(NewsTotals { waits: 1, ..NewsTotals::default() });
        }
        while self.idle.is_empty() {
            self.wait_for_oldest(device)?;
        }
        Ok(())
    }

    /// Records what lists the news of `light`, channels `channel_stride` numbers apart, and its way to the host with `words`;
    /// [`Self::make_room`] comes before, [`Self::submitted`] has to follow.
    pub(crate) fn record(
        &mut self,
        recorder: &mut Recorder<'_>,
        light: &Buffer,
        channel_stride: u32,
        words: Option<&Buffer>,
    ) {
        let slots = self.since.len() as u32;
        let groups = slots.div_ceil(LANES);
        let flight = self.idle.last_mut().expect("room was made");
        recorder.write(&self.marks_there, &self.marks);
        let pass = Pass { entry_count: slots, channel_stride, ..Pass::default() };
        let counted = [light, &self.marks_there, &self.told, &self.group_counts];
        recorder.dispatch(&COUNT_NEWS, &counted, pass, folded(groups));
        let scanned = Pass { entry_count: groups, ..pass };
        recorder.dispatch(&SCAN_GROUPS, &[&self.group_counts], scanned, [1, 1, 1]);
        let listed = [light, &self.marks_there, &self.told, &self.group_counts, flight.list()];
        recorder.dispatch(&LIST_NEWS, &listed, pass, folded(groups));
        flight.record(recorder.encoder(), self.copied.min(slots), words);
        for marks in &mut self.marks {
            marks.fresh &= !marks.known;
        }
    }

    /// What was recorded is on its way.
    pub(crate) fn submitted(&mut self, device: &GpuDevice, submission: SubmissionIndex) {
        self.step += 1;
        let mut flight = self.idle.pop().expect("room was made");
        flight.depart(device, submission);
        self.flights.push_back(OfStep { flight, step: self.step, asked: self.asked });
    }

    /// Appends to `news` what has arrived. Does not wait.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::NotANumber`]: `news` is as it was.
    pub(crate) fn take(
        &mut self,
        device: &GpuDevice,
        news: &mut Vec<(Slot, Rgb)>,
    ) -> Result<(), BackendError> {
        self.collect(device)?;
        self.take_arrived(news);
        Ok(())
    }

    /// As [`Self::take`], of what [`Self::collect`] has taken in.
    pub(crate) fn take_arrived(&mut self, news: &mut Vec<(Slot, Rgb)>) {
        self.asked += 1;
        self.waiting.take(news);
    }

    /// Waits until everything that is on its way has arrived.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::NotANumber`].
    pub(crate) fn wait(&mut self, device: &GpuDevice) -> Result<(), BackendError> {
        while self.is_coming() {
            self.wait_for_oldest(device)?;
        }
        Ok(())
    }

    fn wait_for_oldest(&mut self, device: &GpuDevice) -> Result<(), BackendError> {
        if let Some(submission) = self.flights.front().and_then(|of| of.flight.submission()) {
            device.wait("news", submission)?;
        }
        self.collect(device)
    }

    /// Takes in what has arrived, oldest first. Does not wait.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::NotANumber`].
    pub(crate) fn collect(&mut self, device: &GpuDevice) -> Result<(), BackendError> {
        device.poll()?;
        while let Some(of) = self.flights.front_mut()
            && of.flight.arrive(device)?
        {
            let OfStep { flight, step, asked } = self.flights.pop_front().expect("the one in front");
            device.note_news(NewsTotals {
                frames: 1,
                entries: flight.entries().len() as u64,
                bytes: flight.bytes(),
                late_frames: self.asked - asked,
                waits: 0,
            });
            let landed = self.land(&flight, step);
            self.idle.push(flight);
            landed?;
        }
        Ok(())
    }

    /// Takes in the news of a step, all of which is here.
    fn land(&mut self, flight: &Flight<NewsEntry>, step: u64) -> Result<(), BackendError> {
        self.copied = (flight.entries().len() as u32).next_power_of_two().max(COPIED_MIN);
        self.words = Some((step, flight.words().to_vec()));
        for &NewsEntry { slot, red, green, blue } in flight.entries() {
            let (slot, light) = (slot as usize, Rgb::new(red, green, blue));
            // Of a patch that has left since.
            if step < self.since[slot] {
                continue;
            }
            if !light.is_finite() {
                return Err(BackendError::NotANumber(Slot(slot as u32)));
            }
            self.waiting.put(slot, light);
        }
        Ok(())
    }
}
