//! The news of one step on its way to the host: the words that go with it, the count, as many entries as were guessed, and
//! the rest if the guess was too low.

use crate::device::GpuDevice;
use crate::readback::{Arrival, Staging};
use earthshine_radiosity::BackendError;
use earthshine_shaders::host::NewsEntry;
use wgpu::{Buffer, BufferUsages, CommandEncoder, SubmissionIndex};

/// Bytes of an entry, and of the one in front that says how many there are.
pub(super) const ENTRY_BYTES: u64 = size_of::<NewsEntry>() as u64;

/// A list on the device, where it is copied to, and what has been read of it.
#[derive(Debug)]
pub(super) struct Flight {
    list: Buffer,
    staging: Staging,
    /// Words in front of the list.
    words_bytes: u64,
    /// Bytes of the copy that is on its way.
    coming_bytes: u64,
    submission: Option<SubmissionIndex>,
    step: u64,
    asked: u64,
    /// Bytes of all copies.
    bytes: u64,
    /// None before it has arrived.
    count: Option<usize>,
    entries: Vec<NewsEntry>,
    words: Vec<u32>,
}

impl Flight {
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(super) fn new(device: &GpuDevice, slots: usize, words_bytes: u64) -> Result<Self, BackendError> {
        let list_bytes = super::list_bytes(slots as u32);
        Ok(Self {
            list: device.buffer("news", list_bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC)?,
            staging: Staging::new(device, words_bytes + list_bytes)?,
            words_bytes,
            coming_bytes: 0,
            submission: None,
            step: 0,
            asked: 0,
            bytes: 0,
            count: None,
            entries: Vec::with_capacity(slots),
            words: Vec::new(),
        })
    }

    /// Where the news is listed.
    pub(super) fn list(&self) -> &Buffer {
        &self.list
    }

    /// Of which step.
    pub(super) fn step(&self) -> u64 {
        self.step
    }

    /// How often news had been asked for when it departed.
    pub(super) fn asked(&self) -> u64 {
        self.asked
    }

    /// Bytes that were copied.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// All of it, once it has arrived.
    pub(super) fn entries(&self) -> &[NewsEntry] {
        &self.entries
    }

    pub(super) fn words(&self) -> &[u32] {
        &self.words
    }

    /// What has to be done before more of it arrives.
    pub(super) fn submission(&self) -> Option<SubmissionIndex> {
        self.submission.clone()
    }

    /// Records the copy of `words`, the count and the first `copied` entries.
    pub(super) fn record(&mut self, encoder: &mut CommandEncoder, copied: u32, words: Option<&Buffer>) {
        if let Some(words) = words {
            encoder.copy_buffer_to_buffer(words, 0, self.staging.buffer(), 0, self.words_bytes);
        }
        let list_bytes = ENTRY_BYTES * (1 + u64::from(copied));
        encoder.copy_buffer_to_buffer(&self.list, 0, self.staging.buffer(), self.words_bytes, list_bytes);
        self.coming_bytes = self.words_bytes + list_bytes;
        (self.count, self.bytes) = (None, 0);
        self.entries.clear();
    }

    /// What was recorded is on its way.
    pub(super) fn depart(&mut self, submission: SubmissionIndex, step: u64, asked: u64) {
        (self.step, self.asked) = (step, asked);
        self.go(submission);
    }

    fn go(&mut self, submission: SubmissionIndex) {
        self.submission = Some(submission);
        self.bytes += self.coming_bytes;
        self.staging.map(self.coming_bytes);
    }

    /// Reads what is here; sends for the rest if there is one. Returns whether all of it is here.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(super) fn arrive(&mut self, device: &GpuDevice) -> Result<bool, BackendError> {
        if self.staging.arrival() == Arrival::Coming {
            return Ok(false);
        }
        let Self { staging, words_bytes, coming_bytes, count, entries, words, .. } = self;
        staging.take(device, *coming_bytes, |mut bytes| {
            if count.is_none() {
                let (front, list) = bytes.split_at(*words_bytes as usize);
                let (head, first) = list.split_at(ENTRY_BYTES as usize);
                *words = bytemuck::pod_collect_to_vec(front);
                *count = Some(bytemuck::pod_read_unaligned::<NewsEntry>(head).slot as usize);
                bytes = first;
            }
            let missing = count.unwrap_or_default() - entries.len();
            let here = bytes.chunks_exact(ENTRY_BYTES as usize).take(missing);
            entries.extend(here.map(bytemuck::pod_read_unaligned::<NewsEntry>));
        })?;
        let (here, missing) = (entries.len(), count.unwrap_or_default() - entries.len());
        if missing > 0 {
            let from = ENTRY_BYTES * (1 + here as u64);
            *coming_bytes = ENTRY_BYTES * missing as u64;
            let mut encoder = device.wgpu().create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(&self.list, from, staging.buffer(), 0, *coming_bytes);
            let submission = device.queue().submit([encoder.finish()]);
            self.go(submission);
        }
        Ok(missing == 0)
    }
}
