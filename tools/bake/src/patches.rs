//! Samples to patches: what faces one direction in one voxel, or what one cluster holds.

use crate::apart::{CHUNK_EDGE_MAX, Contribution, Emitters, SortKey, is_apart, is_apart_ordinal, part};
use crate::buried::{BuriedPiece, BuriedPieces};
use crate::clusters::ClusterOf;
use crate::exposure::Exposure;
use crate::hidden::{HiddenPlaces, PieceSample};
use crate::layers::LayersOfSample;
use crate::places::{AxisPlaces, ClusterPlaces, Owners, Place, Places};
use crate::rows::patch_key;
use crate::sample::{SurfaceSample, side_weights};
use earthshine_tiles::BakeParameters;
use earthshine_world::random::{Purpose, hash, unit_f32};
use earthshine_world::{ChunkCoord, Direction, Grid, Patch, Rgb, Vec3, VoxelCoord};
use std::collections::BTreeMap;

/// Patches below this share of a voxel's face that do not emit are left out: slivers where geometry grazes a
/// voxel would be noise to every lookup. What hits them is booked as absorbed.
const AREA_MIN: f32 = 1e-4;

/// Ordinals below it are of directions or of clusters; layers count in steps of it.
pub(crate) const LAYER_ORDINALS: u8 = 16;

/// A patch with everything the bake needs to know of it.
#[derive(Debug, Clone)]
pub struct BakePatch {
    /// As it goes into the tile; its points are numbered when the chunk is emitted.
    pub patch: Patch,
    /// What its random numbers hang on: see [`patch_key`].
    pub key: u64,
    /// Samples it consists of, with weight `w_a * s_p`, cumulated: the last is the patch's area.
    pub samples: Vec<(u32, f32)>,
}

/// All patches of a world, chunk by chunk.
#[derive(Debug)]
pub struct PatchSet {
    /// Ordered by chunk, then direction, then Morton code.
    pub patches: Vec<BakePatch>,
    /// Which run of [`Self::patches`] each chunk owns, ascending.
    pub chunks: BTreeMap<[i32; 3], std::ops::Range<u32>>,
    places: Places,
    hidden: HiddenPlaces,
    buried: BuriedPieces,
}

impl PatchSet {
    /// No patch here.
    pub const NONE: u32 = u32::MAX;

    /// The axis-aligned patches of `voxel` by direction, those of what does not emit where there are two; clusters are not
    /// found by direction.
    #[must_use]
    pub fn of_voxel(&self, voxel: VoxelCoord) -> [u32; 6] {
        self.places.of_voxel(voxel)
    }

    /// Whose `place` is, with the share of each; [`Self::NONE`] where there is no patch. `None` for a place that its
    /// voxel's patches left out, and on a buried piece.
    #[must_use]
    pub fn owners(&self, place: &Place) -> Option<Owners> {
        let is_buried = self.buried.contains(place.side, place.voxel);
        if is_buried || self.hidden.contains(place.side, place.voxel, place.position) {
            return None;
        }
        Some(self.places.owners(place))
    }

    /// Where hits find no patch.
    #[must_use]
    pub fn hidden(&self) -> &HiddenPlaces {
        &self.hidden
    }

    /// Where hits find no patch because nobody is there.
    #[must_use]
    pub fn buried(&self) -> &BuriedPieces {
        &self.buried
    }

    /// The same patches, whose hits on `pieces` are absorbed.
    #[must_use]
    pub fn with_buried(self, pieces: Vec<BuriedPiece>) -> Self {
        Self { buried: BuriedPieces::new(pieces), ..self }
    }

    /// All axis-aligned patches of a world, from those of its chunks in ascending order. Their samples are let go.
    #[must_use]
    pub fn assemble(
        chunks: impl Iterator<Item = ([i32; 3], Vec<BakePatch>, Vec<PieceSample>)>,
        parameters: &BakeParameters,
    ) -> Self {
        let mut places = AxisPlaces::new(parameters.weights);
        let (mut patches, mut ranges) = (Vec::new(), BTreeMap::new());
        let mut hidden = HiddenPlaces::default();
        for (coord, own, pieces) in chunks {
            let first = patches.len() as u32;
            for BakePatch { patch, key, .. } in own {
                places.add(patch.voxel, patch.direction, is_apart(key), patches.len() as u32);
                patches.push(BakePatch { patch, key, samples: Vec::new() });
            }
            if patches.len() as u32 > first {
                ranges.insert(coord, first..patches.len() as u32);
            }
            pieces.into_iter().for_each(|piece| hidden.add(piece));
        }
        let places = Places::Axis(places);
        Self { patches, chunks: ranges, places, hidden, buried: BuriedPieces::default() }
    }

