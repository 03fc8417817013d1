//! An edge-aware mip chain: means over blocks of pixels that lie on one surface.
//!
//! Each level joins the groups of four blocks where normals and planes agree, so a group never crosses an
//! edge. A pixel takes the mean of its group on the top level. Groups are disjoint and every member gets the
//! same mean, so the filter keeps both a constant and the sum of all pixels, exactly. Blocks would show;
//! the mean over several shifted chains smooths them, and a mean of such filters keeps sums and constants too.
//!
//! Not here: what is filtered.

use super::g_buffer::GBuffer;
use earthshine_trace::hemisphere::spread_pair;
use earthshine_world::Vec3;
use glam::Vec4;
use rayon::prelude::*;

/// Most levels of a chain: blocks of 256 x 256 pixels.
pub const LEVELS_MAX: u32 = 8;
/// Chains at different offsets whose mean is taken.
const SHIFTS: u32 = 16;
/// Groups join while their normals are within this cosine (25 degrees).
const NORMAL_COSINE_MIN: f32 = 0.906;
/// Groups join while one lies within this slope of the other's plane.
const PLANE_SLOPE_MAX: f32 = 0.1;

/// How far the filter reaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// Levels: blocks of `2^levels` pixels; at most [`LEVELS_MAX`].
    pub levels: u32,
    /// Groups join while their centres are nearer than this, m.
    pub distance_m: f32,
}

/// Means of `values` (one a pixel) over surfaces; pixels without a surface keep theirs.
///
/// # Panics
/// If `values` are not one a pixel.
#[must_use]
pub fn filter(buffer: &GBuffer, values: &[Vec4], reach: Reach) -> Vec<Vec4> {
    assert_eq!(values.len(), buffer.texels().len(), "one value a pixel");
    let levels = reach.levels.min(LEVELS_MAX);
    if levels == 0 {
        return values.to_vec();
    }
    let edge = (1u32 << levels) as f32;
    let chains: Vec<Vec<Vec4>> = (0..SHIFTS)
        .into_par_iter()
        .map(|shift| {
            let (x, y) = spread_pair(shift, 0.0, 0.0);
            chain_means(buffer, values, ((x * edge) as u32, (y * edge) as u32), Reach { levels, ..reach })
        })
        .collect();
    (0..values.len())
        .into_par_iter()
        .map(|pixel| chains.iter().map(|chain| chain[pixel]).sum::<Vec4>() / SHIFTS as f32)
        .collect()
}

/// Pixels of one block on one surface.
#[derive(Debug, Clone, Copy)]
struct Group {
    sum: Vec4,
    normals: Vec3,
    positions: Vec3,
    footprints: f32,
    pixels: f32,
}

impl Group {
    fn centre(&self) -> Vec3 {
        self.positions / self.pixels
    }

    fn joins(&self, other: &Self, distance_max_m: f32) -> bool {
        let one = self.normals.normalize_or(Vec3::Y);
        let two = other.normals.normalize_or(Vec3::Y);
        if one.dot(two) < NORMAL_COSINE_MIN {
            return false;
        }
        let offset = other.centre() - self.centre();
        let distance = offset.length();
        let height = one.dot(offset).abs().max(two.dot(offset).abs());
        // Half a pixel: rounding of nearly coincident centres has any slope.
        let rounding = 0.25 * (self.footprints / self.pixels + other.footprints / other.pixels);
        distance <= distance_max_m && height <= PLANE_SLOPE_MAX * distance + rounding
    }

    fn take(&mut self, other: &Self) {
        self.sum += other.sum;
        self.normals += other.normals;
        self.positions += other.positions;
        self.footprints += other.footprints;
        self.pixels += other.pixels;
    }
}

/// The groups of one level: those of block `b` are `starts[b]..starts[b + 1]`.
struct Level {
    across: u32,
    down: u32,
    starts: Vec<u32>,
    groups: Vec<Group>,
}

