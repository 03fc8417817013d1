//! Whose an emitter's rays are that end in a detail voxel with several layers.
//!
//! They say which side of which triangle they end on ([`crate::emitted`]), and a layer takes those of its own. A wall parts
//! the floor that goes on behind it into two layers, and both consist of one triangle: there a layer's share is its area as
//! far as the emitter is seen from it.

use crate::emitted::{is_plain, piece_of};
use crate::patches::BakePatch;
use crate::places::Place;
use crate::rows::{RAY_OFFSET, RowCaster};
use crate::sample::SurfaceSample;
use earthshine_trace::Hit;
use earthshine_world::{Patch, SamplePoint};
use glam::IVec3;
use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Places of a layer that an emitter is looked for from.
const EYES: u32 = 4;
/// How far before an emitter's middle a look at it ends, in voxel edges.
const BEFORE_EMITTER: f32 = 0.02;

/// The sides of triangles that one of the layers of a detail voxel and direction consists of.
#[derive(Debug, Clone)]
pub(crate) struct Pieces {
    layers: Arc<[LayerPieces]>,
    own: usize,
}

#[derive(Debug)]
struct LayerPieces {
    /// By [`piece_of`], m2.
    areas: BTreeMap<u32, f32>,
    eyes: Vec<SamplePoint>,
}

impl Pieces {
    /// Those of each of `layers`, made of `samples` in detail voxels; `None` for the only layer, if its pieces are plain.
    pub(crate) fn of(
        layers: &[BakePatch],
        samples: &[SurfaceSample],
        caster: &RowCaster<'_>,
    ) -> Vec<Option<Self>> {
        let (scene, set) = (caster.tracer.scene(), caster.set);
        let detail = IVec3::splat(caster.parameters.detail.cast_signed());
        let of_layer = |layer: &BakePatch| {
            let mut areas: BTreeMap<u32, f32> = BTreeMap::new();
            for (sample, area) in layer.areas() {
                let place = samples[sample as usize].place();
                let place = Place { voxel: place.voxel.div_euclid(detail), ..place };
                *areas.entry(piece_of(scene, set, &place)).or_default() += area;
            }
            let eye = |number: u32| {
                let sample = &samples[layer.sample_at((number as f32 + 0.5) / EYES as f32) as usize];
                SamplePoint { position: sample.position, normal: sample.normal }
            };
            LayerPieces { areas, eyes: (0..EYES).map(eye).collect() }
        };
        let all: Arc<[LayerPieces]> = layers.iter().map(of_layer).collect();
        if let [only] = &all[..]
            && only.areas.keys().all(|&piece| is_plain(piece))
        {
            return vec![None];
        }
        (0..layers.len()).map(|own| Some(Self { layers: Arc::clone(&all), own })).collect()
    }

    /// What it takes of the light of `emitter`.
    pub(crate) fn lit_by<'p>(&'p self, emitter: &'p Patch, caster: &'p RowCaster<'p>) -> LitBy<'p> {
        LitBy { pieces: self, emitter, caster, sees: vec![OnceCell::new(); self.layers.len()] }
    }
}

/// One emitter's light on a layer and on those that share its detail voxel and direction; each looks for it once at most.
#[derive(Debug)]
pub(crate) struct LitBy<'p> {
    pieces: &'p Pieces,
    emitter: &'p Patch,
    caster: &'p RowCaster<'p>,
    /// By layer.
    sees: Vec<OnceCell<f32>>,
}

impl LitBy<'_> {
    /// Which share of what the emitter sends to `piece` is the layer's own; `None` where the piece is of others.
    pub(crate) fn share(&self, piece: u32) -> Option<f32> {
        let Pieces { layers, own: own_layer } = self.pieces;
        let own = *layers[*own_layer].areas.get(&piece)?;
        let area_of = |(layer, of): (usize, &LayerPieces)| Some((layer, *of.areas.get(&piece)?));
        let sharers = || layers.iter().enumerate().filter_map(area_of);
        if sharers().count() == 1 {
            return Some(1.0);
        }
        let seen = |(layer, area): (usize, f32)| {
            area * self.sees[layer].get_or_init(|| layers[layer].sees(self.emitter, self.caster))
        };
        let all: f32 = sharers().map(seen).sum();
        if all > 0.0 {
            return Some(seen((*own_layer, own)) / all);
        }
        Some(own / sharers().map(|(_, area)| area).sum::<f32>().max(f32::MIN_POSITIVE))
    }
}

