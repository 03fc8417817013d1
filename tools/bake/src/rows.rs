//! One row by cosine-weighted rays: where the light that arrives at a patch comes from.

use crate::builder::Surfaces;
use crate::eye::Eye;
use crate::patches::{BakePatch, PatchSet};
use crate::places::{Owners, Place};
use crate::sample::{SurfaceSample, side_of, voxel_of};
use crate::spread::Spread;
use earthshine_tiles::BakeParameters;
use earthshine_trace::ends::{RAY_PARTS, RunEnds};
use earthshine_trace::hemisphere::cosine_direction;
use earthshine_trace::{Hit, RayFan, SceneTracer};
use earthshine_world::{AxisWeights, Vec3};
use std::ops::Range;

/// A row as the rays of its own patch see it; columns are indices into the whole [`PatchSet`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RawRow {
    /// `(patch, share)`, ascending by patch.
    pub entries: Vec<(u32, f32)>,
    /// Escapes by direction lobe.
    pub sky: [f32; 6],
    /// Hits on sides without patches.
    pub absorbed: f32,
    /// Rays that it rests on: its weight against other estimates.
    pub rays: u32,
}

/// How far off its surface a ray begins, as a share of a voxel's edge.
pub const RAY_OFFSET: f32 = 1e-4;

/// Casts the rays of rows.
#[derive(Debug, Clone, Copy)]
pub struct RowCaster<'a> {
    /// The scene.
    pub tracer: Eye<'a>,
    /// Where rays begin.
    pub samples: &'a [SurfaceSample],
    /// The patches that they begin on, with samples.
    pub sources: &'a [BakePatch],
    /// Number of the first of them.
    pub first: u32,
    /// Where rays end: all patches, which need no samples.
    pub set: &'a PatchSet,
    /// Of the bake.
    pub parameters: &'a BakeParameters,
}

impl<'a> RowCaster<'a> {
    /// Casts rows of the whole of a world that is in memory.
    #[must_use]
    pub fn of_world(
        tracer: &'a SceneTracer<'a>,
        Surfaces { samples, set }: &'a Surfaces,
        parameters: &'a BakeParameters,
    ) -> Self {
        Self { tracer: tracer.into(), samples, sources: &set.patches, first: 0, set, parameters }
    }

    /// Patch `index`, which rays may begin on.
    pub(crate) fn source(&self, index: u32) -> &'a BakePatch {
        &self.sources[(index - self.first) as usize]
    }

    /// The row of patch `index` as `rays` rays see it.
    #[must_use]
    pub fn row(&self, index: u32, rays: u32) -> RawRow {
        let spread = self.spread(index, rays);
        self.run(index, &spread, 0..rays)
    }

    /// The pairs of numbers of patch `index`.
    pub(crate) fn spread(&self, index: u32, rays: u32) -> Spread {
        let key = self.set.patches[index as usize].key;
        Spread::new(self.parameters.method.spread, rays, self.parameters.seed, key)
    }

    /// The row of patch `index` as the rays numbered `run` see it: they go over all of the patch, in the order of its
    /// samples, so that each sample gets a run of its own.
    pub(crate) fn run(&self, index: u32, spread: &Spread, run: Range<u32>) -> RawRow {
        self.cast(self.source(index), spread, run)
    }

    /// The same for any patch made of the samples, one of the set or not.
    pub(crate) fn cast(&self, source: &BakePatch, spread: &Spread, run: Range<u32>) -> RawRow {
        let rays = run.len() as u32;
        let share = 1.0 / rays as f32;
        let mut row = RawRow { entries: Vec::with_capacity(rays as usize), rays, ..RawRow::default() };
        for ray in run.clone() {
            let (origin, direction) = self.ray(source, spread, &run, ray);
            row.add(&self.end(origin, direction), direction, share);
        }
        row.merge();
        row
    }

    /// Where ray `ray` of `run` begins and its unit direction. [`Self::fans`] has the same rule for
    /// rays that a device makes; the twin `fans` of `earthshine-gpu` and `counted_rows` hold one against the other.
    pub(crate) fn ray(
        &self,
        source: &BakePatch,
        spread: &Spread,
        run: &Range<u32>,
        ray: u32,
    ) -> (Vec3, Vec3) {
        let off_surface_m = RAY_OFFSET * self.parameters.grid.voxel_edge_m;
        let (share, place) = (1.0 / run.len() as f32, (ray - run.start) as f32);
        let sample = &self.samples[source.sample_at((place + 0.5) * share) as usize];
        let (u, v) = spread.pair(ray);
        let direction = cosine_direction(sample.normal, u, v);
        (sample.position + sample.normal * off_surface_m, direction)
    }

    /// The rays of `run`, as [`Self::ray`] makes them, in fans of one sample each: for spreads that have a
    /// [shift](Spread::shift).
    pub(crate) fn fans(&self, source: &BakePatch, shift: (f32, f32), run: &Range<u32>) -> Vec<RayFan> {
        let off_surface_m = RAY_OFFSET * self.parameters.grid.voxel_edge_m;
        let share = 1.0 / run.len() as f32;
        let last = source.samples.len() - 1;
        let (mut fans, mut at): (Vec<RayFan>, _) = (Vec::new(), 0);
        let mut of_last = None;
        for ray in run.clone() {
            // As `sample_at` finds it: samples come in the order of rays.
            let target = ((ray - run.start) as f32 + 0.5) * share * source.patch.area;
            while at < last && source.samples[at].1 <= target {
                at += 1;
            }
            if of_last.replace(at) != Some(at) {
                let SurfaceSample { position, normal, .. } = self.samples[source.samples[at].0 as usize];
                let origin = position + normal * off_surface_m;
                fans.push(RayFan { origin, normal, shift, first_pair: ray, ray_count: 0 });
            }
            if let Some(fan) = fans.last_mut() {
                fan.ray_count += 1;
            }
        }
        fans
    }

    /// Where the ray from `origin` along unit `direction` ends. The one rule for patches' rows and receivers'.
    pub(crate) fn end(&self, origin: Vec3, direction: Vec3) -> RayEnd {
        match self.tracer.closest(origin, direction, f32::INFINITY) {
            None => RayEnd::Sky,
            Some(hit) => RayEnd::Surface(self.owners(&hit, origin + direction * hit.distance)),
        }
    }

    /// Whose `hit` at `position` is.
    pub(crate) fn owners(&self, hit: &Hit, position: Vec3) -> Option<Owners> {
        self.set.owners(&self.place(hit, position))
    }

    /// The place of `hit` at `position`, whose voxel is noted.
    pub(crate) fn place(&self, hit: &Hit, position: Vec3) -> Place {
        let normal = self.tracer.tracer().normal(hit);
        let voxel = voxel_of(position, normal, self.parameters.grid.voxel_edge_m);
        self.tracer.note_voxel(voxel);
        let emits = self.tracer.tracer().emits(hit);
        Place { side: side_of(hit.triangle, hit.front), voxel, position, normal, emits }
    }
}