fn chain_means(buffer: &GBuffer, values: &[Vec4], shift: (u32, u32), reach: Reach) -> Vec<Vec4> {
    let (mut level, leaf_of) = leaves(buffer, values, shift);
    let mut ancestor: Vec<u32> = (0..level.groups.len() as u32).collect();
    for _ in 0..reach.levels {
        let (above, parents) = joined(&level, reach.distance_m);
        for place in &mut ancestor {
            *place = parents[*place as usize];
        }
        level = above;
    }
    let mean = |leaf: u32| {
        let group = &level.groups[ancestor[leaf as usize] as usize];
        group.sum / group.pixels
    };
    leaf_of.iter().zip(values).map(|(leaf, &value)| leaf.map_or(value, mean)).collect()
}

/// The pixels as groups of one, moved by `shift`; and the leaf of each pixel.
fn leaves(buffer: &GBuffer, values: &[Vec4], shift: (u32, u32)) -> (Level, Vec<Option<u32>>) {
    let (width, height) = (buffer.camera().width(), buffer.camera().height());
    let (across, down) = (width + shift.0, height + shift.1);
    let mut level = Level { across, down, starts: vec![0], groups: Vec::with_capacity(values.len()) };
    let mut leaf_of = vec![None; values.len()];
    for y in 0..down {
        for x in 0..across {
            if x >= shift.0 && y >= shift.1 {
                let index = ((y - shift.1) * width + (x - shift.0)) as usize;
                if let Some(texel) = &buffer.texels()[index] {
                    leaf_of[index] = Some(level.groups.len() as u32);
                    level.groups.push(Group {
                        sum: values[index],
                        normals: texel.vertex.normal,
                        positions: texel.vertex.position,
                        footprints: texel.footprint_m,
                        pixels: 1.0,
                    });
                }
            }
            level.starts.push(level.groups.len() as u32);
        }
    }
    (level, leaf_of)
}

