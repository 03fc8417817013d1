//! A device and what it runs: queue, compiled kernels, and whether it is still there.

use crate::adapter::{AdapterChoice, GpuError, choose, instance, required_limits};
use crate::news::NewsTotals;
use crate::pipeline::{Pipeline, compile, compile_all};
use crate::pipeline_cache::{Cache, CachedPipelines};
use crate::subgroups;
use crate::timing::{PassTime, PassTotal};
use earthshine_radiosity::BackendError;
use earthshine_shaders::subgroups::NUMBER_LANES;
use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, Device, DeviceDescriptor, DeviceType, ErrorFilter,
    ExperimentalFeatures, Features, MemoryHints, PollError, PollStatus, PollType, Queue, SubmissionIndex,
    Trace,
};

/// What the driver said when the device was lost; shared with its callbacks.
#[derive(Debug, Default)]
struct Loss(Mutex<Option<String>>);

impl Loss {
    fn note(&self, cause: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(cause);
    }

    /// Notes what `poll` says if it fails. wgpu has no word for a driver that is lost while it is waited for: it panics.
    fn note_of(&self, poll: impl FnOnce() -> Result<PollStatus, PollError>) {
        let said = match catch_unwind(AssertUnwindSafe(poll)) {
            Ok(Ok(_)) => return,
            Ok(Err(error)) => error.to_string(),
            // A panic carries a `String`, or a `str` where there was nothing to format.
            Err(panic) => match panic.downcast::<String>() {
                Ok(said) => *said,
                Err(other) => other.downcast_ref().copied().unwrap_or("wgpu panicked").to_owned(),
            },
        };
        self.note(said);
    }

    fn cause(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// An open device. Cheap to clone; backends share one.
#[derive(Debug, Clone)]
pub struct GpuDevice {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    name: String,
    is_software: bool,
    device: Device,
    queue: Queue,
    pipelines: BTreeMap<&'static str, Pipeline>,
    loss: Arc<Loss>,
    bounds: Bounds,
    has_timestamps: bool,
    subgroup_lanes: Option<u32>,
    pass_totals: Mutex<BTreeMap<&'static str, PassTotal>>,
    news_totals: Mutex<NewsTotals>,
    /// How often the host waited, by what for.
    waits: Mutex<BTreeMap<&'static str, u64>>,
    /// Bytes that were copied to the host, by what they are of.
    read_back: Mutex<BTreeMap<&'static str, u64>>,
    /// Bytes that the columns of rows take, of all who gather.
    row_bytes: Mutex<u64>,
    /// Work that was said to be left to the CPU.
    said: Mutex<BTreeSet<&'static str>>,
    /// Sizes of all buffers so far, and what they are for.
    #[cfg(test)]
    made: Mutex<Vec<(u64, BufferUsages)>>,
}

/// Of every buffer: no struct of the shaders is larger.
const BUFFER_BYTES_MIN: u64 = 64;

/// Bytes that a buffer takes which is to hold `bytes`.
pub(crate) fn buffer_bytes(bytes: u64) -> u64 {
    bytes.max(BUFFER_BYTES_MIN).next_multiple_of(16)
}

/// How large buffers may be.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    /// Of what a kernel is given.
    binding_bytes_max: u64,
    /// Of a part of a plane, no more than that.
    part_bytes_max: u64,
}

impl GpuDevice {
    /// Opens the adapter that `choice` means and compiles all kernels for it: some 10 to 1,000 ms, once.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn open(choice: &AdapterChoice) -> Result<Self, GpuError> {
        Self::open_within(choice, u64::MAX)
    }

