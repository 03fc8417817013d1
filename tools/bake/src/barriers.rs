//! Sides of walls: what lies in one plane in a detail voxel on both sides of a wall is two layers, and a layer says where
//! walls end it.
//!
//! A floor goes on behind a wall, where other light falls on it. So each layer that planes make ([`crate::layers`]) is asked
//! for walls ([`crate::walls`]), cut by one that parts it, and given up to two barriers: those most of its view ends at.

use crate::exposure::Exposure;
use crate::layers::{AREA_SHARE_MIN, Cluster};
use crate::sample::SurfaceSample;
use crate::walls::{EYES_MAX, Ground, Segment, Wall, WallTest, before, ends_at, lines_of, walls_of};
use earthshine_world::{Barrier, DetailVoxel, Direction, Vec3, VoxelCoord};

/// What ends a layer; what is one comes before what is none.
pub(crate) type Barriers = [Option<Barrier>; Barrier::PER_LAYER_MAX];

/// Places on each side of a wall that ways go between to tell whether it parts them.
const PARTED_EYES: usize = 4;
/// Steps that a barrier is put further away, at most, so that all of its layer lies before it.
const STEPS_MAX: u8 = 4;
/// Walls whose ways differ by less than this cosine's angle may be two faces of one.
const SAME_WAY_COSINE: f32 = 0.9;
/// A step of a barrier's distance, in edges; its angle is off by less where a layer reaches.
const STEP: f32 = 0.012;

/// What lies on one side of walls.
#[derive(Debug)]
struct Side {
    cluster: Cluster,
    /// The walls that it was cut by, as seen from it.
    cuts: Vec<Wall>,
}

/// Cuts clusters of `samples` in one detail voxel and direction by walls.
#[derive(Debug)]
pub(crate) struct Sides<'a> {
    pub(crate) test: WallTest<'a>,
    pub(crate) samples: &'a [SurfaceSample],
    pub(crate) voxel: VoxelCoord,
    pub(crate) direction: Direction,
}

