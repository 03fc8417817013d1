//! Walls that stand on a surface, or hang from it, near a detail voxel: where light that falls on it ends.
//!
//! From places on the surface short segments go along it, to where the detail voxel is read. A segment is blocked where one
//! close to the surface is and one higher up is too: kerbs and posts that light passes over or around are no walls. What
//! blocks one draws a line on the surface, and is a wall if nearly all segments that cross this line are blocked before it.

use crate::eye::Eye;
use crate::rows::patch_key;
use crate::sample::OFF_SURFACE;
use earthshine_scene::Scene;
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{Direction, Vec3, VoxelCoord};
use std::cell::Cell;

/// Places of a surface that are looked from, at most.
pub(crate) const EYES_MAX: usize = 8;
/// Segments of a surface, shared out among them: to other ones of them; the first ones to all around; and all of those where a
/// wall blocks any so far.
const SEGMENTS_FIRST: usize = 20;
const SEGMENTS_MAX: usize = 64;
/// Where segments end: so many edges from the middle along both axes. Who is further away does not read the voxel.
const TARGETS_WITHIN: f32 = 1.0;
/// How high above the surface segments lie, in edges, and at most this share of the way that is free there.
const HIGH: f32 = 0.25;
const LOW: f32 = 0.02;
const FREE_SHARE: f32 = 0.5;
/// What stands flatter on the surface, as the cosine between both normals, draws no line. So a wall is met by 0.58 of the
/// height farther away than its foot, and by thrice that on most slanting ways.
const STEEP_COSINE_MAX: f32 = 0.5;
const LEAN_MAX: f32 = 3.0 * 0.58;
/// Surfaces that face their direction less are read little on it, and have no walls.
const FACING_MIN: f32 = 0.3;
/// Least segments that say anything of a line, and the share of them that is blocked by a wall.
const CROSSING_MIN: usize = 3;
pub(crate) const BLOCKED_SHARE: f32 = 0.9;
/// A segment is blocked before a line if it is at most this far behind it, in edges.
const BEHIND_MAX: f32 = 0.05;

/// Lines that may part a surface, at most, and the cosine of the angle between those that are one.
const LINES_MAX: usize = 6;
const SAME_LINE_COSINE: f32 = 0.98;

/// A line across the axis of a direction that a wall draws.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wall {
    /// Unit vector, across the axis.
    pub(crate) towards: Vec3,
    /// How far along it, m.
    pub(crate) at: f32,
}

impl Wall {
    /// The same wall from its other side.
    pub(crate) fn turned(&self) -> Self {
        Self { towards: -self.towards, at: -self.at }
    }

    /// How far `place` lies behind it, m.
    pub(crate) fn beyond(&self, place: Vec3) -> f32 {
        self.towards.dot(place) - self.at
    }
}

/// What lies in one plane and faces one direction in a detail voxel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ground {
    pub(crate) voxel: VoxelCoord,
    pub(crate) direction: Direction,
    /// Unit normal.
    pub(crate) normal: Vec3,
    /// A place in its plane.
    pub(crate) place: Vec3,
}

impl Ground {
    /// Whether walls are looked for.
    pub(crate) fn is_facing(&self) -> bool {
        self.normal.dot(self.direction.vector()) > FACING_MIN
    }

    /// `place` moved along the direction's axis into the plane.
    fn in_plane(&self, place: Vec3) -> Vec3 {
        let axis = self.direction.vector();
        place + axis * ((self.place - place).dot(self.normal) / axis.dot(self.normal))
    }

    /// The line that a surface with `normal` through `place` draws, seen from `eye`.
    fn line(&self, normal: Vec3, place: Vec3, eye: Vec3) -> Option<Wall> {
        let axis = self.direction.axis();
        let share = normal[axis] / self.normal[axis];
        let mut across = normal - share * self.normal;
        across[axis] = 0.0;
        let length = across.length();
        let is_wall = normal.dot(self.normal).abs() <= STEEP_COSINE_MAX && length > f32::MIN_POSITIVE;
        let at = (normal.dot(place) - share * self.normal.dot(self.place)) / length;
        let wall = Wall { towards: across / length, at };
        let is_before = wall.beyond(eye) < 0.0;
        is_wall.then_some(if is_before { wall } else { wall.turned() })
    }
}

