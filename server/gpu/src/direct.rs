//! Direct light on a device: every lamp at every point of many patches, with shadow rays through the resident chunks' trees.
//! It is handed over and fetched when it has come: the mean of each patch, 16 bytes, and light on single points, 12 bytes each,
//! only where somebody wants that and it differs.
//!
//! ```text
//! light_points ▶ sum_lamps ▶ sum_points ──means──────────────┬▶ staging ┄┄▶ host
//!                               └▶ scan_groups ▶ list_points ┘
//! ```
//!
//! Chunks' trees go to the device when they become resident and stay there; what changes with every chunk is the small tree
//! over them. Room is handed out from the front of two lists; when one is full, what is still resident is put into new ones
//! with as much room again, so a chunk is uploaded about twice while it is resident, however many come and go.

use crate::arena::Arena;
use crate::device::GpuDevice;
pub use crate::lit_patches::GpuLight;
use crate::lit_patches::{Coming, Guess};
use crate::rays::{STORAGE, TreesError, check_depth, placement_words, triangle_words, uploaded};
use crate::recorder::{Recorder, folded, uniform_buffer};
use crate::timing::{PassTime, Sampling, Timing};
use earthshine_light::tree_layout::{NodeWords, Placement};
use earthshine_light::{DirectLight, LightUnderWay, OccluderSet, Occluders, PatchPoints};
use earthshine_radiosity::BackendError;
use earthshine_shaders::host::{Lamp, LightPoint, Pass, PointSpan, TreePlacement, TreeTriangle};
use earthshine_shaders::kernel::{LIGHT_POINTS, SUM_LAMPS};
use earthshine_shaders::limits::RAY_LANES;
use earthshine_world::Light;
use glam::DAffine3;
use std::collections::BTreeMap;
use std::sync::Arc;
use wgpu::{Buffer, BufferUsages};

/// Most points times lamps of one dispatch: 64 MiB of what arrives. More are lit in several.
const DISPATCH_RAYS_MAX: usize = 1 << 22;
/// Triangles that there is room for at first.
const TRIANGLES_MIN: u64 = 1 << 14;
/// Fewer points times lamps are left to the CPU. Reckoned from the CPU's rate and a way to a device and back, not measured:
/// look again with hardware.
pub const RAYS_MIN: usize = 1024;

/// Where a chunk's trees are; held so that its address stays its own.
#[derive(Debug)]
struct Resident {
    _held: Arc<Occluders>,
    first_node: u32,
    first_triangle: u32,
    depth: u32,
}

/// Trees of one level's resident chunks on a device, and what lights patches through them. For one [`OccluderSet`] all its life.
#[derive(Debug)]
pub struct GpuDirect {
    device: GpuDevice,
    /// By address.
    residents: BTreeMap<usize, Resident>,
    nodes: Arena,
    triangles: Arena,
    placements: Buffer,
    top_node: u32,
    /// Of the set that was uploaded.
    changes: Option<u64>,
    uniforms: Buffer,
    timing: Option<Timing>,
    sampling: Sampling,
    guess: Guess,
}

