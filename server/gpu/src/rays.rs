//! Rays against trees on a device: the closest triangle along each, many in one dispatch.
//!
//! Trees are uploaded as the CPU built them ([`TreeLayout`]); no tree is built here, and holes of alpha masks are the
//! caller's business.

use crate::device::GpuDevice;
use crate::readback::read_now;
use crate::recorder::{Recorder, folded, uniform_buffer};
use crate::timing::{PassTime, Timing};
use bytemuck::Zeroable as _;
use earthshine_light::TreeLayout;
use earthshine_light::tree_layout::{PlacedTriangle, Placement};
use earthshine_radiosity::BackendError;
use earthshine_shaders::host::{Pass, TreePlacement, TreeTriangle};
use earthshine_shaders::kernel::{MAKE_RAYS, TRACE_CLOSEST};
use earthshine_shaders::limits::{LANES, RAY_LANES, TREE_STACK};

pub use earthshine_shaders::host::{RayHit, RayQuery};
pub use earthshine_shaders::limits::NO_TRIANGLE;

use wgpu::{Buffer, BufferUsages};

/// Most rays of one dispatch: 32 MiB of them.
pub const DISPATCH_RAYS_MAX: usize = 1 << 20;

/// Entries of the stack that the way from one level of trees into the other takes.
const STACK_BETWEEN: u32 = 3;

/// Why trees cannot be on a device.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TreesError {
    /// More than one binding holds.
    #[error("the scene's trees need a binding of {bytes} bytes, the device has {most}; trace on the CPU")]
    TooLarge {
        /// Of the largest list.
        bytes: u64,
        /// Of the device.
        most: u64,
    },
    /// Deeper than the kernels' stack.
    #[error("the scene's trees are {depth} levels deep, kernels follow {most}; trace on the CPU")]
    TooDeep {
        /// Of both levels of trees together.
        depth: u32,
        /// As deep as they may be.
        most: u32,
    },
    /// The device is gone or full.
    #[error(transparent)]
    Device(#[from] BackendError),
}

/// A scene's trees on a device, and room for rays.
#[derive(Debug)]
pub struct GpuRays {
    device: GpuDevice,
    nodes: Buffer,
    placements: Buffer,
    triangles: Buffer,
    pub(crate) queries: Buffer,
    pub(crate) hits: Buffer,
    uniforms: Buffer,
    timing: Option<Timing>,
    rays_max: usize,
}

impl GpuRays {
    /// Uploads `layout`; `rays_max` rays go in one dispatch, at most [`DISPATCH_RAYS_MAX`].
    ///
    /// # Errors
    /// [`TreesError`].
    pub fn new(device: &GpuDevice, layout: &TreeLayout, rays_max: usize) -> Result<Self, TreesError> {
        check_depth(layout.depth)?;
        let nothing = [[0u32; 20]];
        let nodes = if layout.nodes.is_empty() { &nothing[..] } else { &layout.nodes };
        let placements: Vec<TreePlacement> = layout.placements.iter().map(placement_words).collect();
        let triangles: Vec<TreeTriangle> = layout.triangles.iter().map(triangle_words).collect();
        let rays_max = rays_max.clamp(1, DISPATCH_RAYS_MAX);
        let ray = |bytes: usize| device.buffer("rays", (bytes * rays_max) as u64, STORAGE);
        Ok(Self {
            nodes: uploaded(device, "nodes", nodes)?,
            placements: uploaded(device, "placements", &placements)?,
            triangles: uploaded(device, "triangles", &triangles)?,
            queries: ray(size_of::<RayQuery>())?,
            hits: ray(size_of::<RayHit>())?,
            uniforms: uniform_buffer(device)?,
            timing: None,
            device: device.clone(),
            rays_max,
        })
    }

    /// Room for as many rays beside these, against the same trees.
    pub(crate) fn beside(&self) -> Result<Self, BackendError> {
        let ray = |bytes: usize| self.device.buffer("rays", (bytes * self.rays_max) as u64, STORAGE);
        Ok(Self {
            device: self.device.clone(),
            nodes: self.nodes.clone(),
            placements: self.placements.clone(),
            triangles: self.triangles.clone(),
            queries: ray(size_of::<RayQuery>())?,
            hits: ray(size_of::<RayHit>())?,
            uniforms: uniform_buffer(&self.device)?,
            timing: None,
            rays_max: self.rays_max,
        })
    }

