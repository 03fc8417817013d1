//! How different a picture is from what two noisy references have in common.
//!
//! A path-traced reference is never free of noise, and SSIM takes noise for structure that is missing. Noise of two
//! references of different seeds is independent: a product of one with the other knows none of it. So where a measure
//! squares the reference, one reference is multiplied by the other; what is left is the measure against a
//! reference of endless paths, but for rounding to 8 bits and what tone encoding makes of a mean of noisy pixels. Noise of the
//! measured picture itself still counts.
//!
//! SSIM divides by such a product, of one window, and that is noisy too. Where a wall is flat, noise of variance `s` in each
//! reference makes a variance `s^2 sum w^2` (w the window's weights) in a divisor of about SSIM's stabiliser: at 128 paths a
//! pixel as large as the divisor itself. Bounding a window's value to 1, and a variance to 0, would take all that is too
//! good and keep all that is too bad (.91 for .96 on a picture of Sponza). So neither is bounded, but for a divisor, at half
//! the stabiliser from below, and the mean of the quotient is corrected to second order;
//! [`NoiselessErrors::ssim_correction`] says by how much. What is left to higher orders is some thousandths where that is
//! below [`CORRECTION_MAX`], and makes the picture worse rather than better.
//!
//! Measures against a single reference are in [`crate::metrics`].

use crate::metrics::{SSIM_STABILISERS, SSIM_WINDOW, SizeError, blur, check_sizes, grey, window};
use image::RgbImage;

/// With a larger correction of SSIM the references are too noisy: take more paths.
pub const CORRECTION_MAX: f64 = 0.01;

/// Loss of SSIM that [`lost_ssim`] shows white.
const LOST_WHITE: f64 = 0.5;

/// How far a picture is from the reference behind two noisy ones.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct NoiselessErrors {
    /// As [`PictureErrors::ssim`](crate::metrics::PictureErrors::ssim).
    pub ssim: f64,
    /// By how much noise in the divisors had lifted it before that was taken out: trust `ssim` while it is below
    /// [`CORRECTION_MAX`].
    pub ssim_correction: f64,
    /// `-10 log10` of the mean of `(measured - one) (measured - other)`, dB; `None` where that is nothing or less.
    pub psnr_db: Option<f64>,
}

/// Compares 8-bit sRGB pictures of one exposure; the two references differ by their seeds alone.
///
/// # Errors
/// The pictures differ in size or are smaller than SSIM's window.
pub fn compare_noiseless(
    measured: &RgbImage,
    references: [&RgbImage; 2],
) -> Result<NoiselessErrors, SizeError> {
    references.iter().try_for_each(|reference| check_sizes(measured, reference))?;
    let [one, other] = references;
    let gap = |at: usize, reference: &RgbImage| {
        (f64::from(measured.as_raw()[at]) - f64::from(reference.as_raw()[at])) / 255.0
    };
    let count = measured.as_raw().len();
    let mse = (0..count).map(|at| gap(at, one) * gap(at, other)).sum::<f64>() / count as f64;
    let grey_references = references.map(grey);
    let (ssim, ssim_correction) = ssim(&grey(measured), &grey_references, measured.width() as usize);
    Ok(NoiselessErrors { ssim, ssim_correction, psnr_db: (mse > 0.0).then(|| -10.0 * mse.log10()) })
}

/// Where SSIM is lost: each pixel as white as the window around it falls short of 1, half of that being white; black within half a
/// window of the edges. Noise of the references makes single windows tremble, more than the mean of all.
///
/// # Errors
/// As [`compare_noiseless`].
pub fn lost_ssim(measured: &RgbImage, references: [&RgbImage; 2]) -> Result<RgbImage, SizeError> {
    references.iter().try_for_each(|reference| check_sizes(measured, reference))?;
    let windows = windows(&grey(measured), &references.map(grey), measured.width() as usize);
    let half = SSIM_WINDOW as u32 / 2;
    let across = measured.width() - 2 * half;
    let mut picture = RgbImage::new(measured.width(), measured.height());
    for (at, (_, corrected)) in (0..).zip(windows) {
        let white = ((1.0 - corrected) / LOST_WHITE).clamp(0.0, 1.0);
        picture.put_pixel(
            at % across + half,
            at / across + half,
            image::Rgb([(white * 255.0).round() as u8; 3]),
        );
    }
    Ok(picture)
}

