//! How many patches a scene makes at a voxel edge, and at which edge it makes so many: counted, not baked.
//!
//! Triangles are cut at the voxel grid as the bake cuts them, and what faces one direction in one voxel counts once. Some
//! of it is buried (the inside of walls, floors under boxes) and makes no patch; how much is asked of a few hundred of
//! these places, by the bake's own rays. The answer is a guess of the bake's own count, within some 15 %; it hangs on the
//! scene and the parameters alone. Start at [`PatchCounter`].

use crate::apart::{EMITTER_ORDINALS, is_apart};
use crate::builder::Builder;
use crate::clip::clip_to_grid;
use crate::exposure::Exposure;
use crate::memory::{MemoryLimit, Trees, of_trees};
use crate::rows::{patch_key, voxel_of_key};
use crate::sample::{EVERYWHERE, OFF_SURFACE, SurfaceSample, sample_triangle, side_of, side_weights};
use earthshine_scene::Scene;
use earthshine_tiles::BakeParameters;
use earthshine_trace::SceneTracer;
use earthshine_world::random::{Purpose, hash};
use earthshine_world::{ChunkCoord, Grid, Vec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::RangeInclusive;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Triangles counted together.
const BATCH: usize = 256;
/// Places (a direction in a voxel) of which it is asked whether they are buried: the share is right within some 2 %.
const PLACES_ASKED: usize = 512;
/// Most points that are asked of one of them.
const POINTS_ASKED: usize = 8;
/// Above so many triangles nothing is taken for buried: a tree over them would take long, and much memory.
const SEARCHED_TRIANGLES_MAX: usize = 2_000_000;
/// Bytes that a place takes while places are found: a number in a table that has just grown, and in a list.
const PLACE_BYTES: u64 = 32;
/// Times the wanted patches that may be found, buried ones among them, before an edge counts as far too fine.
const EXCESS: f64 = 16.0;
/// Above so many places the excess shrinks: all counts of landscapes stay below some 60 MB, and below what a bake may
/// take ([`PatchCounter::within`]).
const PLACES_MAX: f64 = 1_800_000.0;
/// Down to this: slanted surfaces fill several voxels a face, and half of their sides may be buried.
const EXCESS_MIN: f64 = 4.0;
/// Places that a thread keeps before it hands them in: one triangle may cover a whole landscape.
const PLACES_KEPT: usize = 1 << 14;
/// Faces of voxels that surfaces would fill for each place that may be found: with more, nothing is cut to pieces.
const FACES_A_PLACE_MAX: f64 = 64.0;
/// Steps towards the edge that is wanted.
const STEPS: u32 = 8;
/// A count this near to the wanted one ends the search.
const NEAR_ENOUGH: f64 = 0.03;

/// An edge, and how many patches it makes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeGuess {
    /// m.
    pub voxel_edge_m: f32,
    /// `None` where it was only found that they are many more than wanted.
    pub patches: Option<PatchGuess>,
}

/// About how many patches there are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchGuess {
    /// In all.
    pub count: f64,
    /// In the chunk that has most.
    pub of_chunk_max: f64,
    /// Mean area that emits, in faces of a voxel, in a voxel and direction in which anything does; 0 where nothing does.
    pub lamp_faces: f64,
}

/// Counts the patches of a scene.
#[derive(Debug)]
pub struct PatchCounter<'a> {
    scene: &'a Scene,
    /// All but the voxel edge counts.
    parameters: &'a BakeParameters,
    memory: MemoryLimit,
    /// Built when it is first needed.
    tracer: OnceLock<SceneTracer<'a>>,
}

impl<'a> PatchCounter<'a> {
    /// Of `scene`, as `parameters` would bake it by area and axis.
    #[must_use]
    pub fn new(scene: &'a Scene, parameters: &'a BakeParameters) -> Self {
        Self { scene, parameters, memory: MemoryLimit::default(), tracer: OnceLock::new() }
    }

    /// The same with places and a tree that `memory` has room for. What is counted stays the same as long as it has: a bake of
    /// as many patches takes more.
    #[must_use]
    pub fn within(self, memory: MemoryLimit) -> Self {
        Self { memory, ..self }
    }