    /// The same without samples; places and all else that rays ask for stay.
    #[must_use]
    pub(crate) fn without_samples(&self) -> Self {
        let bare = |source: &BakePatch| BakePatch { samples: Vec::new(), ..*source };
        Self {
            patches: self.patches.iter().map(bare).collect(),
            chunks: self.chunks.clone(),
            places: self.places.clone(),
            hidden: self.hidden.clone(),
            buried: self.buried.clone(),
        }
    }

    /// A number of patch `index` within its chunk that does not change when others come or go; for clusters, which
    /// have no place of their own, its number.
    #[must_use]
    pub fn stable_id(&self, index: u32, grid: &Grid) -> u16 {
        let patch = &self.patches[index as usize].patch;
        let chunk = grid.chunk_of(patch.voxel);
        match &self.places {
            Places::Clusters(_) => (index - self.chunks[&chunk.to_array()].start) as u16,
            Places::Axis(_) => {
                let edge = grid.chunk_edge_voxels.cast_signed();
                let at = patch.voxel - chunk * edge;
                let emitters = if is_apart(self.patches[index as usize].key) { edge.pow(3) * 6 } else { 0 };
                (emitters + ((at.x * edge + at.y) * edge + at.z) * 6) as u16 + patch.direction.index() as u16
            }
        }
    }

    /// The patch of `chunk` with that [`Self::stable_id`], if there is one.
    #[must_use]
    pub fn by_stable_id(&self, chunk: [i32; 3], id: u16, grid: &Grid) -> Option<u32> {
        match &self.places {
            Places::Clusters(_) => {
                let range = self.chunks.get(&chunk)?;
                Some(range.start + u32::from(id)).filter(|index| range.contains(index))
            }
            Places::Axis(places) => {
                let edge = grid.chunk_edge_voxels.cast_signed();
                let (voxel, direction) = (i32::from(id) / 6, usize::from(id) % 6);
                let (is_emitter, voxel) = (voxel / edge.pow(3) > 0, voxel % edge.pow(3));
                let at = VoxelCoord::new(voxel / (edge * edge), voxel / edge % edge, voxel % edge);
                let at = VoxelCoord::from_array(chunk) * edge + at;
                let found = if is_emitter { places.emitters(at) } else { places.of_voxel(at) };
                (found[direction] != Self::NONE).then_some(found[direction])
            }
        }
    }

    /// Number of patches.
    #[must_use]
    pub fn len(&self) -> usize {
        self.patches.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.patches.is_empty()
    }

    /// Groups `samples` into axis-aligned patches: what emits in a voxel and direction apart from what does not.
    #[must_use]
    pub fn group(samples: &[SurfaceSample], parameters: &BakeParameters) -> Self {
        let has_numbers = parameters.grid.chunk_edge_voxels <= CHUNK_EDGE_MAX;
        let emitters = if has_numbers { Emitters::Apart } else { Emitters::Mixed };
        Self::of_sides(samples, |_, _| 0, parameters, emitters)
    }

    /// One patch a voxel, direction and layer.
    fn of_sides(
        samples: &[SurfaceSample],
        layer: impl Fn(usize, Direction) -> u8,
        parameters: &BakeParameters,
        emitters: Emitters,
    ) -> Self {
        let grid = parameters.grid;
        let mut contributions: Vec<Contribution> = Vec::with_capacity(samples.len());
        for (index, sample) in samples.iter().enumerate() {
            if sample.exposure == Exposure::Buried {
                continue;
            }
            for (direction, weight) in side_weights(parameters.weights, sample.normal) {
                if weight > 0.0 {
                    let ordinal = direction as u8 + layer(index, direction) * LAYER_ORDINALS;
                    contributions.push(Contribution {
                        key: sort_key(&grid, sample.voxel, direction, ordinal),
                        sample: index as u32,
                        weight: weight * sample.area,
                    });
                }
            }
        }
        let places = Places::Axis(AxisPlaces::new(parameters.weights));
        Self::from_contributions(contributions, samples, &grid, places, emitters)
    }

