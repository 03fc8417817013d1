//! Layers: which samples in a detail voxel lie in one plane.
//!
//! Moulding and the wall behind it may share a detail voxel and a direction and see quite different things; one value for
//! both would be right for neither. So what faces one direction in a detail voxel is clustered by plane: at most
//! [`DetailVoxel::LAYERS_MAX`] clusters, fewer where planes are much alike. Both sides of a wall are clusters of their own
//! ([`crate::barriers`]); nothing else here asks what the layers see. Start at [`layers_of`].

use crate::barriers::{Barriers, Sides};
use crate::exposure::Exposure;
use crate::eye::Eye;
use crate::sample::{SurfaceSample, side_weights};
use crate::walls::WallTest;
use earthshine_tiles::BakeParameters;
use earthshine_world::{DetailVoxel, Direction, Vec3, VoxelCoord};
use rayon::prelude::*;
use std::cell::Cell;
use std::collections::BTreeMap;

/// Planes whose normals differ by this, as the sine of half the angle, differ by one.
const ANGLE_SCALE: f32 = 0.12;
/// Planes that are this far apart, in detail voxel edges, differ by one.
const DISTANCE_SCALE: f32 = 0.1;
/// Clusters that differ by less are one, whatever their area.
const DIFFERENCE_MIN: f32 = 1.0;
/// Samples whose planes differ by less are one from the start.
const SAME_PLANE: f32 = 0.2;
/// Clusters that samples are first put in, at most; merging costs their square.
const FIRST_MAX: usize = 24;
/// Parts that are cut together.
const BATCH: usize = 64;
/// Clusters of less than this share of a detail voxel's face join another.
pub(crate) const AREA_SHARE_MIN: f32 = 0.01;

/// Of a sample: its layer by direction. 0 where it does not face.
pub(crate) type LayersOfSample = [u8; 6];

/// The layers of a chunk.
#[derive(Debug, Default)]
pub(crate) struct Layers {
    /// Of each sample.
    pub(crate) of_samples: Vec<LayersOfSample>,
    /// What ends a layer, by detail voxel, direction and layer, where anything does.
    barriers: BTreeMap<([i32; 3], Direction, u8), Barriers>,
    /// Rays cast to find walls.
    pub(crate) rays: u64,
}

impl Layers {
    /// What ends `layer` of what faces `direction` in `voxel`.
    pub(crate) fn barriers(&self, voxel: VoxelCoord, direction: Direction, layer: u8) -> Barriers {
        self.barriers.get(&(voxel.to_array(), direction, layer)).copied().unwrap_or_default()
    }
}

/// A plane and how much of it there is.
#[derive(Debug, Clone)]
pub(crate) struct Cluster {
    /// Sum of normals by area.
    normals: Vec3,
    /// Sum of places by area.
    places: Vec3,
    pub(crate) area: f32,
    /// Of it, what is neither hidden nor buried.
    open_area: f32,
    /// Samples, and how much of each faces the direction, m2.
    pub(crate) members: Vec<(u32, f32)>,
}

impl Cluster {
    /// Of `area` of sample `index`.
    pub(crate) fn new(index: u32, sample: &SurfaceSample, area: f32) -> Self {
        Self {
            normals: sample.normal * area,
            places: sample.position * area,
            area,
            open_area: if matches!(sample.exposure, Exposure::Open(_)) { area } else { 0.0 },
            members: vec![(index, area)],
        }
    }

    pub(crate) fn normal(&self) -> Vec3 {
        self.normals.normalize_or(Vec3::Y)
    }

    pub(crate) fn middle(&self) -> Vec3 {
        self.places / self.area
    }

    /// How different the planes of both are; places in detail voxel edges.
    fn difference(&self, other: &Self, edge_m: f32) -> f32 {
        let (own, theirs) = (self.normal(), other.normal());
        let way = (other.middle() - self.middle()) / edge_m;
        let apart = way.dot(own).abs().max(way.dot(theirs).abs());
        let turned = 0.5 * (own - theirs).length();
        (turned / ANGLE_SCALE).powi(2) + (apart / DISTANCE_SCALE).powi(2)
    }

    pub(crate) fn absorb(&mut self, other: &Self) {
        self.normals += other.normals;
        self.places += other.places;
        self.area += other.area;
        self.open_area += other.open_area;
        self.members.extend(&other.members);
    }
}

