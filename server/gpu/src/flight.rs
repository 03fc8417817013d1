//! A list that kernels have filled, on its way to the host: words that go with it, how many entries there are, as many of them
//! as were guessed, and the rest if the guess was too low. Nobody waits for it.
//!
//! The list's first word says how many entries follow, in the place of an entry. Who fills it and what a good guess is,
//! is not known here: [`crate::news`], [`crate::told_sums`], [`crate::direct`].

use crate::device::GpuDevice;
use crate::readback::{Arrival, Staging};
use earthshine_radiosity::BackendError;
use wgpu::{Buffer, BufferUsages, CommandEncoder, SubmissionIndex};

/// A list of `E` on the device, where it is copied to, and what has been read of it.
#[derive(Debug)]
pub(crate) struct Flight<E> {
    /// As bytes that come back are counted.
    what: &'static str,
    list: Buffer,
    staging: Staging,
    capacity: u32,
    /// Words in front of the list.
    words_bytes: u64,
    /// Bytes of the copy that is on its way.
    coming_bytes: u64,
    submission: Option<SubmissionIndex>,
    /// Bytes of all copies.
    bytes: u64,
    /// None before it has arrived.
    count: Option<usize>,
    entries: Vec<E>,
    words: Vec<u32>,
}

impl<E: bytemuck::Pod> Flight<E> {
    const ENTRY_BYTES: u64 = size_of::<E>() as u64;

    /// Bytes on the device of a list of `entries` entries.
    pub(crate) fn list_bytes(entries: u32) -> u64 {
        Self::ENTRY_BYTES * (u64::from(entries) + 1)
    }

    /// Room for `capacity` entries and `words_bytes` bytes of words with them, which are counted as `what` on their way.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub(crate) fn new(
        device: &GpuDevice,
        what: &'static str,
        capacity: u32,
        words_bytes: u64,
    ) -> Result<Self, BackendError> {
        let list_bytes = Self::list_bytes(capacity);
        Ok(Self {
            what,
            list: device.buffer(what, list_bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC)?,
            staging: Staging::new(device, words_bytes + list_bytes)?,
            capacity,
            words_bytes,
            coming_bytes: 0,
            submission: None,
            bytes: 0,
            count: None,
            entries: Vec::new(),
            words: Vec::new(),
        })
    }

    /// Where entries are listed.
    pub(crate) fn list(&self) -> &Buffer {
        &self.list
    }

    /// Bytes that were copied.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// All of them, once they have arrived.
    pub(crate) fn entries(&self) -> &[E] {
        &self.entries
    }

    pub(crate) fn words(&self) -> &[u32] {
        &self.words
    }

    /// What has to be done before more of it arrives.
    pub(crate) fn submission(&self) -> Option<SubmissionIndex> {
        self.submission.clone()
    }

    /// Records the copy of `words`, the count and the first `copied` entries; [`Self::depart`] has to follow.
    pub(crate) fn record(&mut self, encoder: &mut CommandEncoder, copied: u32, words: Option<&Buffer>) {
        if let Some(words) = words {
            encoder.copy_buffer_to_buffer(words, 0, self.staging.buffer(), 0, self.words_bytes);
        }
        let list_bytes = Self::list_bytes(copied.min(self.capacity));
        encoder.copy_buffer_to_buffer(&self.list, 0, self.staging.buffer(), self.words_bytes, list_bytes);
        self.coming_bytes = self.words_bytes + list_bytes;
        (self.count, self.bytes) = (None, 0);
        self.entries.clear();
    }

    /// What was recorded is on its way.
    pub(crate) fn depart(&mut self, device: &GpuDevice, submission: SubmissionIndex) {
        self.submission = Some(submission);
        self.bytes += self.coming_bytes;
        self.staging.map(device, self.what, self.coming_bytes);
    }

    /// Nobody wants what is on its way: another can be recorded.
    pub(crate) fn forget(&mut self) {
        self.staging.forget();
    }

    /// Reads what is here; sends for the rest if there is one. Returns whether all of it is here.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn arrive(&mut self, device: &GpuDevice) -> Result<bool, BackendError> {
        if self.staging.arrival() == Arrival::Coming {
            return Ok(false);
        }
        let Self { staging, words_bytes, coming_bytes, count, entries, words, .. } = self;
        staging.take(device, *coming_bytes, |mut bytes| {
            if count.is_none() {
                let (front, list) = bytes.split_at(*words_bytes as usize);
                let (head, first) = list.split_at(Self::ENTRY_BYTES as usize);
                *words = bytemuck::pod_collect_to_vec(front);
                *count = Some(bytemuck::pod_read_unaligned::<u32>(&head[..4]) as usize);
                bytes = first;
            }
            let missing = count.unwrap_or_default() - entries.len();
            let here = bytes.chunks_exact(Self::ENTRY_BYTES as usize).take(missing);
            entries.extend(here.map(bytemuck::pod_read_unaligned::<E>));
        })?;
        let (here, missing) = (entries.len(), count.unwrap_or_default() - entries.len());
        if missing > 0 {
            let from = Self::list_bytes(here as u32);
            *coming_bytes = Self::ENTRY_BYTES * missing as u64;
            let mut encoder = device.wgpu().create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(&self.list, from, staging.buffer(), 0, *coming_bytes);
            let submission = device.queue().submit([encoder.finish()]);
            self.depart(device, submission);
        }
        Ok(missing == 0)
    }
}
