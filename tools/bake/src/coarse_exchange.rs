//! What a few samples exchange with the coarse voxels around them: the form factors of the cluster metric.
//!
//! `A_i F_ik` for coarse voxels k, by a few rays: rough, sparse, and no dearer for a larger world. Form factors the
//! other way follow by reciprocity from the area of surface in a coarse voxel.

use crate::rows::RAY_OFFSET;
use crate::sample::{SurfaceSample, voxel_of};
use earthshine_tiles::BakeParameters;
use earthshine_trace::SceneTracer;
use earthshine_trace::hemisphere::{cosine_direction, spread_pair};
use earthshine_world::VoxelCoord;
use earthshine_world::random::{Purpose, hash, unit_pair};
use std::collections::HashMap;

/// Voxels along the edge of a coarse one.
const COARSE: i32 = 4;
/// Rays of one cluster.
const RAYS: u32 = 16;

/// `A_i F_ik` (m2) by coarse voxel, ascending.
pub(crate) type Exchange = Vec<([i32; 3], f64)>;

/// The area of surface in each coarse voxel. Only looked up, never iterated.
#[derive(Debug, Default)]
pub(crate) struct CoarseGrid {
    areas: HashMap<[i32; 3], f64>,
}

fn coarse_of(voxel: VoxelCoord) -> [i32; 3] {
    voxel.to_array().map(|at| at.div_euclid(COARSE))
}

impl CoarseGrid {
    /// Adds up the areas of `samples`.
    pub(crate) fn new(samples: &[SurfaceSample]) -> Self {
        let mut areas = HashMap::new();
        for sample in samples {
            *areas.entry(coarse_of(sample.voxel)).or_default() += f64::from(sample.area);
        }
        Self { areas }
    }

    /// What `members` of area `area` exchange with every coarse voxel that their rays meet. All clusters of a voxel
    /// use the same pairs of numbers: what differs between two of them is not noise.
    pub(crate) fn exchange(
        &self,
        tracer: &SceneTracer<'_>,
        samples: &[SurfaceSample],
        members: &[u32],
        area: f64,
        parameters: &BakeParameters,
    ) -> Exchange {
        let edge = parameters.grid.voxel_edge_m;
        let key = crate::rows::patch_key(samples[members[0] as usize].voxel, 15);
        let (shift_u, shift_v) = unit_pair(hash(parameters.seed, Purpose::PointChoice, key, 1));
        let share = area / f64::from(RAYS);
        let mut met: Exchange = (0..RAYS)
            .filter_map(|ray| {
                let (u, v) = spread_pair(ray, shift_u, shift_v);
                let member = members[ray as usize * members.len() / RAYS as usize];
                let sample = &samples[member as usize];
                let direction = cosine_direction(sample.normal, u, v);
                let origin = sample.position + sample.normal * (RAY_OFFSET * edge);
                let hit = tracer.closest(origin, direction, 0.0, f32::INFINITY)?;
                let place = origin + direction * hit.distance;
                Some((coarse_of(voxel_of(place, tracer.normal(&hit), edge)), share))
            })
            .collect();
        met.sort_unstable_by_key(|entry| entry.0);
        met.dedup_by(|later, kept| {
            let same = later.0 == kept.0;
            if same {
                kept.1 += later.1;
            }
            same
        });
        met
    }
}

/// Both together.
pub(crate) fn sum(a: &Exchange, b: &Exchange) -> Exchange {
    let mut both = Vec::with_capacity(a.len() + b.len());
    for_both(a, b, |k, from_a, from_b| both.push((k, from_a + from_b)));
    both
}

/// `sum_k (F_ik - F_jk)^2 + (F_ki - F_kj)^2`.
pub(crate) fn difference_squared(
    a: &Exchange,
    area_a: f64,
    b: &Exchange,
    area_b: f64,
    grid: &CoarseGrid,
) -> f64 {
    let mut total = 0.0;
    for_both(a, b, |k, from_a, from_b| {
        total += (from_a / area_a - from_b / area_b).powi(2);
        // A hit on a surface without samples has no area to come back from.
        if let Some(area) = grid.areas.get(&k).filter(|area| **area > 0.0) {
            total += ((from_a - from_b) / area).powi(2);
        }
    });
    total
}

fn for_both(a: &Exchange, b: &Exchange, mut each: impl FnMut([i32; 3], f64, f64)) {
    let (mut a, mut b) = (a.iter().peekable(), b.iter().peekable());
    loop {
        let k = match (a.peek(), b.peek()) {
            (None, None) => return,
            (Some(x), None) | (None, Some(x)) => x.0,
            (Some(x), Some(y)) => x.0.min(y.0),
        };
        let from_a = a.next_if(|x| x.0 == k).map_or(0.0, |x| x.1);
        let from_b = b.next_if(|y| y.0 == k).map_or(0.0, |y| y.1);
        each(k, from_a, from_b);
    }
}