/// The layers of `samples`, whose voxels are detail voxels of `parameters`' grid, with walls as `tracer` sees them; the one
/// with the most open surface is 0.
pub(crate) fn layers_of(samples: &[SurfaceSample], parameters: &BakeParameters, tracer: Eye<'_>) -> Layers {
    let edge_m = parameters.grid.voxel_edge_m;
    let mut parts: BTreeMap<([i32; 3], Direction), Vec<Cluster>> = BTreeMap::new();
    for (index, sample) in samples.iter().enumerate() {
        if sample.exposure == Exposure::Buried {
            continue;
        }
        for (direction, weight) in side_weights(parameters.weights, sample.normal) {
            let area = weight * sample.area;
            if area > 0.0 {
                let voxel: VoxelCoord = sample.voxel;
                let cluster = Cluster::new(index as u32, sample, area);
                put(parts.entry((voxel.to_array(), direction)).or_default(), cluster, edge_m);
            }
        }
    }
    let sides = |((voxel, direction), mut clusters): (([i32; 3], Direction), Vec<Cluster>)| {
        merge(&mut clusters, edge_m);
        let test = WallTest { tracer, edge_m, seed: parameters.seed, cast: Cell::new(0) };
        let sides = Sides { test, samples, voxel: VoxelCoord::from_array(voxel), direction };
        let mut layers = sides.of(clusters);
        // What is hidden comes last: clients that read one layer read that of 0.
        layers.sort_by(|(a, _), (b, _)| b.open_area.total_cmp(&a.open_area).then(b.area.total_cmp(&a.area)));
        ((voxel, direction), layers, sides.test.cast.get())
    };
    let parts: Vec<_> = parts.into_iter().collect();
    let parted: Vec<_> = parts.into_par_iter().with_min_len(BATCH).map(sides).collect();
    let mut layers = Layers { of_samples: vec![[0; 6]; samples.len()], ..Layers::default() };
    for ((voxel, direction), parts, cast) in parted {
        layers.rays += cast;
        for (layer, (cluster, barriers)) in (0..).zip(&parts) {
            for &(member, _) in &cluster.members {
                layers.of_samples[member as usize][direction.index()] = layer;
            }
            if barriers[0].is_some() {
                layers.barriers.insert((voxel, direction, layer), *barriers);
            }
        }
    }
    layers
}

/// Puts one sample to what lies in its plane already, or to the most alike where there are many.
fn put(clusters: &mut Vec<Cluster>, sample: Cluster, edge_m: f32) {
    let are_many = clusters.len() >= FIRST_MAX;
    let alike = clusters
        .iter_mut()
        .map(|cluster| (cluster.difference(&sample, edge_m), cluster))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    match alike {
        Some((difference, cluster)) if are_many || difference < SAME_PLANE => cluster.absorb(&sample),
        _ => clusters.push(sample),
    }
}

