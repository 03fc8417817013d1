//! Clustered virtual patches: the sources' first variant, with free normals.
//!
//! In each voxel the pair of clusters with the least
//!
//! ```text
//! M(i,j) = (1 + |c_i - c_j|) (2 - n_i . n_j) (1 + sqrt(sum_k (F_ik - F_jk)^2 + (F_ki - F_kj)^2))
//! ```
//!
//! becomes one, until at most `clusters_per_voxel` are left and no pair is nearer than `cluster_distance`. Distances
//! are in voxel edges, so that the metric does not hang on the unit of length. The form factors are those to coarse
//! voxels, found by a few rays (`coarse_exchange`), so that all of it is linear in voxels.
//! Merging never crosses voxels.

use crate::coarse_exchange::{CoarseGrid, Exchange, difference_squared, sum};
use crate::exposure::Exposure;
use crate::sample::SurfaceSample;
use earthshine_tiles::BakeParameters;
use earthshine_trace::SceneTracer;
use earthshine_world::{Direction, Vec3};
use glam::DVec3;
use rayon::prelude::*;

/// A voxel with more samples than this begins with what shares an octant of it and a dominant direction: 48 at most.
const STARTS_MAX: usize = 48;

/// Which cluster of its voxel a sample belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClusterOf {
    /// 0 to 15, within the voxel.
    pub ordinal: u8,
    /// The direction that the cluster's mean normal leans to most.
    pub direction: Direction,
}

/// The cluster of each of `samples`; `None` for buried ones.
#[must_use]
pub fn clusters_of(
    tracer: &SceneTracer<'_>,
    samples: &[SurfaceSample],
    parameters: &BakeParameters,
) -> Vec<Option<ClusterOf>> {
    let grid = CoarseGrid::new(samples);
    let mut order: Vec<u32> = (0..samples.len() as u32)
        .filter(|&index| samples[index as usize].exposure != Exposure::Buried)
        .collect();
    order.par_sort_unstable_by_key(|&index| (samples[index as usize].voxel.to_array(), index));
    let voxels: Vec<&[u32]> =
        order.chunk_by(|&a, &b| samples[a as usize].voxel == samples[b as usize].voxel).collect();
    let merged: Vec<Vec<Cluster>> = voxels
        .par_iter()
        .map(|members| {
            let mut clusters = starts(members, samples, parameters.grid.voxel_edge_m);
            for cluster in &mut clusters {
                cluster.exchange = grid.exchange(tracer, samples, &cluster.members, cluster.area, parameters);
            }
            merge(
                clusters,
                parameters.method.clusters_per_voxel as usize,
                parameters.method.cluster_distance,
                &grid,
            )
        })
        .collect();
    let mut found = vec![None; samples.len()];
    for clusters in merged {
        for (ordinal, cluster) in clusters.iter().enumerate() {
            let of = ClusterOf { ordinal: ordinal as u8, direction: dominant(cluster.normal()) };
            cluster.members.iter().for_each(|&member| found[member as usize] = Some(of));
        }
    }
    found
}

/// What the metric knows of a cluster. Sums, so that merging is adding.
#[derive(Debug, Clone, Default)]
struct Cluster {
    members: Vec<u32>,
    /// m2.
    area: f64,
    /// Positions in voxel edges, weighted by area.
    centre_sum: DVec3,
    /// Normals, weighted by area.
    normal_sum: DVec3,
    /// `A_i F_ik` by coarse voxel.
    exchange: Exchange,
}

impl Cluster {
    fn add(&mut self, member: u32, sample: &SurfaceSample, voxel_edge_m: f32) {
        let area = f64::from(sample.area);
        self.members.push(member);
        self.area += area;
        self.centre_sum += (sample.position / voxel_edge_m).as_dvec3() * area;
        self.normal_sum += sample.normal.as_dvec3() * area;
    }

    fn absorb(&mut self, other: Self) {
        self.members.extend(other.members);
        self.area += other.area;
        self.centre_sum += other.centre_sum;
        self.normal_sum += other.normal_sum;
        self.exchange = sum(&self.exchange, &other.exchange);
    }

    fn normal(&self) -> DVec3 {
        self.normal_sum.normalize_or(DVec3::Y)
    }
}

/// One cluster a sample, or one an octant and direction where there are too many.
fn starts(members: &[u32], samples: &[SurfaceSample], voxel_edge_m: f32) -> Vec<Cluster> {
    if members.len() <= STARTS_MAX {
        return members
            .iter()
            .map(|&member| {
                let mut cluster = Cluster::default();
                cluster.add(member, &samples[member as usize], voxel_edge_m);
                cluster
            })
            .collect();
    }
    let mut buckets = vec![Cluster::default(); STARTS_MAX];
    for &member in members {
        let sample = &samples[member as usize];
        let upper = (sample.position / voxel_edge_m - sample.voxel.as_vec3()).cmpge(Vec3::splat(0.5));
        let bucket = dominant(sample.normal.as_dvec3()).index() * 8 + upper.bitmask() as usize;
        buckets[bucket].add(member, sample, voxel_edge_m);
    }
    buckets.retain(|bucket| !bucket.members.is_empty());
    buckets
}

fn dominant(normal: DVec3) -> Direction {
    let size = normal.abs();
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    Direction::of_component(axis, normal[axis] as f32)
}

fn metric(a: &Cluster, b: &Cluster, grid: &CoarseGrid) -> f64 {
    let apart = (a.centre_sum / a.area).distance(b.centre_sum / b.area);
    let turned = 2.0 - a.normal().dot(b.normal());
    let seen = difference_squared(&a.exchange, a.area, &b.exchange, b.area, grid).sqrt();
    (1.0 + apart) * turned * (1.0 + seen)
}

/// Merges the nearest pair until at most `most` are left and no pair is nearer than `distance`. Of equal pairs the
/// one with the lowest numbers goes first. O(n^2): each cluster remembers its nearest.
fn merge(mut clusters: Vec<Cluster>, most: usize, distance: f32, grid: &CoarseGrid) -> Vec<Cluster> {
    let nearest_of = |clusters: &[Cluster], i: usize| {
        let others = (0..clusters.len()).filter(|&j| j != i);
        others
            .map(|j| (metric(&clusters[i.min(j)], &clusters[i.max(j)], grid), j))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
    };
    let mut nearest: Vec<Option<(f64, usize)>> =
        (0..clusters.len()).map(|i| nearest_of(&clusters, i)).collect();
    while clusters.len() > 1 {
        let ranked = nearest.iter().enumerate().filter_map(|(i, near)| near.map(|(m, j)| (m, i, j)));
        let Some((least, i, j)) = ranked.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))) else {
            break;
        };
        if clusters.len() <= most && least >= f64::from(distance) {
            break;
        }
        let (kept, gone) = (i.min(j), i.max(j));
        let last = clusters.len() - 1;
        let absorbed = clusters.swap_remove(gone);
        nearest.swap_remove(gone);
        clusters[kept].absorb(absorbed);
        for i in 0..clusters.len() {
            // Who pointed to either of the two, or to the one that moved, looks again; others look at the new one.
            let lost = nearest[i].is_none_or(|(_, near)| near == kept || near == gone || near == last);
            if i == kept || lost {
                nearest[i] = nearest_of(&clusters, i);
            } else if let Some((m, _)) = nearest[i] {
                let to_kept = metric(&clusters[i.min(kept)], &clusters[i.max(kept)], grid);
                if to_kept < m {
                    nearest[i] = Some((to_kept, kept));
                }
            }
        }
    }
    clusters
}

#[cfg(test)]
#[path = "clusters/tests.rs"]
mod tests;