    /// As [`Self::open`], and never binds more than `binding_bytes_max` bytes at once: planes are split above it, and what
    /// cannot be split is refused.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn open_within(choice: &AdapterChoice, binding_bytes_max: u64) -> Result<Self, GpuError> {
        let bounds = Bounds { binding_bytes_max, part_bytes_max: binding_bytes_max };
        Ok(Self::open_storing(choice, bounds, None)?.0)
    }

    /// As [`Self::open`], and splits planes above `part_bytes_max` bytes, where a whole binding would do: for tests of split
    /// planes at sizes that a test can afford.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn open_splitting(choice: &AdapterChoice, part_bytes_max: u64) -> Result<Self, GpuError> {
        let bounds = Bounds { binding_bytes_max: u64::MAX, part_bytes_max };
        Ok(Self::open_storing(choice, bounds, None)?.0)
    }

    /// As [`Self::open`], given the kernels that an earlier open compiled, whole as it gave them, or no bytes. Those of
    /// another adapter or driver are refused, and all kernels compiled.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn open_cached(choice: &AdapterChoice, stored: &[u8]) -> Result<(Self, CachedPipelines), GpuError> {
        let bounds = Bounds { binding_bytes_max: u64::MAX, part_bytes_max: u64::MAX };
        Self::open_storing(choice, bounds, Some(stored))
    }

    fn open_storing(
        choice: &AdapterChoice,
        bounds: Bounds,
        stored: Option<&[u8]>,
    ) -> Result<(Self, CachedPipelines), GpuError> {
        let adapter = choose(&instance(), choice)?;
        let info = adapter.get_info();
        let lanes = subgroups::lanes_of(&info, adapter.features()).filter(|_| !choice.without_subgroups);
        let (name, is_software) = (info.name, info.device_type == DeviceType::Cpu);
        let has_timestamps = adapter.features().contains(Features::TIMESTAMP_QUERY);
        let caching = if stored.is_some() { Features::PIPELINE_CACHE } else { Features::empty() };
        let with_lanes = if lanes.is_some() { Features::SUBGROUP } else { Features::empty() };
        let wanted = Features::TIMESTAMP_QUERY | caching | with_lanes;
        let required_limits = required_limits(&adapter.limits());
        let limit = required_limits.max_storage_buffer_binding_size.min(required_limits.max_buffer_size);
        let binding_bytes_max = bounds.binding_bytes_max.min(limit);
        let bounds =
            Bounds { binding_bytes_max, part_bytes_max: bounds.part_bytes_max.min(binding_bytes_max) };
        let descriptor = DeviceDescriptor {
            label: Some("earthshine"),
            required_features: wanted & adapter.features(),
            required_limits,
            experimental_features: ExperimentalFeatures::disabled(),
            memory_hints: MemoryHints::Performance,
            trace: Trace::Off,
        };
        let refused = |cause: String| GpuError::Refused { name: name.clone(), cause };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| refused(error.to_string()))?;
        let loss = Arc::new(Loss::default());
        let (on_loss, on_error) = (Arc::clone(&loss), Arc::clone(&loss));
        device.set_device_lost_callback(move |reason, said| on_loss.note(format!("{reason:?}: {said}")));
        // Every call is valid by construction, so what goes wrong is the device: it is of no more use.
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| on_error.note(error.to_string())));
        let cache = stored.map_or_else(Cache::none, |stored| Cache::new(&device, stored));
        let with = |pipelines, subgroup_lanes| {
            let inner = Inner {
                name: name.clone(),
                is_software,
                device: device.clone(),
                queue: queue.clone(),
                pipelines,
                loss: Arc::clone(&loss),
                bounds,
                has_timestamps,
                subgroup_lanes,
                pass_totals: Mutex::default(),
                news_totals: Mutex::default(),
                waits: Mutex::default(),
                read_back: Mutex::default(),
                row_bytes: Mutex::default(),
                said: Mutex::default(),
                #[cfg(test)]
                made: Mutex::default(),
            };
            Self { inner: Arc::new(inner) }
        };
        let lanes = lanes.filter(|&lanes| {
            let source = NUMBER_LANES.source.into();
            let probe = compile(&device, &NUMBER_LANES, source, cache.wgpu.as_ref());
            let probe = with(BTreeMap::from([(NUMBER_LANES.name, probe)]), None);
            let in_order = subgroups::are_in_order(&probe, lanes);
            if in_order != Ok(true) {
                tracing::info!(adapter = %name, lanes, "subgroups are not in order: kernels do without them");
            }
            in_order == Ok(true)
        });
        let opened = with(compile_all(&device, lanes, cache.wgpu.as_ref()), lanes);
        let cached = cache.finish(stored.unwrap_or_default());
        match loss.cause() {
            Some(cause) => Err(refused(cause)),
            None => Ok((opened, cached)),
        }
    }

    /// Lanes of a subgroup, where kernels use them.
    #[must_use]
    pub fn subgroup_lanes(&self) -> Option<u32> {
        self.inner.subgroup_lanes
    }

    /// The adapter's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Whether it computes on the CPU: of use for tests of kernels, not for figures of speed.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.inner.is_software
    }

    /// Largest buffer that a kernel is given, bytes.
    #[must_use]
    pub fn binding_bytes_max(&self) -> u64 {
        self.inner.bounds.binding_bytes_max
    }

    /// Largest part of a plane, bytes: larger planes are split.
    pub(crate) fn part_bytes_max(&self) -> u64 {
        self.inner.bounds.part_bytes_max
    }

    /// Sizes of the buffers that were made since the last call, and what they are for.
    #[cfg(test)]
    pub(crate) fn take_made(&self) -> Vec<(u64, BufferUsages)> {
        std::mem::take(&mut self.inner.made.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Whether the device is gone: whatever is on it is lost, and a new one has to be opened.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        self.inner.loss.cause().is_some()
    }

    /// Gives the device up, as a driver may at any time: for tests of what follows.
    pub fn destroy(&self) {
        self.inner.device.destroy();
        self.inner.loss.note("it was destroyed".to_owned());
    }

    /// What kernels have taken in the frames that were timed, one in 64 of each backend; empty where the device has no
    /// timestamps.
    #[must_use]
    pub fn pass_totals(&self) -> BTreeMap<&'static str, PassTotal> {
        self.inner.pass_totals.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(crate) fn note_passes(&self, passes: &[PassTime]) {
        let mut totals = self.inner.pass_totals.lock().unwrap_or_else(PoisonError::into_inner);
        for pass in passes {
            let total = totals.entry(pass.name).or_default();
            total.count += 1;
            total.seconds += pass.ms / 1e3;
            total.bytes += pass.work.map_or(0.0, |work| work.bytes);
            total.flops += pass.work.map_or(0.0, |work| work.flops);
        }
    }

    /// What has come to the host of the light that changed, of all backends on this device.
    #[must_use]
    pub fn news_totals(&self) -> NewsTotals {
        *self.inner.news_totals.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn note_news(&self, more: NewsTotals) {
        let mut totals = self.inner.news_totals.lock().unwrap_or_else(PoisonError::into_inner);
        totals.frames += more.frames;
        totals.entries += more.entries;
        totals.bytes += more.bytes;
        totals.late_frames += more.late_frames;
        totals.waits += more.waits;
    }

    /// How often somebody has waited for the device, by what for. Opening it, reading light or drift at once and
    /// measurements wait; a tick does not.
    #[must_use]
    pub fn waits(&self) -> BTreeMap<&'static str, u64> {
        self.inner.waits.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Bytes that were copied to the host so far, by what they are of: all that ever crosses that way.
    #[must_use]
    pub fn read_back_bytes(&self) -> BTreeMap<&'static str, u64> {
        self.inner.read_back.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(crate) fn note_read_back(&self, what: &'static str, bytes: u64) {
        let mut read_back = self.inner.read_back.lock().unwrap_or_else(PoisonError::into_inner);
        *read_back.entry(what).or_default() += bytes;
    }

    /// Says in the log that `work` is left to the CPU, once however many on this device leave it.
    pub fn warn_once(&self, work: &'static str, error: &dyn std::fmt::Display) {
        if self.inner.said.lock().unwrap_or_else(PoisonError::into_inner).insert(work) {
            tracing::warn!(adapter = self.name(), %error, "{work} is left to the CPU");
        }
    }

    pub(crate) fn row_bytes(&self) -> MutexGuard<'_, u64> {
        self.inner.row_bytes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn wgpu(&self) -> &Device {
        &self.inner.device
    }

    pub(crate) fn queue(&self) -> &Queue {
        &self.inner.queue
    }

    pub(crate) fn has_timestamps(&self) -> bool {
        self.inner.has_timestamps
    }

    pub(crate) fn pipeline(&self, name: &str) -> &Pipeline {
        &self.inner.pipelines[name]
    }

    /// # Errors
    /// [`BackendError::DeviceLost`] if it is.
    pub(crate) fn check(&self) -> Result<(), BackendError> {
        match self.inner.loss.cause() {
            Some(cause) => Err(BackendError::DeviceLost { cause }),
            None => Ok(()),
        }
    }

    /// A zeroed buffer of `bytes` bytes, at least as many as the largest struct in a list takes: an empty list is bound too.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], also for one that kernels are to be given and that is above
    /// [`Self::binding_bytes_max`]; [`BackendError::DeviceLost`].
    pub(crate) fn buffer(
        &self,
        label: &str,
        bytes: u64,
        usage: BufferUsages,
    ) -> Result<Buffer, BackendError> {
        self.check()?;
        let size = buffer_bytes(bytes);
        // A binding above the device's largest would be found when a kernel is given it, and be taken for a lost device.
        if usage.contains(BufferUsages::STORAGE) && size > self.binding_bytes_max() {
            return Err(BackendError::OutOfMemory { slots: 0, bytes: size });
        }
        let device = &self.inner.device;
        let memory = device.push_error_scope(ErrorFilter::OutOfMemory);
        let validity = device.push_error_scope(ErrorFilter::Validation);
        #[cfg(test)]
        self.inner.made.lock().unwrap_or_else(PoisonError::into_inner).push((size, usage));
        let buffer = device.create_buffer(&BufferDescriptor {
            label: Some(label),
            size,
            usage,
            mapped_at_creation: false,
        });
        // Both guards are popped, the inner first.
        let (invalid, full) = (pollster::block_on(validity.pop()), pollster::block_on(memory.pop()));
        match (invalid, full) {
            (None, None) => Ok(buffer),
            // A buffer above the device's largest is as much too large as one above its memory.
            (Some(_), _) | (_, Some(_)) => {
                self.check()?;
                Err(BackendError::OutOfMemory { slots: 0, bytes: size })
            }
        }
    }

    /// Waits until `submission` is done, and for the callbacks of maps that it leads to. The only place that waits for a
    /// device; `what` for is counted.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn wait(&self, what: &'static str, submission: SubmissionIndex) -> Result<(), BackendError> {
        *self.inner.waits.lock().unwrap_or_else(PoisonError::into_inner).entry(what).or_default() += 1;
        self.poll_as(PollType::Wait { submission_index: Some(submission), timeout: None })
    }

    /// Runs the callbacks of maps that are there; waits for none.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn poll(&self) -> Result<(), BackendError> {
        self.poll_as(PollType::Poll)
    }

    fn poll_as(&self, poll: PollType) -> Result<(), BackendError> {
        self.inner.loss.note_of(|| self.inner.device.poll(poll));
        self.check()
    }

    /// Notes that the device failed.
    pub(crate) fn lose(&self, cause: &str) -> BackendError {
        self.inner.loss.note(cause.to_owned());
        BackendError::DeviceLost { cause: self.inner.loss.cause().unwrap_or_default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_driver_that_is_lost_while_it_is_waited_for_is_a_loss() {
        let loss = Loss::default();
        loss.note_of(|| Ok(PollStatus::QueueEmpty));
        assert_eq!(loss.cause(), None);
        loss.note_of(|| panic!("Error in {}: the device is lost", "Device::poll"));
        loss.note_of(|| Err(PollError::Timeout));
        assert_eq!(loss.cause().as_deref(), Some("Error in Device::poll: the device is lost"));
    }
}