    /// Times every pass from now on; false where the device cannot.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub fn time_passes(&mut self) -> Result<bool, BackendError> {
        self.timing = Timing::new(&self.device)?;
        Ok(self.timing.is_some())
    }

    /// The passes since the last call. Waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn take_times(&mut self) -> Result<Vec<PassTime>, BackendError> {
        self.timing.as_mut().map_or(Ok(Vec::new()), |timing| timing.take(&self.device))
    }

    /// What each of `queries` meets first, in as many dispatches as it takes; waits for each.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
    pub fn closest(&mut self, queries: &[RayQuery]) -> Result<Vec<RayHit>, BackendError> {
        let mut hits = Vec::with_capacity(queries.len());
        for queries in queries.chunks(self.rays_max) {
            self.trace(queries)?;
            let bytes = size_of_val(queries) / size_of::<RayQuery>() * size_of::<RayHit>();
            let read = read_now(&self.device, "rays", &self.hits, bytes as u64, |_| {})?;
            hits.extend(bytemuck::pod_collect_to_vec::<u8, RayHit>(&read));
        }
        Ok(hits)
    }

    /// Traces the first `count` of the rays that were uploaded last once more, and waits: what `bench gpu` times.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn again(&mut self, count: usize) -> Result<(), BackendError> {
        self.dispatch(count.min(self.rays_max))?;
        self.device.wait("finish", self.device.queue().submit([]))
    }

    /// Traces at most as many rays as one dispatch takes; what they hit stays on the device.
    pub(crate) fn trace(&mut self, queries: &[RayQuery]) -> Result<(), BackendError> {
        self.device.queue().write_buffer(&self.queries, 0, bytemuck::cast_slice(queries));
        self.dispatch(queries.len())
    }

    /// As [`Self::trace`], with the rays of the first `fan_count` of `fans`, which follow one another from ray 0 on.
    pub(crate) fn trace_fans(
        &mut self,
        fans: &Buffer,
        fan_count: usize,
        count: usize,
    ) -> Result<(), BackendError> {
        let mut recorder = Recorder::new(&self.device, &self.uniforms, self.timing.as_mut());
        let pass = Pass { entry_count: count as u32, fan_count: fan_count as u32, ..Pass::zeroed() };
        recorder.dispatch(&MAKE_RAYS, &[fans, &self.queries], pass, folded((count as u32).div_ceil(LANES)));
        recorder.submit()?;
        self.dispatch(count)
    }

    fn dispatch(&mut self, count: usize) -> Result<(), BackendError> {
        let mut recorder = Recorder::new(&self.device, &self.uniforms, self.timing.as_mut());
        let bound = [&self.nodes, &self.placements, &self.triangles, &self.queries, &self.hits];
        let pass = Pass { entry_count: count as u32, ..Pass::zeroed() };
        recorder.dispatch(&TRACE_CLOSEST, &bound, pass, folded((count as u32).div_ceil(RAY_LANES)));
        recorder.submit().map(|_| ())
    }
}

pub(crate) const STORAGE: BufferUsages =
    BufferUsages::STORAGE.union(BufferUsages::COPY_DST).union(BufferUsages::COPY_SRC);

/// Refuses trees that the kernels' stack does not hold.
pub(crate) fn check_depth(depth: u32) -> Result<(), TreesError> {
    let most = TREE_STACK - STACK_BETWEEN;
    if depth > most { Err(TreesError::TooDeep { depth, most }) } else { Ok(()) }
}

/// A buffer with `values` in it.
pub(crate) fn uploaded<T: bytemuck::NoUninit>(
    device: &GpuDevice,
    label: &str,
    values: &[T],
) -> Result<Buffer, TreesError> {
    let bytes: &[u8] = bytemuck::cast_slice(values);
    let most = device.binding_bytes_max();
    if bytes.len() as u64 > most {
        return Err(TreesError::TooLarge { bytes: bytes.len() as u64, most });
    }
    let buffer = device.buffer(label, bytes.len() as u64, STORAGE)?;
    device.queue().write_buffer(&buffer, 0, bytes);
    Ok(buffer)
}

pub(crate) fn placement_words(placement: &Placement) -> TreePlacement {
    let rows = placement.to_tree.matrix3.transpose();
    let offset = placement.to_tree.translation;
    let row = |row: glam::DVec3, offset: f64| row.extend(offset).as_vec4().to_array();
    TreePlacement {
        to_tree_x: row(rows.x_axis, offset.x),
        to_tree_y: row(rows.y_axis, offset.y),
        to_tree_z: row(rows.z_axis, offset.z),
        first_node: placement.first_node,
        first_triangle: placement.first_triangle,
        spare: [0; 2],
    }
}

pub(crate) fn triangle_words(triangle: &PlacedTriangle) -> TreeTriangle {
    TreeTriangle {
        corner: triangle.corner.to_array(),
        index: triangle.index,
        edge_1: triangle.edge_1.to_array(),
        transmittance: triangle.transmittance,
        edge_2: triangle.edge_2.to_array(),
        spare: 0,
    }
}
