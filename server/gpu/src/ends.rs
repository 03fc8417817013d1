//! Where rays end, counted on a device: the closest triangle along each of many rays, then runs of them added up by patch,
//! or fans of them by what they face.
//!
//! What a run adds up stays in its workgroup until it is a short list, and only lists come back. Whose a crossing is,
//! follows from the side that is hit and from a table of voxels, both as the host made them: no rule of a bake is here.

use crate::device::GpuDevice;
use crate::rays::{GpuRays, STORAGE, TreesError, uploaded};
use crate::readback::{Staging, read_now};
use crate::recorder::{Recorder, folded, uniform_buffer};
use bytemuck::Zeroable as _;
use earthshine_light::TreeLayout;
use earthshine_radiosity::BackendError;
use earthshine_radiosity::tables::draw::mix;
use earthshine_shaders::host::{EndSpan, EndVoxel, Pass, RayHit, RayQuery};
use earthshine_shaders::kernel::{COUNT_ENDS, FACE_FANS};
use earthshine_shaders::limits::LANES;
use wgpu::Buffer;

pub use earthshine_shaders::host::{EndPart, EndRun, EndSide, RayFan};
pub use earthshine_shaders::limits::{
    BURIED_IN_PLACES, BURIED_OPEN, KEY_ABSORBED, KEY_SKY, KEY_UNKNOWN, NO_KEY, RAY_PARTS, RUN_RAYS,
    SIDE_BACK_BURIED, SIDE_FOR_HOST, SIDE_FOR_HOST_IN_PLACES, SIDE_FRONT_BURIED, SIDE_TWO_SIDED,
    SUM_ABSORBED, SUM_WHOLE,
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
    /// Each voxel once.
    pub voxels: &'a [MapVoxel],
    /// m.
    pub voxel_edge_m: f32,
    /// How far before a side its voxel is looked up, m.
    pub off_surface_m: f32,
}

/// A voxel with patches, places left out, or buried sides.
#[derive(Debug, Clone, Copy)]
pub struct MapVoxel {
    /// Which.
    pub voxel: [i32; 3],
    /// By direction, below [`KEY_UNKNOWN`] or [`NO_KEY`].
    pub patches: [u32; 6],
    /// Whether rays that meet sides with [`SIDE_FOR_HOST_IN_PLACES`] there are the host's.
    pub asks_host: bool,
    /// See [`EndVoxel::buried`].
    pub buried: u32,
}

/// The rays of a question.
#[derive(Debug, Clone, Copy)]
pub enum AskedRays<'a> {
    /// As they are.
    Made(&'a [RayQuery]),
    /// To be made on the device; `first_ray` of each is set there.
    Fans(&'a [RayFan]),
}

/// The parts of some runs, and what it took to learn them.
#[derive(Debug, Clone, Default)]
pub struct RunParts {
    /// By run, in no order.
    pub runs: Vec<Vec<EndPart>>,
    /// To the device, bytes.
    pub sent_bytes: u64,
    /// From the device, bytes.
    pub read_bytes: u64,
}

/// How many rays of a fan meet what; those that the host has to judge are not among the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Faced {
    /// Backs of sides that have one.
    pub back: u32,
    /// Anything near.
    pub near: u32,
    /// For the host.
    pub for_host: u32,
    /// How far the farthest of them gets, m; `f32::MAX` or near it where one meets nothing.
    pub reach_m: f32,
}

impl Faced {
    fn of([counts, reach]: [u32; 2]) -> Self {
        let reach_m = f32::from_bits(reach);
        Self { back: counts & 0x3FF, near: counts >> 10 & 0x3FF, for_host: counts >> 20, reach_m }
    }
}

// Ten bits hold what a fan may have.
const _: () = assert!(RUN_RAYS < 1 << 10);

/// A scene's trees on a device, and where rays through them end. 128 bytes of room a ray.
#[derive(Debug)]
pub struct GpuEnds {
    rays: GpuRays,
    device: GpuDevice,
    sides: Buffer,
    /// None before [`Self::settle`].
    voxels: Option<Buffer>,
    fans: Buffer,
    faced: Buffer,
    runs: Buffer,
    parts: Buffer,
    part_spans: Buffer,
    parts_taken: Buffer,
    uniforms: Buffer,
    pass: Pass,
    rays_max: usize,
    parts_max: usize,
    /// Parts that are read with the spans: about as many as the last runs had.
    parts_guess: usize,
}

impl GpuEnds {
    /// Uploads `layout` and `sides`, by the number that triangles of the trees have; `rays_max` rays can be asked about at
    /// once.
    ///
    /// # Errors
    /// [`TreesError`].
    pub fn new(
        device: &GpuDevice,
        layout: &TreeLayout,
        sides: &[EndSide],
        rays_max: usize,
    ) -> Result<Self, TreesError> {
        let most = device.binding_bytes_max();
        let parts_max = PARTS_MAX.min(most as usize / size_of::<EndPart>());
        let of_run = KEYS_PER_RAY * RUN_RAYS as usize;
        if parts_max < of_run {
            return Err(TreesError::TooLarge { bytes: (of_run * size_of::<EndPart>()) as u64, most });
        }
        let (rays, sides) = (GpuRays::new(device, layout, rays_max)?, uploaded(device, "sides", sides)?);
        Ok(Self::with_room(device, rays, sides, (rays_max, parts_max))?)
    }

