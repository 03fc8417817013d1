//! Sample points on surfaces: every piece of every triangle, each side its own.
//!
//! A point stands for an area `s_p`; the areas of a triangle's points add up to it. Every piece that a
//! voxel cuts from a triangle gets at least one point, so that no surface a ray can hit lacks a patch.

use crate::clip::{Polygon, clip_to_cells};
use crate::exposure::Exposure;
use crate::places::Place;
use earthshine_scene::Scene;
use earthshine_tiles::BakeParameters;
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{AxisWeights, Direction, Rgb, Vec3, VoxelCoord};
use xxhash_rust::xxh3::xxh3_64;

/// Share of a voxel's edge by which points are moved off their surface when their voxel is looked up, so
/// that a wall in a face of the grid belongs to the voxel it faces.
pub(crate) const OFF_SURFACE: f32 = 1e-3;

/// Directions with less weight than this are left out and the others scaled up: a wall that is out of true
/// by two degrees has no patch sideways.
const WEIGHT_MIN: f32 = 2e-3;

/// Points are moved this share of a voxel's edge towards the middle of their triangle: a ray that begins in
/// the very edge of a room could slip out through it.
pub(crate) const OFF_EDGE: f32 = 1e-3;

/// A point on one side of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceSample {
    /// m.
    pub position: Vec3,
    /// Unit normal of the side.
    pub normal: Vec3,
    /// Twice its triangle's index, plus one on the back: see [`side_of`].
    pub side: u32,
    /// The voxel it belongs to.
    pub voxel: VoxelCoord,
    /// Area it stands for, m2.
    pub area: f32,
    /// Diffuse reflectance.
    pub reflectance: Rgb,
    /// `pi * L` that leaves this side, lm/m2.
    pub emission: Rgb,
    /// Whether it counts, and how much.
    pub exposure: Exposure,
    /// Whether it sees so many backs that it is buried unless light is found.
    pub is_suspect: bool,
}

impl SurfaceSample {
    /// What its random numbers hang on.
    #[must_use]
    pub fn key(&self) -> u64 {
        xxh3_64(bytemuck::bytes_of(&[self.position, self.normal]))
    }

    /// Where it lies.
    #[must_use]
    pub fn place(&self) -> Place {
        let Self { side, voxel, position, normal, emission, .. } = *self;
        Place { side, voxel, position, normal, emits: emission != Rgb::ZERO }
    }
}

/// The number of a side of a triangle.
#[must_use]
pub fn side_of(triangle: usize, front: bool) -> u32 {
    triangle as u32 * 2 + u32::from(!front)
}

/// The voxel that a point on a side with unit `normal` belongs to. The one rule for points and for hits.
#[must_use]
pub fn voxel_of(position: Vec3, normal: Vec3, voxel_edge_m: f32) -> VoxelCoord {
    ((position + normal * (OFF_SURFACE * voxel_edge_m)) / voxel_edge_m).floor().as_ivec3()
}

/// Weights of a side's directions, with negligible ones left out. The one rule for points and for hits.
#[must_use]
pub fn side_weights(weights: AxisWeights, normal: Vec3) -> [(Direction, f32); 3] {
    let mut shares = weights.of(normal);
    let total: f32 = shares.iter().map(|(_, w)| w).sum();
    for (_, weight) in &mut shares {
        if *weight < WEIGHT_MIN {
            *weight = 0.0;
        }
    }
    let kept: f32 = shares.iter().map(|(_, w)| w).sum();
    shares.map(|(direction, weight)| (direction, weight * total / kept.max(f32::MIN_POSITIVE)))
}

/// The voxels from the first to the last, both included.
pub type VoxelBox = (VoxelCoord, VoxelCoord);

/// All voxels there are.
pub const EVERYWHERE: VoxelBox = (VoxelCoord::MIN, VoxelCoord::MAX);

