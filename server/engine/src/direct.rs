//! The one place that asks `earthshine-light` for direct light.
//!
//! It owns the shadow casters of all chunks in memory and says when and where they have changed; which slots are lit again,
//! and when, is [`crate::relight`]'s business.

use earthshine_light::{DirectLight, OccluderSet, Occluders, PatchPoints, direct_irradiance_on, told_apart};
use earthshine_world::random::{Purpose, hash};
use earthshine_world::{Bounds, ChunkId, Light, OccluderMesh, Patch, Rgb, SamplePoint};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// How far shadow rays start off their surface at least, in voxel edges.
const RAY_EPSILON_VOXELS: f32 = 1e-3;

/// Changes remembered: more than tiles come and go between two looks of a session.
const CHANGES_KEPT: usize = 256;

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
    device: Option<Mutex<Box<dyn DirectLight>>>,
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

    /// Patches are lit by `device` from now on, as far as it can.
    pub(crate) fn light_by(&mut self, device: Box<dyn DirectLight>) {
        self.device = Some(Mutex::new(device));
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

    /// Irradiance on each of `patches`, with its points, from delta lights, lx, and that on each of the points; nothing where
    /// all have the same. The same bits for the same lights, casters and seed, on one device or on the CPU.
    pub(crate) fn irradiance(
        &self,
        lights: &[Light],
        patches: &[(&Patch, &[SamplePoint])],
    ) -> Vec<(Rgb, Box<[Rgb]>)> {
        if lights.is_empty() {
            return vec![(Rgb::ZERO, Box::default()); patches.len()];
        }
        let asked: Vec<PatchPoints<'_>> =
            patches.iter().map(|&(patch, points)| self.asked(patch, points)).collect();
        let by_device = self.device.as_ref().and_then(|device| {
            device.lock().unwrap_or_else(PoisonError::into_inner).on_points(&self.set, lights, &asked)
        });
        let Some(on_points) = by_device else {
            let on_cpu = |of: &PatchPoints<'_>| {
                direct_irradiance_on(&self.set, lights, of.points, of.epsilon_m, of.seed)
            };
            return asked.iter().map(on_cpu).collect();
        };
        let mut rest = &on_points[..];
        let mut next = |of: &PatchPoints<'_>| {
            let (own, others) = rest.split_at(of.points.len());
            rest = others;
            (own.iter().sum::<Rgb>() / own.len().max(1) as f32, told_apart(own))
        };
        asked.iter().map(&mut next).collect()
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

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::{Direction, Vec3, VoxelCoord};

    /// Lights batches of two and more, and nothing else.
    #[derive(Debug)]
    struct Fussy;

    impl DirectLight for Fussy {
        fn on_points(
            &mut self,
            _: &OccluderSet,
            _: &[Light],
            patches: &[PatchPoints<'_>],
        ) -> Option<Vec<Rgb>> {
            let counts: usize = patches.iter().map(|patch| patch.points.len()).sum();
            (patches.len() > 1).then(|| (0..counts).map(|at| Rgb::splat(at as f32)).collect())
        }
    }

    #[test]
    fn a_device_lights_what_it_can_and_the_cpu_the_rest() {
        let sun = Light::Directional {
            direction: Vec3::NEG_Y,
            illuminance: Rgb::splat(10.0),
            angular_diameter_rad: 0.0,
        };
        let patch = Patch {
            voxel: VoxelCoord::ZERO,
            direction: Direction::PosY,
            area: 1.0,
            centroid: Vec3::ZERO,
            reflectance: Rgb::splat(0.5),
            emission: Rgb::ZERO,
            point_first: 0,
            point_count: 1,
        };
        let point = SamplePoint { position: Vec3::ZERO, normal: Vec3::Y };
        let asked = [(&patch, &[point; 1][..]), (&patch, &[point; 3][..])];
        let alike = |light: f32| (Rgb::splat(light), Box::<[Rgb]>::default());
        let mut casters = ShadowCasters::new(1, 0, 1.0);
        assert_eq!(casters.irradiance(&[sun], &asked), [alike(10.0), alike(10.0)]);
        casters.light_by(Box::new(Fussy));
        let apart = [1.0, 2.0, 3.0].map(Rgb::splat);
        assert_eq!(casters.irradiance(&[sun], &asked), [alike(0.0), (Rgb::splat(2.0), Box::new(apart) as _)]);
        assert_eq!(casters.irradiance(&[sun], &asked[..1]), [alike(10.0)]);
        assert_eq!(casters.irradiance(&[], &asked), [alike(0.0), alike(0.0)]);
    }
}
