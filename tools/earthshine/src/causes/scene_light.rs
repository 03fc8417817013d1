//! A solved world seen from the scene: which patches stand for a place that a ray hit, and what leaves them.

use crate::whole_world::{WholeLight, WholeWorld};
use earthshine_bake::exposure::{NEAR_SHARE, NEAR_VOXELS};
use earthshine_bake::sample::{side_weights, voxel_of};
use earthshine_render::SceneTracer;
use earthshine_render::path::{EmitterSampling, PathTracer};
use earthshine_render::sampling::{PathStream, cosine_direction};
use earthshine_render::tracer::{Vertex, off_surface};
use earthshine_tiles::BakeParameters;
use earthshine_world::{LightRig, Patch, Rgb, SamplePoint, Vec3, VoxelCoord};
use std::collections::HashMap;
use std::f32::consts::PI;

/// Rays that tell whether a dark place behind a glowing patch is hidden.
const HIDDEN_RAYS: u64 = 16;

/// A patch with its light.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LitPatch<'a> {
    pub patch: &'a Patch,
    pub points: &'a [SamplePoint],
    irradiance: Rgb,
    /// `pi L`.
    emission: Rgb,
    /// Reflected first arrival of lamps and sun.
    lamps: Rgb,
}

/// What the patches of a place send out, by where it comes from, lm/m2; absent patches send nothing.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PlaceLight {
    pub emission: Rgb,
    pub lamps: Rgb,
    pub bounced: Rgb,
    /// Irradiance on them, lx.
    pub irradiance: Rgb,
    /// Share of the place that has patches.
    pub covered: f32,
}

impl PlaceLight {
    pub(crate) fn exitance(&self) -> Rgb {
        self.emission + self.lamps + self.bounced
    }
}

/// A world, its light and its scene together.
pub(crate) struct SceneLight<'a> {
    pub tracer: &'a SceneTracer<'a>,
    pub rig: &'a LightRig,
    pub parameters: BakeParameters,
    patches: Vec<LitPatch<'a>>,
    /// Only looked up, never iterated.
    by_voxel: HashMap<VoxelCoord, [Option<u32>; 6]>,
    /// Patches of what emits beside what does not.
    emitters: HashMap<VoxelCoord, [Option<u32>; 6]>,
}

impl<'a> SceneLight<'a> {
    /// Numbers the patches of `world`.
    pub(crate) fn new(
        world: &'a WholeWorld,
        light: &'a WholeLight,
        tracer: &'a SceneTracer<'a>,
        rig: &'a LightRig,
    ) -> Self {
        let mut patches = Vec::with_capacity(light.irradiance.len());
        let (mut by_voxel, mut emitters) = (HashMap::<VoxelCoord, [Option<u32>; 6]>::new(), HashMap::new());
        for chunk in world.chunks() {
            for (local, patch) in chunk.patches.iter().enumerate() {
                let index = patches.len();
                let emission = patch.emission * rig.emission_scale;
                let places = if chunk.is_told(local) { &mut by_voxel } else { &mut emitters };
                places.entry(patch.voxel).or_default()[patch.direction.index()] = Some(index as u32);
                patches.push(LitPatch {
                    patch,
                    points: chunk.points_of(patch),
                    irradiance: light.irradiance[index],
                    emission,
                    lamps: (light.direct_exitance[index] - emission).max(Rgb::ZERO),
                });
            }
        }
        Self { tracer, rig, parameters: world.manifest.parameters, patches, by_voxel, emitters }
    }

    /// m.
    pub(crate) fn voxel_edge_m(&self) -> f32 {
        self.parameters.grid.voxel_edge_m
    }

    /// The patch on side `direction` of `voxel`.
    pub(crate) fn patch(&self, voxel: VoxelCoord, direction: usize) -> Option<&LitPatch<'a>> {
        let index = self.by_voxel.get(&voxel)?[direction]?;
        self.patches.get(index as usize)
    }

    /// The patch on side `direction` of `voxel` that stands for what emits there, or else for what does not.
    fn patch_of(&self, voxel: VoxelCoord, direction: usize, emits: bool) -> Option<&LitPatch<'a>> {
        let emitter =
            if emits { self.emitters.get(&voxel).and_then(|patches| patches[direction]) } else { None };
        emitter.and_then(|index| self.patches.get(index as usize)).or_else(|| self.patch(voxel, direction))
    }

    /// What the patches that stand for `vertex` send out.
    pub(crate) fn at(&self, vertex: &Vertex) -> PlaceLight {
        let mut found = PlaceLight::default();
        let voxel = voxel_of(vertex.position, vertex.normal, self.voxel_edge_m());
        for (direction, weight) in side_weights(self.parameters.weights, vertex.normal) {
            if weight <= 0.0 {
                continue;
            }
            let emits = vertex.emitted_radiance != Rgb::ZERO;
            let Some(lit) = self.patch_of(voxel, direction.index(), emits) else { continue };
            let brightest = self.patch_of(voxel, direction.index(), true).unwrap_or(lit);
            if self.outshines(brightest.patch, vertex) {
                return PlaceLight::default();
            }
            found.emission += lit.emission * weight;
            found.lamps += lit.lamps * weight;
            found.bounced += lit.patch.reflectance * lit.irradiance * weight;
            found.irradiance += lit.irradiance * weight;
            found.covered += weight;
        }
        found
    }

    /// Whether `vertex` lies hidden behind a patch that glows as it does not itself: the bake books hits there as
    /// absorbed. The tiles do not name those places, so they are found again here.
    fn outshines(&self, patch: &Patch, vertex: &Vertex) -> bool {
        if patch.emission.max_element() <= 2.0 * PI * vertex.emitted_radiance.max_element() {
            return false;
        }
        let mut stream = PathStream::new(self.parameters.seed, 0);
        let origin = off_surface(vertex.position, vertex.normal);
        let near = NEAR_VOXELS * self.voxel_edge_m();
        let blocked = (0..HIDDEN_RAYS)
            .filter(|_| self.tracer.is_blocked(origin, cosine_direction(vertex.normal, stream.pair()), near));
        blocked.count() as f32 > NEAR_SHARE * HIDDEN_RAYS as f32
    }

    /// First arrival of lamps and sun at `vertex`, with shadows, lx.
    pub(crate) fn lamp_irradiance(&self, vertex: &Vertex, stream: &mut PathStream) -> Rgb {
        let paths =
            PathTracer { tracer: self.tracer, rig: self.rig, emitter_sampling: EmitterSampling::Balanced };
        paths.lamp_irradiance(vertex, stream, &mut 0)
    }

    /// Whether nothing stands between two places.
    pub(crate) fn sees(&self, from: Vec3, to: Vec3) -> bool {
        let distance = from.distance(to);
        (to - from)
            .try_normalize()
            .is_none_or(|direction| !self.tracer.is_blocked(from, direction, distance * (1.0 - 1e-4)))
    }
}
