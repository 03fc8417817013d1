//! Rows of parts of detail beside crevices: hits on what patches leave out count by how open it is ([`Crevices`]).
//!
//! [`Crevices`]: crate::crevices::Crevices

use crate::detail::{DetailBake, DetailPart, detail_voxel_of};
use crate::inquiry::QUESTION_RAYS;
use crate::offload::Offload;
use crate::rows::{RawRow, RayEnd};
use crate::sample::{side_of, voxel_of};
use crate::spread::Spread;
use earthshine_trace::{Hit, Query};
use rayon::prelude::*;

impl DetailBake<'_> {
    /// Whether hits count by how open they are; a device does not know that.
    pub(crate) fn is_beside_crevice(&self, of: &DetailPart) -> bool {
        self.crevices.are_beside(of.part.patch.voxel)
    }

    /// The rows of `parts`, all beside crevices. A device that works names what each ray meets.
    pub(crate) fn rows_in_crevices(&self, parts: &[&DetailPart], offload: &Offload<'_>) -> Vec<RawRow> {
        let rays = self.rays() as usize;
        let asked_together = (QUESTION_RAYS / rays.max(1)).max(1);
        let rows = parts.par_chunks(asked_together).flat_map_iter(|parts| {
            let spreads: Vec<Spread> = parts.iter().map(|part| self.spread(part)).collect();
            let of_part = |(part, spread)| self.queries(part, spread);
            let queries: Vec<Query> = parts.iter().copied().zip(&spreads).flat_map(of_part).collect();
            let named = if queries.len() <= QUESTION_RAYS { offload.first(&queries) } else { None };
            let hit = |at: usize| match &named {
                Some(named) => {
                    let returned = || offload.note_returned(1);
                    self.caster.tracer.closest_named(&queries[at], named[at], returned)
                }
                None => self.closest(&queries[at]),
            };
            let row = |(place, part): (usize, &&DetailPart)| {
                let range = place * rays..(place + 1) * rays;
                let hits = range.clone().map(hit);
                self.finished(self.counted(&queries[range], hits), part)
            };
            parts.iter().enumerate().map(row).collect::<Vec<RawRow>>()
        });
        rows.collect()
    }

    /// The row of `of` by rays of `spread`, before emitters say what they see of it.
    pub(crate) fn row_in_crevice(&self, of: &DetailPart, spread: &Spread) -> RawRow {
        let queries: Vec<Query> = self.queries(of, spread).collect();
        self.counted(&queries, queries.iter().map(|query| self.closest(query)))
    }

    fn closest(&self, query: &Query) -> Option<Hit> {
        self.caster.tracer.closest(query.origin, query.direction, query.distance_max)
    }

    /// The rays of `of`.
    fn queries(&self, of: &DetailPart, spread: &Spread) -> impl Iterator<Item = Query> {
        let run = 0..self.rays();
        run.clone().map(move |ray| {
            let (origin, direction) = self.caster.ray(&of.part, spread, &run, ray);
            Query { origin, direction, distance_max: f32::INFINITY }
        })
    }

    /// As [`RowCaster::cast`](crate::rows::RowCaster::cast) counts `queries` that end at `hits`, but that those on what patches
    /// leave out count less. What emits does so in crevices too.
    fn counted(&self, queries: &[Query], hits: impl Iterator<Item = Option<Hit>>) -> RawRow {
        let caster = &self.caster;
        let share = 1.0 / queries.len() as f32;
        let mut row = RawRow { rays: self.rays(), ..RawRow::default() };
        for (query, hit) in queries.iter().zip(hits) {
            let Some(hit) = hit else {
                row.add(&RayEnd::Sky, query.direction, share);
                continue;
            };
            let position = query.origin + query.direction * hit.distance;
            let count = if caster.tracer.tracer().emits(&hit) {
                1.0
            } else {
                let normal = caster.tracer.tracer().normal(&hit);
                let voxel = voxel_of(position, normal, caster.parameters.grid.voxel_edge_m);
                let at = detail_voxel_of(voxel, position, normal, caster.parameters);
                self.crevices.count(side_of(hit.triangle, hit.front), at)
            };
            row.add(&RayEnd::Surface(caster.owners(&hit, position)), query.direction, share * count);
            row.absorbed += share * (1.0 - count);
        }
        row.merge();
        row
    }
}