    fn with_room(
        device: &GpuDevice,
        rays: GpuRays,
        sides: Buffer,
        (rays_max, parts_max): (usize, usize),
    ) -> Result<Self, BackendError> {
        let room = |label, count: usize, bytes: usize| device.buffer(label, (count * bytes) as u64, STORAGE);
        Ok(Self {
            rays,
            sides,
            voxels: None,
            fans: room("fans", rays_max, size_of::<RayFan>())?,
            faced: room("faced", rays_max, size_of::<[u32; 2]>())?,
            runs: room("runs", RUNS_MAX, size_of::<EndRun>())?,
            parts: room("parts", parts_max, size_of::<EndPart>())?,
            part_spans: room("part spans", RUNS_MAX, size_of::<EndSpan>())?,
            parts_taken: room("parts taken", 1, size_of::<u32>())?,
            uniforms: uniform_buffer(device)?,
            pass: Pass::zeroed(),
            device: device.clone(),
            rays_max,
            parts_max,
            parts_guess: 0,
        })
    }

    /// Room of its own for questions beside these, with the same trees and map: two threads can ask at once.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
    pub fn beside(&self) -> Result<Self, BackendError> {
        let room = (self.rays_max, self.parts_max);
        let mut other = Self::with_room(&self.device, self.rays.beside()?, self.sides.clone(), room)?;
        other.settle_as(self);
        Ok(other)
    }

    /// Uploads where rays end.
    ///
    /// # Errors
    /// [`TreesError`].
    pub fn settle(&mut self, map: &EndMap<'_>) -> Result<(), TreesError> {
        let table = voxel_table(map.voxels);
        self.sides = uploaded(&self.device, "sides", map.sides)?;
        self.voxels = Some(uploaded(&self.device, "voxels", &table)?);
        self.pass = Pass {
            voxel_edge_m: map.voxel_edge_m,
            off_surface_m: map.off_surface_m,
            voxel_slots: table.len() as u32,
            ..Pass::zeroed()
        };
        Ok(())
    }

    /// Takes over where rays end from `other`, of the same trees.
    pub fn settle_as(&mut self, other: &Self) {
        (self.sides, self.voxels) = (other.sides.clone(), other.voxels.clone());
        self.pass = other.pass;
    }

    /// What the rays of each of `fans` face, nearer than `near_m` being near; waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
    ///
    /// # Panics
    /// If there is no room for so many rays or fans, or a fan has more than [`RUN_RAYS`].
    pub fn face(&mut self, fans: &[RayFan], near_m: f32) -> Result<Vec<Faced>, BackendError> {
        assert!(fans.iter().all(|fan| fan.ray_count <= RUN_RAYS), "{RUN_RAYS} rays of a fan");
        if fans.is_empty() {
            return Ok(Vec::new());
        }
        self.trace(AskedRays::Fans(fans))?;
        let pass = Pass { entry_count: fans.len() as u32, near_m, ..Pass::zeroed() };
        let mut recorder = Recorder::new(&self.device, &self.uniforms, None);
        let bound = [&self.fans, &self.rays.queries, &self.rays.hits, &self.sides, &self.faced];
        recorder.dispatch(&FACE_FANS, &bound, pass, folded((fans.len() as u32).div_ceil(LANES)));
        recorder.submit()?;
        let bytes = (fans.len() * size_of::<[u32; 2]>()) as u64;
        let words = read_now(&self.device, "ends", &self.faced, bytes, |_| {})?;
        Ok(bytemuck::pod_collect_to_vec::<u8, [u32; 2]>(&words).into_iter().map(Faced::of).collect())
    }

    /// What each of `queries` meets first; waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
    pub fn first(&mut self, queries: &[RayQuery]) -> Result<Vec<RayHit>, BackendError> {
        self.rays.closest(queries)
    }

    /// The rays of `fans` as they are made here, for tests; waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
    ///
    /// # Panics
    /// If there is no room for so many.
    pub fn made(&mut self, fans: &[RayFan]) -> Result<Vec<RayQuery>, BackendError> {
        let count = self.trace(AskedRays::Fans(fans))?;
        if count == 0 {
            return Ok(Vec::new());
        }
        let bytes = (count * size_of::<RayQuery>()) as u64;
        let words = read_now(&self.device, "ends", &self.rays.queries, bytes, |_| {})?;
        Ok(bytemuck::pod_collect_to_vec(&words))
    }