    /// Groups `samples` by voxel, direction and layer; `layers` says which one each belongs to on each direction.
    pub(crate) fn of_layers(
        samples: &[SurfaceSample],
        layers: &[LayersOfSample],
        parameters: &BakeParameters,
    ) -> Self {
        Self::of_sides(
            samples,
            |sample, direction| layers[sample][direction.index()],
            parameters,
            Emitters::LeftOut,
        )
    }

    /// Makes one patch of each cluster; `clusters` says which one each of `samples` belongs to.
    #[must_use]
    pub fn of_clusters(
        samples: &[SurfaceSample],
        clusters: &[Option<ClusterOf>],
        parameters: &BakeParameters,
    ) -> Self {
        let grid = parameters.grid;
        let contributions = samples
            .iter()
            .zip(clusters)
            .enumerate()
            .filter_map(|(index, (sample, cluster))| {
                let ClusterOf { ordinal, direction } = (*cluster)?;
                let key = sort_key(&grid, sample.voxel, direction, ordinal);
                Some(Contribution { key, sample: index as u32, weight: sample.area })
            })
            .collect();
        Self::from_contributions(
            contributions,
            samples,
            &grid,
            Places::Clusters(ClusterPlaces::default()),
            Emitters::Mixed,
        )
    }

    fn from_contributions(
        mut contributions: Vec<Contribution>,
        samples: &[SurfaceSample],
        grid: &Grid,
        places: Places,
        emitters: Emitters,
    ) -> Self {
        contributions.sort_by_key(|c| (c.key, c.sample));
        let mut set = Self {
            patches: Vec::new(),
            chunks: BTreeMap::new(),
            places,
            hidden: HiddenPlaces::default(),
            buried: BuriedPieces::default(),
        };
        part(&mut contributions, samples, emitters, area_min(grid));
        for run in contributions.chunk_by(|a, b| a.key == b.key) {
            set.push(run, samples, grid, emitters);
        }
        let is_left_out: Vec<bool> = samples.iter().map(|sample| set.outshines(sample)).collect();
        set.hidden = HiddenPlaces::collect(samples, &is_left_out);
        set
    }

    /// Whether `sample` lies behind a patch that glows as it does not itself.
    fn outshines(&self, sample: &SurfaceSample) -> bool {
        if matches!(sample.exposure, Exposure::Open(_)) {
            return false;
        }
        let lamp = Place { emits: true, ..sample.place() };
        self.places.owners(&lamp).iter().any(|&(patch, weight)| {
            weight > 0.0
                && patch != Self::NONE
                && self.patches[patch as usize].patch.emission.max_element()
                    > 2.0 * sample.emission.max_element()
        })
    }

    fn push(&mut self, run: &[Contribution], samples: &[SurfaceSample], grid: &Grid, emitters: Emitters) {
        let (_, direction, _, ordinal) = run[0].key;
        let voxel = samples[run[0].sample as usize].voxel;
        let merged =
            merge(exposed(run, samples, emitters), samples, voxel, key_of(voxel, ordinal), direction);
        let is_sliver = merged.patch.area < area_min(grid) && merged.patch.emission == Rgb::ZERO;
        let index = if is_sliver { Self::NONE } else { self.patches.len() as u32 };
        match &mut self.places {
            Places::Axis(places) if !is_sliver => {
                places.add(voxel, direction, is_apart_ordinal(ordinal), index);
            }
            Places::Axis(_) => {}
            Places::Clusters(places) => {
                let members = || run.iter().map(|contribution| &samples[contribution.sample as usize]);
                let normal = members().map(|sample| sample.normal * sample.area).sum::<Vec3>();
                members().for_each(|sample| places.add(&sample.place(), index, normal.normalize_or(Vec3::Y)));
            }
        }
        if !is_sliver {
            let chunk = grid.chunk_of(voxel).to_array();
            let range = self.chunks.entry(chunk).or_insert(index..index);
            range.end = index + 1;
            self.patches.push(merged);
        }
    }
}

/// [`AREA_MIN`] of a face of the voxels of `grid`, m2.
fn area_min(grid: &Grid) -> f32 {
    AREA_MIN * (grid.voxel_edge_m * grid.voxel_edge_m)
}

