//! Form factors in closed form, between two points, and from two estimates of one exchange.
//!
//! The closed forms are oracles: rectangles that face each other or share an edge (J. R. Howell, A Catalog
//! of Radiation Heat Transfer Configuration Factors, C-11 and C-14). Ray-cast rows come from the bake.

use earthshine_world::Vec3;
use std::f64::consts::PI;

/// From a `width` x `height` rectangle to its twin straight opposite, `distance` away. All m, positive.
#[must_use]
pub fn parallel_rectangles(width: f64, height: f64, distance: f64) -> f64 {
    let (x, y) = (width / distance, height / distance);
    let (x_root, y_root) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    let logarithm = (x_root * y_root / (1.0 + x * x + y * y).sqrt()).ln();
    let sum = logarithm + x * y_root * (x / y_root).atan() + y * x_root * (y / x_root).atan()
        - x * x.atan()
        - y * y.atan();
    2.0 / (PI * x * y) * sum
}

/// From a floor, `depth` deep, to a wall, `height` high, that stands on its edge of `length`. All m, positive.
#[must_use]
pub fn perpendicular_rectangles(length: f64, depth: f64, height: f64) -> f64 {
    let (w, h) = (depth / length, height / length);
    let (w2, h2) = (w * w, h * h);
    let diagonal = (w2 + h2).sqrt();
    let angles = w * (1.0 / w).atan() + h * (1.0 / h).atan() - diagonal * (1.0 / diagonal).atan();
    let all = 1.0 + w2 + h2;
    let logarithm = ((1.0 + w2) * (1.0 + h2) / all).ln()
        + w2 * (w2 * all / ((1.0 + w2) * (w2 + h2))).ln()
        + h2 * (h2 * all / ((1.0 + h2) * (w2 + h2))).ln();
    (angles + 0.25 * logarithm) / (PI * w)
}

/// Share of what leaves a point at `from` that arrives at a small disc of `area` m2 at `to`, unoccluded:
/// `area cos cos / (pi r^2 + area)`. Normals are unit; zero if either faces away.
#[must_use]
pub fn point_to_disc(from: Vec3, from_normal: Vec3, to: Vec3, to_normal: Vec3, area: f32) -> f32 {
    let across = to - from;
    let (out, back) = (across.dot(from_normal), -across.dot(to_normal));
    if out <= 0.0 || back <= 0.0 {
        return 0.0;
    }
    let square = across.length_squared();
    area * out * back / (square * (std::f32::consts::PI * square + area))
}

/// One estimate of a form factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// `F_ij`.
    pub share: f64,
    /// `A_i`, m2. Positive.
    pub area: f64,
    /// How uncertain `A_i F_ij` is, up to a factor common to both estimates; zero is certain.
    pub variance: f64,
}

impl Estimate {
    /// An estimate by counting hits among `rays` rays.
    ///
    /// Hits are rare events: the variance of `A_i F_ij` is `A_i / rays` times the true exchange, and
    /// the exchange is common to both directions. (The variance *observed* is zero where no ray hit, and would
    /// turn every missed patch into certainty.)
    #[must_use]
    pub fn from_rays(share: f64, area: f64, rays: u32) -> Self {
        Self { share, area, variance: area / f64::from(rays.max(1)) }
    }
}

/// `F_ij` and `F_ji` that obey `A_i F_ij = A_j F_ji`: the mean of both exchanges, weighted by inverse variance.
#[must_use]
pub fn reciprocal(forth: Estimate, back: Estimate) -> (f64, f64) {
    let total = forth.variance + back.variance;
    let forth_weight = if total > 0.0 { back.variance / total } else { 0.5 };
    let exchange = forth_weight * forth.area * forth.share + (1.0 - forth_weight) * back.area * back.share;
    (exchange / forth.area, exchange / back.area)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_have_the_published_values() {
        let close = |value: f64, expected: f64| assert!((value - expected).abs() < 1e-6, "{value}");
        close(parallel_rectangles(1.0, 1.0, 1.0), 0.199_825);
        close(parallel_rectangles(1.0, 1.0, 0.1), 0.826_995);
        close(perpendicular_rectangles(1.0, 1.0, 1.0), 0.200_044);
        close(perpendicular_rectangles(1.0, 1.0, 2.0), 0.232_853);
    }

    #[test]
    fn the_faces_of_a_cube_see_only_each_other() {
        let sum = parallel_rectangles(1.0, 1.0, 1.0) + 4.0 * perpendicular_rectangles(1.0, 1.0, 1.0);
        assert!((sum - 1.0).abs() < 1e-12, "{sum}");
    }

    /// Goal: the point formula is the one the closed forms integrate. Method: midpoints of both squares.
    #[test]
    fn points_integrate_to_the_closed_form() {
        let cells = 16u16;
        let at = |i: u16| (f32::from(i) + 0.5) / f32::from(cells);
        let area = 1.0 / f32::from(cells * cells);
        let mut sum = 0.0f64;
        for (a, b) in (0..cells * cells).flat_map(|a| (0..cells * cells).map(move |b| (a, b))) {
            let from = Vec3::new(at(a % cells), 0.0, at(a / cells));
            let to = Vec3::new(at(b % cells), 1.0, at(b / cells));
            sum += f64::from(point_to_disc(from, Vec3::Y, to, Vec3::NEG_Y, area) * area);
        }
        assert!((sum - parallel_rectangles(1.0, 1.0, 1.0)).abs() < 1e-3, "{sum}");
    }

    #[test]
    fn the_surer_estimate_weighs_more_and_exchange_is_mutual() {
        let (forth, back) = (Estimate::from_rays(0.2, 2.0, 100), Estimate::from_rays(0.5, 1.0, 150));
        let (ij, ji) = reciprocal(forth, back);
        assert!((2.0 * ij - ji).abs() < 1e-12);
        // 50 rays a square metre against 150: a quarter of 0.4 and three quarters of 0.5.
        assert!((ji - 0.475).abs() < 1e-12, "{ji}");
        let certain = Estimate { variance: 0.0, ..back };
        assert_eq!(reciprocal(forth, certain).1, 0.5);
        assert_eq!(reciprocal(Estimate { variance: 0.0, ..forth }, certain).1, 0.45);
    }
}