/// Merges clusters until all that are left differ and there are few enough of them.
fn merge(clusters: &mut Vec<Cluster>, edge_m: f32) {
    let area_min = AREA_SHARE_MIN * edge_m * edge_m;
    while clusters.len() > 1 {
        let is_sliver = |cluster: &Cluster| cluster.area < area_min;
        let has_slivers = clusters.iter().any(is_sliver);
        let has_to_go = has_slivers || clusters.len() > usize::from(DetailVoxel::LAYERS_MAX);
        // Ward's criterion where some have to go, slivers first: what lies in few places counts little.
        let cost = |a: &Cluster, b: &Cluster| {
            let difference = a.difference(b, edge_m);
            if has_to_go { difference * a.area * b.area / (a.area + b.area) } else { difference }
        };
        let pairs = (1..clusters.len())
            .flat_map(|b| (0..b).map(move |a| (a, b)))
            .filter(|&(a, b)| !has_slivers || is_sliver(&clusters[a]) || is_sliver(&clusters[b]));
        let costs = pairs.map(|(a, b)| (cost(&clusters[a], &clusters[b]), a, b));
        let Some((least, a, b)) = costs.min_by(|one, other| one.0.total_cmp(&other.0)) else { return };
        if !has_to_go && least >= DIFFERENCE_MIN {
            return;
        }
        let gone = clusters.swap_remove(b);
        clusters[a].absorb(&gone);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::scene_of;
    use earthshine_trace::SceneTracer;
    use earthshine_world::{Grid, Rgb};

    /// Detail voxels of a metre.
    fn parameters() -> BakeParameters {
        BakeParameters {
            grid: Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 16 },
            ..BakeParameters::default()
        }
    }

    /// Samples of `area` m2 each at `places` with `normal`, all in the voxel at the origin.
    fn samples(normal: Vec3, area: f32, places: impl Iterator<Item = Vec3>) -> Vec<SurfaceSample> {
        places
            .map(|position| SurfaceSample {
                position,
                normal,
                side: 0,
                voxel: VoxelCoord::ZERO,
                area,
                reflectance: Rgb::ONE,
                emission: Rgb::ZERO,
                exposure: Exposure::Open(1.0),
                is_suspect: false,
            })
            .collect()
    }

    /// A square of 16 samples across the voxel that lies `x` from its low side.
    fn wall(x: f32) -> Vec<SurfaceSample> {
        let middle = |i: u32| (i as f32 + 0.5) / 4.0;
        samples(Vec3::X, 1.0 / 16.0, (0..16).map(move |i| Vec3::new(x, middle(i % 4), middle(i / 4))))
    }

    fn layers_facing(samples: &[SurfaceSample], direction: Direction) -> Vec<u8> {
        let nothing = scene_of(Vec::new());
        let layers = layers_of(samples, &parameters(), (&SceneTracer::new(&nothing)).into());
        layers.of_samples.iter().map(|layers| layers[direction.index()]).collect()
    }

    #[test]
    fn planes_are_told_apart_and_one_plane_is_one_layer() {
        assert_eq!(layers_facing(&wall(0.3), Direction::PosX), [0; 16]);
        let both = [wall(0.1), wall(0.5)].concat();
        let layers = layers_facing(&both, Direction::PosX);
        assert!(layers[..16].iter().all(|&layer| layer == layers[0]));
        assert!(layers[16..].iter().all(|&layer| layer == 1 - layers[0]));
        // Nearer than is worth a row.
        assert_eq!(layers_facing(&[wall(0.1), wall(0.15)].concat(), Direction::PosX), [0; 32]);
    }

    #[test]
    fn the_largest_is_first_and_slivers_join_another() {
        let small = samples(Vec3::X, 0.1, [Vec3::new(0.2, 0.5, 0.5)].into_iter());
        let layers = layers_facing(&[small, wall(0.8)].concat(), Direction::PosX);
        assert_eq!((layers[0], &layers[1..]), (1, &[0; 16][..]));
        let sliver = samples(Vec3::X, 0.5 * AREA_SHARE_MIN, [Vec3::new(0.2, 0.5, 0.5)].into_iter());
        assert_eq!(layers_facing(&[sliver, wall(0.8)].concat(), Direction::PosX), [0; 17]);
    }

    /// Goal: a sliver goes where it costs least and takes nobody along. Method: two planes that differ, and a scrap that is unlike
    /// both and costs more to join than they to merge.
    #[test]
    fn a_sliver_does_not_merge_planes_that_differ() {
        let at = |x: f32| samples(Vec3::X, 0.05, [Vec3::new(x, 0.5, 0.5)].into_iter());
        let turned = Vec3::new(1.0, 1.0, 0.0).normalize_or(Vec3::X);
        let scrap = samples(turned, 0.009, [Vec3::new(0.8, 0.8, 0.5)].into_iter());
        let layers = layers_facing(&[at(0.3), at(0.5), scrap].concat(), Direction::PosX);
        assert_ne!(layers[0], layers[1], "{layers:?}");
    }

    #[test]
    fn hidden_surfaces_come_after_open_ones() {
        let mut behind = wall(0.1);
        behind.iter_mut().for_each(|sample| sample.exposure = Exposure::Hidden(0.25));
        let panel = samples(Vec3::X, 0.2, [Vec3::new(0.5, 0.5, 0.5)].into_iter());
        let layers = layers_facing(&[behind, panel].concat(), Direction::PosX);
        assert_eq!((&layers[..16], layers[16]), (&[1; 16][..], 0));
    }

    #[test]
    fn a_curve_has_as_many_layers_as_there_may_be() {
        let round: Vec<SurfaceSample> = (0..90)
            .flat_map(|degree| {
                let (sine, cosine) = (degree as f32 + 0.5).to_radians().sin_cos();
                let normal = Vec3::new(cosine, sine, 0.0);
                samples(normal, 0.01, [0.1 + 0.8 * normal].into_iter())
            })
            .collect();
        let layers = layers_facing(&round, Direction::PosX);
        let mut found = layers.clone();
        found.sort_unstable();
        found.dedup();
        assert_eq!(found, (0..DetailVoxel::LAYERS_MAX).collect::<Vec<_>>());
        // Neighbours stay together: one change a border.
        let facing = &layers[..85];
        assert_eq!(facing.windows(2).filter(|pair| pair[0] != pair[1]).count(), found.len() - 1);
    }

    #[test]
    fn buried_samples_belong_to_none() {
        let mut behind = wall(0.1);
        behind.iter_mut().for_each(|sample| sample.exposure = Exposure::Buried);
        assert_eq!(layers_facing(&[behind, wall(0.5)].concat(), Direction::PosX), [0; 32]);
    }
}