/// Where a ray ends, in terms of patches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum RayEnd {
    /// Out in the sky.
    Sky,
    /// On a surface; `None` where its voxel's patches left it out.
    Surface(Option<Owners>),
}

impl RayEnd {
    /// The share of it that no patch takes.
    pub(crate) fn absorbed_share(&self) -> f32 {
        match self {
            Self::Sky => 0.0,
            Self::Surface(None) => 1.0,
            Self::Surface(Some(owners)) => {
                owners.iter().filter(|owner| owner.0 == PatchSet::NONE).map(|owner| owner.1).sum()
            }
        }
    }
}

impl RawRow {
    /// Adds the end of a ray along `direction` that stands for `share`.
    pub(crate) fn add(&mut self, end: &RayEnd, direction: Vec3, share: f32) {
        match *end {
            RayEnd::Sky => add_sky(&mut self.sky, direction, share),
            RayEnd::Surface(owners) => self.add_hit(owners, share),
        }
    }

    /// Adds ends that a device counted, where a whole ray stands for `share`; [`Self::merge`] has to follow.
    pub(crate) fn add_counted(&mut self, runs: &[RunEnds], share: f64) {
        let part = share / f64::from(RAY_PARTS);
        let sum =
            |parts: &mut dyn Iterator<Item = u32>| (parts.map(u64::from).sum::<u64>() as f64 * part) as f32;
        let mut counted: Vec<(u32, u32)> = runs.iter().flat_map(|run| run.patches.iter().copied()).collect();
        counted.sort_unstable();
        let by_patch = counted.chunk_by(|a, b| a.0 == b.0);
        self.entries.extend(by_patch.map(|own| (own[0].0, sum(&mut own.iter().map(|entry| entry.1)))));
        self.absorbed += sum(&mut runs.iter().map(|run| run.absorbed));
        for (lobe, of_sky) in self.sky.iter_mut().enumerate() {
            *of_sky += sum(&mut runs.iter().map(|run| run.sky[lobe]));
        }
    }

    /// Multiplies all shares.
    pub(crate) fn scale(&mut self, factor: f32) {
        self.entries.iter_mut().for_each(|(_, share)| *share *= factor);
        self.sky.iter_mut().for_each(|share| *share *= factor);
        self.absorbed *= factor;
    }

    fn add_hit(&mut self, owners: Option<Owners>, share: f32) {
        let Some(owners) = owners else {
            self.absorbed += share;
            return;
        };
        for (patch, weight) in owners {
            if weight > 0.0 {
                match patch {
                    PatchSet::NONE => self.absorbed += share * weight,
                    patch => self.entries.push((patch, share * weight)),
                }
            }
        }
    }

    /// Sorts the entries and adds up those of one patch.
    pub(crate) fn merge(&mut self) {
        self.entries.sort_by_key(|&(patch, _)| patch);
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

/// The voxel of a [`patch_key`], if its coordinates are within 2^19.
pub(crate) fn voxel_of_key(key: u64) -> earthshine_world::VoxelCoord {
    // Twenty bits with their sign.
    let coordinate = |shift: u32| ((key >> shift) as i32) << 12 >> 12;
    [coordinate(44), coordinate(24), coordinate(4)].into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::VoxelCoord;

    #[test]
    fn keys_hold_their_voxels() {
        for voxel in [[0, 0, 0], [-1, 2, -3], [524_287, -524_288, 77]].map(VoxelCoord::from) {
            assert_eq!(voxel_of_key(patch_key(voxel, 5)), voxel);
        }
    }
}