/// The next level, and the parent of each group.
fn joined(below: &Level, distance_max_m: f32) -> (Level, Vec<u32>) {
    let (across, down) = (below.across.div_ceil(2), below.down.div_ceil(2));
    let mut above = Level { across, down, starts: vec![0], groups: Vec::new() };
    let mut parents = vec![0; below.groups.len()];
    for y in 0..down {
        for x in 0..across {
            let first = above.groups.len();
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let (cx, cy) = (2 * x + dx, 2 * y + dy);
                if cx >= below.across || cy >= below.down {
                    continue;
                }
                let block = (cy * below.across + cx) as usize;
                for child in below.starts[block]..below.starts[block + 1] {
                    let group = below.groups[child as usize];
                    let home = (first..above.groups.len())
                        .find(|&parent| above.groups[parent].joins(&group, distance_max_m));
                    parents[child as usize] = home.unwrap_or(above.groups.len()) as u32;
                    match home {
                        Some(parent) => above.groups[parent].take(&group),
                        None => above.groups.push(group),
                    }
                }
            }
            above.starts.push(above.groups.len() as u32);
        }
    }
    (above, parents)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pinhole;
    use crate::test_scenes::{SceneBuilder, grey};
    use crate::tracer::SceneTracer;
    use earthshine_world::random::{Purpose, hash, unit_f32};

    const REACH: Reach = Reach { levels: 5, distance_m: f32::INFINITY };

    /// Floor and wall of a room with sky above, seen by 61 x 47 pixels: sizes that no block divides.
    fn corner_view() -> GBuffer {
        let mut builder = SceneBuilder::default();
        let wall = builder.material(grey(0.5));
        builder.quad(Vec3::new(-5.0, 0.0, 0.0), Vec3::Z * 9.0, Vec3::X * 9.0, wall);
        builder.quad(Vec3::new(-5.0, 0.0, 0.0), Vec3::X * 9.0, Vec3::Y * 1.2, wall);
        let camera = Pinhole::new(Vec3::new(0.0, 1.5, 4.0), Vec3::new(0.2, 0.4, 0.0), 60.0, 61, 47).unwrap();
        GBuffer::trace(&SceneTracer::new(&builder.scene), &camera)
    }

    fn noise(count: usize) -> Vec<Vec4> {
        let number =
            |i: usize, k: u64| unit_f32(hash(3, Purpose::MeasurePoint, i as u64, k)) * 10f32.powi(k as i32);
        (0..count).map(|i| Vec4::new(number(i, 0), number(i, 1), number(i, 2), number(i, 3))).collect()
    }

    fn sum(values: &[Vec4]) -> glam::DVec4 {
        values.iter().map(|value| value.as_dvec4()).sum()
    }

    #[test]
    fn sums_are_kept_and_noise_is_not() {
        let buffer = corner_view();
        let values = noise(buffer.texels().len());
        let filtered = filter(&buffer, &values, REACH);
        let (before, after) = (sum(&values), sum(&filtered));
        assert!(((after - before) / before).abs().max_element() < 1e-5, "{before} {after}");
        let spread = |values: &[Vec4]| {
            let on_surface = values.iter().zip(buffer.texels()).filter(|(_, texel)| texel.is_some());
            on_surface.map(|(value, _)| f64::from((value.x - 0.5).powi(2))).sum::<f64>()
        };
        assert!(spread(&filtered) < 0.02 * spread(&values), "{} {}", spread(&filtered), spread(&values));
    }

    #[test]
    fn constants_stay() {
        let buffer = corner_view();
        let values = vec![Vec4::new(3.0, 0.25, 7.0, 1.0); buffer.texels().len()];
        for (&found, &value) in filter(&buffer, &values, REACH).iter().zip(&values) {
            assert!((found - value).abs().max_element() < 1e-5, "{found}");
        }
    }

    #[test]
    fn edges_are_not_crossed() {
        let buffer = corner_view();
        let value = |normal: Vec3| if normal.y > 0.5 { Vec4::ONE } else { Vec4::ZERO };
        let values: Vec<Vec4> = buffer
            .texels()
            .iter()
            .map(|texel| texel.map_or(Vec4::splat(9.0), |texel| value(texel.vertex.normal)))
            .collect();
        assert!(values.contains(&Vec4::ONE) && values.contains(&Vec4::ZERO));
        assert!(values.contains(&Vec4::splat(9.0)), "the sky is in view");
        for (found, right) in filter(&buffer, &values, REACH).iter().zip(&values) {
            assert!((*found - *right).abs().max_element() < 1e-6, "{found} for {right}");
        }
    }

    #[test]
    fn steps_of_parallel_planes_are_not_crossed() {
        let mut builder = SceneBuilder::default();
        let wall = builder.material(grey(0.5));
        builder.plate(0.0, 8.0, true, wall);
        builder.plate(0.5, 1.0, true, wall);
        let camera = Pinhole::new(Vec3::new(0.0, 4.0, 0.0), Vec3::ZERO, 60.0, 64, 64).unwrap();
        let buffer = GBuffer::trace(&SceneTracer::new(&builder.scene), &camera);
        let height = |texel: &Option<super::super::g_buffer::Texel>| {
            Vec4::splat(texel.map_or(0.0, |texel| texel.vertex.position.y))
        };
        let values: Vec<Vec4> = buffer.texels().iter().map(height).collect();
        let found = filter(&buffer, &values, Reach { levels: 3, ..REACH });
        assert!(values.iter().any(|value| value.x > 0.4));
        for (found, right) in found.iter().zip(&values) {
            assert!((found.x - right.x).abs() < 1e-4, "{found} for {right}");
        }
    }

    #[test]
    fn reach_bounds_how_far_light_travels() {
        let buffer = corner_view();
        let mut values = vec![Vec4::ZERO; buffer.texels().len()];
        let centre = 40 * 61 + 30;
        values[centre] = Vec4::ONE;
        let from = buffer.texels()[centre].expect("the floor").vertex.position;
        let reached = |distance_m: f32| {
            let found = filter(&buffer, &values, Reach { levels: 6, distance_m });
            let places = found.iter().zip(buffer.texels()).filter(|(value, _)| value.x > 0.0);
            places
                .filter_map(|(_, texel)| texel.as_ref())
                .map(|texel| (texel.vertex.position - from).length())
                .fold(0.0, f32::max)
        };
        assert!(reached(0.2) < 0.8, "{}", reached(0.2));
        assert!(reached(f32::INFINITY) > 1.5, "{}", reached(f32::INFINITY));
    }
}