    /// The edge within `edges_m` at which there are nearest to `patches`, to three digits.
    ///
    /// Costs some passes over all triangles and, below two million of them, a tree; [`Self::within`] bounds what they take.
    /// Where it has no room for enough places to tell nothing is counted: the edge is that of both sides of all surfaces.
    #[must_use]
    pub fn edge_for(&self, patches: f64, edges_m: &RangeInclusive<f32>) -> EdgeGuess {
        let within = |edge: f64| edge.clamp(f64::from(*edges_m.start()), f64::from(*edges_m.end()));
        // Both sides of all surfaces, in squares. Never much finer: what is buried is not nearly all.
        let start = within((2.0 * self.scene.surface_area() / patches).sqrt());
        let finest = within(start / 4.0);
        let most = most_places(patches).min(self.places_that_fit());
        if most < EXCESS_MIN * patches {
            return EdgeGuess { voxel_edge_m: three_digits(start) as f32, patches: None };
        }
        let mut edge = start;
        for _ in 0..STEPS {
            let factor = match self.patches_at(edge as f32, most) {
                None => (most / patches).sqrt(),
                // Surfaces: patches go with the square of the edge.
                Some(found) => (found.count / patches).sqrt(),
            };
            let next = within(edge * factor).max(finest);
            let is_near = (next / edge - 1.0).abs() < NEAR_ENOUGH / 2.0;
            edge = next;
            if is_near {
                break;
            }
        }
        let voxel_edge_m = three_digits(edge) as f32;
        EdgeGuess { voxel_edge_m, patches: self.patches_at(voxel_edge_m, most) }
    }

    /// Places that there is room for beside the scene and its tree.
    fn places_that_fit(&self) -> f64 {
        let room = |limit: u64| limit.saturating_sub(of_trees(self.scene, self.trees())) / PLACE_BYTES;
        self.memory.0.map_or(f64::INFINITY, |limit| room(limit) as f64)
    }

    /// About how many patches a voxel edge of `edge_m` makes; `None` for more than `most`, buried ones among them, or more than
    /// there is room for.
    #[must_use]
    pub fn patches_at(&self, edge_m: f32, most: f64) -> Option<PatchGuess> {
        let most = most.min(self.places_that_fit());
        let grid = Grid { voxel_edge_m: edge_m, ..self.parameters.grid };
        // Not by the bake's seed: its edge would hang on it.
        let parameters = BakeParameters { grid, detail: 1, seed: 0, ..*self.parameters };
        let places = self.places(edge_m, most as usize)?;
        let mut by_chunk: HashMap<ChunkCoord, usize> = HashMap::new();
        for &place in &places {
            *by_chunk.entry(grid.chunk_of(voxel_of_key(place))).or_default() += 1;
        }
        let lamps = places.iter().filter(|&&place| is_apart(place)).count();
        let lamp_faces = self.emitting_area() / (lamps.max(1) as f64 * f64::from(edge_m).powi(2));
        let (count, of_chunk_max) = (places.len(), by_chunk.into_values().max().unwrap_or(0));
        // What is buried is taken to be so everywhere.
        let exposed = self.exposed_share(places, &parameters);
        Some(PatchGuess {
            count: count as f64 * exposed,
            of_chunk_max: of_chunk_max as f64 * exposed,
            lamp_faces,
        })
    }

    /// Area of all sides that emit, m2.
    fn emitting_area(&self) -> f64 {
        let Scene { triangles, materials, material_of, .. } = self.scene;
        let area = |(&[a, b, c], &of): (&[Vec3; 3], &u32)| {
            let material = &materials[of as usize];
            let sides = if material.double_sided { 2.0 } else { 1.0 };
            let area = 0.5 * f64::from((b - a).cross(c - a).length());
            if material.emits() { sides * area } else { 0.0 }
        };
        triangles.iter().zip(material_of).map(area).sum()
    }

    /// Every direction that something faces in a voxel of `edge_m`, ascending; `None` for more than `most`.
    fn places(&self, edge_m: f32, most: usize) -> Option<Vec<u64>> {
        let faces = 2.0 * self.scene.surface_area() / f64::from(edge_m).powi(2);
        if faces > FACES_A_PLACE_MAX * most as f64 {
            return None;
        }
        let found = Mutex::new(HashSet::<u64>::new());
        // Beyond too many none is kept.
        let hand_in = |own: &mut HashSet<u64>| {
            let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
            if found.len() <= most {
                found.extend(own.drain());
            }
            own.clear();
            found.len() <= most
        };
        let triangles = self.scene.triangles.len();
        let batches = (0..triangles.div_ceil(BATCH)).into_par_iter();
        batches.try_for_each(|batch| {
            let mut own = HashSet::new();
            for triangle in batch * BATCH..((batch + 1) * BATCH).min(triangles) {
                self.places_of(triangle, edge_m, |place| {
                    own.insert(place);
                    if own.len() >= PLACES_KEPT {
                        hand_in(&mut own);
                    }
                });
            }
            hand_in(&mut own).then_some(())
        })?;
        let found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut places: Vec<u64> = found.into_iter().collect();
        places.sort_unstable();
        Some(places)
    }

