//! How different a picture is from what two noisy references have in common.
//!
//! A path-traced reference is never free of noise, and SSIM takes noise for structure that is missing. Noise of two
//! references of different seeds is independent: a product of one with the other knows none of it. So where a measure
//! squares the reference, one reference is multiplied by the other; what is left is the measure against a
//! reference of endless paths, but for rounding to 8 bits. Noise of the measured picture itself still counts, and SSIM is
//! some hundredths off where noise is strong, most often low: windows are not let above 1, nor variances below 0.
//!
//! Measures against a single reference are in [`crate::metrics`].

use crate::metrics::{SSIM_STABILISERS, SizeError, blur, check_sizes, grey};
use image::RgbImage;

/// How far a picture is from the reference behind two noisy ones.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct NoiselessErrors {
    /// As [`PictureErrors::ssim`](crate::metrics::PictureErrors::ssim); a window counts at most 1.
    pub ssim: f64,
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
    Ok(NoiselessErrors {
        ssim: ssim(&grey(measured), &grey_references, measured.width() as usize),
        psnr_db: (mse > 0.0).then(|| -10.0 * mse.log10()),
    })
}

/// Mean over the windows of SSIM, with the references' covariance for the reference's variance.
fn ssim(measured: &[f64], [one, other]: &[Vec<f64>; 2], width: usize) -> f64 {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).collect::<Vec<f64>>();
    let blurred = |values: &[f64]| blur(values, width);
    let reference: Vec<f64> = one.iter().zip(other).map(|(a, b)| 0.5 * (a + b)).collect();
    let (mean, mean_one, mean_other) = (blurred(measured), blurred(one), blurred(other));
    let squares = blurred(&product(measured, measured));
    let products = blurred(&product(measured, &reference));
    let common = blurred(&product(one, other));
    let [c1, c2] = SSIM_STABILISERS;
    let of_window = |at: usize| {
        let (a, b) = (mean[at], 0.5 * (mean_one[at] + mean_other[at]));
        let own = squares[at] - a * a;
        // Noise may carry it below zero where the reference is flat.
        let references = (common[at] - mean_one[at] * mean_other[at]).max(0.0);
        let covariance = products[at] - a * b;
        let luminance = (2.0 * a * b + c1) / (a * a + b * b + c1);
        (luminance * (2.0 * covariance + c2) / (own + references + c2)).min(1.0)
    };
    (0..mean.len()).map(of_window).sum::<f64>() / mean.len() as f64
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

    #[test]
    fn sizes_that_do_not_match_are_errors() {
        let picture = waves(0.0, 0);
        let other = RgbImage::new(SIZE, SIZE + 1);
        assert!(compare_noiseless(&picture, [&picture, &other]).is_err());
        let tiny = RgbImage::new(5, 5);
        assert_eq!(compare_noiseless(&tiny, [&tiny, &tiny]), Err(SizeError::TooSmall(5, 5)));
    }
}
