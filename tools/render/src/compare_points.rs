//! Errors of light at points against a reference: the figures a bake is accepted on.
//!
//! A point's light is the mean of its three channels. Differences are taken relative to the reference
//! there, but to no less than [`DARK_SHARE`] of the mean reference: in near-black corners a ratio
//! measures nothing that anyone sees.

use crate::csv::ReferencePoint;
use earthshine_world::Rgb;

/// Differences are relative to at least this share of the mean reference.
pub const DARK_SHARE: f64 = 0.01;

/// Points with less than this share of the mean reference are unlit: sealed hollows between walls, which nothing but a lamp
/// carried inside would light.
const UNLIT_SHARE: f64 = 1e-4;

/// How far measured light is from the reference. Relative figures are fractions: 0.03 is 3 %.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct LightErrors {
    /// Points compared: those with a measurement.
    pub points: usize,
    /// Points without a measurement.
    pub uncovered: usize,
    /// Median over points of `|measured - reference| / reference`.
    pub median_rel: f64,
    /// The same for the 90th percentile.
    pub p90_rel: f64,
    /// The same for the 99th percentile.
    pub p99_rel: f64,
    /// Root of the mean squared difference, over the mean reference: absolute errors, so bright points rule.
    pub rel_rmse: f64,
    /// Mean measured light over mean reference light, minus one.
    pub bias: f64,
    /// Median over points of the reference's own standard error, relative like the differences
    /// (channels' errors averaged, as if they were fully correlated).
    pub reference_noise_rel: f64,
    /// Share of points off by more than a factor of two either way.
    pub beyond_factor_two: f64,
    /// Points that the reference has next to no light at; they are in all figures above.
    pub unlit: usize,
    /// As [`Self::beyond_factor_two`], of the points that are not unlit.
    pub beyond_factor_two_lit: f64,
}

/// Why nothing can be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CompareError {
    /// The lists do not belong together.
    #[error("{reference} reference points but {measured} measurements")]
    LengthsDiffer {
        /// Reference points.
        reference: usize,
        /// Measurements.
        measured: usize,
    },
    /// No point has a measurement.
    #[error("none of the {0} points has a measurement: does the reference belong to this scene?")]
    NothingCovered(usize),
    /// There is nothing to be relative to.
    #[error("the reference is black at every compared point")]
    Black,
    /// A measurement is no light.
    #[error("the measurement at point {0} is not finite")]
    NotFinite(usize),
}

/// Compares `measured` (`None` where there is no patch to ask) with `reference`, point by point.
///
/// # Errors
/// The lists differ in length, nothing is covered, the reference is black, or a measurement is not finite.
pub fn compare_points(
    reference: &[ReferencePoint],
    measured: &[Option<Rgb>],
) -> Result<LightErrors, CompareError> {
    if reference.len() != measured.len() {
        return Err(CompareError::LengthsDiffer { reference: reference.len(), measured: measured.len() });
    }
    if let Some(index) = measured.iter().position(|light| light.is_some_and(|rgb| !rgb.is_finite())) {
        return Err(CompareError::NotFinite(index));
    }
    let pairs: Vec<Pair> =
        reference.iter().zip(measured).filter_map(|(r, m)| Some(Pair::of(r, (*m)?))).collect();
    if pairs.is_empty() {
        return Err(CompareError::NothingCovered(reference.len()));
    }
    let count = pairs.len() as f64;
    let mean = |value: &dyn Fn(&Pair) -> f64| pairs.iter().map(value).sum::<f64>() / count;
    let mean_reference = mean(&|pair| pair.reference);
    if mean_reference <= 0.0 {
        return Err(CompareError::Black);
    }
    let floor = DARK_SHARE * mean_reference;
    let relative = sorted(pairs.iter().map(|pair| pair.difference().abs() / pair.reference.max(floor)));
    let noise = sorted(pairs.iter().map(|pair| pair.noise / pair.reference.max(floor)));
    let far_off = pairs.iter().filter(|pair| pair.is_beyond_factor_two(floor)).count();
    let lit = || pairs.iter().filter(|pair| pair.reference > UNLIT_SHARE * mean_reference);
    let far_off_lit = lit().filter(|pair| pair.is_beyond_factor_two(floor)).count();
    Ok(LightErrors {
        points: pairs.len(),
        uncovered: reference.len() - pairs.len(),
        median_rel: percentile(&relative, 0.5),
        p90_rel: percentile(&relative, 0.9),
        p99_rel: percentile(&relative, 0.99),
        rel_rmse: mean(&|pair| pair.difference().powi(2)).sqrt() / mean_reference,
        bias: mean(&|pair| pair.measured) / mean_reference - 1.0,
        reference_noise_rel: percentile(&noise, 0.5),
        beyond_factor_two: far_off as f64 / count,
        unlit: pairs.len() - lit().count(),
        beyond_factor_two_lit: far_off_lit as f64 / lit().count() as f64,
    })
}