/// Mean over the windows of SSIM, with the references' covariance for the reference's variance; and by how much that was
/// more before noise of the divisors was taken out.
fn ssim(measured: &[f64], references: &[Vec<f64>; 2], width: usize) -> (f64, f64) {
    let windows = windows(measured, references, width);
    let sums = windows.iter().fold((0.0, 0.0), |sum, window| (sum.0 + window.0, sum.1 + window.1));
    let count = windows.len() as f64;
    (sums.1 / count, (sums.0 - sums.1) / count)
}

/// SSIM of each window, before and after noise of its divisor is taken out.
fn windows(measured: &[f64], [one, other]: &[Vec<f64>; 2], width: usize) -> Vec<(f64, f64)> {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).collect::<Vec<f64>>();
    let blurred = |values: &[f64]| blur(values, width);
    let reference: Vec<f64> = one.iter().zip(other).map(|(a, b)| 0.5 * (a + b)).collect();
    let gaps: Vec<f64> = one.iter().zip(other).map(|(a, b)| a - b).collect();
    let (mean, mean_one, mean_other) = (blurred(measured), blurred(one), blurred(other));
    let squares = blurred(&product(measured, measured));
    let products = blurred(&product(measured, &reference));
    let common = blurred(&product(one, other));
    let square_gaps = blurred(&product(&gaps, &gaps));
    let weights = window().iter().map(|weight| weight * weight).sum::<f64>().powi(2);
    let [c1, c2] = SSIM_STABILISERS;
    let of_window = |at: usize| {
        let (a, b) = (mean[at], 0.5 * (mean_one[at] + mean_other[at]));
        let variance = common[at] - mean_one[at] * mean_other[at];
        let covariance = products[at] - a * b;
        // A window of noise alone may come out below nothing.
        let divisor = (squares[at] - a * a + variance + c2).max(0.5 * c2);
        // Of one reference's noise; then what it does to `variance`, and to that and `covariance` together.
        let noise = (0.5 * (square_gaps[at] - (mean_one[at] - mean_other[at]).powi(2))).max(0.0);
        let spread = weights * noise * (noise + 2.0 * variance.max(0.0));
        let together = weights * noise * covariance;
        let luminance = (2.0 * a * b + c1) / (a * a + b * b + c1);
        let found = luminance * (2.0 * covariance + c2) / divisor;
        // 1 / E[d] is about (1 - s / d^2) / d, s the divisor's variance; this form stays sound where s is large.
        let corrected = found * divisor * divisor / (divisor * divisor + spread)
            + luminance * 2.0 * together / (divisor * divisor);
        (found, corrected)
    };
    (0..mean.len()).map(of_window).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::compare_pictures;
    use earthshine_world::random::{Purpose, hash, unit_f32};

    const SIZE: u32 = 96;

    /// Waves, and noise of `amplitude` (encoded steps) on top.
    fn waves(amplitude: f32, seed: u64) -> RgbImage {
        let noise =
            |x: u32, y: u32| 2.0 * unit_f32(hash(seed, Purpose::MeasurePoint, x.into(), y.into())) - 1.0;
        let value = |x: u32, y: u32| {
            128.0 + 40.0 * (x as f32 * 0.35).sin() * (y as f32 * 0.2).cos() + amplitude * noise(x, y)
        };
        RgbImage::from_fn(SIZE, SIZE, |x, y| image::Rgb([value(x, y).round() as u8; 3]))
    }

    /// Goal: noise of the references costs a fifth of what it does, errors cost what they do against a clean reference. Method: a picture
    /// that is right, one that is shifted and one that is darker, against clean waves and against two noisy ones.
    #[test]
    fn noisy_references_measure_like_a_clean_one() {
        let (clean, noisy) = (waves(0.0, 0), [waves(24.0, 1), waves(24.0, 2)]);
        let shifted = RgbImage::from_fn(SIZE, SIZE, |x, y| *clean.get_pixel((x + 3) % SIZE, y));
        let mut darker = clean.clone();
        darker.pixels_mut().for_each(|pixel| pixel.0 = pixel.0.map(|value| value / 2));
        for measured in [&clean, &shifted, &darker] {
            let expected = compare_pictures(measured, &clean).unwrap();
            let naive = compare_pictures(measured, &noisy[0]).unwrap();
            let found = compare_noiseless(measured, [&noisy[0], &noisy[1]]).unwrap();
            let (lost, lost_to_noise) = (expected.ssim - found.ssim, expected.ssim - naive.ssim);
            assert!(lost_to_noise > 0.1, "{naive:?}");
            assert!(lost.abs() < 0.2 * lost_to_noise, "{found:?}, {expected:?}, {naive:?}");
            if let Some(psnr_db) = expected.psnr_db {
                assert!((found.psnr_db.unwrap() - psnr_db).abs() < 0.3, "{found:?}, {expected:?}");
            }
        }
    }

    /// Goal: a right picture of a flat wall is right, whatever the noise of the references. Method: a faint slope under noise as that of
    /// 512 to 4096 paths in Sponza, right and with waves that are not there, against a clean reference; windows bounded to 1 lost
    /// 0.012, 0.03 and 0.053 of the right one.
    #[test]
    fn noise_on_flat_walls_is_not_held_against_a_picture() {
        let slope = |amplitude: f32, seed: u64, waves: f32| {
            RgbImage::from_fn(4 * SIZE, 2 * SIZE, |x, y| {
                let pair =
                    [0, 1].map(|k| unit_f32(hash(seed, Purpose::MeasurePoint, x.into(), (2 * y + k).into())));
                // Of two even numbers: a triangle, of standard deviation `amplitude`.
                let noise = (pair[0] + pair[1] - 1.0) * amplitude * 6f32.sqrt();
                let wave = waves * (x as f32 * 0.5).sin() * (y as f32 * 0.7).sin();
                image::Rgb([(120.0 + 0.2 * x as f32 + wave + noise).round() as u8; 3])
            })
        };
        let (clean, wavy) = (slope(0.0, 0, 0.0), slope(0.0, 0, 6.0));
        for (amplitude, tolerance) in [(3.0, 0.003), (5.0, 0.006), (7.0, 0.02)] {
            let noisy = [slope(amplitude, 1, 0.0), slope(amplitude, 2, 0.0)];
            for measured in [&clean, &wavy] {
                let expected = compare_pictures(measured, &clean).unwrap().ssim;
                let found = compare_noiseless(measured, [&noisy[0], &noisy[1]]).unwrap();
                assert!((found.ssim - expected).abs() < tolerance, "{amplitude}: {found:?} for {expected}");
                assert!(
                    (found.ssim_correction < CORRECTION_MAX) == (amplitude < 6.0),
                    "{amplitude}: {found:?}"
                );
            }
        }
    }

    #[test]
    fn what_is_lost_is_shown_where_it_is() {
        let clean = waves(0.0, 0);
        let mut blot = clean.clone();
        for (x, y) in (40..60).flat_map(|x| (40..60).map(move |y| (x, y))) {
            blot.put_pixel(x, y, image::Rgb([128; 3]));
        }
        let lost = lost_ssim(&blot, [&clean, &clean]).unwrap();
        assert_eq!(lost.dimensions(), (SIZE, SIZE));
        assert!(lost.get_pixel(50, 50).0[0] > 200, "{:?}", lost.get_pixel(50, 50));
        assert!([(20, 20), (80, 50), (3, 3)].iter().all(|&(x, y)| lost.get_pixel(x, y).0 == [0; 3]));
    }

    #[test]
    fn sizes_that_do_not_match_are_errors() {
        let picture = waves(0.0, 0);
        let other = RgbImage::new(SIZE, SIZE + 1);
        assert!(compare_noiseless(&picture, [&picture, &other]).is_err());
        let tiny = RgbImage::new(5, 5);
        assert_eq!(compare_noiseless(&tiny, [&tiny, &tiny]), Err(SizeError::TooSmall(5, 5)));
    }
}
