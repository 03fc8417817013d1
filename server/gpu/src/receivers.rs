//! Light of receivers, or far light of patches, on a device: rows of chunks stay there, what their columns stand for is
//! kept up to date, and one dispatch gathers all that is asked for. What of its sums is news is fetched when it has come
//! (`told_sums`).
//!
//! Rows go to the device when their chunk is first named and stay as long as it is; room is handed out from the front of two
//! lists, and what still counts is put into new ones when they are full. Of the table of columns only what changed is uploaded. What leaves
//! slots is uploaded with each gather, 16 bytes a slot: it is that of the light the engine publishes, whoever solved it.

use crate::arena::Arena;
use crate::device::GpuDevice;
use crate::mirror::Mirror;
use crate::packed_rows::PackedRows;
use crate::recorder::{Recorder, folded, uniform_buffer};
use crate::row_room::RowRoom;
use crate::timing::{PassTime, Sampling, Timing};
use crate::told_sums::{SUMS_BYTES, ToldSums};
use earthshine_radiosity::BackendError;
use earthshine_radiosity::receivers::{ReceiverGather, ReceiverLight, ReceiverRow, ReceiverSums, RowsOf};
use earthshine_shaders::host::{Pass, ReceiverAsked, ReceiverSpan, SegmentSpan};
use earthshine_shaders::kernel::GATHER_RECEIVERS;
use earthshine_world::{Asked, Chunk, Vec4};
use std::collections::BTreeMap;
use std::sync::Arc;
use wgpu::Buffer;

/// Most receivers of one gather: 3 MiB of sums, and 4 MiB of what of them is news, at most.
pub const ROWS_MAX: usize = 1 << 16;
/// Most memory for the columns of rows, of all who gather on a device together, bytes.
pub const COLUMN_BYTES_MAX: u64 = 256 << 20;
/// Words of columns that there is room for at first.
const WORDS_MIN: u64 = 1 << 16;
/// Bytes of a word.
const WORD: u64 = 4;
/// Rows that there is room for at first.
const ROWS_MIN: u64 = 1 << 10;
/// Rows that a workgroup gathers.
const ROWS_A_GROUP: u32 = 8;

/// Why receivers cannot be gathered on a device.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReceiversError {
    /// More rows than there is to be room for.
    #[error(
        "rows to gather take {bytes} bytes, there is room for {most}; lower `receiver_voxels_max` or `resident_patches_max`"
    )]
    TooLarge {
        /// Of the columns of all chunks named, or of the table of sources.
        bytes: u64,
        /// Of the device, or of this program.
        most: u64,
    },
    /// The device is full.
    #[error(
        "the device has no memory for {bytes} bytes of rows; lower `receiver_voxels_max` or `resident_patches_max`"
    )]
    OutOfMemory {
        /// Asked for.
        bytes: u64,
    },
    /// The device is gone.
    #[error(transparent)]
    Device(BackendError),
}

impl From<BackendError> for ReceiversError {
    fn from(error: BackendError) -> Self {
        match error {
            BackendError::OutOfMemory { bytes, .. } => Self::OutOfMemory { bytes },
            other => Self::Device(other),
        }
    }
}

/// Rows of a chunk on the device; it is held so that its address stays its own.
#[derive(Debug)]
struct Resident {
    _held: Arc<Chunk>,
    first_row: u32,
    first_target: u32,
}

/// Receivers of one session, or patches of one of its levels, on a device.
#[derive(Debug)]
pub struct GpuReceivers {
    device: GpuDevice,
    column_bytes_max: u64,
    /// By address.
    residents: BTreeMap<usize, Resident>,
    rows: Arena,
    columns: Arena,
    column_room: RowRoom,
    asked: Mirror<ReceiverAsked>,
    spans: Mirror<SegmentSpan>,
    source_of: Mirror<u32>,
    sources: Mirror<[f32; 4]>,
    sky: Mirror<[f32; 4]>,
    /// Whose rows are there; none before the first gather.
    rows_of: Option<RowsOf>,
    told: ToldSums,
    uniforms: Buffer,
    /// Rows of the gather that was handed over, by their numbers on the device.
    under_way: Option<Vec<u32>>,
    timing: Option<Timing>,
    sampling: Sampling,
}

