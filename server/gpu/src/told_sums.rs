//! What was told of the sums of rows, on the device and on the host, and how what is news gets from there to here.
//!
//! After a gather each part of a row's sums (light of slots, of coarse parents, of the sky) is compared, bit by bit, with
//! what was told of that row last; what differs is listed in the order asked and copied to the host, 20 bytes a part. Both
//! sides keep what was told by the row's number among all rows on the device, so it follows the row whatever else is asked
//! for; a row that comes has zero on both sides.
//!
//! ```text
//! gathered ▶ count_sums ▶ scan_groups ▶ list_sums ──count, entries──▶ staging ┄┄▶ what was told, here
//!              told, there ◀────────────────┘
//! ```
//!
//! By bits, not by the published code: far light is a source of the next solve, whose errors would add up, and light that is
//! settled has the same bits in every gather. How much is copied is guessed from the last gather; nothing, if that had no
//! news.

use crate::device::GpuDevice;
use crate::flight::Flight;
use crate::rays::STORAGE;
use crate::recorder::{Recorder, folded};
use earthshine_radiosity::BackendError;
use earthshine_radiosity::receivers::{ReceiverSums, RowsOf};
use earthshine_shaders::host::{Pass, ReceiverLight as GatheredLight, SumsEntry};
use earthshine_shaders::kernel::{COUNT_SUMS, LIST_SUMS, SCAN_GROUPS};
use earthshine_shaders::limits::{LANES, SUM_PARTS};
use earthshine_world::Rgb;
use wgpu::{Buffer, BufferUsages, SubmissionIndex};

/// Bytes of a row's sums.
pub(crate) const SUMS_BYTES: usize = size_of::<GatheredLight>();
const _: () = assert!(SUMS_BYTES == 16 * SUM_PARTS as usize);

/// Entries that are copied with a count, once there were any, at least.
const COPIED_MIN: u32 = 64;

/// Sums of rows on a device, and what is known of them here.
#[derive(Debug)]
pub(crate) struct ToldSums {
    /// By row and part, as is [`Self::here`] for the rows so far.
    there: Buffer,
    here: Vec<[f32; 4]>,
    /// Rows whose sums are gathered at once, one after the other.
    room: Room,
    /// Entries that the next copy takes along.
    copied: u32,
    is_under_way: bool,
    /// Whether all that was told there was meant to come here.
    is_in_step: bool,
}

/// Of the rows of one gather.
#[derive(Debug)]
struct Room {
    rows: u32,
    rows_of: RowsOf,
    gathered: Buffer,
    group_counts: Buffer,
    flight: Flight<SumsEntry>,
}

