//! One row by cosine-weighted rays: where the light that arrives at a patch comes from.

use crate::patches::PatchSet;
use crate::sample::{SurfaceSample, side_of, side_weights, voxel_of};
use earthshine_tiles::BakeParameters;
use earthshine_trace::SceneTracer;
use earthshine_trace::hemisphere::{cosine_direction, spread_pair};
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{AxisWeights, Direction, Vec3};

/// A row as the rays of its own patch see it; columns are indices into the whole [`PatchSet`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RawRow {
    /// `(patch, share)`, ascending by patch.
    pub entries: Vec<(u32, f32)>,
    /// Escapes by direction lobe.
    pub sky: [f32; 6],
    /// Hits on sides without patches.
    pub absorbed: f32,
}

/// How far off its surface a ray begins, as a share of a voxel's edge.
pub const RAY_OFFSET: f32 = 1e-4;

/// Traces the row of patch `index`.
#[must_use]
pub fn trace_row(
    tracer: &SceneTracer<'_>,
    samples: &[SurfaceSample],
    set: &PatchSet,
    index: u32,
    parameters: &BakeParameters,
) -> RawRow {
    let source = &set.patches[index as usize];
    let rays = parameters.rays_per_patch.max(1);
    let edge = parameters.grid.voxel_edge_m;
    let key = patch_key(source.patch.voxel, source.patch.direction.index());
    let (shift_u, shift_v) = unit_pair(hash(parameters.seed, Purpose::RowRay, key, 0));
    let mut row = RawRow { entries: Vec::with_capacity(rays as usize), ..RawRow::default() };
    let share = 1.0 / rays as f32;
    for ray in 0..rays {
        let (u, v) = spread_pair(ray, shift_u, shift_v);
        let sample = &samples[source.sample_at((ray as f32 + 0.5) * share) as usize];
        let direction = cosine_direction(sample.normal, u, v);
        let origin = sample.position + sample.normal * (RAY_OFFSET * edge);
        match tracer.closest(origin, direction, 0.0, f32::INFINITY) {
            None => add_sky(&mut row.sky, direction, share),
            Some(hit) => {
                let place = origin + direction * hit.distance;
                let normal = tracer.normal(&hit);
                let voxel = voxel_of(place, normal, edge);
                if set.is_left_out(side_of(hit.triangle, hit.front), voxel, place) {
                    row.absorbed += share;
                } else {
                    row.add_hit(set.of_voxel(voxel), side_weights(parameters.weights, normal), share);
                }
            }
        }
    }
    row.merge();
    row
}

impl RawRow {
    fn add_hit(&mut self, patches: [u32; 6], weights: [(Direction, f32); 3], share: f32) {
        for (direction, weight) in weights {
            if weight > 0.0 {
                match patches[direction.index()] {
                    PatchSet::NONE => self.absorbed += share * weight,
                    patch => self.entries.push((patch, share * weight)),
                }
            }
        }
    }

    fn merge(&mut self) {
        self.entries.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        self.entries.dedup_by(|later, kept| {
            let same = later.0 == kept.0;
            if same {
                kept.1 += later.1;
            }
            same
        });
    }
}

fn add_sky(sky: &mut [f32; 6], direction: Vec3, share: f32) {
    for (lobe, weight) in AxisWeights::Squared.of(direction) {
        sky[lobe.index()] += share * weight;
    }
}

/// What a patch's random numbers hang on: its place, not its number, so that it does not matter what else is baked.
#[must_use]
pub fn patch_key(voxel: earthshine_world::VoxelCoord, direction: usize) -> u64 {
    let bits = |c: i32| u64::from(c.cast_unsigned() & 0x000F_FFFF);
    bits(voxel.x) << 44 | bits(voxel.y) << 24 | bits(voxel.z) << 4 | direction as u64
}