/// Covers what lies in `within` of both sides of triangle `triangle` with points and hands them to `each`.
///
/// Its random numbers hang on its corners, not on its number: triangles elsewhere do not matter.
pub fn sample_triangle(
    scene: &Scene,
    triangle: usize,
    parameters: &BakeParameters,
    within: VoxelBox,
    mut each: impl FnMut(SurfaceSample),
) {
    let material = &scene.materials[scene.material_of[triangle] as usize];
    let normal = scene.normal(triangle);
    let edge = parameters.grid.voxel_edge_m;
    let off_edge = OFF_EDGE * edge;
    let point_area = edge * edge / parameters.samples_per_voxel_face.max(1) as f32;
    let corners = xxh3_64(bytemuck::bytes_of(&scene.triangles[triangle]));
    for front in [true, false] {
        if !front && !parameters.two_sided && !material.double_sided {
            continue;
        }
        let side_normal = if front { normal } else { -normal };
        let shift = side_normal * (OFF_SURFACE * edge);
        let shifted = scene.triangles[triangle].map(|corner| corner + shift);
        clip_to_cells(shifted, edge, within, |voxel, polygon| {
            let piece = crate::rows::patch_key(voxel, usize::from(front));
            let key = hash(parameters.seed, Purpose::SamplePoint, corners, piece);
            cover(polygon, point_area, key, |shifted_position, area| {
                let position = inset(scene.triangles[triangle], shifted_position - shift, off_edge);
                let (u, v) = barycentric(scene.triangles[triangle], position);
                let surface = scene.surface(triangle, u, v, front);
                if !surface.is_hole {
                    each(SurfaceSample {
                        position,
                        normal: side_normal,
                        side: side_of(triangle, front),
                        voxel,
                        area,
                        reflectance: surface.reflectance,
                        emission: surface.emitted_radiance * std::f32::consts::PI,
                        exposure: Exposure::Open(1.0),
                        is_suspect: false,
                    });
                }
            });
        });
    }
}

/// Spreads points evenly over `polygon`, one for each `point_area` of it and at least one.
fn cover(polygon: &Polygon, point_area: f32, key: u64, mut each: impl FnMut(Vec3, f32)) {
    let area = polygon.area();
    let count = ((area / point_area).ceil() as u32).clamp(1, 4096);
    let (shift_u, shift_v) = unit_pair(key);
    for index in 0..count {
        let along = (index as f32 + shift_u) / count as f32 * area;
        // The golden ratio spreads the second number against the first.
        let across = (shift_v + index as f32 * 0.618_034).fract();
        each(point_at(polygon, along, across), area / count as f32);
    }
}

/// The point that has `along` m2 of the polygon's fan before it, and `across` (0..1) along the cut there.
fn point_at(polygon: &Polygon, along: f32, across: f32) -> Vec3 {
    let mut before = 0.0;
    let mut last = polygon.corners()[0];
    for [a, b, c] in polygon.fan() {
        let area = (b - a).cross(c - a).length() * 0.5;
        if along < before + area && area > 0.0 {
            let t = ((along - before) / area).clamp(0.0, 1.0).sqrt();
            return a + (b - a) * (t * (1.0 - across)) + (c - a) * (t * across);
        }
        before += area;
        last = (a + b + c) / 3.0;
    }
    last
}

/// `position` moved at most `distance` towards the middle of its triangle, and never far compared with it.
pub(crate) fn inset([a, b, c]: [Vec3; 3], position: Vec3, distance: f32) -> Vec3 {
    let inwards = (a + b + c) / 3.0 - position;
    position + inwards.clamp_length_max(distance.min(inwards.length() * 0.1))
}

fn barycentric([a, b, c]: [Vec3; 3], point: Vec3) -> (f32, f32) {
    let (e1, e2, p) = (b - a, c - a, point - a);
    let normal = e1.cross(e2);
    let scale = 1.0 / normal.length_squared().max(f32::MIN_POSITIVE);
    ((p.cross(e2).dot(normal) * scale).clamp(0.0, 1.0), (e1.cross(p).dot(normal) * scale).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_cover_a_polygon_evenly() {
        let polygon = Polygon::triangle([Vec3::ZERO, Vec3::X * 2.0, Vec3::Y * 2.0]);
        let (mut sum, mut area, mut count) = (Vec3::ZERO, 0.0, 0);
        cover(&polygon, 2.0 / 500.0, 99, |point, share| {
            sum += point;
            area += share;
            count += 1;
        });
        assert_eq!(count, 500);
        assert!((area - 2.0).abs() < 1e-4);
        assert!((sum / 500.0 - Vec3::new(2.0 / 3.0, 2.0 / 3.0, 0.0)).length() < 0.01);
    }

    #[test]
    fn a_wall_in_a_face_of_the_grid_belongs_to_the_voxel_it_faces() {
        assert_eq!(voxel_of(Vec3::new(1.0, 0.5, 0.5), Vec3::X, 1.0).x, 1);
        assert_eq!(voxel_of(Vec3::new(1.0, 0.5, 0.5), Vec3::NEG_X, 1.0).x, 0);
    }

    #[test]
    fn nearly_true_walls_have_one_direction_and_weights_still_sum_to_one() {
        let leaning = Vec3::new(0.03, 0.999_55, 0.0);
        let weights = side_weights(AxisWeights::Squared, leaning);
        assert_eq!(weights[0].1, 0.0);
        assert!((weights[1].1 - 1.0).abs() < 1e-5);
    }
}