impl Sides<'_> {
    /// `clusters`, with each side of a wall for itself as long as there are layers left, and the barriers of each.
    pub(crate) fn of(&self, clusters: Vec<Cluster>) -> Vec<(Cluster, Barriers)> {
        let mut open: Vec<Side> =
            clusters.into_iter().map(|cluster| Side { cluster, cuts: Vec::new() }).collect();
        let mut done = Vec::new();
        while let Some(side) = open.pop() {
            let Side { cluster, cuts } = &side;
            let ground = Ground {
                voxel: self.voxel,
                direction: self.direction,
                normal: cluster.normal(),
                place: cluster.middle(),
            };
            if !ground.is_facing() {
                done.push((side.cluster, [None; Barrier::PER_LAYER_MAX]));
                continue;
            }
            let segments = self.test.look(&ground, &self.eyes(cluster, EYES_MAX, |_| true));
            let has_room = open.len() + done.len() + 1 < usize::from(DetailVoxel::LAYERS_MAX);
            // What parts the layer may end beside it: a pillar that a ledge goes on behind.
            let lines = if has_room { lines_of(&segments, self.test.edge_m) } else { Vec::new() };
            if let Some(wall) = lines.iter().find(|wall| self.parts(&ground, cluster, wall)) {
                open.extend(self.cut(&side, wall));
            } else {
                let barriers = self.barriers(cluster, cuts, &segments);
                done.push((side.cluster, barriers));
            }
        }
        done
    }

    /// The two barriers of `cluster`, which lies before `cuts`, that most of `segments` end at.
    fn barriers(&self, cluster: &Cluster, cuts: &[Wall], segments: &[Segment]) -> Barriers {
        let middle = (self.voxel.as_vec3() + 0.5) * self.test.edge_m;
        let is_farther = |wall: &Wall, other: &Wall| {
            wall.towards.dot(other.towards) > SAME_WAY_COSINE && wall.beyond(middle) < other.beyond(middle)
        };
        let mut walls = walls_of(segments);
        walls.retain(|wall| !self.has_both(cluster, wall) && !cuts.iter().any(|cut| is_farther(wall, cut)));
        let mut cuts: Vec<Wall> =
            cuts.iter().filter(|cut| !walls.iter().any(|wall| is_farther(cut, wall))).copied().collect();
        let mut found = [None; Barrier::PER_LAYER_MAX];
        let mut rest = segments.to_vec();
        for barrier in &mut found {
            // What cut the layer ends it before all else: what lies behind it is read with it otherwise.
            let cut = cuts.iter().map(|cut| ((true, ends_at(&rest, cut).unwrap_or(0)), cut));
            let seen = walls.iter().filter_map(|wall| Some(((false, ends_at(&rest, wall)?), wall)));
            let mut most: Vec<((bool, usize), &Wall)> = cut.chain(seen).collect();
            most.sort_by_key(|&(ending, _)| std::cmp::Reverse(ending));
            let first = most.into_iter().find_map(|(_, wall)| Some((*wall, self.barrier(cluster, wall)?)));
            let Some((wall, made)) = first else { break };
            *barrier = Some(made);
            rest = before(&rest, &wall);
            cuts.retain(|cut| *cut != wall);
        }
        found
    }

    /// `wall` as a barrier that the side of `cluster` before it lies before; `None` where it is out of reach.
    fn barrier(&self, cluster: &Cluster, wall: &Wall) -> Option<Barrier> {
        let edge_m = self.test.edge_m;
        let middle = (self.voxel.as_vec3() + 0.5) * edge_m;
        let distance = -wall.beyond(middle) / edge_m;
        let is_before = |barrier: &Barrier| {
            let (towards, distance) = (barrier.towards(self.direction), barrier.middle_distance());
            let mut own = self.places(cluster).filter(|&place| wall.beyond(place) < 0.0);
            own.all(|place| towards.dot(place - middle) <= distance * edge_m)
        };
        (0..=STEPS_MAX)
            .filter_map(|steps| {
                Barrier::new(self.direction, wall.towards, distance + f32::from(steps) * STEP)
            })
            .find(is_before)
    }

    /// Whether `wall` cuts `cluster` into two, each worth a layer, between which nearly all ways are blocked.
    fn parts(&self, ground: &Ground, cluster: &Cluster, wall: &Wall) -> bool {
        let side =
            |is_far: bool| self.eyes(cluster, PARTED_EYES, |place| (wall.beyond(place) > 0.0) == is_far);
        self.has_both(cluster, wall) && self.test.parts(ground, &side(false), &side(true))
    }

    /// Whether more than slivers lie on both sides of `wall`.
    fn has_both(&self, cluster: &Cluster, wall: &Wall) -> bool {
        let is_far = |member: &u32| wall.beyond(self.samples[*member as usize].position) > 0.0;
        let far: f32 =
            cluster.members.iter().filter(|(member, _)| is_far(member)).map(|(_, area)| area).sum();
        let area_min = AREA_SHARE_MIN * self.test.edge_m * self.test.edge_m;
        far >= area_min && cluster.area - far >= area_min
    }

    /// What of `side` lies before `wall` and what lies behind it.
    fn cut(&self, Side { cluster, cuts }: &Side, wall: &Wall) -> [Side; 2] {
        [false, true].map(|is_far| {
            let own = |(member, _): &&(u32, f32)| {
                (wall.beyond(self.samples[*member as usize].position) > 0.0) == is_far
            };
            let made =
                |&(member, area): &(u32, f32)| Cluster::new(member, &self.samples[member as usize], area);
            let mut parts = cluster.members.iter().filter(own).map(made);
            let mut own_side = parts.next().expect("there is more than a sliver on either side");
            parts.for_each(|part| own_side.absorb(&part));
            let cut = if is_far { wall.turned() } else { *wall };
            Side { cluster: own_side, cuts: cuts.iter().copied().chain([cut]).collect() }
        })
    }

    fn places(&self, cluster: &Cluster) -> impl Iterator<Item = Vec3> {
        cluster.members.iter().map(|&(member, _)| self.samples[member as usize].position)
    }

    /// At most `count` places of `cluster` that `is_own` says, spread over its area; open ones where there are any.
    fn eyes(&self, cluster: &Cluster, count: usize, is_own: impl Fn(Vec3) -> bool) -> Vec<Vec3> {
        let samples = || cluster.members.iter().map(|&(member, area)| (area, &self.samples[member as usize]));
        let own = || samples().filter(|(_, sample)| is_own(sample.position));
        let is_open = |sample: &SurfaceSample| matches!(sample.exposure, Exposure::Open(_));
        let has_open = own().any(|(_, sample)| is_open(sample));
        let eyes: Vec<(f32, Vec3)> = own()
            .filter(|(_, sample)| !has_open || is_open(sample))
            .map(|(area, sample)| (area, sample.position))
            .collect();
        let total: f32 = eyes.iter().map(|(area, _)| area).sum();
        let (mut before, mut chosen) = (0.0, Vec::new());
        for (area, place) in eyes {
            before += area;
            if before >= total * (chosen.len() as f32 + 0.5) / count as f32 && chosen.len() < count {
                chosen.push(place);
            }
        }
        chosen
    }
}

#[cfg(test)]
#[path = "barriers/tests.rs"]
mod tests;
