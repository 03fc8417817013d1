//! Directions over the hemisphere: cosine-weighted, from evenly spread pairs of numbers.

use earthshine_world::Vec3;

/// Unit direction about unit `normal` with density `cos / pi`, from `(u, v)` in `[0, 1)`.
#[must_use]
pub fn cosine_direction(normal: Vec3, u: f32, v: f32) -> Vec3 {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let radius = u.sqrt();
    let (sin, cos) = (v * std::f32::consts::TAU).sin_cos();
    let up = (1.0 - u).max(0.0).sqrt();
    (tangent * (radius * cos) + bitangent * (radius * sin) + normal * up).normalize_or(normal)
}

/// Pair `index` of the R2 sequence (M. Roberts, 2018), shifted by `(shift_u, shift_v)`: any run of
/// consecutive indices covers the square evenly, so that a share of the rays is as well spread as all.
#[must_use]
pub fn spread_pair(index: u32, shift_u: f32, shift_v: f32) -> (f32, f32) {
    // 1/g and 1/g^2 for the plastic number g, as 32-bit fractions: exact for any index.
    const STEP_U: u32 = 3_242_174_889;
    const STEP_V: u32 = 2_447_445_414;
    let fraction = |step: u32, shift: f32| {
        let turn = index.wrapping_mul(step) >> 8;
        let value = turn as f32 * (1.0 / (1u32 << 24) as f32) + shift;
        (value - value.floor()).min(1.0 - f32::EPSILON)
    };
    (fraction(STEP_U, shift_u), fraction(STEP_V, shift_v))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_cosine_is_two_thirds() {
        let normal = Vec3::new(0.2, -0.9, 0.4).normalize_or_zero();
        let count = 4096;
        let mean = (0..count)
            .map(|i| {
                let (u, v) = spread_pair(i, 0.3, 0.7);
                cosine_direction(normal, u, v).dot(normal)
            })
            .sum::<f32>()
            / count as f32;
        assert!((mean - 2.0 / 3.0).abs() < 1e-3, "{mean}");
    }
}
