//! Whether two estimates of the same light agree within their noise.
//!
//! A point agrees within `k` when the difference of its two lights (channels averaged) is at most `k` combined standard
//! errors, `k sqrt(s1^2 + s2^2)`. For two unbiased estimates with normal errors 95.4 % of the points agree within two
//! and 99.7 % within three; standard errors of averaged channels are averaged, as if the channels were fully
//! correlated, which a path's are to all but its colour.

use crate::csv::ReferencePoint;
use earthshine_world::Rgb;

/// How well two lists of light agree.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Agreement {
    /// Points compared.
    pub points: usize,
    /// Share of the points within two combined standard errors.
    pub within_two: f64,
    /// Share of the points within three combined standard errors.
    pub within_three: f64,
    /// Median over points of the combined standard error relative to the light there.
    pub combined_noise_rel: f64,
    /// Mean difference over mean light of the second.
    pub bias: f64,
    /// Standard error of that bias.
    pub bias_noise: f64,
    /// Root of the mean squared difference in combined standard errors: 1 where noise explains all.
    pub deviation_rms: f64,
}

/// A point whose lights differ by more than two combined standard errors.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ApartPoint {
    /// Place in both lists.
    pub point: usize,
    /// m.
    pub position: [f32; 3],
    /// First less second light, in combined standard errors; infinite where both claim to be exact.
    pub deviation: f64,
    /// First light over the second, less one.
    pub difference_rel: f64,
}

/// The points that [`Agreement::within_two`] leaves out, in the order of the lists.
#[must_use]
pub fn apart(ours: &[ReferencePoint], theirs: &[ReferencePoint]) -> Vec<ApartPoint> {
    let pairs = ours.iter().zip(theirs).enumerate();
    let found = pairs.map(|(point, (a, b))| {
        let (difference, spread) = (mean(a.irradiance) - mean(b.irradiance), spread(a, b));
        ApartPoint {
            point,
            position: b.position.to_array(),
            deviation: if difference == 0.0 { 0.0 } else { difference / spread },
            difference_rel: difference / mean(b.irradiance),
        }
    });
    found.filter(|found| found.deviation.abs() > 2.0).collect()
}

/// Of the channels.
fn mean(rgb: Rgb) -> f64 {
    rgb.as_dvec3().element_sum() / 3.0
}

/// Combined standard error.
fn spread(a: &ReferencePoint, b: &ReferencePoint) -> f64 {
    mean(a.standard_error).hypot(mean(b.standard_error))
}

/// Compares `ours` with `theirs`, point by point; `None` without points or light.
#[must_use]
pub fn agreement(ours: &[ReferencePoint], theirs: &[ReferencePoint]) -> Option<Agreement> {
    let pairs: Vec<(f64, f64, f64)> = ours
        .iter()
        .zip(theirs)
        .map(|(a, b)| (mean(a.irradiance) - mean(b.irradiance), spread(a, b), mean(b.irradiance)))
        .collect();
    let count = pairs.len() as f64;
    let light: f64 = pairs.iter().map(|pair| pair.2).sum();
    if pairs.is_empty() || light <= 0.0 {
        return None;
    }
    // Exact light on both sides agrees with itself.
    let within = |k: f64| pairs.iter().filter(|(d, s, _)| d.abs() <= k * s).count() as f64 / count;
    let deviations = pairs.iter().filter(|(_, s, _)| *s > 0.0).map(|(d, s, _)| (d / s).powi(2));
    let mut noise: Vec<f64> =
        pairs.iter().filter(|pair| pair.2 > 0.0).map(|(_, s, light)| s / light).collect();
    noise.sort_by(f64::total_cmp);
    Some(Agreement {
        points: pairs.len(),
        within_two: within(2.0),
        within_three: within(3.0),
        combined_noise_rel: noise.get(noise.len() / 2).copied().unwrap_or(0.0),
        bias: pairs.iter().map(|pair| pair.0).sum::<f64>() / light,
        bias_noise: pairs.iter().map(|pair| pair.1.powi(2)).sum::<f64>().sqrt() / light,
        deviation_rms: (deviations.sum::<f64>() / count).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::Vec3;
    use earthshine_world::random::{Purpose, hash, unit_pair};

    /// Normal errors of the stated size around ten, by Box and Muller.
    fn noisy(count: u64, stated: f32, scale: f32, seed: u64) -> Vec<ReferencePoint> {
        let point = |index| {
            let (a, b) = unit_pair(hash(seed, Purpose::Simulation, index, 0));
            let normal = (-2.0 * (1.0 - a).ln()).sqrt() * (std::f32::consts::TAU * b).cos();
            ReferencePoint {
                position: Vec3::ZERO,
                normal: Vec3::Y,
                irradiance: Rgb::splat(10.0 + normal * stated * scale),
                standard_error: Rgb::splat(stated),
            }
        };
        (0..count).map(point).collect()
    }

    #[test]
    fn honest_noise_agrees_as_often_as_the_normal_distribution_says() {
        let found = agreement(&noisy(20_000, 0.1, 1.0, 1), &noisy(20_000, 0.2, 1.0, 2)).unwrap();
        assert!((found.within_two - 0.9545).abs() < 0.006, "{found:?}");
        assert!((found.within_three - 0.9973).abs() < 0.002, "{found:?}");
        assert!((found.deviation_rms - 1.0).abs() < 0.03 && found.bias.abs() < 3.0 * found.bias_noise);
        let apart = apart(&noisy(20_000, 0.1, 1.0, 1), &noisy(20_000, 0.2, 1.0, 2));
        assert!((1.0 - apart.len() as f64 / 20_000.0 - found.within_two).abs() < 1e-9);
        assert!(apart.iter().all(|point| point.deviation * point.difference_rel > 0.0));
    }

    #[test]
    fn understated_noise_and_bias_are_seen() {
        let found = agreement(&noisy(5_000, 0.1, 3.0, 1), &noisy(5_000, 0.1, 3.0, 2)).unwrap();
        assert!(found.within_two < 0.6, "{found:?}");
        let mut brighter = noisy(5_000, 0.1, 1.0, 1);
        brighter.iter_mut().for_each(|point| point.irradiance *= 1.1);
        let found = agreement(&brighter, &noisy(5_000, 0.1, 1.0, 2)).unwrap();
        assert!((found.bias - 0.1).abs() < 0.002 && found.within_three < 0.05, "{found:?}");
        assert_eq!(agreement(&[], &[]), None);
    }
}