impl GpuReceivers {
    /// No rows yet.
    ///
    /// # Errors
    /// [`ReceiversError`].
    pub fn new(device: &GpuDevice) -> Result<Self, ReceiversError> {
        Self::with_room(device, COLUMN_BYTES_MAX)
    }

    /// As [`Self::new`], with no more than `column_bytes_max` bytes for the columns of all rows on the device.
    ///
    /// # Errors
    /// [`ReceiversError`].
    pub fn with_room(device: &GpuDevice, column_bytes_max: u64) -> Result<Self, ReceiversError> {
        let rows_min = ROWS_MIN.min(device.binding_bytes_max() / SUMS_BYTES as u64);
        Ok(Self {
            column_bytes_max,
            residents: BTreeMap::new(),
            rows: Arena::new(device, "receivers", size_of::<ReceiverSpan>(), rows_min)?,
            columns: Arena::new(device, "receiver columns", WORD as usize, 0)?,
            column_room: RowRoom::new(device),
            asked: Mirror::new(device, "asked receivers")?,
            spans: Mirror::new(device, "segments")?,
            source_of: Mirror::new(device, "column sources")?,
            sources: Mirror::new(device, "sources")?,
            sky: Mirror::new(device, "sky")?,
            rows_of: None,
            told: ToldSums::new(device, rows_min)?,
            uniforms: uniform_buffer(device)?,
            under_way: None,
            timing: None,
            sampling: Sampling::default(),
            device: device.clone(),
        })
    }

    /// Hands a gather over; see [`ReceiverLight::begin`].
    ///
    /// # Errors
    /// [`ReceiversError`]; nothing is under way then.
    pub fn gather(&mut self, gather: &ReceiverGather<'_>) -> Result<(), ReceiversError> {
        self.under_way = None;
        self.device.check()?;
        self.sampling.begin(&self.device, &mut self.timing)?;
        self.bring_rows(gather)?;
        let rows = self.bring_lists(gather)?;
        if !rows.is_empty() {
            self.dispatch(gather)?;
        }
        self.under_way = Some(rows);
        Ok(())
    }

    fn dispatch(&mut self, gather: &ReceiverGather<'_>) -> Result<(), ReceiversError> {
        let rows = gather.rows.len() as u32;
        let gathered = self.told.gathered(&self.device, rows, gather.rows_of)?;
        let pass = Pass { entry_count: rows, rows: gather.slot_count, ..Pass::default() };
        let mut recorder = Recorder::new(&self.device, &self.uniforms, self.timing.as_mut());
        let bound = [
            self.asked.buffer(),
            self.rows.buffer(),
            self.columns.buffer(),
            self.spans.buffer(),
            self.source_of.buffer(),
            self.sources.buffer(),
            self.sky.buffer(),
            gathered,
        ];
        let columns = |row: &ReceiverRow| {
            let starts = &gather.rows_of.of(gather.chunks[row.chunk as usize]).row_starts;
            u64::from(starts[row.row as usize + 1] - starts[row.row as usize])
        };
        recorder.over(gather.rows.iter().map(columns).sum());
        recorder.dispatch(&GATHER_RECEIVERS, &bound, pass, folded(rows.div_ceil(ROWS_A_GROUP)));
        self.told.record(&mut recorder, self.asked.buffer(), rows, self.rows.used());
        let submission = recorder.submit()?;
        self.told.submitted(&self.device, submission);
        self.sampling.end(&self.device, &mut self.timing)?;
        Ok(())
    }

    /// Puts rows of the chunks on the device that are not there, and forgets those of others.
    fn bring_rows(&mut self, gather: &ReceiverGather<'_>) -> Result<(), ReceiversError> {
        let named: BTreeMap<usize, &Arc<Chunk>> =
            gather.chunks.iter().map(|&chunk| (address(chunk), chunk)).collect();
        if self.rows_of.replace(gather.rows_of) != Some(gather.rows_of) {
            self.residents.clear();
        }
        self.residents.retain(|at, _| named.contains_key(at));
        if !self.place_new(&named, gather.rows_of) {
            self.place_all(&named, gather.rows_of)?;
        }
        Ok(())
    }