fn sort_key(grid: &Grid, voxel: VoxelCoord, direction: Direction, ordinal: u8) -> SortKey {
    let chunk: ChunkCoord = grid.chunk_of(voxel);
    let local = voxel - chunk * grid.chunk_edge_voxels.cast_signed();
    (chunk.to_array(), direction, morton(local.to_array()), ordinal)
}

/// What random numbers of a patch hang on: with layers, what those of the patch without them do, and the layer.
fn key_of(voxel: VoxelCoord, ordinal: u8) -> u64 {
    let layer = u64::from(ordinal / LAYER_ORDINALS);
    patch_key(voxel, usize::from(ordinal % LAYER_ORDINALS)) ^ layer.wrapping_mul(0x9E37_79B9_7F4A_7C15)
}

/// Interleaves the low ten bits of three numbers.
pub(crate) fn morton(local: [i32; 3]) -> u32 {
    let spread = |value: i32| (0..10).fold(0u32, |code, bit| code | ((value as u32 >> bit & 1) << (3 * bit)));
    spread(local[0]) | spread(local[1]) << 1 | spread(local[2]) << 2
}

/// Open samples where there are any, else all; and all that emit, where they send light: a hidden part of a lamp does too.
fn exposed<'r>(
    run: &'r [Contribution],
    samples: &'r [SurfaceSample],
    emitters: Emitters,
) -> impl Iterator<Item = &'r Contribution> + Clone + 'r {
    let is_hidden = move |contribution: &Contribution| {
        let sample = &samples[contribution.sample as usize];
        let sends = emitters != Emitters::LeftOut && sample.emission != Rgb::ZERO;
        matches!(sample.exposure, Exposure::Hidden(_)) && !sends
    };
    let all = run.iter().all(is_hidden);
    run.iter().filter(move |contribution| all || !is_hidden(contribution))
}

fn merge<'r>(
    run: impl Iterator<Item = &'r Contribution> + Clone,
    samples: &[SurfaceSample],
    voxel: VoxelCoord,
    key: u64,
    direction: Direction,
) -> BakePatch {
    let (mut area, mut seen) = (0.0f64, 0.0f64);
    let mut centroid = glam::DVec3::ZERO;
    let (mut reflectance, mut emission) = (glam::DVec3::ZERO, glam::DVec3::ZERO);
    let mut cumulated = Vec::new();
    let is_open = |of: &Contribution| matches!(samples[of.sample as usize].exposure, Exposure::Open(_));
    let is_any_open = run.clone().any(is_open);
    for contribution in run {
        let sample = &samples[contribution.sample as usize];
        let weight = f64::from(contribution.weight);
        area += weight;
        cumulated.push((contribution.sample, area as f32));
        // Exitance is what others see of the patch: open places count more, and hidden ones of a lamp less than any of them. A
        // patch of nothing but hidden ones counts all alike.
        let openness = match sample.exposure {
            Exposure::Open(openness) => openness,
            Exposure::Hidden(openness) if is_any_open => openness,
            Exposure::Hidden(_) | Exposure::Buried => 1.0,
        };
        let seen_weight = weight * f64::from(openness);
        seen += seen_weight;
        centroid += sample.position.as_dvec3() * seen_weight;
        reflectance += sample.reflectance.as_dvec3() * seen_weight;
        emission += sample.emission.as_dvec3() * seen_weight;
    }
    let mean = |sum: glam::DVec3| -> Vec3 { (sum / seen).as_vec3() };
    BakePatch {
        patch: Patch {
            voxel,
            direction,
            area: area as f32,
            centroid: mean(centroid),
            reflectance: mean(reflectance).clamp(Rgb::ZERO, Rgb::splat(Patch::REFLECTANCE_MAX)),
            emission: mean(emission),
            point_first: 0,
            point_count: 0,
        },
        key,
        samples: cumulated,
    }
}

impl BakePatch {
    /// The sample under the share `at` (0..1) of the patch's area.
    #[must_use]
    pub fn sample_at(&self, at: f32) -> u32 {
        let target = at * self.patch.area;
        let index = self.samples.partition_point(|&(_, cumulated)| cumulated <= target);
        self.samples[index.min(self.samples.len() - 1)].0
    }

