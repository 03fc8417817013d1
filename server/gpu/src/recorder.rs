//! Runs kernels one after the other: what a dispatch is told goes into one uniform buffer, a piece each.

use crate::device::GpuDevice;
use crate::timing::Timing;
use crate::work::work;
use earthshine_radiosity::BackendError;
use earthshine_shaders::host::Pass;
use earthshine_shaders::kernel::Kernel;
use earthshine_shaders::limits::GRID_WIDTH;
use wgpu::{
    BindGroupDescriptor, BindGroupEntry, BindingResource, Buffer, BufferBinding, BufferSize, BufferUsages,
    CommandEncoder, ComputePassDescriptor, SubmissionIndex,
};

/// Bytes from one piece of the uniform buffer to the next: the most that any device asks for.
const PIECE_BYTES: u64 = 256;
/// Most dispatches of a submission.
const DISPATCHES_MAX: u64 = 256;

/// Bytes of the uniforms of a submission.
pub(crate) const UNIFORM_BYTES: u64 = PIECE_BYTES * DISPATCHES_MAX;
/// What their buffer is for.
pub(crate) const UNIFORM: BufferUsages = BufferUsages::UNIFORM.union(BufferUsages::COPY_DST);

/// Room for the uniforms of a submission.
pub(crate) fn uniform_buffer(device: &GpuDevice) -> Result<Buffer, BackendError> {
    device.buffer("passes", UNIFORM_BYTES, UNIFORM)
}

/// Commands on their way to one submission.
pub(crate) struct Recorder<'a> {
    device: &'a GpuDevice,
    uniforms: &'a Buffer,
    timing: Option<&'a mut Timing>,
    pieces: Vec<u8>,
    encoder: CommandEncoder,
    /// What the entries of the next passes have together, for [`work`].
    items: u64,
}

/// A grid of `count` workgroups in a row, folded where one dimension has no room.
pub(crate) fn folded(count: u32) -> [u32; 3] {
    [count.clamp(1, GRID_WIDTH), count.div_ceil(GRID_WIDTH).max(1), 1]
}

impl<'a> Recorder<'a> {
    pub(crate) fn new(device: &'a GpuDevice, uniforms: &'a Buffer, timing: Option<&'a mut Timing>) -> Self {
        let encoder = device.wgpu().create_command_encoder(&Default::default());
        Self { device, uniforms, timing, pieces: Vec::new(), encoder, items: 0 }
    }

    /// Says how many items the entries of the next passes have together, as [`work`] counts them.
    pub(crate) fn over(&mut self, items: u64) -> &mut Self {
        self.items = items;
        self
    }

    /// One dispatch of `kernel`: `buffers` in the order of its bindings, the uniform aside.
    ///
    /// # Panics
    /// If there are more dispatches than a submission has room for, or buffers than bindings.
    pub(crate) fn dispatch(&mut self, kernel: &Kernel, buffers: &[&Buffer], pass: Pass, grid: [u32; 3]) {
        assert_eq!(buffers.len() + 1, kernel.bindings.len(), "{}", kernel.name);
        let offset = self.pieces.len() as u64;
        assert!(offset < PIECE_BYTES * DISPATCHES_MAX, "{DISPATCHES_MAX} dispatches in a submission");
        self.pieces.extend_from_slice(bytemuck::bytes_of(&pass));
        self.pieces.resize(self.pieces.len().next_multiple_of(PIECE_BYTES as usize), 0);
        let uniform = BindingResource::Buffer(BufferBinding {
            buffer: self.uniforms,
            offset: 0,
            size: BufferSize::new(size_of::<Pass>() as u64),
        });
        let resources =
            std::iter::once(uniform).chain(buffers.iter().map(|buffer| buffer.as_entire_binding()));
        let entries: Vec<BindGroupEntry<'_>> =
            (0..).zip(resources).map(|(binding, resource)| BindGroupEntry { binding, resource }).collect();
        let pipeline = self.device.pipeline(kernel.name);
        let label = Some(kernel.name);
        let descriptor = BindGroupDescriptor { label, layout: &pipeline.layout, entries: &entries };
        let group = self.device.wgpu().create_bind_group(&descriptor);
        let timestamp_writes =
            self.timing.as_mut().and_then(|timing| timing.next(kernel.name, work(kernel, &pass, self.items)));
        let mut commands =
            self.encoder.begin_compute_pass(&ComputePassDescriptor { label, timestamp_writes });
        commands.set_pipeline(&pipeline.compute);
        commands.set_bind_group(0, &group, &[offset as u32]);
        commands.dispatch_workgroups(grid[0], grid[1], grid[2]);
    }

    /// Writes to the beginning of a buffer before the submission runs.
    pub(crate) fn write<T: bytemuck::NoUninit>(&self, buffer: &Buffer, values: &[T]) {
        self.device.queue().write_buffer(buffer, 0, bytemuck::cast_slice(values));
    }

    /// Zeroes a buffer.
    pub(crate) fn clear(&mut self, buffer: &Buffer) {
        self.encoder.clear_buffer(buffer, 0, None);
    }

    /// Copies `bytes` bytes.
    pub(crate) fn copy(&mut self, from: &Buffer, from_at: u64, to: &Buffer, to_at: u64, bytes: u64) {
        self.encoder.copy_buffer_to_buffer(from, from_at, to, to_at, bytes);
    }

    pub(crate) fn encoder(&mut self) -> &mut CommandEncoder {
        &mut self.encoder
    }

    /// Hands everything to the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub(crate) fn submit(self) -> Result<SubmissionIndex, BackendError> {
        self.device.check()?;
        if !self.pieces.is_empty() {
            self.device.queue().write_buffer(self.uniforms, 0, &self.pieces);
        }
        Ok(self.device.queue().submit([self.encoder.finish()]))
    }
}
