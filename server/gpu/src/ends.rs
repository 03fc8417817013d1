//! Where rays end, counted on a device: the closest triangle along each of many rays, then runs of them added up by patch.
//!
//! What a run adds up stays in its workgroup until it is a short list, and only lists come back. Whose a crossing is,
//! follows from the side that is hit and from a table of voxels, both as the host made them: no rule of a bake is here.

use crate::device::GpuDevice;
use crate::rays::{GpuRays, STORAGE, TreesError, uploaded};
use crate::readback::read_now;
use crate::recorder::{Recorder, folded, uniform_buffer};
use bytemuck::Zeroable as _;
use earthshine_light::TreeLayout;
use earthshine_radiosity::BackendError;
use earthshine_radiosity::tables::draw::mix;
use earthshine_shaders::host::{EndSpan, EndVoxel, Pass, RayQuery};
use earthshine_shaders::kernel::COUNT_ENDS;
use wgpu::Buffer;

pub use earthshine_shaders::host::{EndPart, EndRun, EndSide};
pub use earthshine_shaders::limits::{
    KEY_ABSORBED, KEY_SKY, KEY_UNKNOWN, NO_KEY, RAY_PARTS, RUN_RAYS, SUM_ABSORBED, SUM_WHOLE,
};

/// Parts that one dispatch has room for: 32 MiB.
const PARTS_MAX: usize = 1 << 22;
/// Runs of one dispatch.
const RUNS_MAX: usize = 1 << 16;
/// Keys of a ray at most: three patches, or three lobes of the sky.
const KEYS_PER_RAY: usize = 3;

/// Where rays can end.
#[derive(Debug, Clone, Copy)]
pub struct EndMap<'a> {
    /// By the number that triangles of the trees have.
    pub sides: &'a [EndSide],
    /// Voxels with their patches by direction, below [`KEY_UNKNOWN`] or [`NO_KEY`]; each voxel once.
    pub voxels: &'a [([i32; 3], [u32; 6])],
    /// m.
    pub voxel_edge_m: f32,
    /// How far before a side its voxel is looked up, m.
    pub off_surface_m: f32,
}

/// The parts of some runs, and what it took to learn them.
#[derive(Debug, Clone, Default)]
pub struct RunParts {
    /// By run, in no order.
    pub runs: Vec<Vec<EndPart>>,
    /// From the device, bytes.
    pub read_bytes: u64,
}

/// A scene's trees on a device, and where rays through them end.
#[derive(Debug)]
pub struct GpuEnds {
    rays: GpuRays,
    device: GpuDevice,
    sides: Buffer,
    voxels: Buffer,
    runs: Buffer,
    parts: Buffer,
    part_spans: Buffer,
    parts_taken: Buffer,
    uniforms: Buffer,
    pass: Pass,
    rays_max: usize,
    parts_max: usize,
}

impl GpuEnds {
    /// Uploads `layout` and `map`; `rays_max` rays can be asked about at once.
    ///
    /// # Errors
    /// [`TreesError`].
    pub fn new(
        device: &GpuDevice,
        layout: &TreeLayout,
        map: &EndMap<'_>,
        rays_max: usize,
    ) -> Result<Self, TreesError> {
        let table = voxel_table(map.voxels);
        let most = device.binding_bytes_max();
        let parts_max = PARTS_MAX.min(most as usize / size_of::<EndPart>());
        let of_run = KEYS_PER_RAY * RUN_RAYS as usize;
        if parts_max < of_run {
            return Err(TreesError::TooLarge { bytes: (of_run * size_of::<EndPart>()) as u64, most });
        }
        let room = |label, count: usize, bytes: usize| device.buffer(label, (count * bytes) as u64, STORAGE);
        Ok(Self {
            rays: GpuRays::new(device, layout, rays_max)?,
            sides: uploaded(device, "sides", map.sides)?,
            voxels: uploaded(device, "voxels", &table)?,
            runs: room("runs", RUNS_MAX, size_of::<EndRun>())?,
            parts: room("parts", parts_max, size_of::<EndPart>())?,
            part_spans: room("part spans", RUNS_MAX, size_of::<EndSpan>())?,
            parts_taken: room("parts taken", 1, size_of::<u32>())?,
            uniforms: uniform_buffer(device)?,
            pass: Pass {
                voxel_edge_m: map.voxel_edge_m,
                off_surface_m: map.off_surface_m,
                voxel_slots: table.len() as u32,
                ..Pass::zeroed()
            },
            device: device.clone(),
            rays_max,
            parts_max,
        })
    }