impl LayerPieces {
    /// The share of its eyes that see the middle of `emitter`, or something before it that emits: itself, where its middle lies in
    /// it.
    fn sees(&self, emitter: &Patch, caster: &RowCaster<'_>) -> f32 {
        let edge_m = caster.parameters.grid.voxel_edge_m;
        let target = emitter.centroid + emitter.direction.vector() * (BEFORE_EMITTER * edge_m);
        let is_seen = |eye: &&SamplePoint| {
            let origin = eye.position + eye.normal * (RAY_OFFSET * edge_m);
            let way = target - origin;
            let distance = way.length().max(f32::MIN_POSITIVE);
            let is_of_lamp = |hit: &Hit| caster.tracer.tracer().emits(hit);
            let stop = || caster.tracer.closest(origin, way / distance, distance);
            way.dot(eye.normal) > 0.0 && stop().as_ref().is_none_or(is_of_lamp)
        };
        self.eyes.iter().filter(is_seen).count() as f32 / EYES as f32
    }
}

impl BakePatch {
    /// Its samples, and how much of its area each is, m2.
    pub(crate) fn areas(&self) -> impl Iterator<Item = (u32, f32)> {
        let before = std::iter::once(0.0).chain(self.samples.iter().map(|&(_, cumulated)| cumulated));
        self.samples.iter().zip(before).map(|(&(sample, cumulated), before)| (sample, cumulated - before))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exposure::Exposure;
    use crate::patches::PatchSet;
    use crate::test_shapes::{boxed, quad, scene_of};
    use earthshine_scene::Material;
    use earthshine_tiles::BakeParameters;
    use earthshine_trace::SceneTracer;
    use earthshine_world::{Direction, Grid, Rgb, Vec3, VoxelCoord};

    /// Goal: a lamp's light stays on its side of a wall. Method: a floor of two triangles, parted by a wall along x = 0.5 or by
    /// nothing, and a lamp beside it, which is round or nothing but a place.
    fn shares(has_wall: bool, is_round: bool) -> [Option<f32>; 2] {
        let mut triangles = quad(Vec3::ZERO, Vec3::Z, Vec3::X).to_vec();
        if has_wall {
            triangles.extend(quad(Vec3::new(0.5, 0.0, -5.0), Vec3::Z * 11.0, Vec3::Y * 5.0));
        }
        let mut scene = scene_of(triangles);
        if is_round {
            // Its middle, seen from below, lies in it.
            let lamp = boxed(Vec3::new(-1.2, 1.8, 0.3), Vec3::new(-0.8, 2.2, 0.7));
            let glowing = Material { emitted_radiance: Rgb::ONE, ..scene.materials[0].clone() };
            scene.material_of.extend(lamp.triangles.iter().map(|_| scene.materials.len() as u32));
            scene.texture_coordinates.extend(lamp.texture_coordinates);
            scene.triangles.extend(lamp.triangles);
            scene.materials.push(glowing);
        }
        let tracer = SceneTracer::new(&scene);
        let parameters = BakeParameters {
            grid: Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 1 },
            ..BakeParameters::default()
        };
        let middle = |i: u32| (i as f32 + 0.5) / 8.0;
        let samples: Vec<SurfaceSample> = (0..64)
            .map(|i| SurfaceSample {
                position: Vec3::new(middle(i % 8), 0.0, middle(i / 8)),
                normal: Vec3::Y,
                side: 0,
                voxel: VoxelCoord::ZERO,
                area: 1.0 / 64.0,
                reflectance: Rgb::ONE,
                emission: Rgb::ZERO,
                exposure: Exposure::Open(1.0),
                is_suspect: false,
            })
            .collect();
        let layers: Vec<[u8; 6]> = (0..64u8).map(|i| [i % 8 / 4; 6]).collect();
        let set = PatchSet::of_layers(&samples, &layers, &parameters);
        let caster = RowCaster {
            tracer: (&tracer).into(),
            samples: &samples,
            sources: &[],
            first: 0,
            set: &set,
            parameters: &parameters,
        };
        let lamp =
            Patch { direction: Direction::NegY, centroid: Vec3::new(-1.0, 2.0, 0.5), ..set.patches[0].patch };
        let pieces = Pieces::of(&set.patches, &samples, &caster);
        let piece = piece_of(&scene, &set, &samples[0].place());
        let share = |layer: usize| pieces[layer].as_ref()?.lit_by(&lamp, &caster).share(piece);
        assert_eq!(pieces[0].as_ref().expect("two layers").lit_by(&lamp, &caster).share(piece ^ 8), None);
        [share(0), share(1)]
    }

    #[test]
    fn a_shared_side_s_light_is_of_those_who_see_the_lamp() {
        for is_round in [false, true] {
            assert_eq!(shares(false, is_round), [Some(0.5), Some(0.5)]);
            assert_eq!(shares(true, is_round), [Some(1.0), Some(0.0)]);
        }
    }
}