/// A place that segments begin at.
#[derive(Debug, Clone, Copy)]
struct Stand {
    place: Vec3,
    /// How high above it, m; the higher one first.
    heights: [f32; 2],
}

/// The way from one place to another.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Segment {
    from: Vec3,
    to: Vec3,
    /// Where both heights are blocked, as a share of the way: at the wall's foot; infinite where one is not.
    blocked: f32,
    /// What draws a line there.
    wall: Option<Wall>,
    /// An edge as a share of the way.
    edge: f32,
}

impl Segment {
    /// Whether it goes from before `wall` behind it.
    fn crosses(&self, wall: &Wall) -> bool {
        wall.beyond(self.from) < 0.0 && wall.beyond(self.to) > 0.0
    }

    fn is_blocked_before(&self, wall: &Wall) -> bool {
        self.blocked <= crossing(self.from, self.to, wall) + BEHIND_MAX * self.edge
    }
}

/// Where the way between two places crosses `wall`, as a share of it.
fn crossing(from: Vec3, to: Vec3, wall: &Wall) -> f32 {
    let (before, beyond) = (wall.beyond(from), wall.beyond(to));
    before / (before - beyond)
}

/// Looks for walls; one a thread.
#[derive(Debug)]
pub(crate) struct WallTest<'a> {
    /// The scene.
    pub(crate) tracer: Eye<'a>,
    /// Of detail voxels, m.
    pub(crate) edge_m: f32,
    /// Of the bake.
    pub(crate) seed: u64,
    /// Rays cast so far.
    pub(crate) cast: Cell<u64>,
}

impl WallTest<'_> {
    /// Segments along `ground` from `eyes`, at most [`EYES_MAX`] of its places, to all around.
    pub(crate) fn look(&self, ground: &Ground, eyes: &[Vec3]) -> Vec<Segment> {
        if eyes.is_empty() {
            return Vec::new();
        }
        let stands: Vec<Stand> = eyes.iter().map(|&eye| self.stand(ground, eye)).collect();
        let key = patch_key(ground.voxel, ground.direction.index());
        let (shift_x, shift_y) = unit_pair(hash(self.seed, Purpose::WallSegment, key, 0));
        let middle = (ground.voxel.as_vec3() + 0.5) * self.edge_m;
        let [across, up] = [1, 2].map(|step| (ground.direction.axis() + step) % 3);
        let segment = |number: usize| {
            // The plastic number spreads points of a square as the golden ratio does those of a line.
            let along = |shift: f32, step: f32| {
                let share = (shift + number as f32 * step).fract();
                (2.0 * share - 1.0) * TARGETS_WITHIN * self.edge_m
            };
            let mut target = middle;
            target[across] += along(shift_x, 0.754_877_7);
            target[up] += along(shift_y, 0.569_840_3);
            self.segment(ground, &stands[number % stands.len()], ground.in_plane(target))
        };
        let (count, step) = (eyes.len(), eyes.len().div_ceil(2));
        let among = |number: usize| self.segment(ground, &stands[number], eyes[(number + step) % count]);
        let mut segments: Vec<Segment> =
            (0..count).filter(|_| count > 1).map(among).chain((0..SEGMENTS_FIRST).map(segment)).collect();
        if segments.iter().any(|segment| segment.wall.is_some()) {
            segments.extend((SEGMENTS_FIRST..SEGMENTS_MAX).map(segment));
        }
        segments
    }

    /// Whether nearly all ways from `near` to `far` are blocked.
    pub(crate) fn parts(&self, ground: &Ground, near: &[Vec3], far: &[Vec3]) -> bool {
        let pairs = near.len() * far.len();
        let free_max = pairs as f32 * (1.0 - BLOCKED_SHARE);
        let mut free = 0.0;
        for &from in near {
            let stand = self.stand(ground, from);
            for &to in far {
                free += if self.segment(ground, &stand, to).blocked < 1.0 { 0.0 } else { 1.0 };
                if free > free_max {
                    return false;
                }
            }
        }
        pairs > 0
    }

    fn stand(&self, ground: &Ground, place: Vec3) -> Stand {
        let off_surface = OFF_SURFACE * self.edge_m;
        let free =
            self.closest(place + ground.normal * off_surface, ground.normal, HIGH / FREE_SHARE * self.edge_m);
        let high = free.map_or(HIGH * self.edge_m, |(free, _)| FREE_SHARE * (free + off_surface));
        Stand { place, heights: [high, high.min(LOW * self.edge_m)] }
    }

    fn segment(&self, ground: &Ground, stand: &Stand, to: Vec3) -> Segment {
        let from = stand.place;
        let flat = (to - from).reject_from_normalized(ground.normal);
        let length = flat.length().max(f32::MIN_POSITIVE);
        let edge = self.edge_m / length;
        let free = Segment { from, to, blocked: f32::INFINITY, wall: None, edge };
        let mut farthest = (0.0, None);
        for height in stand.heights {
            let (origin, way) = (from + ground.normal * height, flat / length);
            let reach = length + LEAN_MAX * height;
            let Some((distance, normal)) = self.closest(origin, way, reach) else { return free };
            if distance >= farthest.0 {
                farthest = (distance, ground.line(normal, origin + way * distance, from));
            }
        }
        // Where a slanted wall stands on the surface, not where it is met above it.
        let (distance, wall) = farthest;
        let foot =
            wall.map(|wall| crossing(from, to, &wall)).filter(|share| share.is_finite() && *share >= 0.0);
        Segment { blocked: foot.unwrap_or(distance / length), wall, ..free }
    }

    /// How far a ray gets, m, and the normal of what stops it.
    fn closest(&self, origin: Vec3, direction: Vec3, distance_max: f32) -> Option<(f32, Vec3)> {
        self.cast.set(self.cast.get() + 1);
        let scene: &Scene = self.tracer.scene();
        let hit = self.tracer.closest(origin, direction, distance_max)?;
        Some((hit.distance, scene.normal(hit.triangle)))
    }
}