    fn places_of(&self, triangle: usize, edge_m: f32, mut each: impl FnMut(u64)) {
        let material = &self.scene.materials[self.scene.material_of[triangle] as usize];
        let normal = self.scene.normal(triangle);
        let sides: &[f32] =
            if self.parameters.two_sided || material.double_sided { &[1.0, -1.0] } else { &[1.0] };
        for &side in sides {
            let side_normal = normal * side;
            let apart = self.apart(triangle, side > 0.0);
            let shifted =
                self.scene.triangles[triangle].map(|corner| corner + side_normal * (OFF_SURFACE * edge_m));
            let faced = side_weights(self.parameters.weights, side_normal);
            clip_to_grid(shifted, edge_m, |voxel, _| {
                for (direction, _) in faced.iter().filter(|(_, weight)| *weight > 0.0) {
                    each(patch_key(voxel, direction.index() + apart));
                }
            });
        }
    }

    /// What ordinals of a side of `triangle` grow by: what emits is a patch of its own. By its material alone: a place knows no
    /// texels, and its points must be found under its key however dark a texture is there.
    fn apart(&self, triangle: usize, front: bool) -> usize {
        let material = &self.scene.materials[self.scene.material_of[triangle] as usize];
        let emits = material.emits() && (front || material.double_sided);
        if emits { usize::from(EMITTER_ORDINALS) } else { 0 }
    }

    /// Share of `places` that have a point which is not buried, nor a hole.
    fn exposed_share(&self, places: Vec<u64>, parameters: &BakeParameters) -> f64 {
        let is_searched = parameters.buried_rays > 0 && self.scene.triangles.len() <= SEARCHED_TRIANGLES_MAX;
        if !is_searched || places.is_empty() {
            return 1.0;
        }
        let tracer = self.tracer();
        let asked = drawn(places, parameters.seed);
        let points = self.points_in(&asked, parameters);
        let builder = Builder { tracer, parameters };
        let exposed: usize = points
            .into_par_iter()
            .map(|(_, points)| {
                let test = builder.exposure_test(tracer.into());
                usize::from(points.iter().any(|point| test.of(point) != Exposure::Buried))
            })
            .sum();
        exposed as f64 / asked.len() as f64
    }

    fn tracer(&self) -> &SceneTracer<'a> {
        self.tracer.get_or_init(|| match self.trees() {
            Trees::One => SceneTracer::new(self.scene),
            Trees::OfMeshes => SceneTracer::of_meshes(self.scene),
        })
    }

    /// Those that fit beside all places that may be counted, or the smaller ones.
    fn trees(&self) -> Trees {
        let of_places = PLACES_MAX as u64 * PLACE_BYTES;
        let beside = MemoryLimit(self.memory.0.map(|limit| limit.saturating_sub(of_places)));
        beside.trees_alone(self.scene).unwrap_or(Trees::OfMeshes)
    }

    /// Some points of each of the `asked` places.
    fn points_in(&self, asked: &HashSet<u64>, parameters: &BakeParameters) -> Vec<(u64, Vec<SurfaceSample>)> {
        let triangles = self.scene.triangles.len();
        let found: Vec<Vec<(u64, SurfaceSample)>> = (0..triangles.div_ceil(BATCH))
            .into_par_iter()
            .map(|batch| {
                let mut found = Vec::new();
                for triangle in batch * BATCH..((batch + 1) * BATCH).min(triangles) {
                    sample_triangle(self.scene, triangle, parameters, EVERYWHERE, |sample| {
                        let faced = side_weights(parameters.weights, sample.normal);
                        let faced = faced.iter().filter(|(_, weight)| *weight > 0.0);
                        let apart = self.apart(triangle, sample.side == side_of(triangle, true));
                        let of_sample = faced.map(|(way, _)| patch_key(sample.voxel, way.index() + apart));
                        found.extend(of_sample.filter(|key| asked.contains(key)).map(|key| (key, sample)));
                    });
                }
                found
            })
            .collect();
        let mut by_place: BTreeMap<u64, Vec<SurfaceSample>> = BTreeMap::new();
        for (key, sample) in found.into_iter().flatten() {
            by_place.entry(key).or_default().push(sample);
        }
        let spread = |points: Vec<SurfaceSample>| {
            let step = points.len().div_ceil(POINTS_ASKED);
            points.into_iter().step_by(step).collect()
        };
        by_place.into_iter().map(|(key, points)| (key, spread(points))).collect()
    }
}

/// Most places that are counted on the way to so many patches.
fn most_places(patches: f64) -> f64 {
    (EXCESS * patches).min(PLACES_MAX).max(EXCESS_MIN * patches)
}