impl ToldSums {
    /// Nothing told, for as many as `rows` rows on the device.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn new(device: &GpuDevice, rows: u64) -> Result<Self, BackendError> {
        Ok(Self {
            there: device.buffer("sums told", SUMS_BYTES as u64 * rows, STORAGE)?,
            here: Vec::new(),
            room: Room::new(device, 0, RowsOf::Receivers)?,
            copied: u32::MAX,
            is_under_way: false,
            is_in_step: true,
        })
    }

    /// Where the sums of `rows` rows are to be gathered. What is under way is forgotten: it was told there, and is not known
    /// here, so all is told afresh.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn gathered(
        &mut self,
        device: &GpuDevice,
        rows: u32,
        rows_of: RowsOf,
    ) -> Result<&Buffer, BackendError> {
        if std::mem::take(&mut self.is_under_way) {
            self.room.flight.forget();
            self.is_in_step = false;
        }
        if rows > self.room.rows || rows_of != self.room.rows_of {
            self.room = Room::new(device, rows.next_power_of_two(), rows_of)?;
        }
        Ok(&self.room.gathered)
    }

    /// Records what lists the news of `rows` gathered rows, `asked` for by their numbers, which are below `end`, and its way to
    /// the host; [`Self::submitted`] has to follow.
    pub(crate) fn record(&mut self, recorder: &mut Recorder<'_>, asked: &Buffer, rows: u32, end: u32) {
        self.here.resize(self.here.len().max((end * SUM_PARTS) as usize), [0.0; 4]);
        if !std::mem::replace(&mut self.is_in_step, true) {
            recorder.clear(&self.there);
            self.here.fill([0.0; 4]);
        }
        let Room { rows_of, gathered, group_counts, flight, .. } = &mut self.room;
        let parts = parts_of(*rows_of);
        let entries = rows * parts.len() as u32;
        let groups = entries.div_ceil(LANES);
        let (part, part_count) = (parts.start, parts.len() as u32);
        let pass = Pass { entry_count: entries, part, part_count, ..Pass::default() };
        let [gathered, group_counts, there] = [&*gathered, &*group_counts, &self.there];
        recorder.dispatch(&COUNT_SUMS, &[asked, gathered, there, group_counts], pass, folded(groups));
        let scanned = Pass { entry_count: groups, ..pass };
        recorder.dispatch(&SCAN_GROUPS, &[group_counts], scanned, [1, 1, 1]);
        let listed = [asked, gathered, there, group_counts, flight.list()];
        recorder.dispatch(&LIST_SUMS, &listed, pass, folded(groups));
        flight.record(recorder.encoder(), self.copied.min(entries), None);
    }

    /// What was recorded is on its way.
    pub(crate) fn submitted(&mut self, device: &GpuDevice, submission: SubmissionIndex) {
        self.room.flight.depart(device, submission);
        self.is_under_way = true;
    }

    /// Takes in what has come; returns whether that is all. Does not wait.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn arrive(&mut self, device: &GpuDevice) -> Result<bool, BackendError> {
        device.poll()?;
        if !self.room.flight.arrive(device)? {
            return Ok(false);
        }
        self.is_under_way = false;
        let entries = self.room.flight.entries();
        let count = entries.len() as u32;
        self.copied = if count == 0 { 0 } else { count.next_power_of_two().max(COPIED_MIN) };
        for &SumsEntry { at, red, green, blue, share } in entries {
            self.here[at as usize] = [red, green, blue, share];
        }
        Ok(true)
    }

    /// As [`Self::arrive`], and waits for all of it.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn wait(&mut self, device: &GpuDevice) -> Result<(), BackendError> {
        while !self.arrive(device)? {
            if let Some(submission) = self.room.flight.submission() {
                device.wait(what(self.room.rows_of), submission)?;
            }
        }
        Ok(())
    }

    /// What was told of the row of that number.
    pub(crate) fn of(&self, row: u32) -> ReceiverSums {
        let first = (row * SUM_PARTS) as usize;
        let part = |at: usize| {
            let [red, green, blue, share] = self.here[first + at];
            (Rgb::new(red, green, blue), share)
        };
        let [(irradiance, resident_share), (far_irradiance, fed_share), (sky_irradiance, far_share)] =
            [part(0), part(1), part(2)];
        ReceiverSums { irradiance, resident_share, far_irradiance, far_share, sky_irradiance, fed_share }
    }
}

impl Room {
    fn new(device: &GpuDevice, rows: u32, rows_of: RowsOf) -> Result<Self, BackendError> {
        let entries = rows * parts_of(rows_of).len() as u32;
        let groups = u64::from(entries.div_ceil(LANES));
        Ok(Self {
            rows,
            rows_of,
            gathered: device.buffer("gathered", SUMS_BYTES as u64 * u64::from(rows), STORAGE)?,
            group_counts: device.buffer("counts of sums", 4 * groups, BufferUsages::STORAGE)?,
            flight: Flight::new(device, what(rows_of), entries, 0)?,
        })
    }
}

/// Parts of a row's sums that anybody reads: of patches far light alone.
fn parts_of(rows_of: RowsOf) -> std::ops::Range<u32> {
    match rows_of {
        RowsOf::Receivers => 0..SUM_PARTS,
        RowsOf::Patches => 1..2,
    }
}

/// As which bytes and waits are counted.
fn what(rows_of: RowsOf) -> &'static str {
    match rows_of {
        RowsOf::Receivers => "receivers",
        RowsOf::Patches => "far light",
    }
}