/// How many of `segments` end at `wall`, if it is one: if nearly all that cross its line are blocked before it.
pub(crate) fn ends_at(segments: &[Segment], wall: &Wall) -> Option<usize> {
    let (mut count, mut blocked) = (0, 0);
    for segment in segments.iter().filter(|segment| segment.crosses(wall)) {
        count += 1;
        blocked += usize::from(segment.is_blocked_before(wall));
    }
    (count >= CROSSING_MIN && blocked as f32 >= BLOCKED_SHARE * count as f32).then_some(blocked)
}

/// The lines at which `segments` end, those that most do first.
pub(crate) fn walls_of(segments: &[Segment]) -> Vec<Wall> {
    let drawn = segments.iter().filter_map(|segment| segment.wall);
    let mut walls: Vec<(usize, Wall)> =
        drawn.filter_map(|wall| Some((ends_at(segments, &wall)?, wall))).collect();
    walls.sort_by_key(|&(ending, _)| std::cmp::Reverse(ending));
    walls.into_iter().map(|(_, wall)| wall).collect()
}

/// The lines that any of `segments` is blocked at, those that most are first, each once; `edge_m` is a voxel's.
pub(crate) fn lines_of(segments: &[Segment], edge_m: f32) -> Vec<Wall> {
    let mut lines: Vec<(usize, Wall)> = Vec::new();
    for wall in segments.iter().filter_map(|segment| segment.wall) {
        let is_same = |other: &Wall| {
            other.towards.dot(wall.towards) > SAME_LINE_COSINE
                && (other.at - wall.at).abs() < BEHIND_MAX * edge_m
        };
        match lines.iter_mut().find(|(_, other)| is_same(other)) {
            Some((count, _)) => *count += 1,
            None => lines.push((1, wall)),
        }
    }
    lines.sort_by_key(|&(count, _)| std::cmp::Reverse(count));
    lines.into_iter().map(|(_, wall)| wall).take(LINES_MAX).collect()
}

/// `segments` that do not cross `wall`.
pub(crate) fn before(segments: &[Segment], wall: &Wall) -> Vec<Segment> {
    segments.iter().filter(|segment| !segment.crosses(wall)).copied().collect()
}