    /// Uploads the chunks of `named` that are not there, as long as there is room. Returns whether there was.
    fn place_new(&mut self, named: &BTreeMap<usize, &Arc<Chunk>>, rows_of: RowsOf) -> bool {
        named.iter().all(|(at, chunk)| {
            self.residents.contains_key(at) || self.place(chunk, rows_of, &PackedRows::new(rows_of.of(chunk)))
        })
    }

    /// Uploads the rows of `chunk` if there is room; returns whether there was.
    fn place(&mut self, chunk: &Arc<Chunk>, rows_of: RowsOf, packed: &PackedRows) -> bool {
        let rows = rows_of.of(chunk);
        if !self.rows.has_room(rows.row_count()) || !self.columns.has_room(packed.words.len()) {
            return false;
        }
        let first = self.columns.push(&self.device, &packed.words);
        let first_row = self.rows.push(&self.device, &packed.spans(rows, first));
        let first_target = packed.first_target(first);
        let resident = Resident { _held: Arc::clone(chunk), first_row, first_target };
        self.residents.insert(address(chunk), resident);
        true
    }

    /// Forgets all rows, makes room for twice what `named` have, or for just that where there is to be no more, and uploads them.
    fn place_all(
        &mut self,
        named: &BTreeMap<usize, &Arc<Chunk>>,
        rows_of: RowsOf,
    ) -> Result<(), ReceiversError> {
        self.residents.clear();
        // A column takes a word at least: what cannot fit is not packed in vain.
        let columns: usize = named.values().map(|chunk| rows_of.of(chunk).columns.len()).sum();
        let (bytes, most) =
            (WORD * columns as u64, self.device.binding_bytes_max().min(self.column_bytes_max));
        if bytes > most {
            return Err(ReceiversError::TooLarge { bytes, most });
        }
        let packed: Vec<(&Arc<Chunk>, PackedRows)> =
            named.values().map(|&chunk| (chunk, PackedRows::new(rows_of.of(chunk)))).collect();
        let rows = packed.iter().map(|(chunk, _)| rows_of.of(chunk).row_count() as u64).sum();
        self.make_room(rows, WORD * packed.iter().map(|(_, packed)| packed.words.len() as u64).sum::<u64>())?;
        for (chunk, packed) in &packed {
            assert!(self.place(chunk, rows_of, packed), "room was made for all");
        }
        Ok(())
    }

    /// Makes room for twice as many `rows` and bytes of columns, or for just that where there is to be no more.
    fn make_room(&mut self, rows: u64, column_bytes: u64) -> Result<(), ReceiversError> {
        let binding = self.device.binding_bytes_max();
        let too_large = |bytes: u64| move |most: u64| ReceiversError::TooLarge { bytes, most };
        // What was told of a row takes more than the row.
        let row_bytes = rows * SUMS_BYTES as u64;
        if row_bytes.max(column_bytes) > binding {
            return Err(too_large(row_bytes.max(column_bytes))(binding));
        }
        let wanted = (2 * column_bytes).max(WORDS_MIN * WORD).min(binding);
        // The old ones are given up before the new ones are taken.
        self.columns = Arena::new(&self.device, "receiver columns", WORD as usize, 0)?;
        let given = self.column_room.take(wanted, column_bytes, self.column_bytes_max);
        let words = given.map_err(too_large(column_bytes))? / WORD;
        let rows = (2 * rows).max(ROWS_MIN).min(binding / SUMS_BYTES as u64);
        let made = ToldSums::new(&self.device, rows).and_then(|told| {
            let rows = Arena::new(&self.device, "receivers", size_of::<ReceiverSpan>(), rows)?;
            Ok((told, rows, Arena::new(&self.device, "receiver columns", WORD as usize, words)?))
        });
        // Room for what could not be had is left to others.
        (self.told, self.rows, self.columns) =
            made.inspect_err(|_| self.column_room = RowRoom::new(&self.device))?;
        Ok(())
    }

