//! Form factors of a triangle as seen from a point: discs, as many as its nearness asks for.
//!
//! `A cos cos / (pi d^2 + A)` is the form factor of a disc of area A (Wallace et al. 1989; GPU Gems 2, ch. 39).
//! It stays below one however near the disc is, but a triangle that is large against its distance is no disc, and
//! for what lies off the disc's axis its A is too much: a furnace lost 2.5 % of its light. So a triangle is split
//! until its parts are small, and small parts do without it, `A cos cos / (pi d^2)`; the disc is for the rest.

use earthshine_world::Vec3;
use std::f32::consts::PI;

/// Parts are split while an edge is longer than this share of their distance.
const EDGE_SHARE_MAX: f32 = 0.5;
/// How often; 4 parts each time.
const SPLITS_MAX: u32 = 5;

/// The four halves-of-edges parts of a triangle: one at each corner, and the middle one.
///
/// All face the way the whole does.
#[must_use]
pub fn quartered([a, b, c]: [Vec3; 3]) -> [[Vec3; 3]; 4] {
    let (ab, bc, ca) = ((a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5);
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [bc, ca, ab]]
}

/// Mean of the corners.
#[must_use]
pub fn centre([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (*a + *b + *c) / 3.0
}

/// m2.
#[must_use]
pub fn area([a, b, c]: &[Vec3; 3]) -> f32 {
    0.5 * (*b - *a).cross(*c - *a).length()
}

/// Share of the hemisphere about `normal` at `point` (cosine-weighted) that a disc of `area` m2 fills, which faces
/// `disc_normal` about `disc_centre`.
#[must_use]
pub fn disc(point: Vec3, normal: Vec3, disc_centre: Vec3, disc_normal: Vec3, area: f32) -> f32 {
    let offset = disc_centre - point;
    let (cosine, disc_cosine) = (normal.dot(offset), -disc_normal.dot(offset));
    if cosine <= 0.0 || disc_cosine <= 0.0 {
        return 0.0;
    }
    let square = offset.length_squared();
    area * cosine * disc_cosine / (square * (PI * square + area))
}

/// As [`disc`], for an area that is small against its distance whatever its outline.
fn small(point: Vec3, normal: Vec3, centre: Vec3, facing: Vec3, area: f32) -> f32 {
    let offset = centre - point;
    let (cosine, other_cosine) = (normal.dot(offset).max(0.0), -facing.dot(offset).min(0.0));
    let square = offset.length_squared();
    area * cosine * other_cosine / (PI * square * square)
}

/// Share of the hemisphere about `normal` at `point` (cosine-weighted) that `corners`, facing `facing`, fills where
/// `is_visible` says so of its parts' centres.
pub fn triangle(
    (point, normal): (Vec3, Vec3),
    corners: &[Vec3; 3],
    facing: Vec3,
    is_visible: &dyn Fn(Vec3) -> bool,
) -> f32 {
    parts((point, normal), corners, facing, SPLITS_MAX, is_visible)
}

fn parts(
    (point, normal): (Vec3, Vec3),
    corners: &[Vec3; 3],
    facing: Vec3,
    splits_left: u32,
    is_visible: &dyn Fn(Vec3) -> bool,
) -> f32 {
    let [a, b, c] = *corners;
    let is_behind = facing.dot(point - a) <= 0.0 || corners.iter().all(|&at| normal.dot(at - point) <= 0.0);
    if is_behind {
        return 0.0;
    }
    let centre = centre(corners);
    let edge = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    let distance = (centre - point).length_squared();
    let is_small = edge <= EDGE_SHARE_MAX * EDGE_SHARE_MAX * distance;
    if splits_left > 0 && !is_small {
        let part = |part: &[Vec3; 3]| parts((point, normal), part, facing, splits_left - 1, is_visible);
        return quartered(*corners).iter().map(part).sum();
    }
    let area = area(corners);
    let share = if is_small {
        small(point, normal, centre, facing, area)
    } else {
        disc(point, normal, centre, facing, area)
    };
    if share > 0.0 && is_visible(centre) { share } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lambert's formula: exact for a polygon above the horizon of `point`.
    fn exact(point: Vec3, normal: Vec3, corners: &[Vec3]) -> f32 {
        let edges =
            (0..corners.len()).map(|i| (corners[i] - point, corners[(i + 1) % corners.len()] - point));
        let sum: f32 = edges
            .map(|(from, to)| {
                let turn = from.cross(to);
                turn.normalize_or_zero().dot(normal) * turn.length().atan2(from.dot(to))
            })
            .sum();
        sum.abs() / (2.0 * PI)
    }

    #[test]
    fn a_disc_on_its_axis_is_exact() {
        // sin^2 of the half angle: R^2 / (R^2 + d^2).
        for (radius, distance) in [(1.0f32, 1.0f32), (0.3, 2.0), (5.0, 0.1)] {
            let found = disc(Vec3::ZERO, Vec3::Y, Vec3::Y * distance, Vec3::NEG_Y, PI * radius * radius);
            let expected = radius * radius / (radius * radius + distance * distance);
            assert!((found - expected).abs() < 1e-6, "{found} for {expected}");
        }
        assert_eq!(disc(Vec3::ZERO, Vec3::Y, Vec3::NEG_Y, Vec3::Y, 1.0), 0.0, "behind");
        assert_eq!(disc(Vec3::ZERO, Vec3::Y, Vec3::Y, Vec3::Y, 1.0), 0.0, "facing away");
    }

    #[test]
    fn triangles_near_and_far_are_within_two_percent_of_lambert() {
        let corners = [Vec3::new(0.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.0, 0.0, 1.0)];
        let facing = Vec3::X;
        for point in [(0.1, 0.3, 0.3), (0.2, 0.1, 0.2), (1.0, 0.0, 0.0), (3.0, -1.0, 2.0)] {
            let point = Vec3::from(point);
            let found = triangle((point, Vec3::NEG_X), &corners, facing, &|_| true);
            let expected = exact(point, Vec3::NEG_X, &corners);
            assert!((found / expected - 1.0).abs() < 0.02, "{point}: {found} for {expected}");
        }
        // Nearer than splits help.
        let near = Vec3::new(0.02, 0.3, 0.3);
        let found = triangle((near, Vec3::NEG_X), &corners, facing, &|_| true);
        assert!(found < 1.0 && found > 0.8, "{found}");
        // A floor next to it.
        for x in [0.02, 0.1, 0.5] {
            let point = Vec3::new(x, 0.0, 0.3);
            let found = triangle((point, Vec3::Y), &corners, facing, &|_| true);
            let expected = exact(point, Vec3::Y, &corners);
            assert!((found / expected - 1.0).abs() < 0.03, "{x}: {found} for {expected}");
        }
    }

    #[test]
    fn opposite_and_adjacent_unit_squares_have_their_closed_forms() {
        let square = |corner: Vec3, side: Vec3, up: Vec3| {
            [[corner, corner + side, corner + side + up], [corner, corner + side + up, corner + up]]
        };
        let mean = |source: [[Vec3; 3]; 2], facing: Vec3| {
            let at = |i: i32| (i as f32 + 0.5) / 16.0;
            let share = |i: i32| {
                let place = (Vec3::new(at(i % 16), 0.0, at(i / 16)), Vec3::Y);
                source.iter().map(|part| triangle(place, part, facing, &|_| true)).sum::<f32>()
            };
            (0..256).map(share).sum::<f32>() / 256.0
        };
        let opposite = mean(square(Vec3::Y, Vec3::X, Vec3::Z), Vec3::NEG_Y);
        assert!((opposite / 0.199_825 - 1.0).abs() < 0.01, "{opposite}");
        let adjacent = mean(square(Vec3::ZERO, Vec3::Y, Vec3::Z), Vec3::X);
        assert!((adjacent / 0.200_044 - 1.0).abs() < 0.01, "{adjacent}");
    }

    #[test]
    fn quarters_cover_the_whole_and_face_its_way() {
        let whole = [Vec3::ZERO, Vec3::X * 2.0, Vec3::Y * 3.0];
        let parts = quartered(whole);
        assert!((parts.iter().map(area).sum::<f32>() - area(&whole)).abs() < 1e-6);
        for [a, b, c] in parts {
            assert!((b - a).cross(c - a).z > 0.0);
        }
    }

    #[test]
    fn hidden_parts_do_not_count() {
        let corners = [Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.0, 0.0, 1.0)];
        let place = (Vec3::ZERO, Vec3::X);
        let whole = triangle(place, &corners, Vec3::NEG_X, &|_| true);
        let upper = triangle(place, &corners, Vec3::NEG_X, &|at| at.y > 0.3);
        assert!(upper > 0.0 && upper < whole);
        assert_eq!(triangle(place, &corners, Vec3::NEG_X, &|_| false), 0.0);
    }
}
