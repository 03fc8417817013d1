//! Rows of patches from ends that a device counted: a fixed number of rays, or batches until an error is met.

use crate::adaptive::Refinement;
use crate::inquiry::{Inquiry, Question};
use crate::patches::BakePatch;
use crate::rows::{RawRow, RowCaster};
use crate::spread::Spread;
use earthshine_trace::ends::{RUN_RAYS_MAX, RunEnds, RunSum};
use earthshine_trace::{Query, Rays};
use std::ops::Range;

/// How many rays a row takes.
#[derive(Debug, Clone)]
pub(crate) enum RayPlan {
    /// All at once.
    Fixed(u32),
    /// What its error asks for.
    Refined(Refinement),
}

/// A row that asks for the ends of its rays.
#[derive(Debug)]
pub(crate) struct RowInquiry<'a> {
    pub(crate) caster: RowCaster<'a>,
    pub(crate) source: &'a BakePatch,
    pub(crate) spread: Spread,
    pub(crate) plan: RayPlan,
}

impl RowInquiry<'_> {
    /// The runs of rays that are asked for next, each of which goes over the whole patch.
    fn due(&self) -> Vec<Range<u32>> {
        match &self.plan {
            RayPlan::Fixed(rays) => std::iter::once(0..*rays).collect(),
            RayPlan::Refined(refinement) => refinement.due().collect(),
        }
    }

    /// The row of `run`, whose pieces ended in `pieces`; rays that the device could not judge are cast here.
    fn row(&self, run: &Range<u32>, pieces: &[RunEnds]) -> RawRow {
        let share = 1.0 / run.len() as f32;
        let mut row = RawRow { rays: run.len() as u32, ..RawRow::default() };
        row.add_counted(pieces, f64::from(share));
        for (first, piece) in run.clone().step_by(RUN_RAYS_MAX as usize).zip(pieces) {
            for place in &piece.unknown {
                let (origin, direction) = self.caster.ray(self.source, &self.spread, run, first + place);
                row.add(&self.caster.end(origin, direction), direction, share);
            }
        }
        row.merge();
        row
    }
}

impl Inquiry for RowInquiry<'_> {
    type Made = RawRow;

    fn ray_count(&self) -> usize {
        self.due().iter().map(Range::len).sum()
    }

    fn ask(&mut self) -> Question {
        let mut question = Question::default();
        for run in self.due() {
            let query = |ray: u32| {
                let (origin, direction) = self.caster.ray(self.source, &self.spread, &run, ray);
                Query { origin, direction, distance_max: f32::INFINITY }
            };
            let first = question.rays.count() as u32;
            question.rays.append(match self.spread.shift() {
                Some(shift) => Rays::Fans(self.caster.fans(self.source, shift, &run)),
                None => Rays::Made(run.clone().map(query).collect()),
            });
            question.sum(first, run.len() as u32, RunSum::Whole);
        }
        question
    }

    fn hear(&mut self, ends: &[RunEnds]) -> Option<RawRow> {
        let mut rest = ends;
        for run in self.due() {
            let (pieces, others) = rest.split_at(run.len().div_ceil(RUN_RAYS_MAX as usize));
            rest = others;
            let row = self.row(&run, pieces);
            match &mut self.plan {
                RayPlan::Fixed(_) => return Some(row),
                RayPlan::Refined(refinement) => {
                    if refinement.add(&row) {
                        return Some(refinement.mean());
                    }
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builder::Builder;
    use crate::end_places::end_places;
    use crate::estimator::Estimator;
    use crate::progress::Silent;
    use crate::test_shapes::boxed;
    use earthshine_scene::Scene;
    use earthshine_tiles::{BakeParameters, RaySpread};
    use earthshine_trace::SceneTracer;
    use earthshine_trace::ends::count_ends;
    use earthshine_world::{Grid, Vec3};

    /// A room askew in the grid with a box in it, of which one triangle may have holes.
    fn scene() -> Scene {
        let mut scene = boxed(Vec3::splat(-1.9), Vec3::new(2.1, 1.7, 1.9));
        let inner = boxed(Vec3::new(-0.7, -1.9, -0.3), Vec3::new(0.4, -0.2, 0.6));
        scene.triangles.extend(inner.triangles);
        scene.texture_coordinates.extend(inner.texture_coordinates);
        scene.material_of.extend(inner.material_of);
        let turn = glam::Quat::from_rotation_y(0.4);
        scene.triangles.iter_mut().flatten().for_each(|corner| *corner = turn * *corner);
        scene.materials[0].double_sided = true;
        let mut masked = scene.materials[0].clone();
        masked.alpha_cutoff = Some(0.5);
        scene.materials.push(masked);
        scene.material_of[14] = 1;
        scene
    }

    fn own(row: &RawRow) -> impl Iterator<Item = f32> {
        row.entries.iter().map(|entry| entry.1).chain(row.sky).chain([row.absorbed])
    }

    /// Goal: a row that is made of counted ends is the CPU's row, ray for ray, be its rays many or few, one question or
    /// several. Method: the twin of a device.
    #[test]
    fn rows_of_counted_ends_are_those_of_the_cpu() {
        let scene = scene();
        let tracer = SceneTracer::new(&scene);
        let spreads = [RaySpread::R2, RaySpread::R2, RaySpread::R2, RaySpread::R2, RaySpread::Sobol];
        let counts = [(1, 0.0), (512, 0.0), (1300, 0.0), (1, 0.03), (600, 0.0)];
        for ((rays, row_error), spread) in counts.into_iter().zip(spreads) {
            let grid = Grid { voxel_edge_m: 0.8, chunk_edge_voxels: 4 };
            let mut parameters = BakeParameters { grid, rays_per_patch: rays, ..BakeParameters::default() };
            parameters.method.row_error = row_error;
            parameters.method.spread = spread;
            let surfaces = Builder { tracer: &tracer, parameters: &parameters }.surfaces(&Silent);
            let places = end_places(&scene, &surfaces.set, &parameters);
            let estimator = Estimator::with_factor(RowCaster::of_world(&tracer, &surfaces, &parameters), 1);
            let (mut returned, mut questions) = (0, 0);
            for index in 0..surfaces.set.len() as u32 {
                let mut inquiry = estimator.inquiry(index);
                let counted = loop {
                    let question = inquiry.ask();
                    let ends = count_ends(&tracer, &places, &question.rays.queries(), &question.runs);
                    returned += ends.iter().map(|run| run.unknown.len()).sum::<usize>();
                    questions += 1;
                    if let Some(row) = inquiry.hear(&ends) {
                        break row;
                    }
                };
                let expected = estimator.row(index);
                assert_eq!(counted.rays, expected.rays, "{rays} rays, row {index}");
                assert_eq!(counted.entries.len(), expected.entries.len(), "{rays} rays, row {index}");
                for (a, b) in own(&counted).zip(own(&expected)) {
                    assert!((a - b).abs() < 1e-5, "{rays} rays, row {index}: {a} for {b}");
                }
            }
            assert!(surfaces.set.len() > 100 && returned > 0, "{returned} came back");
            assert_eq!(questions > surfaces.set.len(), row_error > 0.0, "{questions} questions");
        }
    }
}