    /// Tells the device what is asked for, and what columns stand for now. Returns the numbers of the rows there.
    fn bring_lists(&mut self, gather: &ReceiverGather<'_>) -> Result<Vec<u32>, ReceiversError> {
        let ask = |row: &ReceiverRow| {
            let chunk = row.chunk as usize;
            let &Resident { first_row, first_target, .. } = &self.residents[&address(gather.chunks[chunk])];
            ReceiverAsked { row: first_row + row.row, first_span: gather.first_spans[chunk], first_target }
        };
        let asked: Vec<ReceiverAsked> = gather.rows.iter().map(ask).collect();
        let spans: Vec<SegmentSpan> =
            gather.spans.iter().map(|span| SegmentSpan { first: span.first, count: span.count }).collect();
        let sources: Vec<[f32; 4]> = gather.sources.iter().map(Vec4::to_array).collect();
        let sky = gather.sky.lobes.map(|lobe| lobe.extend(0.0).to_array());
        let device = &self.device;
        self.asked.bring(device, &asked)?;
        self.spans.bring(device, &spans)?;
        self.source_of.bring(device, gather.columns)?;
        self.sources.bring(device, &sources)?;
        self.sky.bring(device, &sky)?;
        Ok(asked.iter().map(|asked| asked.row).collect())
    }

    /// How the last gather stands; see [`ReceiverLight::take`].
    ///
    /// # Errors
    /// [`ReceiversError::Device`]; nothing is under way then.
    pub fn fetch(&mut self) -> Result<Asked<Vec<ReceiverSums>>, ReceiversError> {
        let Some(rows) = self.under_way.take() else { return Ok(Asked::Lost) };
        if !rows.is_empty() && !self.told.arrive(&self.device)? {
            self.under_way = Some(rows);
            return Ok(Asked::UnderWay);
        }
        Ok(Asked::Done(self.sums_of(&rows)))
    }

    /// The sums of the last gather, waited for; none if nothing is under way.
    ///
    /// # Errors
    /// [`ReceiversError::Device`]; nothing is under way then.
    pub fn wait(&mut self) -> Result<Vec<ReceiverSums>, ReceiversError> {
        let rows = self.under_way.take().unwrap_or_default();
        if !rows.is_empty() {
            self.told.wait(&self.device)?;
        }
        Ok(self.sums_of(&rows))
    }

    fn sums_of(&self, rows: &[u32]) -> Vec<ReceiverSums> {
        rows.iter().map(|&row| self.told.of(row)).collect()
    }

    /// Times every pass from now on; false where the device cannot.
    ///
    /// # Errors
    /// [`ReceiversError`].
    pub fn time_passes(&mut self) -> Result<bool, ReceiversError> {
        self.timing = Timing::new(&self.device)?;
        Ok(self.timing.is_some())
    }

    /// The passes since the last call. Waits for the device.
    ///
    /// # Errors
    /// [`ReceiversError::Device`].
    pub fn take_times(&mut self) -> Result<Vec<PassTime>, ReceiversError> {
        Ok(self.timing.as_mut().map_or(Ok(Vec::new()), |timing| timing.take(&self.device))?)
    }

    fn say(&self, error: &ReceiversError) {
        let work = match self.rows_of {
            Some(RowsOf::Patches) => "far light",
            _ => "light of receivers",
        };
        self.device.warn_once(work, error);
    }
}

impl ReceiverLight for GpuReceivers {
    fn rows_max(&self) -> usize {
        if self.device.is_lost() { 0 } else { ROWS_MAX }
    }

    fn begin(&mut self, gather: &ReceiverGather<'_>) -> bool {
        self.gather(gather).inspect_err(|error| self.say(error)).is_ok()
    }

    fn take(&mut self) -> Asked<Vec<ReceiverSums>> {
        self.fetch().unwrap_or_else(|error| {
            self.say(&error);
            Asked::Lost
        })
    }
}

fn address(chunk: &Arc<Chunk>) -> usize {
    Arc::as_ptr(chunk).addr()
}