    /// At most `count` samples that stand for equal shares of the patch, for direct light.
    #[must_use]
    pub fn representative_samples(&self, count: u32, seed: u64) -> Vec<u32> {
        let count = (count.max(1) as usize).min(self.samples.len());
        let shift = unit_f32(hash(seed, Purpose::PointChoice, self.key, 0));
        (0..count).map(|i| self.sample_at((i as f32 + shift) / count as f32)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::point;

    fn sample(position: Vec3, normal: Vec3, area: f32) -> SurfaceSample {
        let reflectance = Rgb::splat(0.5);
        SurfaceSample { area, reflectance, ..point(position, normal, position.floor().as_ivec3()) }
    }

    #[test]
    fn slanted_surfaces_become_patches_whose_areas_add_up() {
        let normal = Vec3::new(1.0, 2.0, -2.0) / 3.0;
        let samples = [sample(Vec3::splat(0.25), normal, 2.0), sample(Vec3::splat(0.75), normal, 1.0)];
        let set = PatchSet::group(&samples, &BakeParameters::default());
        assert_eq!(set.len(), 3);
        let total: f32 = set.patches.iter().map(|p| p.patch.area).sum();
        assert!((total - 3.0).abs() < 1e-5);
        let of_voxel = set.of_voxel(VoxelCoord::ZERO);
        assert_eq!(of_voxel.iter().filter(|&&p| p != PatchSet::NONE).count(), 3);
        assert_ne!(of_voxel[Direction::NegZ.index()], PatchSet::NONE);
        assert_eq!(set.patches[0].sample_at(0.1), 0);
        assert_eq!(set.patches[0].sample_at(0.9), 1);
    }

    /// Goal: a place keeps a patch that is told, whatever little of it does not emit. Method: a flame beside a wall that is
    /// just enough for a patch, and beside a sliver.
    #[test]
    fn what_emits_is_apart_only_from_what_gets_a_patch() {
        let parameters = BakeParameters {
            grid: Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 16 },
            ..BakeParameters::default()
        };
        let flame = SurfaceSample { emission: Rgb::ONE, ..sample(Vec3::splat(0.25), Vec3::Y, 0.01) };
        for (rest, count) in [(2.0 * AREA_MIN, 2), (0.5 * AREA_MIN, 1)] {
            let samples = [flame, sample(Vec3::splat(0.75), Vec3::Y, rest)];
            let set = PatchSet::group(&samples, &parameters);
            assert_eq!(set.len(), count, "beside {rest} m2");
            let told = set.of_voxel(VoxelCoord::ZERO)[Direction::PosY.index()];
            assert_ne!(told, PatchSet::NONE, "beside {rest} m2");
            assert_eq!(set.patches[told as usize].patch.emits(), count == 1, "beside {rest} m2");
            // The same of layers, which leave out what is apart.
            let layered = PatchSet::of_layers(&samples, &[[0; 6]; 2], &parameters);
            assert_eq!(layered.len(), 1, "beside {rest} m2");
        }
    }

    /// Goal: a lamp sends as much light far off as its points that lie open do. Method: a lamp whose texture varies between
    /// points that are hidden and points that half see out; what goes far of each is its emission times its openness.
    #[test]
    fn what_a_lamp_sends_is_what_gets_out_of_it() {
        let parameters = BakeParameters {
            grid: Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 16 },
            ..BakeParameters::default()
        };
        let place = |emission: f32, exposure: Exposure| SurfaceSample {
            emission: Rgb::splat(emission),
            exposure,
            ..sample(Vec3::splat(0.25), Vec3::Y, 0.1)
        };
        let emission =
            |samples: &[SurfaceSample]| PatchSet::group(samples, &parameters).patches[0].patch.emission.x;
        let half_open = place(1.0, Exposure::Open(0.5));
        let bright = emission(&[half_open, place(9.0, Exposure::Hidden(0.25))]);
        assert!((bright - (0.5 * 1.0 + 0.25 * 9.0) / 0.75).abs() < 1e-5, "{bright}");
        assert_eq!(emission(&[half_open, place(9.0, Exposure::Hidden(0.0))]), 1.0);
        // Where all is hidden something must stand for it.
        let hidden = [1.0, 9.0].map(|light| place(light, Exposure::Hidden(0.0)));
        assert_eq!(emission(&hidden), 5.0);
    }

    #[test]
    fn morton_codes_interleave() {
        assert_eq!(morton([1, 0, 0]), 1);
        assert_eq!(morton([0, 1, 0]), 2);
        assert_eq!(morton([3, 0, 1]), 0b001_101);
    }
}