impl GpuDirect {
    /// Nothing casts shadows yet.
    ///
    /// # Errors
    /// [`TreesError`].
    pub fn new(device: &GpuDevice) -> Result<Self, TreesError> {
        Ok(Self {
            residents: BTreeMap::new(),
            nodes: arena(device, "nodes", size_of::<NodeWords>(), TRIANGLES_MIN / 4)?,
            triangles: arena(device, "triangles", size_of::<TreeTriangle>(), TRIANGLES_MIN)?,
            placements: device.buffer("placements", 0, STORAGE)?,
            top_node: 0,
            changes: None,
            uniforms: uniform_buffer(device)?,
            timing: None,
            sampling: Sampling::default(),
            device: device.clone(),
            guess: Guess::default(),
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

    /// Hands the light of `patches` over, in order, through `occluders`; see [`DirectLight::begin`].
    ///
    /// # Errors
    /// [`TreesError`].
    pub fn light(
        &mut self,
        occluders: &OccluderSet,
        lights: &[Light],
        patches: &[PatchPoints<'_>],
        wants_points: bool,
    ) -> Result<GpuLight, TreesError> {
        self.bring(occluders)?;
        let mut light = GpuLight::new(&self.device, wants_points.then(|| self.guess.clone()));
        if lights.is_empty() {
            light.push_dark(patches.len());
            return Ok(light);
        }
        self.sampling.begin(&self.device, &mut self.timing)?;
        let mut first = 0;
        while first < patches.len() {
            let mut rays = 0;
            let fits = |patch: &&PatchPoints<'_>| {
                rays += patch.points.len().max(1) * lights.len();
                rays <= DISPATCH_RAYS_MAX
            };
            let count = patches[first..].iter().take_while(fits).count().max(1);
            self.dispatch(lights, &patches[first..first + count], &mut light)?;
            first += count;
        }
        self.sampling.end(&self.device, &mut self.timing)?;
        Ok(light)
    }

    /// Puts on the device what `occluders` has and it has not.
    fn bring(&mut self, occluders: &OccluderSet) -> Result<(), TreesError> {
        if self.changes == Some(occluders.changes()) {
            return Ok(());
        }
        self.changes = None;
        let (top, top_depth, chunks) = occluders.top_level();
        let held: BTreeMap<usize, &Arc<Occluders>> =
            chunks.iter().map(|chunk| (address(chunk), chunk)).collect();
        self.residents.retain(|at, _| held.contains_key(at));
        if !self.place_all(&held, top.len()) {
            self.make_room(&held, top.len())?;
            self.place_all(&held, top.len());
        }
        let residents = chunks.iter().map(|chunk| &self.residents[&address(chunk)]);
        check_depth(top_depth + residents.clone().map(|resident| resident.depth).max().unwrap_or(0))?;
        let placed = residents.map(|resident| {
            let Resident { first_node, first_triangle, .. } = *resident;
            placement_words(&Placement { to_tree: DAffine3::IDENTITY, first_node, first_triangle })
        });
        let placed: Vec<TreePlacement> = placed.collect();
        self.placements = uploaded(&self.device, "placements", &placed)?;
        self.top_node = self.nodes.push(&self.device, &top);
        self.changes = Some(occluders.changes());
        Ok(())
    }

    /// Uploads the chunks of `held` that are not there, as long as there is room, and for the `top` nodes over them too.
    fn place_all(&mut self, held: &BTreeMap<usize, &Arc<Occluders>>, top: usize) -> bool {
        for (&at, &occluders) in held {
            if self.residents.contains_key(&at) {
                continue;
            }
            let (nodes, triangles, depth) = occluders.layout();
            if !self.nodes.has_room(nodes.len() + top) || !self.triangles.has_room(triangles.len()) {
                return false;
            }
            let triangles: Vec<TreeTriangle> = triangles.iter().map(triangle_words).collect();
            let first_node = self.nodes.push(&self.device, &nodes);
            let first_triangle = self.triangles.push(&self.device, &triangles);
            self.residents
                .insert(at, Resident { _held: Arc::clone(occluders), first_node, first_triangle, depth });
        }
        self.nodes.has_room(top)
    }

    /// Forgets all chunks and makes room for twice what `held` takes, or for just that where a binding holds no more.
    fn make_room(&mut self, held: &BTreeMap<usize, &Arc<Occluders>>, top: usize) -> Result<(), TreesError> {
        self.residents.clear();
        let most = self.device.binding_bytes_max();
        let layouts = held.values().map(|occluders| (occluders.node_count(), occluders.triangle_count()));
        let (nodes, triangles) = layouts.fold((top, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        let room = |count: usize, stride: usize, least: u64| {
            (2 * count as u64).min(most / stride as u64).max(count as u64).max(least)
        };
        let strides = (size_of::<NodeWords>(), size_of::<TreeTriangle>());
        self.nodes = arena(&self.device, "nodes", strides.0, room(nodes, strides.0, TRIANGLES_MIN / 4))?;
        self.triangles =
            arena(&self.device, "triangles", strides.1, room(triangles, strides.1, TRIANGLES_MIN))?;
        Ok(())
    }

    fn dispatch(
        &mut self,
        lights: &[Light],
        patches: &[PatchPoints<'_>],
        light: &mut GpuLight,
    ) -> Result<(), TreesError> {
        let (points, spans) = point_words(patches);
        let lamps: Vec<Lamp> = lights.iter().map(lamp_words).collect();
        let shift = |patch: &PatchPoints<'_>, index: usize| match lamps[index].cap_height > 0.0 {
            true => patch.disc_shift(index).into(),
            false => [0.0; 2],
        };
        let shifts: Vec<[f32; 2]> = patches
            .iter()
            .flat_map(|patch| (0..lamps.len()).map(move |index| (patch, index)))
            .map(|(patch, index)| shift(patch, index))
            .collect();
        let (device, rays) = (&self.device, points.len() * lamps.len());
        let [points_on, spans_on] =
            [uploaded(device, "points", &points)?, uploaded(device, "spans", &spans)?];
        let [lamps_on, shifts_on] =
            [uploaded(device, "lamps", &lamps)?, uploaded(device, "shifts", &shifts)?];
        let arriving = device.buffer("arriving", 16 * rays as u64, BufferUsages::STORAGE)?;
        let on_points = device.buffer("on points", 16 * points.len() as u64, BufferUsages::STORAGE)?;
        let pass = Pass {
            rows: points.len() as u32,
            entry_count: lamps.len() as u32,
            top_node: self.top_node,
            ..Pass::default()
        };
        let mut recorder = Recorder::new(device, &self.uniforms, self.timing.as_mut());
        let [nodes, triangles] = [self.nodes.buffer(), self.triangles.buffer()];
        let bound =
            [nodes, &self.placements, triangles, &points_on, &spans_on, &lamps_on, &shifts_on, &arriving];
        recorder.dispatch(&LIGHT_POINTS, &bound, pass, folded((rays as u32).div_ceil(RAY_LANES)));
        let groups = (points.len() as u32).div_ceil(RAY_LANES);
        recorder.dispatch(&SUM_LAMPS, &[&arriving, &on_points], pass, folded(groups));
        let counts = [spans.len() as u32, points.len() as u32];
        let coming = Coming::record(device, &mut recorder, [&spans_on, &on_points], counts, light.guess())?;
        light.push(coming, recorder.submit()?);
        Ok(())
    }
}

impl DirectLight for GpuDirect {
    fn rays_min(&self) -> usize {
        if self.device.is_lost() { usize::MAX } else { RAYS_MIN }
    }

    fn begin(
        &mut self,
        occluders: &OccluderSet,
        lights: &[Light],
        patches: &[PatchPoints<'_>],
        wants_points: bool,
    ) -> Option<Box<dyn LightUnderWay>> {
        let light = self.light(occluders, lights, patches, wants_points);
        match light {
            Ok(light) => Some(Box::new(light)),
            Err(error) => {
                self.device.warn_once("direct light", &error);
                None
            }
        }
    }
}

/// Room for `capacity` elements in one binding.
fn arena(device: &GpuDevice, label: &str, stride: usize, capacity: u64) -> Result<Arena, TreesError> {
    let (bytes, most) = (stride as u64 * capacity, device.binding_bytes_max());
    if bytes > most {
        return Err(TreesError::TooLarge { bytes, most });
    }
    Ok(Arena::new(device, label, stride, capacity)?)
}

fn point_words(patches: &[PatchPoints<'_>]) -> (Vec<LightPoint>, Vec<PointSpan>) {
    let (mut points, mut spans) = (Vec::new(), Vec::new());
    for (of_patch, patch) in (0u32..).zip(patches) {
        spans.push(PointSpan { first_point: points.len() as u32, point_count: patch.points.len() as u32 });
        points.extend(patch.points.iter().map(|point| LightPoint {
            position: point.position.to_array(),
            epsilon_m: patch.epsilon_m,
            normal: point.normal.to_array(),
            of_patch,
        }));
    }
    (points, spans)
}

fn address(occluders: &Arc<Occluders>) -> usize {
    Arc::as_ptr(occluders).addr()
}

fn lamp_words(light: &Light) -> Lamp {
    match *light {
        Light::Directional { direction, illuminance, angular_diameter_rad } => {
            let half_angle = 0.5 * angular_diameter_rad;
            let strength = illuminance * (2.0 / (1.0 + half_angle.cos()));
            let cap_height = if half_angle > 0.0 { 2.0 * (0.5 * half_angle).sin().powi(2) } else { 0.0 };
            let (direction, intensity) = (direction.to_array(), strength.to_array());
            Lamp { kind: 0, direction, intensity, cap_height, ..Lamp::default() }
        }
        Light::Point { position, intensity, range_m } => Lamp {
            kind: 1,
            position: position.to_array(),
            intensity: intensity.to_array(),
            range_m: range_m.unwrap_or(0.0),
            ..Lamp::default()
        },
        Light::Spot { position, direction, intensity, inner_cone_rad, outer_cone_rad, range_m } => Lamp {
            kind: 2,
            position: position.to_array(),
            direction: direction.to_array(),
            intensity: intensity.to_array(),
            range_m: range_m.unwrap_or(0.0),
            inner_cosine: inner_cone_rad.cos(),
            outer_cosine: outer_cone_rad.cos(),
            ..Lamp::default()
        },
    }
}
