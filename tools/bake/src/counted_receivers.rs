//! Rows of receivers in the air from ends that a device counted: one set of rays, added up for each direction faced.

use crate::inquiry::{Inquiry, Question};
use crate::receiver_places::Candidate;
use crate::receivers::{FIRST_RAYS, ReceiverBake};
use crate::rows::{RawRow, RayEnd};
use earthshine_trace::ends::{RAY_PARTS, RUN_RAYS_MAX, RunEnds, RunSum};
use earthshine_trace::{Query, Rays};
use earthshine_world::{Direction, Vec3};

/// A voxel that asks for the ends of its rays.
#[derive(Debug)]
pub(crate) struct ReceiverInquiry<'a> {
    pub(crate) bake: ReceiverBake<'a>,
    pub(crate) candidate: Candidate,
}

impl ReceiverInquiry<'_> {
    fn rays(&self) -> u32 {
        self.bake.caster.parameters.receiver_rays
    }

    /// Directions without a patch: each becomes a row.
    fn open(&self) -> impl Iterator<Item = Direction> {
        let taken = self.candidate.taken;
        Direction::ALL.into_iter().filter(move |direction| taken >> direction.index() & 1 == 0)
    }

    /// The rays that a device could not judge, cast here: number, direction and end.
    fn returned(&self, directions: &[Vec3], pieces: &[RunEnds]) -> Vec<(u32, Vec3, RayEnd)> {
        let firsts = (0..self.rays()).step_by(RUN_RAYS_MAX as usize);
        let rays =
            firsts.zip(pieces).flat_map(|(first, piece)| piece.unknown.iter().map(move |at| first + at));
        rays.map(|ray| {
            let direction = directions[ray as usize];
            (ray, direction, self.bake.caster.end(self.candidate.place, direction))
        })
        .collect()
    }
}

impl Inquiry for ReceiverInquiry<'_> {
    type Made = ([RawRow; 6], u64);

    fn ray_count(&self) -> usize {
        self.rays() as usize
    }

    fn ask(&mut self) -> Question {
        let (origin, distance_max) = (self.candidate.place, f32::INFINITY);
        let directions = self.bake.directions(self.candidate.voxel);
        let rays = directions.map(|direction| Query { origin, direction, distance_max }).collect();
        let mut question = Question { rays: Rays::Made(rays), runs: Vec::new() };
        question.sum(0, FIRST_RAYS, RunSum::Absorbed);
        question.sum(0, self.rays(), RunSum::Absorbed);
        for direction in self.open() {
            question.sum(0, self.rays(), RunSum::Facing(direction));
        }
        question
    }

    fn hear(&mut self, ends: &[RunEnds]) -> Option<Self::Made> {
        let directions: Vec<Vec3> = self.bake.directions(self.candidate.voxel).collect();
        let pieces = self.rays().div_ceil(RUN_RAYS_MAX) as usize;
        let (first, rest) = ends.split_at(1);
        let (whole, facing) = rest.split_at(pieces);
        let returned = self.returned(&directions, whole);
        let absorbed = |counted: &[RunEnds], before: u32| -> f32 {
            let parts: u64 = counted.iter().map(|ends| u64::from(ends.absorbed)).sum();
            let own = returned.iter().filter(|(ray, ..)| *ray < before);
            own.map(|(_, _, end)| end.absorbed_share()).sum::<f32>() + parts as f32 / RAY_PARTS as f32
        };
        if let Some(rays) = self.bake.inside(absorbed(first, FIRST_RAYS), absorbed(whole, self.rays())) {
            return Some((Default::default(), rays));
        }
        let (mut rows, mut weights): ([RawRow; 6], _) = (Default::default(), [0.0f32; 6]);
        for (direction, pieces) in self.open().zip(facing.chunks(pieces)) {
            let facing = |way: Vec3| way.dot(direction.vector()).max(0.0);
            let row = &mut rows[direction.index()];
            row.add_counted(pieces, 1.0);
            for (_, way, end) in returned.iter().filter(|(_, way, _)| facing(*way) > 0.0) {
                row.add(end, *way, facing(*way));
            }
            weights[direction.index()] = directions.iter().map(|way| facing(*way)).sum();
        }
        Some((self.bake.finished(rows, weights, self.candidate.voxel), u64::from(self.rays())))
    }
}