    /// What each of `runs` over `queries` adds up; waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
    ///
    /// # Panics
    /// If there are more rays than there is room for, or in a run, or a run has rays that are not there.
    pub fn count(&mut self, queries: &[RayQuery], runs: &[EndRun]) -> Result<RunParts, BackendError> {
        assert!(queries.len() <= self.rays_max, "{} rays at once", queries.len());
        let is_sound = |run: &EndRun| {
            run.ray_count <= RUN_RAYS && (run.first_ray + run.ray_count) as usize <= queries.len()
        };
        assert!(runs.iter().all(is_sound), "runs of other rays");
        let mut counted = RunParts::default();
        if runs.is_empty() {
            return Ok(counted);
        }
        self.rays.trace(queries)?;
        let mut first = 0;
        while first < runs.len() {
            let mut parts = 0;
            let fits = |run: &&EndRun| {
                parts += KEYS_PER_RAY * run.ray_count as usize;
                parts <= self.parts_max
            };
            let count = runs[first..].iter().take(RUNS_MAX).take_while(fits).count();
            self.dispatch(&runs[first..first + count], &mut counted)?;
            first += count;
        }
        Ok(counted)
    }

    fn dispatch(&mut self, runs: &[EndRun], counted: &mut RunParts) -> Result<(), BackendError> {
        let pass = Pass { entry_count: runs.len() as u32, ..self.pass };
        self.device.queue().write_buffer(&self.runs, 0, bytemuck::cast_slice(runs));
        let mut recorder = Recorder::new(&self.device, &self.uniforms, None);
        recorder.clear(&self.parts_taken);
        let (rays, sums) = (&self.rays, [&self.parts, &self.part_spans, &self.parts_taken]);
        let bound =
            [&rays.queries, &rays.hits, &self.sides, &self.voxels, &self.runs, sums[0], sums[1], sums[2]];
        recorder.dispatch(&COUNT_ENDS, &bound, pass, folded(runs.len() as u32));
        recorder.submit()?;
        let bytes = size_of_val(runs) / size_of::<EndRun>() * size_of::<EndSpan>();
        let spans: Vec<EndSpan> = bytemuck::pod_collect_to_vec(&read_now(
            &self.device,
            "ends",
            &self.part_spans,
            bytes as u64,
            |_| {},
        )?);
        let total: usize = spans.iter().map(|span| span.part_count as usize).sum();
        let part_bytes = total * size_of::<EndPart>();
        counted.read_bytes += (bytes + part_bytes) as u64;
        let parts: Vec<EndPart> = match part_bytes {
            0 => Vec::new(),
            _ => bytemuck::pod_collect_to_vec(&read_now(
                &self.device,
                "ends",
                &self.parts,
                part_bytes as u64,
                |_| {},
            )?),
        };
        let of = |span: &EndSpan| {
            parts[span.first_part as usize..(span.first_part + span.part_count) as usize].to_vec()
        };
        counted.runs.extend(spans.iter().map(of));
        Ok(())
    }
}

/// `voxels` in a table that a kernel searches from the hash of a voxel on, at most half full.
fn voxel_table(voxels: &[([i32; 3], [u32; 6])]) -> Vec<EndVoxel> {
    let mut table = vec![EndVoxel::zeroed(); (2 * voxels.len()).next_power_of_two().max(2)];
    let last = table.len() - 1;
    for &(voxel, patches) in voxels {
        let [x, y, z] = voxel.map(i32::cast_unsigned);
        let mut slot = mix(x.wrapping_add(mix(y.wrapping_add(mix(z))))) as usize & last;
        while table[slot].is_taken != 0 {
            slot = (slot + 1) & last;
        }
        let [along, against] = [0, 1].map(|side| [0, 2, 4].map(|axis| patches[axis + side]));
        table[slot] = EndVoxel { voxel, is_taken: 1, along, against, ..EndVoxel::zeroed() };
    }
    table
}