/// Some of `places`, drawn by `seed`.
fn drawn(mut places: Vec<u64>, seed: u64) -> HashSet<u64> {
    if places.len() > PLACES_ASKED {
        // In place: there may be millions.
        let order = |&key: &u64| (hash(seed, Purpose::BuriedTest, key, 0), key);
        places.select_nth_unstable_by_key(PLACES_ASKED, order);
        places.truncate(PLACES_ASKED);
    }
    places.into_iter().collect()
}

/// `edge` to three significant digits: within 0.5 %, which is 1 % of patches.
fn three_digits(edge: f64) -> f64 {
    let unit = 10f64.powf(edge.log10().floor() - 2.0);
    (edge / unit).round() * unit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::{boxed, quad, scene_of};
    use earthshine_scene::{Texture, Wrap};
    use earthshine_world::Rgb;

    /// Goal: a texture that leaves a lamp dark does not bury it. Method: a room's floor with and without such a lamp's material,
    /// at an edge at which all places are asked.
    #[test]
    fn what_a_texture_leaves_dark_is_counted_as_what_does_not_emit() {
        let plain = scene_of(quad(Vec3::splat(-4.0), Vec3::Z * 8.0, Vec3::X * 8.0).to_vec());
        let mut dark = plain.clone();
        let texture = Texture {
            width: 1,
            height: 1,
            texels: vec![[0, 0, 0, 255]],
            wrap: [Wrap::Repeat; 2],
            nearest: true,
            transform: Texture::IDENTITY,
        };
        dark.textures.push(texture);
        dark.materials[0].emitted_radiance = Rgb::ONE;
        dark.materials[0].emissive_texture = Some(0);
        let parameters = BakeParameters { two_sided: false, ..BakeParameters::default() };
        let counted = |scene: &Scene| {
            PatchCounter::new(scene, &parameters).patches_at(1.0, 1e6).expect("few patches").count
        };
        assert!(counted(&plain) > 60.0, "{}", counted(&plain));
        assert_eq!(counted(&dark), counted(&plain));
    }

    #[test]
    fn large_triangles_are_counted_in_pieces_up_to_the_limit() {
        let scene = scene_of(quad(Vec3::ZERO, Vec3::Z * 200.0, Vec3::X * 200.0).to_vec());
        let parameters = BakeParameters { two_sided: false, ..BakeParameters::default() };
        let counter = PatchCounter::new(&scene, &parameters);
        let places = counter.places(1.0, 100_000).expect("fewer places").len();
        assert!((39_900..41_000).contains(&places), "{places}");
        assert_eq!(counter.places(1.0, places).map(|found| found.len()), Some(places));
        assert_eq!(counter.places(1.0, places - 1), None);
    }

    #[test]
    fn many_patches_leave_room_for_less_excess() {
        let most = [13_000.0, 400_000.0, 1e9].map(most_places);
        assert_eq!(most, [208_000.0, 1_800_000.0, 4e9]);
    }

    /// Goal: counting takes no more memory than a bake may, and comes to the same where it has enough. Method: a floor and the
    /// inside of a box, which is buried, with room for a smaller tree, for a place less than there are, and for nothing.
    #[test]
    fn a_limit_leaves_the_count_as_it_is_or_there_is_none() {
        let floor = quad(Vec3::splat(-4.0), Vec3::Z * 8.0, Vec3::X * 8.0);
        let inside = boxed(Vec3::splat(-2.0), Vec3::splat(2.0)).triangles;
        let scene = scene_of([&floor[..], &inside].concat());
        let parameters = BakeParameters::default();
        let counter = |memory| PatchCounter::new(&scene, &parameters).within(MemoryLimit(memory));
        let counted = |memory| counter(memory).patches_at(0.5, 1e6).map(|guess| guess.count);
        let free = counted(None).expect("few patches");
        let places = counter(None).places(0.5, 1_000_000).expect("few places").len();
        assert!(free < 0.9 * places as f64, "{free} of {places}");
        let with_room = |places: usize| Some(of_trees(&scene, Trees::OfMeshes) + places as u64 * PLACE_BYTES);
        assert_eq!(counted(with_room(places)), Some(free));
        assert_eq!(counted(with_room(places - 1)), None);
        assert_eq!(counted(Some(1)), None);
        // An edge for as many as a bake has no memory for either is not searched for.
        let wanted = |memory| counter(memory).edge_for(1e3, &(0.1..=4.0));
        assert_eq!(wanted(with_room(16_000)), wanted(None));
        assert_eq!(wanted(Some(1)).patches, None);
    }
}