/// Points that are off by more than a factor of two, as [`LightErrors::beyond_factor_two`] counts them: their places in
/// the lists, ascending. Nothing where the lists cannot be compared.
#[must_use]
pub fn beyond_factor_two(reference: &[ReferencePoint], measured: &[Option<Rgb>]) -> Vec<usize> {
    let pair = |(index, (point, light)): (usize, (&ReferencePoint, &Option<Rgb>))| {
        Some((index, Pair::of(point, (*light)?)))
    };
    let pairs: Vec<(usize, Pair)> = reference.iter().zip(measured).enumerate().filter_map(pair).collect();
    let mean = pairs.iter().map(|(_, pair)| pair.reference).sum::<f64>() / pairs.len().max(1) as f64;
    let is_beyond = |pair: &Pair| pair.is_beyond_factor_two(DARK_SHARE * mean);
    pairs.iter().filter(|(_, pair)| is_beyond(pair)).map(|&(index, _)| index).collect()
}

struct Pair {
    reference: f64,
    noise: f64,
    measured: f64,
}

impl Pair {
    fn of(point: &ReferencePoint, measured: Rgb) -> Self {
        let mean = |rgb: Rgb| rgb.as_dvec3().element_sum() / 3.0;
        Self {
            reference: mean(point.irradiance),
            noise: mean(point.standard_error),
            measured: mean(measured),
        }
    }

    fn difference(&self) -> f64 {
        self.measured - self.reference
    }

    fn is_beyond_factor_two(&self, floor: f64) -> bool {
        let ratio = self.measured.max(floor) / self.reference.max(floor);
        !(0.5..=2.0).contains(&ratio)
    }
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The smallest value that at least `share` of `ascending` do not exceed.
///
/// # Panics
/// If there is none.
#[must_use]
pub fn percentile(ascending: &[f64], share: f64) -> f64 {
    let rank = (share * ascending.len() as f64).ceil() as usize;
    ascending[rank.clamp(1, ascending.len()) - 1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::Vec3;

    fn points(lights: &[f32]) -> Vec<ReferencePoint> {
        let point = |&light: &f32| ReferencePoint {
            position: Vec3::ZERO,
            normal: Vec3::Y,
            irradiance: Rgb::splat(light),
            standard_error: Rgb::splat(0.01 * light),
        };
        lights.iter().map(point).collect()
    }

    fn near(found: f64, expected: f64) -> bool {
        (found - expected).abs() < 1e-6
    }

    #[test]
    fn equal_light_has_no_error() {
        let reference = points(&[1.0, 2.0, 3.0]);
        let measured: Vec<_> = reference.iter().map(|point| Some(point.irradiance)).collect();
        let errors = compare_points(&reference, &measured).unwrap();
        assert_eq!((errors.median_rel, errors.rel_rmse, errors.bias), (0.0, 0.0, 0.0));
        assert!(near(errors.reference_noise_rel, 0.01));
    }

    #[test]
    fn figures_are_what_their_words_say() {
        let reference = points(&[10.0, 10.0, 10.0, 10.0, 10.0]);
        let measured = [Some(11.0), Some(9.5), Some(10.0), Some(30.0), None].map(|m| m.map(Rgb::splat));
        let errors = compare_points(&reference, &measured).unwrap();
        assert_eq!((errors.points, errors.uncovered), (4, 1));
        assert!(near(errors.median_rel, 0.05) && near(errors.p90_rel, 2.0), "{errors:?}");
        let squares: f64 = 1.0 + 0.25 + 0.0 + 400.0;
        assert!(near(errors.rel_rmse, (squares / 4.0).sqrt() / 10.0));
        assert!(near(errors.bias, 60.5 / 40.0 - 1.0) && near(errors.beyond_factor_two, 0.25));
    }

    #[test]
    fn near_black_points_are_measured_against_the_floor() {
        let reference = points(&[100.0, 100.0, 1e-6]);
        let measured = [Some(100.0), Some(100.0), Some(0.1)].map(|m| m.map(Rgb::splat));
        let errors = compare_points(&reference, &measured).unwrap();
        assert!(errors.p99_rel < 0.16 && errors.beyond_factor_two == 0.0, "{errors:?}");
    }

    #[test]
    fn unlit_points_are_counted_apart() {
        let reference = points(&[100.0, 100.0, 30.0, 0.0]);
        let measured = [Some(100.0), Some(250.0), Some(30.0), Some(50.0)].map(|m| m.map(Rgb::splat));
        let errors = compare_points(&reference, &measured).unwrap();
        assert_eq!((errors.unlit, errors.beyond_factor_two), (1, 0.5));
        assert!((errors.beyond_factor_two_lit - 1.0 / 3.0).abs() < 1e-9, "{errors:?}");
    }

    #[test]
    fn what_cannot_be_compared_is_said() {
        let one = points(&[1.0]);
        let lengths = CompareError::LengthsDiffer { reference: 1, measured: 0 };
        assert_eq!(compare_points(&one, &[]), Err(lengths));
        assert_eq!(compare_points(&one, &[None]), Err(CompareError::NothingCovered(1)));
        assert_eq!(compare_points(&points(&[0.0]), &[Some(Rgb::ONE)]), Err(CompareError::Black));
        assert_eq!(compare_points(&one, &[Some(Rgb::NAN)]), Err(CompareError::NotFinite(0)));
    }
}