    /// What each of `runs` over `rays` adds up; waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
    ///
    /// # Panics
    /// If there are more rays than there is room for, or in a run, or a run has rays that are not there, or nobody said where
    /// rays end ([`Self::settle`]).
    pub fn count(&mut self, rays: AskedRays<'_>, runs: &[EndRun]) -> Result<RunParts, BackendError> {
        let mut counted = RunParts::default();
        if runs.is_empty() {
            return Ok(counted);
        }
        let ray_count = self.trace(rays)?;
        let is_sound =
            |run: &EndRun| run.ray_count <= RUN_RAYS && (run.first_ray + run.ray_count) as usize <= ray_count;
        assert!(runs.iter().all(is_sound), "runs of other rays");
        counted.sent_bytes = rays.bytes() + size_of_val(runs) as u64;
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

    /// Uploads and traces `rays`; how many they are.
    fn trace(&mut self, rays: AskedRays<'_>) -> Result<usize, BackendError> {
        match rays {
            AskedRays::Made(queries) => {
                assert!(queries.len() <= self.rays_max, "{} rays at once", queries.len());
                self.rays.trace(queries)?;
                Ok(queries.len())
            }
            AskedRays::Fans(fans) => {
                let mut count = 0usize;
                let mut placed = Vec::with_capacity(fans.len());
                for fan in fans {
                    placed.push(RayFan { first_ray: count as u32, ..*fan });
                    count += fan.ray_count as usize;
                }
                assert!(
                    fans.len().max(count) <= self.rays_max,
                    "{count} rays of {} fans at once",
                    fans.len()
                );
                self.device.queue().write_buffer(&self.fans, 0, bytemuck::cast_slice(&placed));
                self.rays.trace_fans(&self.fans, fans.len(), count)?;
                Ok(count)
            }
        }
    }

    fn dispatch(&mut self, runs: &[EndRun], counted: &mut RunParts) -> Result<(), BackendError> {
        let voxels = self.voxels.as_ref().expect("it was said where rays end");
        let pass = Pass { entry_count: runs.len() as u32, ..self.pass };
        self.device.queue().write_buffer(&self.runs, 0, bytemuck::cast_slice(runs));
        let mut recorder = Recorder::new(&self.device, &self.uniforms, None);
        recorder.clear(&self.parts_taken);
        let (rays, sums) = (&self.rays, [&self.parts, &self.part_spans, &self.parts_taken]);
        let bound = [&rays.queries, &rays.hits, &self.sides, voxels, &self.runs, sums[0], sums[1], sums[2]];
        recorder.dispatch(&COUNT_ENDS, &bound, pass, folded(runs.len() as u32));
        // What spans say is known with the first of the parts; the rest, if any, is read once more.
        let span_bytes = (runs.len() * size_of::<EndSpan>()) as u64;
        let guess = (self.parts_guess.min(self.parts_max) * size_of::<EndPart>()) as u64;
        let mut staging = Staging::new(&self.device, span_bytes + guess)?;
        recorder.copy(&self.part_spans, 0, staging.buffer(), 0, span_bytes);
        recorder.copy(&self.parts, 0, staging.buffer(), span_bytes, guess);
        let submission = recorder.submit()?;
        staging.map(&self.device, "ends", span_bytes + guess);
        self.device.wait("ends", submission)?;
        staging.hear(&self.device);
        let (mut spans, mut parts) = (Vec::<EndSpan>::new(), Vec::<EndPart>::new());
        staging.take(&self.device, span_bytes + guess, |bytes| {
            let (of_spans, of_parts) = bytes.split_at(span_bytes as usize);
            spans = bytemuck::pod_collect_to_vec(of_spans);
            parts = bytemuck::pod_collect_to_vec(of_parts);
        })?;
        let total: usize = spans.iter().map(|span| span.part_count as usize).sum();
        counted.read_bytes += span_bytes + guess;
        if total > parts.len() {
            let bytes = (total * size_of::<EndPart>()) as u64;
            let read = read_now(&self.device, "ends", &self.parts, bytes, |_| {})?;
            parts = bytemuck::pod_collect_to_vec(&read);
            counted.read_bytes += bytes;
        }
        self.parts_guess = total + total / 8;
        let of = |span: &EndSpan| {
            parts[span.first_part as usize..(span.first_part + span.part_count) as usize].to_vec()
        };
        counted.runs.extend(spans.iter().map(of));
        Ok(())
    }
}

impl AskedRays<'_> {
    fn bytes(&self) -> u64 {
        match self {
            Self::Made(queries) => size_of_val(*queries) as u64,
            Self::Fans(fans) => size_of_val(*fans) as u64,
        }
    }
}

/// `voxels` in a table that a kernel searches from the hash of a voxel on, at most half full.
fn voxel_table(voxels: &[MapVoxel]) -> Vec<EndVoxel> {
    let mut table = vec![EndVoxel::zeroed(); (2 * voxels.len()).next_power_of_two().max(2)];
    let last = table.len() - 1;
    for &MapVoxel { voxel, patches, asks_host, buried } in voxels {
        let [x, y, z] = voxel.map(i32::cast_unsigned);
        let mut slot = mix(x.wrapping_add(mix(y.wrapping_add(mix(z))))) as usize & last;
        while table[slot].is_taken != 0 {
            slot = (slot + 1) & last;
        }
        let [along, against] = [0, 1].map(|side| [0, 2, 4].map(|axis| patches[axis + side]));
        let asks_host = u32::from(asks_host);
        table[slot] = EndVoxel { voxel, is_taken: 1, along, asks_host, against, buried };
    }
    table
}
