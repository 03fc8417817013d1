//! The one place that asks `earthshine-light` for direct light.
//!
//! It owns the shadow casters of all chunks in memory and says when and where they have changed; which slots are lit again,
//! and when, is [`crate::relight`]'s business.

use crate::refusals::Refusals;
use earthshine_light::{
    DirectLight, LightUnderWay, LitPatch, OccluderSet, Occluders, PatchPoints, direct_irradiance_on,
};
use earthshine_world::random::{Purpose, hash};
use earthshine_world::{Bounds, ChunkId, Light, OccluderMesh, Patch, Rgb, SamplePoint};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// How far shadow rays start off their surface at least, in voxel edges.
const RAY_EPSILON_VOXELS: f32 = 1e-3;

/// Changes remembered: more than tiles come and go between two looks of a session.
const CHANGES_KEPT: usize = 256;

/// Who lights many patches at once, and when it is asked.
#[derive(Debug)]
struct Device {
    light: Box<dyn DirectLight>,
    refusals: Refusals,
}

/// Shadow casters of every chunk of one level whose tile is in memory.
#[derive(Debug)]
pub(crate) struct ShadowCasters {
    set: OccluderSet,
    generation: u64,
    /// The newest changes, the last of which made the present generation.
    changes: VecDeque<Bounds>,
    seed: u64,
    ray_epsilon_m: f32,
    /// Lights many patches at once, where there is one.
    device: Option<Mutex<Device>>,
}

impl ShadowCasters {
    pub(crate) fn new(seed: u64, level: u8, voxel_edge_m: f32) -> Self {
        let voxels = OccluderMesh::displacement_voxels(level).max(RAY_EPSILON_VOXELS);
        Self {
            set: OccluderSet::new(),
            generation: 0,
            changes: VecDeque::new(),
            seed,
            ray_epsilon_m: voxels * voxel_edge_m,
            device: None,
        }
    }

    /// [`Self::ask`] asks `device` from now on.
    pub(crate) fn light_by(&mut self, device: Box<dyn DirectLight>) {
        self.device = Some(Mutex::new(Device { light: device, refusals: Refusals::default() }));
    }

    /// Counts changes.
    pub(crate) fn generation(&self) -> u64 {
        self.generation
    }

    /// What came or went after `generation`; nothing if that was too long ago to tell.
    pub(crate) fn changes_since(&self, generation: u64) -> Option<impl Iterator<Item = &Bounds>> {
        let count = usize::try_from(self.generation.checked_sub(generation)?).ok()?;
        let first = self.changes.len().checked_sub(count)?;
        Some(self.changes.range(first..))
    }

    fn has_changed(&mut self, where_to: Bounds) {
        self.generation += 1;
        if self.changes.len() == CHANGES_KEPT {
            self.changes.pop_front();
        }
        self.changes.push_back(where_to);
    }

    /// Chunks that cast shadows.
    pub(crate) fn len(&self) -> usize {
        self.set.len()
    }

    /// A tile came. One without triangles changes no shadow and is left out.
    pub(crate) fn insert(&mut self, chunk: ChunkId, occluders: Arc<Occluders>) {
        if occluders.triangle_count() > 0 {
            self.has_changed(occluders.bounds());
            self.set.insert(chunk, occluders);
        }
    }

    /// A tile with `occluders` went.
    pub(crate) fn remove(&mut self, chunk: ChunkId, occluders: &Occluders) {
        let before = self.set.len();
        self.set.remove(chunk);
        if self.set.len() != before {
            self.has_changed(occluders.bounds());
        }
    }

    /// Has somebody else light `patches`, each with its points, by `lights`; nothing where the CPU has to.
    pub(crate) fn ask(
        &self,
        lights: &[Light],
        patches: &[(&Patch, &[SamplePoint])],
        wants_points: bool,
    ) -> Option<Box<dyn LightUnderWay>> {
        let device = self.device.as_ref().filter(|_| !lights.is_empty())?;
        let Device { light, refusals } = &mut *device.lock().unwrap_or_else(PoisonError::into_inner);
        let rays: usize = patches.iter().map(|(_, points)| points.len() * lights.len()).sum();
        if rays < light.rays_min() || !refusals.may_ask() {
            return None;
        }
        let asked: Vec<_> = patches.iter().map(|&(patch, points)| self.asked(patch, points)).collect();
        let light = light.begin(&self.set, lights, &asked, wants_points);
        if light.is_none() {
            refusals.note();
        }
        light
    }

    /// Irradiance on each of `patches`, with its points, from delta lights, lx, and that on each of the points; nothing where
    /// all have the same. The same bits for the same lights, casters and seed.
    pub(crate) fn irradiance(&self, lights: &[Light], patches: &[(&Patch, &[SamplePoint])]) -> Vec<LitPatch> {
        if lights.is_empty() {
            return vec![(Rgb::ZERO, Box::default()); patches.len()];
        }
        let lit = |&(patch, points): &(&Patch, &[SamplePoint])| {
            let of = self.asked(patch, points);
            direct_irradiance_on(&self.set, lights, of.points, of.epsilon_m, of.seed)
        };
        patches.iter().map(lit).collect()
    }

    fn asked<'a>(&self, patch: &Patch, points: &'a [SamplePoint]) -> PatchPoints<'a> {
        let rounding = 8.0 * f32::EPSILON * patch.centroid.abs().max_element();
        PatchPoints { points, epsilon_m: self.ray_epsilon_m.max(rounding), seed: self.patch_seed(patch) }
    }

    /// The patch's own, wherever it is resident.
    fn patch_seed(&self, patch: &Patch) -> u64 {
        let [x, y, z] = patch.voxel.to_array().map(|c| u64::from(c.cast_unsigned()));
        hash(self.seed, Purpose::SunDisc, x << 32 | y, z << 32 | patch.direction.index() as u64)
    }
}
